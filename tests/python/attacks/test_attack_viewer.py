"""The viewer under attack, in small: tests/attacks has the programs that do it by the thousand."""

from __future__ import annotations

import random

import pytest

import sheetsplat as ss
from sheetsplat.viewer.data import Shown
from sheetsplat.viewer.session import _MOST_JOBS, Session

pytest.importorskip("aiohttp", reason="aiohttp is not installed")

from attacks import endings, lines, messages  # noqa: E402  # They need aiohttp.


@pytest.mark.slow
def test_messages_that_no_page_would_send() -> None:
    found = messages.messages(0, 600)
    assert not found.failures and found.done["messages"] == 600, found


@pytest.mark.slow
def test_lines_that_no_browser_would_make() -> None:
    found = lines.lines(0, 60)
    assert not found.failures and found.done["pages that got a picture"] >= 2, found


@pytest.mark.parametrize("kind", sorted(lines.KINDS))
def test_a_line_of_each_wrong_kind_leaves_the_page_of_another(kind: str) -> None:
    with messages.Faults() as faults, lines.viewer() as shown:
        with lines.Line(shown.url) as line:
            try:
                lines.KINDS[kind](line, random.Random(kind))
            except (OSError, AssertionError):
                pass
            assert lines.gets_a_picture(shown.url)
        assert faults.taken() == []


def test_a_reader_that_does_not_read_costs_no_memory() -> None:
    found = lines.slow_readers(0, 200)
    assert not found.failures, found


@pytest.mark.slow
def test_fifty_pages_at_once() -> None:
    found = lines.many_pages(0, 50)
    assert not found.failures and found.done["pages that got a picture"] == 32, found


def test_data_that_change_under_a_session() -> None:
    found = endings.swapped_fields(0, 60)
    assert not found.failures and found.done["pictures of whole files"] == 3, found


@pytest.mark.slow
def test_viewers_that_are_ended_with_pages_open() -> None:
    found = endings.ends_of_viewers(0, 3)
    assert not found.failures and found.done["pages that were open"] >= 3, found


WRONG = {
    "a plane that is a number": {"clip": {"planes": [3]}},
    "a camera without an angle": {"camera": {"kind": "perspective", "eye": [9, 9, 9], "target": [0, 0, 0]}},
    "a camera without an eye": {"camera": {"kind": "orthographic", "target": [0, 0, 0], "height": 1}},
    "occlusion without a radius": {"ambient_occlusion": {"strength": 0.5}},
    "an effect that is no text": {"effects": {"\ud800": False}},
}


@pytest.fixture
def told():
    """Return a session, its page, and what the page was told."""
    session = Session(Shown(messages.volumes()["first"], {"backend": "cpu", "threads": 1}, None, None), messages.SIZE)
    found: list[dict[str, object]] = []
    try:
        yield session, session.connect(lambda message, _: found.append(message)), found
    finally:
        session.close()


@pytest.mark.parametrize("changes", WRONG.values(), ids=list(WRONG))
def test_wrong_values_are_told_and_are_no_fault(told, changes) -> None:
    session, page, found = told
    with messages.Faults() as faults:
        session.receive(page, {"type": "hello", "width": 32, "height": 24})
        session.receive(page, {"type": "set", "changes": changes})
        assert messages.rest(session)
        assert faults.taken() == []
    assert any(one["type"] == "error" for one in found)


def test_a_wrong_value_after_a_scene_that_cannot_be_is_told(told) -> None:
    session, page, found = told
    together = {"shadows": True, "gradient_opacity": 20.0}
    with pytest.raises(ss.Error):
        ss.Scene(ss.RegularField(messages.volumes()["first"]), [(0, 1, 1, 1, 1)], **together)
    for _ in range(20):
        session.receive(page, {"type": "set", "changes": together})
        session.receive(page, {"type": "set", "changes": {"mode": 3}})
    assert messages.rest(session)
    assert sum(one["type"] == "error" for one in found) >= 20


def test_what_pages_wait_for_is_bounded_and_goes_with_them(told) -> None:
    session, page, _ = told
    with session._wake:
        for number in range(10 * _MOST_JOBS):
            session.receive(page, {"type": "hello", "width": 32, "height": 24})
            session.receive(page, {"type": "save", "width": 9 + number, "height": 9, "shown": False})
            session.receive(page, {"type": "pick", "x": 0.5, "y": number, "purpose": "tell"})
        assert len(session._jobs) <= _MOST_JOBS + 1 and len(session._idle_jobs) == 1
        session.disconnect(page)
        assert not session._jobs and not session._idle_jobs

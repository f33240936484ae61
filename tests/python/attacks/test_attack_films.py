"""Films under attack, in small: tests/attacks has the programs that do it by the hundred."""

from __future__ import annotations

import os
import threading
from pathlib import Path

import pytest

import sheetsplat as ss
from attacks import films
from sheetsplat.animation.folder import held
from sheetsplat.io.png_text import read_text

pytest.importorskip("imageio_ffmpeg", reason="imageio-ffmpeg is not installed")


@pytest.mark.slow
def test_killed_films_are_made_whole_to_the_same_bytes() -> None:
    found = films.kills_of_films(0, 3)
    assert not found.failures and found.done["films made whole to the same bytes"] == 3, found


def test_rubbish_in_place_of_frames() -> None:
    found = films.rubbish_frames(0, 60)
    assert not found.failures and found.done["films that were refused"] > 40, found


@pytest.mark.slow
def test_films_run_out_of_space() -> None:
    found = films.full_disks_of_films(0, 4)
    assert not found.failures, found


@pytest.mark.slow
def test_names_that_programs_trip_over() -> None:
    found = films.odd_names(0, 25)
    assert not found.failures and found.done["places that were refused"] == 6, found


@pytest.mark.slow
def test_two_processes_save_one_film() -> None:
    found = films.two_films_in_one_folder(0, 2)
    assert not found.failures, found


def test_two_films_at_once_in_one_folder(tmp_path: Path) -> None:
    made = films.film()[:2]
    began, goes_on = threading.Event(), threading.Event()

    def wait(_: float) -> None:
        began.set()
        goes_on.wait(30)

    thread = threading.Thread(target=made.save, args=(tmp_path / "film",), kwargs={"progress": wait})
    thread.start()
    try:
        assert began.wait(30)
        with pytest.raises(ss.Error, match="another film that is being written"):
            made.save(tmp_path / "film")
        # Other folders are free; the renderer of the first film is not.
        films.film()[:2].save(tmp_path / "other")
    finally:
        goes_on.set()
        thread.join()
    made.save(tmp_path / "film")
    assert films.content(tmp_path / "film") == films.content(tmp_path / "other")
    before = len(os.listdir("/proc/self/fd"))
    with held(tmp_path), pytest.raises(ss.Error), held(tmp_path):
        pass
    assert len(os.listdir("/proc/self/fd")) == before


def test_a_bit_that_changed_anywhere_is_found(tmp_path: Path) -> None:
    made = films.film()[:1]
    made.save(tmp_path / "film")
    (frame,) = (tmp_path / "film").iterdir()
    whole = frame.read_bytes()
    assert read_text(frame, 200, "sheetsplat frame", whole=True)
    for at in range(0, len(whole), 7):
        frame.write_bytes(whole[:at] + bytes([whole[at] ^ 4]) + whole[at + 1 :])
        with pytest.raises(ss.InvalidInput):
            read_text(frame, 200, "sheetsplat frame", whole=True)

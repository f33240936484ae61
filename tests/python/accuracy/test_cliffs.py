"""No effect, and no pair of effects, costs over three times the plain frames that it did: ratios within one run."""

from __future__ import annotations

import pytest

from bench import cliffs_small
from bench.cliffs_small import FIELDS, MOST, cliffs, measured, ratios, stored_ratios


def _told(wrong: list[str]) -> str:
    return (
        f"{len(wrong)} effects cost over {MOST} times what is stored in {cliffs_small.STORED.name}:\n"
        + "\n".join(wrong)
        + "\nWhere that is what they are worth: ./run bench cliffs --row store"
    )


@pytest.mark.alone
@pytest.mark.parametrize("name", FIELDS)
def test_no_effect_costs_three_times_what_it_did(name: str) -> None:
    subject = cliffs_small.subject_of(name)
    found, stored = ratios(measured(subject)), stored_ratios()[name]
    assert set(found) == set(stored), "effects came or went: ./run bench cliffs --row store"
    wrong = cliffs(subject, found, stored)
    assert not wrong, _told(wrong)


@pytest.mark.alone
def test_a_cliff_is_found() -> None:
    """Shadows take over three plain frames in pictures as small as these, which would be a cliff if one was stored."""
    subject = cliffs_small.subject_of("ball")
    found = ratios(cliffs_small.rows(subject, ["shadows", "clip"]))
    (told,) = cliffs(subject, found, {"shadows": [1.0, 1.0], "clip": found["clip"]})
    assert told.startswith("shadows: ") and told.endswith("stored 1.00 and 1.00")
    # What was slow once, and is not when it is measured again, is none.
    assert not cliffs(subject, {"clip": [100.0, 100.0]}, {"clip": found["clip"]})
    (missing,) = cliffs(subject, {}, {"clip": [1.0, 1.0]})
    assert missing == "clip: could not be drawn"

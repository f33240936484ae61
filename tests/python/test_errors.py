"""Errors carry fields, and each front end spells the options in them."""

from __future__ import annotations

import copy
import pickle

import numpy as np
import pytest

import sheetsplat as ss
from sheetsplat.errors import OptionRef, Words, complain, option_ref, spelled_in_python

KINDS = (ss.Error, ss.InvalidInput, ss.DeviceUnavailable, ss.OutOfMemory, ss.Unsupported, ss.Cancelled)


@pytest.mark.parametrize(
    ("option", "spelled"),
    [
        (OptionRef("max_error"), "max_error"),
        (OptionRef("allow_inexact", "true"), "allow_inexact=True"),
        (OptionRef("prefilter", "false"), "prefilter=False"),
        (OptionRef("filter", "none"), "filter=None"),
        (OptionRef("nan", "skip"), 'nan="skip"'),
        (OptionRef("max_error", "1e-3"), "max_error=1e-3"),
        (OptionRef("neighbors", "32"), "neighbors=32"),
        (OptionRef("scalar", "..."), "scalar=..."),
    ],
)
def test_python_spells_options_as_keyword_arguments(option: OptionRef, spelled: str) -> None:
    assert spelled_in_python(option) == spelled


def test_words_are_joined_piece_by_piece() -> None:
    words = "use " + option_ref("nan", "skip") + " or " + option_ref("w0")
    assert words.text() == 'use nan="skip" or w0'
    assert words.text(lambda option: f"<{option.name}>") == "use <nan> or <w0>"
    assert not Words.of("")
    assert Words.of(words) is words


@pytest.mark.parametrize("kind", KINDS)
def test_fields_and_text(kind: type[ss.Error]) -> None:
    advice = "pass " + option_ref("nan", "skip")
    error = complain("it failed", "3", "4", advice, option="nan", kind=kind)
    assert type(error) is kind
    assert (error.what, error.found, error.wanted, error.advice) == ("it failed", "3", "4", 'pass nan="skip"')
    assert error.option == "nan"
    assert str(error) == 'it failed: found 3; wanted 4; pass nan="skip"'
    assert error.complaint.text(lambda option: f"--{option.name} {option.value}").endswith("; pass --nan skip")


def test_empty_fields_are_left_out() -> None:
    assert str(complain("it failed")) == "it failed"
    assert str(complain("it failed", wanted="4")) == "it failed: wanted 4"
    assert str(complain("", "3", "4")) == "found 3; wanted 4"
    assert complain("it failed").option is None


def test_option_is_the_only_one_that_failed() -> None:
    assert complain(option_ref("w0") + " cannot be used", advice=option_ref("nan")).option == "w0"
    assert complain(option_ref("w0") + " and " + option_ref("nan") + " do not go together").option is None


def test_texts_are_bounded() -> None:
    assert len(str(complain("it failed", "x" * 10**6))) < 2000


@pytest.mark.parametrize("kind", KINDS)
def test_errors_cross_processes(kind: type[ss.Error]) -> None:
    error = complain("it failed", "3", "4", "pass " + option_ref("nan", "skip"), option="nan", kind=kind)
    for other in (pickle.loads(pickle.dumps(error)), copy.deepcopy(error)):
        assert type(other) is kind
        assert other.complaint == error.complaint
        assert str(other) == str(error)


def test_errors_of_the_native_half_have_fields() -> None:
    with pytest.raises(ss.InvalidInput) as raised:
        ss.RegularField(np.full((2, 2, 2), np.nan))
    error = raised.value
    assert error.what == "RegularField: the samples cannot be used"
    assert error.found == "NaN at sample (0, 0, 0)"
    assert error.wanted == "finite numbers"
    assert pickle.loads(pickle.dumps(error)).complaint == error.complaint
    assert isinstance(error, ValueError)

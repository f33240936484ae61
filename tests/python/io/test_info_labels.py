"""`sheetsplat info` on labels: how many there are, who says so, names and colours; a hint where there may be some."""

from __future__ import annotations

import json

import numpy as np
import pytest
from command_line import run
from test_channels import LABELS, dicom_segments, label_image, nifti, nrrd, segmentation

import sheetsplat as ss
from sheetsplat.api import prepare

RED = [1.0, 0.0, 0.0, 1.0]


def regions():
    """Return regions of 1, 3 and 7, beside which others than the next ones lie."""
    values = np.zeros((12, 12, 12), np.uint8)
    values[2:6, 2:10, 2:6], values[2:10, 2:10, 6:10], values[6:10, 2:10, 2:6] = 1, 7, 3
    return values


def shells():
    """Return regions 1, 2 and 3 of which each touches the next ones alone."""
    k, j, i = np.mgrid[0:24, 0:24, 0:24] - 11.5
    return np.clip(4 - np.round(np.sqrt(k**2 + j**2 + i**2) / 4), 0, 3).astype(np.uint8)


def told(path, *options):
    """Return what info says of a file, as JSON and as text."""
    return json.loads(run("info", path, "--json", *options).stdout), run("info", path, *options).stdout


STATED = {
    "nifti": (lambda folder: nifti(folder / "a.nii", values=LABELS, intent_code=1002), {}, {}),
    "slicer": (
        lambda folder: segmentation(folder / "a.seg.nrrd"),
        {1: "liver", 5: "lung"},
        {1: RED, 5: [0.0, 0.5, 1.0, 1.0]},
    ),
    "ome-zarr": (lambda folder: label_image(folder / "a.zarr"), {1: "liver"}, {1: RED, 5: [0.0, 0.2, 1.0, 0.4]}),
}


@pytest.mark.parametrize("kind", STATED)
def test_labels_that_a_file_states(tmp_path, kind):
    write, names, colors = STATED[kind]
    report, text = told(write(tmp_path))
    assert report["labels_by"] == "file" and "\nshown " not in text and "clim" not in report
    assert "\nlabels      3 beside the background, as the file states; --no-labels shows them as values\n" in text
    listed = {one["label"]: one for one in report["labels"]}
    shown = ss.LabelColors.distinct(np.unique(LABELS)).colors
    assert list(listed) == np.unique(LABELS).tolist()
    for label, one in listed.items():
        assert one["samples"] == int((LABELS == label).sum()) and one["name"] == names.get(label, "")
        assert one["background"] == (label == 0)
        expected = colors.get(label, list(shown[label]) if label in shown else None)
        assert one["color"] == (None if expected is None else pytest.approx(expected))
    (line,) = [one for one in text.splitlines() if one.split()[:1] == ["0"]]
    assert line.split() == ["0", "background", "not", "shown", str(int((LABELS == 0).sum()))]
    if colors:
        (line,) = [one for one in text.splitlines() if one.split()[:1] == ["1"]]
        assert line.split() == ["1", "liver", "#ff0000", str(int((LABELS == 1).sum()))]


def test_labels_of_dicom(tmp_path):
    path, masks = dicom_segments(tmp_path / "a", order=((1, 0), (1, 1), (2, 3)))
    report, text = told(path)
    assert [(one["label"], one["name"]) for one in report["labels"]] == [(0, ""), (1, "liver"), (2, "lung")]
    assert report["labels"][2]["samples"] == int(masks[2].sum()) and "lung" in text


def test_layers_of_segments_are_told_apart(tmp_path):
    two = np.stack([np.where(LABELS == 1, 1, 0), np.where(LABELS == 5, 5, 0)], axis=3).astype(np.uint8)
    report, text = told(segmentation(tmp_path / "a.seg.nrrd", two, 2, kinds=["list", *["domain"] * 3]))
    named = {(one["channel"], one["label"]): one["name"] for one in report["labels"]}
    assert named[report["channels"][0], 1] == "liver" and named[report["channels"][1], 5] == "lung"
    assert "labels      2 beside the background" in text and f"{report['channels'][1]}: lung" in text


def test_labels_that_samples_look_like(tmp_path):
    np.save(tmp_path / "a.npy", regions())
    report, text = told(tmp_path / "a.npy")
    assert report["labels_by"] == "samples" and [one["label"] for one in report["labels"]] == [0, 1, 3, 7]
    assert "3 beside the background, few whole numbers between which nothing lies; --no-labels" in text
    # Those of pictures.
    shown = prepare(tmp_path / "a.npy", size=16).scene.transfer_functions[0].colors
    assert {one["label"]: tuple(one["color"]) for one in report["labels"][1:]} == dict(shown)
    values, text = told(tmp_path / "a.npy", "--no-labels")
    assert not {"labels", "whole_numbers"} & values.keys() and "\nshown " in text and "\nlabels " not in text


def test_shells_may_be_labels(tmp_path):
    """Each touches the next ones alone, as steps of measured values do."""
    np.save(tmp_path / "a.npy", shells())
    report, text = told(tmp_path / "a.npy")
    assert report["whole_numbers"] == [0, 1, 2, 3] and "labels" not in report
    assert (
        "\nvalues      0, 1, 2, 3, each in regions of its own; where they name things, --labels shows these\n" in text
    )
    report, text = told(tmp_path / "a.npy", "--labels")
    assert (
        report["labels_by"] == "caller" and len(report["labels"]) == 4 and "3 beside the background, as given" in text
    )
    plan = ss.render(tmp_path / "a.npy", size=16).plan.quality.of("prefilter").reason
    assert "labels=True" in plan


def test_no_hint_where_values_are_measured(tmp_path):
    k, j, i = np.mgrid[0:20, 0:20, 0:20]
    for name, values in {
        "noise": np.random.default_rng(3).integers(0, 6, (20, 20, 20)).astype(np.uint8),
        "ramp": (10 * i + j).astype(np.uint8),
        "floats": np.sin(0.3 * (i + j + k)),
        "all the same": np.full((4, 4, 4), 3),
    }.items():
        np.save(tmp_path / "a.npy", values)
        report, text = told(tmp_path / "a.npy")
        assert not {"labels", "whole_numbers"} & report.keys() and "--labels" not in text, name


def test_thousands_of_labels(tmp_path):
    report, text = told(label_image(tmp_path / "a.zarr", np.arange(4000, dtype=np.uint16).reshape(10, 20, 20)))
    assert len(report["labels"]) == 4000 and "a picture tells at most 256 apart" in text
    assert "... and 3936 more; --json lists all" in text


def test_names_of_labels_are_text(tmp_path):
    path = nrrd(tmp_path / "a.seg.nrrd", LABELS, Segment0_LabelValue="1", Segment0_Name="a\x1b[31mb")
    assert "\x1b" not in run("info", path).stdout

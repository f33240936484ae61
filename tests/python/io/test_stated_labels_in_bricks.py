"""Files that state labels, in bricks: they are drawn as labels, as the same files in memory."""

from __future__ import annotations

import numpy as np
import pytest
from command_line import run
from labelled_volumes import things
from test_channels import label_image, segmentation

import sheetsplat as ss

SIZE = (44, 36)
BOUND = 3e-5
STATED = {
    "a.zarr": lambda path: label_image(path, things(), colors=[{"label-value": 2, "rgba": [0, 255, 0, 255]}]),
    "a.seg.nrrd": lambda path: segmentation(path, things()),
}


@pytest.mark.parametrize("name", STATED)
def test_files_that_state_labels_are_drawn_as_labels(tmp_path, name):
    path = STATED[name](tmp_path / name)
    whole, bricked = ss.open(path), ss.open_bricks(path, brick=8)
    assert whole.labels and bricked.labels and bricked.label_colors == whole.label_colors is not None
    made = [ss.render(one, size=SIZE) for one in (whole, bricked)]
    assert made[0].recipe.transfer_functions == made[1].recipe.transfer_functions
    assert np.abs(made[0].rgba - made[1].rgba).max() < BOUND
    assert "samples name things" in made[1].plan.quality.of("labels").reason
    assert not ss.open_bricks(path, brick=8, labels=False).labels
    # Whoever asks for another way of summing asks for values.
    assert not ss.open_bricks(path, brick=8, normalization="none").labels
    picture = tmp_path / "a.png"
    run("render", path, "--brick", 8, "--size", "44x36", "-o", picture)
    assert ss.Recipe.read(picture).fields[0].options["labels"] is True


def test_halves_are_shown_as_values_where_a_file_states_labels(tmp_path):
    path = label_image(tmp_path / "a.zarr", things() + np.float32(0.5))
    with pytest.warns(ss.PictureWarning, match="states labels, but has numbers that are not whole"):
        assert not ss.open_bricks(path, brick=8).labels

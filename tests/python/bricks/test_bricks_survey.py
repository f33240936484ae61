"""Volumes in bricks: statistics of all samples, values at points, and what stays in memory."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from bricked_volumes import ROUNDING, SHAPE, SIZE, blob, rmse, stored

import sheetsplat as ss
from sheetsplat import api
from sheetsplat.bricks.resident import Residents, residents
from sheetsplat.bricks.sources import open_source
from sheetsplat.bricks.statistics import SurveyPlan, merge_surveys, survey_brick
from sheetsplat.look.histogram import choose_for


def surveyed(samples, edges, lattice="cartesian"):
    """Return what is known of an array by bricks with these edges."""
    source = open_source(samples, {})
    plan = SurveyPlan.of(source.shape, lattice)
    cores = list(itertools.product(*([(a, min(a + edge, size)) for a in range(0, size, edge)]
                                     for edge, size in zip(edges, samples.shape, strict=True))))  # fmt: skip
    parts = []
    for number, core in enumerate(cores):
        outer = plan.margin(core)
        parts.append((survey_brick(source.read(outer), outer, core, number, plan, "it"),))
    from sheetsplat.bricks.statistics import Survey

    one_by_one = merge_surveys(None, *parts)
    halves = parts[:1], parts[1:]
    in_a_tree = merge_surveys(None, *(merge_surveys(None, *half) for half in halves))
    assert one_by_one == in_a_tree
    return Survey.of(source, one_by_one, cores, plan)


@pytest.mark.parametrize("edges", [(64, 64, 64), (16, 9, 30), (1, 46, 41), (5, 5, 5)])
@pytest.mark.parametrize("lattice", ["cartesian", "bcc"])
def test_a_survey_has_what_looks_ask_of_an_array(edges, lattice, rng):
    noisy = blob(kind=np.float32) + rng.normal(size=SHAPE).astype(np.float32)
    field = ss.RegularField(noisy, lattice=lattice)
    found, own = surveyed(noisy, edges, lattice), field.samples
    plan = SurveyPlan.of(SHAPE, lattice)
    for stride in plan.strides:
        np.testing.assert_array_equal(found.every(stride), own.every(stride))
    np.testing.assert_array_equal(found.on_grid(plan.steps), own.on_grid(plan.steps))
    assert found.value_range == field.value_range
    mine, others = (one.roughness(plan.starts, plan.apart, field.value_range) for one in (found, own))
    assert mine[0] / mine[1] == pytest.approx(others[0] / others[1], rel=1e-9)
    high = float(np.quantile(noisy, 0.999))
    np.testing.assert_array_equal(found.beyond(high, above=True), own.beyond(high, above=True))
    assert found.within(high) == own.within(high)
    assert choose_for(found) == choose_for(own)


def test_missing_samples_bound_the_centres(rng):
    values = rng.normal(size=(12, 13, 14)).astype(np.float32)
    values[:3], values[:, 11:], values[..., :2] = np.nan, np.nan, np.nan
    for lattice in ("cartesian", "bcc"):
        field = ss.RegularField(values, lattice=lattice, nan="skip", spacing=(2, 3, 4), origin=(1, 2, 3))
        bricked = ss.open_bricks(
            values, brick=5, lattice=lattice, nan="skip", spacing=(2, 3, 4), origin=(1, 2, 3), quality="draft"
        )
        assert bricked.size == field.size
        np.testing.assert_allclose(bricked.centre_bounds, field.centre_bounds, rtol=1e-15)
        np.testing.assert_allclose(bricked.bounds, field.bounds, rtol=1e-14)


@pytest.mark.parametrize(
    "options",
    [{}, {"quality": "best"}, {"slice_spacing": 0.5}, {"mode": "isosurface"}, {"shading": False}, {"mode": "mip"}],
)
def test_a_volume_in_bricks_looks_as_in_memory(samples, tmp_path, options):
    data, _ = stored("npy", samples, tmp_path)
    quality = {name: options[name] for name in ("quality",) if name in options}
    options = {name: value for name, value in options.items() if name != "quality"}
    one = api.prepare(ss.open(data, **quality), size=SIZE, **quality, **options)
    other = api.prepare(ss.open_bricks(data, brick=16, **quality), size=SIZE, **quality, **options)
    assert one.camera == other.camera and one.scene.transfer_function == other.scene.transfer_function
    assert one.scene.options == other.scene.options
    assert one.scene.fields[0].prefilter == other.scene.fields[0].prefilter


@pytest.mark.parametrize("options", [{}, {"prefilter": True}, {"lattice": "bcc"}, {"normalization": "threshold"}])
def test_values_at_points_are_those_of_the_volume(samples, options, rng):
    options = {"prefilter": False, "spacing": (1.0, 1.0, 1.0), "origin": (3.0, -2.0, 1.0), **options}
    if "normalization" in options:
        del options["prefilter"]
    whole = ss.RegularField(samples, **options)
    bricked = ss.open_bricks(samples, brick=16, quality="draft", **options)
    lower, upper = np.asarray(whole.bounds)
    points = rng.uniform(lower - 1, upper + 1, (500, 3))
    np.testing.assert_allclose(bricked.at(points), whole.at(points), atol=2e-6)
    for mine, others in zip(bricked.evaluate(points), whole.evaluate(points), strict=True):
        np.testing.assert_allclose(mine, others, atol=5e-6)
    np.testing.assert_array_equal(bricked.nearest_kernel(points), whole.nearest_kernel(points))
    with pytest.raises(ss.InvalidInput, match="positions"):
        bricked.at([1.0, 2.0])


@pytest.mark.parametrize("mode", ["composite", "isosurface", "mip"])
def test_pictures_in_bricks_are_picked(samples, mode):
    options = {"size": SIZE, "mode": mode, "quality": "draft", "azimuth": 35, "elevation": 20}
    one = ss.render(ss.RegularField(samples), backend="cpu", **options).pick(33, 28)
    other = ss.render(ss.open_bricks(samples, brick=16, quality="draft"), **options).pick(33, 28)
    assert (one.kernel, one.sample, one.field) == (other.kernel, other.sample, other.field)
    for name in ("position", "depth", "value", "gradient"):
        np.testing.assert_allclose(getattr(one, name), getattr(other, name), rtol=1e-5, atol=1e-5)


@pytest.mark.slow
def test_the_cluster_chooses_the_slices_that_light_calls_for(cluster, samples, rng):
    noisy = np.clip(samples.astype(np.float32) + rng.normal(size=SHAPE, scale=2), 0, 255).astype(np.float32)
    for quality in ("good", "best"):
        one = api.prepare(ss.RegularField(noisy), size=SIZE, quality=quality)
        bricked = ss.open_bricks(noisy, brick=16, client=cluster, quality=quality)
        before = residents().counts.reads
        other = api.prepare(bricked, size=SIZE, quality=quality)
        assert one.scene.options == other.scene.options
        # Nothing passes through the client.
        assert residents().counts.reads == before
    drawn = ss.render(bricked, size=SIZE, quality="best", client=cluster)
    assert rmse(drawn, ss.render(ss.RegularField(noisy), size=SIZE, quality="best")) <= ROUNDING


def test_fields_of_bricks_are_made_once_for_views_of_one_kind(samples, monkeypatch):
    from sheetsplat.bricks import lattice as module

    made, make = [], module.LatticeSpec.field
    monkeypatch.setattr(module.LatticeSpec, "field", lambda *given: made.append(given[2]) or make(*given))
    bricked = ss.open_bricks(samples, brick=24, prefilter=True)
    for turn in range(3):
        del made[:]
        drawn = ss.render(bricked, size=SIZE)
        # The first time for values along rays, and with wider borders for the picture.
        assert len(made) <= (2 * drawn.stats["bricks"] if turn == 0 else 0)


def test_bricks_that_show_nothing_are_not_read_for_slices(samples):
    empty = np.zeros((64, 32, 32), np.uint8)
    empty[4:20, 8:24, 8:24] = 200
    bricked = ss.open_bricks(empty, brick=16, quality="draft")
    residents().clear()
    before = residents().counts.reads
    assert api.prepare(bricked, size=SIZE).scene.quality is not None
    # Of 16 bricks four are farther than any kernel reaches.
    assert 0 < residents().counts.reads - before <= 12 < len(bricked.survey.cores)


def test_decades_are_found_in_bricks(rng, tmp_path):
    decades = (10.0 ** (6 * blob(kind=np.float64) / 200 - 5)).astype(np.float32)
    np.save(tmp_path / "v.npy", decades)
    one = api.prepare(ss.open(tmp_path / "v.npy"), size=SIZE)
    other = api.prepare(ss.open_bricks(tmp_path / "v.npy", brick=16), size=SIZE)
    assert one.scene.fields[0].quantity == other.scene.fields[0].quantity
    assert other.scene.fields[0].quantity.floor is not None
    assert one.scene.transfer_function == other.scene.transfer_function


class Counted:
    def __init__(self):
        self.key, self.boxes = "counted", []

    def read(self, box):
        self.boxes.append(box)
        return np.zeros([last - first for first, last in box], np.uint8)


class Picture:
    """One picture."""


def test_what_the_last_picture_used_stays():
    source, kept = Counted(), Residents(2500)
    boxes = [((n * 10, n * 10 + 10), (0, 10), (0, 10)) for n in range(4)]

    def asked(*numbers):
        """Return the numbers of the boxes that a picture of some boxes reads."""
        before, picture = len(source.boxes), Picture()
        kept.begin(picture)
        for number in numbers:
            assert kept.samples(source, boxes[number], boxes[number]).shape == (10, 10, 10)
        assert kept.size <= kept.budget
        return [boxes.index(one) for one in source.boxes[before:]]

    assert asked(0, 1, 2) == [0, 1, 2]
    # Two fit: the third is read again, and not all three.
    assert asked(0, 1, 2) == [2]
    assert asked(2, 1, 0) == [2]
    # Of what no picture used any more the least used goes first.
    assert asked(3) == [3] and asked(3) == [3]
    assert asked(3) == [] and asked(0) == [] and asked(1) == [1]
    assert kept.counts.reads == len(source.boxes) and kept.counts.hits + kept.counts.reads == 14


def test_views_that_look_less_far_leave_what_others_need():
    source = Counted()
    core, far, near = ((8, 16),) * 3, ((2, 22),) * 3, ((6, 18),) * 3

    def reads(kept, box):
        before = len(source.boxes)
        made = kept.made(source, core, box, "a key", lambda samples: ss.RegularField(samples, boundary="zero"))
        assert made.shape == tuple(last - first for first, last in box)
        return len(source.boxes) - before

    ample = Residents(1 << 20)
    assert [reads(ample, box) for box in (far, near, far, near, far)] == [1, 0, 0, 0, 0]
    # 20**3 samples and 12**3 do not fit together: then the brick stays, as its last view needs it.
    short = Residents(10500)
    assert [reads(short, box) for box in (far, near, near, far)] == [1, 0, 0, 1]
    assert short.size <= short.budget and short.counts.dropped == 0

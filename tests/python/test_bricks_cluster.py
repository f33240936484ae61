"""Volumes in bricks: what is read of files, statistics of all samples, and pictures by the workers of a cluster."""

from __future__ import annotations

import itertools
import os
import pickle
import signal
import subprocess
import sys
import threading
import time

import numpy as np
import pytest

import sheetsplat as ss
from sheetsplat import api
from sheetsplat.bricks.cluster import covering
from sheetsplat.bricks.needs import view_of
from sheetsplat.bricks.resident import Residents, residents
from sheetsplat.bricks.sources import open_source
from sheetsplat.bricks.statistics import SurveyPlan, merge_surveys, survey_brick
from sheetsplat.look.histogram import choose_for

SIZE = (72, 60)
SHAPE = (37, 46, 41)
# Rounding of float32: what is drawn in bricks is the picture of the whole.
ROUNDING = 1e-6


def blob(shape=SHAPE, kind=np.uint8):
    """Return two soft balls, one of them behind the other in most views."""
    k, j, i = (np.arange(size, dtype=np.float64) / size for size in shape)
    k, j, i = k[:, None, None], j[None, :, None], i[None, None, :]
    first = np.exp(-((k - 0.4) ** 2 + (j - 0.5) ** 2 + (i - 0.45) ** 2) / 0.03)
    second = np.exp(-((k - 0.7) ** 2 + (j - 0.6) ** 2 + (i - 0.7) ** 2) / 0.008)
    values = 200 * np.maximum(first, 0.8 * second)
    return values.round().astype(kind) if np.dtype(kind).kind in "iu" else values.astype(kind)


@pytest.fixture(scope="module")
def samples():
    return blob()


def rmse(one, other):
    return float(np.sqrt(np.mean((one.pixels.astype(np.float64) - other.pixels) ** 2)))


@pytest.fixture(scope="module")
def cluster():
    """Return a client of two processes of one thread each."""
    distributed = pytest.importorskip("distributed", reason="no distributed: pip install 'sheetsplat[distributed]'")
    with (
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None, silence_logs=50
        ) as made,
        distributed.Client(made) as client,
    ):
        yield client


def stored(kind, samples, folder):
    """Return what `open_bricks` and `open` take for the samples in a format, with options."""
    if kind == "npy":
        np.save(folder / "v.npy", samples)
        return folder / "v.npy", {}
    if kind == "fortran":
        np.save(folder / "v.npy", np.asfortranarray(samples))
        return folder / "v.npy", {}
    if kind == "raw":
        (folder / "v.raw").write_bytes(b"head" + samples.astype(">i2").tobytes())
        return folder / "v.raw", {"shape": samples.shape, "dtype": ">i2", "offset": 4}
    if kind == "nrrd":
        header = f"NRRD0004\ntype: uchar\ndimension: 3\nsizes: {' '.join(map(str, samples.shape[::-1]))}\n"
        header += "encoding: raw\nspace dimension: 3\nspace directions: (-2,0,0) (0,1.5,0) (0,0,-1)\n"
        header += "space origin: (1,2,3)\ndata file: v.bin\n"
        (folder / "v.nhdr").write_text(header)
        (folder / "v.bin").write_bytes(samples.tobytes())
        return folder / "v.nhdr", {}
    if kind == "metaimage":
        header = f"NDims = 3\nDimSize = {' '.join(map(str, samples.shape[::-1]))}\nElementType = MET_UCHAR\n"
        (folder / "v.mha").write_bytes((header + "ElementDataFile = LOCAL\n").encode() + samples.tobytes())
        return folder / "v.mha", {}
    if kind == "hdf5":
        h5py = pytest.importorskip("h5py")
        with h5py.File(folder / "v.h5", "w") as file:
            file.create_dataset("a/b", data=samples[:, None], chunks=(8, 1, 9, 10), compression="gzip")
        return f"{folder / 'v.h5'}:/a/b", {}
    if kind in ("zarr", "ome-zarr"):
        zarr = pytest.importorskip("zarr")
        if kind == "zarr":
            array = zarr.create_array(folder / "v.zarr", shape=samples.shape, chunks=(9, 16, 8), dtype=samples.dtype)
            array[:] = samples
            return folder / "v.zarr", {}
        group = zarr.create_group(folder / "v.zarr", zarr_format=2)
        array = group.create_array("0", shape=(1, *samples.shape), chunks=(1, 16, 16, 16), dtype=samples.dtype)
        array[:] = samples[None]
        axes = [{"name": name, "type": "space" if name in "zyx" else "channel"} for name in "czyx"]
        level = {"path": "0", "coordinateTransformations": [{"type": "scale", "scale": [1, 3.0, 2.0, 1.0]}]}
        group.attrs["multiscales"] = [{"version": "0.4", "axes": axes, "datasets": [level]}]
        return folder / "v.zarr", {}
    xarray = pytest.importorskip("xarray")
    coords = {"z": np.arange(samples.shape[0])[::-1] * 2.0, "y": np.arange(samples.shape[1]) * 1.0}
    array = xarray.DataArray(samples.astype(np.float32), dims=("z", "y", "x"), coords=coords, name="rho")
    if kind == "netcdf":
        pytest.importorskip("h5netcdf")
        array.to_netcdf(folder / "v.nc", engine="h5netcdf")
        return folder / "v.nc", {}
    if kind == "netcdf classic":
        array.to_netcdf(folder / "v.nc", engine="scipy")
        return folder / "v.nc", {}
    if kind == "xarray":
        return array, {}
    dask = pytest.importorskip("dask.array")
    return dask.from_array(samples, chunks=(10, 20, 30)), {}


KINDS = (
    "npy", "fortran", "raw", "nrrd", "metaimage", "hdf5", "zarr", "ome-zarr", "netcdf", "netcdf classic",
    "xarray", "dask",
)  # fmt: skip


@pytest.mark.parametrize("kind", KINDS)
def test_boxes_of_a_source_are_those_of_the_opened_volume(kind, samples, tmp_path):
    data, options = stored(kind, samples, tmp_path)
    whole = ss.open(data, quality="draft", **options)
    source = open_source(data, options)
    assert source.shape == whole.shape and source.spacing == whole.spacing and source.origin == whole.origin
    assert source.quantity == whole.quantity and source.orientation == whole.orientation
    for box in (((0, 37), (0, 46), (0, 41)), ((3, 12), (45, 46), (7, 33)), ((36, 37), (0, 5), (40, 41))):
        cut = tuple(slice(*part) for part in box)
        np.testing.assert_array_equal(source.read(box), whole.values[cut])
    again = pickle.loads(pickle.dumps(source))
    assert again == source and again.token == source.token


def test_remote_raw_samples_are_read_by_ranges(samples, tmp_path):
    pytest.importorskip("fsspec")
    (tmp_path / "v.raw").write_bytes(samples.tobytes())
    source = open_source(f"file://{tmp_path / 'v.raw'}", {"shape": SHAPE, "dtype": "uint8"})
    np.testing.assert_array_equal(source.read(((5, 9), (3, 40), (2, 41))), samples[5:9, 3:40, 2:41])
    with pytest.raises(ss.InvalidInput, match="bytes of samples"):
        open_source(f"file://{tmp_path / 'v.raw'}", {"shape": SHAPE, "dtype": "uint16"})


def test_arrays_of_any_strides_and_types_are_read(samples):
    turned = samples[::-1, :, ::-2]
    assert ss.open_bricks(turned, brick=16, quality="draft").value_range == (0.0, float(samples.max()))
    np.testing.assert_array_equal(open_source(turned, {}).read(((0, 3), (1, 2), (0, 21))), turned[:3, 1:2])
    wide = ss.open_bricks(samples.astype(np.int64) - 3, brick=16, quality="draft")
    assert wide.samples.dtype == np.int16
    assert ss.RegularField(samples.astype(np.int64) - 3).values.dtype == np.int16


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (np.zeros((3, 4)), "2 axes"),
        (np.zeros((0, 4, 4)), "no samples"),
        (np.zeros((4, 4, 4), complex), "complex128"),
        (np.full((5, 5, 5), np.nan), "NaN"),
        (np.full((5, 5, 5), np.inf), "infinite sample at \\[0, 0, 0\\], in brick 0"),
    ],
)
def test_bad_arrays_are_refused(data, words):
    with pytest.raises(ss.InvalidInput, match=words):
        ss.open_bricks(data, brick=4)


def test_bad_options_are_refused(samples, tmp_path):
    for brick in (0, 3, 4096, "x", 1.5):
        with pytest.raises(ss.InvalidInput, match="brick"):
            ss.open_bricks(samples, brick=brick)
    with pytest.raises(ss.InvalidInput, match="client"):
        ss.open_bricks(samples, client="tcp://nowhere")
    with pytest.raises(ss.InvalidInput, match="resample"):
        ss.open_bricks(samples, resample=True)
    with pytest.raises(ss.InvalidInput, match="open_bricks"):
        ss.render(samples, client=Pretender())
    path = tmp_path / "mesh.vtk"
    path.write_text("# vtk DataFile Version 3.0\nx\nASCII\nDATASET POLYDATA\nPOINTS 0 float\n")
    with pytest.raises(ss.Error):
        ss.open_bricks(path)
    with pytest.raises(ss.Unsupported, match="values at points"):
        pickle.loads(pickle.dumps(ss.open_bricks(samples, brick=16))).at([[1, 2, 3]])
    with pytest.raises(ss.Unsupported, match="all samples"):
        np.asarray(ss.open_bricks(samples, brick=16).values)


class Pretender:
    def submit(self):
        """Have the name that a client has."""

    def scheduler_info(self):
        """Have the name that a client has."""


def test_blocks_that_disagree_with_their_array_are_named(samples):
    dask = pytest.importorskip("dask.array")
    lying = dask.from_array(samples, chunks=20).map_blocks(lambda part: part.astype(np.float64), dtype=np.uint8)
    with pytest.raises(ss.InvalidInput, match="samples of type float64.*uint8, as when it was opened"):
        ss.open_bricks(lying, brick=20)


def test_a_file_that_changed_is_not_mixed_with_what_was_read(samples, tmp_path):
    path = tmp_path / "v.npy"
    np.save(path, samples)
    bricked = ss.open_bricks(path, brick=16, quality="draft")
    residents().clear()
    np.save(path, samples[:, :, :40])
    with pytest.raises(ss.InvalidInput, match="changed"):
        ss.render(bricked, size=SIZE)


def test_zarr_chunks_are_checked_when_their_brick_is_read(samples, tmp_path):
    zarr = pytest.importorskip("zarr")
    path = tmp_path / "v.zarr"
    array = zarr.create_array(path, shape=SHAPE, chunks=(16, 16, 16), dtype=samples.dtype, fill_value=7)
    array[:] = samples
    source = open_source(path, {})
    chunk = path / "c" / "1" / "1" / "1"
    chunk.unlink()
    # A chunk that was never written holds the fill value.
    assert (source.read(((16, 32), (16, 32), (16, 32))) == 7).all()
    chunk.symlink_to("/etc/passwd")
    with pytest.raises(ss.InvalidInput, match="a link"):
        source.read(((20, 21), (20, 21), (20, 21)))
    np.testing.assert_array_equal(source.read(((0, 16), (0, 16), (0, 16))), samples[:16, :16, :16])


def surveyed(samples, edges, lattice="cartesian"):
    """Return what is known of an array by bricks with these edges."""
    source = open_source(samples, {})
    plan = SurveyPlan.of(source.shape, lattice)
    cores = list(itertools.product(*([(a, min(a + edge, size)) for a in range(0, size, edge)]
                                     for edge, size in zip(edges, samples.shape, strict=True))))  # fmt: skip
    parts = []
    for number, core in enumerate(cores):
        outer = plan.margin(core)
        parts.append(survey_brick(source.read(outer), outer, core, number, plan, "it"))
    from sheetsplat.bricks.statistics import Survey

    one_by_one = merge_surveys(parts)
    in_a_tree = merge_surveys([merge_surveys(parts[:1]), merge_surveys(parts[1:] or parts[:1])])
    assert one_by_one.ranges == in_a_tree.ranges
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
        made = kept.made(source, core, box, "a key", ss.RegularField)
        assert made.shape == tuple(last - first for first, last in box)
        return len(source.boxes) - before

    ample = Residents(1 << 20)
    assert [reads(ample, box) for box in (far, near, far, near, far)] == [1, 0, 0, 0, 0]
    # 20**3 samples and 12**3 do not fit together: then the brick stays, as its last view needs it.
    short = Residents(9000)
    assert [reads(short, box) for box in (far, near, near, far)] == [1, 0, 0, 1]
    assert short.size <= short.budget and short.counts.dropped == 0


MODES = ("composite", "isosurface", "xray", "mip", "minimum", "average")


@pytest.mark.parametrize("mode", MODES)
def test_one_process_draws_the_picture_of_the_whole(samples, tmp_path, mode):
    data, _ = stored("npy", samples, tmp_path)
    outputs = ("depth",) if mode in ("composite", "isosurface") else ("coverage",)
    options = {"size": SIZE, "mode": mode, "azimuth": 35, "elevation": 20, "outputs": outputs, "slice_spacing": 0.5}
    one = ss.render(ss.open(data), **options)
    other = ss.render(ss.open_bricks(data, brick=16), **options)
    scale = max(1.0, float(np.abs(one.pixels).max()))
    assert rmse(one, other) <= ROUNDING * scale
    for name in outputs:
        np.testing.assert_allclose(getattr(one, name), getattr(other, name), rtol=1e-5, atol=1e-5 * scale)
    assert other.recipe.fields[0].kind == "RegularField"


@pytest.mark.parametrize("mode", ["composite", "isosurface", "xray"])
def test_the_error_of_a_picture_in_bricks_is_that_of_one_process(samples, mode):
    options = {"size": (36, 30), "mode": mode, "quality": "draft", "backend": "cpu", "background": (0.2, 0.4, 0.9)}
    one = ss.render(ss.RegularField(samples), **options).error
    image = ss.render(ss.open_bricks(samples, brick=24, quality="draft"), **options)
    other = image.error
    assert other.rmse == pytest.approx(one.rmse, rel=1e-3)
    assert other.budget["slice distance"] == pytest.approx(one.budget["slice distance"], rel=1e-3)
    np.testing.assert_allclose(other.map, one.map, rtol=0.01, atol=2e-6 * max(1.0, float(np.abs(image.pixels).max())))
    assert np.sqrt(sum(part**2 for part in other.budget.values())) == pytest.approx(other.rmse, rel=1e-6)
    if mode == "xray":
        # Sums of so smooth a volume are right at any distance of slices.
        assert other.rmse < 1e-4
        return
    # Halved slices: the estimate follows them, whatever the stop leaves out.
    finer = ss.render(
        ss.open_bricks(samples, brick=24, quality="draft"), **options, slice_spacing=0.5 * image.plan.slice_spacing
    )
    assert finer.error.budget["slice distance"] < 0.8 * other.budget["slice distance"]


@pytest.mark.slow
@pytest.mark.parametrize("mode", ["composite", "isosurface", "average"])
def test_a_cluster_draws_the_picture_of_one_process(cluster, samples, tmp_path, mode):
    data, _ = stored("npy", samples, tmp_path)
    options = {
        "size": SIZE,
        "mode": mode,
        "azimuth": 35,
        "elevation": 20,
        "projection": "perspective",
        "slice_spacing": 0.5,
    }
    bricked = ss.open_bricks(data, brick=24, client=cluster)
    drawn = ss.render(bricked, client=cluster, **options)
    alone = ss.render(ss.open(data), **options)
    assert rmse(drawn, alone) <= ROUNDING * max(1.0, float(np.abs(alone.pixels).max()))
    again = ss.render(bricked, client=cluster, **options)
    np.testing.assert_array_equal(drawn.pixels, again.pixels)
    # What was drawn once is resident, and nothing is read.
    assert again.stats["bricks_read"] == 0 and again.stats["bricks_drawn"] == drawn.stats["bricks_drawn"] > 0


@pytest.mark.slow
@pytest.mark.parametrize("options", [{}, {"opacity_stop": 1.0}, {"mode": "average"}])
def test_a_cluster_and_one_process_make_the_same_bits(cluster, samples, options):
    options = {"size": SIZE, "azimuth": 35, "quality": "draft", **options}
    drawn = ss.render(ss.open_bricks(samples, brick=16, client=cluster, quality="draft"), client=cluster, **options)
    alone = ss.render(ss.open_bricks(samples, brick=16, quality="draft"), **options)
    np.testing.assert_array_equal(drawn.pixels, alone.pixels)


@pytest.mark.slow
@pytest.mark.parametrize("stop", [0.98, 1.0])
def test_bits_do_not_depend_on_the_number_of_workers(cluster, samples, stop):
    bricked = ss.open_bricks(samples, brick=24, client=cluster)
    both = ss.render(bricked, client=cluster, size=SIZE, opacity_stop=stop)
    # Without a stop bricks are drawn in any order.
    assert rmse(both, ss.render(bricked, size=SIZE, opacity_stop=stop)) <= ROUNDING
    from sheetsplat.bricks import cluster as module

    places = module._cluster(cluster)
    for number in range(64):
        places._places[(bricked.source.token, number)] = places.workers[0]
    one = ss.render(bricked, client=cluster, size=SIZE, opacity_stop=stop)
    np.testing.assert_array_equal(both.pixels, one.pixels)


@pytest.mark.slow
def test_bricks_behind_an_opaque_front_are_not_read(cluster):
    wall = np.zeros((64, 24, 24), np.uint8)
    wall[4:60] = 255
    bricked = ss.open_bricks(wall, brick=16, client=cluster, prefilter=False)
    camera = ss.Camera.orthographic((12, 12, -50), (12, 12, 0), (0, 1, 0), height=10)
    table = [(0, 0, 0, 0, 0), (128, 1, 1, 1, 0.97), (255, 1, 1, 1, 0.97)]
    drawn = ss.render(bricked, client=cluster, camera=camera, transfer_function=table, size=32)
    assert drawn.stats["bricks"] == 16 and 0 < drawn.stats["bricks_drawn"] <= 8
    whole = ss.render(
        ss.RegularField(wall), camera=camera, transfer_function=table, size=32,
        opacity_stop=drawn.recipe.options["opacity_stop"], slice_spacing=drawn.plan.slice_spacing,
        reference_length=1.0,
    )  # fmt: skip
    assert rmse(drawn, whole) <= ROUNDING


def test_covering_bricks_leave_none_out(samples):
    bricked = ss.open_bricks(samples, brick=8)
    picture = api.prepare(bricked, size=SIZE, azimuth=33, elevation=21)
    view = view_of(bricked, picture.scene, picture.camera, SIZE, (), None, picture.renderer.settings)
    order = [number for number in view.order() if view.footprint(number) is not None]
    found = covering(view, order)
    # What a brick is told by those before it that it asks for, and they by theirs, is all there is in front of it.
    told, seen = {}, {}
    for place, number in enumerate(order):
        known = set()
        for one in found[number]:
            known |= told[one] | {one}
        told[number] = known
        x0, y0, x1, y1 = view.footprint(number)
        seen[number] = np.zeros(SIZE[::-1], bool)
        seen[number][y0:y1, x0:x1] = view.outline(number)
        assert known >= {before for before in order[:place] if (seen[before] & seen[number]).any()}
    assert sum(map(len, found.values())) < sum(map(len, told.values()))
    # Bricks side by side do not wait for each other: no more steps than a ray of a cube passes bricks.
    steps = {}
    for number in order:
        steps[number] = 1 + max((steps[one] for one in found[number]), default=0)
    assert max(steps.values()) <= sum(-(-size // 8) for size in SHAPE) - 2


@pytest.mark.slow
def test_a_brick_smaller_than_the_reach_of_kernels_is_drawn(cluster, samples):
    small = samples[:14, 15:33, 10:26]
    drawn = ss.render(ss.open_bricks(small, brick=4, radius=3.0, falloff=5.0), size=SIZE, client=cluster)
    whole = ss.render(
        ss.RegularField(small, radius=3.0), camera=drawn.camera, size=SIZE,
        transfer_function=drawn.recipe.transfer_functions[0],
    )  # fmt: skip
    assert drawn.size == whole.size
    kernels = ss.RegularField(small, radius=drawn.recipe.fields[0].options["radius"],
                              prefilter=drawn.recipe.fields[0].options["prefilter"])  # fmt: skip
    assert rmse(drawn, ss.Renderer("cpu").render(drawn.recipe.scene([kernels]), drawn.camera, SIZE)) <= ROUNDING


@pytest.mark.slow
def test_a_damaged_chunk_names_worker_brick_and_file(cluster, samples, tmp_path):
    data, _ = stored("hdf5", samples, tmp_path)
    path = tmp_path / "v.h5"
    import h5py

    with h5py.File(path) as file:
        chunk = file["a/b"].id.get_chunk_info(50)
    content = bytearray(path.read_bytes())
    content[chunk.byte_offset : chunk.byte_offset + chunk.size] = bytes(chunk.size)
    path.write_bytes(content)
    with pytest.raises(ss.InvalidInput, match=r"brick \d+ \[.*v\.h5.* by worker tcp://"):
        ss.open_bricks(data, brick=16, client=cluster)


@pytest.mark.slow
def test_nan_in_a_brick_is_told_and_skipped(cluster, tmp_path):
    values = blob(kind=np.float32)
    values[20:24, 5:9, 3] = np.nan
    np.save(tmp_path / "v.npy", values)
    with pytest.raises(ss.InvalidInput, match="16 of .* samples are NaN"):
        ss.open_bricks(tmp_path / "v.npy", brick=16, client=cluster)
    bricked = ss.open_bricks(tmp_path / "v.npy", brick=16, client=cluster, nan="skip")
    drawn = ss.render(bricked, client=cluster, size=SIZE, slice_spacing=0.5)
    whole = ss.render(ss.open(tmp_path / "v.npy", nan="skip"), size=SIZE, slice_spacing=0.5)
    assert rmse(drawn, whole) <= ROUNDING


def test_effects_that_bricks_cannot_have_are_refused_before_anything_is_read(samples, cluster):
    bricked = ss.open_bricks(samples, brick=16)
    residents().clear()
    reads = residents().counts.reads
    for options in ({"shadows": True}, {"ambient_occlusion": True}, {"max_error": 1e-3}, {"max_seconds": 1.0}):
        with pytest.raises(ss.Unsupported, match="bricks"):
            ss.render(bricked, size=SIZE, client=cluster, **options)
    assert residents().counts.reads == reads


def slow(block):
    """Take a while to be read: all bricks together seconds."""
    time.sleep(0.03)
    return block


@pytest.mark.slow
def test_a_killed_worker_is_survived(cluster, samples):
    dask = pytest.importorskip("dask.array")
    killed = min(cluster.scheduler_info(n_workers=-1)["workers"])
    lazily = dask.from_array(samples, chunks=16).map_blocks(slow, dtype=samples.dtype)
    pid = cluster.run(os.getpid, workers=[killed])[killed]
    timer = threading.Timer(0.5, os.kill, (pid, signal.SIGKILL))
    timer.start()
    try:
        bricked = ss.open_bricks(lazily, brick=20, client=cluster, quality="draft")
        drawn = ss.render(bricked, client=cluster, size=SIZE, quality="draft")
        # It ended meanwhile: another one with its name would have another address.
        assert killed not in cluster.scheduler_info(n_workers=-1)["workers"]
    finally:
        timer.join()
    whole = ss.render(ss.RegularField(samples), size=SIZE, quality="draft")
    assert rmse(drawn, whole) <= ROUNDING
    cluster.wait_for_workers(2, timeout=30)


def executing(dask_worker):
    """Return the number of tasks that a worker has not left yet."""
    return len(dask_worker.state.executing)


@pytest.mark.slow
def test_a_picture_that_is_given_up_leaves_the_workers_idle(cluster):
    large = np.tile(blob(), (3, 3, 3))
    bricked = ss.open_bricks(large, brick=64, client=cluster, quality="draft")

    def busy():
        return any(cluster.processing().values()) or any(cluster.run(executing).values())

    def seconds_until_idle():
        calls = []

        def stop(share):
            calls.append(share)
            return len(calls) < 3

        with pytest.raises(ss.Cancelled):
            ss.render(bricked, client=cluster, size=(1500, 1500), quality="best", progress=stop)
        began = time.monotonic()
        while busy() and time.monotonic() - began < 10:
            time.sleep(0.02)
        assert not busy()
        return time.monotonic() - began

    # Other programs may hold up one of them.
    assert any(seconds_until_idle() < 1.0 for _ in range(3))


def test_workers_of_another_version_are_refused(cluster, samples, monkeypatch):
    from sheetsplat.bricks import cluster as module

    monkeypatch.setattr(module, "__version__", "0.0.1")
    monkeypatch.setattr(module, "_clusters", {})
    with pytest.raises(ss.Unsupported, match=r"sheetsplat \S+ on worker tcp://.*wanted 0\.0\.1, as here"):
        ss.open_bricks(samples, client=cluster)


@pytest.mark.slow
def test_a_lost_scheduler_is_told(samples):
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, processes=False, dashboard_address=None, silence_logs=50
    ) as made:
        client = distributed.Client(made, set_as_default=False)
        bricked = ss.open_bricks(samples, brick=16, client=client, quality="draft")
    with pytest.raises(ss.Error, match="the scheduler .* cannot be used"):
        ss.render(bricked, client=client, size=SIZE)
    client.close()


@pytest.mark.slow
def test_a_film_is_drawn_by_all_workers(cluster, samples, tmp_path):
    bricked = ss.open_bricks(samples, brick=24, client=cluster, quality="draft")
    film = ss.turntable(bricked, frames=3, size=(40, 30), quality="draft", client=cluster)
    film.save(tmp_path / "film")
    names = sorted(one.name for one in (tmp_path / "film").iterdir())
    assert names == ["frame_0000.png", "frame_0001.png", "frame_0002.png"]
    before = {name: (tmp_path / "film" / name).read_bytes() for name in names}
    (tmp_path / "film" / names[1]).unlink()
    film.save(tmp_path / "film")
    assert {name: (tmp_path / "film" / name).read_bytes() for name in names} == before
    alone = ss.turntable(ss.RegularField(samples), frames=3, size=(40, 30), quality="draft", backend="cpu")
    assert rmse(film[1], alone[1]) <= ROUNDING


@pytest.mark.slow
def test_processes_draw_frames_of_data_in_bricks(samples, tmp_path):
    film = ss.turntable(ss.open_bricks(samples, brick=24, quality="draft"), frames=2, size=(40, 30), quality="draft")
    film.save(tmp_path / "here")
    film.save(tmp_path / "there", workers=2)
    for one in sorted((tmp_path / "here").iterdir()):
        assert one.read_bytes() == (tmp_path / "there" / one.name).read_bytes()


def bricks_read():
    """Return how many bricks a worker has read."""
    from sheetsplat.bricks.resident import residents

    return residents().counts.reads


@pytest.mark.slow
def test_workers_that_keep_all_of_the_data_draw_frames_of_their_own(cluster, samples, tmp_path, monkeypatch):
    from sheetsplat.bricks import cluster as module

    # No other test has read these.
    bricked = ss.open_bricks(samples[::-1].copy(), brick=16, client=cluster, quality="draft")
    film = ss.turntable(bricked, frames=4, size=(40, 30), quality="draft", client=cluster)
    assert module.frames_side_by_side(cluster, bricked) == 2
    before = cluster.run(bricks_read)
    film.save(tmp_path / "alone")
    # Both workers drew frames, and read the bricks that the other had.
    assert all(count > before[worker] for worker, count in cluster.run(bricks_read).items())
    # Where a worker has too little memory all draw each frame, and the pictures are the same.
    monkeypatch.setattr(module, "_ALL_OF_IT", 1e-9)
    assert module.frames_side_by_side(cluster, bricked) == 0
    film.save(tmp_path / "together")
    for one in sorted((tmp_path / "alone").iterdir()):
        assert one.read_bytes() == (tmp_path / "together" / one.name).read_bytes()


@pytest.mark.slow
def test_the_command_line_draws_in_bricks(samples, tmp_path):
    from click.testing import CliRunner

    from sheetsplat.cli.main import main

    np.save(tmp_path / "v.npy", samples)
    for name, options in (("whole", []), ("bricks", ["--brick", "16"])):
        command = ["render", str(tmp_path / "v.npy"), "-o", str(tmp_path / f"{name}.npy"), "--size", "60", *options]
        command += ["--slice-spacing", "0.5"]
        result = CliRunner().invoke(main, command)
        assert result.exit_code == 0, result.output
    one, other = np.load(tmp_path / "whole.npy"), np.load(tmp_path / "bricks.npy")
    assert np.sqrt(np.mean((one.astype(np.float64) - other) ** 2)) <= ROUNDING
    both = ["--workers", "2", "--scheduler", "tcp://127.0.0.1:9"]
    refused = CliRunner().invoke(main, ["render", str(tmp_path / "v.npy"), "-o", str(tmp_path / "x.png"), *both])
    assert refused.exit_code == 2 and "leave out one" in refused.output


@pytest.mark.slow
def test_the_command_line_films_in_bricks(samples, tmp_path, cluster):
    from click.testing import CliRunner

    from sheetsplat.cli.main import main

    np.save(tmp_path / "v.npy", samples)
    (tmp_path / "v.raw").write_bytes(samples.tobytes())
    turn = ["turntable", str(tmp_path / "v.raw"), "--shape", "41,46,37", "--dtype", "uint8", "--frames", "2"]
    turn += ["--size", "40x30", "--quality", "draft", "--backend", "cpu"]
    address = ["--scheduler", cluster.scheduler.address]
    for name, options in (("whole", []), ("here", ["--brick", "24"]), ("cluster", ["--brick", "24", *address])):
        result = CliRunner().invoke(main, [*turn, "-o", str(tmp_path / name), *options])
        assert result.exit_code == 0, result.output
    pictures = {name: read_frame(tmp_path / name / "frame_0001.png") for name in ("whole", "here", "cluster")}
    np.testing.assert_allclose(pictures["here"], pictures["whole"], atol=1)
    np.testing.assert_array_equal(pictures["here"], pictures["cluster"])
    key = str(tmp_path / "whole" / "frame_0001.png")
    flight = ["animate", str(tmp_path / "v.npy"), "-o", str(tmp_path / "flight"), "--frames", "1", "--key", key]
    flight += ["--brick", "24", "--size", "40x30", "--quality", "draft", *address]
    result = CliRunner().invoke(main, flight)
    assert result.exit_code == 0, result.output
    np.testing.assert_allclose(read_frame(tmp_path / "flight" / "frame_0000.png"), pictures["whole"], atol=1)


@pytest.mark.slow
@pytest.mark.usefixtures("ctrl_c")
def test_a_viewer_with_workers_ends_quietly(samples, tmp_path):
    pytest.importorskip("distributed")
    np.save(tmp_path / "v.npy", samples)
    command = [sys.executable, "-m", "sheetsplat", "view", str(tmp_path / "v.npy"), "--brick", "24", "--workers", "2"]
    with subprocess.Popen(
        [*command, "--no-browser"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
    ) as viewer:
        try:
            assert viewer.stdout is not None and viewer.stdout.readline().startswith("http://127.0.0.1:")
            assert viewer.stderr is not None and "Ctrl-C" in viewer.stderr.readline()
            # It is told just before the viewer waits. A terminal sends it to the workers, too.
            time.sleep(0.5)
            os.killpg(viewer.pid, signal.SIGINT)
            _, told = viewer.communicate(timeout=60)
        finally:
            if viewer.poll() is None:
                os.killpg(viewer.pid, signal.SIGKILL)
    assert viewer.returncode == 0 and "Traceback" not in told, told


def read_frame(path):
    """Return the numbers of a picture, int (h, w, 4)."""
    from PIL import Image

    return np.asarray(Image.open(path)).astype(int)


def test_films_in_bricks_refuse_what_they_cannot_be(samples, tmp_path):
    from click.testing import CliRunner

    from sheetsplat.cli.main import main

    np.save(tmp_path / "v.npy", samples)
    (tmp_path / "scene.toml").write_text("")
    volume, film = str(tmp_path / "v.npy"), ["-o", str(tmp_path / "film"), "--brick", "16"]
    for command, words in (
        (["animate", volume, volume, *film], "time series"),
        (["animate", volume, *film], "give --frames"),
        (["turntable", volume, *film, "--workers", "2", "--scheduler", "tcp://127.0.0.1:9"], "leave out one"),
        (["turntable", str(tmp_path / "scene.toml"), *film], "files of data"),
        (["turntable", volume, *film, "--brick", "2"], "--brick"),
    ):
        refused = CliRunner().invoke(main, command)
        assert refused.exit_code == 2 and words in refused.output, refused.output


def test_films_tell_how_long_they_go_on(samples, tmp_path, caplog):
    with caplog.at_level("INFO", "sheetsplat"):
        ss.turntable(samples, frames=2, size=16, quality="draft").save(tmp_path / "film")
    told = [one.getMessage() for one in caplog.records if "frames" in one.getMessage()]
    assert len(told) == 2 and told[0].startswith("1 of 2 frames, ") and told[1] == "2 of 2 frames, 0:00 left"

"""Scattered kernels in bricks: what is read of tables, how it is sorted, and the pictures of it."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

import sheetsplat as ss
from sheetsplat import api
from sheetsplat.bricks import kernel_pieces, opening_kernels
from sheetsplat.bricks.kernel_pieces import pieces_of
from sheetsplat.bricks.resident import residents

SIZE = (60, 48)
BOUND = 1e-6
LOOK = [(0.0, 0.1, 0.2, 0.9, 0.0), (0.35, 0.2, 0.8, 0.3, 0.05), (0.7, 0.9, 0.6, 0.1, 0.3), (1.0, 1.0, 0.9, 0.8, 0.7)]
LIGHTS = (ss.Light((0.4, 0.6, 1.0)),)
SPACING = 0.05
MODES = (
    {"lights": LIGHTS},
    {"mode": "isosurface", "iso_value": [(0.3, 0.4), (0.6, 1.0)], "lights": LIGHTS},
    {"mode": "xray"},
    {"mode": "mip"},
    {"mode": "average"},
    {"mode": "minimum"},
    {"preintegration": True, "filter": "ewa"},
)


def kernels(kind, count=128):
    """Return spheres, or weighted ellipsoids with needles 1:1000 that are longer than bricks."""
    random = np.random.default_rng(7)
    centers, values = random.uniform(-1, 1, (count, 3)), random.uniform(0.2, 1.0, count)
    if kind == "spheres":
        return ss.EllipsoidField(centers, random.uniform(0.2, 0.5, count), values=values, w0=0.3)
    scales = random.uniform(0.15, 0.4, (count, 1)) * np.array([1.0, 0.6, 0.8])
    scales[::6] = np.array([1.5, 0.0015, 0.0015])
    turns = random.normal(size=(count, 4))
    turns /= np.linalg.norm(turns, axis=1)[:, None]
    weights = random.uniform(0.0, 2.0, count) * (random.random(count) > 0.1)
    return ss.EllipsoidField(centers, scales, turns, values, weights=weights, w0=0.3)


def pixels_apart(one, other):
    scale = max(1.0, float(np.abs(other.pixels).max()))
    return float(np.sqrt(np.mean(((one.pixels.astype(np.float64) - other.pixels) / scale) ** 2)))


@pytest.mark.slow
@pytest.mark.parametrize("count", [1, 2, 7, 64])
@pytest.mark.parametrize("kind", ["spheres", "ellipsoids"])
def test_any_number_of_bricks_makes_the_picture_of_one_process(kind, count):
    field = kernels(kind)
    bricked = ss.open_bricks(field, brick_kernels=-(-field.size // count))
    assert len(bricked.source.partition) == count and bricked.kernels == field.size
    worst = 0.0
    for number, options in enumerate(MODES):
        projection = ("orthographic", "perspective")[(number + count) % 2]
        direction = ((0.0, 0.0, -1.0), (0.45, -0.35, -1.0), (-1.0, 0.2, 0.1))[(number + count) % 3]
        camera = ss.Camera.fit(field, direction=direction, kind=projection, margin=0.7)
        given = {"camera": camera, "size": SIZE, "slice_spacing": SPACING, "backend": "cpu", **options}
        given |= {} if options.get("mode") in ("xray", "mip", "average", "minimum") else {"transfer_function": LOOK}
        apart = pixels_apart(ss.render(bricked, **given), ss.render(field, **given))
        print(kind, count, projection, options.get("mode"), apart)
        worst = max(worst, apart)
    assert worst <= BOUND


def test_bricks_without_what_reaches_them_are_seen(monkeypatch):
    field = kernels("spheres")
    camera = ss.Camera.fit(field, direction=(0.3, 0.2, -1.0))
    given = {"camera": camera, "size": SIZE, "slice_spacing": SPACING, "transfer_function": LOOK, "backend": "cpu"}
    bricked = ss.open_bricks(field, brick_kernels=20)
    monkeypatch.setattr("sheetsplat.bricks.kernel_source._ROUNDING", 0.0)
    monkeypatch.setattr("sheetsplat.bricks.resident._WIDER", 0.0)
    residents().clear()
    assert pixels_apart(ss.render(bricked, **given), ss.render(field, **given)) > 100 * BOUND
    residents().clear()


@pytest.mark.parametrize("options", [{}, {"mode": "isosurface"}, {"log": 0.01}])
def test_kernels_in_bricks_look_as_in_memory(options):
    field = kernels("ellipsoids")
    data = {"centers": field.centers, "value": field.values, "weight": field.weights}
    data |= dict(zip(("sx", "sy", "sz"), field.scales.T, strict=True))
    data |= dict(zip(("qw", "qx", "qy", "qz"), field.rotations.T, strict=True))
    opening = {"w0": 0.3, **({"log": options.pop("log")} if "log" in options else {})}
    one = api.prepare(ss.open(data, **opening), size=SIZE, **options)
    other = api.prepare(ss.open_bricks(data, brick_kernels=30, **opening), size=SIZE, **options)
    assert one.camera == other.camera and one.scene.transfer_function == other.scene.transfer_function
    assert one.scene.options == other.scene.options and one.scene.slice_spacing == other.scene.slice_spacing
    assert one.scene.fields[0].quantity == other.scene.fields[0].quantity
    assert pixels_apart(other.render(), one.render()) <= BOUND


def snapshot(path, field, masses=True):
    """Write spheres as particles with the layout of Gadget."""
    h5py = pytest.importorskip("h5py")
    with h5py.File(path, "w") as file:
        group = file.create_group("PartType0")
        group.create_dataset("Coordinates", data=field.centers, chunks=(16, 3))
        group.create_dataset("SmoothingLength", data=field.scales)
        group.create_dataset("Density", data=field.values)
        if masses:
            group.create_dataset("Masses", data=np.full(field.size, 0.01))


def tables(kind, field, folder):
    """Return what `open_bricks` takes for spheres in a format, and what `open` takes."""
    if kind == "hdf5":
        snapshot(folder / "s.h5", field)
        return folder / "s.h5", folder / "s.h5"
    pandas = pytest.importorskip("pandas")
    columns = dict(zip("xyz", field.centers.T, strict=True)) | {"radius": field.scales, "value": field.values}
    frame = pandas.DataFrame(columns)
    if kind == "pandas":
        return frame, frame
    if kind == "dask":
        dataframe = pytest.importorskip("dask.dataframe")
        return dataframe.from_pandas(frame, npartitions=4, sort=False), frame
    pytest.importorskip("pyarrow", reason="no pyarrow: pip install 'sheetsplat[parquet]'")
    if kind == "parquet":
        frame.to_parquet(folder / "t.parquet", row_group_size=30)
        return folder / "t.parquet", frame
    (folder / "parts").mkdir()
    for number in range(3):
        frame[number * 43 : number * 43 + 43].to_parquet(folder / "parts" / f"{number}.parquet")
    return folder / "parts", frame


@pytest.mark.parametrize("kind", ["hdf5", "pandas", "dask", "parquet", "folder of parquet"])
def test_all_kernels_of_a_table_are_there(kind, tmp_path, monkeypatch):
    monkeypatch.setattr(kernel_pieces, "_ROWS", 50)
    path, same = tables(kind, kernels("spheres"), tmp_path)
    field, bricked = ss.open(same), ss.open_bricks(path, brick_kernels=25)
    found, _ = bricked.source.read(0, 100.0, bricked.value_range)
    for name in ("centers", "scales", "values"):
        np.testing.assert_array_equal(getattr(found, name), getattr(field, name))
    assert (found.weights is None) == (field.weights is None)
    if found.weights is not None:
        np.testing.assert_array_equal(found.weights, field.weights)
    assert found.normalization == field.normalization and found.quantity == field.quantity
    assert bricked.bounds == field.bounds and bricked.centre_bounds == field.centre_bounds
    assert bricked.value_range == field.value_range
    # Cells fill space: a kernel is the own one of one brick.
    segments = bricked.source.segments
    assert (segments["last"] - segments["first"]).sum() == field.size


def test_snapshots_of_several_files_are_one(tmp_path):
    field = kernels("spheres")
    for number in range(2):
        snapshot(tmp_path / f"s.{number}.h5", field.part(np.arange(number * 64, number * 64 + 64)), masses=False)
    bricked = ss.open_bricks([tmp_path / "s.0.h5", tmp_path / "s.1.h5"], brick_kernels=30)
    found, _ = bricked.source.read(1, 100.0, bricked.value_range)
    np.testing.assert_array_equal(found.centers, field.centers)


@pytest.mark.slow
def test_a_sample_stands_for_many_kernels(monkeypatch):
    monkeypatch.setattr(opening_kernels, "_SAMPLE", 2000)
    random = np.random.default_rng(3)
    count = 8000
    field = ss.EllipsoidField(random.uniform(-1, 1, (count, 3)), np.full(count, 0.25), values=random.random(count))
    bricked = ss.open_bricks(field, brick_kernels=1000)
    assert bricked.facts.stride == 4 and bricked.kernels == count and 2000 <= bricked.size <= 2006
    assert bricked.default_slice_spacing == field.default_slice_spacing
    assert ss.Scene(bricked, LOOK).slice_spacing == ss.Scene(field, LOOK).slice_spacing
    points = random.uniform(-0.5, 0.5, (200, 3))
    weights = bricked.weight_at(points).mean() / field.weight_at(points).mean()
    assert 0.9 < weights < 1.1
    given = {"size": SIZE, "camera": ss.Camera.fit(field), "transfer_function": LOOK, "backend": "cpu"}
    assert pixels_apart(ss.render(bricked, **given), ss.render(field, **given)) <= BOUND
    # What follows from the data follows from the sample, and shows as much.
    auto, whole = (ss.render(one, size=SIZE, quality="draft") for one in (bricked, field))
    print(auto.rgba[..., 3].mean(), whole.rgba[..., 3].mean())
    assert auto.rgba[..., 3].mean() == pytest.approx(whole.rgba[..., 3].mean(), abs=0.1)


def test_a_second_view_reads_nothing(tmp_path):
    path, _ = tables("hdf5", kernels("spheres"), tmp_path)
    bricked = ss.open_bricks(path, brick_kernels=32, scratch=tmp_path)
    first = ss.render(bricked, size=SIZE, quality="draft")
    assert first.stats["bricks_read"] == first.stats["bricks_drawn"] == 4
    second = ss.render(bricked, size=SIZE, quality="draft", azimuth=20)
    assert second.stats["bricks_read"] == 0 and second.stats["bricks_drawn"] == 4
    # The sorted kernels go with the field.
    assert list(tmp_path.glob("sheetsplat-*/piece_*.npy"))
    again = pickle.loads(pickle.dumps(bricked))
    assert again == bricked and again.source == bricked.source
    store = bricked.source.store.folder
    del bricked, first, second
    residents().clear()
    import gc

    gc.collect()
    assert not store.exists()
    with pytest.raises(ss.Error, match="a folder that all workers see"):
        ss.render(again, size=SIZE, quality="draft")


@pytest.mark.parametrize("kind", ["dask", "pandas", "field"])
def test_other_options_of_the_same_data_are_other_kernels(kind):
    """What was sorted and kept of a table is that of one scalar, and of one falloff."""
    pandas = pytest.importorskip("pandas")
    field = kernels("spheres")
    (x, y, z), other = field.centers.T, field.values[::-1].copy()
    frame = pandas.DataFrame({"x": x, "y": y, "z": z, "radius": field.scales, "a": field.values, "b": other})
    if kind == "dask":
        frame = pytest.importorskip("dask.dataframe").from_pandas(frame, npartitions=3)
    options = {"size": SIZE, "mode": "xray", "slice_spacing": SPACING}
    for name, values in (("a", field.values), ("b", other)):
        for falloff in (8.0, 2.0):
            whole = ss.EllipsoidField(field.centers, field.scales, values=values, falloff=falloff)
            if kind == "field":
                bricked = ss.open_bricks(whole, brick_kernels=30)
            else:
                bricked = ss.open_bricks(frame, brick_kernels=30, scalar=name, falloff=falloff)
            assert pixels_apart(ss.render(bricked, **options), ss.render(whole, **options)) < BOUND, (name, falloff)


def test_partitions_without_rows_are_passed_over():
    pandas, frames = pytest.importorskip("pandas"), pytest.importorskip("dask.dataframe")
    field = kernels("spheres")
    order = np.argsort(field.centers[:, 0])
    (x, y, z), radius, values = field.centers[order].T, field.scales[order], field.values[order]
    table = pandas.DataFrame({"x": x, "y": y, "z": z, "radius": radius, "value": values})
    frame = frames.from_pandas(table, npartitions=4)
    bricked = ss.open_bricks(frame[frame.x > 0.6], brick_kernels=20)
    kept = x > 0.6
    whole = ss.EllipsoidField(field.centers[order][kept], radius[kept], values=values[kept])
    assert bricked.kernels == whole.size > 0
    options = {"size": SIZE, "mode": "xray", "slice_spacing": SPACING}
    assert pixels_apart(ss.render(bricked, **options), ss.render(whole, **options)) < BOUND
    with pytest.raises(ss.InvalidInput, match="no rows"):
        ss.open_bricks(frame[frame.x > 9.0])


def test_what_has_no_bricks_is_refused(tmp_path):
    field = kernels("spheres")
    points = dict(zip("xyz", field.centers.T, strict=True)) | {"value": field.values}
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "p.h5", "w") as file:
        file["PartType0/Coordinates"] = field.centers
        file["PartType0/Masses"] = field.values
    with pytest.raises(ss.InvalidInput, match="points without the sizes of kernels"):
        ss.open_bricks(tmp_path / "p.h5")
    for options, words in (
        ({"spacing": (1, 1, 1)}, "spacing"),
        ({"scratch": tmp_path / "no"}, "a folder that exists"),
        ({"brick_kernels": 0}, "brick_kernels"),
    ):
        with pytest.raises(ss.InvalidInput, match=words):
            ss.open_bricks({**points, "radius": field.scales}, **options)
    bricked = ss.open_bricks(field)
    image = ss.render(bricked, size=SIZE, quality="draft")
    with pytest.raises(ss.Unsupported, match="in bricks"):
        image.pick(30, 24)
    with pytest.raises(ss.Unsupported, match="ghost points"):
        bricked.with_ghost_points()
    with pytest.raises(ss.Unsupported, match="sheetsplat.render"):
        ss.Renderer().render(ss.Scene(bricked, LOOK), ss.Camera.fit(bricked))
    snapshot(tmp_path / "a.h5", field)
    snapshot(tmp_path / "b.h5", field, masses=False)
    with pytest.raises(ss.InvalidInput, match="the same kinds of kernels"):
        ss.open_bricks([tmp_path / "a.h5", tmp_path / "b.h5"])
    with pytest.raises(ss.InvalidInput, match="several files"):
        ss.open_bricks([tmp_path / "a.h5", "x.csv"])
    assert pieces_of(np.zeros((4, 4, 4)), {}) is None


def test_parquet_is_read_by_path(tmp_path, monkeypatch):
    path, _ = tables("parquet", kernels("spheres"), tmp_path)
    from pyarrow import parquet

    with pytest.raises(ss.InvalidInput) as told:
        ss.open_bricks(tmp_path / "no.parquet")
    assert told.value.found == "no such file"
    # Nobody is asked for a URL.
    monkeypatch.setattr(parquet, "ParquetFile", None)
    for url in ("s3://nowhere/t.parquet", f"file://{path}", [f"https://nowhere.invalid/{path.name}"]):
        with pytest.raises(ss.InvalidInput) as told:
            ss.open_bricks(url)
        assert told.value.found == "Parquet at a URL" and "raw samples" in told.value.wanted


def test_whoever_opens_parquet_as_a_whole_is_told_of_bricks(tmp_path):
    tables("parquet", kernels("spheres"), tmp_path)
    parts, _ = tables("folder of parquet", kernels("spheres"), tmp_path)
    for path in (tmp_path / "t.parquet", parts):
        for read in (ss.open, ss.render, ss.io.read_volume, ss.io.read_scattered):
            with pytest.raises(ss.InvalidInput) as told:
                read(path)
            assert "open_bricks" in told.value.advice and "--workers" in told.value.advice
    (tmp_path / "t.what").write_bytes(b"what?")
    (tmp_path / "others").mkdir()
    for path in (tmp_path / "t.what", tmp_path / "others"):
        with pytest.raises(ss.InvalidInput) as told:
            ss.open(path)
        assert "open_bricks" not in told.value.advice


@pytest.mark.slow
def test_a_cluster_draws_the_picture_of_one_process(tmp_path):
    distributed = pytest.importorskip("distributed", reason="no distributed: pip install 'sheetsplat[distributed]'")
    path, same = tables("hdf5", kernels("spheres", 400), tmp_path)
    with (
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None, silence_logs=50
        ) as made,
        distributed.Client(made) as client,
    ):
        bricked = ss.open_bricks(path, brick_kernels=60, client=client, scratch=tmp_path)
        given = {"size": SIZE, "azimuth": 30, "slice_spacing": SPACING, "backend": "cpu"}
        drawn = ss.render(bricked, client=client, **given)
        assert pixels_apart(drawn, ss.render(ss.open(same), **given)) <= BOUND
        again = ss.render(bricked, client=client, **given)
        np.testing.assert_array_equal(drawn.pixels, again.pixels)
        assert again.stats["bricks_read"] == 0 and again.stats["bricks_drawn"] == drawn.stats["bricks_drawn"] > 0
        # Kernels of this process are sent to the workers.
        here = ss.open_bricks(ss.open(same), brick_kernels=60, client=client)
        assert pixels_apart(ss.render(here, client=client, **given), drawn) <= BOUND

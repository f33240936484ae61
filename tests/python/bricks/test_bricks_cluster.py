"""Pictures of volumes in bricks, by one process and by the workers of a cluster, and what may go wrong."""

from __future__ import annotations

import gc
import os
import signal
import threading
import time

import numpy as np
import pytest
from bricked_volumes import ROUNDING, SHAPE, SIZE, blob, rmse, stored

import sheetsplat as ss
from sheetsplat import api
from sheetsplat.bricks.cluster import covering
from sheetsplat.bricks.needs import view_of
from sheetsplat.bricks.resident import residents
from sheetsplat.bricks.workers import workers_of

MODES = ("composite", "isosurface", "xray", "mip", "minimum", "average")


@pytest.mark.parametrize("mode", MODES)
def test_one_process_draws_the_picture_of_the_whole(samples, tmp_path, mode):
    data, _ = stored("npy", samples, tmp_path)
    outputs = ("depth",) if mode in ("composite", "isosurface") else ("coverage",)
    options = {"size": SIZE, "mode": mode, "azimuth": 35, "elevation": 20, "outputs": outputs, "slice_spacing": 0.5}
    one = ss.render(ss.open(data), **options)
    other = ss.render(ss.open_bricks(data, brick=16), **options)
    scale = max(1.0, float(np.nanmax(np.abs(one.pixels))))
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
    from sheetsplat.bricks import workers as module

    known = module.workers_of(cluster)
    for number in range(64):
        known.held(bricked.source).places[number] = known.workers[0]
    one = ss.render(bricked, client=cluster, size=SIZE, opacity_stop=stop)
    np.testing.assert_array_equal(both.pixels, one.pixels)


def bricks_kept(dask_scheduler):
    """Return how many bricks are drawn or let go again, and how many of them are kept."""
    bricks = [one.state for key, one in dask_scheduler.tasks.items() if str(key).startswith("render-brick")]
    return sum(state in ("memory", "released") for state in bricks), bricks.count("memory")


@pytest.mark.slow
def test_what_is_merged_is_let_go_while_a_picture_is_drawn(cluster, samples):
    bricked = ss.open_bricks(samples, brick=8, client=cluster, quality="draft")
    found, shares = [], []

    def look(share):
        found.append(cluster.run_on_scheduler(bricks_kept))
        shares.append(share)

    ss.render(bricked, client=cluster, size=(320, 240), quality="draft", opacity_stop=1.0, progress=look)
    assert shares == sorted(shares) and shares[-1] == 1.0
    assert any(drawn > 60 and kept < 0.6 * drawn for drawn, kept in found), found


def spans_of_dask(dask_scheduler):
    return len(dask_scheduler.extensions["spans"].spans)


def counters_of_dask(dask_worker):
    return len(dask_worker.digests_total)


def test_what_dask_counts_does_not_grow_with_pictures(cluster, samples):
    """It keeps a counter of each task of a span, on the workers too, for ever."""
    import distributed

    bricked = ss.open_bricks(samples, brick=16, client=cluster, quality="draft")

    def counted():
        # (Each of the workers has had each kind of task after a few pictures.)
        for azimuth in range(0, 360, 60):
            ss.render(bricked, client=cluster, size=(32, 24), quality="draft", azimuth=azimuth)
        return cluster.run_on_scheduler(spans_of_dask), sum(cluster.run(counters_of_dask).values())

    counted()
    (spans, counters), (later_spans, later_counters) = counted(), counted()
    assert later_spans == spans
    assert later_counters - counters < 40

    with distributed.span("mine") as mine:
        ss.render(bricked, client=cluster, size=(32, 24), quality="draft")
    assert cluster.run_on_scheduler(lambda dask_scheduler: mine in dask_scheduler.extensions["spans"].spans)


def bytes_of_data(dask_worker):
    """Return how many bytes a worker keeps of what it was sent and what tasks made."""
    return sum(getattr(one, "carried", 0) for one in dask_worker.data.values())


def test_workers_let_go_of_fields_that_are_gone(cluster):
    from sheetsplat.bricks import workers as module

    known = module.workers_of(cluster)
    gc.collect()
    before = set(known._held)
    values = np.random.default_rng(3).integers(0, 255, (128, 128, 128), dtype=np.uint8)
    bricked = ss.open_bricks(values, brick=64, client=cluster, quality="draft")
    ss.render(bricked, client=cluster, size=(32, 24), quality="draft")
    assert sum(cluster.run(bytes_of_data).values()) >= values.nbytes
    token = bricked.source.token
    assert set(known._held) - before == {token}
    # As long as one field of the same samples is there, so are they.
    again = ss.open_bricks(values, brick=64, client=cluster, quality="draft")
    del bricked
    gc.collect()
    assert token in known._held
    ss.render(again, client=cluster, size=(32, 24), quality="draft")
    del again
    gc.collect()
    assert token not in known._held
    ended = time.monotonic() + 10.0
    while sum(cluster.run(bytes_of_data).values()) and time.monotonic() < ended:
        time.sleep(0.02)
    assert sum(cluster.run(bytes_of_data).values()) == 0


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
    for options in ({"max_error": 1e-3}, {"max_seconds": 1.0}):
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
    from sheetsplat.bricks import workers as module

    monkeypatch.setattr(module, "__version__", "0.0.1")
    monkeypatch.setattr(module, "_known", {})
    with pytest.raises(ss.Unsupported, match=r"sheetsplat \S+ on worker tcp://.*wanted 0\.0\.1, as here"):
        ss.open_bricks(samples, client=cluster)


def test_a_scheduler_without_workers_is_told(samples, monkeypatch):
    distributed = pytest.importorskip("distributed")
    from sheetsplat.bricks import workers as module

    monkeypatch.setattr(module, "_PATIENCE", 0.3)
    with (
        distributed.LocalCluster(n_workers=0, processes=False, dashboard_address=None, silence_logs=50) as made,
        distributed.Client(made, set_as_default=False) as client,
        pytest.raises(ss.Error) as told,
    ):
        ss.open_bricks(samples, client=client)
    assert told.value.found == "no worker that answers" and "with workers" in told.value.wanted


@pytest.mark.slow
def test_workers_are_there_while_a_client_looks_after_its_scheduler(cluster):
    import dask
    import distributed

    # The client's own thread forgets all workers that `scheduler_info` has found.
    with (
        dask.config.set({"distributed.client.scheduler-info-interval": "1ms"}),
        distributed.Client(cluster.scheduler.address, set_as_default=False) as restless,
    ):
        assert {len(workers_of(restless).watch.now()) for _ in range(30)} == {2}


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


def _pause(size, dask_worker):
    """Pause a worker, as dask does where it takes most of its memory, until it keeps no bricks any more."""
    from distributed.core import Status

    from sheetsplat.bricks.resident import residents

    def look():
        if size is not None and residents().size < size:
            dask_worker.status = Status.running
        else:
            dask_worker.loop.call_later(0.05, look)

    dask_worker.status = Status.paused
    look()


def _run(dask_worker):
    from distributed.core import Status

    dask_worker.status = Status.running


@pytest.mark.slow
def test_paused_workers_let_go_of_what_they_keep_or_are_named(samples, monkeypatch):
    distributed = pytest.importorskip("distributed")
    monkeypatch.setattr("sheetsplat.bricks.cluster._STALLED", 0.2)
    monkeypatch.setattr("sheetsplat.bricks.cluster._GIVEN_UP", 1.0)
    options = {"size": SIZE, "mode": "xray", "slice_spacing": 0.5}
    with (
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, memory_limit=0, dashboard_address=None, silence_logs=50
        ) as made,
        distributed.Client(made) as client,
    ):
        bricked = ss.open_bricks(samples, brick=24, client=client, quality="draft")
        first = ss.render(bricked, client=client, **options)
        # Paused, with bricks that they can let go.
        client.run(_pause, 1)
        again = ss.render(bricked, client=client, **options)
        np.testing.assert_array_equal(first.pixels, again.pixels)
        assert again.stats["bricks_read"] > 0
        # Paused for ever.
        client.run(_pause, None)
        with pytest.raises(ss.OutOfMemory, match="2 workers paused for lack of memory"):
            ss.render(bricked, client=client, **options)
        client.run(_run)
        np.testing.assert_array_equal(first.pixels, ss.render(bricked, client=client, **options).pixels)

"""Bricks whose workers are killed, whose files are damaged, whose disks are full; arrays that are not what they say."""

from __future__ import annotations

import logging
import os
import random
import resource
import shutil
import signal
import tempfile
import threading
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

import sheetsplat as ss
from attacks import Tally, soon
from attacks.forgetful import FORGETFUL

SIZE = (40, 32)
_SHAPE = (30, 34, 28)
_PATIENCE = 60.0
_SECONDS = 30.0
# Seconds in which a killed worker comes back, on machines that are busy with other things too. A nanny whose new
# process ends while it starts gives up, and a LocalCluster gives up a worker that is away for longer: others are asked
# for then.
_AWAY, _RETURN = 30.0, 600.0


def samples(kind: Any = np.uint8) -> Any:
    """Return a soft ball."""
    k, j, i = (np.linspace(-1, 1, size) for size in _SHAPE)
    ball = 200 * np.exp(-(k[:, None, None] ** 2 + j[None, :, None] ** 2 + i[None, None, :] ** 2) / 0.4)
    return ball.round().astype(kind)


@contextmanager
def cluster(workers: int = 3) -> Iterator[Any]:
    """Yield a client of small processes of one thread each, which a nanny starts again."""
    import dask
    import distributed

    with (
        dask.config.set({"distributed.deploy.lost-worker-timeout": f"{_AWAY:.0f}s", **FORGETFUL}),
        distributed.LocalCluster(
            n_workers=workers,
            threads_per_worker=1,
            processes=True,
            dashboard_address=None,
            silence_logs=logging.CRITICAL,
        ) as made,
        distributed.Client(made) as client,
    ):
        yield client


def _slow(block: Any) -> Any:
    time.sleep(0.01)
    return block


def _named_in(error: ss.Error) -> bool:
    """Return whether an error names what failed: a worker, or the scheduler."""
    return "tcp://" in str(error)


def kills_of_workers(seed: int, count: int) -> Tally:
    """Kill workers at random moments of opening and drawing: the same picture, or one error that names a worker."""
    import dask.array as da

    tally, rng = Tally(), random.Random(seed)
    lazily = da.from_array(samples(), chunks=12).map_blocks(_slow, dtype=np.uint8)
    options: dict[str, Any] = {"size": SIZE, "quality": "draft"}
    with cluster() as client:
        expected = ss.render(ss.open_bricks(lazily, brick=12, client=client, quality="draft"), client=client, **options)
        while tally.done["workers killed"] < count:
            timers = []
            for _ in range(rng.choice((1, 1, 1, 2))):
                timers.append(threading.Timer(rng.uniform(0.0, 1.0), _kill_one, (client, rng.random(), tally)))
                timers[-1].start()
            before = tally.done["workers killed"]
            try:
                opened = ss.open_bricks(lazily, brick=12, client=client, quality="draft")
                drawn = ss.render(opened, client=client, **options)
                tally.did("the same picture", np.array_equal(drawn.pixels, expected.pixels))
                if not np.array_equal(drawn.pixels, expected.pixels):
                    tally.failed(f"another picture after {before} kills")
            except ss.Error as error:
                tally.did("clear errors")
                if not _named_in(error):
                    tally.failed(f"after {before} kills: {error}")
            except Exception as error:  # Whatever else is raised is what is looked for.
                tally.failed(f"after {before} kills: {type(error).__name__}: {error}")
            for one in timers:
                one.join()
            _refill(client, 3, tally)
    return tally


def _refill(client: Any, count: int, tally: Tally) -> None:
    """Wait until a cluster has as many workers again; ask for others where some were given up."""
    ends = time.monotonic() + _RETURN
    while len(client.scheduler_info(n_workers=-1)["workers"]) < count:
        if time.monotonic() > ends:
            raise TimeoutError(f"fewer than {count} workers after {_RETURN:g} s")
        if len(client.cluster.workers) < count:
            tally.did("workers that were replaced")
            client.cluster.scale(count)
        time.sleep(0.2)


def _kill_one(client: Any, share: float, tally: Tally) -> None:
    """Kill one of the workers that the scheduler knows: a nanny gives a process up that ends before it is known."""
    there = client.scheduler_info(n_workers=-1)["workers"]
    nannies = getattr(client.cluster, "workers", {})
    known = [nanny.pid for nanny in nannies.values() if nanny.worker_address in there and nanny.pid]
    if known:
        try:
            os.kill(known[int(share * len(known))], signal.SIGKILL)
            tally.did("workers killed")
        except ProcessLookupError:
            tally.did("workers that were gone already")


def _damage(rng: random.Random, path: Path) -> str:
    """Damage a file in one way; return which."""
    whole = path.read_bytes()
    kind = rng.choice(("cut", "flipped", "gone", "empty", "noise", "folder", "pipe", "longer", "zeros"))
    path.unlink()
    at = rng.randrange(len(whole))
    if kind == "cut":
        path.write_bytes(whole[:at])
    elif kind == "flipped":
        path.write_bytes(whole[:at] + bytes([whole[at] ^ 1 << rng.randrange(8)]) + whole[at + 1 :])
    elif kind == "empty":
        path.touch()
    elif kind == "noise":
        path.write_bytes(rng.randbytes(len(whole)))
    elif kind == "folder":
        path.mkdir()
    elif kind == "pipe":
        os.mkfifo(path)
    elif kind == "longer":
        path.write_bytes(whole + rng.randbytes(99))
    elif kind == "zeros":
        path.write_bytes(whole[:at] + bytes(len(whole) - at))
    return kind


def _stored(root: Path) -> dict[str, Any]:
    """Write the samples in formats that are read in parts; return what `open_bricks` takes."""
    import h5py
    import zarr

    with h5py.File(root / "v.h5", "w") as file:
        file.create_dataset("a", data=samples(), chunks=(8, 9, 10), compression="gzip", fletcher32=True)
        file.create_dataset("plain", data=samples(), chunks=(8, 9, 10))
    for name, version in (("v2.zarr", 2), ("v3.zarr", 3)):
        array = zarr.create_array(root / name, shape=_SHAPE, chunks=(9, 16, 8), dtype="u1", zarr_format=version)
        array[:] = samples()
    np.save(root / "v.npy", samples())
    (root / "v.raw").write_bytes(samples().tobytes())
    return {
        f"{root / 'v.h5'}:/a": {},
        f"{root / 'v.h5'}:/plain": {},
        str(root / "v2.zarr"): {},
        str(root / "v3.zarr"): {},
        str(root / "v.npy"): {},
        str(root / "v.raw"): {"shape": _SHAPE, "dtype": "u1"},
    }


def damaged_chunks(seed: int, count: int) -> Tally:
    """Damage a file before it is opened, or between opening and drawing: a picture, or an error of the package."""
    from sheetsplat.bricks.resident import residents

    tally, rng = Tally(), random.Random(seed)
    with tempfile.TemporaryDirectory() as name, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        root, place = Path(name) / "whole", Path(name) / "used"
        root.mkdir()
        stored = _stored(root)
        for number in range(count):
            shutil.rmtree(place, ignore_errors=True)
            shutil.copytree(root, place)
            data, options = rng.choice(sorted(stored.items(), key=lambda one: one[0]))
            data = data.replace(str(root), str(place))
            path = Path(data.partition(":")[0])
            chosen = path if path.is_file() else rng.choice(sorted(one for one in path.rglob("*") if one.is_file()))
            early = rng.random() < 0.5
            residents().clear()
            said = f"{number}: {data.rpartition('/used/')[2]}"
            try:
                with soon(tally, said, _SECONDS):
                    kind = _damage(rng, chosen) if early else ""
                    opened = ss.open_bricks(data, brick=12, quality="draft", **options)
                    residents().clear()
                    kind = kind or _damage(rng, chosen)
                    ss.render(opened, size=SIZE, quality="draft")
                tally.did(f"pictures of files: {kind}")
            except ss.Error as error:
                tally.did("errors of the package")
                if path.name not in str(error) and chosen.name not in str(error):
                    tally.failed(f"{said}, {chosen.name}: {error}")
            except Exception as error:  # Whatever else is raised is what is looked for.
                tally.failed(f"{said}, {chosen.name}: {type(error).__name__}: {error}")
    return tally


class _Array:
    """Says that it is a Zarr array, and does as it is told.

    Parameters
    ----------
    shape, dtype
        As it says.
    get
        Called for each box.
    """

    def __init__(self, shape: Any, dtype: Any, get: Callable[[Any], Any]) -> None:
        self.shape, self.dtype, self._get = shape, dtype, get
        self.ndim, self.chunks = 3, (8, 8, 8)
        self.size = 1

    def __getitem__(self, key: Any) -> Any:
        return self._get(key)


_Array.__name__ = _Array.__qualname__ = "Array"
_Array.__module__ = "zarr"


def _raise(error: BaseException) -> Any:
    raise error


def hostile(rng: random.Random) -> tuple[str, Callable[[], Any], dict[str, Any]]:
    """Return data that nobody expects: their name, what makes them, and options."""
    whole = samples(np.float32)
    cube = (16, 16, 16)
    shapes = ((0, 4, 4), (4, 0, 4), (1, 1, 1), (2, 1, 1), (1, 1, 40), (3, 3, 3), (13, 12, 11), (1, 64, 1))
    shape = rng.choice(shapes)
    errors = (
        RuntimeError("x"),
        KeyError(3),
        OSError(5, "y"),
        MemoryError(),
        ValueError(),
        IndexError(),
        EOFError("z"),
        StopIteration(),
        RecursionError(),
        ZeroDivisionError(),
        UnicodeDecodeError("utf-8", b"\xff", 0, 1, "no"),
    )
    error = rng.choice(errors)
    other = rng.choice(("f8", "i2", "c8", "O", "U3", "M8[s]", "?", "V4"))
    calls = [0]

    def changing(key: Any) -> Any:
        calls[0] += 1
        return whole[:16, :16, :16][key].astype(other if calls[0] > 2 else "f4")

    kinds: dict[str, Callable[[], Any]] = {
        f"ones of {shape}": lambda: np.ones(shape, np.float32),
        "noise of small edges": lambda: np.random.default_rng(1).random(shape).astype(np.float32),
        "negative strides": lambda: whole[::-1, ::-2, ::-1],
        "broadcast": lambda: np.broadcast_to(np.float32(3), cube),
        "Fortran": lambda: np.asfortranarray(whole),
        "all NaN": lambda: np.full(cube, np.nan, np.float32),
        "NaN bricks": lambda: np.where(np.arange(30)[:, None, None] < 12, np.nan, whole),
        "infinities": lambda: np.where(whole > 150, np.inf, whole),
        "huge": lambda: whole.astype(np.float64) * 1e300,
        "tiny": lambda: whole.astype(np.float64) * 1e-310,
        "half": lambda: whole.astype(np.float16),
        "bool": lambda: whole > 100,
        "big-endian": lambda: whole.astype(">f8"),
        "uint64": lambda: np.full(cube, 2**64 - 1, np.uint64),
        "complex": lambda: whole.astype(np.complex64),
        "objects": lambda: whole.astype(object),
        "texts": lambda: np.full(cube, "x"),
        "masked": lambda: np.ma.masked_where(whole > 100, whole),
        "read-only": lambda: np.frombuffer(whole.tobytes(), np.float32).reshape(whole.shape),
        f"raises {type(error).__name__}": lambda: _Array(cube, np.dtype("f4"), lambda key: _raise(error)),
        "another shape": lambda: _Array(cube, np.dtype("f4"), lambda key: np.zeros((3, 3, 3), np.float32)),
        "no array": lambda: _Array(cube, np.dtype("f4"), lambda key: "x"),
        "None": lambda: _Array(cube, np.dtype("f4"), lambda key: None),
        f"another dtype ({other})": lambda: _Array(cube, np.dtype("f4"), changing),
        "a shape of words": lambda: _Array(("a", "b", "c"), np.dtype("f4"), lambda key: whole[key]),
        "a negative shape": lambda: _Array((-1, 4, 4), np.dtype("f4"), lambda key: whole[key]),
        "a shape of 10^9 each": lambda: _Array((10**9,) * 3, np.dtype("f4"), lambda key: _raise(OSError(5, "far"))),
        "no dtype": lambda: _Array(cube, "nonsense", lambda key: whole[key]),
    }
    urls = (
        "http://127.0.0.1:1/v.raw",
        "memory://no",
        "ftp://",
        "nosuch://a",
        "file:///etc/passwd",
        "s3://a/b",
        "://",
        "zip://x::y",
        "http://[::1",
        "memory://",
        "gs://x",
        "local://" + "x" * 5000,
    )
    url = rng.choice(urls)
    kinds[f"the URL {url[:40]}"] = lambda: url
    name = rng.choice(sorted(kinds))
    options: dict[str, Any] = {}
    if name.startswith("the URL") and rng.random() < 0.7:
        options = {"shape": (4, 4, 4), "dtype": "u1"}
    if rng.random() < 0.4:
        options["nan"] = "skip"
    if rng.random() < 0.2:
        options["lattice"] = "bcc"
    if rng.random() < 0.2:
        options["levels"] = rng.choice((1, 2, 9))
    if rng.random() < 0.2:
        options["radius"] = rng.choice((0.6, 4.0, 30.0))
    return name, kinds[name], options


def hostile_arrays(seed: int, count: int) -> Tally:
    """Open and draw data that nobody expects, in this process: a picture, or an error of the package."""
    tally, rng = Tally(), random.Random(seed)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for number in range(count):
            name, make, options = hostile(rng)
            brick = rng.choice((12, 16, 64))
            said = f"{number}: {name}, brick {brick}, {options}"
            tally.did("arrays")
            try:
                with soon(tally, said, _SECONDS):
                    opened = ss.open_bricks(make(), brick=brick, quality=rng.choice(("draft", "good")), **options)
                    mode = rng.choice(("composite", "mip", "isosurface", "xray"))
                    drawn = ss.render(opened, size=(24, 20), mode=mode)
                    # Where no slice counts, nothing is the largest.
                    known = np.isfinite(drawn.pixels) | (np.isnan(drawn.pixels) & (mode == "mip"))
                    tally.did("pictures", bool(known.all()))
                    if not known.all():
                        tally.failed(f"{said}: numbers that are none")
            except ss.Error as error:
                tally.did("errors of the package")
                if len(str(error)) > 3000:
                    tally.failed(f"{said}: {len(str(error))} characters")
            except Exception as error:  # Whatever else is raised is what is looked for.
                tally.failed(f"{said}: {type(error).__name__}: {error}")
    return tally


def _busy(dask_worker: Any) -> int:
    return len(dask_worker.state.executing)


def given_up(seed: int, count: int) -> Tally:
    """Give pictures up at random moments: the workers are idle within a second."""
    tally, rng = Tally(), random.Random(seed)
    with cluster(2) as client:
        opened = ss.open_bricks(np.tile(samples(), (4, 4, 4)), brick=64, client=client, quality="draft")
        slowest = 0.0
        for _ in range(count):
            end = time.monotonic() + rng.uniform(0.0, 1.5)
            try:
                ss.render(
                    opened,
                    client=client,
                    size=(900, 900),
                    quality="best",
                    progress=lambda _, end=end: time.monotonic() < end,
                )
                tally.did("pictures that were done before")
            except ss.Cancelled:
                tally.did("pictures given up")
            began = time.monotonic()
            while any(client.processing().values()) or any(client.run(_busy).values()):
                if time.monotonic() - began > 20:
                    break
                time.sleep(0.01)
            slowest = max(slowest, time.monotonic() - began)
            tally.did("idle within a second", time.monotonic() - began < 1.0)
        tally.did("ms until idle, the most", round(1000 * slowest))
        if slowest > 3.0:
            tally.failed(f"{slowest:.1f} s until the workers were idle")
    return tally


def _limit(most: int) -> None:
    resource.setrlimit(resource.RLIMIT_FSIZE, (most, resource.RLIM_INFINITY))


def full_disks_of_workers(seed: int, count: int) -> Tally:
    """Let workers run out of disk while they write coarser levels: one error that names worker and brick."""
    tally, rng = Tally(), random.Random(seed)
    with tempfile.TemporaryDirectory() as scratch, cluster(2) as client:
        for number in range(count):
            most = rng.randrange(0, 4000)
            client.run(_limit, most)
            folder = Path(scratch) / f"{number}"
            folder.mkdir()
            try:
                ss.open_bricks(samples(), brick=12, levels=1, scratch=folder, client=client, quality="draft")
                tally.did("levels made")
            except ss.Error as error:
                tally.did("clear errors")
                if "tcp://" not in str(error) or "brick" not in str(error):
                    tally.failed(f"{number}, {most} bytes: {error}")
            except Exception as error:  # Whatever else is raised is what is looked for.
                tally.failed(f"{number}, {most} bytes: {type(error).__name__}: {error}")
        client.run(_limit, resource.RLIM_INFINITY)
        folder = Path(scratch) / "last"
        folder.mkdir()
        opened = ss.open_bricks(samples(), brick=12, levels=1, scratch=folder, client=client, quality="draft")
        tally.did("pictures afterwards", ss.render(opened, client=client, size=SIZE).rgba.any())
    return tally


def lost_schedulers(seed: int, count: int) -> Tally:
    """End the scheduler at random moments of a picture: one error that names it."""
    import distributed

    tally, rng = Tally(), random.Random(seed)
    large = np.tile(samples(), (3, 3, 3))
    for number in range(count):
        made = distributed.LocalCluster(
            n_workers=1, threads_per_worker=1, processes=False, dashboard_address=None, silence_logs=logging.CRITICAL
        )
        client = distributed.Client(made, set_as_default=False)
        try:
            opened = ss.open_bricks(large, brick=32, client=client, quality="draft")
            timer = threading.Timer(rng.uniform(0.0, 0.5), made.close)
            timer.start()
            began = time.monotonic()
            try:
                ss.render(opened, client=client, size=(500, 500), quality="best")
                tally.did("pictures that were done before")
            except ss.Error as error:
                tally.did("clear errors")
                if "scheduler" not in str(error) and "worker" not in str(error):
                    tally.failed(f"{number}: {error}")
            except Exception as error:  # Whatever else is raised is what is looked for.
                tally.failed(f"{number}: {type(error).__name__}: {error}")
            if time.monotonic() - began > _PATIENCE:
                tally.failed(f"{number}: {time.monotonic() - began:.0f} s")
            timer.join()
        finally:
            client.close()
            made.close()
    return tally

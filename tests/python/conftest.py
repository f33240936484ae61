"""Fixtures of all Python tests."""

from __future__ import annotations

import ctypes
import fcntl
import gc
import logging
import os
import signal
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bricked_volumes import blob

import sheetsplat as ss

ROOT = Path(__file__).resolve().parents[2]

# A message of the OpenGL driver fails the test.
os.environ.setdefault("SHEETSPLAT_GL_DEBUG", "1")

# Where as many processes test as there are cores (pytest -n), software OpenGL draws without threads of its own: for
# small pictures, handing work to threads takes a fifth of the time.
if "PYTEST_XDIST_WORKER" in os.environ:
    os.environ.setdefault("LP_NUM_THREADS", "0")

# Software OpenGL compiles a shader for every effect and draws a small picture with it: without the optimizer, whose
# programs some C++ tests draw with, compiling takes less than half the time.
os.environ.setdefault("GALLIVM_PERF", "nopt")

# A quick run has the first case of each test, and those that take it to another backend.
BACKENDS = {"auto", "cpu", "gl", "reference"}


# The C library keeps what is freed, in a heap for each thread, and puts ever larger arrays there. Arrays of a megabyte
# and more stay mapped by themselves, threads share two heaps, and `give_back` returns the rest.
M_MMAP_THRESHOLD, M_ARENA_MAX = -3, -8
C_LIBRARY = ctypes.CDLL(None)
if hasattr(C_LIBRARY, "mallopt"):
    C_LIBRARY.mallopt(M_MMAP_THRESHOLD, 1 << 20)
    C_LIBRARY.mallopt(M_ARENA_MAX, 2)

# Bytes that a process grows by before it gives back what was freed; what it had when it last did.
GROWTH = 48 << 20
_resident = 0


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--quick",
        action="store_true",
        help="run one case of each test, one for each other backend, and none that is marked slow",
    )


def pytest_configure(config: pytest.Config) -> None:
    """Keep the figures of every comparison of pictures, also of those that pass, in out/python/comparisons.txt."""
    folder = ROOT / "out" / "python"
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "comparisons.txt"
    # Worker processes (pytest -n) append to what the first process begins.
    if not hasattr(config, "workerinput"):
        path.write_text("")
    logger = logging.getLogger("image_checks")
    logger.setLevel(logging.INFO)
    logger.addHandler(logging.FileHandler(path, mode="a"))


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Iterator[None]:
    """Spare the garbage collector what is imported and collected, which lives to the end."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.enable()


@pytest.fixture(autouse=True)
def _log_as_it_was() -> Iterator[None]:
    """Undo what a command that ran in this process made of the log, as `--quiet` does."""
    logger = logging.getLogger("sheetsplat")
    level, handlers = logger.level, list(logger.handlers)
    yield
    logger.setLevel(level)
    logger.handlers[:] = handlers


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item, nextitem: pytest.Item | None) -> Iterator[None]:
    """Forget what the tests of a file keep for one another, and give back to the system what was freed."""
    done = yield
    module = getattr(item, "module", None)
    if nextitem is None or getattr(nextitem, "module", None) is not module:
        for value in vars(module).values() if module else ():
            if getattr(value, "__module__", "") == module.__name__ and hasattr(value, "cache_clear"):
                value.cache_clear()
        give_back(0)
    else:
        give_back(GROWTH)
    return done


def resident() -> int:
    """Return the bytes of this process that are in memory."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


def give_back(growth: int) -> None:
    """Return freed memory to the system where the process has grown by more than so many bytes since the last time."""
    global _resident
    if resident() > _resident + growth:
        gc.collect()
        if hasattr(C_LIBRARY, "malloc_trim"):
            C_LIBRARY.malloc_trim(0)
        _resident = resident()


def quick(items: list[pytest.Item]) -> list[pytest.Item]:
    """Return the items of a quick run."""
    cases: dict[str, list[pytest.Item]] = {}
    for item in items:
        if item.get_closest_marker("slow") is None:
            cases.setdefault(item.nodeid.partition("[")[0], []).append(item)
    chosen = []
    for found in cases.values():
        seen: set[str] = set()
        for number, item in enumerate(found):
            parameters = getattr(item, "callspec", None)
            backends = BACKENDS & {str(value) for value in parameters.params.values()} if parameters else set()
            if number == 0 or not backends <= seen:
                seen |= backends
                chosen.append(item)
    return chosen


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    # At the end those wait for one another only, and not for long tests beside them.
    items.sort(key=lambda item: item.get_closest_marker("alone") is not None)
    if config.getoption("quick"):
        kept = quick(items)
        chosen = set(kept)
        config.hook.pytest_deselected(items=[item for item in items if item not in chosen])
        items[:] = kept


@pytest.fixture(autouse=True)
def _turn(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Let tests that are marked alone wait until no other worker process (pytest -n) has a test under way."""
    if not hasattr(request.config, "workerinput"):
        yield
        return
    folder = tmp_path_factory.getbasetemp().parent
    with open(folder / "gate", "w") as gate, open(folder / "turn", "w") as turn:
        # Who waits for its turn holds the gate, so that nobody overtakes it.
        fcntl.flock(gate, fcntl.LOCK_EX)
        fcntl.flock(turn, fcntl.LOCK_EX if request.node.get_closest_marker("alone") else fcntl.LOCK_SH)
        fcntl.flock(gate, fcntl.LOCK_UN)
        yield


def gl_missing() -> str:
    """Return why no picture can be made by OpenGL here, or an empty text."""
    reports = [device for device in ss.devices() if device.backend == "gl"]
    if any(device.available for device in reports):
        return ""
    return "no OpenGL: " + "; ".join(f"{device.platform}: {device.description}" for device in reports)


@pytest.fixture(scope="session")
def _gl_reason() -> str:
    return gl_missing()


@pytest.fixture(autouse=True)
def _skip_without_gl(request: pytest.FixtureRequest) -> None:
    if request.node.get_closest_marker("gl") is not None:
        reason = request.getfixturevalue("_gl_reason")
        if reason:
            pytest.skip(reason)


@pytest.fixture(scope="module")
def samples() -> Any:
    """Return the volume that tests of bricks draw."""
    return blob()


@pytest.fixture(scope="module")
def cluster() -> Iterator[Any]:
    """Return a client of two processes of one thread each."""
    distributed = pytest.importorskip("distributed", reason="no distributed: pip install 'sheetsplat[distributed]'")
    with (
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None, silence_logs=50
        ) as made,
        distributed.Client(made) as client,
    ):
        yield client


@pytest.fixture
def ctrl_c() -> Iterator[None]:
    """Make SIGINT raise KeyboardInterrupt, in this process and in those that it starts.

    A process that a script starts in the background ignores SIGINT, and Python then leaves it ignored.
    """
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.fixture
def rng() -> np.random.Generator:
    """Return a generator with a fixed seed."""
    return np.random.default_rng(20050901)


@pytest.fixture(scope="session")
def ball() -> np.ndarray:
    """Return a smooth ball, float32 [k, j, i] of shape (14, 16, 18): 1 in the middle, 0 from the radius 7 on."""
    k, j, i = np.mgrid[0:14, 0:16, 0:18]
    distance = np.sqrt((k - 6.5) ** 2 + (j - 7.5) ** 2 + (i - 8.5) ** 2)
    return np.clip(1 - distance / 7, 0, 1).astype(np.float32)


@pytest.fixture
def volume(tmp_path: Path, ball: np.ndarray) -> Path:
    """Return a file that holds the ball in bytes, 0 to 200."""
    path = tmp_path / "ball.npy"
    np.save(path, (ball * 200).astype(np.uint8))
    return path


@pytest.fixture(scope="session")
def data_dir() -> Path:
    """Return the folder of the measured volumes: SHEETSPLAT_DATA, else ../shared/data."""
    folder = Path(os.environ.get("SHEETSPLAT_DATA", ROOT.parent / "shared" / "data"))
    if not folder.is_dir():
        pytest.skip(f"no measured volumes: {folder} is no folder (SHEETSPLAT_DATA names it)")
    return folder


@pytest.fixture(scope="session")
def reference_renderer() -> ss.Renderer:
    """Return a renderer by the reference."""
    return ss.Renderer("reference")


@pytest.fixture(scope="module")
def gl_renderer() -> Iterator[ss.Renderer]:
    """Return a renderer by OpenGL; tests that ask for it carry the mark gl."""
    yield ss.Renderer("gl")


@pytest.fixture(scope="module")
def cpu_renderer() -> Iterator[ss.Renderer]:
    """Return a renderer by the processor's vector instructions."""
    yield ss.Renderer("cpu")


def random_rotations(rng, count):
    """Return rotation matrices, of determinant 1."""
    matrices = np.linalg.qr(rng.normal(size=(count, 3, 3)))[0]
    return matrices * np.linalg.det(matrices)[:, np.newaxis, np.newaxis]


@pytest.fixture
def soup(rng):
    """Return centres, semi-axes, rotation matrices, values and weights of 40 ellipsoids."""
    n = 40
    return (
        rng.normal(size=(n, 3)),
        rng.uniform(0.1, 1.5, (n, 3)),
        random_rotations(rng, n),
        rng.normal(size=n),
        rng.uniform(0.2, 2.0, n),
    )


@pytest.fixture
def block():
    """Return the positions of 9 x 9 x 9 samples, 1 apart."""
    return np.mgrid[0:9, 0:9, 0:9].reshape(3, -1).T.astype(float)


@pytest.fixture
def opened():
    """Return a function that opens a session of data, closed in the end."""
    from viewer_pages import opened_sessions

    with opened_sessions() as make:
        yield make

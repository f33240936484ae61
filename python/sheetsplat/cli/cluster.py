"""What draws: a cluster of this machine's processes, or one that a scheduler has."""

from __future__ import annotations

import contextlib
import functools
import logging
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from click.core import ParameterSource

from sheetsplat._processes import deaf, require_files, safe_path
from sheetsplat._waiting import begun, wait
from sheetsplat.cli.help import GroupedOption
from sheetsplat.cli.options import apply, options_of
from sheetsplat.options.bricks import BrickOptions
from sheetsplat.options.core import definitions
from sheetsplat.options.data import OpenOptions
from sheetsplat.options.film import MOST_WORKERS
from sheetsplat.options.workers import WORKER_TIMEOUT, WorkerOptions

if TYPE_CHECKING:
    from sheetsplat.fields import BrickedField, BrickedKernels

_log = logging.getLogger("sheetsplat")
_GROUP = "Data in bricks"
_WORKERS = click.option(
    "--workers",
    cls=GroupedOption,
    group=_GROUP,
    type=click.IntRange(1, MOST_WORKERS),
    help="Draw FILE in bricks by so many processes of this machine, which share its memory.",
)
# Of dask, for processes of one command. A worker that ended may take long to come back: a busy machine takes longer
# than the 15 s after which a LocalCluster gives it up for good. Nobody sees what the processes say many times a second
# of their threads, of their loops and of the machine.
# The web servers of scheduler and workers answer everybody: they have no pages, and are closed as they begin.
_PRELOAD = ["sheetsplat.cli.cluster_process"]
_SETTINGS = {
    "distributed.deploy.lost-worker-timeout": "600s",
    "distributed.worker.profile.enabled": False,
    "distributed.admin.tick.interval": "1s",
    "distributed.admin.system-monitor.interval": "5s",
    "distributed.scheduler.http.routes": [],
    "distributed.scheduler.preload": _PRELOAD,
    "distributed.worker.http.routes": [],
    "distributed.worker.preload": _PRELOAD,
}
# Open files of this process, the scheduler: its own, and those for each worker (pipes, connections, a lock).
_FILES, _FILES_EACH = 24, 11
_SCHEDULER = click.option(
    "--scheduler",
    cls=GroupedOption,
    group=_GROUP,
    metavar="ADDRESS",
    help="Draw FILE in bricks by the workers of a dask scheduler, tcp://host:8786, all of which can read it.",
)


def brick_options(function: Callable[..., Any]) -> Callable[..., Any]:
    """Add the options of pictures in bricks."""
    decorated: Callable[..., Any] = apply([*options_of(BrickOptions, WorkerOptions), _WORKERS, _SCHEDULER])(function)
    return decorated


@contextlib.contextmanager
def connected(address: str | None) -> Iterator[Any]:
    """Yield a client of a dask scheduler, or None without an address."""
    if address is None:
        yield None
        return
    from sheetsplat.errors import Error, complain, missing_package

    try:
        from distributed import Client  # type: ignore[import-not-found, import-untyped, unused-ignore]
    except ImportError as error:
        raise missing_package(f"the scheduler {address} cannot be used", error) from error
    try:
        connect: Any = Client
        client = connect(address, timeout=10)
    except (OSError, ValueError, TypeError, TimeoutError) as error:
        # TypeError: an address tls:// without keys.
        raise complain(
            f"the scheduler {address} cannot be used",
            str(error),
            "a running scheduler",
            "of tls:// addresses, Dask's configuration names the keys" if address.startswith("tls:") else "",
            kind=Error,
        ) from None
    try:
        yield client
    finally:
        client.close()


@contextlib.contextmanager
def started(count: int, timeout: float | None = None) -> Iterator[Any]:
    """Yield a client of so many processes, one thread each, that share the memory of this machine.

    Only who has the keys, which are made anew and are nowhere but in these processes, can connect to them. `timeout`:
    seconds until they must be ready.
    """
    from sheetsplat import _memory
    from sheetsplat.errors import Error, complain, missing_package

    try:
        import cryptography  # noqa: F401 - makes the keys
        import dask.config
        from distributed import Client, LocalCluster
    except ImportError as error:
        raise missing_package("processes that draw bricks cannot be started", error) from error
    require_files(_FILES + _FILES_EACH * count, "processes that draw bricks")
    start: Any = LocalCluster
    connect: Any = Client
    with contextlib.ExitStack() as ends:
        # What Dask writes, spilled results and locks, is read again as it is: a folder that nobody else can change.
        folder = ends.enter_context(tempfile.TemporaryDirectory(prefix="sheetsplat-"))
        ends.enter_context(dask.config.set({**_SETTINGS, "temporary-directory": folder}))
        ends.enter_context(safe_path())
        launch = functools.partial(
            start,
            n_workers=count,
            threads_per_worker=1,
            processes=True,
            security=True,
            local_directory=folder,
            memory_limit=_memory.available() // (count + 1),
            # Any free port of this machine: distributed warns where the usual one is taken, dashboard or not.
            dashboard_address="127.0.0.1:0",
            scheduler_kwargs={"dashboard": False},
            # What processes say of a brick that cannot be read comes as the error of the command.
            silence_logs=logging.ERROR if _log.isEnabledFor(logging.INFO) else logging.CRITICAL,
        )
        try:
            cluster = _launched(launch, WORKER_TIMEOUT if timeout is None else timeout)
        except (OSError, RuntimeError, TimeoutError) as error:
            raise complain(
                "processes that draw bricks cannot be started", str(error), f"{count}", kind=Error
            ) from error
        ends.enter_context(cluster)
        yield ends.enter_context(connect(cluster))


def _launched(launch: Callable[[], Any], timeout: float) -> Any:
    """Return what starts processes, in a thread: this one answers Ctrl-C meanwhile, and gives up after a time."""
    from multiprocessing import active_children

    until = time.monotonic() + timeout

    def look() -> None:
        if time.monotonic() > until:
            raise TimeoutError(f"no process that was ready within {timeout:g} s (--worker-timeout)")

    future = begun(lambda: deaf(launch))
    try:
        wait(future, look)
    except BaseException:
        # They may hang, and the end of this process would wait for them.
        for child in active_children():
            child.kill()
        raise
    return future.result()


@dataclass(frozen=True)
class Bricks:
    """What opens a file in bricks, and what draws it: a client, or None for this process.

    `cut`: the values of `BrickOptions`.
    """

    cut: Mapping[str, Any]
    client: Any

    def open(self, path: Path, **reading: Any) -> BrickedField | BrickedKernels:
        """Return the data of a file; `reading`: options of `sheetsplat.open_bricks`.

        Raises
        ------
        click.UsageError
            For scene files, which name their data themselves.
        """
        from sheetsplat.bricks.opening import open_bricks
        from sheetsplat.cli.scene import is_scene_file

        if is_scene_file(path):
            raise click.UsageError("--brick, --workers and --scheduler are for files of data")
        return open_bricks(path, client=self.client, **self.cut, **reading)

    def opened(self, path: Path, keywords: Mapping[str, Any]) -> tuple[Any, dict[str, Any]]:
        """Return the data of a file, and the keywords of `sheetsplat.render` but for those that opened it."""
        of_data = [name for name in definitions(OpenOptions) if name in keywords]
        rest = {name: value for name, value in keywords.items() if name not in of_data or name == "quality"}
        return self.open(path, **{name: keywords[name] for name in of_data}), rest


def is_cut(options: Mapping[str, Any], *, by_workers: bool) -> bool:
    """Return whether the command line asks for data in bricks; `by_workers`: workers and a scheduler ask for it too.

    Raises
    ------
    click.UsageError
        For both workers and a scheduler.
    """
    if options["workers"] is not None and options["scheduler"] is not None:
        raise click.UsageError("--scheduler and --workers both say what draws; leave out one or the other")
    given = click.get_current_context().get_parameter_source
    names = (*definitions(BrickOptions), *(("workers", "scheduler") if by_workers else ()))
    return any(given(name) is ParameterSource.COMMANDLINE for name in names)


def without_bricks(options: Mapping[str, Any]) -> dict[str, Any]:
    """Return the options of a command but for those that cut data, and those that say what draws them."""
    names = (*definitions(BrickOptions), *definitions(WorkerOptions), "workers", "scheduler")
    return {name: value for name, value in options.items() if name not in names}


@contextlib.contextmanager
def in_bricks(options: Mapping[str, Any], *, by_workers: bool = True) -> Iterator[Bricks | None]:
    """Yield what opens and draws a file in bricks; None where no option asks for that: see `is_cut`."""
    if not is_cut(options, by_workers=by_workers):
        yield None
        return
    from sheetsplat.bricks.workers import look_after

    cut = {name: options[name] for name in definitions(BrickOptions)}
    workers, scheduler = options["workers"], options["scheduler"]
    with started(workers, options["worker_timeout"]) if workers is not None else connected(scheduler) as client:
        look_after("open_bricks", client, options["worker_timeout"])
        yield Bricks(cut, client)

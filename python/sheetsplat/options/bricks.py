"""The options of volumes that are drawn in bricks, and of the cluster that draws them."""

import os
from typing import Annotated, Any, TypedDict

from sheetsplat._checks import attribute, shown, whole
from sheetsplat.errors import complain, unusable
from sheetsplat.options.core import CommandLine, Option
from sheetsplat.options.data import FileOptions, KernelOptions, PlacementOptions
from sheetsplat.options.quality import QualityOptions
from sheetsplat.options.renderer import Progress
from sheetsplat.options.values import Special, Whole
from sheetsplat.options.workers import WorkerOptions

#: Edges of bricks, in samples. Smaller ones would be all border, larger ones more than a worker holds.
LEAST_EDGE, LARGEST_EDGE = 4, 2048
#: Coarser levels of a volume.
MOST_LEVELS = 8
#: Kernels of a brick of scattered data.
LEAST_KERNELS, MOST_KERNELS = 1, 1 << 31


def edge_of(what: str, value: object) -> int:
    """Return the edge of bricks in samples, or InvalidInput."""
    wanted = f"a whole number of samples from {LEAST_EDGE} to {LARGEST_EDGE}"
    result = whole(what, value, wanted)
    if not LEAST_EDGE <= result <= LARGEST_EDGE:
        raise complain(unusable(what), str(result), wanted)
    return result


def levels_of(what: str, value: object) -> int:
    """Return a number of coarser levels, or InvalidInput."""
    wanted = f"a whole number from 0 to {MOST_LEVELS}"
    result = whole(what, value, wanted)
    if not 0 <= result <= MOST_LEVELS:
        raise complain(unusable(what), str(result), wanted)
    return result


def kernels_of(what: str, value: object) -> int:
    """Return the most kernels of a brick, or InvalidInput."""
    wanted = f"a whole number of kernels from {LEAST_KERNELS} to {MOST_KERNELS}"
    result = whole(what, value, wanted)
    if not LEAST_KERNELS <= result <= MOST_KERNELS:
        raise complain(unusable(what), str(result), wanted)
    return result


def folder_of(what: str, value: object) -> str | None:
    """Return the path of a folder that exists, or None; InvalidInput for anything else."""
    if value is not None and not (isinstance(value, str | os.PathLike) and os.path.isdir(value)):
        raise complain(unusable(what), shown(value), "a folder that exists")
    return None if value is None else os.path.abspath(os.fsdecode(value))


def cluster_of(what: str, value: Any) -> Any:
    """Return a client of dask.distributed, or None; InvalidInput for anything else."""
    if value is not None and not all(callable(attribute(value, name)) for name in ("submit", "scheduler_info")):
        wanted = "a client of dask.distributed"
        advice = "from dask.distributed import Client; Client(n_workers=4, threads_per_worker=1)"
        raise complain(unusable(what), f"{type(value).__name__}, {shown(value)}", wanted, advice)
    return value


class ClusterOptions(WorkerOptions, total=False):
    """What draws a volume in bricks."""

    client: Annotated[
        Any,
        Option(
            "Of data in bricks: a client of dask.distributed, all of whose workers draw the picture, which does "
            "not depend on their number.",
            unset="this process",
            accepts="distributed.Client",
            check=cluster_of,
            cli=(),
        ),
    ]


class BrickOptions(TypedDict, total=False):
    """How a volume is cut."""

    brick: Annotated[
        int,
        Option(
            "Edge of the bricks of a volume in samples; best a multiple of the edge of the file's chunks.",
            default=256,
            check=edge_of,
            value=Whole(LEAST_EDGE, LARGEST_EDGE),
        ),
    ]
    levels: Annotated[
        int,
        Option(
            "Coarser levels of a volume, each half as fine, of means of samples or those of an OME-Zarr image: "
            "pictures have, brick by brick, the coarsest one whose error the quality allows. 0: all samples are drawn.",
            default=0,
            check=levels_of,
            value=Whole(0, MOST_LEVELS),
        ),
    ]
    brick_kernels: Annotated[
        int,
        Option(
            "Kernels of a brick of scattered data, about.",
            default=1_000_000,
            check=kernels_of,
            value=Whole(LEAST_KERNELS, MOST_KERNELS),
        ),
    ]
    scratch: Annotated[
        str | os.PathLike[str] | None,
        Option(
            "Scattered data in bricks: a folder for kernels sorted by bricks, about as large as the data, which all "
            "workers see.",
            unset="the folder for temporary files",
            accepts="path",
            check=folder_of,
            value=Special.TEXT,
            cli=(CommandLine(value=Special.TEXT, metavar="FOLDER"),),
        ),
    ]


class OpenBricksOptions(
    BrickOptions, ClusterOptions, PlacementOptions, KernelOptions, FileOptions, QualityOptions, total=False
):
    """Every keyword argument of `sheetsplat.open_bricks`."""

    progress: Annotated[
        Progress | None,
        Option(
            "Called with the finished share, from 0 to 1; where it returns False, the opening stops.",
            accepts="function",
            cli=(),
        ),
    ]

"""`open_bricks`: data that stay where they are until a picture asks for them, brick by brick."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Unpack

import numpy as np

from sheetsplat._checks import check_progress, choice, is_off, truth, whole
from sheetsplat._waiting import ask, asking, note, part
from sheetsplat.bricks.cluster import each
from sheetsplat.bricks.kernel_pieces import KERNELS, READING, pieces_of
from sheetsplat.bricks.lattice import PREFILTER_MARGIN, LatticeSpec
from sheetsplat.bricks.levels import coarsen_brick, most_levels
from sheetsplat.bricks.levels import levels_of as coarse_levels
from sheetsplat.bricks.opening_kernels import open_kernels
from sheetsplat.bricks.partition import Partition, partition_lattice
from sheetsplat.bricks.prober import BrickProber
from sheetsplat.bricks.sources import BrickSource, open_source
from sheetsplat.bricks.statistics import Survey, SurveyPlan, first_sample, merge_surveys, survey_of
from sheetsplat.bricks.store import FileStore
from sheetsplat.bricks.tasks import nothing
from sheetsplat.bricks.workers import look_after
from sheetsplat.choose.asked import Asked
from sheetsplat.choose.kernels import with_own_kernel
from sheetsplat.errors import Unsupported, complain, option_ref, option_refs, unusable
from sheetsplat.fields import BrickedField, BrickedKernels
from sheetsplat.fields.labelled import is_open, warn_of_halves
from sheetsplat.fields.regular import narrowest
from sheetsplat.io.axes import placement, tell_units
from sheetsplat.io.kernels import log_base
from sheetsplat.options.bricks import OpenBricksOptions, cluster_of, edge_of, folder_of, kernels_of, levels_of
from sheetsplat.options.core import check_names, definitions, documented, filled
from sheetsplat.options.data import KernelOptions
from sheetsplat.options.quality import QUALITIES

# Of all that is done, what the first reading is: a second one sorts kernels, or makes levels.
_SURVEY = 0.5
# Samples around a brick that most pictures need: the reach of kernels, and two slices.
_AROUND = 6
_SAMPLES = ("shape", "dtype", "offset", "name", "scalar", "step")
_OWN = ("brick", "levels", "brick_kernels", "scratch", "client", "worker_timeout", "progress")
# Options of scattered data, and one that needs all samples at once.
_REFUSED = ("grid", "particles", "support", "fit", "neighbors", "min_scale", "periodic", "resample", "weight")


@documented(OpenBricksOptions, chooses=True)
def open_bricks(path_or_array: Any, **options: Unpack[OpenBricksOptions]) -> BrickedField | BrickedKernels:
    """Return data that are drawn brick by brick: by this process, or by all workers of a cluster.

    Each brick is read once when the data are opened, by the process that draws it, for the range and the histogram of
    all samples, and is kept where it fits into memory. `sheetsplat.render` then makes the picture that it makes of the
    same volume in memory.
    Scattered kernels are sorted into bricks first; those of files in a folder for temporary files (`scratch`).

    Parameters
    ----------
    path_or_array
        A file of raw samples (with `shape` and `dtype`), .npy, HDF5 (FILE:/dataset), NetCDF, a folder of Zarr or
        OME-Zarr (FOLDER:/array); a URL of raw samples that fsspec reads; or an array [k, j, i] of NumPy, dask, Zarr,
        h5py or xarray. Kernels with their sizes: HDF5 with particles, Parquet with the columns that `open` takes of
        .csv (a file, a folder, several paths), a DataFrame of dask, pandas or polars, a dict of columns, or an
        EllipsoidField. All workers must be able to read a file by the same path.
    **options
        Those of OpenBricksOptions.

    Raises
    ------
    InvalidInput
        For damaged files, infinite samples, NaN unless they are skipped, and options that do not apply.
    Unsupported
        For formats of which no part can be read, and for workers with another version of this package.
    OutOfMemory
        Where a brick does not fit.
    Cancelled
        Where `progress` returned False.
    Error
        Where the file cannot be read, and where no worker lives.

    Examples
    --------
    >>> bricked = ss.open_bricks(values, brick=16)
    >>> image = ss.render(bricked, size=(40, 30))
    >>> image.size
    (40, 30)
    """
    check_names("open_bricks", options, OpenBricksOptions)
    check_progress("open_bricks", options.get("progress"))
    with asking(options.get("progress"), "the opening"):
        made = _opened(path_or_array, options)
        note(1.0)
        ask()
    return made


def _opened(path_or_array: Any, options: OpenBricksOptions) -> BrickedField | BrickedKernels:
    given: dict[str, Any] = {name: value for name, value in options.items() if value is not None}
    own = filled(OpenBricksOptions, given)
    cut = _Cut(
        edge_of("open_bricks: brick", own["brick"]),
        levels_of("open_bricks: levels", own["levels"]),
        folder_of("open_bricks: scratch", own["scratch"]),
    )
    most = kernels_of("open_bricks: brick_kernels", own["brick_kernels"])
    client = cluster_of("open_bricks: client", own["client"])
    look_after("open_bricks", client, given.get("worker_timeout"))
    off = [name for name in ("log", "offset", "resample") if is_off(given.get(name))]
    given = {name: value for name, value in given.items() if name not in (*_OWN, *off)}
    pieces = pieces_of(path_or_array, given, client)
    if pieces is not None:
        _refuse({"levels": cut.levels} if cut.levels else {}, ("levels",), "kernels")
        _refuse(given, [name for name in given if name not in (*READING, *KERNELS, "log", "quality")], "kernels")
        made_of = {name: value for name, value in given.items() if name != "quality"}
        return open_kernels(pieces, most, cut.scratch, client, given).opened_with(made_of)
    _refuse(given, _REFUSED, "volumes")
    if "offset" in given:
        given["offset"] = whole("open_bricks: offset", given["offset"])
    source = open_source(path_or_array, {name: given[name] for name in _SAMPLES if name in given})
    field = _field(source, cut, client, given)
    asked = Asked.of("open_bricks", {name: value for name, value in options.items() if name not in _OWN})
    made = with_own_kernel(field.probed_by(BrickProber.of(client)), asked)
    return made.opened_with({name: value for name, value in given.items() if name != "quality"})


def _refuse(given: Mapping[str, Any], names: Sequence[str], what: str) -> None:
    """Raise InvalidInput for options that were given and have no meaning for what is read."""
    if wrong := [name for name in names if name in given]:
        raise complain(
            "open_bricks: these options cannot be used",
            option_refs(wrong),
            f"those of {what} that are read in parts",
            "leave them out, or open the data with sheetsplat.open",
            option=wrong[0] if len(wrong) == 1 else None,
        )


def _are_labels(source: BrickSource, known: Survey, cut: _Cut, given: Mapping[str, Any]) -> bool:
    """Return whether samples that are said to be labels are whole numbers; InvalidInput where the caller says so."""
    failed = f"the labels of {source.name} cannot be drawn in bricks"
    if known.labels is None and "labels" not in given:
        warn_of_halves()
        return False
    if known.labels is None:
        raise complain(
            failed,
            "numbers that are not whole",
            "whole numbers",
            "pass " + option_ref("labels", "false"),
            option="labels",
        )
    if known.missing:
        found, advice = f"{known.missing} of {known.size} samples are NaN", "open them with sheetsplat.open"
        raise complain(failed, found, "a label for each sample", advice, kind=Unsupported)
    for name in ("levels", "log"):
        if cut.levels if name == "levels" else name in given:
            told = option_ref(name) + ", and labels have neither means nor logarithms"
            raise complain(failed, told, "samples as they are", "leave it out", option=name)
    return True


@dataclass(frozen=True)
class _Cut:
    """How a volume is cut: the edge of bricks, the number of coarser levels, and the folder for them."""

    brick: int
    levels: int
    scratch: str | None


def _with_levels(source: BrickSource, cut: _Cut, partition: Partition, client: Any) -> BrickSource:
    """Return a volume with coarser levels: its own, or those of means, which are made now."""
    if not cut.levels or source.coarser:
        return source.replace(coarser=source.coarser[: cut.levels])
    most = most_levels(source.shape, cut.brick)
    if cut.levels > most:
        raise complain(
            unusable("open_bricks: levels"),
            f"{cut.levels} for bricks of {cut.brick} samples along each axis",
            f"at most {most}: each halves the samples of a brick",
            "pass " + option_ref("brick", "256"),
            option="levels",
        )
    store = FileStore.new(cut.scratch, "coarser levels", "a seventh of the samples in float32")
    with part(_SURVEY, 1.0):
        shared = (partition, cut.brick, cut.levels, store)
        task, merge = ("coarsen-brick", coarsen_brick), ("merge-levels", nothing)
        each(client, source, shared, len(partition), task, merge, partition)
    return source.replace(coarser=coarse_levels(source, store, cut.brick, cut.levels))


def _field(source: BrickSource, cut: _Cut, client: Any, given: Mapping[str, Any]) -> BrickedField:
    """Return the field with the kernels that were given, or plain ones."""
    if "spacing" not in given:
        tell_units(source.quantity, source.shape, source.spacing)
    placed = placement(source, given)
    if source.holey:
        placed["nan"] = "skip"
    by_caller = truth("open_bricks: labels", given.get("labels", False))
    by_file = source.labels is not False and is_open(given) and "log" not in given
    names = ("lattice", *(name for name in definitions(KernelOptions) if name != "labels"))
    placed |= {name: given[name] for name in names if name in given}
    lattice = placed.get("lattice", "cartesian")
    choice("open_bricks: lattice", lattice, ("cartesian", "bcc"))
    if cut.levels and lattice != "cartesian":
        asked, wanted = f"{cut.levels} for the lattice {lattice}", "none: levels are of cartesian lattices"
        raise complain(unusable("open_bricks: levels"), asked, wanted, option="levels")
    partition = partition_lattice(LatticeSpec(source.shape, lattice=lattice), cut.brick)
    # A quality may choose a prefilter by what is found.
    quality = choice("open_bricks: quality", given.get("quality", "good"), QUALITIES)
    filtered = given.get("prefilter", quality != "draft" and "normalization" not in given)
    filtered = truth("open_bricks: prefilter", filtered)
    around = _AROUND + (PREFILTER_MARGIN if filtered else 0)
    plan = SurveyPlan.of(source.shape, lattice, around, first_sample(source), by_caller or by_file)
    with part(0.0, _SURVEY if cut.levels else 1.0):
        task, merge = ("survey-brick", survey_of), ("merge-surveys", merge_surveys)
        found = each(client, source, (partition, plan), len(partition), task, merge, partition, "drawn")
    cores = [one.samples for one in partition.bricks if one.samples is not None]
    known = Survey.of(source, found, cores, plan)
    if known.missing and placed.get("nan", "error") == "error":
        raise complain(
            f"{source.name} cannot be drawn",
            f"{known.missing} of {known.size} samples are NaN",
            "numbers",
            "pass " + option_ref("nan", "skip") + " to leave their kernels out",
            option="nan",
        )
    if by_caller or by_file:
        placed["labels"] = _are_labels(source, known, cut, given)
    shown_source = _with_levels(source, cut, partition, client)
    if source.kept is None:
        low, high = known.value_range
        shown_source = shown_source.replace(kept=narrowest(int(low), int(high)))
    if "log" in given:
        low = known.value_range[0]
        floor = log_base(np.asarray([low]), source.name, given["log"])
        shown_source = shown_source.replace(floor=floor, quantity=replace(source.quantity, floor=floor))
    if shown_source.key != source.key:
        known = known.shown_by(shown_source)
    field = BrickedField(shown_source, known, cut.brick, **placed)
    if field.labels and not isinstance(source.labels, bool):
        field = field.with_label_colors(source.labels)
    return field.with_quantity_of_samples(shown_source.quantity, source.spacing, source.origin, "cartesian")

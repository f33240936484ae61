"""What effects cost: each one and each pair of them over the plain lit composite of the same field."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

import sheetsplat as ss
from bench import cliffs_small
from bench.effect_costs import EFFECTS, VIEWS, Conditions, Subject, surface
from bench.measure import data_file, device_of, renderer_for
from bench.quality import measured
from bench.report import Options, Report, Row, columns, environment
from bench.scenes import ellipsoids, spheres
from sheetsplat import datasets
from sheetsplat.choose.look import compose_scene
from sheetsplat.fields import Field

# How many of the steepest are listed.
_LISTED = 10
# Edge of the generated volume that stands in for the measured one.
_STAND_IN = 200
# Times that the small fields are measured for what is stored.
_PASSES = 3
# Kernels of the large set of 3D Gaussians.
_COPIED = 3_000_000


def _engine(options: Options) -> tuple[str, Field]:
    try:
        return "engine, 256 x 256 x 128", measured(options, "engine_256")
    except FileNotFoundError:
        made = datasets.noisy_ball(options.edge(_STAND_IN))
        return f"noisy ball, {made.shape[0]}^3 (engine is not in the data folder)", made.field()


def _signal(options: Options) -> tuple[str, Field]:
    edge = options.edge(128)
    return f"Marschner-Lobb, {edge}^3", datasets.marschner_lobb(edge).field()


def _tubes(options: Options) -> tuple[str, Field]:
    edge = options.edge(128)
    return f"thin tubes, {edge}^3", datasets.tubes(edge).field()


def _spheres(options: Options) -> tuple[str, Field]:
    count = options.count(100_000)
    return f"{count:,} spheres", spheres(count, options.edge(128))


def _ellipsoids(options: Options) -> tuple[str, Field]:
    count = options.count(35_000)
    return f"{count:,} ellipsoids to 1:20", ellipsoids(count, options.edge(128))


def _combustor(options: Options) -> tuple[str, Field]:
    field = ss.open(data_file(options, "combq.bin.gz"), grid=data_file(options, "combxyz.bin.gz"))
    return f"combustor, {field.size:,} kernels", field


def _galaxy(options: Options) -> tuple[str, Field]:
    field = ss.open(data_file(options, "sph_gas_nchilada12M.h5"))
    return f"SPH galaxy, {field.size:,} kernels", field


def _gaussians(options: Options) -> tuple[str, Field]:
    one = ss.open(data_file(options, "3dgs_guitar.ply.gz"))
    assert isinstance(one, ss.EllipsoidField)
    return copied(one, round(_COPIED * options.scale))


def copied(field: ss.EllipsoidField, least: int) -> tuple[str, Field]:
    """Return copies of a field side by side, with at least so many kernels together, and what they are."""
    copies = -(-least // field.size)
    side = int(np.ceil(copies ** (1.0 / 3.0)))
    lower, upper = (np.array(corner) for corner in field.centre_bounds)
    places = np.array([(n % side, n // side % side, n // side**2) for n in range(copies)], np.float64)
    moves = places * (upper - lower)

    def repeated(values: Any) -> Any:
        return None if values is None else np.concatenate([np.asarray(values)] * copies)

    normalization: Any = field.normalization

    made = ss.EllipsoidField(
        (moves[:, None, :] + np.asarray(field.centers)[None]).reshape(-1, 3),
        repeated(field.scales),
        repeated(field.rotations),
        repeated(field.values),
        weights=repeated(field.weights),
        normalization=normalization,
        falloff=field.falloff,
        w0=field.w0,
    )
    return f"{copies} guitars, {made.size:,} kernels", made


#: The fields, by the names of their rows.
FIELDS: Mapping[str, Callable[[Options], tuple[str, Field]]] = {
    "engine": _engine,
    "marschner-lobb": _signal,
    "spheres": _spheres,
    "ellipsoids": _ellipsoids,
    "tubes": _tubes,
}
#: Larger scattered fields, which are drawn where their names or "scattered" are asked for.
SCATTERED: Mapping[str, Callable[[Options], tuple[str, Field]]] = {
    "combustor": _combustor,
    "galaxy": _galaxy,
    "gaussians": _gaussians,
}

#: Fields and effects that can be measured alone; "single": no pairs; "small": two small fields, "store": for later runs
#: to compare with.
ROWS = (*FIELDS, "scattered", *SCATTERED, "single", *EFFECTS, "small", "store")


def subject_of(options: Options, name: str) -> Subject:
    """Return a field with its look. FileNotFoundError where it is missing."""
    title, field = {**FIELDS, **SCATTERED}[name](options)
    return Subject(name, title, compose_scene([field]))


def _wanted(options: Options) -> tuple[list[str], list[str]]:
    """Return the names of the fields and effects that are measured."""
    asked = set(options.rows) | (set(SCATTERED) if "scattered" in options.rows else set())
    fields = [name for name in (*FIELDS, *SCATTERED) if name in asked] or list(FIELDS)
    return fields, [name for name in EFFECTS if name in asked] or list(EFFECTS)


def _rows(options: Options) -> tuple[list[Row], list[str]]:
    """Return the rows of the fields and effects that are wanted, and what the fields are."""
    fields, names = _wanted(options)
    conditions = Conditions(options.backend, options.size, min(VIEWS, options.views), tell=options.say)
    rows: list[Row] = []
    titles: list[str] = []
    for name in fields:
        options.say(name)
        try:
            subject = subject_of(options, name)
        except FileNotFoundError as error:
            rows.append({"field": name, "row": "all", "remark": f"skipped: {error}"})
            continue
        titles.append(f"{name}: {subject.title}, slices {subject.base.slice_spacing:.3g} apart")
        paired = name in FIELDS and "single" not in options.rows
        rows += surface(subject, names, conditions, names if paired else [])
    return rows, titles


def _small_rows(options: Options, *, store: bool) -> tuple[list[Row], list[str]]:
    """Return the rows of the small fields, beside the stored ratios or to store them."""
    rows: list[Row] = []
    passes = _PASSES if store else 1
    found: dict[str, list[cliffs_small.Ratios]] = {}
    for name in cliffs_small.FIELDS:
        subject = cliffs_small.subject_of(name)
        several = [cliffs_small.measured(subject, options.say) for _ in range(passes)]
        found[name] = [cliffs_small.ratios(those) for those in several]
        rows += several[-1]
    if store:
        cliffs_small.store({name: cliffs_small.medians(those) for name, those in found.items()})
        return rows, [f"The medians of {passes} passes are stored in {cliffs_small.STORED.name}."]
    stored = cliffs_small.stored_ratios()
    for row in rows:
        known = stored.get(row["field"], {}).get(row["row"])
        if known is not None:
            row["stored"], row["stored_first"] = known
    return rows, [f"Small fields, at {cliffs_small.SIZE[0]}x{cliffs_small.SIZE[1]}, by one thread."]


def steepest(rows: Sequence[Row], count: int = _LISTED) -> list[str]:
    """Return, in words, the rows that are farthest above what was to be expected of them."""
    found = sorted((row for row in rows if "over" in row), key=lambda row: -float(row["over"]))
    return [
        f"{row['row']} on {row['field']}: {row['ratio']:.2f} plain frames (first {row['first_ratio']:.1f}), "
        f"{row['over']:.2f} times what "
        + ("is wanted" if len(row["effects"]) == 1 else f"its parts give, {row['expected']:.2f}")
        for row in found[:count]
    ]


def run(options: Options) -> Report:
    """Measure the fields and effects that are wanted."""
    options = options.preferring("cpu")
    small = [name for name in ("small", "store") if name in options.rows]
    rows, titles = _small_rows(options, store="store" in small) if small else _rows(options)
    listed = steepest(rows)
    return Report(
        name="cliffs",
        title=f"Effects over the plain lit composite, backend {options.backend}, {options.size[0]}x{options.size[1]}",
        columns=columns(
            "field, row=effect, ratio, first_ratio=first frame, expected=at most, expected_first=first at most, "
            "over=over that, wall_ratio=elapsed, ms=cpu ms, plain_ms=plain cpu ms, frames, slices, precision, stored, "
            "stored_first=stored first, remark"
        ),
        rows=rows,
        notes=[
            *titles,
            "ratio: least processor time of up to five frames, each from another direction, over the least of the "
            "plain lit composite with the same slices; both are drawn in turn by renderers of their own. first frame: "
            "the first one with the effect, by a renderer that has drawn the plain scene, over the plain frame. "
            "elapsed: the ratio of elapsed times.",
            "at most: for one effect, what is aimed at; for two, the product of what each takes alone, at least 1.",
            *(f"steepest, {n}: {text}" for n, text in enumerate(listed, 1)),
        ],
        environment=environment(device_of(renderer_for(options))),
    )

"""What effects cost: each one and each pair of them over the plain lit composite of the same field."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

import sheetsplat as ss
from bench.effect_costs import EFFECTS, VIEWS, Conditions, Subject, judged, measure, pairs, quiet
from bench.measure import attempt, data_file, device_of, renderer_for
from bench.quality import measured
from bench.report import Options, Report, Row, columns, environment
from bench.scenes import ellipsoids, spheres
from sheetsplat import datasets
from sheetsplat.look.compose import compose_scene

# Seconds after which no further view of an effect, or of a pair, is timed.
_LONGEST, _LONGEST_OF_PAIR = 6.0, 0.8
_VIEWS_OF_PAIR = 2
# How many of the steepest are listed.
_LISTED = 10
# Edge of the generated volume that stands in for the measured one.
_STAND_IN = 200
# Kernels of the large set of 3D Gaussians.
_COPIED = 3_000_000


def _engine(options: Options) -> tuple[str, ss.Field]:
    try:
        return "engine, 256 x 256 x 128", measured(options, "engine_256")
    except FileNotFoundError:
        made = datasets.noisy_ball(options.edge(_STAND_IN))
        return f"noisy ball, {made.shape[0]}^3 (engine is not in the data folder)", made.field()


def _signal(options: Options) -> tuple[str, ss.Field]:
    edge = options.edge(128)
    return f"Marschner-Lobb, {edge}^3", datasets.marschner_lobb(edge).field()


def _tubes(options: Options) -> tuple[str, ss.Field]:
    edge = options.edge(128)
    return f"thin tubes, {edge}^3", datasets.tubes(edge).field()


def _spheres(options: Options) -> tuple[str, ss.Field]:
    count = options.count(100_000)
    return f"{count:,} spheres", spheres(count, options.edge(128))


def _ellipsoids(options: Options) -> tuple[str, ss.Field]:
    count = options.count(35_000)
    return f"{count:,} ellipsoids to 1:20", ellipsoids(count, options.edge(128))


def _combustor(options: Options) -> tuple[str, ss.Field]:
    field = ss.open(data_file(options, "combq.bin.gz"), grid=data_file(options, "combxyz.bin.gz"))
    return f"combustor, {field.size:,} kernels", field


def _galaxy(options: Options) -> tuple[str, ss.Field]:
    field = ss.open(data_file(options, "sph_gas_nchilada12M.h5"))
    return f"SPH galaxy, {field.size:,} kernels", field


def _gaussians(options: Options) -> tuple[str, ss.Field]:
    one = ss.open(data_file(options, "3dgs_guitar.ply.gz"))
    assert isinstance(one, ss.EllipsoidField)
    return copied(one, round(_COPIED * options.scale))


def copied(field: ss.EllipsoidField, least: int) -> tuple[str, ss.Field]:
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
FIELDS: Mapping[str, Callable[[Options], tuple[str, ss.Field]]] = {
    "engine": _engine,
    "marschner-lobb": _signal,
    "spheres": _spheres,
    "ellipsoids": _ellipsoids,
    "tubes": _tubes,
}
#: Larger scattered fields, which are drawn where their names or "scattered" are asked for.
SCATTERED: Mapping[str, Callable[[Options], tuple[str, ss.Field]]] = {
    "combustor": _combustor,
    "galaxy": _galaxy,
    "gaussians": _gaussians,
}

#: Fields and effects that can be measured alone; "single": no pairs.
ROWS = (*FIELDS, "scattered", *SCATTERED, "single", *EFFECTS)


def subject_of(options: Options, name: str) -> Subject:
    """Return a field with its look. FileNotFoundError where it is missing."""
    title, field = {**FIELDS, **SCATTERED}[name](options)
    return Subject(name, title, compose_scene([field]))


def _wanted(options: Options) -> tuple[list[str], list[str]]:
    """Return the names of the fields and effects that are measured."""
    asked = set(options.rows) | (set(SCATTERED) if "scattered" in options.rows else set())
    fields = [name for name in (*FIELDS, *SCATTERED) if name in asked] or list(FIELDS)
    return fields, [name for name in EFFECTS if name in asked] or list(EFFECTS)


def surface(subject: Subject, names: Sequence[str], options: Options, *, paired: bool) -> list[Row]:
    """Time effects on a field, and then pairs of them."""
    conditions = Conditions(options.backend, options.size)
    plain = conditions.renderer()
    plain.render(subject.base, subject.camera(VIEWS), size=options.size)
    alone: dict[str, float] = {}
    rows: list[Row] = []

    def timed(names: tuple[str, ...], frames: int, seconds: float) -> Row:
        options.say(f"{subject.name}: {', '.join(names)}")
        run = partial(measure, subject, names, conditions, plain, frames=min(frames, options.views), seconds=seconds)
        return {"field": subject.name, "row": " + ".join(names), "effects": list(names)} | attempt(
            lambda: judged(quiet(run), names, alone)
        )

    for name in names:
        rows.append(timed((name,), VIEWS, _LONGEST))
        if "ratio" in rows[-1]:
            alone[name] = rows[-1]["ratio"]
    for both in pairs(subject, [name for name in names if name in alone]) if paired else ():
        rows.append(timed(both, _VIEWS_OF_PAIR, _LONGEST_OF_PAIR))
    return rows


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
    fields, names = _wanted(options)
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
        rows += surface(subject, names, options, paired="single" not in options.rows and name in FIELDS)
    listed = steepest(rows)
    return Report(
        name="cliffs",
        title=f"Effects over the plain lit composite, backend {options.backend}, {options.size[0]}x{options.size[1]}",
        columns=columns(
            "field, row=effect, ratio, first_ratio=first frame, expected=at most, expected_first=first at most, "
            "over=over that, wall_ratio=elapsed, ms=cpu ms, plain_ms=plain cpu ms, frames, slices, precision, remark"
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

"""The reference against the oracle: bases, mirrored samples, where fields end, holes, scalar pictures."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import oracle
import oracle.picture
import oracle.samples
import pytest
import scene_parts
from random_scenes import random_ellipsoids, random_lattice, random_lattice_transfer, random_light
from scene_parts import GENTLE, OPAQUE, lift, pick, random_camera
from test_oracle import build_effects, expected, make_wrong, reference_excess, share_seen, with_effects

import sheetsplat as ss

SEEDS = range(120)
MODES = ("composite", "isosurface", "mip", "composite", "xray", "isosurface", "minimum", "composite", "average")


def lattice_that_ends(rng: np.random.Generator, like: dict[str, Any] | None) -> dict[str, Any]:
    """Return the arguments of a lattice in the cube of edge 2 round 0, now and then where another one is."""
    field = random_lattice(rng)
    count = max(field["values"].shape)
    field["spacing"] = tuple((np.array(field["spacing"]) / max(field["spacing"]) * 2 / count).tolist())
    field["origin"] = tuple(rng.uniform(-1, -0.7, 3).tolist())
    field["boundary"] = pick(rng, "edge", "edge", "edge", "zero")
    if rng.random() < 0.15:
        # A single layer, which is repeated.
        field["values"] = field["values"][:1, :, :: pick(rng, 1, 1, 99)]
        if np.isnan(field["values"]).all():
            field["values"] = np.ones_like(field["values"])
    elif rng.random() < 0.25:
        field["values"], field["nan"] = field["values"].copy(), "skip"
        field["values"][np.random.default_rng(count).random(field["values"].shape) < 0.6] = np.nan
        field["values"].flat[-1] = 0.5
    if like is not None and rng.random() < 0.6:
        shape = like["values"].shape
        field |= {name: like[name] for name in ("lattice", "spacing", "origin", "boundary")}
        field["values"] = rng.random(shape)
        field.pop("nan", None)
    if rng.random() < 0.3:
        field["base"] = float(rng.uniform(-1, 1))
    return field


def ends_scene(seed: int) -> dict[str, Any]:
    """Return the parts of a scene; modes are counted through, the rest is drawn."""
    rng = np.random.default_rng([14, seed])
    fields = [lattice_that_ends(rng, None)]
    for _ in range(pick(rng, 0, 0, 1, 1, 2)):
        if rng.random() < 0.7:
            fields.append(lattice_that_ends(rng, fields[0]))
        else:
            fields.append(random_ellipsoids(rng) | ({"base": float(rng.uniform(-1, 1))} if rng.random() < 0.5 else {}))
    cuts = np.flatnonzero(rng.random(len(fields) - 1) < 0.5) + 1
    groups = [part.tolist() for part in np.split(np.arange(len(fields)), cuts)]
    mode = MODES[seed % len(MODES)]
    scene: dict[str, Any] = {
        "mode": mode,
        "sampling": ("point", "slab")[seed // len(MODES) % 2],
        "opacity_stop": float(pick(rng, 0.98, 1.0, rng.uniform(0.3, 1))),
        "preintegration": mode == "composite" and bool(rng.random() < 0.4),
        "slice_spacing": float(2 / rng.uniform(3, 16)),
        "reference_length": float(rng.uniform(0.1, 0.6)),
    }
    if rng.random() < 0.2:
        scene["filter"] = "ewa"
    if mode == "isosurface":
        scene["iso_value"] = [(float(v), float(rng.random())) for v in rng.uniform(0.05, 0.9, rng.integers(1, 4))]
    parts = {
        "fields": fields,
        "groups": groups,
        "transfer": [random_lattice_transfer(rng) for _ in groups],
        "scene": scene,
        **random_light(rng),
        "camera": random_camera(rng, 2.0),
        "size": tuple(int(n) for n in rng.integers(4, 16, 2)),
    }
    with_effects(parts, seed)
    if scene["preintegration"] and len(groups) > 1:
        scene["preintegration"] = True
    if rng.random() < 0.4:
        # Sums of the normalization `none` stay counted from 0.
        by = float(pick(rng, 7.0, -300.0, 5000.0))
        lift(parts, by, lambda field: "centers" in field or field["boundary"] == "zero")
    return parts


@pytest.mark.parametrize("seed", SEEDS)
def test_reference_is_the_oracle_of_ends(seed: int, reference_renderer: ss.Renderer) -> None:
    assert reference_excess(ends_scene(seed), reference_renderer, build_effects) <= 1


def test_random_ends_show_something(reference_renderer: ss.Renderer) -> None:
    parts = [ends_scene(seed) for seed in SEEDS]
    assert share_seen(parts, reference_renderer) > 0.6
    built = [build_effects(oracle, one)[0] for one in parts]
    groups = [fields for scene in built for fields, _ in scene.groups()]
    assert sum(len(fields) > 1 and fields[0].domain() is not None for fields in groups) >= 5
    assert sum(any(f.least_weight() > 0 for f in fields) for fields in groups) >= 10
    ended = [[fields[0].domain() for fields, _ in scene.groups()] for scene in built]
    assert sum(len({str(domain) for domain in domains}) > 1 for domains in ended) >= 5
    pictures = [oracle.render(*build_effects(oracle, one)) for one in parts if one["scene"]["mode"] == "mip"]
    assert sum(bool(np.isnan(expected(picture)).any()) for picture in pictures) >= 3


def telling_scene(**options: Any) -> dict[str, Any]:
    """Return a lit volume seen from within its domain's edges."""
    rng = np.random.default_rng(3)
    values = 4 + rng.random((6, 6, 6))
    field = {"values": values, "spacing": (0.4, 0.38, 0.35), "origin": (-1.0, -0.9, -1.0), "boundary": "edge"}
    transfer = [(point[0] + 4, *point[1:]) for point in GENTLE]
    return scene_parts.parts([field | options.pop("field", {})], transfer=transfer, size=(14, 12), **options)


def holey() -> dict[str, Any]:
    """Return options of a field in which a block is missing."""
    values = 4 + np.random.default_rng(4).random((8, 8, 8))
    values[2:6, 2:6, 2:6] = np.nan
    return {"values": values, "nan": "skip", "spacing": (0.28, 0.28, 0.28)}


def counted_from_nothing(original: Callable[..., Any]) -> Callable[..., Any]:
    """Return bases of 0."""
    return lambda self: 0.0


def repeated(original: Callable[..., Any]) -> Callable[..., Any]:
    """Return samples mirrored half a layer farther out."""

    def kernels(self: Any, *, mirrored: bool = True) -> Any:
        pad = np.pad
        try:
            np.pad = lambda grid, width, mode: pad(grid, width, mode="symmetric")  # type: ignore[assignment]
            return original(self, mirrored=mirrored)
        finally:
            np.pad = pad

    return kernels


def wider(original: Callable[..., Any]) -> Callable[..., Any]:
    """Return domains that are a tenth wider."""

    def domain(self: Any) -> Any:
        found = original(self)
        return found and (found[0] - 0.02, found[1] + 0.02)

    return domain


def without_end(original: Callable[..., Any]) -> Callable[..., Any]:
    """Return no domain."""
    return lambda self: None


def nothing_is_empty(original: Callable[..., Any]) -> Callable[..., Any]:
    """Return half of the least weight."""
    return lambda self: original(self) / 2


def of_the_window_alone(original: Callable[..., Any]) -> Callable[..., Any]:
    """Return g0 of transfer functions alone."""
    return lambda self: [1e-3 * tf.span() / self.length() for _, tf in self.groups()]


def zero_where_nothing_is(original: Callable[..., Any]) -> Callable[..., Any]:
    """Return scalar pictures that are 0 where no slice counts."""
    return lambda *arguments: np.nan_to_num(original(*arguments))


# The owner, the name of what is wrong there, the wrong one, and the scene that shows it.
WRONG: dict[str, tuple[Any, str, Callable[..., Any], dict[str, Any]]] = {
    "base": (oracle.RegularField, "counted_from", counted_from_nothing, {}),
    "mirror": (oracle.RegularField, "kernels", repeated, {}),
    "domain": (oracle.RegularField, "domain", wider, {}),
    "no domain": (oracle.RegularField, "domain", without_end, {"preintegration": True}),
    "surfaces": (oracle.RegularField, "domain", without_end, {"mode": "isosurface", "iso_value": [(4.1, 0.5)]}),
    "shadows": (oracle.Scene, "bases", lambda original: lambda self: [0.0], {"shadows": True}),
    "holes": (oracle.RegularField, "least_weight", nothing_is_empty, {"field": holey()}),
    "weak": (oracle.Scene, "weakest", of_the_window_alone, {}),
    "numbers": (oracle.picture, "_scalar", zero_where_nothing_is, {"mode": "mip"}),
}


@pytest.mark.parametrize("formula", WRONG)
def test_a_wrong_end_is_seen(formula: str, monkeypatch: pytest.MonkeyPatch, reference_renderer: ss.Renderer) -> None:
    owner, name, wrong, options = WRONG[formula]
    parts = telling_scene(**options)
    if formula == "weak":
        # A window of one value, and nearly no gradient but in a corner.
        parts["transfer"] = [(4.5, 1.0, 0.8, 0.5, 0.3)]
        parts["fields"][0]["values"] = 4 + 1e-8 * np.random.default_rng(3).random((6, 6, 6))
        parts["fields"][0]["values"][0, 0, 0] = 5
        parts["fields"][0]["base"] = 4.0
    assert reference_excess(parts, reference_renderer, build_effects) <= 1
    make_wrong(monkeypatch, owner, name, wrong)
    assert reference_excess(parts, reference_renderer, build_effects) > 1000


@pytest.mark.parametrize("mode", ["composite", "isosurface", "mip", "average", "xray"])
@pytest.mark.parametrize("lattice", ["cartesian", "bcc"])
def test_a_constant_field_is_constant_to_its_end(mode: str, lattice: str, reference_renderer: ss.Renderer) -> None:
    field = {"values": np.full((6, 6, 6), 7.25), "lattice": lattice, "spacing": (0.4, 0.4, 0.4), "origin": (-1, -1, -1)}
    function = [(point[0] + 7, *point[1:]) for point in OPAQUE]
    built = scene_parts.parts([field | {"boundary": "edge"}], transfer=function, lit=False, mode=mode, size=(20, 20))
    if mode == "isosurface":
        built["scene"]["iso_value"] = [(7.0, 0.5)]
    scene, camera, size = build_effects(ss, built)
    pixels = np.asarray(reference_renderer.render(scene, camera, size=size).pixels, float)
    if mode == "isosurface":
        assert not pixels.any()
    elif mode == "composite":
        # One colour, whatever its opacity.
        shown = pixels[pixels[..., 3] > 0]
        colour = shown[:, :3] / shown[:, 3:]
        assert len(shown) > 50
        assert np.abs(colour - colour[0]).max() < 1e-6
    elif mode == "xray":
        slices = pixels[pixels > 0] / (7.25 / 12)
        assert slices.size > 50 and np.abs(slices - np.round(slices)).max() < 1e-5
    else:
        assert np.isnan(pixels).any()
        assert np.nanmax(np.abs(pixels - 7.25)) < 1e-6
    # It falls to 0 without mirrored samples.
    built["fields"][0]["boundary"] = "zero"
    scene, camera, size = build_effects(ss, built)
    other = np.asarray(reference_renderer.render(scene, camera, size=size).pixels, float)
    assert not np.allclose(np.nan_to_num(other), np.nan_to_num(pixels), atol=1e-2)

"""Effects beyond the papers in pictures of the reference, each against a closed form (conventions, section 10)."""

from __future__ import annotations

import math

import numpy as np
import pytest

import sheetsplat as ss

# Half a rounding of a float32 picture, and the float64 sums before it.
ROUNDING = 2e-7
WHITE = [(0.0, 1.0, 1.0, 1.0, 0.0), (1.0, 1.0, 1.0, 1.0, 1.0)]


def kernel(r2: float, k: float) -> float:
    """Return g of a squared radius."""
    return (math.exp(-k * r2) - math.exp(-k)) / (1 - math.exp(-k))


def front(height: float, at: tuple[float, float] = (0.0, 0.0)) -> ss.Camera:
    """Return a camera that looks along -z at (x, y) from a distance of 20."""
    return ss.Camera.orthographic((*at, 20.0), (*at, 0.0), height=height)


@pytest.mark.parametrize("normalization", ["none", "threshold", "lattice"])
def test_the_analytic_gradient_of_one_kernel(normalization: str, reference_renderer: ss.Renderer) -> None:
    """One slice of one ellipsoid: the normal is that of its Gaussian, whatever a pixel's width."""
    axes, k, at = np.array([1.1, 0.8, 0.9]), 8.0, np.array([0.21, -0.17, 0.4])
    field = ss.EllipsoidField([(0.0, 0.0, 0.0)], [axes], values=[0.7], normalization=normalization, w0=0.2, falloff=k,
                              cell_volume=1.0 if normalization == "lattice" else None)  # fmt: skip
    towards = np.array([0.3, 0.5, 0.8])

    def colour(gradient: str, height: float) -> np.ndarray:
        scene = ss.Scene(
            field,
            [(0.0, 0.5, 0.7, 0.9, 0.1), (1.0, 0.5, 0.7, 0.9, 0.1)],
            # Slices at 0.4 and -0.4; one is cut off.
            slice_spacing=0.8,
            reference_length=0.8,
            clip=ss.Clip(planes=[((0, 0, 1), 0.0)]),
            gradient=gradient,
            lights=[ss.Light(towards)],
            material=ss.Material(ambient=0.2, diffuse=0.6, specular=0.0),
        )
        image = reference_renderer.render(scene, front(height, tuple(at[:2])), size=(1, 1))
        return np.asarray(image.rgba[0, 0], float)

    inward = -at / axes**2
    normal = -inward / np.linalg.norm(inward)
    wanted = np.array([0.5, 0.7, 0.9]) * (0.2 + 0.6 * max(0.0, normal @ towards / np.linalg.norm(towards)))
    for height in (0.01, 0.4):
        found = colour("analytic", height)
        assert found[3] == pytest.approx(0.1, rel=ROUNDING)
        np.testing.assert_allclose(found[:3] / found[3], wanted, rtol=1e-6)
    # Differences over two slices of which one does not exist, and over wide pixels, are something else.
    found = colour("sheets", 0.4)
    assert np.abs(found[:3] / found[3] - wanted).max() > 1e-2


def test_clipping_through_the_middle_halves_an_xray(reference_renderer: ss.Renderer) -> None:
    field = ss.EllipsoidField([(0.0, 0.0, 0.0)], [1.0], values=[1.0], normalization="none")
    size, camera = (9, 7), front(1.2)

    def xray(**options: object) -> np.ndarray:
        scene = ss.Scene(field, WHITE, mode="xray", sampling="slab", slice_spacing=0.05, **options)
        return np.asarray(reference_renderer.render(scene, camera, size=size).scalar, float)

    whole = xray()
    assert whole.min() > 1e-3
    np.testing.assert_allclose(xray(clip=ss.Clip(planes=[((0, 0, 3), 0)])), whole / 2, rtol=ROUNDING)
    np.testing.assert_allclose(xray(clip=ss.Clip(box=((-9, -9, -9), (9, 9, 0)))), whole / 2, rtol=ROUNDING)
    assert np.abs(xray(clip=ss.Clip(planes=[((0, 0, 1), 0.051)])) / whole - 0.5).max() > 0.02
    left = xray(clip=ss.Clip(planes=[((-1, 0, 0), 0.0)]))
    np.testing.assert_allclose(left[:, :4], whole[:, :4], rtol=ROUNDING)
    # The middle of the middle column is on the plane, and kept.
    np.testing.assert_allclose(left[:, 4], whole[:, 4], rtol=ROUNDING)
    assert not left[:, 5:].any()


def test_gradient_opacity_of_a_ramp(reference_renderer: ss.Renderer) -> None:
    """A scalar that rises by 0.3 along x: opacity is multiplied by 0.3 over the gradient given."""
    samples = np.broadcast_to(0.3 * np.arange(21.0), (9, 9, 21))
    field = ss.RegularField(samples, origin=(-10, -4, -4), normalization="threshold", w0=1e-6, radius=3, falloff=8)
    flat = [(0.0, 0.2, 0.4, 0.8, 0.3), (6.0, 0.2, 0.4, 0.8, 0.3)]

    def opacity(g1: float, **options: object) -> float:
        box = ss.Clip(box=((-1, -1, -0.6), (1, 1, 0.6)))
        scene = ss.Scene(field, flat, clip=box, gradient_opacity=g1, opacity_stop=1.0, **options)
        return float(reference_renderer.render(scene, front(1.0), size=(1, 1)).rgba[0, 0, 3])

    # Two slices, half a unit before and behind the middle.
    for gradient in ("sheets", "analytic"):
        wanted = 1 - (1 - 0.3 * 0.3 / 0.5) ** 2
        assert opacity(0.5, gradient=gradient) == pytest.approx(wanted, abs=2e-3)
        assert opacity(0.25, gradient=gradient) == pytest.approx(1 - 0.7**2, rel=ROUNDING)
        assert abs(opacity(0.55, gradient=gradient) - wanted) > 1e-2


@pytest.mark.parametrize("boundary", ["edge", "zero"])
def test_depth_cue_of_a_flat_surface(boundary: str, reference_renderer: ss.Renderer) -> None:
    """Every pixel sees the front of a block, whose depth is asked for beside it."""
    if boundary == "zero":
        field = ss.RegularField(np.ones((7, 15, 15)), origin=(-7, -7, -3), normalization="threshold", boundary="zero")
    else:
        # A volume that ends has no front of its own: nothing crosses an end.
        samples = np.zeros((13, 15, 15))
        samples[3:10] = 1
        field = ss.RegularField(samples, origin=(-7, -7, -6), normalization="threshold")
    colour, cue = np.array([0.9, 0.5, 0.2]), np.array([0.1, 0.3, 0.8])

    def shown(**options: object) -> tuple[np.ndarray, float]:
        scene = ss.Scene(field, [(0.0, *colour, 1.0), (1.0, *colour, 1.0)], mode="isosurface", iso_value=0.4, **options)
        image = reference_renderer.render(scene, front(2.0), size=(1, 1), outputs=("depth",))
        return np.asarray(image.rgba[0, 0, :3], float), float(image.depth[0, 0])

    plain, depth = shown()
    np.testing.assert_allclose(plain, colour, rtol=ROUNDING)
    for start, end, strength, share in (
        (depth - 1, depth + 3, 0.8, 0.2),
        (depth - 3, depth - 1, 0.8, 0.8),
        (depth + 1, depth + 3, 0.8, 0.0),
    ):
        found, _ = shown(depth_cue=ss.DepthCue(start, end, tuple(cue), strength))
        np.testing.assert_allclose(found, colour + share * (cue - colour), atol=1e-6)
    moved, _ = shown(depth_cue=ss.DepthCue(depth - 1.01, depth + 3, tuple(cue), 0.8))
    assert np.abs(moved - (colour + 0.2 * (cue - colour))).max() > 1e-4


def block(**options: object) -> ss.Scene:
    """Return a block of constant opacity, 0.2 per unit, supports from -8 to 8; one slice at z = 7.75 is kept."""
    field = ss.RegularField(np.ones((13, 13, 13)), origin=(-6, -6, -6), normalization="threshold")
    return ss.Scene(
        field,
        [(0.0, 1.0, 0.5, 0.25, 0.2), (1.0, 1.0, 0.5, 0.25, 0.2)],
        slice_spacing=0.5,
        reference_length=1.0,
        opacity_stop=1.0,
        **options,
    )


def test_ambient_occlusion_under_a_face(reference_renderer: ss.Renderer) -> None:
    """Just below a face all is free along five directions of 14; deep inside along none."""
    camera, strength = front(0.2), 0.6
    for radius, steps in ((0.5, 1), (1.5, 3), (1.49, 2)):
        taken = strength * (1 - 0.8 ** (0.5 * steps))
        for offset, share in ((7.75, 9 / 14), (0.25, 1.0)):
            # What lies in front is seen from inside: the camera's rays begin anywhere, the slice alone is shown.
            scene = block(ambient_occlusion=ss.AmbientOcclusion(radius, strength))
            picture = reference_renderer.render(scene, camera, size=(1, 1)).rgba[0, 0]
            assert picture[3] > 0.9
            one = block(
                ambient_occlusion=ss.AmbientOcclusion(radius, strength),
                clip=ss.Clip(planes=[((0, 0, -1), -offset - 0.01)]),
                mode="composite",
            )
            # Cut off in front, the first slice that is left is like the one under the face.
            first = reference_renderer.render(one.replace(opacity_stop=1e-6), camera, size=(1, 1)).rgba[0, 0]
            wanted = 1 - taken * 9 / 14
            np.testing.assert_allclose(first[:3] / first[3], wanted * np.array([1.0, 0.5, 0.25]), rtol=1e-6)
            if share == 1.0:
                uncut = reference_renderer.render(
                    block(ambient_occlusion=ss.AmbientOcclusion(radius, strength)),
                    ss.Camera.perspective((0, 0, 0.5), (0, 0, 0), fov_y=1.0, near=0.2),
                    size=(1, 1),
                ).rgba[0, 0]
                # Through the whole block, all but the last slices are deep inside.
                assert uncut[0] / uncut[3] == pytest.approx(1 - taken, abs=0.1 * taken)
                assert abs(uncut[0] / uncut[3] - wanted) > 0.1 * taken


def beside(value: float, normalization: str = "threshold") -> ss.RegularField:
    """Return a block of one value, supports from x = 4 to 10 along the axis through its samples."""
    return ss.RegularField(np.full((9, 9, 3), value), origin=(6, -4, -4), normalization=normalization, w0=1e-9)


def test_a_block_casts_its_shadow_on_a_plane(reference_renderer: ss.Renderer) -> None:
    """Light comes along x through a block beside the view, to a slice of another kernel: steps through it count."""
    k, spacing, at = 0.1, 0.8, (0.21, -0.17)
    plane = ss.EllipsoidField([(0.0, 0.0, 0.0)], [(1.1, 0.8, 0.9)], values=[0.7], normalization="none")

    def light(*fields: ss.Field, **options: object) -> float:
        # Slices at 0.4 and -0.4; one is cut off.
        planes = [((0, 0, 1), 0.0), *options.pop("planes", ())]  # type: ignore[misc]
        scene = ss.Scene(
            fields,
            [(0.0, 1, 1, 1, k), (1.0, 1, 1, 1, k)],
            slice_spacing=spacing,
            reference_length=1.0,
            clip=ss.Clip(planes=planes),
            gradient="analytic",
            lights=[ss.Light((1, 0, 0), space="world")],
            material=ss.Material(ambient=0, diffuse=1),
            opacity_stop=1e-9,
            **options,
        )
        return float(reference_renderer.render(scene, front(0.01, at), size=(1, 1)).rgba[0, 0, 0])

    def steps(first: float, last: float) -> int:
        return sum(first < at[0] + m * spacing < last for m in range(1, 40))

    block = beside(1e-3)
    free = light(plane, block)
    assert free > 1e-3
    # The kernel itself ends within a step.
    assert light(plane, shadows=True) == pytest.approx(free, rel=1e-6)
    left = (1 - k) ** spacing
    assert light(plane, block, shadows=True) == pytest.approx(free * left ** steps(4, 10), rel=1e-6)
    cut = {"planes": [((-1, 0, 0), -7.0)], "shadows": True}
    assert light(plane, block, **cut) == pytest.approx(free * left ** steps(4, 7), rel=1e-6)
    assert steps(4, 7) < steps(4, 10) and left ** steps(4, 7) < 0.8, "light that is not dimmed would be seen"


def test_a_block_of_surfaces_casts_their_shadow_on_a_surface(reference_renderer: ss.Renderer) -> None:
    """Light comes along x through the front and the back of a block: each takes its opacity, whatever is between."""
    plane = ss.EllipsoidField([(0.0, 0.0, 0.0)], [1.0], values=[1.0], normalization="none")
    spacing = 0.02

    def light(*fields: ss.Field, values: object = ((0.3, 0.4),), **options: object) -> float:
        scene = ss.Scene(
            fields,
            WHITE,
            mode="isosurface",
            iso_value=values,
            slice_spacing=spacing,
            reference_length=1.0,
            lights=[ss.Light((1, 0, 0), space="world")],
            material=ss.Material(ambient=0, diffuse=1),
            gradient="analytic",
            opacity_stop=0.1,  # the first crossing ends the pixel
            **options,
        )
        picture = reference_renderer.render(scene, front(0.01, (0.3, 0.0)), size=(1, 1)).rgba[0, 0]
        return float(picture[0] / picture[3])

    block = beside(1.0)
    free = light(plane, block)
    assert free > 0.2
    # The surface that is lit does not shade itself.
    assert light(plane, shadows=True) == pytest.approx(free, rel=1e-6)
    assert light(plane, block, shadows=True) == pytest.approx(free * 0.6**2, rel=1e-6)
    # A value that the block crosses and one that nothing crosses.
    two = ((0.3, 0.4), (0.6, 0.25), (1.5, 0.9))
    assert light(plane, block, values=two, shadows=True) == pytest.approx(free * (0.6 * 0.75) ** 2, rel=1e-6)
    # What is cut open has lost its back; what is cut off casts no shadow; neither does a block that is empty enough.
    open_block = ss.Clip(planes=[((-1, 0, 0), -7.0)])
    assert light(plane, block, shadows=True, clip=open_block) == pytest.approx(free * 0.6, rel=1e-6)
    nothing = ss.Clip(planes=[((-1, 0, 0), -3.5)])
    assert light(plane, block, shadows=True, clip=nothing) == pytest.approx(free, rel=1e-6)
    assert light(plane, beside(0.2), shadows=True) == pytest.approx(free, rel=1e-6)
    assert light(plane, block, values=((0.3, 1.0),), shadows=True) == 0.0


def test_lines_towards_lights_begin_a_slice_distance_away(reference_renderer: ss.Renderer) -> None:
    """A wall nearer than that casts no shadow, the same wall farther away does."""
    wall = ss.RegularField(np.ones((9, 9, 2)), origin=(2.4, -4, -4), spacing=(0.2, 1, 1), normalization="threshold")
    plane = ss.EllipsoidField([(0.0, 0.0, 0.0)], [(1.0, 8.0, 8.0)], values=[1.0], normalization="none")

    def light(spacing: float, shadows: bool) -> float:
        scene = ss.Scene(
            (plane, wall),
            WHITE,
            mode="isosurface",
            iso_value=((0.3, 0.5),),
            slice_spacing=spacing,
            lights=[ss.Light((1, 0, 0), space="world")],
            material=ss.Material(ambient=0, diffuse=1),
            gradient="analytic",
            opacity_stop=0.1,
            shadows=shadows,
        )
        picture = reference_renderer.render(scene, front(0.01, (0.3, 0.0)), size=(1, 1)).rgba[0, 0]
        return float(picture[0] / picture[3])

    assert light(0.05, True) == pytest.approx(light(0.05, False) * 0.25, rel=1e-6)
    # From 2 to 3.0, all between the surface and its first step.
    assert light(3.5, True) == pytest.approx(light(3.5, False), rel=1e-6)


def test_second_order_is_nearer_to_the_limit(reference_renderer: ss.Renderer) -> None:
    """Thin intervals of first order are the limit; second order is there with wide ones."""
    rng = np.random.default_rng(3)
    field = ss.EllipsoidField(rng.uniform(-1, 1, (12, 3)), rng.uniform(1.2, 2, 12), values=rng.uniform(0.1, 0.4, 12),
                              normalization="none", falloff=16)  # fmt: skip
    colours = [(0.0, 0.1, 0.3, 0.9, 0.0), (3.0, 1.0, 0.6, 0.1, 0.8)]

    def picture(spacing: float, order: object) -> np.ndarray:
        scene = ss.Scene(
            field, colours, slice_spacing=spacing, reference_length=0.5, opacity_stop=1.0, preintegration=order
        )
        return np.asarray(reference_renderer.render(scene, front(3.0), size=(8, 8)).rgba, float)

    limit = picture(0.005, True)
    first, second = (np.abs(picture(0.1, order) - limit).max() for order in (True, "second_order"))
    assert limit.max() > 0.2
    assert first > 5e-5
    assert second < first / 20


def test_shadows_without_lights_change_nothing(ball: np.ndarray, reference_renderer: ss.Renderer) -> None:
    size = (12, 10)
    plain = ss.render(ball, size=size, shading=False, renderer=reference_renderer)
    with pytest.warns(ss.PictureWarning, match="shadows"):
        same = ss.render(ball, size=size, shading=False, shadows=True, renderer=reference_renderer)
    assert np.array_equal(plain.rgba, same.rgba)


def test_an_automatic_depth_cue_spans_the_field(ball: np.ndarray, reference_renderer: ss.Renderer) -> None:
    options = {"size": (16, 14), "renderer": reference_renderer}
    plain, cued = (ss.render(ball, **options, **more).pixels for more in ({}, {"depth_cue": "auto"}))
    assert np.array_equal(plain[..., 3], cued[..., 3])
    assert 0.1 < cued[..., :3].sum() / plain[..., :3].sum() < 0.9
    with pytest.raises(ss.InvalidInput, match="depth_cue"):
        ss.render(ball, **options, depth_cue="far")


@pytest.mark.parametrize("gradient", ["sheets", "analytic"])
@pytest.mark.parametrize(("length", "value"), [(1e90, 1e-250), (1e-90, 1e250)], ids=["small", "large"])
def test_light_in_any_unit_of_length_and_value(
    length: float, value: float, gradient: str, ball: np.ndarray, reference_renderer: ss.Renderer
) -> None:
    """Gradients that leave double's range turn no normals: they are counted per reference length."""

    def picture(length: float, value: float) -> np.ndarray:
        field = ss.RegularField(
            value * ball[::4, ::4, ::4].astype(float), spacing=(length,) * 3, origin=(-4 * length,) * 3
        )
        scene = ss.Scene(
            field,
            [(value * v, *color) for v, *color in [(0.1, 0.2, 0.5, 0.9, 0.0), (1.0, 0.9, 0.5, 0.2, 0.6)]],
            lights=[ss.Light((0.3, 0.5, 0.8))],
            material=ss.Material(specular=0.3),
            gradient=gradient,  # type: ignore[arg-type]
            sampling="slab" if gradient == "analytic" else "point",
        )
        camera = ss.Camera.perspective((5 * length, 8 * length, 20 * length), (0.0, 0.0, 0.0), fov_y=30)
        return np.asarray(reference_renderer.render(scene, camera, size=(12, 10)).rgba)

    plain = picture(1.0, 1.0)
    assert plain[..., 3].max() > 0.2
    np.testing.assert_allclose(picture(length, value), plain, atol=1e-6)

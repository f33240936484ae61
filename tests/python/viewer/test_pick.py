"""What is seen at a pixel: against the depth of the reference, sums over all kernels, and closed forms."""

from __future__ import annotations

import numpy as np
import pytest

import sheetsplat as ss

RAMP = [(0, 0, 0, 1, 0), (1, 1, 1, 0, 0.5)]
THIN = [(0, 0, 0, 1, 0), (1, 1, 1, 0, 0.004)]
SIZE = (30, 24)


def kernels_of(field):
    """Return places (layers of samples along x, y, z) and values, counted from the base, of a volume's kernels."""
    bcc = field.lattice == "bcc"
    nk, nj, ni = field.shape
    counts = np.array([2 * ni, 2 * nj, nk] if bcc else [ni, nj, nk])
    more = 12 if field.boundary == "edge" else 0
    places = np.stack(np.meshgrid(*(np.arange(-more, n + more) for n in counts), indexing="ij"), -1).reshape(-1, 3)
    if bcc:
        places = places[(places % 2 == places[:, :1] % 2).all(axis=1)]
    own = places
    if more:
        # Mirrored in the first and the last layer.
        period = np.maximum(2 * (counts - 1), 1)
        own = np.abs((places + counts - 1) % period - (counts - 1))
        radius = field.radius * (np.sqrt(2) if bcc else 1)
        beyond = np.maximum(0, np.maximum(-0.5 - places, places - (counts - 1) - 0.5))
        near = (beyond**2).sum(axis=1) < radius**2
        places, own = places[near], own[near]
    i, j, k = own.T
    values = field.coefficients[k, j // 2, i // 2] if bcc else field.coefficients[k, j, i]
    return places, values.astype(float) - (0.0 if field.prefilter else field.base)


def brute_force(field, point):
    """Return D, W and C of a field at a point, by a sum over all kernels."""
    if isinstance(field, ss.RegularField):
        places, values = kernels_of(field)
        layer = 0.5 * field.spacing[0] if field.lattice == "bcc" else np.asarray(field.spacing)
        axes = field.radius * (field.spacing[0] / np.sqrt(2) if field.lattice == "bcc" else layer)
        q = ((point - (np.asarray(field.origin) + places * layer)) / axes) ** 2
        weights = np.ones(values.size)
    else:
        offset = point - field.centers
        if field.rotations is not None:
            w, x, y, z = field.rotations.T
            rotation = np.array(
                [
                    [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                    [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                    [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
                ]
            )
            offset = np.einsum("jin,nj->ni", rotation, offset)
        scales = field.scales if field.scales.ndim == 2 else field.scales[:, None]
        q, values = (offset / scales) ** 2, field.values - field.base
        weights = np.ones(len(values)) if field.weights is None else field.weights
    known = ~np.isnan(values)
    r2, k = q.sum(axis=1), field.falloff
    g = np.where((r2 < 1) & known, (np.exp(-k * r2) - np.exp(-k)) / (1 - np.exp(-k)), 0.0) * weights
    return float((g * np.where(known, values, 0)).sum()), float(g.sum())


def scalar(field, point):
    d, w = brute_force(field, point)
    if field.normalization == "threshold":
        return field.base + d / max(field.w0, w)
    if field.normalization == "none":
        return field.base + d
    c = field.native.lattice_constant
    return field.base + d / (max(0.5 * c, w) if np.isnan(field.values).any() and field.boundary == "edge" else c)


def fields(rng):
    volume = rng.random((6, 7, 8))
    turns = rng.normal(size=(40, 4))
    turns /= np.linalg.norm(turns, axis=1)[:, None]
    shapes = (rng.normal(size=(40, 3)), rng.uniform(0.5, 1.5, (40, 3)), turns)
    return {
        "volume": ss.RegularField(volume, spacing=(1, 1.5, 0.7), origin=(3, -2, 1)),
        "holes": ss.RegularField(np.where(volume < 0.3, np.nan, volume), nan="skip", normalization="threshold"),
        "missing": ss.RegularField(np.where(volume < 0.3, np.nan, 280 + volume), nan="skip"),
        "kelvin": ss.RegularField(280 + volume, radius=2.5, falloff=7),
        "falls": ss.RegularField(280 + volume, boundary="zero", base=270),
        "based": ss.EllipsoidField(*shapes, values=rng.random(40), w0=0.3, base=0.5),
        "bcc": ss.RegularField(volume, lattice="bcc"),
        "prefiltered": ss.RegularField(volume, prefilter=True),
        "mean": ss.EllipsoidField(*shapes, values=rng.random(40), weights=rng.uniform(0.5, 2, 40), w0=0.3),
        "sums": ss.EllipsoidField(*shapes, values=rng.normal(size=40), normalization="none", falloff=0.4),
        "spheres": ss.EllipsoidField(shapes[0], 1.0, values=rng.random(40), normalization="lattice", cell_volume=0.5),
    }


@pytest.mark.parametrize(
    "name",
    [
        *("volume", "holes", "missing", "kelvin", "falls", "bcc", "prefiltered"),
        *("mean", "based", "sums", "spheres"),
    ],
)
def test_fields_are_evaluated_at_points(rng, name):
    field = fields(rng)[name]
    low, high = np.asarray(field.bounds)
    points = rng.uniform(low, high, (60, 3))
    values, gradients = field.evaluate(points)
    expected = [scalar(field, point) for point in points]
    assert np.abs(values - expected).max() < 1e-12 * max(1, np.abs(expected).max()) and np.ptp(expected) > 0.1
    assert np.array_equal(field.at(points), values)
    step = 1e-6
    for axis in range(3):
        by = step * np.eye(3)[axis]
        slopes = np.array([scalar(field, point + by) - scalar(field, point - by) for point in points]) / (2 * step)
        # Where a support ends, or W passes w0, between the two points, the difference is of both sides.
        assert np.quantile(np.abs(slopes - gradients[:, axis]), 0.9) < 1e-6
    # (Mirrored kernels reach farther than others.)
    away = field.radius * np.max(field.spacing) + 1 if isinstance(field, ss.RegularField) else 1
    outside = field.evaluate([high + away, low - away])
    assert (outside[0] == field.base).all() and not outside[1].any()
    assert (field.nearest_kernel([high + away, high - 1e-9]) == -1).all()


@pytest.mark.parametrize("name", ["volume", "bcc", "mean"])
def test_the_nearest_kernel(rng, name):
    field = fields(rng)[name]
    low, high = np.asarray(field.bounds)
    points = rng.uniform(low, high, (40, 3))
    if name == "mean":
        centers = field.centers
    else:
        nk, nj, ni = field.shape
        centers = np.array([field.native.position(i, j, k) for k in range(nk) for j in range(nj) for i in range(ni)])
    found = field.nearest_kernel(points)
    for point, number in zip(points, found, strict=True):
        distances = np.linalg.norm(centers - point, axis=1)
        # (Beyond the outermost samples mirrored ones may be nearer.)
        between = (point >= centers.min(axis=0)).all() and (point <= centers.max(axis=0)).all()
        if number >= 0 and name != "mean" and between:
            assert distances[number] == pytest.approx(distances.min())
        # Of ellipsoids, a nearer centre may have a support that does not reach.
        assert number < len(centers)
    assert (found >= 0).any()


@pytest.mark.parametrize("points", [[1, 2, 3], [[1, 2]], [[np.nan, 0, 0]], "abc", [[1, 2, 3, 4]], None])
def test_unusable_points(ball, points):
    with pytest.raises(ss.InvalidInput, match="point"):
        ss.RegularField(ball).evaluate(points)
    assert ss.RegularField(ball).evaluate(np.empty((0, 3)))[0].shape == (0,)


SCENES = {
    "plain": {},
    "no stop": {"opacity_stop": 1.0},
    "fine": {"slice_spacing": 0.25, "reference_length": 1.0},
    "clipped": {"clip": ss.Clip(planes=[((0.2, 0.1, 1), 6.0)], box=((0, 0, 0), (17, 15, 9)))},
    "gradient opacity": {"gradient_opacity": 0.3, "gradient": "analytic"},
}


@pytest.mark.parametrize("kind", ["orthographic", "perspective"])
@pytest.mark.parametrize("name", SCENES)
def test_opaque_pixels_are_picked_at_their_depth(ball, name, kind):
    scene = ss.Scene(ss.RegularField(ball), [(0, 0, 0, 1, 0), (1, 1, 1, 0, 0.9)], **SCENES[name])
    camera = ss.Camera.fit(scene, (-1, -2, -3), kind=kind)
    image = ss.Renderer("reference").render(scene, camera, SIZE, outputs=("depth",))
    known = np.isfinite(image.depth)
    assert known.sum() > 25
    away = np.array([image.pick(x, y).depth - image.depth[y, x] for y, x in np.argwhere(known)])
    # A pixel that is at ½ within rounding may have the next slice.
    assert (np.abs(away) < 1e-4).mean() > 0.98
    for y, x in np.argwhere(known)[::7]:
        found = image.pick(x, y)
        assert found.value == pytest.approx(scalar(scene.fields[0], np.array(found.position)), abs=1e-12)
        eye = camera.native.to_eye(found.position)
        assert -eye[2] == pytest.approx(found.depth)
        across = 1.0 if kind == "orthographic" else None
        if across:
            assert eye[0] == pytest.approx((2 * (x + 0.5) / SIZE[0] - 1) * camera.height / 2 * SIZE[0] / SIZE[1])
            assert eye[1] == pytest.approx((1 - 2 * (y + 0.5) / SIZE[1]) * camera.height / 2)


def test_faint_pixels_are_picked_where_most_comes_from(ball):
    field = ss.RegularField(ball)
    scene = ss.Scene(field, THIN)
    camera = ss.Camera.fit(scene, "-z")
    image = ss.Renderer("reference").render(scene, camera, SIZE, outputs=("depth",))
    assert not np.isfinite(image.depth).any()
    found = image.pick(15, 12)
    # So thin that nothing hides anything: the largest value on the ray.
    x, y, _ = found.position
    along = np.array([(x, y, z) for z in np.linspace(0, 13, 500)])
    assert found.value == pytest.approx(field.at(along).max(), rel=0.02) and abs(found.position[2] - 6.5) <= 0.5 + 1e-9
    assert found.opacity == pytest.approx(0.004 * found.value)


def test_surfaces_are_picked_on_the_value(ball):
    scene = ss.Scene(ss.RegularField(ball), RAMP, mode="isosurface", iso_value=0.5)
    camera = ss.Camera.fit(scene, (-1, -2, -3), kind="perspective")
    image = ss.Renderer("reference").render(scene, camera, SIZE, outputs=("depth",))
    for y, x in np.argwhere(np.isfinite(image.depth)):
        found = image.pick(x, y)
        assert found.value == pytest.approx(0.5, abs=1e-6) and found.opacity == 1.0
        # The picture interpolates linearly between slices.
        assert found.depth == pytest.approx(image.depth[y, x], abs=0.3 * scene.slice_spacing)
        # The gradient points inwards: to larger values, away from the viewer.
        assert np.dot(found.gradient, np.subtract(found.position, camera.eye)) > -0.5
    for y, x in np.argwhere(~np.isfinite(image.depth)):
        assert image.pick(x, y) is None


def test_scalar_modes_are_picked_where_they_are_largest(ball):
    field = ss.RegularField(ball)
    scene = ss.Scene(field, RAMP, mode="mip")
    image = ss.Renderer("reference").render(scene, ss.Camera.fit(scene, "-z"), SIZE)
    for x, y in ((15, 12), (12, 10), (18, 14)):
        found = image.pick(x, y)
        assert found.value == pytest.approx(image.scalar[y, x], abs=1e-6) and found.opacity is None
    assert image.pick(0, 0) is None


def test_several_fields_are_picked_together(rng):
    near = ss.EllipsoidField([(0, 0, 2.0), (0.1, 0, 2.0)], 0.8, values=[1.0, 1.0])
    far = ss.RegularField(np.ones((3, 3, 3)), origin=(-1, -1, -3))
    scene = ss.Scene([far, near], [(0, 0, 0, 0, 0), (1, 1, 1, 1, 0.9)], slice_spacing=0.1)
    image = ss.Renderer("reference").render(scene, ss.Camera.fit(scene, "-z"), (31, 31))
    found = image.pick(15, 15)
    assert (found.field, found.kernel, found.sample) == (1, 0, None) and 1.2 < found.position[2] < 2.8
    behind = ss.Renderer("reference").render(scene, ss.Camera.fit(scene, "z"), (31, 31)).pick(15, 15)
    assert behind.field == 0 and behind.sample == tuple(np.unravel_index(behind.kernel, (3, 3, 3)))
    assert behind.sample[0] == 0


def test_groups_are_picked_by_what_is_most_opaque():
    near = ss.EllipsoidField([(0, 0, 2.0)], 1.0, values=[0.5], normalization="none")
    far = ss.RegularField(np.ones((3, 3, 3)), origin=(-1, -1, -3))
    hidden = [(0, 0, 0, 0, 0), (1, 1, 1, 1, 0.001)]
    shown = [(0, 0, 0, 0, 0), (1, 1, 1, 1, 0.9)]
    for functions, field in (([shown, hidden], 0), ([hidden, shown], 1)):
        scene = ss.Scene([far, near], functions, slice_spacing=0.1)
        image = ss.Renderer("reference").render(scene, ss.Camera.fit(scene, "-z"), (31, 31), outputs=("depth",))
        found = image.pick(15, 15)
        assert found.field == field
        depth = float(image.depth[15, 15])
        # Where opacity stays below one half, `pick` shows the most opaque slice.
        assert found.depth == pytest.approx(depth, abs=1e-4) if np.isfinite(depth) else found.opacity < 0.5
        assert found.value == pytest.approx(scene.fields[field].at([found.position])[0])


def test_of_several_surfaces_the_one_that_shows_is_picked(ball):
    field = ss.RegularField(ball)
    for pairs, value in (([(0.2, 0.1), (0.6, 1.0)], 0.6), ([(0.2, 0.7), (0.6, 1.0)], 0.2), ([(0.3, 0.2)], 0.3)):
        scene = ss.Scene(field, RAMP, mode="isosurface", iso_value=pairs)
        image = ss.Renderer("reference").render(scene, ss.Camera.fit(scene, (-1, -2, -3)), (31, 31), outputs=("depth",))
        found = image.pick(15, 15)
        assert found.value == pytest.approx(value, abs=1e-6) and found.opacity == dict(pairs)[value]
        if len(pairs) > 1:
            assert found.depth == pytest.approx(float(image.depth[15, 15]), abs=0.3)


@pytest.mark.parametrize("place", [(-1, 0), (30, 0), (0, 24), (np.nan, 0), ("1", 0), (None, 0), (np.inf, 0), (True, 0)])
def test_places_outside_are_refused(ball, place):
    image = ss.render(ball, size=SIZE, backend="reference")
    with pytest.raises(ss.InvalidInput, match=r"Image\.pick: [xy]"):
        image.pick(*place)
    assert image.pick(15.9, np.int64(12)) == image.pick(15, 12)


def test_pictures_without_their_scene_cannot_be_picked(ball):
    import pickle

    image = pickle.loads(pickle.dumps(ss.render(ball, size=SIZE, backend="reference")))
    with pytest.raises(ss.InvalidInput, match="its scene"):
        image.pick(1, 1)


def test_empty_pictures_have_nothing_to_pick():
    with pytest.warns(ss.PictureWarning):
        image = ss.render(np.full((3, 3, 3), np.nan), nan="skip", size=(8, 8), backend="reference")
    assert image.pick(3, 3) is None


@pytest.mark.parametrize("near", [1.0, None])
@pytest.mark.parametrize("opacity", [1.0, 0.3])
def test_a_surface_that_the_near_plane_cuts_is_open(near: float | None, opacity: float) -> None:
    """Conventions, section 7: between the last slice that the near plane removes and the first one nothing crosses."""
    z, y, x = np.mgrid[0:10, 0:10, 0:10] - 4.5
    field = ss.RegularField(np.exp(-(x * x + y * y + z * z) / 10))
    look = ss.TransferFunction([(0, 1, 1, 1, 1), (1, 1, 1, 1, 1)])
    scene = ss.Scene(field, look, mode="isosurface", iso_value=[(0.5, opacity)])
    inside = ss.Camera.perspective((4.5, 4.5, 5), (4.5, 4.5, 0), fov_y=120, **({} if near is None else {"near": near}))
    image = ss.Renderer("cpu").render(scene, inside, size=(5, 5), outputs=("depth",))
    found = image.pick(2, 2)
    assert found is not None
    assert found.value == pytest.approx(0.5, abs=0.02)
    assert found.depth == pytest.approx(3.009, abs=0.05)
    if opacity == 1.0:
        assert found.depth == pytest.approx(float(image.depth[2, 2]), abs=0.05)

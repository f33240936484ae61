"""Volumes among the surfaces of a plotter of PyVista, and its camera."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import sheetsplat as ss

pv: Any = pytest.importorskip("pyvista", reason="pyvista is not installed")

from sheetsplat.integrations.pyvista import composite  # noqa: E402
from sheetsplat.integrations.vtk_picture import surface_picture  # noqa: E402

SIZE = (160, 120)
KINDS = ("perspective", "parallel")
RADIUS = 0.6
# The plane n x = d cuts the ball around 0.
NORMAL = np.array([1.0, 0.25, 0.1]) / np.linalg.norm([1.0, 0.25, 0.1])
OFFSET = 0.15
BLUE = (0.0, 0.0, 1.0)


@pytest.fixture(scope="module")
def ball_field() -> ss.RegularField:
    """Return a field that falls linearly from 1 in the middle of a cube of edge 2 to 0 at its sides."""
    at = np.stack(np.meshgrid(*[np.linspace(-1, 1, 41)] * 3, indexing="ij"))
    values = np.clip(1.0 - np.sqrt((at**2).sum(0)), 0, 1).astype(np.float32)
    return ss.RegularField(values, spacing=(0.05, 0.05, 0.05), origin=(-1, -1, -1))


def plotter_of(kind: str = "perspective", **options: Any) -> Any:
    """Return a plotter that looks at 0 from the side, with a white background."""
    plotter = pv.Plotter(off_screen=True, window_size=SIZE, **options)
    plotter.set_background("white")
    plotter.camera_position = [(3.0, -1.5, 1.2), (0.05, 0.0, -0.05), (0.0, 0.2, 1.0)]
    if kind == "parallel":
        plotter.enable_parallel_projection()
        plotter.camera.parallel_scale = 1.1
    return plotter


def plane(**options: Any) -> Any:
    return pv.Plane(center=tuple(OFFSET * NORMAL), direction=tuple(NORMAL), i_size=2.0, j_size=1.6, **options)


class Rays:
    """The rays of a picture's pixels: points are start + t along at depth t."""

    def __init__(self, camera: ss.Camera, size: tuple[int, int]) -> None:
        width, height = size
        right, up, back = map(np.array, camera.world_axes())
        x = (2 * (np.arange(width) + 0.5) / width - 1) * width / height
        y = 1 - 2 * (np.arange(height) + 0.5) / height
        across = x[None, :, None] * right + y[:, None, None] * up
        eye = np.array(camera.eye)
        if camera.kind == "orthographic":
            self.start, self.along = eye + 0.5 * camera.height * across, np.broadcast_to(-back, across.shape)
        else:
            self.start = np.broadcast_to(eye, across.shape)
            self.along = np.tan(np.radians(camera.fov_y / 2)) * across - back

    def plane(self) -> np.ndarray:
        """Return the depth of the endless plane."""
        return np.asarray((OFFSET - self.start @ NORMAL) / (self.along @ NORMAL))

    def ball(self) -> np.ndarray:
        """Return the depth at which rays enter the ball, NaN beside it."""
        a, b = (self.along**2).sum(-1), (self.start * self.along).sum(-1)
        c = (self.start**2).sum(-1) - RADIUS**2
        with np.errstate(invalid="ignore"):
            return np.asarray((-b - np.sqrt(b * b - a * c)) / a)

    def at(self, depths: np.ndarray) -> np.ndarray:
        return np.asarray(self.start + depths[..., None] * self.along)


@pytest.mark.parametrize("kind", KINDS)
def test_depths_are_those_of_a_plane(kind: str) -> None:
    plotter = plotter_of(kind)
    plotter.add_mesh(plane())
    found = surface_picture(plotter, SIZE)
    seen = np.isfinite(found.depths)
    wanted = Rays(ss.Camera.from_pyvista(plotter, SIZE), SIZE).plane()
    assert 0.2 < seen.mean() < 0.9
    assert np.abs(found.depths - wanted)[seen].max() < 1e-5
    # A negative control: pixels half a step to the side.
    shifted = (wanted[:, 1:] + wanted[:, :-1]) / 2
    assert np.abs(found.depths[:, 1:] - shifted)[seen[:, 1:]].max() > 1e-3


@pytest.mark.parametrize("kind", KINDS)
def test_a_plane_that_cuts_a_ball(kind: str, ball_field: ss.RegularField) -> None:
    """Pixel by pixel: the ball hides the plane where it is nearer, the plane hides the ball, and the rest is white."""
    plotter = plotter_of(kind)
    plotter.add_mesh(plane(), color=BLUE, lighting=False)
    red = [(0, 1, 0, 0, 1), (1, 1, 0, 0, 1)]
    scene = ss.Scene(ball_field, red, mode="isosurface", iso_value=1 - RADIUS, slice_spacing=0.01)
    image = composite(plotter, scene)
    rays = Rays(image.camera, SIZE)
    ball, flat = rays.ball(), rays.plane()
    on_plane = np.isfinite(image.depth_limit)
    shows_ball = ~np.isnan(ball) & ~(on_plane & (flat < ball))
    wanted = np.where(shows_ball[..., None], (1, 0, 0), np.where(on_plane[..., None], BLUE, (1, 1, 1)))
    wrong = np.abs(image.rgba[..., :3] - wanted).max(-1) > 0.02
    # A crossing counts where both its slices are in front of the plane.
    near_edge = on_plane & (np.abs(ball - flat) < 0.012)
    grown = np.pad(shows_ball, 1, mode="edge")
    steps = [(dy, dx) for dy in (-1, 0, 1) for dx in (-1, 0, 1)]
    height, width = shows_ball.shape
    near = [grown[1 + dy : height + 1 + dy, 1 + dx : width + 1 + dx] for dy, dx in steps]
    near_edge |= np.logical_or.reduce(near) & ~np.logical_and.reduce(near)
    assert not (wrong & ~near_edge).any()
    assert wrong.mean() < 0.01, "at the edges"
    counts = [shows_ball.sum(), (on_plane & ~shows_ball).sum(), (on_plane & ~np.isnan(ball) & ~shows_ball).sum()]
    assert min(counts) > 300, "ball, plane, and what it hides of the ball"
    # Without the depths the plane would hide nothing.
    whole = ss.Renderer("cpu").render(scene, image.camera, size=SIZE)
    assert (whole.rgba[..., 3] > 0.5)[on_plane & ~shows_ball].mean() > 0.1


@pytest.mark.parametrize("kind", KINDS)
def test_a_translucent_volume_covers_surfaces_in_part(kind: str, ball_field: ss.RegularField) -> None:
    """Each pixel is the volume in front of the plane over the plane's colour."""
    plotter = plotter_of(kind)
    plotter.add_mesh(plane(), color=BLUE, lighting=False)
    scene = ss.Scene(ball_field, [(0, 1, 0, 0, 0), (1, 1, 1, 0, 0.1)], opacity_stop=1.0)
    image = composite(plotter, scene)
    depths = np.where(np.isfinite(image.depth_limit), Rays(image.camera, SIZE).plane(), np.inf)
    volume = ss.Renderer("cpu").render(scene, image.camera, size=SIZE, depth_limit=depths).rgba
    behind = np.where(np.isfinite(depths)[..., None], (*BLUE, 1.0), (1.0, 1.0, 1.0, 1.0))
    wanted = volume + (1 - volume[..., 3:]) * behind
    # A depth that is rounded may lie on the other side of a slice.
    off = np.abs(image.rgba - wanted).max(-1)
    assert np.mean(off > 1e-5) < 2e-3 and off.max() < 0.05
    assert 0.2 < volume[..., 3][np.isfinite(depths)].max() < 0.95
    assert np.allclose(image.rgba[..., 3], 1.0)


def test_hidden_volumes_leave_the_plotters_picture(ball_field: ss.RegularField) -> None:
    """Surfaces, edges, scalars, bars, texts, labels and axes are those of VTK, and nothing of the plotter changes."""
    plotter = plotter_of()
    plotter.background_color = (0.2, 0.3, 0.4)
    mesh = pv.Sphere(radius=1.9)
    mesh["height"] = mesh.points[:, 2]
    plotter.add_mesh(mesh, scalars="height", show_edges=True, scalar_bar_args={"title": "height"})
    plotter.add_text("a text", font_size=10)
    plotter.add_point_labels([(0, 0, 2.0), (0, 0, 0.0)], ["in front", "inside"], always_visible=False)
    plotter.add_axes()
    samples = plotter.render_window.GetMultiSamples()
    plotter.render_window.SetMultiSamples(0)
    before = plotter.screenshot(None, return_img=True)
    state = [tuple(plotter.camera.clipping_range), tuple(plotter.window_size), plotter.camera_position]
    with pytest.warns(ss.PictureWarning, match="depth_limit hides all"):
        image = composite(plotter, ball_field)
    assert np.abs(np.asarray(image)[..., :3] - before / 255.0).max() < 2.5 / 255
    assert [tuple(plotter.camera.clipping_range), tuple(plotter.window_size), plotter.camera_position] == state
    assert np.array_equal(plotter.screenshot(None, return_img=True), before)
    plotter.render_window.SetMultiSamples(samples)
    plotter.render_window.Render()
    samples = plotter.render_window.GetMultiSamples()
    bare = surface_picture(plotter, SIZE)
    assert bare.over is not None and 0.01 < (bare.over[..., 3] > 0.5).mean() < 0.5
    assert np.abs(bare.colors - before / 255.0).max() > 0.2, "texts are not among the surfaces"
    assert plotter.render_window.GetMultiSamples() == samples


def test_transparent_background(ball_field: ss.RegularField) -> None:
    plotter = plotter_of()
    plotter.add_mesh(plane(), color=BLUE, lighting=False)
    image = composite(plotter, ball_field, transparent_background=True, size=(80, 60))
    assert image.size == (80, 60) and tuple(plotter.window_size) == SIZE
    assert not image.rgba[0, 0].any()
    assert np.allclose(image.rgba[np.isfinite(image.depth_limit)][:, 3], 1.0)


def test_a_camera_that_was_not_placed_sees_surfaces_and_data(ball_field: ss.RegularField) -> None:
    for meshes in ([], [pv.Sphere(radius=0.2, center=(4, 0, 0))]):
        plotter = pv.Plotter(off_screen=True, window_size=SIZE)
        for mesh in meshes:
            plotter.add_mesh(mesh, color=BLUE, lighting=False)
        image = composite(plotter, ball_field, cmap="gray")
        opaque = np.isfinite(image.depth_limit).sum()
        assert (opaque > 20) == bool(meshes)
        outside = np.concatenate([image.rgba[0], image.rgba[-1], image.rgba[:, 0], image.rgba[:, -1]])
        assert np.abs(outside - outside[0]).max() < 0.02, "the picture's edges show the background alone"
        assert np.abs(image.rgba - outside[0]).max(-1).mean() > 0.005


@pytest.mark.parametrize("kind", [*KINDS, "horizontal"])
def test_cameras_show_points_at_the_same_pixels(kind: str) -> None:
    plotter = plotter_of("perspective" if kind == "horizontal" else kind)
    plotter.camera.roll += 20.0
    if kind == "horizontal":
        plotter.camera.SetUseHorizontalViewAngle(True)
    camera = ss.Camera.from_pyvista(plotter, SIZE)
    plotter.add_mesh(pv.Sphere())
    plotter.render_window.Render()
    rays = Rays(camera, SIZE)
    rng = np.random.default_rng(3)
    width, height = SIZE
    for row, column in zip(rng.integers(0, height, 9), rng.integers(0, width, 9), strict=True):
        point = rays.at(np.full((height, width), rng.uniform(1.5, 5.0)))[row, column]
        plotter.renderer.SetWorldPoint(*point, 1.0)
        plotter.renderer.WorldToDisplay()
        x, y, _ = plotter.renderer.GetDisplayPoint()
        assert (x, height - y) == pytest.approx((column + 0.5, row + 0.5), abs=1e-3)
    assert ss.Camera.from_pyvista(plotter.camera, SIZE) == camera
    assert ss.Camera.from_pyvista(plotter, SIZE) != ss.Camera.from_pyvista(plotter, (120, 160)) or kind != "horizontal"


def test_cameras_without_counterpart_are_refused() -> None:
    for distort in (
        lambda camera: camera.SetWindowCenter(0.1, 0.0),
        lambda camera: camera.SetViewShear(0.1, 0.0, 1.0),
        lambda camera: camera.SetUseExplicitProjectionTransformMatrix(True),
        lambda camera: camera.SetUseOffAxisProjection(True),
        lambda camera: setattr(camera, "model_transform_matrix", np.diag([1.0, 1.0, 2.0, 1.0])),
    ):
        plotter = plotter_of()
        distort(plotter.camera)
        with pytest.raises(ss.Unsupported, match="has no counterpart"):
            ss.Camera.from_pyvista(plotter, SIZE)
    with pytest.raises(ss.InvalidInput, match="there is no camera"):
        ss.Camera.from_pyvista("plotter", SIZE)


def with_translucent_surface() -> Any:
    plotter = plotter_of()
    plotter.add_mesh(pv.Sphere(), opacity=0.5)
    return plotter


def with_volume() -> Any:
    plotter = plotter_of()
    plotter.add_volume(np.random.default_rng(1).random((4, 4, 4)))
    return plotter


def with_pass() -> Any:
    plotter = plotter_of()
    plotter.enable_ssao()
    return plotter


def with_scale() -> Any:
    plotter = plotter_of()
    plotter.add_mesh(pv.Sphere())
    plotter.set_scale(zscale=2.0, reset_camera=False)
    return plotter


def closed() -> Any:
    plotter = plotter_of()
    plotter.close()
    return plotter


REFUSED: list[tuple[Callable[[], Any], str]] = [
    (with_translucent_surface, "translucent surface.*make it opaque"),
    (with_volume, "a volume that VTK draws"),
    (with_pass, "render pass"),
    (with_scale, "scaled by"),
    (closed, "closed"),
    (lambda: plotter_of(shape=(1, 2)), "2 views"),
]


@pytest.mark.parametrize(("make", "message"), REFUSED, ids=[message for _, message in REFUSED])
def test_what_has_no_single_depth_is_refused(
    make: Callable[[], Any], message: str, ball_field: ss.RegularField
) -> None:
    with pytest.raises(ss.Unsupported, match=message):
        composite(make(), ball_field)


def test_unusable_arguments_are_refused(ball_field: ss.RegularField) -> None:
    plotter = plotter_of()
    camera = ss.Camera.fit(ball_field)
    for options in ({"camera": camera}, {"azimuth": 30}, {"depth_limit": 2.0}, {"background": "white"}):
        with pytest.raises(ss.InvalidInput, match=f"{next(iter(options))} beside a plotter"):
            composite(plotter, ball_field, **options)  # type: ignore[arg-type]
    with pytest.raises(ss.InvalidInput, match="mode 'xray'"):
        composite(plotter, ball_field, mode="xray")
    with pytest.raises(ss.InvalidInput, match="there is no plotter"):
        composite(ball_field, plotter)
    with pytest.raises(ss.InvalidInput, match="opacitty"):
        composite(plotter, ball_field, opacitty=1)  # type: ignore[call-arg]


@pytest.mark.gl
def test_opengl_draws_beside_windows_that_open_and_close(ball_field: ss.RegularField) -> None:
    # VTK ends the EGL display, which belongs to the process, when it looks for devices and when it closes a window.
    renderer = ss.Renderer("gl")
    scene = ss.Scene(ball_field, ss.TransferFunction.from_colormap("gray", "linear", (0, 1)))
    camera = ss.Camera.fit(ball_field)
    expected = renderer.render(scene, camera, size=(20, 20)).rgba
    plotter = plotter_of()
    plotter.add_mesh(plane())
    plotter.screenshot(return_img=True)
    assert np.array_equal(renderer.render(scene, camera, size=(20, 20)).rgba, expected)
    plotter.close()
    assert np.array_equal(renderer.render(scene, camera, size=(20, 20)).rgba, expected)

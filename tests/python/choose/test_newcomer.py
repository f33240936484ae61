"""What somebody meets who uses the package for the first time: colours, warnings, names, and messages that help."""

from __future__ import annotations

import json
import logging
import warnings

import numpy as np
import pytest
from command_line import run

import sheetsplat as ss
from sheetsplat.choose.look import compose_scene
from sheetsplat.framing import compose_camera
from sheetsplat.io.pictures import read_picture
from sheetsplat.look.empty import why_empty
from sheetsplat.look.surface import surface_color, surface_text

RED = [(0, 1, 0, 0, 0), (1, 1, 0, 0, 1)]
SMALL = {"size": (24, 24), "backend": "reference", "quality": "draft"}
BACKEND = ["--backend", "reference", "--size", "12"]


@pytest.mark.parametrize("iso", [None, 0.2, 0.8])
def test_a_surface_without_limits_is_bright(ball, iso):
    scene = compose_scene([ss.RegularField(ball)], mode="isosurface", iso_value=iso, cmap="gray")
    assert surface_color(scene, scene.surfaces[0][0]) == pytest.approx((0.7, 0.7, 0.7), abs=0.01)
    limited = compose_scene([ss.RegularField(ball)], mode="isosurface", iso_value=0.3, cmap="gray", clim=(0, 1))
    assert surface_color(limited, limited.surfaces[0][0]) == pytest.approx((0.3, 0.3, 0.3), abs=0.01)


def test_the_command_tells_value_and_colour_of_a_surface(tmp_path, volume, ball, caplog):
    result = run(
        "render", volume, "-o", tmp_path / "a.npy", "--mode", "isosurface", "--cmap", "gray", "--json", *BACKEND
    )
    report = json.loads(result.stdout)
    assert 0 < report["iso_value"] < 200 and report["color"] == pytest.approx([0.7] * 3, abs=0.01)
    assert f"isosurface at {report['iso_value']:g}, colour #b" in result.stderr
    with caplog.at_level(logging.INFO, "sheetsplat"):
        ss.render(ball, mode="isosurface", **SMALL)
    assert "isosurface at" in caplog.text


@pytest.mark.parametrize(
    "options",
    [
        ["--mode", "xray", "--background", "white"],
        ["--mode", "mip", "--background", "gray"],
        ["--log-scale"],
        ["--mode", "xray", "--opacity", "0.5"],
        ["--mode", "xray", "--depth", "d.npy"],
        ["--mode", "isosurface", "--opacity", "0.5"],
        ["--mode", "isosurface", "--preintegration"],
        ["--iso", "3"],
    ],
)
def test_options_that_a_mode_ignores_are_refused(tmp_path, monkeypatch, volume, options):
    monkeypatch.chdir(tmp_path)
    stderr = run("render", volume, "-o", "a.png", *options, *BACKEND, code=2).stderr
    mode = options[1] if options[0] == "--mode" else "composite"
    assert (
        f"--mode {mode}" in stderr
        and next(one for one in options if one.startswith("--") and one != "--mode") in stderr
    )
    assert sorted(path.name for path in tmp_path.iterdir()) == ["ball.npy"]


def test_harmless_options_are_told(tmp_path, volume, ball):
    options = ["--mode", "xray", "--no-shading", *BACKEND]
    assert "does not use --shading" in run("render", volume, "-o", tmp_path / "a.png", *options).stderr
    assert "does not use" not in run("render", volume, "-o", tmp_path / "a.png", *options[:2], *BACKEND).stderr
    with pytest.warns(ss.PictureWarning, match="mode xray does not use these options: opacity, background"):
        ss.render(ball, mode="xray", opacity=0.5, background="white", **SMALL)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        ss.render(ball, mode="xray", cmap="gray", **SMALL)
        ss.render(ball, cmap="gray", background="white", **SMALL)


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        ({"mode": "isosurface", "iso_value": 7}, "iso value 7 lies outside the values 0 to"),
        ({"clim": (5, 9)}, "goes from 5 to 9"),
        ({"opacity": 0.0, "background": "white"}, "opacity is 0 everywhere"),
        ({"camera": ss.Camera.orthographic((900, 900, 9), (900, 900, 0), height=5)}, "perhaps the camera looks past"),
        ({"clip": ss.Clip(planes=[((1, 0, 0), 1e6)])}, "the clip cuts off all"),
    ],
)
def test_empty_pictures_say_why(ball, options, reason):
    with pytest.warns(ss.PictureWarning, match=f"nothing can be seen.*{reason}"):
        ss.render(ball, **options, **SMALL)


def test_empty_pictures_are_told_on_stderr_and_are_no_error(tmp_path, volume):
    options = ["--mode", "isosurface", "--iso", 900, *BACKEND]
    assert "outside the values 0 to" in run("render", volume, "-o", tmp_path / "a.png", *options).stderr
    assert (tmp_path / "a.png").exists()


def test_differences_are_scaled_to_be_seen(tmp_path):
    first = np.zeros((4, 5, 4), np.float32)
    first[..., 3] = 1
    second = first.copy()
    second[1, 2, 0] = 0.02
    second[2, 2, 1] = 0.01
    np.save(tmp_path / "a.npy", first)
    np.save(tmp_path / "b.npy", second)
    pair = [tmp_path / "a.npy", tmp_path / "b.npy"]
    assert "times 50" in run("compare", *pair, "--difference", tmp_path / "d.png").stdout
    shown = read_picture(tmp_path / "d.png")
    assert shown[1, 2, 0] == 1 and shown[2, 2, 1] == pytest.approx(0.5, abs=0.01) and shown[0, 0, :3].max() == 0
    report = json.loads(run("compare", *pair, "--difference", tmp_path / "d.npy", "--scale", 3, "--json").stdout)
    assert report["difference_scale"] == 3 and np.load(tmp_path / "d.npy")[1, 2, 0] == pytest.approx(0.06)
    run("compare", *pair, "--scale", 3, code=2)


def test_scenes_and_data_sets_are_taken_as_they_are(ball):
    data = ss.datasets.noisy_ball(16)
    camera = ss.Camera.fit(data)
    assert camera.height == ss.Camera.fit(data.field()).height == ss.Camera.fit(data.scene()).height
    scene = data.scene()
    renderer = ss.Renderer("reference")
    expected = renderer.render(scene, camera, size=(24, 24)).rgba
    assert np.array_equal(ss.render(scene, camera=camera, **SMALL).rgba, expected)
    assert ss.render(scene, **SMALL).rgba.any()
    with pytest.raises(ss.InvalidInput, match="cmap for a scene"):
        ss.render(scene, cmap="gray", **SMALL)
    suggested = ss.render(data, camera=camera, lights=scene.lights, material=scene.material, **SMALL)
    assert np.array_equal(suggested.rgba, expected)
    assert not np.allclose(ss.render(data, camera=camera, cmap="gray", **SMALL).rgba, expected)
    signal = ss.datasets.marschner_lobb(12)
    assert ss.render(signal, **SMALL).rgba[..., 3].max() == 1
    assert ss.render(signal, mode="xray", **SMALL).is_scalar


def test_names_of_colours_and_axes(ball):
    white = ss.render(ball, background="white", direction="-z", up="y", **SMALL)
    assert np.array_equal(white.rgba, ss.render(ball, background=(1, 1, 1), direction=(0, 0, -1), **SMALL).rgba)
    field = ss.RegularField(ball)
    assert ss.Camera.fit(field, "x").eye == ss.Camera.fit(field, (1, 0, 0)).eye
    with pytest.raises(ss.InvalidInput, match="axis"):
        ss.Camera.fit(field, "w")
    function = ss.TransferFunction.from_colormap("black,orange,white")
    assert function.at(0.5)[:3] == pytest.approx((1, 165 / 255, 0))
    listed = ss.TransferFunction.from_colormap(["black", "orange", "white"])
    assert np.array_equal(listed.points, function.points)


def test_colours_at_values(tmp_path, volume, ball):
    options = ["--cmap", "0:black,50:red,200:white", "--opacity", "0.2", "--no-shading", *BACKEND]
    run("render", volume, "-o", tmp_path / "a.npy", *options)
    function = ss.TransferFunction([(0, 0, 0, 0, 0.2), (50, 1, 0, 0, 0.2), (200, 1, 1, 1, 0.2)])
    values = (ball * 200).astype(np.uint8)
    expected = ss.render(values, transfer_function=function, shading=False, size=(12, 12), backend="reference")
    assert np.allclose(read_picture(tmp_path / "a.npy"), expected.rgba, atol=2e-3)
    for wrong in ("50:red,0:black", "0:black,x:red", "black,nocolour"):
        run("render", volume, "-o", tmp_path / "b.png", "--cmap", wrong, *BACKEND, code=2)


@pytest.mark.parametrize("projection", ["orthographic", "perspective"])
@pytest.mark.parametrize("rise", [90, -90])
def test_straight_from_above_and_below(ball, rise, projection):
    options = {"azimuth": 30, "projection": projection, **SMALL}
    # Continuous: the picture at the pole is that of just before it.
    at, near = (ss.render(ball, elevation=degrees, **options).rgba for degrees in (rise, rise * 0.9999))
    assert np.abs(at - near).max() < 0.02
    assert ss.render(ball, direction="-y", **SMALL).rgba.any()


def test_a_perspective_fit_touches_the_frame():
    field = ss.RegularField(np.ones((20, 30, 10), np.float32))
    for size in ((40, 40), (80, 30), (30, 80)):
        camera = compose_camera(field, size, projection="perspective", fov_y=40, margin=1.0)
        lower, upper = np.asarray(field.bounds)
        slope = np.tan(np.radians(20))
        reach = 0.0
        for corner in np.stack(np.meshgrid(*zip(lower, upper, strict=True)), -1).reshape(-1, 3):
            x, y, z = camera.native.direction_to_eye(tuple(corner - np.asarray(camera.eye)))
            reach = max(reach, abs(x) / -z / slope * size[1] / size[0], abs(y) / -z / slope)
        assert reach == pytest.approx(1.0, rel=1e-6)


def test_messages_of_the_command_name_its_options(tmp_path, volume):
    stderr = run(
        "render",
        volume,
        "-o",
        tmp_path / "a.png",
        "--effect",
        "bloom=on",
        *BACKEND[2:],
        "--backend",
        "reference",
        code=2,
    ).stderr
    assert "--effect" in stderr and "effects=" not in stderr
    np.savez(tmp_path / "two.npz", a=np.zeros((2, 2, 2)), b=np.zeros((2, 2, 2)))
    assert "--name TEXT" in run("render", tmp_path / "two.npz", "-o", tmp_path / "a.png", code=1).stderr
    assert "a, b; choose with --name" in run("info", tmp_path / "two.npz").output
    (tmp_path / "a.raw").write_bytes(bytes(10))
    for shape in ("2x2x2", "3x3x3"):
        stderr = run("info", tmp_path / "a.raw", "--shape", shape, "--dtype", "uint8", code=1).stderr
        assert "--shape" in stderr and "--dtype" in stderr and "header says" not in stderr


def test_info_takes_places(volume):
    options = ["--lattice", "bcc", "--spacing", "2,2,2", "--origin", "1,2,3"]
    report = json.loads(run("info", volume, "--json", *options).stdout)
    assert report["lattice"] == "bcc" and report["origin"] == [1, 2, 3] and report["spacing"] == [2, 2, 2]
    lower, upper = ss.RegularField(np.zeros((14, 16, 18)), lattice="bcc", spacing=(2, 2, 2)).centre_bounds
    assert report["extent"] == pytest.approx([high - low for low, high in zip(lower, upper, strict=True)])


def test_short_descriptions(ball):
    data = ss.datasets.noisy_ball(16)
    field = ss.RegularField(ball, spacing=(1, 2, 3), origin=(4, 5, 6))
    moved = ss.resample_to_bcc(field)
    assert np.array_equal(moved.values, ss.resample_to_bcc(ball, (1, 2, 3), (4, 5, 6)).values)
    for thing in (data, moved, ss.Renderer("reference"), ss.resample_to_bcc(data)):
        assert len(repr(thing)) < 160 and " object at " not in repr(thing)
    with pytest.raises(ss.InvalidInput, match="Cartesian"):
        ss.resample_to_bcc(moved.field())


def test_the_reason_is_one_of_the_scene():
    scene = ss.Scene(ss.RegularField(np.full((3, 3, 3), -2.0)), [(0, 1, 1, 1, 0), (1, 1, 1, 1, 1)])
    assert "the opacity is 0 for all of the values -2 to -2" in why_empty(scene)
    # Maxima below 0 are maxima.
    assert "-2" not in why_empty(scene.replace(mode="mip"))


def test_a_dict_of_arrays_says_what_to_do(ball):
    for data in ({"T": ball}, {"T": ball, "p": ball}, {}):
        with pytest.raises(ss.InvalidInput, match="dict with the keys"):
            ss.render(data, **SMALL)
    with pytest.raises(ss.InvalidInput, match=r"data\['T'\]"):
        ss.render({"T": ball}, **SMALL)


def test_a_colormap_for_each_field_is_a_list_of_transfer_functions(ball):
    fields = [ss.RegularField(ball), ss.RegularField(ball[::-1])]
    for options in ({"cmap": ["viridis", "gray"]}, {"clim": [(0, 1), (0, 2)]}):
        with pytest.raises(ss.InvalidInput, match="transfer_function=") as told:
            ss.render(fields, **options, **SMALL)
        assert told.value.option == next(iter(options))
    own = [ss.TransferFunction.from_colormap(name, 0.5) for name in ("viridis", "gray")]
    assert ss.render(fields, transfer_function=own, **SMALL).rgba.any()
    # Two colours, and two numbers, are for the sum of all fields.
    assert ss.render(fields, cmap=["black", "red"], clim=[0, 1.5], **SMALL).rgba.any()


def test_a_quality_cannot_change_a_scene(ball):
    scene = ss.Scene(ss.RegularField(ball), [(0, 0, 0, 0, 0), (1, 1, 1, 1, 1)])
    with pytest.warns(ss.PictureWarning, match="quality changes nothing in a scene"):
        ss.render(scene, **SMALL)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        ss.render(scene, size=24, backend="reference")


def test_many_surfaces_are_told_in_few_words(ball):
    scene = ss.Scene(ss.RegularField(ball), RED, mode="isosurface", iso_value=[(n / 300, 0.01) for n in range(256)])
    text = surface_text(scene)
    assert text.count("isosurface at") == 4 and len(text) < 400
    assert text.endswith("and 252 more, all between 0 and 0.85")


def test_more_surfaces_than_can_be_told_apart_are_refused(ball):
    with pytest.raises(ss.InvalidInput, match="more than 256 values; wanted at most 256"):
        ss.render(ball, mode="isosurface", iso_value=[(n / 5000, 0.01) for n in range(4096)], **SMALL)


def test_iso_values_from_an_iterator(ball):
    once = ss.render(ball, mode="isosurface", iso_value=iter([(0.3, 0.5), (0.6, 1)]), **SMALL)
    assert once == ss.render(ball, mode="isosurface", iso_value=[(0.3, 0.5), (0.6, 1)], **SMALL)
    for given in ((value for value in (0.3, 0.5)), [0.3, 0.5], [0.3]):
        with pytest.raises(ss.InvalidInput, match=r"\[\(0.3, 1\), …\]"):
            ss.render(ball, mode="isosurface", iso_value=given, **SMALL)


def test_a_size_that_is_too_large_is_told_the_limit(tmp_path):
    stderr = run("render", "a.nrrd", "-o", tmp_path / "a.png", "--size", str(2**31), code=2).stderr
    assert "wanted numbers below 2,147,483,648" in stderr


def test_the_plan_of_a_filter_taken_by_itself_does_not_say_that_it_was_asked_for():
    rng = np.random.default_rng(3)
    dust = ss.EllipsoidField(rng.random((300, 3)), np.full(300, 1e-3), values=np.ones(300))
    plan = ss.render(dust, size=24, backend="cpu", clim=(0, 1), opacity=0.5).plan
    rows = {one.name: one for one in plan.effects}
    assert rows["ewa_filter"].on and "asked" not in rows["ewa_filter"].reason

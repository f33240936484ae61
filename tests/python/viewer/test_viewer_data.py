"""The data that a viewer shows: files, scenes, times, scattered kernels, large volumes, bricks."""

from __future__ import annotations

import io

import numpy as np
import pytest
from PIL import Image as Pillow
from viewer_pages import CHANGES, SIZE, Page, made_by, picture_of, volume

import sheetsplat as ss
from sheetsplat.viewer import coarse, frames, previews
from sheetsplat.viewer import state as state_module
from sheetsplat.viewer.data import Shown


@pytest.mark.slow
@pytest.mark.parametrize("engine", ["scipy", "h5netcdf"])
def test_steps_of_a_file_are_times(opened, tmp_path, engine):
    xarray = pytest.importorskip("xarray", reason="xarray is not installed")
    pytest.importorskip(engine)
    steps = np.stack([volume(), 0.5 * volume(0.3)])
    xarray.DataArray(steps, dims=("time", "z", "y", "x"), name="t").to_netcdf(tmp_path / "a.nc", engine=engine)
    session = opened(tmp_path / "a.nc")
    page = Page(session)
    assert page.wait("state")[0]["data"]["times"] == ["step 0", "step 1"]
    page.set(time=1)
    page.wait("frame", last=True)
    assert np.array_equal(session.scene().fields[0].values, steps[1])
    assert "step=1" in session.code()
    for mode in ("composite", "isosurface", "mip", "xray"):
        page.set(mode=mode)
        page.wait("frame", last=True)
        space = {}
        exec(session.code().replace('image.save("picture.png")', ""), space)
        image = session.picture()
        assert frames.levels(space["image"], (0, 0, 0)).tolist() == frames.levels(image, (0, 0, 0)).tolist(), mode


def test_logarithms_of_all_times_are_above_one_number(opened):
    values = 10.0 ** (6 * volume()[::2, ::2, ::2] / volume().max())
    session = opened(times=[values, 100 * values], log=True)
    first = session.scene().fields[0].quantity.floor
    page = Page(session)
    page.wait("about")
    page.set(time=1)
    assert session.scene().fields[0].quantity.floor == first
    page.set(mode="xray")
    assert session.scene().fields[0].quantity.floor is None


def test_sums_along_rays_are_of_values_whose_logarithms_are_shown(opened):
    values = 10.0 ** (6 * volume()[::2, ::2, ::2].astype(np.float32) / volume().max())
    session = opened(values, log=True)
    assert session.scene().fields[0].quantity.floor is not None
    page = Page(session)
    page.set(mode="xray")
    page.wait("frame", last=True)
    assert np.array_equal(session.scene().fields[0].values, values)
    assert session.scene().scalar_colors.log


@pytest.mark.parametrize("first", ["composite", "xray"])
def test_particles_are_sums_in_x_rays_alone(opened, first):
    rng = np.random.default_rng(3)
    ones = np.ones(50)
    kernels = ss.fit.sph(rng.random((50, 3)), ones, 0.5 * ones, masses=ones, densities=ones)
    session = opened(kernels, mode=first)
    page = Page(session)
    for mode in (first, "xray", "composite", "mip", "xray"):
        page.set(mode=mode)
        page.wait("frame", last=True)
        assert session.scene().fields[0].normalization == ("none" if mode == "xray" else "threshold"), mode


def test_scattered_data_and_their_code(opened):
    rng = np.random.default_rng(3)
    data = {"x": rng.random(200), "y": rng.random(200), "z": rng.random(200), "value": rng.random(200)}
    session = opened(data)
    page = Page(session)
    assert sum(page.wait("state")[0]["data"]["groups"][0]["counts"]) == 200
    page.set(look={"group": 0, "opacity": [[0, 0], [1, 0.2]]})
    page.wait("frame", last=True)
    assert np.array_equal(made_by(session.code(), data).rgba, session.picture().rgba)


def test_scenes_are_saved_and_viewed_again(opened, tmp_path):
    np.save(tmp_path / "data.npy", volume())
    session = opened(tmp_path / "data.npy")
    page = Page(session)
    page.wait("about")
    page.set(**{name: CHANGES[name] for name in ("camera", "clip", "lights", "look", "depth_cue")})
    page.wait("frame", last=True)
    page.clear()
    page.say(type="scene")
    message, payload = page.wait("file")
    assert message["name"] == "data.toml"
    (tmp_path / "scene.toml").write_bytes(payload)
    expected = session.picture(SIZE).rgba
    assert np.array_equal(ss.SceneFile.read(tmp_path / "scene.toml").render(size=SIZE).rgba, expected)
    again = opened(tmp_path / "scene.toml", backend=None, threads=None)
    assert np.array_equal(again.picture(SIZE).rgba, expected)
    other = Page(again)
    assert other.wait("state")[0]["state"]["clip"]["box"] == [[0, 0, 0], [13, 13, 9]]
    # Data that are no file are to be given.
    text = opened(volume()).scene_file().to_toml()
    assert "file" not in text
    plain = opened(volume())
    drawn = ss.SceneFile.parse(text).render(plain.scene().fields[0]).rgba
    assert np.array_equal(drawn, plain.picture(SIZE).rgba)


def test_large_volumes_are_coarse_while_the_view_moves(opened, monkeypatch):
    monkeypatch.setattr(coarse, "_MANY", 4000)
    monkeypatch.setattr(coarse, "_FEW", 1000)
    monkeypatch.setattr(previews, "_SLOW", 0.0)
    session = opened(volume(n=24), shading=True)
    page = Page(session)
    page.wait("frame", last=True)
    assert not any(message.get("stage") == 0 for message, _ in page.messages)
    page.set(camera=CHANGES["camera"])
    preview, payload = page.wait("frame", stage=0)
    assert preview["size"] == [SIZE[0] // 2, SIZE[1] // 2] and not preview["last"]
    message, exact = page.wait("frame", last=True)
    assert message["number"] > preview["number"]
    # The first view may have had one more, on its way when the messages were cleared.
    preview, payload = [
        one for one in page.messages if one[0].get("stage") == 0 and one[0]["number"] < message["number"]
    ][-1]
    small = np.asarray(Pillow.open(io.BytesIO(exact)).convert("RGB").resize(preview["size"]), float)
    assert np.abs(picture_of(preview, payload) - small).mean() < 12


def test_coarse_copies_are_means_where_the_data_are():
    values = np.random.default_rng(1).random((121, 118, 125)).astype(np.float32)
    field = ss.RegularField(values, spacing=(1, 2, 3), origin=(5, 6, 7))
    (found,) = coarse.coarse_fields([field])
    assert found.spacing == (2, 4, 6) and found.origin == (5.5, 7, 8.5) and found.shape == (60, 59, 62)
    assert np.isclose(found.values[3, 4, 5], values[6:8, 8:10, 10:12].mean())
    assert np.isclose(found.values[59, 58, 61], values[118:120, 116:118, 122:124].mean())
    assert coarse.coarse_fields([ss.RegularField(volume())]) is None


def test_coarse_copies_of_bricks_have_their_axes():
    axes = np.array(((0.6, 0.0, 0.0), (-0.25, 0.7, 0.0), (0.2, -0.3, 0.9)))
    bricked = ss.open_bricks(np.arange(60**3, dtype=np.float32).reshape(60, 60, 60), axes=axes, origin=(1, 2, 3))
    (found,) = coarse.coarse_fields([bricked])
    steps = np.diag([one // two for one, two in zip(bricked.shape[::-1], found.shape[::-1], strict=True)])
    assert np.allclose(found.axes, steps @ axes) and found.origin == bricked.origin


def test_what_is_shown_must_be_said_once(tmp_path):
    for given in ((None, {}, None, None), (volume(), {}, [volume()], None), (None, {}, [], None)):
        with pytest.raises(ss.InvalidInput):
            Shown(*given)
    with pytest.raises(ss.InvalidInput, match="outputs"):
        Shown(volume(), {"outputs": ("depth",)}, None, None)
    with pytest.raises(ss.InvalidInput, match="port"):
        ss.view(volume(), port=70000)
    with pytest.raises(TypeError, match="quality"):
        ss.view(volume(), qualty="good")
    with pytest.raises(ss.Error, match="nothing.npy"):
        ss.view(tmp_path / "nothing.npy")


def in_bricks(kind):
    if kind == "volume":
        return ss.open_bricks(volume(n=20), brick=8)
    table = dict(zip("xyz", np.random.default_rng(1).normal(size=(3, 60)), strict=True))
    return ss.open_bricks({**table, "radius": np.full(60, 0.4), "value": np.arange(60.0)}, brick_kernels=20)


@pytest.mark.parametrize("kind", ["volume", "kernels"])
def test_data_in_bricks_are_coarse_at_once_and_whole_when_the_view_rests(opened, kind):
    bricked = in_bricks(kind)
    session = opened(bricked)
    page = Page(session)
    page.wait("state")
    first, _ = page.wait("frame", stage=0)
    last, payload = page.wait("frame", last=True)
    assert first["number"] < last["number"] and not first["last"]
    np.testing.assert_array_equal(picture_of(last, payload), frames.levels(ss.render(bricked, size=SIZE), (0, 0, 0)))
    # While the view turns nothing is drawn but coarse pictures.
    page.clear()
    for azimuth in (10, 20, 30):
        camera = state_module.camera_parts(session.shown.camera(session.scene(), SIZE, azimuth=azimuth))
        page.say(type="set", changes={"camera": {**camera, "eye": list(camera["eye"])}})
    page.wait("frame", last=True)
    page.wait("about")
    assert sum(one["type"] == "frame" and one["last"] for one, _ in page.messages) == 1
    page.say(type="pick", x=0.5, y=0.5, purpose="tell")
    assert (page.wait("picked")[0]["value"] is None) == (kind == "kernels")
    page.say(type="measure", what="effects")
    assert "data in bricks" in page.wait("error")[0]["text"]
    assert page.wait("measured")[0]["stopped"]
    page.set(mode="mip")
    page.wait("frame", last=True)
    assert session.picture().plan.slices > 0
    page.set(mode="composite", shadows=True, gradient_opacity=20.0)
    assert "shadows" in page.wait("error")[0]["text"]


@pytest.mark.slow
def test_a_cluster_draws_what_a_viewer_shows(opened):
    distributed = pytest.importorskip("distributed")
    with (
        distributed.LocalCluster(
            n_workers=1, threads_per_worker=1, processes=True, dashboard_address=None, silence_logs=50
        ) as made,
        distributed.Client(made, set_as_default=False) as client,
    ):
        bricked = ss.open_bricks(volume(n=20), brick=8, client=client)
        session = opened(bricked, client=client)
        page = Page(session)
        last, payload = page.wait("frame", last=True)
        alone = frames.levels(ss.render(ss.RegularField(volume(n=20)), size=SIZE, backend="cpu"), (0, 0, 0))
        np.testing.assert_allclose(picture_of(last, payload), alone, atol=1)
        assert session.picture().stats["workers"] == 1
        pytest.importorskip("imageio_ffmpeg", reason="imageio-ffmpeg is not installed")
        page.say(type="film", width=32, height=24, what="turn", frames=2, fps=5, kind="gif")
        assert page.wait("file")[1][:3] == b"GIF"
        session.close()


def test_the_page_lets_choose_among_the_arrays_of_a_file(opened, tmp_path):
    rows = [f"{x},{y},{z},2,{x + y},{10 * z}" for x in range(4) for y in range(4) for z in range(4)]
    path = tmp_path / "points.csv"
    path.write_text("x,y,z,radius,density,heat\n" + "\n".join(rows) + "\n")
    session = opened(path)
    page = Page(session)
    told = page.wait("state")[0]["data"]
    assert told["title"] == "points.csv" and told["names"][0] == "density" and "heat" in told["names"]
    page.wait("about")
    camera = session.state.camera
    page.set(choice=told["names"].index("heat"))
    message, payload = page.wait("frame", last=True)
    expected = ss.render(path, scalar="heat", camera=camera, size=SIZE, backend="cpu", threads=1)
    assert np.array_equal(picture_of(message, payload), frames.levels(expected, (0.0, 0.0, 0.0)))
    assert session.state.camera == camera and "scalar='heat'" in session.code().replace('"', "'")
    assert message["bars"][0]["label"].startswith("heat")
    assert not opened(path, scalar="heat").shown.names


def test_after_a_coarse_copy_what_was_soon_complete_is_drawn_at_once(opened, monkeypatch):
    monkeypatch.setattr(coarse, "_MANY", 4000)
    monkeypatch.setattr(coarse, "_FEW", 1000)
    monkeypatch.setattr(previews, "_SLOW", 0.0)
    monkeypatch.setattr(previews, "_AFTER_COPY", 1e-6)
    session = opened(volume(n=24), shadows=True)
    page = Page(session)
    page.wait("about")
    stages = []
    for turn, soon in enumerate((0.0, 1e9)):
        monkeypatch.setattr(previews, "_SOON", soon)
        page.set(camera={**CHANGES["camera"], "fov_y": 30 + turn})
        page.wait("frame", stage=0)
        page.wait("about")
        stages.append(page.wait("frame", last=True)[0]["stages"])
    assert stages[0] > 1 == stages[1]

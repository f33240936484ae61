"""Scene files: what they say makes the same picture, and what is wrong in them is told with its line."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import pytest
from command_line import run
from hypothesis import given, settings
from hypothesis import strategies as st

import sheetsplat as ss
from sheetsplat.describe.scene_file import SECTIONS, options_of
from sheetsplat.describe.toml import document, lines_of_keys
from sheetsplat.io.pictures import read_picture
from sheetsplat.options.core import definitions
from sheetsplat.options.picture import RenderOptions

SMALL = {"size": (20, 16), "backend": "reference"}
HEAD = 'format = 1\npicture = {size = [20, 16]}\nrenderer = {backend = "reference"}\n'


def write(folder: Path, text: str) -> Path:
    path = folder / "scene.toml"
    path.write_text(HEAD + text, encoding="utf-8")
    return path


def test_every_option_of_a_picture_is_in_one_section():
    names = [name for section in SECTIONS for name in options_of(section)]
    assert len(names) == len(set(names))
    # Functions, objects that replace groups, clusters, arrays beside the picture and depths of one view are no part of
    # a scene.
    others = {"outputs", "progress", "camera", "renderer", "depth_limit", "client", "worker_timeout"}
    assert set(definitions(RenderOptions)) - set(names) == others


LOOKS = {
    "nothing": ("", {}),
    "colours": ('[look]\ncmap = ["black", "#ff8000"]\nopacity = [[40, 0.0], [150, 0.5]]\nclim = [0, 200]\n', {
        "cmap": ["black", "#ff8000"], "opacity": [(40, 0.0), (150, 0.5)], "clim": (0, 200)}),
    "surface": ('[look]\nmode = "isosurface"\niso_value = [[50, 0.3], [120, 1]]\n', {
        "mode": "isosurface", "iso_value": [(50, 0.3), (120, 1)]}),
    "objects": (
        '[look]\nclip = {planes = [[[1, 0, 0], 5]]}\ndepth_cue = "auto"\nambient_occlusion = {radius = 3.0}\n'
        '[light]\nbackground = "white"\nmaterial.specular = 0.5\n[[light.lights]]\ndirection = [1, 2, 3]\n'
        'space = "world"\n',
        {"clip": ss.Clip(planes=[((1, 0, 0), 5)]), "depth_cue": "auto", "background": "white",
         "ambient_occlusion": ss.AmbientOcclusion(3.0), "material": ss.Material(specular=0.5),
         "lights": [ss.Light((1, 2, 3), space="world")]},
    ),
    "scalar": ('[look]\nmode = "xray"\nlog_scale = true\n', {"mode": "xray", "log_scale": True}),
    "quality": ('[picture]\nquality = "draft"\nsize = [20, 16]\n', {"quality": "draft"}),
    "camera": ('[camera]\nazimuth = 20\nprojection = "perspective"\nzoom = 1.5\n', {
        "azimuth": 20, "projection": "perspective", "zoom": 1.5}),
    "eye": ('[camera]\neye = [30, 10, 5]\ntarget = [8, 7, 6]\nup = [0, 0, 1]\nheight = 20\n', {
        "camera": ss.Camera.orthographic((30, 10, 5), (8, 7, 6), (0, 0, 1), height=20)}),
    "off-axis": (
        '[camera]\nprojection = "perspective"\neye = [30, 10, 5]\ntarget = [8, 7, 6]\nup = [0, 0, 1]\nfov_y = 40\n'
        "shift = [0.2, -0.1]\n",
        {"camera": ss.Camera.perspective((30, 10, 5), (8, 7, 6), (0, 0, 1), fov_y=40, shift=(0.2, -0.1))},
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", LOOKS)
def test_a_file_makes_the_picture_of_its_keywords(tmp_path, volume, name):
    text, options = LOOKS[name]
    head = 'format = 1\nrenderer = {backend = "reference"}\n' if name == "quality" else HEAD
    path = tmp_path / "scene.toml"
    path.write_text(f'{head}[data]\nfile = "{volume.name}"\nspacing = [1, 2, 1]\n{text}', encoding="utf-8")
    wanted = ss.render(volume, spacing=(1, 2, 1), **SMALL, **options)
    scene = ss.SceneFile.read(path)
    assert scene.render() == wanted
    # What is written says the same, in another folder too.
    other = tmp_path / "other" / "again.toml"
    other.parent.mkdir()
    scene.save(other)
    assert ss.SceneFile.read(other) == scene
    assert ss.SceneFile.read(other).render() == wanted
    written = ss.SceneFile.of_options(volume, spacing=(1, 2, 1), **SMALL, **options)
    assert written.render() == wanted


@pytest.mark.parametrize("name", LOOKS)
def test_a_picture_is_written_as_a_scene_that_makes_it_again(tmp_path, volume, name):
    image = ss.render(volume, **SMALL, **LOOKS[name][1])
    path = tmp_path / "exact.toml"
    ss.SceneFile.of(image, volume).save(path)
    again = ss.SceneFile.read(path)
    assert again.is_exact and again.files == (volume,)
    assert np.array_equal(again.render().pixels, image.pixels, equal_nan=True)
    assert again.camera == image.camera


def test_values_of_numpy_and_objects_are_written_as_plain_ones(tmp_path):
    raw = tmp_path / "a.raw"
    np.arange(27, dtype=np.uint8).tofile(raw)
    colors = ss.ScalarColors("magma", (0, 9))
    options = {"dtype": np.uint8, "shape": (3, 3, 3), "mode": "xray", "scalar_colors": colors, "zoom": np.float64(1.5)}
    text = ss.SceneFile.of_options(raw, **SMALL, **options).to_toml()
    assert 'dtype = "|u1"' in text and "zoom = 1.5" in text
    found, expected = ss.SceneFile.parse(text).render(), ss.render(raw, **SMALL, **options)
    assert np.array_equal(found.pixels, expected.pixels)


def test_several_fields_and_what_was_left_out_are_kept(tmp_path, volume):
    points = tmp_path / "points.npz"
    rng = np.random.default_rng(3)
    centers = rng.normal(8, 2, (40, 3))
    centers[7] = 1e4
    ss.io.save_npz(ss.EllipsoidField(centers, rng.uniform(0.5, 1.5, 40), values=200 * rng.random(40)), points)
    with pytest.warns(ss.PictureWarning, match="left out"):
        alone = ss.render(points, **SMALL)
    exact = ss.SceneFile.of(alone, points)
    assert "trim = {kernels = [7]" in exact.to_toml()
    assert np.array_equal(exact.render().pixels, alone.pixels)
    look = ss.TransferFunction.from_colormap("viridis", (0, 0.5), (0, 200))
    fields = [ss.open(volume), ss.open(points), ss.open(volume)]
    scene = ss.Scene([[fields[0], fields[1]], fields[2]], [look, look])
    camera = ss.Camera.fit(fields[0])
    image = ss.Renderer("reference").render(scene, camera, size=(12, 12))
    text = ss.SceneFile.of(image, [volume, points, volume]).to_toml()
    assert np.array_equal(ss.SceneFile.parse(text).render().pixels, image.pixels)
    # Data in memory take the place of files.
    assert np.array_equal(ss.SceneFile.of(image).render(fields).pixels, image.pixels)


def test_options_replace_those_of_the_file(tmp_path, volume):
    path = write(tmp_path, f'[data]\nfile = "{volume.name}"\n[look]\nclim = [0, 100]\ncmap = "magma"\n')
    scene = ss.SceneFile.read(path)
    assert scene.render(cmap="gray", size=8) == ss.render(
        volume, clim=(0, 100), cmap="gray", size=8, backend="reference"
    )
    points = [(0, 1, 1, 1, 0), (200, 1, 0, 0, 1)]
    assert scene.render(transfer_function=points) == ss.render(volume, transfer_function=points, **SMALL)
    exact = ss.SceneFile.of(scene.render(), volume)
    with pytest.raises(ss.InvalidInput, match="transfer_function"):
        exact.render(cmap="gray")
    with pytest.raises(ss.InvalidInput, match="camera"):
        exact.render(azimuth=3)


def test_command_line(tmp_path, volume, monkeypatch):
    monkeypatch.chdir(tmp_path)
    direct, scene, again = tmp_path / "direct.png", tmp_path / "look.toml", tmp_path / "look.png"
    options = ["--cmap", "magma", "--size", "20x16", "--azimuth", "30", "--backend", "reference", "--clip-box",
               "0,0,0,20,7,20"]  # fmt: skip
    run("render", volume, "-o", direct, *options)
    run("render", volume, "-o", scene, *options)
    run("render", scene)
    assert again.read_bytes() == direct.read_bytes()
    run("render", scene, volume, "--size", "8", "-o", again)
    assert ss.Recipe.read(again).size == (8, 8)
    exact = tmp_path / "exact.toml"
    run("render", direct, volume, "-o", exact)
    run("render", exact, "-o", again)
    assert np.array_equal(read_picture(again), read_picture(direct))
    assert "elimination" in run("plan", scene).output
    assert "line" in run("render", write(tmp_path, "[look]\ncmpa = 1\n"), code=1).output
    assert "--output" in run("render", volume, code=2).output


# What is wrong, on which line after the head, and words of the message.
WRONG = {
    "[look]\nopactiy = 0.5": (5, "did you mean opacity"),
    "[lok]\nopacity = 0.5": (4, "did you mean look"),
    "[look]\n\n# words\nopacity = {a = 1}": (7, "opacity"),
    '[look]\nmode = "isosurfaces"': (5, "did you mean isosurface"),
    "[look]\nslice_spacing = -1": (5, "above 0"),
    "[look]\nslice_spacing = true": (5, "float"),
    "[look]\nslice_spacing = nan": (5, "float"),
    "[data]\nspacing = [1, 0, 1]": (5, "above 0"),
    "[look]\nslice_spacing = 1979-05-27": (5, "float"),
    "[look]\nclip = {plane = []}": (5, "did you mean planes"),
    "[look]\nclip = {box = [[1, 2, 3], [0, 0, 0]]}": (5, "two corners"),
    "[look]\nambient_occlusion = {}": (5, "radius"),
    "[[light.lights]]\ndirection = [0, 0, 1]\n[[light.lights]]\ndirection = [0, 0]": (7, "three numbers"),
    "[light]\nlights = 3": (5, "tables"),
    "[light]\nlights = {}": (5, "array of tables"),
    "[camera]\neye = [1, 2, 3]": (5, "target"),
    "[camera]\neye = [1, 2, 3]\ntarget = [1, 2, 3]\nheight = 1": (4, "eye"),
    "[camera]\nheight = 3": (5, "eye"),
    "[camera]\neye = [1, 2, 3]\ntarget = [0, 0, 0]\nheight = 1\nfov_y = 3": (8, "height"),
    "[camera]\nfov_y = 200": (5, "below 180"),
    "[camera]\nzoom = 1" + "0" * 400: (5, "zoom"),
    '[data]\nfile = ""': (5, "path"),
    '[data]\nfile = "a\\u0000b"': (5, "path"),
    "[data]\ngroup = 1": (5, "exact"),
    '[[data]]\nfile = "a"\n[[data]]\nfile = "b"\nshape = [1, 2]': (8, "shape"),
    "[data]\noffset = -3": (5, "offset"),
    "[look.opacity]\na = 1": (4, "opacity"),
    "data = 3": (4, "table"),
}


@pytest.mark.parametrize("text", WRONG)
def test_what_is_wrong_is_told_with_its_line(tmp_path, text):
    line, words = WRONG[text]
    with pytest.raises(ss.InvalidInput) as caught:
        ss.SceneFile.read(write(tmp_path, text))
    assert f"scene.toml, line {line}: " in str(caught.value)
    assert words in str(caught.value)


def test_what_only_the_picture_shows_is_told_with_its_line(tmp_path, volume):
    text = f'[data]\nfile = "{volume.name}"\n[look]\ncmap = "virids"\n'
    with pytest.raises(ss.InvalidInput, match="line 7: cmap.*did you mean viridis"):
        ss.SceneFile.read(write(tmp_path, text)).render()


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "format"),
        (b"format = 2", "line 1"),
        (b"format = true", "line 1"),
        (b"format = 1\n[look", "TOML"),
        (b'format = 1\n[data]\nfile = "abc', "TOML"),
        (b"format = 1\nformat = @\n", "line 2"),
        (b"\xff\xfe", "UTF-8"),
        (b"a = " + b"[" * 5000 + b"]" * 5000, "nested"),
        (b"#" * ((1 << 20) + 1), "bytes"),
    ],
)
def test_files_that_are_no_scene(tmp_path, content, words):
    path = tmp_path / "scene.toml"
    path.write_bytes(content)
    with pytest.raises(ss.InvalidInput, match=words):
        ss.SceneFile.read(path)


def test_files_that_cannot_be_read_or_written(tmp_path, volume):
    for path in (tmp_path / "none.toml", tmp_path, Path("/dev/zero")):
        with pytest.raises(ss.Error, match="no such file"):
            ss.SceneFile.read(path)
    scene = ss.SceneFile.of_options(volume, **SMALL)
    with pytest.raises(ss.InvalidInput, match="suffix"):
        scene.save(tmp_path / "scene.txt")
    with pytest.raises(ss.Error, match="written"):
        scene.save(tmp_path / "no" / "scene.toml")
    with pytest.raises(ss.InvalidInput, match="text"):
        ss.SceneFile.of_options("bad\udcff.npy").save(tmp_path / "scene.toml")
    assert list(tmp_path.glob("*")) == [volume]
    for options in ({"cmap": lambda shares: shares}, {"progress": print}, {"outputs": ("depth",)}):
        with pytest.raises(ss.InvalidInput) as caught:
            ss.SceneFile.of_options(volume, **options)
        assert caught.value.option in options
    with pytest.raises(ss.InvalidInput, match="names no file"):
        ss.SceneFile.of_options(**SMALL).render()
    with pytest.raises(ss.InvalidInput, match="2 data"):
        scene.render([volume, volume])


def test_a_truncated_file_is_refused_or_says_less(tmp_path, volume):
    text = ss.SceneFile.of(ss.render(volume, **SMALL), volume).to_toml()
    whole, refused = ss.SceneFile.parse(text), 0
    for end in (*range(0, len(text), len(text) // 12), *range(len(text) - 450, len(text), 7)):
        try:
            said = ss.SceneFile.parse(text[:end])
            said.render(size=(4, 3))
        except ss.Error:
            refused += 1
            continue
        # The end may be that of a number or of a table.
        assert sum(value != whole.options.get(name) for name, value in said.options.items()) <= 1
    assert refused > 40


_NAMES = st.text(min_size=1, max_size=4) | st.sampled_from(["a", "b", "c"])
_VALUES = st.recursive(
    st.booleans() | st.integers(-(10**9), 10**9) | st.floats(allow_nan=False) | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(_NAMES, inner, max_size=3),
    max_leaves=8,
)


def places(value, place=()):
    """Yield the places of all keys, and of tables in arrays."""
    if isinstance(value, dict):
        for key, one in value.items():
            yield (*place, key)
            yield from places(one, (*place, key))
    elif isinstance(value, list):
        for number, one in enumerate(value):
            yield from [(*place, number)] * isinstance(one, dict)
            yield from places(one, (*place, number))


@settings(max_examples=60, deadline=None)
@given(st.dictionaries(_NAMES, _VALUES, max_size=4))
def test_documents_are_read_as_they_were_written_and_every_key_has_a_line(tables):
    text = document(tables)
    assert tomllib.loads(text) == tables
    lines = lines_of_keys(text)
    rows = text.split("\n")
    for place in places(tables):
        key = place[-1]
        assert place in lines
        if isinstance(key, str) and key.isascii() and key.isalnum():
            assert key in rows[lines[place] - 1]


def test_lines_of_unusual_documents():
    text = (
        '# words = 1\na."b c".d = """x\n[no]\n""""\n[ t ] # [x]\n\'k\' = [ # ]\n  {m = 1, n.o = \'\'\'\n]\'\'\'},\n'
        "  2,\n]\n[[t.u]]\nv = 1979-05-27 07:32:00\n[[t.u]]\nw = 0x1F\n[t.u.x]\ny = -inf\r\nz = 1_0.5e+3\n"
    )
    tomllib.loads(text)
    wanted = {
        ("a",): 2, ("a", "b c"): 2, ("a", "b c", "d"): 2, ("t",): 5, ("t", "k"): 6, ("t", "k", 0): 7,
        ("t", "k", 0, "m"): 7, ("t", "k", 0, "n"): 7, ("t", "k", 0, "n", "o"): 7, ("t", "u"): 11, ("t", "u", 0): 11,
        ("t", "u", 0, "v"): 12, ("t", "u", 1): 13, ("t", "u", 1, "w"): 14, ("t", "u", 1, "x"): 15,
        ("t", "u", 1, "x", "y"): 16, ("t", "u", 1, "x", "z"): 17,
    }  # fmt: skip
    assert lines_of_keys(text) == wanted


def test_colours_of_labels_are_written_and_those_of_another_field_refused(tmp_path):
    labels = np.zeros((9, 9, 9), np.uint8)
    labels[2:7, 2:7, 2:5], labels[2:7, 2:7, 5:7] = 1, 4
    np.save(tmp_path / "labels.npy", labels)
    colors = ss.LabelColors({4: ("tomato", 0.5), 1: "gold"}, names={4: "a\n\x1b", 1: "b"})
    options = {"labels": True, "transfer_function": colors, **SMALL}
    image = ss.render(tmp_path / "labels.npy", **options)
    of_options = ss.SceneFile.of_options(tmp_path / "labels.npy", **options)
    for number, scene in enumerate((of_options, ss.SceneFile.of(image, tmp_path / "labels.npy"))):
        path = tmp_path / f"{number}.toml"
        scene.save(path)
        again = ss.SceneFile.read(path).render()
        assert np.array_equal(again.rgba, image.rgba) and again.recipe.transfer_functions == (colors,)
    bad = "[look]\ntransfer_function = {colors = {x = [1, 0, 0, 1]}, names = {}, background = 0}"
    with pytest.raises(ss.InvalidInput, match="line 5: transfer_function"):
        ss.SceneFile.read(write(tmp_path, bad))
    colored = ss.render(labels, labels=False, color_by=labels[::-1], **SMALL)
    with pytest.raises(ss.InvalidInput, match="colours of another field"):
        ss.SceneFile.of(colored)


@pytest.mark.parametrize(
    "colors",
    [
        ss.TransferFunction([(0, 1, 0, 0, 1), (60, 0, 0.5, 1, 1)]),
        ss.LabelColors({0: "red", 40: "blue"}, names={40: "b"}),
    ],
)
def test_transfer_functions_of_another_field_are_written(tmp_path, colors):
    z, y, x = np.mgrid[-1:1:9j, -1:1:9j, -1:1:9j]
    np.save(tmp_path / "a.npy", 9.0 * np.exp(-(x**2 + y**2 + z**2)))
    np.save(tmp_path / "b.npy", 40.0 * (x > 0))
    options = {"color_by": tmp_path / "b.npy", "color_map": colors, **SMALL}
    image = ss.render(tmp_path / "a.npy", **options)
    ss.SceneFile.of_options(tmp_path / "a.npy", **options).save(tmp_path / "a.toml")
    again = ss.SceneFile.read(tmp_path / "a.toml").render()
    assert again.recipe.colors == image.recipe.colors and np.array_equal(again.rgba, image.rgba)
    assert not np.array_equal(image.rgba, ss.render(tmp_path / "a.npy", **{**options, "color_map": None}).rgba)


def test_colours_at_values_of_another_field_go_through_a_scene_file_of_the_command_line(tmp_path):
    np.save(tmp_path / "a.npy", np.arange(216.0).reshape(6, 6, 6))
    colors = "0:red,90:#ff8000,200:white"
    of = [tmp_path / "a.npy", "--color-by", tmp_path / "a.npy", "--color-map", colors, "--size", 16]
    run("render", *of, "-o", tmp_path / "a.toml")
    run("render", *of, "-o", tmp_path / "a.png")
    run("render", tmp_path / "a.toml", "-o", tmp_path / "b.png")
    assert np.array_equal(read_picture(tmp_path / "a.png"), read_picture(tmp_path / "b.png"))


def test_tables_that_are_no_colours_of_another_field_are_told(tmp_path):
    with pytest.raises(ss.InvalidInput, match="line 5: color_map cannot be used"):
        ss.SceneFile.read(write(tmp_path, "[look]\ncolor_map = {x = 1}"))

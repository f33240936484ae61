"""What `quality` sets, what it leaves alone, and that the plan says both."""

from __future__ import annotations

import json
import logging
import pickle
from functools import cache

import numpy as np
import pytest
from command_line import run

import sheetsplat as ss
from sheetsplat import _memory
from sheetsplat.errors import OutOfMemory
from sheetsplat.options.quality import QUALITIES
from sheetsplat.quality import samples
from sheetsplat.quality.samples import LARGEST_NOISE, noise_of, through_samples
from sheetsplat.quality.slicing import slicing_error

SMALL = {"size": (20, 16), "backend": "cpu"}
MODES = ["composite", "isosurface", "xray", "mip", "minimum", "average"]
# Options that a quality sets, and values that it never chooses.
OWN = {
    "radius": 2.2,
    "falloff": 5.5,
    "prefilter": False,
    "slice_spacing": 0.7,
    "opacity_stop": 0.9,
    "filter": "ewa",
    "supersampling": 3,
}


@pytest.fixture(scope="module")
def smooth() -> np.ndarray:
    """Return a smooth shell in floats, without noise."""
    k, j, i = np.mgrid[-1:1:20j, -1:1:22j, -1:1:24j]
    return np.exp(-12 * (np.sqrt(k**2 + j**2 + i**2) - 0.55) ** 2).astype(np.float32)


@pytest.fixture(scope="module")
def particles() -> ss.EllipsoidField:
    """Return spheres that overlap and are larger than pixels and slice distances."""
    rng = np.random.default_rng(7)
    return ss.EllipsoidField(rng.normal(size=(200, 3)), 0.9, values=rng.uniform(1, 2, 200))


def told(image: ss.Image) -> dict[str, ss.QualitySetting]:
    """Return what the plan of a picture says of its quality, by option."""
    assert image.plan.quality is not None
    return {one.option: one for one in image.plan.quality.settings}


def test_what_each_quality_sets(smooth):
    # Unlit: how many slices light calls for depends on the data.
    found = {name: ss.render(smooth, quality=name, shading=False, **SMALL) for name in QUALITIES}
    values = {name: {option: one.value for option, one in told(image).items()} for name, image in found.items()}
    common = {"filter": "off", "supersampling": 1}
    assert values == {
        "draft": {"prefilter": False, "radius": 2, "falloff": 5, "slice_spacing": 1, "opacity_stop": 0.98, **common},
        "good": {"prefilter": True, "radius": 2, "falloff": 5, "slice_spacing": 0.5, "opacity_stop": 0.995, **common},
        "best": {
            "prefilter": True,
            "radius": 2.5,
            "falloff": 7,
            "slice_spacing": 1 / 3,
            "opacity_stop": 0.999,
            **common,
        },
    }
    for name, image in found.items():
        assert image.plan.slice_spacing == values[name]["slice_spacing"]
        assert image.recipe.options["opacity_stop"] == values[name]["opacity_stop"]
        (field,) = image.recipe.fields
        assert [field.options[one] for one in ("prefilter", "radius", "falloff")] == [
            values[name][one] for one in ("prefilter", "radius", "falloff")
        ]
        assert not any(one.given for one in told(image).values()) and all(one.reason for one in told(image).values())
        assert image.plan.quality.name == name and str(told(image)["slice_spacing"]) in str(image.plan)
        assert image.plan.to_dict()["quality"]["name"] == name
    assert ss.render(smooth, shading=False, **SMALL) == found["good"]
    # The looks are the same: opacities refer to the same length.
    assert len({image.clim for image in found.values()}) == 1
    means = [float(image.rgba[..., 3].mean()) for image in found.values()]
    assert max(means) - min(means) < 0.05 * max(means)


@pytest.fixture(scope="module")
def plain_of(smooth):
    """Return what the plan says of a quality where no option is given, by the quality's name."""
    return cache(lambda name: told(ss.render(smooth, quality=name, **SMALL)))


@pytest.mark.parametrize("name", QUALITIES)
@pytest.mark.parametrize("option", OWN)
def test_an_option_that_is_given_wins(smooth, plain_of, name, option):
    image = ss.render(smooth, quality=name, **{option: OWN[option]}, **SMALL)
    plain = plain_of(name)
    for other, setting in told(image).items():
        kernel = {"radius", "falloff"}
        given = other == option or ({other, option} <= kernel)
        assert setting.given == given and ("as given" in setting.reason) == given
        if other == option:
            assert setting.value == OWN[option]
        elif option not in kernel | {"prefilter"}:
            assert setting == plain[other]
    # A kernel is given as a whole: what is left out is that of the plain one.
    if option in ("radius", "falloff"):
        assert {told(image)[one].value for one in ("radius", "falloff")} == {
            OWN[option],
            5.0 if option == "radius" else 2.0,
        }


def test_no_filter_is_a_word_too(smooth):
    for word in (None, "off"):
        assert told(ss.render(smooth, filter=word, **SMALL))["filter"].given
    assert not told(ss.render(smooth, filter="auto", quality="draft", **SMALL))["filter"].given
    with pytest.raises(ss.InvalidInput, match="knows the camera"):
        ss.Scene(ss.RegularField(smooth), [(0, 1, 1, 1, 0), (1, 1, 1, 1, 1)], filter="auto")
    with pytest.raises(ss.InvalidInput, match="did you mean ewa"):
        ss.render(smooth, filter="ewaa", **SMALL)


def test_unknown_words_are_answered_with_the_nearest(smooth, tmp_path, volume):
    for call in (
        lambda: ss.render(smooth, quality="god", **SMALL),
        lambda: ss.open(volume, quality="god"),
    ):
        with pytest.raises(ss.InvalidInput, match=r"one of: draft, good, best; did you mean good\?"):
            call()
    assert (
        "'draft', 'good', 'best'" in run("render", volume, "-o", tmp_path / "a.png", "--quality", "bst", code=2).stderr
    )


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("kind", ["volume", "bcc", "particles", "both"])
def test_every_kind_of_data_in_every_mode(smooth, particles, mode, kind):
    data = {
        "volume": smooth,
        "bcc": ss.resample_to_bcc(smooth),
        "particles": particles,
        "both": [ss.RegularField(smooth, spacing=(0.2,) * 3, origin=(-2, -2, -2)), particles],
    }[kind]
    pictures, spacings = {}, []
    for name in QUALITIES:
        backend = "reference" if mode in ("minimum", "average") else "cpu"
        image = ss.render(data, mode=mode, quality=name, size=(16, 12), backend=backend)
        # Where no point of a ray counts there is no number.
        numbers = np.isfinite(image.pixels)
        assert numbers.any() and (numbers.all() or mode in ("mip", "minimum", "average"))
        assert mode == "minimum" or image.pixels[numbers].any()
        assert ("opacity_stop" in told(image)) == (mode == "composite")
        pictures[name] = image.pixels
        spacings.append(image.plan.slice_spacing)
    assert spacings[0] >= spacings[1] >= spacings[2] and (mode != "composite" or spacings[2] < spacings[0])
    scale = max(1.0, float(np.nanmax(np.abs(pictures["best"]))))
    assert np.sqrt(np.nanmean((pictures["good"] - pictures["best"]) ** 2)) < 0.1 * scale


def test_fields_with_a_given_prefilter_keep_their_kernels(smooth):
    made = (ss.RegularField(smooth, prefilter=False), ss.RegularField(smooth, radius=2.5, falloff=7, prefilter=True))
    for field in made:
        image = ss.render(field, quality="best", shading=False, **SMALL)
        assert told(image)["prefilter"] == ss.QualitySetting("prefilter", field.prefilter, "as the field has it", True)
        assert image.recipe.fields[0].options["radius"] == field.radius
        # Plain sums have smaller kernels, and more slices take the same time.
        assert image.plan.slice_spacing == (1 / 3 if field.prefilter else 1 / 6)


def block(noise: float) -> np.ndarray:
    """Return a ball of one value with a soft border, and noise in it."""
    k, j, i = np.mgrid[-1:1:40j, -1:1:40j, -1:1:40j]
    inside = 1.0 / (1.0 + np.exp(12 * (np.sqrt(k**2 + j**2 + i**2) - 0.7)))
    return (inside * (1.0 + noise * np.random.default_rng(3).normal(size=inside.shape))).astype(np.float32)


@pytest.mark.parametrize("noise", [0.1, 0.3])
@pytest.mark.parametrize("kind", ["orthographic", "perspective"])
def test_the_error_of_slices_is_estimated_by_rays(noise, kind):
    field = ss.RegularField(block(noise), prefilter=False)
    image = ss.render(field, slice_spacing=0.5, opacity_stop=1, projection=kind, size=64, backend="cpu")
    found = slicing_error(image.recipe.scene([field]), image.camera, (64, 64))
    assert found == pytest.approx(image.error.budget["slice distance"], rel=0.5)


def test_light_that_is_rough_calls_for_more_slices(smooth):
    """A thin shell has steeper light than a ball."""
    ball, shell = block(0.0), smooth
    spacings = {}
    for name in ("good", "best"):
        for what, values in (("ball", ball), ("shell", shell)):
            image = ss.render(ss.RegularField(values, prefilter=False), quality=name, **SMALL)
            spacings[name, what] = image.plan.slice_spacing
            assert "an estimated error of" in told(image)["slice_spacing"].reason
    # Few slices leave time for more samples a pixel.
    assert spacings["good", "ball"] == 0.5 and spacings["best", "ball"] == 1 / 3
    plain = ss.render(ss.RegularField(ball, prefilter=False), quality="best", supersampling=1, **SMALL)
    assert plain.plan.slice_spacing == 0.25
    assert 1 / 3 <= spacings["good", "shell"] <= 0.5 and 1 / 8 <= spacings["best", "shell"] < 0.25
    assert ss.render(shell, slice_spacing=0.7, **SMALL).plan.slice_spacing == 0.7


def wide_and_thin(wide: int, thin: int, radius: float, value: float, away: float = 0.0) -> ss.EllipsoidField:
    """Return wide spheres of value 1, and more thin ones of another value, among them or beside them."""
    rng = np.random.default_rng(11)
    centers = np.concatenate((rng.uniform(0, 1, (wide, 3)), away + rng.uniform(0.4, 0.6, (thin, 3))))
    radii = np.concatenate((np.full(wide, 0.3), np.full(thin, radius)))
    return ss.EllipsoidField(centers, radii, values=np.where(radii > 0.1, 1.0, value) + 0.1 * centers[:, 0], w0=0.01)


def test_thin_kernels_that_do_not_show_do_not_set_the_slices():
    """They set the default distance of slices; fewer slices are taken where an estimate keeps the error."""
    field = wide_and_thin(300, 400, 0.0015, 0.0)
    options = {"size": 64, "backend": "cpu", "opacity": [(0.5, 0.0), (1.1, 0.3)], "reference_length": 0.1}
    found = {name: ss.render(field, quality=name, **options) for name in QUALITIES}
    slices = [image.plan.slices for image in found.values()]
    assert slices[0] <= 256 < slices[1] <= 512 < slices[2] <= 1024
    assert found["good"].error.rmse < 5e-3 and found["best"].error.rmse < 2e-3
    assert "not those of the thinnest" in told(found["good"])["slice_spacing"].reason
    # An option wins, and so does a goal.
    given = ss.render(field, slice_spacing=0.002, **options)
    assert given.plan.slice_spacing == 0.002
    assert told(ss.render(field, max_error=0.05, **{**options, "size": 8}))["slice_spacing"].reason.startswith(
        "chosen anew"
    )


def test_thin_kernels_that_show_are_met():
    look = {"opacity": [(0.5, 0.0), (1.1, 0.3), (5.5, 0.9)], "clim": (0.5, 5.5), "reference_length": 0.1}
    image = ss.render(wide_and_thin(5, 3000, 0.004, 5.0, away=1.5), size=64, backend="cpu", **look)
    assert image.plan.slices > 1000 and image.plan.slice_spacing <= 0.002


def test_thin_kernels_beside_isosurfaces_do_not_set_the_slices():
    both = wide_and_thin(300, 400, 0.0015, 0.0)
    field = ss.EllipsoidField(both.centers, both.scales, values=both.values, normalization="none")
    options = {"mode": "isosurface", "iso_value": [(0.8, 0.4), (1.4, 1.0)], "size": 64, "backend": "cpu"}
    found = {name: ss.render(field, quality=name, **options) for name in QUALITIES}
    spacings = {name: image.plan.slice_spacing for name, image in found.items()}
    assert spacings["good"] > 8 * field.default_slice_spacing
    assert np.isclose([spacings["draft"], spacings["best"]], spacings["good"] * np.array([1, 0.5])).all()
    assert "not of the thinnest" in told(found["good"])["slice_spacing"].reason
    fine = ss.render(field, slice_spacing=0.25 * found["good"].plan.slice_spacing, **options)
    assert np.sqrt(np.mean((found["good"].rgba - fine.rgba) ** 2)) < 0.01


@pytest.mark.parametrize("value", [3.0, [(1.5, 0.3), (3.0, 0.3)]])
def test_thin_kernels_in_isosurfaces_set_the_slices(value):
    field = wide_and_thin(5, 3000, 0.004, 5.0, away=1.5)
    image = ss.render(field, mode="isosurface", iso_value=value, size=64, backend="cpu")
    assert image.plan.slice_spacing < 0.001


@pytest.mark.parametrize("name", QUALITIES)
def test_fields_that_leave_it_open_are_shown_as_their_array(smooth, name):
    field = ss.RegularField(smooth)
    image, of_array = (ss.render(one, quality=name, **SMALL) for one in (field, smooth))
    assert image == of_array and image.plan.quality == of_array.plan.quality
    assert not field.prefilter and not field.settled
    several = ss.render([field, ss.RegularField(smooth, origin=(5, 0, 0))], quality=name, **SMALL)
    assert [one.options["prefilter"] for one in several.recipe.fields] == 2 * [name != "draft"]
    # Scenes take a field as it is.
    assert not ss.Scene(field, [(0, 1, 1, 1, 0), (1, 1, 1, 1, 1)]).fields[0].prefilter


def test_what_a_field_has_of_its_own_stays(smooth):
    wide = ss.render(ss.RegularField(smooth, radius=2.5, falloff=7), **SMALL)
    assert wide.recipe.fields[0].options["prefilter"] and told(wide)["radius"].given
    assert wide == ss.render(smooth, radius=2.5, falloff=7, **SMALL)
    for own in ("threshold", "none"):
        field = ss.RegularField(smooth, normalization=own)
        setting = told(ss.render(field, **SMALL))["prefilter"]
        assert setting.value is False and setting.given and "normalization as the field has it" in setting.reason
    grains = smooth + np.random.default_rng(1).normal(size=smooth.shape).astype(np.float32)
    assert "is noise" in told(ss.render(ss.RegularField(grains), **SMALL))["prefilter"].reason


def test_whether_a_prefilter_was_given_belongs_to_the_field(smooth):
    field, plain = ss.RegularField(smooth), ss.RegularField(smooth, prefilter=False)
    assert not field.settled and plain.settled and field != plain and field.as_settled() == plain
    assert ss.RegularField(smooth, prefilter=True).settled
    for one in (field, plain):
        for copy in (pickle.loads(pickle.dumps(one)), one.replace(one.values), one.with_quantity("density")):
            assert copy.settled == one.settled
    assert field.replace(prefilter=True).settled and field.is_plain and not plain.is_plain


def test_a_recipe_gives_its_kernels_to_fields_that_leave_them_open(smooth):
    image = ss.render(smooth, quality="best", **SMALL)
    scene = image.recipe.scene([ss.RegularField(smooth)])
    again = ss.Renderer("cpu").render(scene, image.camera, size=(20, 16))
    assert np.array_equal(again.rgba, image.rgba)
    kept = image.recipe.scene([ss.RegularField(smooth, prefilter=False)])
    assert not kept.fields[0].prefilter and kept.fields[0].radius == 2


def test_scenes_keep_everything(smooth):
    scene = ss.Scene(ss.RegularField(smooth), [(0, 1, 1, 1, 0), (1, 1, 1, 1, 0.3)])
    image = ss.render(scene, quality="best", **SMALL)
    assert image == ss.render(scene, **SMALL) and all(one.given for one in told(image).values())
    assert ss.Renderer("cpu").render(scene, image.camera, size=(8, 8)).plan.quality is None


def test_an_error_to_keep_decides_on_slices(smooth):
    image = ss.render(smooth, max_error=0.02, **SMALL)
    assert told(image)["slice_spacing"].reason == "chosen anew by max_error or max_seconds"
    assert told(image)["prefilter"].value is True and image.stats["max_error_kept"] == 1


def test_opened_fields_pass_through_their_samples(smooth, tmp_path, caplog):
    np.save(tmp_path / "a.npy", smooth)
    with caplog.at_level(logging.INFO, "sheetsplat"):
        good = ss.open(tmp_path / "a.npy")
    assert good.prefilter and good.radius == 2 and "quality good: prefilter=True" in caplog.text
    k, j, i = np.mgrid[4:16:5, 4:16:5, 4:16:5].reshape(3, -1)
    assert np.allclose(good.at(np.stack([i, j, k], -1)), smooth[k, j, i], atol=1e-5)
    plain = ss.open(tmp_path / "a.npy", quality="draft")
    assert not plain.prefilter and not np.allclose(plain.at(np.stack([i, j, k], -1)), smooth[k, j, i], atol=1e-3)
    best = ss.open(tmp_path / "a.npy", quality="best")
    assert best.prefilter and (best.radius, best.falloff) == (2.5, 7)
    assert np.array_equal(best.values, smooth) and best.opened == {}
    assert not ss.open(tmp_path / "a.npy", prefilter=False).prefilter
    # Rendered from the file, or from the field that was opened: the same.
    assert np.array_equal(ss.render(tmp_path / "a.npy", **SMALL).rgba, ss.render(good, **SMALL).rgba)


# What must not pass through its samples: how to make it, and the reason.
PLAIN = {
    "noise": (lambda v: v + np.random.default_rng(1).normal(size=v.shape).astype(np.float32), {}, "is noise"),
    "missing": (lambda v: np.where(v > 0.98, np.nan, v), {"nan": "skip"}, "samples are missing"),
    "weights": (lambda v: v, {"normalization": "threshold"}, "normalization as given"),
    "sums": (lambda v: v, {"normalization": "none"}, "normalization as given"),
    "classes": (lambda v: (4 * v).astype(np.uint8), {}, "classes"),
    "kernel": (lambda v: v, {"radius": 3.0, "falloff": 1.0}, "cannot pass through the samples"),
}


@pytest.mark.parametrize("name", ["good", "best"])
@pytest.mark.parametrize("kind", PLAIN)
def test_when_values_do_not_pass_through_the_samples(smooth, name, kind):
    make, options, reason = PLAIN[kind]
    image = ss.render(make(smooth), quality=name, **options, **SMALL)
    setting = told(image)["prefilter"]
    assert setting.value is False and reason in setting.reason and not image.recipe.fields[0].options["prefilter"]


def test_noise_is_measured(smooth):
    """Of white noise of known strength in a smooth volume; the volume itself, planes and edges along axes have none."""
    rng = np.random.default_rng(5)
    noise = rng.normal(size=smooth.shape).astype(np.float32)
    for share in (0.05, 0.2, 1.0):
        strength = share * smooth.std() / np.sqrt(1 - share**2) if share < 1 else 1e6
        assert noise_of(ss.RegularField(smooth + strength * noise)) == pytest.approx(share, rel=0.1)
    assert noise_of(ss.RegularField(smooth)) < 0.1 * LARGEST_NOISE
    k, j, i = np.mgrid[0:12, 0:13, 0:14].astype(float)
    for flat in (3 * k + 2 * j - i + 1e6, (i > 6) * 1.0, np.full((5, 5, 5), 7.0), np.zeros((2, 9, 9))):
        assert noise_of(ss.RegularField(flat)) < 1e-9
    for scale in (1e-300, 1e298):
        assert noise_of(ss.RegularField((smooth.astype(float) + 0.1 * noise) * scale)) == pytest.approx(
            noise_of(ss.RegularField(smooth.astype(float) + 0.1 * noise)), rel=1e-6
        )
    # On a BCC lattice neighbours of a sample are two layers apart.
    signal = ss.datasets.marschner_lobb(40, lattice="bcc")
    assert noise_of(signal.field()) < LARGEST_NOISE
    grains = signal.values + 0.2 * rng.normal(size=signal.values.shape)
    assert noise_of(ss.RegularField(grains, lattice="bcc")) > 2 * LARGEST_NOISE


def test_bytes_are_no_noise(smooth):
    levels = np.round(255 * smooth).astype(np.uint8)
    assert 0 < noise_of(ss.RegularField(levels)) < LARGEST_NOISE
    assert told(ss.render(levels, **SMALL))["prefilter"].value is True


def test_memory_that_is_short(smooth, monkeypatch):
    field = ss.RegularField(smooth)
    monkeypatch.setattr(_memory, "available", lambda: 10 * smooth.size)
    found = through_samples(field, 2.0, 5.0)
    assert found.field is field and "MB" in found.reason
    monkeypatch.undo()

    def refuse(*_, **__):
        raise OutOfMemory("no")

    monkeypatch.setattr(samples.RegularField, "replace", refuse)
    assert "more memory than there is" in through_samples(field, 2.0, 5.0).reason


@pytest.mark.slow
def test_the_command_has_it(smooth, tmp_path):
    path = tmp_path / "a.npy"
    np.save(path, smooth)
    options = ("--size", "20x16", "--backend", "cpu")
    for name in (*QUALITIES, None):
        word = () if name is None else ("--quality", name)
        report = json.loads(run("plan", path, "--json", *word, *options).stdout)
        expected = ss.render(path, **SMALL) if name is None else ss.render(path, quality=name, **SMALL)
        assert report["quality"] == expected.plan.to_dict()["quality"]
        run("render", path, "-o", tmp_path / f"{name}.npy", *word, *options)
        assert np.array_equal(np.load(tmp_path / f"{name}.npy"), expected.rgba)
    report = json.loads(
        run("plan", path, "--json", "--no-prefilter", "--opacity-stop", 0.98, "--filter", "off", *options).stdout
    )
    given = {one["option"]: one["given"] for one in report["quality"]["settings"]}
    assert given == {
        "prefilter": True,
        "radius": False,
        "falloff": False,
        "slice_spacing": False,
        "opacity_stop": True,
        "filter": True,
        "supersampling": False,
    }


def test_a_picture_is_made_again_by_what_was_set(smooth, tmp_path):
    path = tmp_path / "a.npy"
    np.save(path, smooth)
    for name in QUALITIES:
        run("render", path, "-o", tmp_path / "a.png", "--quality", name, "--size", 20, "--backend", "cpu")
        run("render", tmp_path / "a.png", path, "-o", tmp_path / "b.png")
        assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()
    stderr = run("render", tmp_path / "a.png", path, "-o", tmp_path / "b.png", "--quality", "draft", code=2).stderr
    assert "--quality" in stderr


def test_pictures_and_scenes_keep_it_in_pickles(smooth):
    image = ss.render(smooth, **SMALL)
    assert pickle.loads(pickle.dumps(image)).plan.quality == image.plan.quality
    scene = ss.Scene(ss.RegularField(smooth), [(0, 1, 1, 1, 1)]).with_quality(image.plan.quality)
    again = pickle.loads(pickle.dumps(scene))
    assert again == scene and again.quality == scene.quality == image.plan.quality
    assert scene.replace(mode="mip").quality is None and scene == scene.with_quality(None)
    with pytest.raises(KeyError):
        image.plan.quality.of("cmap")
    assert image.plan.quality.of("prefilter").value is True


@pytest.mark.parametrize("values", [1e-250, 1e250])
@pytest.mark.parametrize("length", [1e-90, 1e90])
def test_values_and_lengths_of_any_size(smooth, values, length):
    """Gradients beyond float64, too, of which the estimate that slices are chosen by has no direction."""
    field = ss.RegularField(smooth.astype(np.float64) * values, spacing=(length,) * 3)
    drawn = ss.render(field, **SMALL).pixels
    usual = ss.render(ss.RegularField(smooth.astype(np.float64)), **SMALL).pixels
    assert np.sqrt(np.mean(np.square(drawn - usual))) < 0.02

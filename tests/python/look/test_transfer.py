"""Transfer functions: points, colormaps, opacities."""

from __future__ import annotations

import numpy as np
import pytest

import sheetsplat as ss


def test_points_are_linear_between_and_clamped_beyond():
    function = ss.TransferFunction([(0, 0, 0, 0, 0), (2, 1, 0.5, 0, 0.8)])
    assert np.allclose(
        function.at([-1, 0, 1, 2, 9]), [[0] * 4, [0] * 4, [0.5, 0.25, 0, 0.4], [1, 0.5, 0, 0.8], [1, 0.5, 0, 0.8]]
    )
    assert function.at(1.0).shape == (4,)
    assert function.at(np.zeros((2, 3))).shape == (2, 3, 4)
    assert (function.v_min, function.v_max, function.max_opacity) == (0, 2, 0.8)


def test_of_two_points_at_one_value_the_later_holds():
    function = ss.TransferFunction([(0, 0, 0, 0, 0), (1, 0, 0, 0, 0), (1, 1, 1, 1, 1), (2, 1, 1, 1, 1)])
    assert function.at([np.nextafter(1, 0), 1.0])[:, 3].round(6).tolist() == [0, 1]


@pytest.mark.parametrize(
    "points",
    [
        [],
        np.empty((0, 5)),
        [(0, 0, 0, 0)],
        [(1, 0, 0, 0, 0), (0, 1, 1, 1, 1)],
        [(0, 0, 0, 0, 2)],
        [(0, 0, 0, 0, -0.1)],
        [(np.nan, 0, 0, 0, 0)],
        [(0, np.inf, 0, 0, 0)],
        "text",
        None,
        [("a", 0, 0, 0, 0)],
        [(0, 0, 0, 0, 0), (1, 0, 0)],
    ],
)
def test_points_without_meaning_are_refused(points):
    with pytest.raises(ss.InvalidInput, match="TransferFunction"):
        ss.TransferFunction(points)


def test_a_name_gives_the_colours_of_that_map():
    import cmap

    function = ss.TransferFunction.from_colormap("viridis", 0.3, (10, 20))
    at = np.linspace(10, 20, 256)
    expected = cmap.Colormap("viridis").lut(256)
    assert np.allclose(function.at(at)[:, :3], expected[:, :3], atol=1e-6)
    assert np.allclose(function.at([0, 15, 30])[:, 3], 0.3)


def test_tables_and_functions_give_their_rows():
    table = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 1]], float)
    function = ss.TransferFunction.from_colormap(table, 1.0, (0, 2))
    assert np.allclose(function.at([0, 0.5, 1, 2])[:, :3], [[0, 0, 0], [0.5, 0, 0], [1, 0, 0], [1, 1, 1]])
    assert np.array_equal(
        ss.TransferFunction.from_colormap((table * 255).astype(np.uint8), 1.0, (0, 2)).points, function.points
    )
    called = ss.TransferFunction.from_colormap(lambda x: np.column_stack([x, 0 * x, 1 - x]), 1.0, (0, 1))
    assert np.allclose(called.at([0.25])[0], [0.25, 0, 0.75, 1])
    alpha = ss.TransferFunction.from_colormap([[1, 1, 1, 0.0], [1, 1, 1, 1.0]], 0.5, (0, 1))
    assert np.allclose(alpha.at([0, 0.5, 1])[:, 3], [0, 0.25, 0.5])
    assert np.allclose(ss.TransferFunction.from_colormap([[1, 0, 0]], 0.5, (0, 1)).at(0.3), [1, 0, 0, 0.5])


def test_opacity_sequences_are_spread_over_clim():
    function = ss.TransferFunction.from_colormap("gray", [0, 0.2, 1], (0, 4))
    assert np.allclose(function.at([-1, 0, 1, 2, 3, 4, 9])[:, 3], [0, 0, 0.1, 0.2, 0.6, 1, 1])
    assert np.allclose(function.at([1, 3])[:, 0], [0.25, 0.75], atol=1e-6)


def test_opacity_pairs_keep_their_values_and_steps():
    function = ss.TransferFunction.from_colormap("gray", [(1, 0), (2, 0), (2, 0.5), (6, 1)], (0, 4))
    assert np.allclose(function.at([0, 1.99999, 2, 4, 6, 7])[:, 3], [0, 0, 0.5, 0.75, 1, 1], atol=1e-5)
    # Beyond clim the colour stays, while the opacity goes on.
    assert np.allclose(function.at([4, 6])[:, 0], 1)
    assert function.v_max == 6


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (("no_such_map", 0.5, (0, 1)), "no_such_map"),
        (("viridis", 1.5, (0, 1)), "opacity"),
        (("viridis", -0.5, (0, 1)), "opacity"),
        (("viridis", [], (0, 1)), "opacity"),
        (("viridis", "x", (0, 1)), "opacity"),
        (("viridis", [(2, 0), (1, 1)], (0, 1)), "decrease"),
        (("viridis", [(0, 0, 0)], (0, 1)), "opacity"),
        (("viridis", [np.nan, 1], (0, 1)), "opacity"),
        (("viridis", 0.5, (1, 1)), "clim"),
        (("viridis", 0.5, (2, 1)), "clim"),
        (("viridis", 0.5, (0, np.inf)), "clim"),
        (("viridis", 0.5, (0,)), "clim"),
        (("viridis", 0.5, None), "clim"),
        ((np.zeros((4, 2)), 0.5, (0, 1)), "cmap cannot be used"),
        ((np.full((4, 3), 2.0), 0.5, (0, 1)), "cmap cannot be used"),
        ((np.full((4, 3), np.nan), 0.5, (0, 1)), "cmap cannot be used"),
        ((np.zeros((0, 3)), 0.5, (0, 1)), "cmap cannot be used"),
        ((lambda x: x, 0.5, (0, 1)), "cmap cannot be used"),
        ((3, 0.5, (0, 1)), "cmap cannot be used"),
    ],
)
def test_colormaps_without_meaning_are_refused(arguments, text):
    with pytest.raises(ss.InvalidInput, match=text):
        ss.TransferFunction.from_colormap(*arguments)

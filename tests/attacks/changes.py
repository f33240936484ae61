"""What pages of the viewer may ask to be changed, as tests, attacks and long runs send it."""

from __future__ import annotations

from typing import Any

#: Values for each name in a page's message "set", for data around `volumes` of 14 samples a side; the first is the one
#: that tests look at.
CHANGES: dict[str, list[Any]] = {
    "camera": [
        {"kind": "perspective", "eye": [40, 7, 9], "target": [7, 7, 7], "up": [0, 0, 1], "fov_y": 35},
        {"kind": "orthographic", "eye": [40, 7, 9], "target": [7, 7, 7], "up": [0, 0, 1], "height": 20},
    ],
    "mode": ["isosurface", "composite", "xray", "mip", "minimum", "average"],
    "quality": ["draft", "good"],
    "choice": [1, 0],
    "time": [0, 1],
    "automatic": [True],
    "material": [{"ambient": 0.5, "diffuse": 0.2, "specular": 0.9, "shininess": 9, "two_sided": False}],
    "lights": [[{"direction": [1, 0, 0], "color": [1, 0.5, 0], "space": "world"}], []],
    "clip": [{"planes": [[[1, 0, 0], 6.0]], "box": [[0, 0, 0], [13, 13, 9]]}, {"planes": []}],
    "depth_cue": [{"strength": 0.5, "color": "#204060"}],
    "ambient_occlusion": [{"radius": 3, "strength": 0.7}],
    "gradient_opacity": [20.0],
    "background": ["#336699"],
    "backdrop": [[0.1, 0.2, 0.3]],
    "shadows": [True, False],
    "surfaces": [[{"value": 40, "opacity": 0.5, "color": "#ff0000"}, {"value": 60}]],
    "scalar_colors": [{"cmap": "magma", "clim": [0, 50], "log": False}],
    "max_error": [0.01],
    "max_seconds": [0.5],
    "effects": [{"opacity_correction": False, "elimination": True}, {}],
    "slice_planes": [[{"normal": [0, 0, 1], "offset": 6.0}], []],
    "color_by": ["heat", None],
    "color_map": ["magma"],
    "shows": [{"box": True, "scale": True}, {}],
    "measures": [[[[0, 0, 0], [3, 4, 0]], [[0, 0, 0], [3, 4, 0], [1, 1, 1]]], []],
    "settings": [{"threads": 1}],
    "look": [
        {"group": 0, "opacity": [[10, 0], [60, 0.4], [90, 0.1]]},
        {"group": 0, "opacity": [[10, 0], [60, 0.4], [90, 0.1]], "colors": [[0, 1, 0, 0], [90, 0, 0, 1]]},
        {"group": 0, "preset": "ct_bone"},
        {"group": 0, "cmap": "magma", "range": [0, 90]},
        {"group": 0, "word": "isolayers:4"},
        {"group": 0, "word": "sigmoid", "range": [10, 80]},
        {"group": 0, "automatic": True},
        {"group": 0, "color": "#ff8000"},
        {"group": 0, "shown": False},
        {"group": 0, "labels": {"1": {"shown": False, "opacity": 0.5, "color": "#ff0000"}}},
    ],
}

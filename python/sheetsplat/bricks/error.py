"""How far a picture in bricks is from the converged one, by further pictures of its view in bricks.

The estimate of one process (``cpp/src/engine/error_estimate.cpp``): what is in front of a brick, sums and
extrema count in these pictures as they do in any other, so that no error of a brick has to be carried through others.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from sheetsplat import _sheetsplat
from sheetsplat.backends import EXACT
from sheetsplat.bricks.light_error import Measure
from sheetsplat.bricks.partial import Finished, over_background
from sheetsplat.bricks.view import BrickView
from sheetsplat.image import ErrorEstimate
from sheetsplat.options.core import checked
from sheetsplat.options.renderer import Progress, RendererClassOptions
from sheetsplat.plan import RenderPlan

#: Draws a picture without its further outputs.
Draw = Callable[[BrickView, "Progress | None"], Finished]

# What the plan expects of light that is looked up in volumes, and is measured: all pictures of a view have it. Effects
# by their causes.
_OF_LIGHT = {"shadows from a volume": "shadows", "occlusion from a volume": "ambient_occlusion"}
# Of all that is done, what the pictures at half and at twice the slice distance are, and what measuring light is.
_HALVED_WORK, _DOUBLED_WORK, _LIGHT_WORK = 0.4, 0.1, 0.1


def estimate_error(
    view: BrickView,
    plan: RenderPlan,
    drawn: Finished,
    draw: Draw,
    measure: Measure,
    progress: Progress | None = None,
) -> ErrorEstimate:
    """Return the estimated distance of a picture from the converged one.

    Parameters
    ----------
    view, plan, drawn
        The picture.
    draw
        Draws further pictures: at half the slice distance without a stop, at the same slices, and without a stop where
        a pixel was finished by it; all in float64.
    measure
        Measures light.
    progress
        As for `Renderer.render`.

    Raises
    ------
    Cancelled
        Where `progress` returned False.
    Error
        What drawing raises.
    """
    given = {"backend": EXACT, "precision": "float64", "allow_inexact": True, "threads": view.settings["threads"]}
    settings = checked("Renderer", given, RendererClassOptions)
    plain = view.replace(settings=settings, outputs=(), allowed=None, options={**view.options, "background": None})
    unstopped = _with(plain, opacity_stop=1.0)
    done = 0.0

    def told(share: float) -> Progress | None:
        nonlocal done
        start = done
        done += share
        return None if progress is None else lambda part: progress(start + share * part)

    # Over a background all is opaque.
    opacity = None if drawn.rgba is None or view.options["background"] is not None else drawn.rgba[..., 3]

    def of(one: BrickView, share: float) -> Finished:
        nonlocal opacity
        found = draw(one, told(share))
        if found.rgba is None:
            return found
        opacity = found.rgba[..., 3] if opacity is None else opacity
        return replace(found, rgba=over_background(view, found.rgba))

    def measured() -> dict[str, float]:
        if opacity is None or not expected:
            return {}
        found = zip(_OF_LIGHT, measure(opacity, told(_LIGHT_WORK)), strict=True)
        return {cause: part for cause, part in found if cause in expected}

    expected = [cause for cause in _OF_LIGHT if cause in plan.error_budget]
    # (The picture's light volumes are there still.)
    of_light = measured()
    finer = of(_with(unstopped, slice_spacing=0.5 * view.slice_spacing), _HALVED_WORK)
    of_light = of_light or measured()
    coarser = of(_with(unstopped, slice_spacing=2.0 * view.slice_spacing), _DOUBLED_WORK)
    stops = not view.is_scalar and float(view.options["opacity_stop"]) < 1.0
    rest = (1.0 - done) / (1.0 + stops)
    exact = of(plain, rest)
    whole = of(unstopped, rest) if stops else exact
    return _of_pictures(view, plan, drawn, (finer, exact, whole, coarser), of_light)


def _with(view: BrickView, **options: float) -> BrickView:
    return view.replace(options={**view.options, **options})


def _of_pictures(
    view: BrickView,
    plan: RenderPlan,
    drawn: Finished,
    further: tuple[Finished, Finished, Finished, Finished],
    of_light: Mapping[str, float],
) -> ErrorEstimate:
    """Return the estimate: `further` are at half the slice distance, in float64, without a stop, and at twice it."""
    finer, exact, whole, coarser = further
    # The pictures that it is compared with are drawn with all samples; rounding is far less.
    levels = [("coarser levels", 1.0, "")]
    others = [(cause, part, "") for cause, part in plan.error_budget.items() if cause not in _OF_LIGHT]
    return ErrorEstimate.of_native(
        _sheetsplat.estimate_error(
            _pixels(drawn),
            _pixels(exact),
            None if whole is exact else _pixels(whole),
            _pixels(finer),
            _pixels(coarser),
            mode=view.mode,
            preintegration=bool(view.options["preintegration"]),
            budget=[
                *(others if view.allowed is None else levels),
                *((cause, part, _OF_LIGHT[cause]) for cause, part in of_light.items()),
            ],
        )
    )


def _pixels(picture: Finished) -> NDArray[np.float32]:
    found = picture.scalar if picture.rgba is None else picture.rgba
    assert found is not None
    return found

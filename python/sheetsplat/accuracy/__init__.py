"""What accuracy costs: every choice that trades error for time, measured on one scene.

:func:`accuracy` is exported as ``sheetsplat.accuracy``; the command line has it as ``sheetsplat accuracy FILE``. What
it needs is imported when it is called, so that importing the package stays quick.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Iterable

    from numpy.typing import ArrayLike

    from sheetsplat.accuracy.knobs import Clock
    from sheetsplat.accuracy.report import AccuracyReport
    from sheetsplat.backends import Backend
    from sheetsplat.camera import Camera
    from sheetsplat.image import Image
    from sheetsplat.options.renderer import Progress
    from sheetsplat.scene import Scene

__all__ = ["accuracy"]


def accuracy(
    scene: Scene,
    camera: Camera,
    *,
    size: tuple[int, int] = (400, 400),
    backend: Backend = "auto",
    knobs: Iterable[str] | str | None = None,
    repeats: int = 3,
    reference_seconds: float = 2.0,
    clock: Clock = "wall",
    truth: Image | ArrayLike | None = None,
    progress: Progress | None = None,
    **settings: Any,
) -> AccuracyReport:
    """Measure what each choice that trades error for time costs in this scene.

    One knob at a time is varied; each of its settings is drawn, timed, and compared with two pictures: the float64
    reference at the same slices (arithmetic error), and the converged picture (the error of slicing and all else),
    which has slices 8 times as close, in float64, with analytic gradients, without an opacity stop or a filter. Knobs
    that change the field of a lattice (lattice, kernel, prefilter) are compared with the converged picture of the
    field that interpolates the samples.

    Parameters
    ----------
    scene, camera
        What is seen, and from where.
    size
        (width, height) in pixels.
    backend
        What draws, as for `Renderer`; the knob "precision" tries the others as well.
    knobs
        Names of the knobs to vary, from `sheetsplat.accuracy.knobs.KNOBS`; all unless given.
    repeats
        Number of timed frames for each setting, after one that is not timed.
    reference_seconds
        Approximate time that the reference may take for a setting: arithmetic errors are measured at the largest size
        that this allows, and not at all at 0.
    clock
        Time that is reported and compared: "wall", elapsed time, or "cpu", the processor time of this process, which
        other processes disturb less and which does not include the work of a graphics card.
    truth
        A known picture to compare with in place of both converged ones: (h, w, 4), or (h, w) in scalar modes.
    progress
        Called with the finished share, 0 to 1. Where it returns False the measurement stops.
    settings
        Other options of `Renderer`: threads, precision, tagging, effects …

    Returns
    -------
    AccuracyReport
        ``print(report)``, ``report.plot("accuracy.png")``, ``report.to_json()``.

    Raises
    ------
    InvalidInput
        For unknown knobs, and as `Renderer`.
    Cancelled
        Where `progress` returned False.
    DeviceUnavailable, Unsupported, OutOfMemory
        Where the scene itself cannot be drawn. The row of a setting that cannot be drawn has the reason.

    Examples
    --------
    >>> report = ss.accuracy(scene, camera, size=(32, 32), knobs="slice_spacing", repeats=1, reference_seconds=0)
    >>> report.size
    (32, 32)
    """
    asked = dict(locals())
    from sheetsplat.accuracy.measurement import measure_accuracy

    return measure_accuracy(**asked)

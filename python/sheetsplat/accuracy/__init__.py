"""What accuracy costs: every choice that trades error for time, measured on one scene.

:func:`accuracy` is exported as ``sheetsplat.accuracy``; the command line has it as ``sheetsplat accuracy FILE``.
"""

from __future__ import annotations

from sheetsplat.accuracy.knobs import KNOBS
from sheetsplat.accuracy.measurement import accuracy
from sheetsplat.accuracy.report import AccuracyReport, AccuracyRow

__all__ = ["KNOBS", "AccuracyReport", "AccuracyRow", "accuracy"]

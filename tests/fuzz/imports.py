"""What children need, imported once by the process that they are forked from; nothing here may start a thread."""

from __future__ import annotations

import fuzz.child
import fuzz.files
import fuzz.scenes
import fuzz.soak  # noqa: F401

"""Films: turntables, time series and camera paths, frame by frame, as video files or folders of pictures."""

from sheetsplat.animation.between import Snapshot
from sheetsplat.animation.film import Animation
from sheetsplat.animation.make import animate, turntable
from sheetsplat.animation.path import CameraPath

__all__ = ["Animation", "CameraPath", "Snapshot", "animate", "turntable"]

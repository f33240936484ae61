"""Frames of an isosurface that turns once. One renderer serves all of them, so only the view is made anew.

Usage: turntable.py [FRAMES] [FOLDER]
"""

import math
import sys
from pathlib import Path

import sheetsplat as ss

frames = int(sys.argv[1]) if len(sys.argv) > 1 else 12
folder = Path(sys.argv[2] if len(sys.argv) > 2 else "turntable")
folder.mkdir(parents=True, exist_ok=True)

data = ss.datasets.marschner_lobb(64)
field = data.field()
gold = ss.TransferFunction([(0.0, 0.9, 0.7, 0.3, 1.0)])
scene = ss.Scene(field, gold, mode="isosurface", iso_value=0.5, lights=[ss.Light((0.3, 0.5, 1.0))])
renderer = ss.Renderer()
for frame in range(frames):
    angle = 2 * math.pi * frame / frames
    camera = ss.Camera.fit(field, direction=(math.sin(angle), math.cos(angle), -0.8), up=(0, 0, 1))
    image = renderer.render(scene, camera, size=(400, 400))
    image.save(folder / f"frame{frame:03}.png")
print(f"{frames} frames in {folder}")

"""Frames of a turntable.

One renderer serves all frames of an isosurface that turns once, so that only the view is made anew.
"""

import math

import numpy as np
from PIL import Image

import sheetsplat as ss

SIZE = (200, 200)

data = ss.datasets.marschner_lobb(40)
field = data.field()
gold = ss.TransferFunction([(0.0, 0.9, 0.7, 0.3, 1.0)])
scene = ss.Scene(field, gold, mode="isosurface", iso_value=0.5, lights=[ss.Light((0.3, 0.5, 1.0))])
renderer = ss.Renderer()
frames = []
for frame in range(8):
    angle = 2 * math.pi * frame / 8
    camera = ss.Camera.fit(field, direction=(math.sin(angle), math.cos(angle), -0.8), up=(0, 0, 1))
    frames.append(renderer.render(scene, camera, size=SIZE).to_pil())
    frames[-1].save(f"frame{frame:03}.png")
Image.fromarray(np.vstack([np.hstack(frames[:4]), np.hstack(frames[4:])])).save("turntable.png")

"""A turntable.

The eye turns once about an isosurface. Range, opacity, camera and backend are decided once; frames are drawn when they
are asked for, or written: into a folder of pictures, or as "film.mp4" with the extra video.
"""

import numpy as np
from PIL import Image

import sheetsplat as ss

SIZE = (200, 200)

field = ss.datasets.marschner_lobb(40).field()
gold = ss.TransferFunction([(0.0, 0.9, 0.7, 0.3, 1.0)])
scene = ss.Scene(field, gold, mode="isosurface", iso_value=0.5, lights=[ss.Light((0.3, 0.5, 1.0))])

film = ss.turntable(scene, frames=8, direction=(0, 1, -0.8), up="z", size=SIZE)
film.save("frames")  # frame_0000.png …; a second call goes on where the first one stopped
print(film)

frames = [Image.open(f"frames/frame_{number:04}.png") for number in range(len(film))]
Image.fromarray(np.vstack([np.hstack(frames[:4]), np.hstack(frames[4:])])).save("turntable.png")

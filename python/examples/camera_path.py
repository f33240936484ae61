"""A camera path.

Key frames are cameras. Positions follow a cubic spline, directions a spline of rotations; a film has a frame at each of
even distances in time. The same cameras, saved in pictures, make `sheetsplat animate FILE --key a.png --key b.png`.
"""

import numpy as np
from PIL import Image

import sheetsplat as ss

SIZE = (220, 200)

data = ss.datasets.tubes(64)
scene = data.scene()
low, high = (np.array(corner) for corner in scene.bounds)
middle, width = 0.5 * (low + high), np.linalg.norm(high - low)
far, side, near = (
    ss.Camera.perspective(middle + width * np.array(place), middle, up=(0, 0, 1), fov_y=30)
    for place in ((-1.2, -0.4, 0.4), (-0.2, -0.9, 0.2), (0.4, -0.4, 0.3))
)
path = ss.CameraPath([far, side, near], times=[0, 2, 3])
film = ss.animate(scene, 8, camera=path, size=SIZE)
print(film)

frames = [frame.to_pil() for frame in film]
Image.fromarray(np.vstack([np.hstack(frames[:4]), np.hstack(frames[4:])])).save("camera_path.png")

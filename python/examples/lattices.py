"""The same volume on a Cartesian and on a BCC lattice: 1/√2 of the samples, nearly the same picture."""

import numpy as np

import sheetsplat as ss

data = ss.datasets.tubes()
cartesian = data.field()
bcc = ss.resample_to_bcc(data.values, data.spacing, data.origin).field()
camera = ss.Camera.fit(cartesian, direction=(0.3, -0.2, -1.0))
renderer = ss.Renderer()
pictures = {}
for name, field in (("cartesian", cartesian), ("bcc", bcc)):
    pictures[name] = renderer.render(data.scene(field=field, slice_spacing=1.0, reference_length=1.0), camera)
    pictures[name].save(f"tubes-{name}.png")
    print(f"{name}: {field.size} samples, {pictures[name].stats['kernels_drawn']:.0f} of them drawn")
difference = pictures["bcc"].rgba - pictures["cartesian"].rgba
print(f"RMSE between them: {np.sqrt(np.mean(np.square(difference))):.3f}")

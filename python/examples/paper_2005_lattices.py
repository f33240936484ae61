"""2005, figure 6: Cartesian against BCC.

The paper compares volumes on a Cartesian lattice with the same volumes on a body-centred cubic one, which needs 1/√2
of the samples. Here it is done with a formula in place of the scans: the semi-transparent and the isosurface view of
each, and the number of splatted samples.
"""

import matplotlib.pyplot as plt
import numpy as np

import sheetsplat as ss

SIZE = (260, 260)

data = ss.datasets.marschner_lobb(48)
cartesian = data.field()
bcc = ss.datasets.marschner_lobb(48, lattice="bcc").field()
spacing = cartesian.spacing[0]
camera = ss.Camera.fit(cartesian, direction=(0.4, 0.8, -0.6), up=(0, 0, 1))
gold = ss.TransferFunction(
    [(0, 0.2, 0.3, 0.8, 0), (0.3, 0.4, 0.5, 0.8, 0.02), (0.6, 1, 0.8, 0.4, 0.1), (1, 1, 0.3, 0.1, 0.5)]
)
renderer = ss.Renderer()
figure, axes = plt.subplots(2, 2, figsize=(6, 6.4), layout="constrained")
pictures = {}
for column, (name, field) in enumerate({"Cartesian": cartesian, "BCC": bcc}.items()):
    for row, mode in enumerate(("composite", "isosurface")):
        scene = ss.Scene(
            field,
            gold,
            mode=mode,
            iso_value=0.5 if mode == "isosurface" else None,
            lights=[ss.Light((0.3, 0.5, 1))],
            slice_spacing=spacing,
            reference_length=spacing,
            clip=ss.Clip(box=((-0.92, -0.92, -0.92), (0.92, 0.92, 0.92))),
        )
        image = pictures[name, mode] = renderer.render(scene, camera, size=SIZE)
        axes[row, column].imshow(image)
        axes[row, column].axis("off")
        effective = image.stats["kernels_drawn"]
        axes[row, column].set_title(f"{name}, {mode}: {effective / 1000:.0f}K splats", fontsize=9)
figure.savefig("paper_2005_lattices.png")
print(f"samples, BCC over Cartesian: {bcc.size / cartesian.size:.3f}")
for mode in ("composite", "isosurface"):
    difference = pictures["BCC", mode].rgba - pictures["Cartesian", mode].rgba
    print(f"{mode}: RMSE between the two {np.sqrt(np.mean(difference**2)):.3f}")

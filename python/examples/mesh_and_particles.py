"""Files of flows and particles.

A flow on a curvilinear mesh (PLOT3D) and SPH particles (HDF5, as of Gadget) are written here, opened and rendered.
Kernels follow the mesh, thin where its layers are thin; those of particles follow their smoothing lengths.
"""

import h5py
import numpy as np
from PIL import Image
from scipy.spatial import cKDTree

import sheetsplat as ss

SIZE = (340, 280)

# Half a ring of 24 x 40 x 16 points: i goes outwards, j around, k along z; layers are thinner near the inner wall.
radius = 1.0 + np.linspace(0.0, 1.0, 24) ** 2
angle = np.linspace(0.0, np.pi, 40)
z, around, r = np.meshgrid(np.linspace(0.0, 1.0, 16), angle, radius, indexing="ij")
grid = np.stack([r * np.cos(around), r * np.sin(around), z])
density = 1.0 + 0.5 * np.sin(3.0 * around) * np.exp(-2.0 * (r - 1.0)) * np.cos(np.pi * z)
momentum = density * np.stack([-np.sin(around), np.cos(around), np.zeros_like(z)])
# A pressure of 1 / 1.4 and the kinetic energy, as the writers of such files count them.
energy = 1.0 / 1.4 / 0.4 + 0.5 * np.square(momentum).sum(axis=0) / density
with open("ring.xyz", "wb") as file:
    file.write(np.array([24, 40, 16], ">i4").tobytes() + grid.astype(">f4").tobytes())
with open("ring.q", "wb") as file:
    conditions = np.array([0.5, 0.0, 1e6, 0.0], ">f4")
    flow = np.stack([density, *momentum, energy]).astype(">f4")
    file.write(np.array([24, 40, 16], ">i4").tobytes() + conditions.tobytes() + flow.tobytes())

# The kernels follow the mesh: thin where its layers are thin. As in the file, the points are i fastest.
field = ss.open("ring.q", grid="ring.xyz", scalar="density")
print(field)
inside = density[2:-2, 2:-2, 2:-2].ravel(), grid[:, 2:-2, 2:-2, 2:-2].reshape(3, -1).T
error = np.abs(field.at(inside[1]) - inside[0])
print(f"density at the points of the mesh: off by {error.mean():.4f} on average, {error.max():.4f} at most, of 1")
assert error.mean() < 0.02
ring = ss.render(field, direction=(0, 1, -1), clim=(0.9, 1.4), opacity=(0, 0.2), slice_spacing=0.015, size=SIZE)
mach = ss.render("ring.q", grid="ring.xyz", scalar="mach", direction=(0, 1, -1), size=SIZE)

# A cloud of particles; the smoothing length is half the distance to the 48th neighbour, as for a cubic spline that ends
# at two of them, and the density is the sum over the neighbours.
random = np.random.default_rng(3)
places = random.normal(size=(6000, 3)) * (1.0, 1.0, 0.2)
distance, near = cKDTree(places).query(places, k=49)
length = 0.5 * distance[:, -1]
spline = ss.fit.SPH_KERNELS["cubic_spline"]
densities = (spline(distance / length[:, None]) / length[:, None] ** 3).sum(axis=1)
with h5py.File("cloud.h5", "w") as file:
    gas = file.create_group("PartType0")
    gas["Coordinates"], gas["Masses"] = places, np.ones(len(places))
    gas["SmoothingLength"], gas["Density"] = length, densities
cloud = ss.open("cloud.h5", log=True)
print(cloud)
# Found from the densities: kernels end at two smoothing lengths. Their closest Gaussian ends a little earlier.
found = cloud.scales / length
print(f"radius of the supports in smoothing lengths: {found.mean():.4f}, that of the closest Gaussian {spline.radius}")
assert np.allclose(found, spline.radius)
gas = ss.render(cloud, cmap="inferno", elevation=60, background="black", size=SIZE)
Image.fromarray(np.hstack([one.to_pil() for one in (ring, mach, gas)])).save("mesh_and_particles.png")

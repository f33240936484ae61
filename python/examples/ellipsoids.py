"""Scattered ellipsoids from arrays.

Each kernel has a place, sizes, a direction and a value, or a covariance. Needles along a spiral are summed and
divided by their weights, so that the scalar keeps its value where they overlap. Kernels smaller than a pixel need the
EWA filter.
"""

import warnings

import numpy as np

import sheetsplat as ss

SIZE = (480, 400)

# 4,000 needles along a spiral, each turned the way the spiral goes; their values rise from its start to its end.
count = 4000
share = np.linspace(0.0, 1.0, count)
angle = 6.0 * np.pi * share
places = np.stack([(0.3 + 0.7 * share) * np.cos(angle), (0.3 + 0.7 * share) * np.sin(angle), share], axis=1)
along = np.gradient(places, axis=0)
along /= np.linalg.norm(along, axis=1, keepdims=True)
side = np.cross(along, (0.0, 0.0, 1.0))
side /= np.linalg.norm(side, axis=1, keepdims=True)
# Columns are the kernel's own axes in the world: the first one is the needle's.
turned = np.stack([along, side, np.cross(along, side)], axis=-1)
# Semi-axes of the supports: where a kernel ends. Of a Gaussian that is 4 standard deviations.
sizes = (0.15, 0.05, 0.05)
noise = 0.04 * np.random.default_rng(1).normal(size=(count, 3))
# Where the weights add up to less than w0, the scalar fades to 0. With the default 1 a tube as thin as this would
# fade from its middle on; with 0.05 it keeps its value nearly to the edge of the supports.
field = ss.EllipsoidField(places + noise, np.tile(sizes, (count, 1)), turned, values=share, w0=0.05)
print(field)

# The same kernels by their covariances, R diag(sigma^2) R^T.
covariances = turned @ (np.diag(np.square(sizes)) / 16.0) @ turned.transpose(0, 2, 1)
same = ss.EllipsoidField.from_covariances(places + noise, covariances, share, w0=0.05)
difference = np.abs(same.at(places) - field.at(places)).max()
print(f"by covariances: the scalar differs by {difference:.1e} at most")
assert difference < 1e-9
print(f"mean of the scalar less the value, along the spiral: {np.mean(field.at(places) - share):.4f}")

image = ss.render(
    field, cmap="turbo", clim=(0, 1), opacity=0.4, elevation=50, slice_spacing=0.01, outputs=("coverage",), size=SIZE
)
image.save("ellipsoids.png")
# How much weight lies along each pixel's ray: where it is small, the data are thin.
print(f"line integrals of the weights: up to {image.coverage.max():.2f} world units")

# Dust: kernels so small that they fall between pixels and slices. The filter keeps their mass.
dust = ss.EllipsoidField(
    np.random.default_rng(2).random((2000, 3)), np.full(2000, 0.01), values=np.ones(2000), normalization="none"
)
camera = ss.Camera.orthographic(eye=(0.5, 0.5, 5), target=(0.5, 0.5, 0), height=1.1)
sums = {}
# Without the filter a PictureWarning says how many kernels no slice meets; here that is meant.
warnings.simplefilter("ignore", ss.PictureWarning)
for filter in (None, "ewa"):
    scene = ss.Scene(dust, [(0, 1, 1, 1, 0), (1, 1, 1, 1, 1)], mode="xray", slice_spacing=0.05, filter=filter)
    small = ss.Renderer().render(scene, camera, size=(32, 32))
    sums[filter] = small.scalar.sum() * (1.1 / 32) ** 2
    reason = next(effect.reason for effect in small.plan.effects if effect.name == "ewa_filter")
    print(f"filter {filter}: sum over the picture {sums[filter]:.2e}; the plan: {reason}")
fine = ss.Scene(dust, [(0, 1, 1, 1, 0), (1, 1, 1, 1, 1)], mode="xray")
exact = ss.Renderer().render(fine, camera, size=(700, 700)).scalar.sum() * (1.1 / 700) ** 2
print(f"large enough to show every kernel: {exact:.2e}")
assert abs(sums["ewa"] / exact - 1) < 0.02 < abs(sums[None] / exact - 1)

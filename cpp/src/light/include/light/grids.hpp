// The grids along the world's axes on which light volumes are made, and what a picture's kernels put there: absorption,
// or rho in mode isosurface. Of a part of a whole, what its cell holds. Source: conventions, sections 10 and 11.
#pragma once

#include <cstddef>
#include <vector>

#include "light/lit_view.hpp"
#include "sheetsplat/light_volume.hpp"

namespace sheetsplat {

/// Slice distances that light takes at once, at least 1: where slices are closer together than a 32nd of the default
/// distance, nothing changes from one to the next that an error to two digits shows, and light takes a bounded time.
double steps_together(const Scene& scene);
/// Whether the steps of a grid are small enough for the smallest kernels of a scene.
bool shows_kernels(const Scene& scene, double step);
/// The same of the grid of a volume.
bool shows_kernels(const Scene& scene, const LightVolume& grid);
/// Mode composite: whether what shows lies in so narrow a range of values that it is thinner than kernels are.
bool shows_narrowly(const Scene& scene);
/// Whether a grid of absorption is 0 only where nothing is, but for what is smaller than its cells.
bool shows_matter(const Scene& scene, const DrawPlan& plan, const LightVolume& absorption);

/// What the light volumes of a picture are made from. Of a part: those of the whole, which Part::supports holds.
LightPlan make_light_plan(const LitView& view, const Reach& reach);

/// A grid as a volume. group: FillLight. Throws OutOfMemory.
LightVolume filled(const LightGrid& grid, const Group* group, const FillLight& fill);
/// The camera whose rows of pixels are rows of grids.
Camera camera_along_z(const Vec3& eye, double height);
/// What lies in the cell of a part, of which elsewhere is nothing: boxes of elements that belong to no other part. (Of
/// planes of several slices two parts may each have some.) Pieces of zeros are left out.
std::vector<LightPiece> pieces_of(const LightPlan& light, const Scene& part, const FillLight& fill);

} // namespace sheetsplat

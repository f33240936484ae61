// Light on its way through a grid of absorption: what is left of it at each element, and how open the surroundings of
// each element are. Rays run from plane to plane of the grid along the axis that is nearest to the light's direction,
// each ray a column of a sheared grid: absorption is interpolated from a plane's elements to the rays, and
// transmittance back, so that nothing is smoothed more than twice however far the light comes. Source: conventions,
// section 10.
#pragma once

#include <functional>
#include <vector>

#include "base/threads.hpp"
#include "sheetsplat/light_volume.hpp"
#include "sheetsplat/types.hpp"

namespace sheetsplat {

/// Every second element along each axis, with its neighbours: weights 1/4, 1/2, 1/4.
LightVolume halved(const LightVolume& volume);

/// Which elements of what follows are computed.
enum class WhereLight {
    everywhere,
    near_matter, ///< within two elements of one that absorbs; others come out somewhere between their number and 1
};

/// Transmittance from each element of a grid towards a light, 0 to 1. absorption: -ln(1 - alpha) of one slice distance;
/// towards_light: world, unit length; poll: ThreadPool::run. The first point that counts lies a slice distance away:
/// the line integral begins at half a slice distance.
LightVolume transmittance(const LightVolume& absorption, const Vec3& towards_light, double slice_spacing,
                          WhereLight where, ThreadPool& pool, const std::function<void()>& poll);

/// Mean over directions (world, unit length) of transmittance through the first `steps` slice distances, 0 to 1.
LightVolume openness(const LightVolume& absorption, const std::vector<Vec3>& directions, double steps,
                     double slice_spacing, WhereLight where, ThreadPool& pool, const std::function<void()>& poll);

} // namespace sheetsplat

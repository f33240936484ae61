// Light on its way through a grid of absorption: what is left of it at each element, and how open the surroundings of
// each element are. Rays run from plane to plane of the grid along the axis that is nearest to the light's direction,
// each ray a column of a sheared grid: absorption is interpolated from a plane's elements to the rays, and
// transmittance back, so that nothing is smoothed more than twice however far the light comes. Source: conventions,
// section 10.
#pragma once

#include <array>
#include <cstddef>
#include <functional>
#include <memory>
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

namespace light_march {
class Stretches;
}

/// A grid of absorption, -ln(1 - alpha) of one slice distance, that several lights are followed through: which parts of
/// its rows are looked at is found once for each axis, where it is first asked for (not by two threads at once). The
/// grid must live as long as this.
class FollowedGrid {
  public:
    FollowedGrid(const LightVolume& absorption, WhereLight where);
    ~FollowedGrid();
    FollowedGrid(const FollowedGrid&) = delete;
    FollowedGrid& operator=(const FollowedGrid&) = delete;

    [[nodiscard]] const LightVolume& absorption() const { return absorption_; }
    [[nodiscard]] WhereLight where() const { return where_; }
    /// For rays along an axis of the grid.
    [[nodiscard]] const light_march::Stretches& stretches(std::size_t along) const;

  private:
    const LightVolume& absorption_;
    WhereLight where_;
    mutable std::array<std::unique_ptr<const light_march::Stretches>, 3> stretches_;
};

/// Transmittance from each element of a grid towards a light, 0 to 1. towards_light: world, unit length; poll:
/// ThreadPool::run. The first point that counts lies a slice distance away: the line integral begins at half a slice
/// distance.
LightVolume transmittance(const FollowedGrid& grid, const Vec3& towards_light, double slice_spacing, ThreadPool& pool,
                          const std::function<void()>& poll);

/// Mean over directions (world, unit length) of transmittance through the first `steps` slice distances, 0 to 1.
LightVolume openness(const FollowedGrid& grid, const std::vector<Vec3>& directions, double steps, double slice_spacing,
                     ThreadPool& pool, const std::function<void()>& poll);

} // namespace sheetsplat

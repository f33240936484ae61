// What light finds on its way, sampled on a grid in the world: made once for several views, looked up by all backends
// that draw shadows and ambient occlusion. Source: conventions, section 10.
#pragma once

#include <array>
#include <cstddef>
#include <memory>
#include <vector>

#include "sheetsplat/types.hpp"

namespace sheetsplat {

/// Numbers on a grid of any orientation with steps at right angles. The place of a point x is, along each of the grid's
/// three directions, dot(x - origin, per_step): element (0, 0, 0) lies at 0. Between elements numbers are linear, and
/// outside they are those of the nearest face.
struct LightVolume {
    Vec3 origin{0.0};                   ///< world
    std::array<Vec3, 3> per_step{};     ///< the grid's directions over the lengths of their steps
    std::array<int, 3> counts{1, 1, 1}; ///< elements, each at least 1
    std::vector<float> values;          ///< the first direction's fastest

    [[nodiscard]] std::size_t bytes() const { return values.size() * sizeof(float); }
    [[nodiscard]] std::size_t index(int u, int v, int w) const {
        const auto size = [&](int axis) { return static_cast<std::size_t>(counts[static_cast<std::size_t>(axis)]); };
        return (static_cast<std::size_t>(w) * size(1) + static_cast<std::size_t>(v)) * size(0) +
               static_cast<std::size_t>(u);
    }
    /// The place of a point of the world, in elements.
    [[nodiscard]] Vec3 place_of(const Vec3& world) const;
    /// The number at a place.
    [[nodiscard]] double at_place(const Vec3& elements) const { return around(elements).number; }
    /// With the least and the greatest of the elements that it is made of.
    struct Around {
        double number, least, greatest;
    };
    [[nodiscard]] Around around(const Vec3& elements) const;
    /// The number at a point of the world.
    [[nodiscard]] double at(const Vec3& world) const { return at_place(place_of(world)); }
};

/// For one scene, and where lights move with the camera for one view.
struct LightVolumes {
    /// For each light of the scene what is left of it: transmittance, 0 to 1. Null where nothing dims it.
    std::vector<std::shared_ptr<const LightVolume>> lights;
    /// What of a point's surroundings is open, 0 to 1; null where there is no ambient occlusion.
    std::shared_ptr<const LightVolume> openness;
    /// Mode isosurface, in place of both: rho of each group of fields over DrawPlan::value_unit, all on one grid whose
    /// faces nothing reaches. Lines towards lights are followed through it (view/surface_lines.hpp).
    std::vector<std::shared_ptr<const LightVolume>> groups;
};

} // namespace sheetsplat

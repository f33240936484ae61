// What light finds on its way, sampled on a grid in the world: made once for several views, looked up by all backends
// that draw shadows and ambient occlusion. Parts of a whole fill the grids that these volumes are made of, each in its
// cell. Source: conventions, sections 10 and 11.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
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
    /// faces nothing reaches. Lines towards lights are followed through it (light/surface_lines.hpp).
    std::vector<std::shared_ptr<const LightVolume>> groups;
};

/// A grid along the world's axes: elements from one to the next along x and against y, planes of whole slices of a view
/// along z, against z. Of absorption, -ln(1 - alpha) of a slice distance, a mean over the slices from plane to plane;
/// or of rho, a slice a plane.
struct LightGrid {
    double wanted = 1.0;  ///< the step that was asked for, world units
    double step = 1.0;    ///< along x and y: larger where there would be too many elements
    double spacing = 1.0; ///< of slices
    int every = 1;        ///< slices from plane to plane
    Vec3 first{0.0};      ///< x and y of the first element, z of the first slice
    Size size{};          ///< elements along x and y
    std::int64_t slices = 0;
    bool shows_matter = false; ///< it is 0 only where nothing is, but for what is smaller than its cells

    /// Elements along each direction of a volume: there is a plane before the slices, and of rho one behind them.
    [[nodiscard]] std::array<int, 3> counts(bool of_rho) const {
        return {size.width, size.height, static_cast<int>((slices + every - 1) / every) + (of_rho ? 2 : 1)};
    }
};

/// How the light volumes of a picture are made.
struct LightPlan {
    double slice_spacing = 1.0; ///< of the picture, world units
    bool surfaces = false;      ///< mode isosurface: grids of rho, of each group; else of absorption
    std::vector<LightGrid> grids{};
    std::vector<Vec3> lights{};  ///< towards each light of which shadows are drawn: world, unit length
    std::size_t light_grid = 0;  ///< from which they are made
    double radius = 0.0;         ///< of ambient occlusion, in slice distances; 0: none
    std::size_t open_grid = 0;   ///< from which openness is made,
    bool open_is_halved = false; ///< on a grid of twice the step
};

/// What a part of a whole holds of a grid: a box of its elements.
struct LightPiece {
    std::size_t grid = 0;               ///< of LightPlan::grids
    std::array<int, 3> first{0, 0, 0};  ///< of the grid's elements
    std::array<int, 3> counts{0, 0, 0}; ///< how many along each direction
    std::vector<float> values{};        ///< the first direction's fastest
};

/// A grid of zeros. Throws OutOfMemory.
LightVolume laid_out(const LightGrid& grid, bool of_rho);

} // namespace sheetsplat

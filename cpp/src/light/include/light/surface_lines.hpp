// Shadows and ambient occlusion in mode isosurface: lines from a point through a grid of rho, one slice distance a
// step, which lose light where rho crosses an iso value between two steps. Source: conventions, section 10.
#pragma once

#include <array>
#include <cstddef>
#include <vector>

#include "sheetsplat/camera.hpp"
#include "sheetsplat/light_volume.hpp"
#include "sheetsplat/scene.hpp"

namespace sheetsplat {

/// The light's direction in the world, of unit length.
Vec3 world_direction(const Light& light, const Camera& camera);

/// The directions of ambient occlusion, world: along the axes and the diagonals of a cube.
constexpr std::size_t directions_around = 14;
std::array<Vec3, directions_around> around_world();
/// M: steps of ambient occlusion. A radius of whole slice distances may come out a little short.
double occlusion_steps(const AmbientOcclusion& occlusion, double slice_spacing);

/// What follows lines needs to know, in elements of the grids and in DrawPlan::value_unit. What is left of light is
/// 2^-a, with a the sum of |b(rho) - b(rho before)| over the steps and the groups, and b(rho) the sum of absorptions of
/// the group's iso values up to rho.
struct SurfaceLines {
    struct Surface {
        double value;
        double absorption; ///< -log2(1 - opacity), at most `opaque`
    };
    /// Half space that is kept: dot(normal, place) + distance >= 0.
    struct Kept {
        Vec3 normal;
        double distance;
    };
    /// Where absorptions add up to this much nothing is left.
    static constexpr double opaque = 40.0;

    std::vector<std::vector<Surface>> surfaces; ///< of each group, by value; those of opacity 0 left out
    std::vector<Vec3> to_lights;                ///< a step towards each light
    std::array<Vec3, directions_around> around{};
    int around_steps = 0;                ///< the last point on a line of ambient occlusion
    std::vector<std::vector<Kept>> kept; ///< of each group: by the clip, and inside of where its fields end
    std::array<int, 3> counts{1, 1, 1};  ///< of the grids

    /// Points of a line, counted in steps: those from first to last. None where first > last.
    struct Run {
        double first, last;
    };
    /// The points from 1 on that are kept.
    [[nodiscard]] Run run_kept(std::size_t group, const Vec3& place, const Vec3& step) const;
    /// Steps to the first point beyond the grid.
    [[nodiscard]] double last_step_in_grid(const Vec3& place, const Vec3& step) const;
    /// b(rho)
    [[nodiscard]] double absorbed_below(std::size_t group, double rho) const;
    /// 2^-a
    [[nodiscard]] static double left_of(double absorbed);
    /// What is left of light that comes from the direction of `step` through points 1 to `steps`, as far as they are
    /// kept and the first one beyond the grid.
    [[nodiscard]] double left_along(const LightVolumes& volumes, const Vec3& place, const Vec3& step,
                                    double steps) const;
};

/// grid: LightVolumes::groups.front().
SurfaceLines make_surface_lines(const Scene& scene, const Camera& camera, const LightVolume& grid, double slice_spacing,
                                double value_unit);

} // namespace sheetsplat

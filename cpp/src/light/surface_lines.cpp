#include "light/surface_lines.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include <glm/common.hpp>
#include <glm/geometric.hpp>

#include "scene/mode_rules.hpp"

namespace sheetsplat {

namespace {

/// A point on a plane of a clip is kept however float32 rounds its place: in slice distances.
constexpr double on_a_plane = 1e-4;

/// Elements of the grid that a vector of the world spans.
Vec3 in_elements(const LightVolume& grid, const Vec3& world) {
    return {glm::dot(world, grid.per_step[0]), glm::dot(world, grid.per_step[1]), glm::dot(world, grid.per_step[2])};
}

SurfaceLines::Kept kept_in(const LightVolume& grid, const Clip::Plane& plane, double slice_spacing) {
    // Scaled first: the length of a normal may be beyond float64's squares.
    const Vec3 size = glm::abs(plane.normal);
    const double largest = std::max({size.x, size.y, size.z});
    const Vec3 scaled = plane.normal / largest;
    const double length = glm::length(scaled);
    const Vec3 normal = scaled / length;
    SurfaceLines::Kept kept{Vec3(0.0), glm::dot(normal, grid.origin) - plane.offset / largest / length +
                                           on_a_plane * slice_spacing};
    for (std::size_t axis = 0; axis < 3; ++axis) {
        // per_step is a direction over the length of its step; the step itself is its inverse.
        const Vec3& per_step = grid.per_step[axis];
        kept.normal[static_cast<int>(axis)] = glm::dot(normal, per_step) / glm::dot(per_step, per_step);
    }
    // In slice distances, so that float32 can hold it whatever the world's unit.
    kept.normal /= slice_spacing;
    kept.distance /= slice_spacing;
    return kept;
}

} // namespace

Vec3 world_direction(const Light& light, const Camera& camera) {
    const Vec3 size = glm::abs(light.direction);
    const Vec3 unit = glm::normalize(light.direction / std::max({size.x, size.y, size.z}));
    return light.space == LightSpace::world
               ? unit
               : unit.x * camera.right_world() + unit.y * camera.up_world() + unit.z * camera.back_world();
}

std::array<Vec3, directions_around> around_world() {
    std::array<Vec3, directions_around> around{};
    std::size_t next = 0;
    for (int axis = 0; axis < 3; ++axis) {
        Vec3 direction(0.0);
        direction[axis] = 1.0;
        around[next++] = direction;
        around[next++] = -direction;
    }
    for (int corner = 0; corner < 8; ++corner) {
        const auto sign = [corner](int axis) { return ((corner >> axis) & 1) != 0 ? 1.0 : -1.0; };
        around[next++] = glm::normalize(Vec3(sign(0), sign(1), sign(2)));
    }
    return around;
}

double occlusion_steps(const AmbientOcclusion& occlusion, double slice_spacing) {
    return std::max(1.0, std::floor(occlusion.radius / slice_spacing + 1e-6));
}

double SurfaceLines::last_step_in_grid(const Vec3& place, const Vec3& step) const {
    double last = std::numeric_limits<double>::max();
    for (int axis = 0; axis < 3; ++axis) {
        if (step[axis] != 0.0) {
            const double face = step[axis] > 0.0 ? counts[static_cast<std::size_t>(axis)] - 1 : 0;
            last = std::min(last, (face - place[axis]) / step[axis]);
        }
    }
    return std::floor(last) + 1.0;
}

SurfaceLines::Run SurfaceLines::run_kept(std::size_t group, const Vec3& place, const Vec3& step) const {
    Run run{1.0, std::numeric_limits<double>::max()};
    for (const Kept& half : kept[group]) {
        const double height = glm::dot(half.normal, place) + half.distance, rise = glm::dot(half.normal, step);
        if (rise > 0.0) {
            run.first = std::max(run.first, std::ceil(-height / rise));
        } else if (rise < 0.0) {
            run.last = std::min(run.last, std::floor(height / -rise));
        } else if (height < 0.0) {
            run.last = 0.0;
        }
    }
    return run;
}

double SurfaceLines::absorbed_below(std::size_t group, double rho) const {
    double sum = 0.0;
    for (const Surface& surface : surfaces[group]) {
        sum += rho >= surface.value ? surface.absorption : 0.0;
    }
    return sum;
}

double SurfaceLines::left_of(double absorbed) { return absorbed < opaque ? std::exp2(-absorbed) : 0.0; }

double SurfaceLines::left_along(const LightVolumes& volumes, const Vec3& place, const Vec3& step, double steps) const {
    const double end = std::min(last_step_in_grid(place, step), steps);
    double absorbed = 0.0;
    for (std::size_t group = 0; group < volumes.groups.size(); ++group) {
        const Run run = run_kept(group, place, step);
        const double last = std::min(run.last, end);
        double before = 0.0;
        for (double point = run.first; point <= last && absorbed < opaque; point += 1.0) {
            const double here = absorbed_below(group, volumes.groups[group]->at_place(place + point * step));
            absorbed += point > run.first ? std::abs(here - before) : 0.0;
            before = here;
        }
    }
    return left_of(absorbed);
}

SurfaceLines make_surface_lines(const Scene& scene, const Camera& camera, const LightVolume& grid, double slice_spacing,
                                double value_unit) {
    SurfaceLines lines;
    const std::vector<Group> groups = scene.groups();
    for (std::size_t group = 0; group < groups.size(); ++group) {
        std::vector<SurfaceLines::Surface>& surfaces = lines.surfaces.emplace_back();
        for (const IsoValue& iso : iso_values_of(scene, group)) {
            if (iso.opacity > 0.0) {
                const double absorption = iso.opacity < 1.0 ? -std::log1p(-iso.opacity) / std::log(2.0) : lines.opaque;
                const double value = is_label(groups[group]) ? just_above_labels : iso.value / value_unit;
                surfaces.push_back({value, std::min(absorption, lines.opaque)});
            }
        }
        std::stable_sort(
            surfaces.begin(), surfaces.end(),
            [](const SurfaceLines::Surface& a, const SurfaceLines::Surface& b) { return a.value < b.value; });
        std::vector<SurfaceLines::Kept>& kept = lines.kept.emplace_back();
        const auto keep = [&](const Clip& clip) {
            for (const Clip::Plane& plane : clip.half_spaces()) {
                kept.push_back(kept_in(grid, plane, slice_spacing));
            }
        };
        keep(scene.clip);
        if (scene.counted && !scene.counted->ends.empty()) {
            keep({{}, scene.counted->ends[group]});
        }
    }
    for (const Light& light : scene.lights) {
        lines.to_lights.push_back(in_elements(grid, slice_spacing * world_direction(light, camera)));
    }
    const std::array<Vec3, directions_around> around = around_world();
    std::transform(around.begin(), around.end(), lines.around.begin(),
                   [&](const Vec3& direction) { return in_elements(grid, slice_spacing * direction); });
    if (scene.ambient_occlusion) {
        lines.around_steps = static_cast<int>(std::min(occlusion_steps(*scene.ambient_occlusion, slice_spacing), 1e6));
    }
    lines.counts = grid.counts;
    return lines;
}

} // namespace sheetsplat

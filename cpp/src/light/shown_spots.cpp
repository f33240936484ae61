#include "shown_spots.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include <glm/geometric.hpp>

#include "reference/classify.hpp"
#include "scene/mode_rules.hpp"

namespace sheetsplat {

namespace {

/// Slice distances over which differences stand for derivatives.
constexpr double little_step = 1e-3;

/// What numbers between 0 and 1 follow from a pixel and a half: alike on every machine, unlike for neighbours.
double chance(int column, int row, std::size_t half) {
    auto bits = static_cast<std::uint64_t>(column) * 0x9E3779B97F4A7C15ULL +
                static_cast<std::uint64_t>(row) * 0xC2B2AE3D27D4EB4FULL +
                static_cast<std::uint64_t>(half) * 0x165667B19E3779F9ULL;
    bits = (bits ^ (bits >> 30)) * 0xBF58476D1CE4E5B9ULL;
    bits = (bits ^ (bits >> 27)) * 0x94D049BB133111EBULL;
    return static_cast<double>((bits ^ (bits >> 31)) >> 11) * 0x1p-53;
}

std::vector<double> weakest_differences(const Scene& scene) {
    std::vector<double> weakest;
    for (const Group& group : scene.groups()) {
        weakest.push_back(weakest_difference(scene, group));
    }
    return weakest;
}

} // namespace

ShownSpots::ShownSpots(const LitView& lit, const LightAtPoints& light)
    : lit_(lit), scene_(lit.scene), light_(light), screen_(lit.camera, lit.size),
      shader_(scene_, lit.camera, weakest_differences(scene_)),
      in_front_(lit.plan.depth_limit ? &*scene_.depth_limit : nullptr, lit.frame),
      faces_(scene_, lit.plan, lit.camera, lit.frame),
      half_slab_(scene_.sampling == Sampling::slab ? 0.5 * lit.frame.slice_spacing : 0.0) {}

std::vector<LightSpot> ShownSpots::at(std::size_t number, int column, int row) const {
    const Frame& frame = lit_.frame;
    const Ray ray = ray_of(column, row);
    std::vector<LightSpot> spots;
    if (ray.first > ray.last) {
        return spots;
    }
    std::vector<Values> known(static_cast<std::size_t>(ray.last - ray.first + 1));
    const auto values = [&](std::int64_t n) -> const Values& {
        static const Values nothing;
        if (n < ray.first || n > ray.last) {
            return nothing;
        }
        Values& here = known[static_cast<std::size_t>(n - ray.first)];
        if (!here.looked_at) {
            here = values_at(ray, n);
        }
        return here;
    };
    const bool between = uses_intervals(scene_.mode, scene_.preintegration);
    double alpha = 0.0;
    const LightAtPoints::ClearLine line = light_.clear_line(ray.start, ray.along);
    for (std::int64_t n = ray.first - (between ? 1 : 0); n <= ray.last && alpha < scene_.opacity_stop; ++n) {
        if (!light_.holds(ray.point(frame.depth_of(std::max<std::int64_t>(n, 0))))) {
            continue;
        }
        // Of the slice, or the interval behind it.
        const double front = frame.depth_of(n) - half_slab_;
        const double back = frame.depth_of(between ? n + 1 : n) + half_slab_;
        if (light_.surfaces()) {
            if (!light_.on_one_side(ray.point(front), ray.point(back))) {
                add_crossings(ray, n, values, alpha, spots);
            }
        } else if (!light_.clear_at(line, front) || (front < back && !light_.clear_at(line, back))) {
            add_slice(ray, n, values, alpha, spots);
        }
    }
    for (LightSpot& spot : spots) {
        spot.number = number;
        spot.chances = {chance(column, row, 0), chance(column, row, 1)};
    }
    return spots;
}

Vec3 ShownSpots::place_of(int column, int row, const LightSpot& spot) const {
    return ray_of(column, row).point(depth_of(spot));
}

std::vector<Vec3> ShownSpots::most_of_lights(int column, int row, const LightSpot& spot, double least) const {
    const double left = cued(spot);
    const Vec3 outward = (1.0 - spot.on_face) * shader_.normal(gradient(column, row, spot), spot.group) +
                         spot.on_face * faces_.at(spot.group, column, row).normal;
    const Vec3 to_viewer = screen_.to_viewer(column, row);
    std::vector<Vec3> most;
    for (std::size_t number = 0; number < scene_.lights.size(); ++number) {
        const Vec3 added = left * shader_.added_by(number, spot.color, outward, to_viewer);
        most.push_back(std::max({added.x, added.y, added.z}) < least ? Vec3(0.0) : added);
    }
    return most;
}

Vec3 ShownSpots::most_open(const LightSpot& spot) const {
    const double ambient = shader_.lit() ? scene_.material.ambient : 1.0;
    return cued(spot) * ambient * scene_.ambient_occlusion->strength * spot.color;
}

Vec3 ShownSpots::to_world(const Vec3& eye) const {
    const Camera& camera = lit_.camera;
    return camera.eye() + eye.x * camera.right_world() + eye.y * camera.up_world() + eye.z * camera.back_world();
}

ShownSpots::Ray ShownSpots::ray_of(int column, int row) const {
    const Frame& frame = lit_.frame;
    Ray ray;
    ray.column = column;
    ray.row = row;
    ray.last_kept = in_front_.last(column, row);
    ray.start = to_world(screen_.point(column, row, 0.0));
    ray.along = to_world(screen_.point(column, row, 1.0)) - ray.start;
    double from = frame.depth_of(0), to = frame.depth_of(frame.slices - 1);
    for (int axis = 0; axis < 3; ++axis) {
        if (ray.along[axis] != 0.0) {
            const double a = (light_.box().lower[axis] - ray.start[axis]) / ray.along[axis];
            const double b = (light_.box().upper[axis] - ray.start[axis]) / ray.along[axis];
            from = std::max(from, std::min(a, b) - half_slab_);
            to = std::min(to, std::max(a, b) + half_slab_);
        } else if (ray.start[axis] < light_.box().lower[axis] || ray.start[axis] > light_.box().upper[axis]) {
            return ray;
        }
    }
    if (from <= to && frame.slices > 0) {
        const auto slice = [&](double depth) { return (depth - frame.first_depth) / frame.slice_spacing; };
        ray.first = std::max<std::int64_t>(0, static_cast<std::int64_t>(std::ceil(slice(from) - 1e-9)));
        ray.last = std::min<std::int64_t>(frame.slices - 1, static_cast<std::int64_t>(std::floor(slice(to) + 1e-9)));
    }
    return ray;
}

ShownSpots::Values ShownSpots::values_at(const Ray& ray, std::int64_t n) const {
    const double depth = lit_.frame.depth_of(n);
    Values values;
    values.looked_at = true;
    for (std::size_t group = 0; group < light_.groups().size(); ++group) {
        values.groups.push_back(light_.surfaces() && half_slab_ == 0.0 ? light_.side_of(group, ray.point(depth))
                                                                       : shown(group, ray.column, ray.row, depth));
    }
    return values;
}

PointValues::Value ShownSpots::shown(std::size_t group, int column, int row, double depth, const Vec3& beside) const {
    const auto at = [&](double place) { return to_world(screen_.point(column, row, place) + beside); };
    return half_slab_ == 0.0 ? light_.value_at(group, at(depth))
                             : light_.mean_between(group, at(depth - half_slab_), at(depth + half_slab_));
}

double ShownSpots::rho_on(std::size_t group, int column, int row, std::int64_t slice) const {
    const bool exists = slice >= 0 && slice < lit_.frame.slices;
    return exists ? shown(group, column, row, lit_.frame.depth_of(slice)).rho : 0.0;
}

bool ShownSpots::keeps(const Ray& ray, std::int64_t n) const {
    return n <= ray.last_kept && light_.clip_keeps(ray.point(lit_.frame.depth_of(n)));
}

template <class At>
void ShownSpots::add_crossings(const Ray& ray, std::int64_t n, const At& values, double& alpha,
                               std::vector<LightSpot>& spots) const {
    if ((lit_.frame.cut_by_near && n < 0) || !keeps(ray, n) || !keeps(ray, n + 1)) {
        return;
    }
    struct Crossing {
        double share;
        std::size_t group;
        IsoValue iso;
    };
    std::vector<Crossing> crossings;
    for (std::size_t group = 0; group < light_.groups().size(); ++group) {
        const double rho = values(n).rho(group), behind = values(n + 1).rho(group);
        const auto inside = [&](std::int64_t slice) {
            return light_.inside_end(group, ray.point(lit_.frame.depth_of(slice)));
        };
        if (light_.absorbed_below(group, rho) == light_.absorbed_below(group, behind) || !inside(n) || !inside(n + 1)) {
            continue;
        }
        const double front = rho_on(group, ray.column, ray.row, n), back = rho_on(group, ray.column, ray.row, n + 1);
        for (const IsoValue& iso : iso_values_of(scene_, group)) {
            if ((front < iso.value) != (back < iso.value)) {
                crossings.push_back({(iso.value - front) / (back - front), group, iso});
            }
        }
    }
    std::stable_sort(crossings.begin(), crossings.end(),
                     [](const Crossing& a, const Crossing& b) { return a.share < b.share; });
    for (const auto& [behind, group, iso] : crossings) {
        if (alpha >= scene_.opacity_stop) {
            return;
        }
        const double share = (1.0 - alpha) * iso.opacity;
        const Vec3 color = light_.groups()[group].transfer_function->at(iso.value).color;
        spots.push_back({0, n, behind, group, color, share});
        alpha += share;
    }
}

template <class At>
void ShownSpots::add_slice(const Ray& ray, std::int64_t n, const At& values, double& alpha,
                           std::vector<LightSpot>& spots) const {
    const bool interval = scene_.preintegration;
    const bool here = keeps(ray, n);
    const bool behind = interval && keeps(ray, n + 1);
    const double lengths = light_.lengths() * screen_.secant(ray.column, ray.row);
    const std::size_t before = spots.size();
    double extinction = 0.0, weights = 0.0;
    for (std::size_t group = 0; group < light_.groups().size(); ++group) {
        if (!is_classified(light_.groups()[group]) ||
            (!(here && !values(n).empty(group)) && !(behind && !values(n + 1).empty(group)))) {
            continue;
        }
        const TransferFunction& function = *light_.groups()[group].transfer_function;
        LightSpot spot{0, n, interval ? 0.5 : 0.0, group};
        const double faded = scene_.gradient_opacity
                                 ? std::min(1.0, glm::length(gradient(ray.column, ray.row, spot)) /
                                                     (*scene_.gradient_opacity * lit_.frame.reference_length))
                                 : 1.0;
        double own = 0.0, weight = 0.0;
        if (lit_.plan.second_order) {
            const std::array<double, 4> rho{values(n - 1).rho(group), values(n).rho(group), values(n + 1).rho(group),
                                            values(n + 2).rho(group)};
            const reference::ColorOpacity looks = reference::preintegrate_second_order(function, rho, lengths * faded);
            own = weight = reference::extinction_of(looks.opacity);
            spot.color = looks.color;
        } else if (interval) {
            const reference::ColorExtinction mean =
                reference::mean_over_ramp(function, values(n).rho(group), values(n + 1).rho(group));
            own = weight = lengths * faded * mean.extinction;
            spot.color = mean.color;
        } else {
            const reference::ColorOpacity looks = reference::look_up(function, values(n).rho(group));
            weight = reference::extinction_of(faded * looks.opacity);
            own = lengths * weight;
            spot.color = looks.color;
        }
        spot.share = weight;
        if (own > 0.0) {
            if (lit_.plan.cut_faces) {
                const double length = std::max(1.0, lit_.frame.reference_length / lit_.frame.slice_spacing);
                spot.on_face = faces_.at(group, ray.column, ray.row)
                                   .share(static_cast<double>(n) + spot.behind, own, alpha, length);
            }
            extinction += own;
            weights += weight;
            spots.push_back(spot);
        }
    }
    const double share = (1.0 - alpha) * -std::expm1(-extinction);
    for (std::size_t added = before; added < spots.size(); ++added) {
        spots[added].share *= share / weights;
    }
    alpha += share;
}

Vec3 ShownSpots::gradient(int column, int row, const LightSpot& spot) const {
    const Vec3 front = gradient_on(column, row, spot.slice, spot.group);
    return spot.behind == 0.0
               ? front
               : (1.0 - spot.behind) * front + spot.behind * gradient_on(column, row, spot.slice + 1, spot.group);
}

Vec3 ShownSpots::gradient_on(int column, int row, std::int64_t slice, std::size_t group) const {
    const Frame& frame = lit_.frame;
    const double depth = frame.depth_of(slice);
    if (!lit_.plan.analytic_gradient) {
        const auto rho = [&](int n, int i, int j) { return rho_on(group, i, j, slice + n); };
        return reference::gradient_eye(screen_, rho, depth, frame.slice_spacing, frame.reference_length, column, row);
    }
    const double h = little_step * frame.slice_spacing;
    Vec3 slope(0.0);
    for (int axis = 0; slice >= 0 && slice < frame.slices && axis < 3; ++axis) {
        Vec3 by(0.0);
        by[axis] = h;
        slope[axis] = (shown(group, column, row, depth, by).rho - shown(group, column, row, depth, -by).rho) /
                      (2.0 * h / frame.reference_length);
    }
    return slope;
}

double ShownSpots::cued(const LightSpot& spot) const {
    if (!scene_.depth_cue) {
        return 1.0;
    }
    const DepthCue& cue = *scene_.depth_cue;
    return 1.0 - cue.strength * std::clamp((depth_of(spot) - cue.start) / (cue.end - cue.start), 0.0, 1.0);
}

} // namespace sheetsplat

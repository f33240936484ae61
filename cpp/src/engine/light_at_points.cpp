#include "light_at_points.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "reference/classify.hpp"

namespace sheetsplat {

namespace {

/// Where a grid shows all kernels, rho between elements is no farther from theirs than this share of what they differ
/// by.
constexpr double margin_of_cell = 0.5;
/// What is left of light where it no longer matters how much.
constexpr double dark = 1e-4;

} // namespace

LightAtPoints::LightAtPoints(const Request& request, const Prepared& prepared, const LightVolumes& volumes,
                             const LightVolume* absorption, const BlocksOf& blocks, const ClearOf& clear,
                             std::vector<std::shared_ptr<const PointValues>> values)
    : scene_(request.scene), camera_(request.camera), frame_(prepared.frame), plan_(prepared.plan), volumes_(volumes),
      values_(std::move(values)), surfaces_(!volumes.groups.empty()), groups_(scene_.groups()),
      clipping_(scene_, camera_), box_(supports_world(scene_)),
      lengths_(frame_.slice_spacing / frame_.reference_length) {
    if (plan_.filter) {
        const double wider = 4.0 * (frame_.largest_pixel() + frame_.slice_spacing);
        box_ = {box_.lower - wider, box_.upper + wider};
    }
    for (const Light& light : scene_.lights) {
        to_lights_.push_back(world_direction(light, camera_));
    }
    if (surfaces_) {
        // The filter widens and lowers kernels by the view, and not as much in the grid.
        resolved_ = !plan_.filter && shows_kernels(scene_, *volumes.groups.front());
        lines_ = make_surface_lines(scene_, camera_, *volumes.groups.front(), frame_.slice_spacing, plan_.value_unit);
        for (const auto& group : volumes.groups) {
            sides_.push_back(sides_of(blocks(*group)));
        }
    } else if (absorption != nullptr && shows_matter(scene_, plan_, *absorption)) {
        absorption_ = absorption;
        clear_ = &clear();
    }
    if (scene_.ambient_occlusion) {
        occlusion_steps_ = occlusion_steps(*scene_.ambient_occlusion, frame_.slice_spacing);
    }
}

LightAtPoints::Sides LightAtPoints::sides_of(const LightBlocks& blocks) const {
    Sides sides{&blocks, {}};
    for (const LightBlocks::Range& range : blocks.ranges()) {
        const auto least = static_cast<double>(range.least), greatest = static_cast<double>(range.greatest);
        const double margin = margin_of_cell * (greatest - least);
        const double below = lines_.absorbed_below(least - margin);
        sides.below.push_back(resolved_ && below == lines_.absorbed_below(greatest + margin) ? below : mixed);
    }
    return sides;
}

double LightAtPoints::side_at(std::size_t group, const Vec3& place) const {
    return sides_[group].below[sides_[group].blocks->at(place)];
}

double LightAtPoints::absorbed_below(double rho) const { return lines_.absorbed_below(rho / plan_.value_unit); }

bool LightAtPoints::on_one_side(const Vec3& front, const Vec3& back) const {
    const LightVolume& grid = *volumes_.groups.front();
    const Vec3 first = grid.place_of(front), second = grid.place_of(back);
    for (std::size_t group = 0; group < groups_.size(); ++group) {
        const double side = side_at(group, first);
        if (side == mixed || side != side_at(group, second)) {
            return false;
        }
    }
    return true;
}

LightAtPoints::ClearLine LightAtPoints::clear_line(const Vec3& start, const Vec3& along) const {
    if (clear_ == nullptr) {
        return {};
    }
    const Vec3 first = absorption_->place_of(start);
    return {first, absorption_->place_of(start + along) - first};
}

PointValues::Value LightAtPoints::side_of(std::size_t group, const Vec3& world) const {
    const LightVolume& grid = *volumes_.groups[group];
    const Vec3 place = grid.place_of(world);
    const std::size_t block = sides_[group].blocks->at(place);
    if (sides_[group].below[block] != mixed) {
        return {plan_.value_unit * static_cast<double>(sides_[group].blocks->ranges()[block].least), false};
    }
    return side_in_cell(group, world, grid.around(place));
}

PointValues::Value LightAtPoints::side_in_cell(std::size_t group, const Vec3& world,
                                               const LightVolume::Around& around) const {
    const double margin = margin_of_cell * (around.greatest - around.least);
    const bool sure =
        resolved_ && lines_.absorbed_below(around.least - margin) == lines_.absorbed_below(around.greatest + margin);
    return sure ? PointValues::Value{plan_.value_unit * around.number, false} : value_at(group, world);
}

bool LightAtPoints::clip_keeps(const Vec3& world) const {
    return scene_.clip.empty() || clipping_.keeps(camera_.to_eye(world));
}

double LightAtPoints::light_off(std::size_t number, const Vec3& world) const {
    constexpr double all = std::numeric_limits<double>::max();
    if (surfaces_) {
        return line_off(world, to_lights_[number], lines_.to_lights[number], all);
    }
    const bool drawn = number < volumes_.lights.size() && volumes_.lights[number];
    return (drawn ? volumes_.lights[number]->at(world) : 1.0) - left_along(world, to_lights_[number], all);
}

double LightAtPoints::open_off(const Vec3& world) const {
    double sum = 0.0;
    for (std::size_t n = 0; n < around_.size(); ++n) {
        sum += surfaces_ ? line_off(world, around_[n], lines_.around[n], occlusion_steps_)
                         : -left_along(world, around_[n], occlusion_steps_);
    }
    sum /= static_cast<double>(around_.size());
    return surfaces_ ? sum : sum + (volumes_.openness ? volumes_.openness->at(world) : 1.0);
}

PointValues::Value LightAtPoints::value_at(std::size_t group, const Vec3& world) const {
    PointValues::Value sum;
    for (std::size_t field = groups_[group].first; field < groups_[group].last; ++field) {
        const PointValues::Value one = values_[field]->at(world);
        sum = {sum.rho + one.rho, sum.empty && one.empty};
    }
    return sum;
}

PointValues::Value LightAtPoints::mean_between(std::size_t group, const Vec3& from, const Vec3& to) const {
    PointValues::Value sum;
    for (std::size_t field = groups_[group].first; field < groups_[group].last; ++field) {
        const PointValues::Value one = values_[field]->mean(from, to);
        sum = {sum.rho + one.rho, sum.empty && one.empty};
    }
    return sum;
}

// What a line through the grid of rho leaves of light, less what the definition leaves. rho is computed from the
// kernels where the grid leaves open on which side of a surface a point is.
double LightAtPoints::line_off(const Vec3& world, const Vec3& direction, const Vec3& step, double steps) const {
    const Vec3 place = volumes_.groups.front()->place_of(world);
    const double last = std::min(lines_.last_step(place, step), steps);
    double absorbed = 0.0, drawn = 0.0;
    for (std::size_t group = 0; group < groups_.size(); ++group) {
        double before = 0.0, drawn_before = 0.0;
        for (double point = 1.0; point <= last; point += 1.0) {
            if (absorbed >= SurfaceLines::opaque && drawn >= SurfaceLines::opaque) {
                break;
            }
            const Vec3 there = place + point * step;
            double here = side_at(group, there), drawn_here = here;
            if (here == mixed) {
                const LightVolume::Around around = volumes_.groups[group]->around(there);
                const Vec3 at = world + point * frame_.slice_spacing * direction;
                drawn_here = lines_.absorbed_below(around.number);
                here = lines_.absorbed_below(side_in_cell(group, at, around).rho / plan_.value_unit);
            }
            absorbed += point > 1.0 ? std::abs(here - before) : 0.0;
            drawn += point > 1.0 ? std::abs(drawn_here - drawn_before) : 0.0;
            before = here;
            drawn_before = drawn_here;
        }
    }
    return SurfaceLines::left_of(drawn) - SurfaceLines::left_of(absorbed);
}

// What the definition leaves of light in mode composite.
double LightAtPoints::left_along(const Vec3& world, const Vec3& direction, double steps) const {
    double end = std::numeric_limits<double>::max();
    for (int axis = 0; axis < 3; ++axis) {
        if (direction[axis] != 0.0) {
            const double side = direction[axis] > 0.0 ? box_.upper[axis] : box_.lower[axis];
            end = std::min(end, (side - world[axis]) / direction[axis]);
        }
    }
    const double last = std::min(steps, std::floor(end / frame_.slice_spacing) + 1.0);
    const Vec3 step = frame_.slice_spacing * direction;
    const ClearLine line = clear_line(world, step);
    double left = 1.0;
    for (double number = 1.0; number <= last && left > dark; number += 1.0) {
        if (clear_at(line, number)) {
            continue;
        }
        const Vec3 point = world + number * step;
        if (!clip_keeps(point)) {
            continue;
        }
        for (std::size_t group = 0; group < groups_.size(); ++group) {
            const PointValues::Value value = value_at(group, point);
            if (!value.empty) {
                const double opacity = reference::look_up(*groups_[group].transfer_function, value.rho).opacity;
                left *= opacity > 0.0 ? 1.0 - reference::opacity_over(opacity, lengths_) : 1.0;
            }
        }
    }
    return left;
}

} // namespace sheetsplat

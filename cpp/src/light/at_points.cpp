#include "at_points.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include <glm/common.hpp>
#include <glm/vector_relational.hpp>

#include "light/grids.hpp"
#include "reference/classify.hpp"

namespace sheetsplat {

namespace {

/// Where a grid shows all kernels, rho between elements is no farther from theirs than this share of what they differ
/// by.
constexpr double margin_of_cell = 0.5;
/// What is left of light where it no longer matters how much.
constexpr double dark = 1e-4;
constexpr double all_steps = std::numeric_limits<double>::max();

/// From where to where a line is in a box, in units of its direction; first > second: nowhere.
std::pair<double, double> within(const Parallelepiped& cell, const Vec3& world, const Vec3& along) {
    const Box& box = cell.box;
    const Vec3 start = cell.to_box * world, direction = cell.to_box * along;
    double from = -all_steps, to = all_steps;
    for (int axis = 0; axis < 3; ++axis) {
        if (direction[axis] != 0.0) {
            const double a = (box.lower[axis] - start[axis]) / direction[axis];
            const double b = (box.upper[axis] - start[axis]) / direction[axis];
            from = std::max(from, std::min(a, b));
            to = std::min(to, std::max(a, b));
        } else if (start[axis] < box.lower[axis] || start[axis] > box.upper[axis]) {
            return {1.0, 0.0};
        }
    }
    return {from, to};
}

/// What a scene draws: the cell of a part, or all points.
Parallelepiped cell_of(const Scene& scene) {
    constexpr double far = std::numeric_limits<double>::infinity();
    return scene.part ? scene.part->cell : Parallelepiped(Box{Vec3(-far), Vec3(far)});
}

} // namespace

LightAtPoints::LightAtPoints(const LitView& lit, const LightVolumes& volumes, const LightVolume* absorption,
                             const BlocksOf& blocks, const ClearOf& clear,
                             std::vector<std::shared_ptr<const PointValues>> values)
    : scene_(lit.scene), camera_(lit.camera), frame_(lit.frame), plan_(lit.plan), volumes_(volumes),
      values_(std::move(values)), surfaces_(!volumes.groups.empty()), groups_(scene_.groups()),
      label_sets_(label_sets(groups_)), clipping_(scene_, camera_), cell_(cell_of(scene_)),
      box_(supports_world(scene_)), lengths_(frame_.slice_spacing / frame_.reference_length),
      together_(steps_together(scene_)) {
    if (plan_.filter) {
        double wider = 0.0;
        for (const auto& field : scene_.fields) {
            const FilterWidth width =
                filter_width(frame_, field->kernel(), frame_.depth_of(std::max<std::int64_t>(frame_.slices, 1) - 1));
            wider = std::max({wider, width.across, width.along});
        }
        box_ = {box_.lower - wider, box_.upper + wider};
    }
    for (const Light& light : scene_.lights) {
        to_lights_.push_back(world_direction(light, camera_));
    }
    if (surfaces_) {
        // The filter widens and lowers kernels by the view, and not as much in the grid.
        resolved_ = !plan_.filter && shows_kernels(scene_, *volumes.groups.front());
        lines_ = make_surface_lines(scene_, camera_, *volumes.groups.front(), frame_.slice_spacing, plan_.value_unit);
        for (std::size_t group = 0; group < volumes.groups.size(); ++group) {
            sides_.push_back(sides_of(group, blocks(*volumes.groups[group])));
        }
    } else if (absorption != nullptr && shows_matter(scene_, plan_, *absorption)) {
        absorption_ = absorption;
        clear_ = &clear();
    }
    if (scene_.ambient_occlusion) {
        occlusion_steps_ = occlusion_steps(*scene_.ambient_occlusion, frame_.slice_spacing);
    }
}

LightAtPoints::Sides LightAtPoints::sides_of(std::size_t group, const LightBlocks& blocks) const {
    Sides sides{&blocks, {}};
    for (const LightBlocks::Range& range : blocks.ranges()) {
        const auto least = static_cast<double>(range.least), greatest = static_cast<double>(range.greatest);
        const double margin = margin_of_cell * (greatest - least);
        const double below = lines_.absorbed_below(group, least - margin);
        sides.below.push_back(resolved_ && below == lines_.absorbed_below(group, greatest + margin) ? below : mixed);
    }
    return sides;
}

double LightAtPoints::side_at(std::size_t group, const Vec3& place) const {
    return sides_[group].below[sides_[group].blocks->at(place)];
}

double LightAtPoints::absorbed_below(std::size_t group, double rho) const {
    return lines_.absorbed_below(group, rho / plan_.value_unit);
}

bool LightAtPoints::inside_end(std::size_t group, const Vec3& world) const {
    if (!scene_.counted || scene_.counted->ends.empty()) {
        return true;
    }
    const std::optional<Parallelepiped>& end = scene_.counted->ends[group];
    return !end || end->holds(world);
}

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
    const bool sure = resolved_ && lines_.absorbed_below(group, around.least - margin) ==
                                       lines_.absorbed_below(group, around.greatest + margin);
    return sure ? PointValues::Value{plan_.value_unit * around.number, false} : value_at(group, world);
}

bool LightAtPoints::clip_keeps(const Vec3& world) const {
    return scene_.clip.empty() || clipping_.keeps(camera_.to_eye(world));
}

double LightAtPoints::light_shown(std::size_t number, const Vec3& world) const {
    if (surfaces_) {
        const LightVolume& grid = *volumes_.groups.front();
        const Vec3 place = grid.place_of(world), &step = lines_.to_lights[number];
        return lines_.left_along(volumes_, place, step, all_steps);
    }
    const bool drawn = number < volumes_.lights.size() && volumes_.lights[number];
    return drawn ? volumes_.lights[number]->at(world) : 1.0;
}

double LightAtPoints::open_shown(const Vec3& world) const {
    if (!surfaces_) {
        return volumes_.openness ? volumes_.openness->at(world) : 1.0;
    }
    const Vec3 place = volumes_.groups.front()->place_of(world);
    double sum = 0.0;
    for (const Vec3& step : lines_.around) {
        sum += lines_.left_along(volumes_, place, step, occlusion_steps_);
    }
    return sum / static_cast<double>(around_.size());
}

double LightAtPoints::light_here(std::size_t number, const Vec3& world) const {
    return surfaces_ ? absorbed_along(world, to_lights_[number], lines_.to_lights[number], all_steps)
                     : left_along(world, to_lights_[number], all_steps);
}

double LightAtPoints::open_here(std::size_t direction, const Vec3& world) const {
    return surfaces_ ? absorbed_along(world, around_[direction], lines_.around[direction], occlusion_steps_)
                     : left_along(world, around_[direction], occlusion_steps_);
}

bool LightAtPoints::holds(const Vec3& world) const {
    const Vec3 at = cell_.to_box * world;
    return glm::all(glm::lessThanEqual(cell_.box.lower, at)) && glm::all(glm::lessThan(at, cell_.box.upper));
}

template <class Of>
PointValues::Value LightAtPoints::sum_of(std::size_t group, const Vec3& world, const Of& of) const {
    PointValues::Value sum;
    for (std::size_t field = groups_[group].first; field < groups_[group].last; ++field) {
        const PointValues::Value one = of(*values_[field]);
        sum = {sum.rho + one.rho, sum.empty && one.empty};
    }
    double largest = 0.0;
    for (const GroupRange& set : label_sets_) {
        for (std::size_t other = set.first; other < set.last && group >= set.first && group < set.last; ++other) {
            largest = other != group ? std::max(largest, of(*values_[groups_[other].first]).rho) : largest;
        }
    }
    sum.rho -= largest;
    sum.empty = sum.empty || !inside_end(group, world);
    return sum;
}

PointValues::Value LightAtPoints::value_at(std::size_t group, const Vec3& world) const {
    return sum_of(group, world, [&](const PointValues& values) { return values.at(world); });
}

PointValues::Value LightAtPoints::mean_between(std::size_t group, const Vec3& from, const Vec3& to) const {
    return sum_of(group, 0.5 * from + 0.5 * to, [&](const PointValues& values) { return values.mean(from, to); });
}

double LightAtPoints::last_step(const Vec3& world, const Vec3& direction, const Vec3& place, const Vec3& step) const {
    // The grid has the supports as they are, of which a filter makes wider ones.
    return plan_.filter ? std::floor(within(box_, world, direction).second / frame_.slice_spacing) + 1.0
                        : lines_.last_step_in_grid(place, step);
}

// What surfaces in the cell absorb on a line: those between a point in it and the one before.
double LightAtPoints::absorbed_along(const Vec3& world, const Vec3& direction, const Vec3& step, double steps) const {
    const Vec3 place = volumes_.groups.front()->place_of(world);
    const double spacing = frame_.slice_spacing;
    const auto [from, to] = within(cell_, world, direction);
    const double first = std::max(2.0, std::floor(from / spacing));
    const double last = std::min({last_step(world, direction, place, step), steps, std::floor(to / spacing) + 1.0});
    const auto below = [&](std::size_t group, double point) {
        const Vec3 there = place + point * step;
        const double side = side_at(group, there);
        const Vec3 at = world + point * spacing * direction;
        return side != mixed
                   ? side
                   : absorbed_below(group, side_in_cell(group, at, volumes_.groups[group]->around(there)).rho);
    };
    double absorbed = 0.0;
    for (std::size_t group = 0; group < groups_.size(); ++group) {
        const SurfaceLines::Run run = lines_.run_kept(group, place, step);
        const double behind = std::min(last, run.last);
        for (double point = std::max(first, run.first + 1.0); point <= behind && absorbed < SurfaceLines::opaque;
             point += 1.0) {
            if (holds(world + point * spacing * direction)) {
                absorbed += std::abs(below(group, point) - below(group, point - 1.0));
            }
        }
    }
    return absorbed;
}

// What the points of a line in the cell leave of light in mode composite, by the definition.
double LightAtPoints::left_along(const Vec3& world, const Vec3& direction, double steps) const {
    const auto [from_cell, to_cell] = within(cell_, world, direction);
    const auto [from_all, to_all] = within(box_, world, direction);
    const double from = std::max(from_cell, from_all), to = std::min(to_cell, to_all);
    const double last = std::min(steps, std::floor(to / frame_.slice_spacing) + 1.0);
    const Vec3 step = frame_.slice_spacing * direction;
    const ClearLine line = clear_line(world, step);
    double left = 1.0;
    // The same steps are taken together in every part of a volume.
    double first =
        1.0 + together_ * std::floor(std::max(0.0, std::floor(from / frame_.slice_spacing) - 1.0) / together_);
    for (; first <= last && left > dark; first += together_) {
        const double taken = std::min(together_, steps - first + 1.0);
        const double number = first + 0.5 * (taken - 1.0);
        if (clear_at(line, number)) {
            continue;
        }
        const Vec3 point = world + number * step;
        if (!holds(point) || !clip_keeps(point)) {
            continue;
        }
        for (std::size_t group = 0; group < groups_.size(); ++group) {
            if (!is_classified(groups_[group])) {
                continue;
            }
            const PointValues::Value value = value_at(group, point);
            if (!value.empty) {
                const double opacity = reference::look_up(*groups_[group].transfer_function, value.rho).opacity;
                left *= opacity > 0.0 ? 1.0 - reference::opacity_over(opacity, taken * lengths_) : 1.0;
            }
        }
    }
    return left;
}

} // namespace sheetsplat

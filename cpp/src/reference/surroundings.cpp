#include "reference/surroundings.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include <glm/common.hpp>
#include <glm/geometric.hpp>

#include "reference/classify.hpp"
#include "scene/mode_rules.hpp"

namespace sheetsplat::reference {

Surroundings::Surroundings(const CountedScene& counted, const Camera& camera, const Screen& screen,
                           const Clipping& clipping, double radius_factor)
    : counted_(counted), scene_(counted.scene()), clipping_(clipping), groups_(scene_.groups()),
      label_sets_(label_sets(groups_)), spacing_(scene_.slice_distance()),
      lengths_(scene_.slice_distance() / scene_.reference_distance()) {
    for (std::size_t group = 0; group < groups_.size(); ++group) {
        ends_.emplace_back(counted.end_of_group(group), camera, spacing_);
    }
    for (const auto& field : scene_.fields) {
        fields_.emplace_back(*field, scene_, camera, screen, radius_factor);
        const Box& box = fields_.back().supports_eye();
        if (!box.empty()) {
            supports_eye_ = supports_eye_.empty() ? box
                                                  : Box{glm::min(supports_eye_.lower, box.lower),
                                                        glm::max(supports_eye_.upper, box.upper)};
        }
    }
    if (scene_.ambient_occlusion) {
        // A radius of whole slice distances may come out a little short.
        occlusion_steps_ = std::max(1.0, std::floor(scene_.ambient_occlusion->radius / spacing_ + 1e-6));
    }
    std::size_t next = 0;
    for (int x = -1; x <= 1; ++x) {
        for (int y = -1; y <= 1; ++y) {
            for (int z = -1; z <= 1; ++z) {
                const int parts = std::abs(x) + std::abs(y) + std::abs(z);
                if (parts == 1 || parts == 3) {
                    const Vec3 world = glm::normalize(Vec3(x, y, z));
                    around_[next++] = Vec3(glm::dot(world, camera.right_world()), glm::dot(world, camera.up_world()),
                                           glm::dot(world, camera.back_world()));
                }
            }
        }
    }
}

double Surroundings::steps_to_end(const Vec3& point_eye, const Vec3& direction) const {
    if (supports_eye_.empty()) {
        return 0.0;
    }
    double end = std::numeric_limits<double>::infinity();
    for (int axis = 0; axis < 3; ++axis) {
        if (direction[axis] != 0.0) {
            const double side = direction[axis] > 0.0 ? supports_eye_.upper[axis] : supports_eye_.lower[axis];
            end = std::min(end, (side - point_eye[axis]) / direction[axis]);
        }
    }
    // One more for rounding: points outside are empty.
    return std::floor(end / spacing_) + 1.0;
}

Surroundings::Place Surroundings::look_at(const Vec3& point_eye, double nudge) const {
    Place place;
    place.kept = clipping_.keeps(point_eye);
    for (std::size_t number = 0; number < groups_.size(); ++number) {
        const Group& group = groups_[number];
        GroupValue value;
        value.ended = !ends_[number].keeps(point_eye);
        for (std::size_t field = group.first; field < group.last; ++field) {
            const PointSums::Value one = fields_[field].at(point_eye);
            value.rho += one.rho;
            value.empty = value.empty && one.empty;
        }
        place.groups.push_back(value);
    }
    for (const GroupRange& set : label_sets_) {
        const std::vector<GroupValue> own(place.groups.begin(), place.groups.end());
        for (std::size_t label = set.first; label < set.last; ++label) {
            double largest = 0.0;
            for (std::size_t other = set.first; other < set.last; ++other) {
                largest = other != label ? std::max(largest, own[other].rho) : largest;
            }
            place.groups[label].rho -= largest;
        }
    }
    for (std::size_t number = 0; number < groups_.size(); ++number) {
        const TransferFunction& function = *groups_[number].transfer_function;
        place.groups[number].rho += nudge * (function.v_max() - function.v_min());
    }
    return place;
}

double Surroundings::left_at(const Place& place) const {
    double left = 1.0;
    for (std::size_t group = 0; place.kept && group < groups_.size(); ++group) {
        const GroupValue& value = place.groups[group];
        if (is_classified(groups_[group]) && !value.empty && !value.ended) {
            left *= 1.0 - opacity_over(look_up(*groups_[group].transfer_function, value.rho).opacity, lengths_);
        }
    }
    return left;
}

double Surroundings::left_between(const Place& front, const Place& back) const {
    double left = 1.0;
    if (!front.kept || !back.kept) {
        return left;
    }
    for (std::size_t group = 0; group < groups_.size(); ++group) {
        if (front.groups[group].ended || back.groups[group].ended) {
            continue;
        }
        const auto below = [&](const GroupValue& value, double iso) {
            return value.rho < iso || (is_label(groups_[group]) && value.empty);
        };
        for (const IsoValue& iso : counted_.iso_values(group)) {
            if (below(front.groups[group], iso.value) != below(back.groups[group], iso.value)) {
                left *= 1.0 - iso.opacity;
            }
        }
    }
    return left;
}

double Surroundings::left_along(const Vec3& point_eye, const Vec3& direction, double steps, double nudge) const {
    const double end = steps_to_end(point_eye, direction);
    const auto place_at = [&](double step) { return look_at(point_eye + step * spacing_ * direction, nudge); };
    double left = 1.0;
    if (shows_surfaces(scene_.mode)) {
        // Beyond the end all points are empty: only the one next to it can lie on the other side of a surface.
        const double last = std::min(steps - 1.0, end);
        Place front = last >= 1.0 ? place_at(1.0) : Place{};
        for (double step = 1.0; step <= last && left > 0.0; step += 1.0) {
            Place back = place_at(step + 1.0);
            left *= left_between(front, back);
            front = std::move(back);
        }
        return left;
    }
    const double last = std::min(steps, end);
    for (double step = 1.0; step <= last && left > 0.0; step += 1.0) {
        left *= left_at(place_at(step));
    }
    return left;
}

double Surroundings::light(const Vec3& point_eye, const Vec3& to_light, double nudge) const {
    return left_along(point_eye, to_light, std::numeric_limits<double>::infinity(), nudge);
}

double Surroundings::ambient(const Vec3& point_eye, double nudge) const {
    double sum = 0.0;
    for (const Vec3& direction : around_) {
        sum += left_along(point_eye, direction, occlusion_steps_, nudge);
    }
    const double open = sum / static_cast<double>(around_.size());
    return 1.0 - scene_.ambient_occlusion->strength * (1.0 - open);
}

} // namespace sheetsplat::reference

#include "reference/counted.hpp"

#include <algorithm>
#include <array>
#include <memory>
#include <optional>
#include <utility>

#include "scene/mode_rules.hpp"

namespace sheetsplat::reference {

namespace {

TransferFunction counted_from(double base, const TransferFunction& function) {
    std::vector<TransferPoint> points = function.points();
    for (TransferPoint& point : points) {
        point.value -= base;
    }
    return TransferFunction(std::move(points));
}

} // namespace

CountedScene::CountedScene(const Scene& scene) : scene_(scene) {
    const std::vector<Group> groups = scene.groups();
    for (std::size_t number = 0; number < groups.size(); ++number) {
        const Group& group = groups[number];
        bool differ = false;
        for (std::size_t field = group.first; field < group.last; ++field) {
            differ = differ || scene.fields[field]->domain() != scene.fields[group.first]->domain();
        }
        double base = 0.0;
        for (std::size_t field = group.first; field < group.last; ++field) {
            std::shared_ptr<const Field>& drawn = scene_.fields[field];
            const RegularField* lattice = as_regular(drawn.get());
            if (differ && lattice != nullptr && (lattice->domain() || lattice->base() != 0.0)) {
                drawn = lattice->without_end();
            } else if (differ && lattice == nullptr && drawn->domain()) {
                drawn = as_ellipsoids(drawn.get())->without_end();
            }
            base += drawn->base();
        }
        TransferFunction& function =
            number == 0 ? scene_.transfer_function : scene_.later_groups[number - 1].transfer_function;
        function = counted_from(base, function);
        iso_values_.emplace_back();
        if (group.use.role == GroupRole::label) {
            iso_values_.back().emplace_back(0.0, function.points().back().opacity);
        } else if (group.use.role == GroupRole::shown) {
            iso_values_.back() = scene.iso_values;
        }
        for (IsoValue& iso : iso_values_.back()) {
            iso.value -= base;
        }
    }
    for (const std::shared_ptr<const Field>& field : scene_.fields) {
        ends_.push_back({{}, field->domain()});
        if (scene.part && scene.part->domain) {
            ends_.back().planes = Clip{{}, scene.part->domain}.half_spaces();
        }
    }
    for (const Group& group : groups_drawn(scene_)) {
        group_ends_.push_back(is_scalar(scene.mode) ? Clip{} : ends_[group.first]);
    }
}

double CountedScene::weakest_difference(const Group& group) const {
    double range = 0.0;
    for (std::size_t field = group.first; field < group.last; ++field) {
        const std::array<double, 2> values = scene_.fields[field]->value_range();
        range = std::max(range, values[1] - values[0]);
    }
    const double window = group.transfer_function->v_max() - group.transfer_function->v_min();
    return 1e-3 * std::max(window, range / 4096.0);
}

} // namespace sheetsplat::reference

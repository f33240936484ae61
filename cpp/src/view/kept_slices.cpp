#include "view/kept_slices.hpp"

#include <algorithm>
#include <cmath>

#include <glm/geometric.hpp>
#include <glm/gtc/matrix_access.hpp>

#include "scene/mode_rules.hpp"
#include "view/half_spaces.hpp"

namespace sheetsplat {

namespace {

/// A point so little in front of a surface, in slice distances, is at it.
constexpr double rounding = 1e-6;
/// Beyond all slices that there can be.
constexpr double no_end = 1 << 30;

} // namespace

SlicesInFront::SlicesInFront(const DepthLimit* limit, const Frame& frame)
    : limit_(limit), first_depth_(frame.first_depth), spacing_(frame.slice_spacing), slices_(frame.slices) {}

std::int32_t SlicesInFront::last(int column, int row) const {
    const auto behind_all = static_cast<std::int32_t>(slices_ + 1);
    if (limit_ == nullptr || column < 0 || row < 0 || column >= limit_->size().width || row >= limit_->size().height) {
        return behind_all;
    }
    const double place = (limit_->at(column, row) - first_depth_) / spacing_ - rounding;
    return static_cast<std::int32_t>(std::clamp(std::ceil(place) - 1.0, -2.0, static_cast<double>(behind_all)));
}

KeptSlices::KeptSlices(const Scene& scene, const DrawPlan& plan, const Camera& camera, const Frame& frame)
    : KeptSlices(plan.clip ? &scene.clip : nullptr,
                 plan.depth_limit && scene.depth_limit ? &*scene.depth_limit : nullptr, plan, camera, frame) {}

KeptSlices::KeptSlices(const Clip& clip, const DrawPlan& plan, const Camera& camera, const Frame& frame)
    : KeptSlices(&clip, nullptr, plan, camera, frame) {}

KeptSlices::KeptSlices(const Clip* clip, const DepthLimit* limit, const DrawPlan& plan, const Camera& camera,
                       const Frame& frame)
    : axis_x_(frame.axis_x), axis_y_(frame.axis_y), pixel_(frame.pixel),
      least_(uses_intervals(plan.mode, plan.preintegration) ? -no_end : 0.0),
      most_(uses_intervals(plan.mode, plan.preintegration) ? no_end : static_cast<double>(frame.slices - 1)),
      in_front_(limit, frame) {
    const double spacing = frame.slice_spacing;
    const double depth = frame.first_depth;
    for (const KeptHalfSpace& half :
         clip != nullptr ? half_spaces_in_eye(*clip, camera, spacing) : std::vector<KeptHalfSpace>{}) {
        const Vec3& normal = half.normal;
        if (frame.projection == Projection::perspective) {
            planes_.push_back({{half.distance - depth * normal.z, depth * normal.x, depth * normal.y},
                               {-spacing * normal.z, spacing * normal.x, spacing * normal.y}});
        } else {
            planes_.push_back(
                {{half.distance - depth * normal.z, normal.x, normal.y}, {-spacing * normal.z, 0.0, 0.0}});
        }
    }
}

SliceRun KeptSlices::at(int column, int row) const {
    const double x = (column + 0.5 - axis_x_) * pixel_;
    const double y = (axis_y_ - row - 0.5) * pixel_;
    double first = least_, last = std::min(static_cast<double>(in_front_.last(column, row)), most_);
    for (const Plane& plane : planes_) {
        const double start = plane.start.at(x, y);
        const double step = plane.step.at(x, y);
        if (step > 0.0) {
            first = std::max(first, std::min(std::ceil(-start / step), no_end));
        } else if (step < 0.0) {
            last = std::min(last, std::max(std::floor(start / -step), -no_end));
        } else if (!(start >= 0.0)) {
            last = first - 1.0;
        }
    }
    if (first > last) {
        return {};
    }
    return {static_cast<std::int32_t>(first), static_cast<std::int32_t>(last)};
}

OwnedSlices::OwnedSlices(const Part& part, const Camera& camera, const Frame& frame)
    : axis_x_(frame.axis_x), axis_y_(frame.axis_y), pixel_(frame.pixel), slices_(static_cast<double>(frame.slices)) {
    const double spacing = frame.slice_spacing, depth = frame.first_depth;
    for (int axis = 0; axis < 3; ++axis) {
        const Vec3 row = glm::row(part.cell.to_box, axis);
        const double at_eye = glm::dot(row, camera.eye());
        const double lower = part.cell.box.lower[axis] - at_eye, upper = part.cell.box.upper[axis] - at_eye;
        if (std::isinf(lower) && std::isinf(upper)) {
            continue;
        }
        const double across = glm::dot(row, camera.right_world()), up = glm::dot(row, camera.up_world());
        const double back = glm::dot(row, camera.back_world());
        if (frame.projection == Projection::perspective) {
            axes_.push_back({{-depth * back, depth * across, depth * up},
                             {-spacing * back, spacing * across, spacing * up},
                             lower,
                             upper});
        } else {
            axes_.push_back({{-depth * back, across, up}, {-spacing * back, 0.0, 0.0}, lower, upper});
        }
    }
}

SliceRun OwnedSlices::at(int column, int row) const {
    const double x = (column + 0.5 - axis_x_) * pixel_;
    const double y = (axis_y_ - row - 0.5) * pixel_;
    double first = -1.0, last = slices_;
    for (const Axis& axis : axes_) {
        const double start = axis.start[0] + x * axis.start[1] + y * axis.start[2];
        const double step = axis.step[0] + x * axis.step[1] + y * axis.step[2];
        // The slices at or above a face: from the first one on where the ray rises, up to the last one where it falls.
        const auto boundary = [&](double face) {
            const double place = (face - start) / step;
            return step > 0.0 ? std::ceil(place) : std::floor(place) + 1.0;
        };
        if (step == 0.0) {
            last = start >= axis.lower && start < axis.upper ? last : -1.0;
        } else if (step > 0.0) {
            first = std::max(first, boundary(axis.lower));
            last = std::min(last, boundary(axis.upper) - 1.0);
        } else {
            first = std::max(first, boundary(axis.upper));
            last = std::min(last, boundary(axis.lower) - 1.0);
        }
    }
    if (last < 0.0 || !(first <= last)) {
        return {};
    }
    return {static_cast<std::int32_t>(first <= 0.0 ? -1.0 : first), static_cast<std::int32_t>(last)};
}

} // namespace sheetsplat

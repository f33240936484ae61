#include "occurring.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include <glm/geometric.hpp>

#include "scene/mode_rules.hpp"

namespace sheetsplat {

namespace {

constexpr double infinity = std::numeric_limits<double>::infinity();
/// Rounding of sums and quotients in float32 must not carry rho past a bound.
constexpr double rounding = 1e-5;
/// Points so many slice distances before a plane count as on it.
constexpr double on_the_plane = 1e-6;

/// 0 stays 0, however often it is added.
double times(double value, double factor) { return value == 0.0 ? 0.0 : value * factor; }

Range values_of(const Field& field, const Scene& scene, const ViewFacts& view) {
    if (field.size() == 0) {
        return {};
    }
    const auto [low, high] = field.value_range();
    Range range{std::min(low, 0.0), std::max(high, 0.0)};
    if (field.normalization() == Normalization::threshold) {
        return range;
    }
    double factor = infinity;
    // Widened kernels of a lattice keep their mass but no longer lie as the bound of the ripple takes them.
    if (const RegularField* regular = as_regular(&field); regular != nullptr && scene.filter == Filter::none) {
        factor = view.lattice_peaks.at(&field) *
                 (field.normalization() == Normalization::none ? regular->lattice_constant() : 1.0);
    }
    return {times(range.lower, factor), times(range.upper, factor)};
}

/// Smallest and largest dot(normal, x) over a box.
Range along(const Box& box, const Vec3& normal) {
    Range range;
    for (int axis = 0; axis < 3; ++axis) {
        const double a = normal[axis] * box.lower[axis];
        const double b = normal[axis] * box.upper[axis];
        range.lower += std::min(a, b);
        range.upper += std::max(a, b);
    }
    return range;
}

} // namespace

Range occurring_values(const Scene& scene, const ViewFacts& view, const Group& group) {
    Range sum;
    for (std::size_t field = group.first; field < group.last; ++field) {
        const Range one = values_of(*scene.fields[field], scene, view);
        sum.lower += one.lower;
        sum.upper += one.upper;
    }
    if (is_label(group)) {
        // The largest of the others is subtracted.
        sum.lower = -sum.upper;
    }
    const double spread = sum.upper - sum.lower;
    // The cubic through four slices leaves the range of the two in its middle by an eighth of the spread at most.
    const double beyond = spread * (rounding + (scene.second_order ? 0.125 : 0.0));
    return {sum.lower == 0.0 && !scene.second_order ? 0.0 : sum.lower - beyond,
            sum.upper == 0.0 && !scene.second_order ? 0.0 : sum.upper + beyond};
}

double most_opaque(const TransferFunction& function, const Range& values) {
    if (function.transparent_over(values.lower, values.upper)) {
        return 0.0;
    }
    double largest = std::max(function.at(values.lower).opacity, function.at(values.upper).opacity);
    for (const TransferPoint& point : function.points()) {
        if (point.value >= values.lower && point.value <= values.upper) {
            largest = std::max(largest, point.opacity);
        }
    }
    return largest;
}

Kept kept_by(const Scene& scene, const ViewFacts& view) {
    // Of a whole that is planned, any of its parts stands for all.
    const bool whole = scene.part && !scene.part->supports.empty();
    const Box supports = whole ? scene.part->supports : supports_world(scene);
    if (scene.clip.empty() || supports.empty()) {
        return Kept::everything;
    }
    if (scene.filter != Filter::none) {
        return Kept::something;
    }
    // A slab reaches half a slice distance beyond its middle, and a crossing has an end beyond the supports.
    const double slices = (scene.sampling == Sampling::slab ? 0.5 : 0.0) + (shows_surfaces(scene.mode) ? 1.0 : 0.0);
    const double margin = slices * view.frame.slice_spacing * view.frame.largest_slant;
    bool everything = true;
    for (const Clip::Plane& plane : scene.clip.half_spaces()) {
        const Range reach = along(supports, plane.normal);
        const double beyond = margin * glm::length(plane.normal);
        const double closed = on_the_plane * view.frame.slice_spacing * glm::length(plane.normal);
        if (reach.upper + beyond + closed < plane.offset) {
            return Kept::nothing;
        }
        everything = everything && reach.lower - beyond >= plane.offset;
    }
    return everything ? Kept::everything : Kept::something;
}

} // namespace sheetsplat

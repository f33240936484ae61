#include "reference/slices.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <sstream>

#include <glm/geometric.hpp>

#include "reference/kernels.hpp"
#include "sheetsplat/error.hpp"

namespace sheetsplat::reference {

namespace {

struct DepthRange {
    double front = std::numeric_limits<double>::infinity();
    double back = -std::numeric_limits<double>::infinity();
};

// Depths that any support reaches.
DepthRange support_depths(const Scene& scene, const Camera& camera, const Screen& screen, double radius_factor) {
    DepthRange range;
    if (scene.part) {
        return {scene.part->depths[0], scene.part->depths[1]};
    }
    for (const auto& field : scene.fields) {
        const EyeKernels kernels(*field, scene, camera, screen, radius_factor);
        kernels.for_each([&](std::uint64_t, const EyeKernel& kernel) {
            range.front = std::min(range.front, kernel.depth() - kernel.shape.half_depth());
            range.back = std::max(range.back, kernel.depth() + kernel.shape.half_depth());
        });
    }
    return range;
}

[[noreturn]] void too_many(double slices, double depth, double spacing) {
    std::ostringstream found, least;
    found << slices << " slices, " << spacing << " apart over " << depth << " world units of depth";
    least << depth / static_cast<double>(most_slices);
    throw InvalidInput(Complaint{"the scene cannot be sliced", found.str(),
                                 "at most " + std::to_string(most_slices) + " slices",
                                 "pass " + option_ref("slice_spacing", least.str()) + " or more", "slice_spacing"});
}

} // namespace

Slices find_slices(const Scene& scene, const Camera& camera, const Screen& screen, double radius_factor) {
    Slices slices;
    slices.spacing = scene.slice_distance();
    const Box centres = scene.centres_world();
    if (centres.empty()) {
        return slices;
    }
    // The eye first: the middle of two large coordinates would be rounded as they are.
    const Vec3 middle = 0.5 * (centres.lower - camera.eye()) + 0.5 * (centres.upper - camera.eye());
    slices.anchor = -glm::dot(middle, camera.back_world());

    // Slab n is [t_c + n ds, t_c + (n + 1) ds]; the supports are open, so one that only touches a slab does not meet
    // it.
    const DepthRange range = support_depths(scene, camera, screen, radius_factor);
    const double first_met = std::floor((range.front - slices.anchor) / slices.spacing);
    double first = first_met;
    const double last = std::ceil((range.back - slices.anchor) / slices.spacing) - 1.0;
    double visible_depth = range.back - range.front;
    const bool perspective = camera.projection() == Projection::perspective;
    if (perspective) {
        const double first_behind_near = std::floor((camera.near() - slices.anchor) / slices.spacing - 0.5) + 1.0;
        first = std::max(first, first_behind_near);
        visible_depth = std::min(visible_depth, range.back - camera.near());
    }
    if (!(first <= last)) {
        return slices;
    }
    if (!(last - first < static_cast<double>(most_slices))) {
        too_many(last - first + 1.0, visible_depth, slices.spacing);
    }
    // Numbers beyond 2^53 would no longer tell one slice from the next.
    constexpr double exact = 9007199254740992.0;
    if (std::abs(first) > exact || std::abs(last) > exact) {
        too_many(std::ceil((range.back - range.front) / slices.spacing), range.back - range.front, slices.spacing);
    }
    slices.first = static_cast<std::int64_t>(first);
    slices.count = static_cast<std::int64_t>(last) - slices.first + 1;
    // The division above rounds; whether a slice is in front of `near` is asked of its own depth.
    while (perspective && static_cast<double>(slices.first) > first_met &&
           slices.depth(slices.first - 1) > camera.near()) {
        --slices.first;
        ++slices.count;
    }
    while (perspective && slices.count > 0 && slices.depth(slices.first) <= camera.near()) {
        ++slices.first;
        --slices.count;
    }
    slices.cut_by_near = static_cast<double>(slices.first) > first_met;
    return slices;
}

} // namespace sheetsplat::reference

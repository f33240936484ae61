#include "facts/frame.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>

#include <glm/common.hpp>
#include <glm/geometric.hpp>

#include "base/checks.hpp"
#include "base/poll.hpp"
#include "sheetsplat/error.hpp"

namespace sheetsplat {

namespace {

constexpr double most_slices = 1e7;

/// Of the EWA filter, in pixels and in slice distances.
constexpr double filter_deviation = 0.5;

double filter_along(const Kernel& kernel, double slice_spacing) {
    return filter_deviation * kernel.deviations() * slice_spacing;
}

/// How far the kernels of a field reach along a direction once they are widened by `more`, squares added.
std::array<double, 2> filtered_reach(const Field& field, const Vec3& from, const Vec3& direction, double more) {
    const auto widened = [more](const std::array<double, 2>& reach, double half) {
        const double longer = std::hypot(half, more) - half;
        return std::array<double, 2>{reach[0] - longer, reach[1] + longer};
    };
    if (const RegularField* regular = as_regular(&field)) {
        return widened(field.reach_along(from, direction), glm::length(regular->kernel_axes().row(direction)));
    }
    std::array<double, 2> all{std::numeric_limits<double>::infinity(), -std::numeric_limits<double>::infinity()};
    const EllipsoidField& ellipsoids = *as_ellipsoids(&field);
    for (std::size_t i = 0; i < ellipsoids.size(); ++i) {
        poll_at(i);
        const std::array<double, 2> own = ellipsoids.reach_along(i, from, direction);
        const std::array<double, 2> wider = widened(own, 0.5 * (own[1] - own[0]));
        all = {std::min(all[0], wider[0]), std::max(all[1], wider[1])};
    }
    return all;
}

} // namespace

double Frame::smallest_pixel() const {
    return projection == Projection::orthographic ? pixel
                                                  : pixel * std::max(depth_of(0), std::numeric_limits<double>::min());
}

double Frame::largest_pixel() const {
    return projection == Projection::orthographic
               ? pixel
               : pixel * std::max(depth_of(std::max<std::int64_t>(slices, 1) - 1), 0.0);
}

double Frame::largest_slope() const {
    if (projection == Projection::orthographic) {
        return 0.0;
    }
    const double x = pixel * std::max(std::abs(axis_x), std::abs(size.width - axis_x));
    const double y = pixel * std::max(std::abs(axis_y), std::abs(size.height - axis_y));
    return std::hypot(x, y);
}

double Frame::largest_slant() const { return std::hypot(1.0, largest_slope()); }

Box supports_world(const Scene& scene) {
    Box all;
    for (const auto& field : scene.fields) {
        const Box own = field->size() > 0 ? field->supports_world() : Box{};
        if (!own.empty()) {
            all = all.empty() ? own : Box{glm::min(all.lower, own.lower), glm::max(all.upper, own.upper)};
        }
    }
    return all;
}

FilterWidth filter_width(const Frame& frame, const Kernel& kernel, double depth) {
    const double pixel =
        frame.projection == Projection::perspective ? frame.pixel * std::max(depth, frame.near) : frame.pixel;
    return {filter_deviation * kernel.deviations() * pixel, filter_along(kernel, frame.slice_spacing)};
}

Frame make_frame(const Scene& scene, const Camera& camera, Size size, const Reach& reach) {
    if (size.width < 1 || size.height < 1) {
        throw InvalidInput(
            Complaint{"the picture cannot be made",
                      "a size of " + std::to_string(size.width) + " x " + std::to_string(size.height) + " pixels",
                      "at least 1 x 1", "correct " + option_ref("size"), "size"});
    }
    Frame frame;
    frame.projection = camera.projection();
    frame.size = size;
    frame.pixel = 2.0 * camera.half_height() / size.height;
    frame.axis_x = 0.5 * size.width - camera.shift().x * size.height;
    frame.axis_y = 0.5 * size.height + camera.shift().y * size.height;
    frame.slice_spacing = scene.slice_distance();
    frame.reference_length = scene.reference_distance();
    frame.near =
        camera.projection() == Projection::perspective ? camera.near() : -std::numeric_limits<double>::infinity();

    const Box box = scene.centres_world();
    if (box.empty()) {
        return frame;
    }
    double nearest = std::numeric_limits<double>::infinity();
    double farthest = -nearest;
    if (scene.part) {
        nearest = scene.part->depths[0];
        farthest = scene.part->depths[1];
    }
    for (const auto& field : scene.fields) {
        if (field->size() == 0 || scene.part) {
            continue;
        }
        // Depth runs against the eye's z.
        const auto [behind, ahead] = scene.filter == Filter::ewa
                                         ? filtered_reach(*field, camera.eye(), camera.back_world(),
                                                          filter_along(field->kernel(), frame.slice_spacing))
                                     : reach ? reach(*field, camera.eye(), camera.back_world())
                                             : field->reach_along(camera.eye(), camera.back_world());
        nearest = std::min(nearest, -ahead);
        farthest = std::max(farthest, -behind);
    }
    const double spacing = frame.slice_spacing;
    const double centre = -camera.to_eye(box.centre()).z;
    // Slab n is [t_c + n ds, t_c + (n + 1) ds]. Slabs that only touch a support are there too, but do not meet it.
    double first = std::ceil((nearest - centre) / spacing - 1.0);
    const double last = std::floor((farthest - centre) / spacing);
    const double first_met = std::floor((nearest - centre) / spacing);
    if (camera.projection() == Projection::perspective) {
        double behind_near = std::floor((frame.near - centre) / spacing - 0.5) + 1.0;
        if (centre + (behind_near + 0.5) * spacing <= frame.near) {
            behind_near += 1.0;
        }
        frame.cut_by_near = behind_near > first_met;
        first = std::max(first, behind_near);
    }
    const double count = last - first + 1.0;
    if (!(count <= most_slices)) {
        // Rounded up, so that what is advised is also accepted.
        const double enough = (farthest - nearest) / most_slices * 1.01;
        throw InvalidInput(
            Complaint{"the scene cannot be sliced",
                      "a slice spacing of " + text_of(spacing) + " for a depth of " + text_of(farthest - nearest),
                      "at most 10,000,000 slices", "pass " + option_ref("slice_spacing", text_of(enough)) + " or more",
                      "slice_spacing"});
    }
    // Where an eye is so far away that its depths cannot tell slices apart, no sum would be right.
    const double largest_depth = std::max(std::abs(nearest), std::abs(farthest));
    const double resolution = largest_depth * std::numeric_limits<double>::epsilon();
    if (resolution > 1e-6 * std::min(spacing, farthest - nearest)) {
        throw InvalidInput(
            Complaint{"the scene cannot be sliced",
                      "depths up to " + text_of(largest_depth) + ", which float64 resolves to " + text_of(resolution),
                      "a resolution of a millionth of the slice spacing " + text_of(spacing),
                      "move the eye closer: an orthographic picture does not depend on its distance"});
    }
    frame.slices = count < 1.0 ? 0 : static_cast<std::int64_t>(count);
    frame.first_slice = static_cast<std::int64_t>(first);
    frame.first_met = static_cast<std::int64_t>(std::max(0.0, first_met - first));
    frame.first_depth = centre + (first + 0.5) * spacing;
    return frame;
}

} // namespace sheetsplat

#include "view/frame.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <string>

#include <glm/geometric.hpp>
#include <glm/matrix.hpp>

#include "base/checks.hpp"
#include "sheetsplat/error.hpp"

namespace sheetsplat {

namespace {

constexpr double most_slices = 1e7;

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
    for (const auto& field : scene.fields) {
        if (field->size() == 0) {
            continue;
        }
        // Depth runs against the eye's z.
        const auto [behind, ahead] = reach ? reach(*field, camera.eye(), camera.back_world())
                                           : field->reach_along(camera.eye(), camera.back_world());
        // A filter makes kernels up to a slice distance deeper.
        const double more = scene.filter == Filter::ewa ? scene.slice_distance() : 0.0;
        const double low = -ahead - more, high = -behind + more;
        nearest = std::min(nearest, low);
        farthest = std::max(farthest, high);
    }
    const double spacing = frame.slice_spacing;
    const double centre = -camera.to_eye(box.centre()).z;
    // Slab n is [t_c + n ds, t_c + (n + 1) ds].
    double first = std::ceil((nearest - centre) / spacing - 1.0);
    const double last = std::floor((farthest - centre) / spacing);
    if (camera.projection() == Projection::perspective) {
        double behind_near = std::floor((frame.near - centre) / spacing - 0.5) + 1.0;
        if (centre + (behind_near + 0.5) * spacing <= frame.near) {
            behind_near += 1.0;
        }
        frame.cut_by_near = behind_near > first;
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
    frame.first_depth = centre + (first + 0.5) * spacing;
    return frame;
}

Vec3 FieldView::eye_position(std::size_t i, std::size_t j, std::size_t k) const {
    Vec3 position =
        first_eye + static_cast<double>(i) * step_i + static_cast<double>(j) * step_j + static_cast<double>(k) * step_k;
    if (k % 2 == 1) {
        position += odd_layer;
    }
    return position;
}

FieldView make_field_view(const RegularField& field, const Camera& camera, const Frame& frame, Sampling sampling,
                          double value_unit) {
    FieldView view;
    view.field = &field;
    const Vec3 spacing = field.options().spacing;
    view.slab_half = sampling == Sampling::slab ? 0.5 * frame.slice_spacing : 0.0;
    view.first_eye = camera.to_eye(field.options().origin);
    const bool bcc = field.lattice() == Lattice::bcc;
    const Vec3 world_step = bcc ? Vec3(spacing.x, spacing.x, 0.5 * spacing.x) : spacing;
    view.step_i = camera.direction_to_eye(Vec3(world_step.x, 0.0, 0.0));
    view.step_j = camera.direction_to_eye(Vec3(0.0, world_step.y, 0.0));
    view.step_k = camera.direction_to_eye(Vec3(0.0, 0.0, world_step.z));
    if (bcc) {
        view.odd_layer = 0.5 * (view.step_i + view.step_j);
    }

    const Vec3 axes = field.semi_axes_world();
    // Rows of B = V S: the support's semi-axes are the world axes.
    const Vec3 row_x = camera.right_world() * axes;
    const Vec3 row_y = camera.up_world() * axes;
    const Vec3 row_z = camera.back_world() * axes;
    view.extent_x = glm::length(row_x);
    view.extent_y = glm::length(row_y);
    view.half_depth = glm::length(row_z);
    const Vec3 n = row_z / view.half_depth;
    const Vec3 helper = std::abs(n.x) < 0.6 ? Vec3(1.0, 0.0, 0.0) : Vec3(0.0, 1.0, 0.0);
    const Vec3 u = glm::normalize(glm::cross(n, helper));
    const Vec3 v = glm::cross(n, u);
    const glm::dmat2 plane(glm::dot(row_x, u), glm::dot(row_y, u), glm::dot(row_x, v), glm::dot(row_y, v));
    view.to_unit = glm::inverse(plane);
    const glm::dvec2 lean(glm::dot(row_x, n), glm::dot(row_y, n));
    const bool isotropic = axes.x == axes.y && axes.y == axes.z;
    if (isotropic) {
        // A sphere's cross-section needs no rotation; this one keeps u, v along eye x, y.
        view.to_unit = glm::dmat2(1.0 / axes.x, 0.0, 0.0, 1.0 / axes.x);
        view.shear = glm::dvec2(0.0);
        view.half_depth = view.extent_x = view.extent_y = axes.x;
    } else {
        view.shear = view.to_unit * lean;
        view.sheared = glm::length(view.shear) > 1e-12;
    }

    const double gain = field.kernel().gain();
    view.weight_scale = gain;
    view.value_scale = gain / value_unit;
    if (field.normalization() == Normalization::lattice) {
        view.value_scale /= field.lattice_constant();
    }
    const double slices = 2.0 * view.half_depth / frame.slice_spacing;
    view.longest_span =
        static_cast<std::int64_t>(std::min(std::floor(slices) + (sampling == Sampling::slab ? 2.0 : 1.0),
                                           static_cast<double>(std::max<std::int64_t>(frame.slices, 1))));
    return view;
}

} // namespace sheetsplat

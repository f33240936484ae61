#include "view/ellipsoid_view.hpp"

#include <cmath>
#include <limits>

#include <glm/geometric.hpp>
#include <glm/vec2.hpp>

#include "facts/widened.hpp"
#include "plan/limits_gl.hpp"
#include "plan/slab_nodes.hpp"

namespace sheetsplat {

namespace {

constexpr double log2_e = 1.4426950408889634;
/// Powers of two that float32 has room for.
constexpr double largest_exponent = 115.0;

} // namespace

EyeKernel slice_kernel(const Vec3& center_eye, const Vec3& row_x, const Vec3& row_y, const Vec3& row_z) {
    EyeKernel kernel;
    kernel.center = center_eye;
    kernel.extent = glm::dvec2(glm::length(row_x), glm::length(row_y));
    kernel.half_depth = glm::length(row_z);
    const Vec3 n = row_z / kernel.half_depth;
    const Vec3 helper = std::abs(n.x) < 0.6 ? Vec3(1.0, 0.0, 0.0) : Vec3(0.0, 1.0, 0.0);
    const Vec3 u = glm::normalize(glm::cross(n, helper));
    const Vec3 v = glm::cross(n, u);
    glm::dvec2 a(glm::dot(row_x, u), glm::dot(row_y, u));
    glm::dvec2 b(glm::dot(row_x, v), glm::dot(row_y, v));
    // One rotation of u and v makes their images orthogonal (one-sided Jacobi); the product of the two with themselves
    // would lose the shorter one.
    const double across = glm::dot(a, b);
    if (across != 0.0) {
        const double zeta = (glm::dot(b, b) - glm::dot(a, a)) / (2.0 * across);
        // std::hypot is needed only where a square would overflow, and takes longer than the rest.
        const double size = std::abs(zeta);
        const double t = (zeta >= 0.0 ? 1.0 : -1.0) / (size + (size < 1e150 ? std::sqrt(1.0 + size * size) : size));
        const double c = 1.0 / std::sqrt(1.0 + t * t);
        const glm::dvec2 turned = c * (a - t * b);
        b = c * (b + t * a);
        a = turned;
    }
    if (glm::dot(a, a) < glm::dot(b, b)) {
        std::swap(a, b);
    }
    kernel.axis_u = a;
    kernel.axis_v = b;
    kernel.lean = glm::dvec2(glm::dot(row_x, n), glm::dot(row_y, n));
    return kernel;
}

EllipsoidView::EllipsoidView(const EllipsoidField& field, const Camera& camera, const Frame& frame, Sampling sampling,
                             Filter filter, double value_unit, double weight_unit)
    : field_(&field), frame_(&frame), sampling_(sampling), filter_(filter), eye_(camera.eye()),
      right_(camera.right_world()), up_(camera.up_world()), back_(camera.back_world()),
      slab_half_(sampling == Sampling::slab ? 0.5 * frame.slice_spacing : 0.0), per_depth_(1.0 / frame.slice_spacing) {
    weight_scale_ = field.kernel().gain() / weight_unit;
    value_scale_ = weight_scale_ / value_unit;
    if (field.normalization() == Normalization::lattice) {
        value_scale_ /= field.lattice_constant();
    }
    spheres_ = field.isotropic() && filter == Filter::none && frame.projection == Projection::orthographic;
}

Vec3 EllipsoidView::center_eye(std::size_t i) const {
    const Vec3 from_eye = field_->center(i) - eye_;
    return Vec3(glm::dot(from_eye, right_), glm::dot(from_eye, up_), glm::dot(from_eye, back_));
}

FilterWidth EllipsoidView::filter_at(const Vec3& center) const {
    return filter_width(*frame_, field_->kernel(), -center.z);
}

EyeKernel EllipsoidView::kernel(std::size_t i) const {
    const Vec3 center = center_eye(i);
    if (field_->isotropic() && filter_ == Filter::none) {
        EyeKernel kernel;
        const double r = field_->arrays().radii[i];
        kernel.center = center;
        kernel.half_depth = r;
        kernel.axis_u = glm::dvec2(r, 0.0);
        kernel.axis_v = glm::dvec2(0.0, r);
        kernel.extent = glm::dvec2(r);
        return kernel;
    }
    const Mat3 m = field_->shape(i);
    WidenedShape shape{{right_ * m, up_ * m, back_ * m}, 1.0};
    if (filter_ == Filter::ewa) {
        shape = widened(shape.rows, field_->semi_axes(i), filter_at(center));
    }
    EyeKernel kernel = slice_kernel(center, shape.rows.x, shape.rows.y, shape.rows.z);
    kernel.amplitude = shape.amplitude;
    return kernel;
}

EllipsoidView::Depths EllipsoidView::depths(std::size_t i) const {
    const double center = -glm::dot(field_->center(i) - eye_, back_);
    double half = field_->isotropic() ? field_->arrays().radii[i] : glm::length(back_ * field_->shape(i));
    if (filter_ == Filter::ewa) {
        half = std::hypot(half, filter_width(*frame_, field_->kernel(), center).along);
    }
    return {center, half};
}

EllipsoidView::Span EllipsoidView::span(const Depths& depths, int wider) const {
    const double reach = depths.half * per_depth_ + (sampling_ == Sampling::slab ? 0.5 : 0.0) + wider;
    const double at = (depths.center - frame_->first_depth) * per_depth_;
    const double first = std::ceil(at - reach);
    const double last = std::floor(at + reach);
    if (!(last >= 0.0) || !(first <= static_cast<double>(frame_->slices - 1)) || first > last) {
        return {0, -1};
    }
    return {static_cast<std::int64_t>(std::max(first, 0.0)),
            static_cast<std::int64_t>(std::min(last, static_cast<double>(frame_->slices - 1)))};
}

SectionRecord EllipsoidView::record(std::size_t i, const EyeKernel& kernel, std::int64_t anchor, SectionRest* rest,
                                    const Counting& counting) const {
    const Frame& frame = *frame_;
    const double depth = frame.depth_of(anchor);
    const double s = (-kernel.center.z - depth) / kernel.half_depth;
    const double step_s = frame.slice_spacing / kernel.half_depth;
    // Rows count downwards, eye y upwards.
    const auto screen = [&](const glm::dvec2& eye) { return glm::dvec2(eye.x, -eye.y) / frame.pixel; };
    const glm::dvec2 lean = screen(kernel.lean);
    glm::dvec2 at = screen(glm::dvec2(kernel.center)) + s * lean;
    glm::dvec2 step = -step_s * lean;
    if (frame.projection == Projection::perspective) {
        at /= depth;
        step -= at * frame.slice_spacing;
    }
    // Beyond 2^24 float32 has no room for all whole pixels: what it leaves is part of the parts.
    const glm::dvec2 whole = glm::dvec2(glm::vec2(glm::floor(at)));
    const glm::dvec2 u = screen(kernel.axis_u);
    const glm::dvec2 v = screen(kernel.axis_v);
    const auto f = [](double value) { return static_cast<float>(value); };
    const double amount = field_->weight(i) * kernel.amplitude;
    SectionRecord record{};
    record.whole_x = f(whole.x);
    record.whole_y = f(whole.y);
    record.part_x = f(at.x - whole.x);
    record.part_y = f(at.y - whole.y);
    record.first = f(static_cast<double>(anchor));
    record.s = f(s);
    record.step_s = f(step_s);
    // A weight of 0 still reaches, by the least that is drawn: what D and W have of it is a value of 0.
    const double value = amount > 0.0 ? field_->value(i) : 0.0;
    record.weight = f(std::max(amount * weight_scale_, least_drawn_weight));
    record.value = counting.amount(value, record.weight, value * amount * value_scale_);
    record.ux = f(u.x);
    record.uy = f(u.y);
    record.vx = f(v.x);
    record.vy = f(v.y);
    record.step_x = f(step.x);
    record.step_y = f(step.y);
    if (rest != nullptr) {
        const auto left = [&](double number) { return f(number - static_cast<double>(f(number))); };
        *rest = SectionRest{left(at.x - whole.x),
                            left(at.y - whole.y),
                            left(s),
                            left(step_s),
                            left(u.x),
                            left(u.y),
                            left(v.x),
                            left(v.y),
                            left(step.x),
                            left(step.y),
                            {0.0F, 0.0F}};
    }
    return record;
}

SectionGroup EllipsoidView::group(std::size_t i, const Depths& depths, double sprite_px, double precise_aspect) const {
    const Vec3 axes = field_->semi_axes(i);
    double shortest = std::min({axes.x, axes.y, axes.z});
    const double pixel =
        frame_->projection == Projection::perspective ? frame_->pixel * std::abs(depths.center) : frame_->pixel;
    const bool tiny =
        std::isfinite(precise_aspect) && filter_ == Filter::none && shortest < gl_limits::least_plain_px * pixel;
    if (sampling_ == Sampling::point && spheres_ && !tiny && depths.half / frame_->pixel <= sprite_px) {
        return SectionGroup::sprite;
    }
    const double step_s = frame_->slice_spacing / depths.half;
    const bool precise = tiny || std::max({axes.x, axes.y, axes.z}) >= precise_aspect * shortest;
    double ray = 1.0;
    if (filter_ == Filter::ewa) {
        // A filtered kernel is no thinner than the filter.
        const FilterWidth width = filter_width(*frame_, field_->kernel(), depths.center);
        shortest = std::max(shortest, std::min(width.along, width.across));
        ray = depths.half / shortest;
    } else if (!field_->isotropic()) {
        // |w| = h |B^-1 e_z|: how far a ray gets through the unit sphere while it gets h deep.
        ray = depths.half * glm::length(back_ * field_->shape(i) / (axes * axes));
    }
    if (sampling_ == Sampling::slab) {
        if (frame_->projection == Projection::perspective) {
            // The ray's own slope moves it through the section's plane as well.
            ray += frame_->largest_slope() * depths.half / shortest;
        }
        const double width = std::sqrt(field_->kernel().falloff) * ray * step_s;
        if (precise) {
            return width < four_node_slab  ? SectionGroup::precise_thin
                   : width < six_node_slab ? SectionGroup::precise_medium
                                           : SectionGroup::precise_thick;
        }
        return width < four_node_slab  ? SectionGroup::thin
               : width < six_node_slab ? SectionGroup::medium
                                       : SectionGroup::thick;
    }
    if (precise) {
        return SectionGroup::precise_plain;
    }
    if (frame_->projection == Projection::orthographic) {
        // |w| ds / h, and the farthest that the middle of four slabs lies from the centre where it matters.
        const double step = ray * step_s;
        const double far = 1.5 + 1.5 * step;
        const double k = log2_e * field_->kernel().falloff;
        if (step <= 1.0 && k * far * far < largest_exponent && 3.0 * k * far * step < largest_exponent) {
            return SectionGroup::compact;
        }
    }
    return SectionGroup::plain;
}

std::int64_t EllipsoidView::anchor(const EyeKernel& kernel, std::int64_t first, std::int64_t last) const {
    double depth = -kernel.center.z;
    if (frame_->projection == Projection::perspective) {
        // Places on the screen grow without bound towards the eye: taken there, they would cost all further sections
        // their digits. 0.6 of the farthest is past the first of two slices, however close to the eye that one is.
        depth = std::max(depth, 0.6 * std::min(depth + kernel.half_depth, frame_->depth_of(last)));
    }
    return static_cast<std::int64_t>(std::clamp(std::round((depth - frame_->first_depth) * per_depth_),
                                                static_cast<double>(first), static_cast<double>(last)));
}

EllipsoidView::ScreenBounds EllipsoidView::bounds(const EyeKernel& kernel, double nearest, double farthest) const {
    const double x = kernel.center.x, y = kernel.center.y;
    const double pixel = frame_->pixel;
    if (frame_->projection == Projection::orthographic) {
        return {(x - kernel.extent.x) / pixel, (x + kernel.extent.x) / pixel, (-y - kernel.extent.y) / pixel,
                (-y + kernel.extent.y) / pixel, false};
    }
    const double depth = -kernel.center.z;
    const double front = std::max(depth - kernel.half_depth, nearest);
    const double back = std::max(std::min(depth + kernel.half_depth, farthest), front);
    if (front <= 1e-9 * frame_->slice_spacing) {
        // A whole slab counts where its middle lies behind the near plane: it can reach through the eye, where every
        // ray starts.
        return {0.0, 0.0, 0.0, 0.0, true};
    }
    // (c +- e) / t is monotonic in t, so that the extremes lie at the nearest or farthest depth that is drawn.
    const auto lowest = [&](double edge) { return std::min(edge / front, edge / back) / pixel; };
    const auto highest = [&](double edge) { return std::max(edge / front, edge / back) / pixel; };
    return {lowest(x - kernel.extent.x), highest(x + kernel.extent.x), lowest(-y - kernel.extent.y),
            highest(-y + kernel.extent.y), false};
}

EllipsoidView::ScreenBounds EllipsoidView::support_bounds(std::size_t i, double nearest, double farthest) const {
    EyeKernel kernel;
    kernel.center = center_eye(i);
    if (field_->isotropic()) {
        const double r = field_->arrays().radii[i];
        kernel.extent = glm::dvec2(r);
        kernel.half_depth = r;
    } else {
        const Mat3 m = field_->shape(i);
        kernel.extent = glm::dvec2(glm::length(right_ * m), glm::length(up_ * m));
        kernel.half_depth = glm::length(back_ * m);
    }
    if (filter_ == Filter::ewa) {
        const FilterWidth width = filter_at(kernel.center);
        kernel.extent =
            glm::dvec2(std::hypot(kernel.extent.x, width.across), std::hypot(kernel.extent.y, width.across));
        kernel.half_depth = std::hypot(kernel.half_depth, width.along);
    }
    return bounds(kernel, nearest, farthest);
}

PixelBox EllipsoidView::pixels(const ScreenBounds& bounds, const Frame& frame, const Tile& tile, int wider_px) {
    if (bounds.unbounded) {
        return {0, 0, tile.target_width(), tile.target_height()};
    }
    const double axis_x = frame.axis_x - tile.x + Tile::border;
    const double axis_y = frame.axis_y - tile.y + Tile::border;
    const double left = bounds.left + axis_x - wider_px, right = bounds.right + axis_x + wider_px;
    const double top = bounds.top + axis_y - wider_px, bottom = bounds.bottom + axis_y + wider_px;
    // What lies between the centres of pixels as a whole is never seen.
    const auto between = [](double lower, double upper) {
        const double rounding = 1e-9 * std::max(1.0, std::max(std::abs(lower), std::abs(upper)));
        return upper - lower < 1.0 && std::ceil(lower - 0.5 - rounding) > std::floor(upper - 0.5 + rounding);
    };
    return between(left, right) || between(top, bottom) ? PixelBox{} : pixels_between(left, right, top, bottom, tile);
}

Vec3 EllipsoidView::first_point_world(std::size_t i) const {
    if (field_->isotropic()) {
        return field_->center(i) + field_->arrays().radii[i] * back_;
    }
    const Mat3 m = field_->shape(i);
    const Vec3 row = back_ * m;
    return field_->center(i) + m * (row / glm::length(row));
}

} // namespace sheetsplat

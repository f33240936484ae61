// Which tiles scattered kernels reach into, and how they look from one.

#if defined(SHEETSPLAT_CPU_FEED_KERNELS_INL) == defined(HWY_TARGET_TOGGLE)
#ifdef SHEETSPLAT_CPU_FEED_KERNELS_INL
#undef SHEETSPLAT_CPU_FEED_KERNELS_INL
#else
#define SHEETSPLAT_CPU_FEED_KERNELS_INL
#endif

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <vector>

#include <glm/geometric.hpp>

#include "backend_cpu/measured.hpp"
#include "backend_cpu/tile_feed.hpp"
#include "backend_cpu/tile_task.hpp"
#include "feed-inl.hpp"
#include "hwy/highway.h"
#include "plan/limits_common.hpp"

HWY_BEFORE_NAMESPACE();
namespace sheetsplat::backend_cpu::HWY_NAMESPACE {

/// The tiles that kernels begin ... end - 1 reach into.
inline void tile_rects(const EllipsoidView& view, const std::vector<std::uint8_t>& visible, const TileLayout& layout,
                       std::size_t begin, std::size_t end, TileRect* rects) {
    const Frame& frame = view.frame();
    const double axis_x = frame.axis_x, axis_y = frame.axis_y;
    const TileLayout::Axis& across = layout.across();
    const TileLayout::Axis& down = layout.down();
    if (frame.slices == 0) {
        std::fill(rects + begin, rects + end, TileRect());
        return;
    }
    if (view.spheres()) {
        const EllipsoidArrays& arrays = view.field().arrays();
        const double per_pixel = 1.0 / frame.pixel;
        const Vec3 right = view.right_world(), up = view.up_world(), eye = view.eye_world();
        for (std::size_t i = begin; i < end; ++i) {
            if (visible[i] == 0) {
                rects[i] = TileRect();
                continue;
            }
            const Vec3 from = arrays.centers[i] - eye;
            const double x = (from.x * right.x + from.y * right.y + from.z * right.z) * per_pixel + axis_x;
            const double y = axis_y - (from.x * up.x + from.y * up.y + from.z * up.z) * per_pixel;
            const double r = arrays.radii[i] * per_pixel;
            rects[i] = {across.between(x - r, x + r), down.between(y - r, y + r)};
        }
        return;
    }
    const double nearest = view.front_of(0), farthest = view.back_of(frame.slices - 1);
    for (std::size_t i = begin; i < end; ++i) {
        if (visible[i] == 0) {
            rects[i] = TileRect();
            continue;
        }
        const EllipsoidView::ScreenBounds bounds = view.support_bounds(i, nearest, farthest);
        rects[i] = bounds.unbounded ? TileRect{{0, layout.columns() - 1}, {0, layout.rows() - 1}}
                                    : TileRect{across.between(bounds.left + axis_x, bounds.right + axis_x),
                                               down.between(bounds.top + axis_y, bounds.bottom + axis_y)};
    }
}

/// Scattered kernels for a tile: one after the other, sorted by first slices in the end.
template <class T>
class KernelFeed {
  public:
    KernelFeed(const EllipsoidView& view, const TileShape& tile, TileKernels<T>& kernels)
        : view_(view), frame_(view.frame()), field_(view.field()), tile_(tile), kernels_(kernels),
          perspective_(frame_.projection == Projection::perspective), origin_(origin_of(tile, frame_)),
          own_(tile, frame_), axis_x_(frame_.axis_x - tile.x + 0.5), axis_y_(frame_.axis_y - tile.y + 0.5) {}

    void run(const std::uint32_t* begin, const std::uint32_t* end) {
        kernels_.clear();
        kernels_.last_slice = static_cast<std::int32_t>(frame_.slices - 1);
        const auto count = static_cast<std::size_t>(end - begin);
        kernels_.unsorted.reserve(count);
        kernels_.unsorted_extras.reserve(count);
        kernels_.unsorted_shapes.reserve(count);
        const EllipsoidArrays& arrays = field_.arrays();
        for (const std::uint32_t* index = begin; index != end; ++index) {
            if ((index - begin) % kernels_between_polls == kernels_between_polls - 1 && kernels_.poll) {
                kernels_.poll();
            }
            // Kernels of one tile are anywhere in memory.
            if (end - index > fetched_ahead) {
                const std::size_t next = index[fetched_ahead];
                __builtin_prefetch(&arrays.centers[next]);
                __builtin_prefetch(&arrays.values[next]);
                if (kernels_.beside != nullptr) {
                    __builtin_prefetch(&kernels_.beside->field().arrays().values[next]);
                }
                if (field_.isotropic()) {
                    __builtin_prefetch(&arrays.radii[next]);
                } else {
                    __builtin_prefetch(&arrays.scales[next]);
                }
                if (!arrays.rotations.empty()) {
                    __builtin_prefetch(&arrays.rotations[next]);
                }
            }
            if (view_.spheres()) {
                add_sphere(*index);
            } else {
                add(*index);
            }
        }
        kernels_.sort();
    }

  private:
    void keep(const Section<T>& section, const SectionExtra<T>& extra, const RowShape<T>& shape) {
        kernels_.unsorted.push_back(section);
        kernels_.unsorted_extras.push_back(extra);
        kernels_.unsorted_shapes.push_back(shape);
    }

    /// First and last slice of a kernel; false where it meets none.
    [[nodiscard]] HWY_INLINE bool span(double depth, double half, double& first, double& last) const {
        const double per_spacing = 1.0 / frame_.slice_spacing;
        const double reach = half * per_spacing + (view_.slab_half() > 0.0 ? 0.5 : 0.0);
        const double at = (depth - frame_.first_depth) * per_spacing;
        first = std::max(std::ceil(at - reach), 0.0);
        last = std::min(std::floor(at + reach), static_cast<double>(frame_.slices - 1));
        return first <= last;
    }

    HWY_INLINE void fill(std::uint32_t index, double amplitude, double first, double last, Section<T>& section,
                         SectionExtra<T>& extra) const {
        section.first = static_cast<std::int32_t>(first);
        extra.last = static_cast<std::int32_t>(last);
        const double weight = field_.weight(index) * amplitude;
        // A weight of 0 still reaches, by the least that is drawn: what D and W have of it is a value of 0.
        const double least = least_drawn_weight / view_.weight_scale();
        const auto amount = [&](const EllipsoidView& view, double pivot) {
            const double value = weight > 0.0 ? (view.field().value(index) - pivot) * weight : -pivot * least;
            return static_cast<T>(value * view.value_scale());
        };
        section.value = amount(view_, kernels_.pivot);
        if (kernels_.beside != nullptr) {
            extra.other = amount(*kernels_.beside, kernels_.beside_pivot);
        }
        extra.weight = static_cast<T>(std::max(weight, least) * view_.weight_scale());
    }

    HWY_INLINE void add_sphere(std::uint32_t index) {
        const Vec3 from = field_.center(index) - view_.eye_world();
        const auto along = [&](const Vec3& axis) { return from.x * axis.x + from.y * axis.y + from.z * axis.z; };
        const double radius = field_.arrays().radii[index], per_radius = 1.0 / radius, per_pixel = 1.0 / frame_.pixel;
        const double depth = -along(view_.back_world());
        double first = 0.0, last = 0.0;
        if (!span(depth, radius, first, last)) {
            return;
        }
        const double x = (along(view_.right_world()) - origin_.x) * per_pixel;
        const double y = (origin_.y - along(view_.up_world())) * per_pixel, r = radius * per_pixel;
        SectionExtra<T> extra;
        if (!place({x - r, x + r, y - r, y + r}, tile_, extra)) {
            return;
        }
        kernels_.counted += own_.hold(x, y) ? 1U : 0U;
        RowShape<T> shape;
        const double X = frame_.pixel * per_radius;
        shape.X = static_cast<T>(X);
        shape.Y2 = static_cast<T>(-X);
        shape.ds = static_cast<T>(-frame_.slice_spacing * per_radius);
        Section<T> section;
        section.a1 = static_cast<T>(-x * X);
        section.a2 = static_cast<T>(y * X);
        section.s = static_cast<T>((depth - frame_.first_depth - first * frame_.slice_spacing) * per_radius);
        fill(index, 1.0, first, last, section, extra);
        keep(section, extra, shape);
    }

    HWY_INLINE void add(std::uint32_t index) {
        const EyeKernel kernel = view_.kernel(index);
        double first = 0.0, last = 0.0;
        if (!span(-kernel.center.z, kernel.half_depth, first, last)) {
            return;
        }
        SectionExtra<T> extra;
        const EllipsoidView::ScreenBounds bounds = view_.bounds(
            kernel, view_.front_of(static_cast<std::int64_t>(first)), view_.back_of(static_cast<std::int64_t>(last)));
        const SheetBox box = bounds.unbounded ? SheetBox{0.0, tile_.width + 1.0, 0.0, tile_.height + 1.0}
                                              : SheetBox{bounds.left + axis_x_, bounds.right + axis_x_,
                                                         bounds.top + axis_y_, bounds.bottom + axis_y_};
        if (!place(box, tile_, extra)) {
            return;
        }
        const double near = perspective_ ? std::max(-kernel.center.z, frame_.first_depth) : 1.0;
        kernels_.counted += own_.hold((kernel.center.x / near - origin_.x) / frame_.pixel,
                                      (origin_.y - kernel.center.y / near) / frame_.pixel)
                                ? 1U
                                : 0U;
        // A^-1, since the images of u and v are orthogonal.
        const glm::dvec2 u = kernel.axis_u / glm::dot(kernel.axis_u, kernel.axis_u);
        const glm::dvec2 v = kernel.axis_v / glm::dot(kernel.axis_v, kernel.axis_v);
        const auto to_plane = [&](const glm::dvec2& p) { return glm::dvec2(glm::dot(u, p), glm::dot(v, p)); };
        const RowBasis basis(frame_.pixel * glm::dvec2(u.x, v.x), -frame_.pixel * glm::dvec2(u.y, v.y));
        const double depth = frame_.first_depth + first * frame_.slice_spacing;
        const double s = (-kernel.center.z - depth) / kernel.half_depth;
        const double step_s = frame_.slice_spacing / kernel.half_depth;
        const glm::dvec2 from =
            (perspective_ ? depth * origin_ : origin_) - glm::dvec2(kernel.center.x, kernel.center.y);
        const glm::dvec2 plane = to_plane(from - s * kernel.lean);
        glm::dvec2 drift = step_s * to_plane(kernel.lean);
        if (perspective_) {
            drift += frame_.slice_spacing * to_plane(origin_);
        }
        Section<T> section;
        set_place(basis, plane, s, section);
        fill(index, kernel.amplitude, first, last, section, extra);
        keep(section, extra, row_shape<T>(basis, drift, step_s));
    }

    const EllipsoidView& view_;
    const Frame& frame_;
    const EllipsoidField& field_;
    const TileShape& tile_;
    TileKernels<T>& kernels_;
    bool perspective_;
    glm::dvec2 origin_;
    OwnPlaces own_;
    double axis_x_, axis_y_;
};

template <class T>
void feed_kernels(const EllipsoidView& view, const std::uint32_t* begin, const std::uint32_t* end,
                  const TileShape& tile, TileKernels<T>& kernels) {
    KernelFeed<T>(view, tile, kernels).run(begin, end);
}

} // namespace sheetsplat::backend_cpu::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif // SHEETSPLAT_CPU_FEED_KERNELS_INL

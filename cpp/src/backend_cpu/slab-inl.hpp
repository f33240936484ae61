// One slab of a tile: what every pass over its pixels reads and writes.

#if defined(SHEETSPLAT_CPU_SLAB_INL) == defined(HWY_TARGET_TOGGLE)
#ifdef SHEETSPLAT_CPU_SLAB_INL
#undef SHEETSPLAT_CPU_SLAB_INL
#else
#define SHEETSPLAT_CPU_SLAB_INL
#endif

#include <algorithm>
#include <cmath>
#include <cstddef>

#include "backend_cpu/shading.hpp"
#include "backend_cpu/tile.hpp"
#include "hwy/highway.h"
#include "light-inl.hpp"
#include "math-inl.hpp"
#include "reach-inl.hpp"
#include "scene/mode_rules.hpp"
#include "transfer-inl.hpp"
#include "view/cut_faces.hpp"

HWY_BEFORE_NAMESPACE();
namespace sheetsplat::backend_cpu::HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

/// Columns x0 <= x < x1.
struct Columns {
    int x0 = 0, x1 = 0;
};

/// The slab that is shaded, of one group of fields. Pixels are those of the tile, without its border; passes go over
/// them in vectors of `lanes` columns.
template <class T>
struct Slab {
    using D = hn::CappedTag<T, TileShape::padding>;
    using V = hn::Vec<D>;
    using M = hn::Mask<D>;
    static constexpr int lanes = static_cast<int>(hn::MaxLanes(D()));

    const Shading<T>& shading;
    const GroupShading<T>& group;
    const TileShape& shape;
    const SlabWindow<T>& window;
    const SheetWindow<T>& sheets; ///< of the group
    TilePicture<T>& picture;

    Slab(const Shading<T>& shading_in, const TileShape& shape_in, const SlabWindow<T>& window_in,
         TilePicture<T>& picture_in, std::size_t number = 0)
        : shading(shading_in), group(shading_in.groups[number]), shape(shape_in), window(window_in),
          sheets(number == 0 ? window_in : window_in.later_groups[number - 1]), picture(picture_in) {}

    /// Element of a sheet and of a plane at the start of a row.
    [[nodiscard]] std::ptrdiff_t in_sheet(int y) const { return static_cast<std::ptrdiff_t>(y + 1) * shape.stride + 1; }
    [[nodiscard]] std::ptrdiff_t in_plane(int y) const { return static_cast<std::ptrdiff_t>(y) * shape.stride; }
    /// rho of slice n - 1 + number, from a row and column on.
    HWY_INLINE V rho(D d, int number, int y, int x) const { return hn::LoadU(d, sheets.rho[number] + in_sheet(y) + x); }
    [[nodiscard]] double depth() const {
        return shading.first_depth + static_cast<double>(window.n) * shading.slice_spacing;
    }

    /// What the picture reports as the depth of slice n, or of the interval behind it.
    [[nodiscard]] double reported_depth() const {
        return shading.preintegration ? std::max(depth() + 0.5 * shading.slice_spacing, shading.nearest_depth)
                                      : depth();
    }

    /// Planes are read and written in whole cache lines.
    [[nodiscard]] int first_column() const { return window.rect.x0 / lanes * lanes; }
    /// Lanes of pixels that still change, on slices that belong to the part that is drawn.
    HWY_INLINE M unfinished(D d, M mask, int y, int x) const {
        const V so_far = hn::LoadU(d, picture.alpha + in_plane(y) + x);
        return owned(d, hn::And(mask, hn::Lt(so_far, hn::Set(d, shading.stop))), y, x);
    }
    /// Lanes with weights of points that are not empty.
    HWY_INLINE M weighs(D d, V weight) const {
        return hn::And(hn::Ne(weight, hn::Zero(d)), hn::Ge(weight, hn::Set(d, group.least_weight)));
    }
    /// Lanes whose point of slice n (ahead 1: n + 1) some kernel reaches, where that is looked at.
    HWY_INLINE M reached(D d, M mask, int ahead, int y, int x) const {
        return reached(d, mask, ahead, y, x, rho(d, 1 + ahead, y, x));
    }
    /// The same of points whose rho is known.
    HWY_INLINE M reached(D d, M mask, int ahead, int y, int x, V found) const {
        if (!shading.empty_test) {
            return mask;
        }
        if (sheets.reach == nullptr) {
            return hn::And(mask, weighs(d, hn::LoadU(d, sheets.weight[ahead] + in_sheet(y) + x)));
        }
        // Where rho is not 0 some kernel has added to it.
        const M unsure = hn::And(mask, hn::Eq(found, hn::Zero(d)));
        if (hn::AllFalse(d, unsure)) {
            return mask;
        }
        HWY_ALIGN T marks[lanes];
        mark_row(*sheets.reach, shape, window.n + ahead, y, x, lanes, marks);
        return hn::And(mask, hn::Or(hn::Not(unsure), hn::Ne(hn::Load(d, marks), hn::Zero(d))));
    }

    HWY_INLINE Ray<D> ray(D d, int x, int y) const {
        const V pixel = hn::Set(d, static_cast<T>(shading.pixel));
        const V column = hn::Iota(d, static_cast<T>(shape.x + x - shading.axis_x));
        const V over = hn::Mul(column, pixel);
        const V up = hn::Set(d, static_cast<T>((shading.axis_y - (shape.y + y)) * shading.pixel));
        return {over, up, hn::Sqrt(hn::MulAdd(over, over, hn::MulAdd(up, up, hn::Set(d, T(1)))))};
    }
    template <bool perspective>
    HWY_INLINE Ray<D> ray_if(D d, int x, int y) const {
        if constexpr (perspective) {
            return ray(d, x, y);
        } else {
            return {hn::Zero(d), hn::Zero(d), hn::Set(d, T(1))};
        }
    }

    /// Minus the gradient at slice n + ahead, by differences of neighbours; at: element of a sheet.
    template <bool perspective>
    HWY_INLINE Normal<D> difference(D d, int ahead, std::ptrdiff_t at, const GradientScale<T>& scale,
                                    const Ray<D>& ray) const {
        return against_gradient<perspective>(d, sheets.rho[ahead] + at, sheets.rho[ahead + 1] + at,
                                             sheets.rho[ahead + 2] + at, shape.stride, scale.across[ahead], scale.along,
                                             ray);
    }

    /// Counts that pixels show `shares` (0 outside of what is visible) of what an error of rho of 1 makes of their
    /// light: it moves the gradient by `moved`, a length over the gradient's (over_size()).
    HWY_INLINE void doubt(D d, V shares, V moved) const {
        const V shown = hn::Mul(shares, moved);
        hn::Store(hn::MulAdd(shown, shown, hn::Load(d, picture.doubts)), d, picture.doubts);
    }
    /// `moved` over a gradient's length, or 10^15 where it is more: squares and their sums stay within the format. 0
    /// where the length is: a gradient of 0 has no direction, unless g0 holds it (conventions, section 5).
    HWY_INLINE static V over_size(D d, V moved, V per_size) {
        const V most = hn::Set(d, T(1e15));
        return hn::IfThenElseZero(hn::Lt(per_size, hn::Set(d, T(1e30))),
                                  hn::Min(hn::Mul(moved, hn::Min(per_size, most)), most));
    }

    /// Composites alpha > 0, 0 outside of `visible`, behind what a plane holds; counts the pixels that end. depths():
    /// what the picture reports. Returns the share of alpha that shows.
    template <class Depths>
    HWY_INLINE V put_behind(D d, std::ptrdiff_t at, int y, M visible, V so_far, V alpha, const Color<D>& color,
                            const Depths& depths) const {
        const V share = hn::Mul(hn::Sub(hn::Set(d, T(1)), so_far), alpha);
        const V opacity = hn::Add(so_far, share);
        const auto add = [&](T* plane, V channel) {
            hn::StoreU(hn::MulAdd(share, channel, hn::LoadU(d, plane + at)), d, plane + at);
        };
        add(picture.red, color.red);
        add(picture.green, color.green);
        add(picture.blue, color.blue);
        hn::StoreU(opacity, d, picture.alpha + at);
        if (picture.depth != nullptr) {
            const V half = hn::Set(d, T(0.5));
            const auto reached_half = hn::And(visible, hn::And(hn::Lt(so_far, half), hn::Ge(opacity, half)));
            hn::StoreU(hn::IfThenElse(reached_half, depths(), hn::LoadU(d, picture.depth + at)), d, picture.depth + at);
        }
        end_pixels(d, y, hn::And(visible, hn::Ge(opacity, hn::Set(d, shading.stop))));
        return share;
    }
    /// At the depth of the slice or interval.
    HWY_INLINE V put_behind(D d, std::ptrdiff_t at, int y, M visible, V so_far, V alpha, const Color<D>& color) const {
        return put_behind(d, at, y, visible, so_far, alpha, color,
                          [&]() { return hn::Set(d, static_cast<T>(reported_depth())); });
    }
    /// Depths `share` slice distances behind slice n.
    HWY_INLINE V depth_behind(D d, V share) const {
        return hn::MulAdd(share, hn::Set(d, static_cast<T>(shading.slice_spacing)),
                          hn::Set(d, static_cast<T>(depth())));
    }

    /// Writes an opaque surface, in front of everything, `share` slice distances behind slice n.
    HWY_INLINE void put_surface(D d, std::ptrdiff_t at, int y, M found, V share, const Color<D>& color) const {
        const auto store = [&](T* plane, V value) {
            hn::StoreU(hn::IfThenElse(found, value, hn::LoadU(d, plane + at)), d, plane + at);
        };
        store(picture.red, color.red);
        store(picture.green, color.green);
        store(picture.blue, color.blue);
        store(picture.alpha, hn::Set(d, T(1)));
        if (picture.depth != nullptr) {
            store(picture.depth, depth_behind(d, share));
        }
        end_pixels(d, y, found);
    }

    HWY_INLINE void end_pixels(D d, int y, M ended) const {
        if (!hn::AllFalse(d, ended)) {
            const int count = static_cast<int>(hn::CountTrue(d, ended));
            picture.row_alive[y] -= count;
            picture.alive -= count;
        }
    }

    /// Columns of a row of slice n + ahead that clipping keeps: one interval, since half spaces are convex. In float64.
    [[nodiscard]] Columns columns_kept(int y, int ahead) const {
        return columns_in(shading.kept, y, ahead, {window.rect.x0, window.rect.x1});
    }
    /// Of columns, those inside of where the group's fields end.
    [[nodiscard]] Columns columns_of_group(int y, int ahead, const Columns& columns) const {
        return group.kept.empty() ? columns : columns_in(group.kept, y, ahead, columns);
    }
    /// Of columns, those in which the group may show something in a row.
    [[nodiscard]] Columns columns_shown(int y, const Columns& columns) const {
        const Rect& rect = sheets.shown;
        return y >= rect.y0 && y < rect.y1 ? Columns{std::max(columns.x0, rect.x0), std::min(columns.x1, rect.x1)}
                                           : Columns{};
    }
    [[nodiscard]] Columns columns_in(const std::vector<KeptHalfSpace>& halves, int y, int ahead,
                                     const Columns& columns) const {
        double first = columns.x0, past = columns.x1;
        const double at_depth = shading.first_depth + static_cast<double>(window.n + ahead) * shading.slice_spacing;
        const double wide = shading.pixel * (shading.perspective ? at_depth : 1.0);
        const double up = (shading.axis_y - (shape.y + y)) * wide;
        for (const KeptHalfSpace& half : halves) {
            const double step = half.normal.x * wide;
            const double at_0 = half.normal.x * ((shape.x - shading.axis_x) * wide) + half.normal.y * up -
                                half.normal.z * at_depth + half.distance;
            if (std::abs(step) * 1024.0 <= std::abs(at_0) || step == 0.0) {
                // No column of a tile lies where this changes.
                past = at_0 >= 0.0 ? past : first;
            } else if (step > 0.0) {
                first = std::max(first, std::ceil(-at_0 / step));
            } else {
                past = std::min(past, std::floor(at_0 / -step) + 1.0);
            }
        }
        if (!(first < past)) {
            return {columns.x0, columns.x0};
        }
        return {static_cast<int>(first), static_cast<int>(past)};
    }

    /// Whether anything may take points of the rectangle away, on slice n or, `behind`, on slice n + 1, or turn normals
    /// of what is left.
    [[nodiscard]] bool cut(bool behind) const {
        if (picture.last_kept != nullptr || picture.first_owned != nullptr ||
            std::any_of(shading.groups.begin(), shading.groups.end(),
                        [](const GroupShading<T>& of) { return !of.kept.empty(); })) {
            return true;
        }
        const double half_width = 0.5 * (window.rect.x1 - 1 - window.rect.x0);
        const double half_height = 0.5 * (window.rect.y1 - 1 - window.rect.y0);
        // Behind a cut its face counts for a while.
        const double faces = shading.cut_faces ? 2.0 * face_lengths * shading.face_length : 0.0;
        for (const double ahead : {0.0, behind ? 1.0 : 0.0, -faces}) {
            const double at_depth =
                shading.first_depth + (static_cast<double>(window.n) + ahead) * shading.slice_spacing;
            const double wide = shading.pixel * (shading.perspective ? at_depth : 1.0);
            const double over = (shape.x + window.rect.x0 + half_width - shading.axis_x) * wide;
            const double up = (shading.axis_y - (shape.y + window.rect.y0 + half_height)) * wide;
            for (const KeptHalfSpace& half : shading.kept) {
                // (A millionth of a pixel, so that rounding does not count.)
                const double least =
                    half.normal.x * over + half.normal.y * up - half.normal.z * at_depth + half.distance -
                    (std::abs(half.normal.x) * half_width + std::abs(half.normal.y) * half_height + 1e-6) *
                        std::abs(wide);
                if (!(least >= 0.0)) {
                    return true;
                }
            }
        }
        return false;
    }

    /// Lanes whose point of slice n + ahead is kept: by clipping, which leaves an interval of columns, and by the depth
    /// limit.
    HWY_INLINE M kept(D d, M mask, int ahead, int y, int x, const Columns& columns) const {
        mask = within(d, mask, x, columns);
        if (picture.last_kept == nullptr) {
            return mask;
        }
        const V slice = hn::Set(d, static_cast<T>(window.n + ahead));
        return hn::And(mask, hn::Ge(hn::LoadU(d, picture.last_kept + in_plane(y) + x), slice));
    }

    /// Lanes whose slice n, and the interval behind it, belongs to the part that is drawn.
    HWY_INLINE M owned(D d, M mask, int y, int x) const {
        if (picture.first_owned == nullptr) {
            return mask;
        }
        const V slice = hn::Set(d, static_cast<T>(window.n));
        return hn::And(mask, hn::And(hn::Le(hn::LoadU(d, picture.first_owned + in_plane(y) + x), slice),
                                     hn::Ge(hn::LoadU(d, picture.last_owned + in_plane(y) + x), slice)));
    }

    /// Lanes whose columns are in an interval.
    HWY_INLINE M within(D d, M mask, int x, const Columns& columns) const {
        const int skipped = columns.x0 - x, left = columns.x1 - x;
        if (skipped > 0) {
            mask = hn::AndNot(hn::FirstN(d, static_cast<std::size_t>(std::min(skipped, lanes))), mask);
        }
        if (left < lanes) {
            mask = hn::And(mask, hn::FirstN(d, static_cast<std::size_t>(std::max(left, 0))));
        }
        return mask;
    }
};

/// Change of a normal, over that of rho, beyond which a crossing is ambiguous (conventions, section 9): a pixel changes
/// by 1e-3 where rho does by 1e-5.
constexpr double most_turned = 100.0;

/// How much the gradient at a crossing of slices n and n + 1 changes by where an error of rho of 1 moves the crossing;
/// front, back, against: minus the gradients there and at the crossing.
template <class T, class D, class V = hn::Vec<D>>
HWY_INLINE V moved_gradient(D d, const Slab<T>& slab, const Normal<D>& front, const Normal<D>& back,
                            const Normal<D>& against, T weakest, int x, int y, hn::Mask<D> found) {
    const V between =
        length(d, Normal<D>{hn::Sub(back.x, front.x), hn::Sub(back.y, front.y), hn::Sub(back.z, front.z)});
    const V step = hn::Abs(hn::Sub(slab.rho(d, 2, y, x), slab.rho(d, 1, y, x)));
    const V size = hn::Max(length(d, against), hn::Set(d, weakest));
    const V moved = hn::Div(between, hn::IfThenElse(found, hn::Max(step, hn::Set(d, T(1e-15))), hn::Set(d, T(1))));
    return hn::Min(moved, hn::Mul(size, hn::Set(d, T(most_turned))));
}

/// Where an isosurface lies between two slices, as a share of their distance; `found`: lanes in which there is one.
template <class D, class V = hn::Vec<D>>
HWY_INLINE V crossing(D d, V front, V back, V iso, hn::Mask<D> found) {
    const V zero = hn::Zero(d), one = hn::Set(d, hn::TFromD<D>(1));
    const V step = hn::IfThenElse(found, hn::Sub(back, front), one);
    const V way = hn::IfThenElseZero(found, hn::Sub(iso, front));
    return hn::Min(hn::Max(hn::Div(way, step), zero), one);
}

/// The number of two that a mode shows.
template <class V>
HWY_INLINE V extreme(Mode mode, V a, V b) {
    return traits_of(mode).fold == Fold::largest ? hn::Max(a, b) : hn::Min(a, b);
}

} // namespace sheetsplat::backend_cpu::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif // SHEETSPLAT_CPU_SLAB_INL

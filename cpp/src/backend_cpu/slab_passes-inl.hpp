// Passes over the pixels of a slab in scenes without further effects: slices, pre-integrated intervals, isosurfaces,
// scalars, and the absorption of light. Source: conventions, sections 4 to 7.

#if defined(SHEETSPLAT_CPU_SLAB_PASSES_INL) == defined(HWY_TARGET_TOGGLE)
#ifdef SHEETSPLAT_CPU_SLAB_PASSES_INL
#undef SHEETSPLAT_CPU_SLAB_PASSES_INL
#else
#define SHEETSPLAT_CPU_SLAB_PASSES_INL
#endif

#include <cstddef>

#include "hwy/highway.h"
#include "light-inl.hpp"
#include "math-inl.hpp"
#include "ramp-inl.hpp"
#include "slab-inl.hpp"
#include "transfer-inl.hpp"

HWY_BEFORE_NAMESPACE();
namespace sheetsplat::backend_cpu::HWY_NAMESPACE {

/// Calls visit(x, y, lanes, alpha so far) for vectors with pixels that still change and of which may(x, y), a mask,
/// holds for any.
template <class T, class May, class Visit>
HWY_INLINE void for_each_vector(const Slab<T>& slab, const May& may, const Visit& visit) {
    const typename Slab<T>::D d;
    const auto stop = hn::Set(d, slab.shading.stop);
    const Rect& rect = slab.window.rect;
    for (int y = rect.y0; y < rect.y1; ++y) {
        if (slab.picture.row_alive[y] == 0) {
            continue;
        }
        for (int x = slab.first_column(); x < rect.x1; x += Slab<T>::lanes) {
            auto visible = may(x, y);
            if (hn::AllFalse(d, visible)) {
                continue;
            }
            const auto so_far = hn::LoadU(d, slab.picture.alpha + slab.in_plane(y) + x);
            visible = slab.inside(d, hn::And(visible, hn::Lt(so_far, stop)), x);
            if (!hn::AllFalse(d, visible)) {
                visit(x, y, visible, so_far);
            }
        }
    }
}

/// Point-sampled slices: opacities corrected for the slice distance, colours lit and composited.
template <class Table, bool lit, bool perspective, class T>
HWY_NOINLINE void add_slices(const Slab<T>& slab) {
    using V = typename Slab<T>::V;
    using M = typename Slab<T>::M;
    const typename Slab<T>::D d;
    const Shading<T>& shading = slab.shading;
    const Table table(slab.group.transfer);
    const GradientScale<T> scale(shading, slab.group, slab.window.n);
    const V zero = hn::Zero(d);
    const V below = hn::Set(d, slab.group.transfer.below), above = hn::Set(d, slab.group.transfer.above);
    const V exponent = hn::Set(d, shading.exponent);
    for_each_vector(
        slab,
        [&](int x, int y) SHEETSPLAT_CPU_INLINE {
            const V rho = slab.rho(d, 1, y, x);
            return slab.reached(d, hn::And(hn::Gt(rho, below), hn::Lt(rho, above)), 0, y, x);
        },
        [&](int x, int y, M visible, V so_far) SHEETSPLAT_CPU_INLINE {
            typename Table::Place place;
            const auto ray = slab.template ray_if<perspective>(d, x, y);
            V alpha = hn::IfThenElseZero(visible, table.opacity(d, slab.rho(d, 1, y, x), place));
            if (shading.correct) {
                alpha = corrected_opacity(d, alpha, perspective ? hn::Mul(exponent, ray.slant) : exponent);
            }
            visible = hn::Gt(alpha, zero);
            if (hn::AllFalse(d, visible)) {
                return;
            }
            auto color = table.color(d, place);
            if constexpr (lit) {
                const auto against = slab.template difference<perspective>(d, 0, slab.in_sheet(y) + x, scale, ray);
                V per_size;
                color = phong<perspective>(d, shading, color, against, scale.weakest, ray, visible, per_size);
                const V share = slab.put_behind(d, slab.in_plane(y) + x, y, visible, so_far, alpha, color);
                slab.doubt(d, share, slab.over_size(d, hn::Set(d, shading.gradient_doubt), per_size));
            } else {
                slab.put_behind(d, slab.in_plane(y) + x, y, visible, so_far, alpha, color);
            }
        });
}

/// Minus the gradient a share of the way from slice n to slice n + 1.
template <bool perspective, class T, class D, class V = hn::Vec<D>>
HWY_INLINE Normal<D> between_slices(D d, const Slab<T>& slab, std::ptrdiff_t at, const GradientScale<T>& scale,
                                    const Ray<D>& ray, V share) {
    const Normal<D> front = slab.template difference<perspective>(d, 0, at, scale, ray);
    const Normal<D> back = slab.template difference<perspective>(d, 1, at, scale, ray);
    return mix(d, front, back, share);
}

/// Pre-integrated intervals between two slices.
template <bool perspective, class T>
HWY_NOINLINE void add_intervals(const Slab<T>& slab) {
    using V = typename Slab<T>::V;
    using M = typename Slab<T>::M;
    const typename Slab<T>::D d;
    const Shading<T>& shading = slab.shading;
    const GradientScale<T> scale(shading, slab.group, slab.window.n);
    const V zero = hn::Zero(d);
    const V below = hn::Set(d, slab.group.transfer.below), above = hn::Set(d, slab.group.transfer.above);
    const V exponent = hn::Set(d, shading.exponent);
    for_each_vector(
        slab,
        [&](int x, int y) SHEETSPLAT_CPU_INLINE {
            const V front = slab.rho(d, 1, y, x), back = slab.rho(d, 2, y, x);
            const M some = hn::And(hn::Gt(hn::Max(front, back), below), hn::Lt(hn::Min(front, back), above));
            const M reached = slab.reached(d, some, 0, y, x);
            return hn::Or(reached, slab.reached(d, hn::AndNot(reached, some), 1, y, x));
        },
        [&](int x, int y, M visible, V so_far) SHEETSPLAT_CPU_INLINE {
            const auto ray = slab.template ray_if<perspective>(d, x, y);
            Color<typename Slab<T>::D> color;
            const V mean =
                ramp_absorption(d, slab.group.ramps, slab.rho(d, 1, y, x), slab.rho(d, 2, y, x), visible, color);
            const V alpha =
                opacity_of_absorption(d, hn::Mul(perspective ? hn::Mul(exponent, ray.slant) : exponent, mean));
            visible = hn::Gt(alpha, zero);
            if (hn::AllFalse(d, visible)) {
                return;
            }
            V per_size = zero;
            if (shading.lit) {
                const auto against =
                    between_slices<perspective>(d, slab, slab.in_sheet(y) + x, scale, ray, hn::Set(d, T(0.5)));
                color = phong<perspective>(d, shading, color, against, scale.weakest, ray, visible, per_size);
            }
            const V share = slab.put_behind(d, slab.in_plane(y) + x, y, visible, so_far, alpha, color);
            if (shading.lit) {
                slab.doubt(d, share, slab.over_size(d, hn::Set(d, shading.gradient_doubt), per_size));
            }
        });
}

/// The first crossing of the one isosurface, an opaque one, on each ray.
template <bool perspective, class T>
HWY_NOINLINE void find_crossings(const Slab<T>& slab) {
    using V = typename Slab<T>::V;
    using M = typename Slab<T>::M;
    const typename Slab<T>::D d;
    const Shading<T>& shading = slab.shading;
    const GradientScale<T> scale(shading, slab.group, slab.window.n);
    const ShadingSurface<T>& surface = slab.group.surfaces.front();
    const V iso = hn::Set(d, surface.value);
    for_each_vector(
        slab,
        [&](int x, int y) SHEETSPLAT_CPU_INLINE {
            return hn::Xor(hn::Lt(slab.rho(d, 1, y, x), iso), hn::Lt(slab.rho(d, 2, y, x), iso));
        },
        [&](int x, int y, M found, V) SHEETSPLAT_CPU_INLINE {
            const V share = crossing(d, slab.rho(d, 1, y, x), slab.rho(d, 2, y, x), iso, found);
            auto color = iso_color(d, surface);
            if (shading.lit) {
                const auto ray = slab.template ray_if<perspective>(d, x, y);
                const auto front = slab.template difference<perspective>(d, 0, slab.in_sheet(y) + x, scale, ray);
                const auto back = slab.template difference<perspective>(d, 1, slab.in_sheet(y) + x, scale, ray);
                const auto against = mix(d, front, back, share);
                V per_size;
                color = phong<perspective>(d, shading, color, against, scale.weakest, ray, found, per_size);
                const V moved = hn::Add(hn::Set(d, shading.gradient_doubt),
                                        moved_gradient(d, slab, front, back, against, scale.weakest, x, y, found));
                slab.doubt(d, hn::IfThenElseZero(found, hn::Set(d, T(1))), slab.over_size(d, moved, per_size));
            }
            slab.put_surface(d, slab.in_plane(y) + x, y, found, share, color);
        });
}

/// Calls visit(x, y, columns that clipping keeps) for vectors of the slice, row by row.
template <bool cuts, class T, class Visit>
HWY_INLINE void for_each_kept(const Slab<T>& slab, const Visit& visit) {
    constexpr int lanes = Slab<T>::lanes;
    const Rect& rect = slab.window.rect;
    for (int y = rect.y0; y < rect.y1; ++y) {
        const Columns kept = cuts ? slab.columns_of_group(y, 0, slab.columns_kept(y, 0)) : Columns{rect.x0, rect.x1};
        for (int x = kept.x0 / lanes * lanes; x < kept.x1; x += lanes) {
            visit(x, y, kept);
        }
    }
}

/// Calls visit(x, y, numbers) for a sheet, row by row; cuts: 0 where the point is cut off.
template <bool cuts, class T, class Visit>
HWY_INLINE void for_each_in_sheet(const Slab<T>& slab, const T* sheet, const Visit& visit) {
    const typename Slab<T>::D d;
    for_each_kept<cuts>(slab, [&](int x, int y, const Columns& kept) SHEETSPLAT_CPU_INLINE {
        auto value = hn::LoadU(d, sheet + slab.in_sheet(y) + x);
        if constexpr (cuts) {
            value = hn::IfThenElseZero(slab.owned(d, slab.kept(d, hn::Eq(value, value), 0, y, x, kept), y, x), value);
        }
        visit(x, y, value);
    });
}

/// Adds a sheet, times a step along the pixel's ray, to a plane: x-ray and coverage. weights: those below 0 are of
/// points that are empty all the same (divide_group()).
template <bool cuts, class T>
HWY_NOINLINE void add_sheet(const Slab<T>& slab, const T* sheet, T step, T* plane, bool weights) {
    using V = typename Slab<T>::V;
    const typename Slab<T>::D d;
    for_each_in_sheet<cuts>(slab, sheet, [&](int x, int y, V value) SHEETSPLAT_CPU_INLINE {
        if (hn::AllTrue(d, hn::Eq(value, hn::Zero(d)))) {
            return;
        }
        V length = hn::Set(d, step);
        if (slab.shading.perspective) {
            length = hn::Mul(length, slab.ray(d, x, y).slant);
        }
        T* to = plane + slab.in_plane(y) + x;
        hn::StoreU(hn::MulAdd(weights ? hn::Abs(value) : value, length, hn::LoadU(d, to)), d, to);
    });
}

/// Calls visit(x, y, lanes) for vectors with points of the slice that some kernel reaches and that are kept.
template <bool cuts, class T, class Visit>
HWY_INLINE void for_each_reached(const Slab<T>& slab, const Visit& visit) {
    const typename Slab<T>::D d;
    for_each_kept<cuts>(slab, [&](int x, int y, const Columns& kept) SHEETSPLAT_CPU_INLINE {
        auto reached = slab.weighs(d, hn::LoadU(d, slab.sheets.weight[0] + slab.in_sheet(y) + x));
        if constexpr (cuts) {
            reached = slab.owned(d, slab.kept(d, reached, 0, y, x, kept), y, x);
        }
        if (!hn::AllFalse(d, reached)) {
            visit(x, y, reached);
        }
    });
}

/// The largest or the smallest scalar.
template <bool cuts, class T>
HWY_NOINLINE void find_extreme(const Slab<T>& slab) {
    using V = typename Slab<T>::V;
    using M = typename Slab<T>::M;
    const typename Slab<T>::D d;
    const V step = hn::Set(d, slab.shading.scalar_step);
    for_each_reached<cuts>(slab, [&](int x, int y, M reached) SHEETSPLAT_CPU_INLINE {
        T* to = slab.picture.scalar + slab.in_plane(y) + x;
        const V found = hn::LoadU(d, to);
        const V value = hn::Mul(slab.rho(d, 1, y, x), step);
        hn::StoreU(hn::IfThenElse(reached, extreme(slab.shading.mode, found, value), found), d, to);
    });
}

/// Adds scalars up, and counts them.
template <bool cuts, class T>
HWY_NOINLINE void add_counted(const Slab<T>& slab) {
    using V = typename Slab<T>::V;
    using M = typename Slab<T>::M;
    const typename Slab<T>::D d;
    const V step = hn::Set(d, slab.shading.scalar_step), one = hn::Set(d, T(1));
    for_each_reached<cuts>(slab, [&](int x, int y, M reached) SHEETSPLAT_CPU_INLINE {
        const std::ptrdiff_t at = slab.in_plane(y) + x;
        const auto add = [&](T* plane, V value) SHEETSPLAT_CPU_INLINE {
            hn::StoreU(hn::Add(hn::LoadU(d, plane + at), hn::IfThenElseZero(reached, value)), d, plane + at);
        };
        add(slab.picture.scalar, hn::Mul(slab.rho(d, 1, y, x), step));
        add(slab.picture.counted, one);
    });
}

/// Adds the slice's -ln(1 - alpha), at most densest_slice, to plane alpha.
template <class Table, class T>
HWY_NOINLINE void absorb(const Slab<T>& slab) {
    using V = typename Slab<T>::V;
    using M = typename Slab<T>::M;
    constexpr int lanes = Slab<T>::lanes;
    constexpr T densest_slice = T(20);
    const typename Slab<T>::D d;
    const Shading<T>& shading = slab.shading;
    const Table table(slab.group.transfer);
    const V one = hn::Set(d, T(1)), densest = hn::Set(d, densest_slice);
    const V below = hn::Set(d, slab.group.transfer.below), above = hn::Set(d, slab.group.transfer.above);
    const V exponent = hn::Set(d, shading.exponent);
    for (int y = slab.window.rect.y0; y < slab.window.rect.y1; ++y) {
        const Columns kept = slab.columns_of_group(y, 0, slab.columns_kept(y, 0));
        for (int x = kept.x0 / lanes * lanes; x < kept.x1; x += lanes) {
            const V rho = slab.rho(d, 1, y, x);
            const M seen =
                slab.reached(d, slab.within(d, hn::And(hn::Gt(rho, below), hn::Lt(rho, above)), x, kept), 0, y, x);
            const M visible = slab.owned(d, seen, y, x);
            if (hn::AllFalse(d, visible)) {
                continue;
            }
            typename Table::Place place;
            const V a = hn::IfThenElseZero(visible, table.opacity(d, rho, place));
            const auto clear = hn::Lt(a, one);
            const V thin = hn::Mul(exponent, absorption(d, hn::IfThenElseZero(clear, a)));
            T* sum = slab.picture.alpha + slab.in_plane(y) + x;
            hn::StoreU(hn::Add(hn::LoadU(d, sum), hn::IfThenElse(clear, hn::Min(thin, densest), densest)), d, sum);
        }
    }
}

} // namespace sheetsplat::backend_cpu::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif // SHEETSPLAT_CPU_SLAB_PASSES_INL

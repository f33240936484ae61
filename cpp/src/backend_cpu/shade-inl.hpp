// Classifies, shades and composites one finished slice, or the interval behind it, over the pixels of a tile: chooses
// the passes that the scene calls for. Source: conventions, sections 4 to 7; [EKE01] for intervals.

#if defined(SHEETSPLAT_CPU_SHADE_INL) == defined(HWY_TARGET_TOGGLE)
#ifdef SHEETSPLAT_CPU_SHADE_INL
#undef SHEETSPLAT_CPU_SHADE_INL
#else
#define SHEETSPLAT_CPU_SHADE_INL
#endif

#include <cstddef>
#include <type_traits>

#include "backend_cpu/shading.hpp"
#include "backend_cpu/tile.hpp"
#include "classified-inl.hpp"
#include "effects-inl.hpp"
#include "groups-inl.hpp"
#include "hwy/highway.h"
#include "scene/mode_rules.hpp"
#include "slab_passes-inl.hpp"

HWY_BEFORE_NAMESPACE();
namespace sheetsplat::backend_cpu::HWY_NAMESPACE {

template <class T, class Pass>
HWY_INLINE void by_projection(const Shading<T>& shading, const Pass& pass) {
    if (shading.perspective) {
        pass(std::true_type());
    } else {
        pass(std::false_type());
    }
}

/// Modes composite and isosurface, of several groups or surfaces.
template <class T>
HWY_NOINLINE void shade_groups(const Slab<T>& slab) {
    by_projection(slab.shading, [&](auto perspective) {
        constexpr bool in_perspective = decltype(perspective)::value;
        if (shows_surfaces(slab.shading.mode)) {
            find_all_crossings<in_perspective>(slab);
        } else {
            mix_groups<in_perspective>(slab);
        }
    });
}

/// Modes composite and isosurface of one group. straight: without effects and cuts.
template <class T>
HWY_NOINLINE void shade_group(const Slab<T>& slab, bool straight) {
    const Shading<T>& shading = slab.shading;
    const auto shade = [&](const auto& kind) {
        by_projection(shading, [&](auto perspective) {
            constexpr bool in_perspective = decltype(perspective)::value;
            if (!straight) {
                go_through_effects<in_perspective>(slab, kind);
            } else if (shading.lit) {
                go_straight<in_perspective, true>(slab, kind);
            } else {
                go_straight<in_perspective, false>(slab, kind);
            }
        });
    };
    if (shows_surfaces(shading.mode)) {
        shade(Crossings<T>(slab));
    } else if (shading.second_order && shading.groups.size() == 1) {
        by_projection(shading, [&](auto perspective) {
            go_through_effects<decltype(perspective)::value>(slab, SecondOrder<T>(slab));
        });
    } else if (shading.preintegration) {
        shade(Intervals<T>(slab));
    } else {
        with_slices(slab, shade);
    }
}

/// Adds slice n, or with preintegration and isosurfaces the interval from slice n to n + 1, to the picture of a tile.
/// Scalars and coverage come out in world units. All planes and sheets must hold numbers, paddings too (planes:
/// start them with 0, depth with infinity).
template <class T>
HWY_INLINE void shade_slab(const Shading<T>& shading, const TileShape& shape, const SlabWindow<T>& window,
                           TilePicture<T>& picture) {
    if (window.rect.empty()) {
        return;
    }
    const Slab<T> slab(shading, shape, window, picture);
    const bool cuts = shading.cuts && slab.cut(uses_intervals(shading.mode, shading.preintegration));
    const auto add = [&](const Slab<T>& of, const T* sheet, T step, T* plane, bool weights) {
        cuts ? add_sheet<true>(of, sheet, step, plane, weights) : add_sheet<false>(of, sheet, step, plane, weights);
    };
    const std::size_t groups = shading.groups.size();
    for (std::size_t group = 0; group < groups && picture.coverage != nullptr && window.n >= 0; ++group) {
        const Slab<T> of(shading, shape, window, picture, group);
        if (!of.group.counts) {
            continue;
        }
        add(of, of.sheets.weight[0], shading.coverage_step, picture.coverage, true);
    }
    if (shading.open_front && window.n < 0) {
        return;
    }
    if (is_scalar(shading.mode) && groups > 1) {
        sum_groups(slab);
    } else if (traits_of(shading.mode).integrates) {
        add(slab, window.rho[1], shading.scalar_step, picture.scalar, false);
    } else if (is_extreme(shading.mode)) {
        cuts ? find_extreme<true>(slab) : find_extreme<false>(slab);
    } else if (traits_of(shading.mode).mean) {
        cuts ? add_counted<true>(slab) : add_counted<false>(slab);
    } else if (shading.several_shown || shading.several_surfaces) {
        shade_groups(slab);
    } else {
        shade_group(Slab<T>(shading, shape, window, picture, shading.shown), !shading.by_effects && !cuts);
    }
}

/// Adds what slice n takes of light that goes straight through it, as -ln(1 - alpha), to the plane alpha of a tile.
template <class T>
HWY_INLINE void absorb_slab(const Shading<T>& shading, const TileShape& shape, const SlabWindow<T>& window,
                            TilePicture<T>& picture) {
    for (std::size_t group = 0; group < shading.groups.size(); ++group) {
        const Slab<T> slab(shading, shape, window, picture, group);
        if (slab.group.classified) {
            with_slices(slab, [&](const auto& kind) { absorb(slab, kind); });
        }
    }
}

} // namespace sheetsplat::backend_cpu::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif // SHEETSPLAT_CPU_SHADE_INL

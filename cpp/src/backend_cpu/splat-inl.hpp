// Adds kernels to sheets: chooses the splat loop that a kernel's shape and the sampling call for. Source:
// conventions, sections 2 and 3; [NM05] section 4.2, [NM06] section 4.1, with the factors of backend_cpu/sections.hpp.

#if defined(SHEETSPLAT_CPU_SPLAT_INL) == defined(HWY_TARGET_TOGGLE)
#ifdef SHEETSPLAT_CPU_SPLAT_INL
#undef SHEETSPLAT_CPU_SPLAT_INL
#else
#define SHEETSPLAT_CPU_SPLAT_INL
#endif

#include <algorithm>
#include <cmath>

#include "backend_cpu/tile_task.hpp"
#include "hwy/highway.h"
#include "splat_batches-inl.hpp"
#include "splat_ellipses-inl.hpp"
#include "splat_products-inl.hpp"
#include "splat_slabs-inl.hpp"
#include "splat_spheres-inl.hpp"
#include "splat_target-inl.hpp"

HWY_BEFORE_NAMESPACE();
namespace sheetsplat::backend_cpu::HWY_NAMESPACE {

/// Whether rows and columns of pixels are axes of a kernel's sections, in the same place in each.
template <class T>
HWY_INLINE bool is_upright(const RowShape<T>& shape) {
    return shape.Y1 == T(0) && shape.d1 == T(0) && shape.d2 == T(0);
}

/// The pixels of a rectangle that a kernel can touch.
template <class T>
HWY_INLINE Rect box_in(const SectionExtra<T>& extra, const Rect& seen) {
    return {std::max<int>(extra.x0, seen.x0), std::max<int>(extra.y0, seen.y0), std::min<int>(extra.x1, seen.x1),
            std::min<int>(extra.y1, seen.y1)};
}

template <Sums sums, class T, bool slopes>
HWY_INLINE int add_kernel(Splat<T, slopes>& splat, const Section<T>& section, const SectionExtra<T>& extra,
                          const RowShape<T>& shape, int count) {
    if (splat.setup.slab) {
        const Rect box = box_in(extra, splat.live.rect);
        if (box.empty()) {
            return 0;
        }
        if (is_upright(shape) && !splat.setup.perspective && splat.profile.integrates &&
            splat.profile.root_falloff * std::abs(shape.ds) >= shortest_slab<T>) {
            return add_upright_slabs<sums>(splat, section, extra.weight, shape, count, box);
        }
        return add_ray_slabs<sums>(splat, section, extra.weight, shape, count, box);
    }
    if (is_upright(shape) && !splat.setup.perspective) {
        return add_spheres<sums>(splat, section, extra.weight, shape, T(1) / shape.X, count);
    }
    if constexpr (!slopes) {
        if (splat.setup.perspective && shape.Y1 == T(0) && extra.x0 < extra.x1) {
            const Rect box = box_in(extra, splat.live.rect);
            if (box.empty() || !splat.live.sees(box.x0, box.y0, box.x1, box.y1)) {
                return 0;
            }
            return add_one_product<sums>(ProductBox<T>(box, T(0), T(0)), splat, section, extra.weight,
                                         product_view<T>(splat, shape, T(0), T(0), nullptr), count);
        }
    }
    return add_ellipses<sums>(splat, section, extra.weight, shape, count);
}

/// Adds the slices from n on, `count` of them, of a kernel. Returns how many sections were drawn.
template <class T, bool slopes>
HWY_INLINE int add_kernel(Splat<T, slopes>& splat, const Section<T>& section, const SectionExtra<T>& extra,
                          const RowShape<T>& shape, int count) {
    return with_sums<T>(splat.profile, [&](auto sums) SHEETSPLAT_CPU_INLINE {
        return add_kernel<sums.value>(splat, section, extra, shape, count);
    });
}

} // namespace sheetsplat::backend_cpu::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif // SHEETSPLAT_CPU_SPLAT_INL

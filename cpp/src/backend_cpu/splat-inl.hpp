// Adds kernels to sheets: chooses the splat loops that the kernels of a part and the sampling call for. Source:
// conventions, sections 2 and 3; [NM05] section 4.2, [NM06] section 4.1, with the factors of backend_cpu/sections.hpp.

#if defined(SHEETSPLAT_CPU_SPLAT_INL) == defined(HWY_TARGET_TOGGLE)
#ifdef SHEETSPLAT_CPU_SPLAT_INL
#undef SHEETSPLAT_CPU_SPLAT_INL
#else
#define SHEETSPLAT_CPU_SPLAT_INL
#endif

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <type_traits>

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
    const Amounts<T> amounts{section.value, extra.weight, extra.other};
    if (splat.setup.slab) {
        const Rect box = box_in(extra, splat.live.rect);
        if (box.empty()) {
            return 0;
        }
        if (is_upright(shape) && !splat.setup.perspective && splat.profile.integrates &&
            splat.profile.root_falloff * std::abs(shape.ds) >= shortest_slab<T>) {
            return add_upright_slabs<sums>(splat, section, amounts, shape, count, box);
        }
        return add_ray_slabs<sums>(splat, section, amounts, shape, count, box);
    }
    if (is_upright(shape) && !splat.setup.perspective) {
        return add_spheres<sums>(splat, section, amounts, shape, T(1) / shape.X, count);
    }
    if constexpr (!slopes) {
        if (splat.setup.perspective && shape.Y1 == T(0) && extra.x0 < extra.x1) {
            const Rect box = box_in(extra, splat.live.rect);
            if (box.empty() || !splat.live.sees(box.x0, box.y0, box.x1, box.y1)) {
                return 0;
            }
            return add_one_product<sums>(ProductBox<T>(box, T(0), T(0)), splat, section, amounts,
                                         product_view<T>(splat, shape, T(0), T(0), nullptr), count);
        }
    }
    return add_ellipses<sums>(splat, section, amounts, shape, count);
}

/// The last slice that a kernel meets whose extent along depth is half_depth slices.
template <class T>
HWY_INLINE std::int32_t last_of(const Section<T>& section, T half_depth, std::int32_t most) {
    const T further = std::floor((T(1) + section.s) * half_depth);
    return static_cast<std::int32_t>(
        std::min(static_cast<T>(section.first) + std::max(further, T(-1)), static_cast<T>(most)));
}

/// Kernels that are drawn one by one. several: for several lattices.
template <Sums sums, class T, bool slopes, bool several = false>
class SingleKernels {
  public:
    SingleKernels(Splat<T, slopes>& splat, const TileKernels<T>& kernels) : splat_(splat), kernels_(kernels) {}

    /// Draws the kernel of each of some numbers. Returns how many sections were drawn.
    HWY_NOINLINE int draw(const std::uint32_t* numbers, int number) {
        int drawn = 0;
        for (int kernel = 0; kernel < number; ++kernel) {
            const Section<T>& section = kernels_.sections[numbers[kernel]];
            const RowShape<T>& shape = kernels_.shapes[kernels_.shapes.size() == 1 ? 0 : numbers[kernel]];
            SectionExtra<T> extra;
            if (kernels_.extras.empty()) {
                extra.weight = kernels_.weight;
                extra.last = last_of(section, T(-1) / shape.ds, kernels_.last_slice);
            } else {
                extra = kernels_.extras[numbers[kernel]];
            }
            const int count = splat_.slices_of(extra.last, numbers[kernel]);
            if (count > 0) {
                for_each_value<several>(splat_, kernels_, numbers[kernel], [&](Splat<T, slopes>& to, T value) {
                    Section<T> own = section;
                    own.value = value;
                    drawn += add_kernel<sums>(to, own, extra, shape, count);
                });
            }
        }
        return drawn;
    }

  private:
    Splat<T, slopes>& splat_;
    const TileKernels<T>& kernels_;
};

/// The same of upright kernels of one shape.
template <Sums sums, class T, bool slopes, bool several = false>
class UprightKernels {
  public:
    UprightKernels(Splat<T, slopes>& splat, const TileKernels<T>& kernels)
        : splat_(splat), kernels_(kernels), per_X_(T(1) / kernels.shapes.front().X),
          half_depth_(T(-1) / kernels.shapes.front().ds) {}

    HWY_NOINLINE int draw(const std::uint32_t* numbers, int number) {
        int drawn = 0;
        for (int kernel = 0; kernel < number; ++kernel) {
            const Section<T>& section = kernels_.sections[numbers[kernel]];
            const int count = splat_.slices_of(last_of(section, half_depth_, kernels_.last_slice), numbers[kernel]);
            if (count > 0) {
                for_each_value<several>(splat_, kernels_, numbers[kernel], [&](Splat<T, slopes>& to, T value) {
                    drawn += add_spheres<sums>(to, section, {value, kernels_.weight, T(0)}, kernels_.shapes.front(),
                                               per_X_, count);
                });
            }
        }
        return drawn;
    }

  private:
    Splat<T, slopes>& splat_;
    const TileKernels<T>& kernels_;
    const T per_X_, half_depth_;
};

/// Calls use(way) with how kernels of a part are drawn on slice n and those behind it: way.draw(numbers, how many).
/// lean: kept for the part.
template <class T, bool slopes, class Use>
bool with_way(Splat<T, slopes>& splat, const TileKernels<T>& kernels, const TileShape& tile, LeanTables<T>& lean,
              const Use& use) {
    const LoopSetup<T>& setup = splat.setup;
    const RowShape<T>& shape = kernels.shapes.front();
    const bool alike = kernels.shapes.size() == 1 && kernels.extras.empty() && !setup.slab;
    const bool upright = alike && !setup.perspective && is_upright(shape);
    if constexpr (!slopes) {
        if (splat.profile.other_channel >= 0) {
            return use(SingleKernels<Sums::pairs, T, slopes>(splat, kernels));
        }
    }
    const auto by_shape = [&](auto sums, auto several) {
        constexpr Sums added = decltype(sums)::value;
        constexpr bool of_several = decltype(several)::value;
        if (upright) {
            return SphereBatch<added, T, slopes, of_several>::holds(shape)
                       ? use(SphereBatch<added, T, slopes, of_several>(splat, kernels))
                       : use(UprightKernels<added, T, slopes, of_several>(splat, kernels));
        }
        if constexpr (!slopes) {
            if (alike && are_products(setup, splat.profile, kernels, tile, splat.n, lean)) {
                const ProductView<T> view = product_view(splat, shape, kernels.reach_x, kernels.reach_y, &lean);
                return use(ProductBatch<added, T, of_several>(splat, kernels, view));
            }
        }
        return use(SingleKernels<added, T, slopes, of_several>(splat, kernels));
    };
    if constexpr (!slopes) {
        if (kernels.fields > 1) {
            return by_shape(std::integral_constant<Sums, Sums::values>(), std::true_type());
        }
    }
    return with_sums<T>(splat.profile, [&](auto sums) { return by_shape(sums, std::false_type()); });
}

} // namespace sheetsplat::backend_cpu::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif // SHEETSPLAT_CPU_SPLAT_INL

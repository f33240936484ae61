// Gradients and Phong shading of a vector of pixels. Source: conventions, section 5.

#if defined(SHEETSPLAT_CPU_LIGHT_INL) == defined(HWY_TARGET_TOGGLE)
#ifdef SHEETSPLAT_CPU_LIGHT_INL
#undef SHEETSPLAT_CPU_LIGHT_INL
#else
#define SHEETSPLAT_CPU_LIGHT_INL
#endif

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <limits>

#include "backend_cpu/shading.hpp"
#include "hwy/highway.h"
#include "math-inl.hpp"
#include "transfer-inl.hpp"

HWY_BEFORE_NAMESPACE();
namespace sheetsplat::backend_cpu::HWY_NAMESPACE {

/// What a slab's gradients are scaled with, so that their squares stay within the number format.
template <class T>
struct GradientScale {
    T across[2] = {T(0), T(0)}; ///< slices n and n + 1
    T along = T(0);
    T weakest = T(0);
    T full = T(1); ///< gradient opacity is 1 from this gradient on

    GradientScale(const Shading<T>& shading, const GroupShading<T>& group, std::int64_t n) {
        double scale[2];
        for (int ahead = 0; ahead < 2; ++ahead) {
            const double depth = shading.first_depth + static_cast<double>(n + ahead) * shading.slice_spacing;
            // At and behind the eye there are no slices: differences are 0 there.
            scale[ahead] = !shading.perspective ? shading.gradient_across
                           : depth > 0.0        ? shading.gradient_across / depth
                                                : 0.0;
        }
        const double largest = std::max({scale[0], scale[1], shading.gradient_along});
        const double unit = largest > 0.0 ? 1.0 / largest : 1.0;
        across[0] = static_cast<T>(scale[0] * unit);
        across[1] = static_cast<T>(scale[1] * unit);
        along = static_cast<T>(shading.gradient_along * unit);
        // Shares of it stand for normals of cuts.
        const double least = shading.cut_faces ? 1e-30 : static_cast<double>(std::numeric_limits<T>::min());
        const auto positive = [&](double gradient) { return static_cast<T>(std::clamp(gradient * unit, least, 1e30)); };
        weakest = positive(group.weakest_gradient);
        full = positive(group.full_gradient);
    }
};

/// The pixel's ray: slopes and their secant; in orthographic views 0 and 1.
template <class D>
struct Ray {
    hn::Vec<D> x, y, slant;
};

/// Minus the gradient.
template <class D>
struct Normal {
    hn::Vec<D> x, y, z;
};

/// `share` of the way from one to the other.
template <class D, class V = hn::Vec<D>>
HWY_INLINE Normal<D> mix(D, const Normal<D>& from, const Normal<D>& to, V share) {
    const auto between = [&](V a, V b) { return hn::MulAdd(share, hn::Sub(b, a), a); };
    return {between(from.x, to.x), between(from.y, to.y), between(from.z, to.z)};
}

template <class D>
HWY_INLINE hn::Vec<D> length(D, const Normal<D>& v) {
    return hn::Sqrt(hn::MulAdd(v.x, v.x, hn::MulAdd(v.y, v.y, hn::Mul(v.z, v.z))));
}

/// The colour of an isosurface before it is lit.
template <class D, class T = hn::TFromD<D>>
HWY_INLINE Color<D> iso_color(D d, const ShadingSurface<T>& surface) {
    return {hn::Set(d, surface.color[0]), hn::Set(d, surface.color[1]), hn::Set(d, surface.color[2])};
}

/// Minus the gradient at pixels of the slice `here`; pointers to the first pixel.
template <bool perspective, class D, class T = hn::TFromD<D>>
HWY_INLINE Normal<D> against_gradient(D d, const T* before, const T* here, const T* after, std::ptrdiff_t stride,
                                      T across_scale, T along_scale, const Ray<D>& ray) {
    const auto across = hn::Set(d, across_scale);
    const auto x = hn::Mul(hn::Sub(hn::LoadU(d, here - 1), hn::LoadU(d, here + 1)), across);
    const auto y = hn::Mul(hn::Sub(hn::LoadU(d, here + stride), hn::LoadU(d, here - stride)), across);
    const auto z = hn::Mul(hn::Sub(hn::LoadU(d, after), hn::LoadU(d, before)), hn::Set(d, along_scale));
    if constexpr (perspective) {
        return {x, y, hn::MulAdd(ray.x, x, hn::MulAdd(ray.y, y, z))};
    } else {
        return {x, y, z};
    }
}

/// The same from sums of the kernels' own derivatives over columns, rows and slices, which stand in the place of half
/// the differences.
template <bool perspective, class D, class T = hn::TFromD<D>>
HWY_INLINE Normal<D> against_slope(D d, const T* const* slope, std::ptrdiff_t at, T across_scale, T along_scale,
                                   const Ray<D>& ray) {
    const auto across = hn::Set(d, T(2) * across_scale);
    const auto x = hn::Neg(hn::Mul(hn::LoadU(d, slope[0] + at), across));
    const auto y = hn::Mul(hn::LoadU(d, slope[1] + at), across);
    const auto z = hn::Mul(hn::LoadU(d, slope[2] + at), hn::Set(d, T(2) * along_scale));
    if constexpr (perspective) {
        return {x, y, hn::MulAdd(ray.x, x, hn::MulAdd(ray.y, y, z))};
    } else {
        return {x, y, z};
    }
}

/// Light that neither shadows nor ambient occlusion dim.
struct Undimmed {
    static constexpr bool anything = false;
};

/// Phong. weakest: g0 in the unit of the gradient, above 0. Lanes outside of `wanted` may come out as anything finite.
/// dimmed: what is left of each light and of ambient light.
/// per_size: comes out as 1 / max(|gradient|, g0).
template <bool perspective, class D, class T = hn::TFromD<D>, class V = hn::Vec<D>, class Dimmed = Undimmed>
HWY_INLINE Color<D> phong(D d, const Shading<T>& shading, const Color<D>& color, const Normal<D>& against, T weakest,
                          const Ray<D>& ray, hn::Mask<D> wanted, V& per_size, const Dimmed& dimmed = {}) {
    const V zero = hn::Zero(d);
    per_size = hn::Div(hn::Set(d, T(1)), hn::Max(length(d, against), hn::Set(d, weakest)));
    const Normal<D> normal{hn::Mul(against.x, per_size), hn::Mul(against.y, per_size), hn::Mul(against.z, per_size)};
    V to_viewer = normal.z, per_slant = zero;
    if constexpr (perspective) {
        if (shading.specular) {
            per_slant = hn::Div(hn::Set(d, T(1)), ray.slant);
            to_viewer = hn::Mul(hn::NegMulAdd(normal.x, ray.x, hn::NegMulAdd(normal.y, ray.y, normal.z)), per_slant);
        }
    }
    V ambient = hn::Set(d, shading.ambient);
    if constexpr (Dimmed::anything) {
        ambient = hn::Mul(ambient, dimmed.ambient());
    }
    Color<D> matt{ambient, ambient, ambient};
    Color<D> shine{zero, zero, zero};
    for (const ShadingLight<T>& light : shading.lights) {
        const V x = hn::Set(d, light.direction[0]), y = hn::Set(d, light.direction[1]),
                z = hn::Set(d, light.direction[2]);
        const V towards = hn::MulAdd(normal.x, x, hn::MulAdd(normal.y, y, hn::Mul(normal.z, z)));
        V facing = shading.two_sided ? hn::Abs(towards) : hn::Max(towards, zero);
        if constexpr (Dimmed::anything) {
            // Lights behind every visible point need no look-up.
            if (!hn::AllFalse(d, hn::And(wanted, hn::Gt(facing, zero)))) {
                facing = hn::Mul(facing, dimmed.light(static_cast<std::size_t>(&light - shading.lights.data())));
            }
        }
        matt.red = hn::MulAdd(facing, hn::Set(d, light.diffuse[0]), matt.red);
        if (!shading.gray) {
            matt.green = hn::MulAdd(facing, hn::Set(d, light.diffuse[1]), matt.green);
            matt.blue = hn::MulAdd(facing, hn::Set(d, light.diffuse[2]), matt.blue);
        }
        if (!shading.specular) {
            continue;
        }
        // (2 f N' - L) V with N' turned along with f is 2 (N L) (N V) - L V on either side.
        V light_to_viewer = z;
        if constexpr (perspective) {
            light_to_viewer = hn::Mul(hn::NegMulAdd(x, ray.x, hn::NegMulAdd(y, ray.y, z)), per_slant);
        }
        const V mirrored = hn::MulSub(hn::Add(towards, towards), to_viewer, light_to_viewer);
        const bool even = shading.shininess == T(0);
        const auto seen = even ? hn::And(wanted, hn::Gt(facing, zero))
                               : hn::And(wanted, hn::And(hn::Gt(facing, zero), hn::Gt(mirrored, zero)));
        if (hn::AllFalse(d, seen)) {
            continue;
        }
        V highlight = facing;
        if (!even) {
            const V base = hn::IfThenElseZero(seen, hn::Min(mirrored, hn::Set(d, T(1))));
            highlight = hn::Mul(facing, pow_below_one(d, base, hn::Set(d, shading.shininess)));
        }
        shine.red = hn::MulAdd(highlight, hn::Set(d, light.specular[0]), shine.red);
        if (!shading.gray) {
            shine.green = hn::MulAdd(highlight, hn::Set(d, light.specular[1]), shine.green);
            shine.blue = hn::MulAdd(highlight, hn::Set(d, light.specular[2]), shine.blue);
        }
    }
    if (shading.gray) {
        matt.green = matt.blue = matt.red;
        shine.green = shine.blue = shine.red;
    }
    return {hn::MulAdd(color.red, matt.red, shine.red), hn::MulAdd(color.green, matt.green, shine.green),
            hn::MulAdd(color.blue, matt.blue, shine.blue)};
}

} // namespace sheetsplat::backend_cpu::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif // SHEETSPLAT_CPU_LIGHT_INL

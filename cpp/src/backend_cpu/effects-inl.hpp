// From what is classified to the picture: gradients (analytic too), gradient opacity, light that shadows and ambient
// occlusion dim, depth cue. One loop a stage over a row of pixels.

#if defined(SHEETSPLAT_CPU_EFFECTS_INL) == defined(HWY_TARGET_TOGGLE)
#ifdef SHEETSPLAT_CPU_EFFECTS_INL
#undef SHEETSPLAT_CPU_EFFECTS_INL
#else
#define SHEETSPLAT_CPU_EFFECTS_INL
#endif

#include <algorithm>
#include <cstddef>
#include <vector>

#include "backend_cpu/number.hpp"
#include "effect_row-inl.hpp"
#include "hwy/highway.h"
#include "light-inl.hpp"
#include "light_volume-inl.hpp"
#include "recolor-inl.hpp"
#include "slab-inl.hpp"
#include "surface_light-inl.hpp"
#include "transfer-inl.hpp"
#include "view/cut_faces.hpp"

HWY_BEFORE_NAMESPACE();
namespace sheetsplat::backend_cpu::HWY_NAMESPACE {

/// Minus the gradient at points `share` slice distances behind slice n, and how much an error of rho of 1 changes it
/// (Slab::doubt).
template <bool perspective, bool analytic, bool between, class T, class V = typename Slab<T>::V>
HWY_INLINE Normal<typename Slab<T>::D> gradient_at(const Slab<T>& slab, const GradientScale<T>& scale, int x, int y,
                                                   V share, typename Slab<T>::M seen, V& doubt) {
    const typename Slab<T>::D d;
    const auto ray = slab.template ray_if<perspective>(d, x, y);
    const std::ptrdiff_t at = slab.in_sheet(y) + x;
    const auto of = [&](int ahead) {
        if constexpr (analytic) {
            return against_slope<perspective>(d, slab.sheets.slope[ahead], at, scale.across[ahead], scale.along, ray);
        } else {
            return slab.template difference<perspective>(d, ahead, at, scale, ray);
        }
    };
    const auto front = of(0);
    doubt = hn::Set(d, slab.shading.gradient_doubt);
    if constexpr (between) {
        const auto back = of(1), against = mix(d, front, back, share);
        if (shows_surfaces(slab.shading.mode)) {
            doubt = hn::Add(doubt, moved_gradient(d, slab, front, back, against, scale.weakest, x, y, seen));
        }
        return against;
    } else {
        return front;
    }
}

template <bool perspective, bool analytic, bool between, class T>
HWY_NOINLINE void find_gradients(const Slab<T>& slab, EffectRow<T>& row, const GradientScale<T>& scale) {
    const typename Slab<T>::D d;
    row.for_each(row.seen, [&](int x, int number, auto seen) {
        typename Slab<T>::V doubt;
        const auto against = gradient_at<perspective, analytic, between>(slab, scale, x, row.y,
                                                                         hn::Load(d, row.share + number), seen, doubt);
        hn::Store(doubt, d, row.doubt + number);
        hn::Store(against.x, d, row.against_x + number);
        hn::Store(against.y, d, row.against_y + number);
        hn::Store(against.z, d, row.against_z + number);
    });
}

/// What gradient opacity leaves; 1 without it.
template <class T>
HWY_NOINLINE void fade(const Slab<T>& slab, EffectRow<T>& row, const GradientScale<T>& scale) {
    const typename Slab<T>::D d;
    if (!slab.shading.gradient_opacity) {
        row.fill(row.faded, T(1));
        return;
    }
    const auto full = hn::Set(d, scale.full);
    row.for_each(row.seen, [&](int, int number, auto) {
        hn::Store(hn::Div(hn::Min(length(d, row.against(d, number)), full), full), d, row.faded + number);
    });
}

/// Mixes normals with those of the cuts through which rays came: gradients become shorter than g0, which keeps them as
/// they are. Of several groups alpha holds absorptions. Conventions, section 10.
template <class T>
HWY_NOINLINE void turn_to_faces(const Slab<T>& slab, EffectRow<T>& row, const GradientScale<T>& scale) {
    using V = typename Slab<T>::V;
    const typename Slab<T>::D d;
    const Shading<T>& shading = slab.shading;
    const bool mixed = shading.several_shown;
    const FacePlanes<T>& faces = slab.picture.faces[static_cast<std::size_t>(&slab.group - shading.groups.data())];
    const auto all = [&](double value) { return hn::Set(d, static_cast<T>(value)); };
    const V zero = hn::Zero(d), one = all(1.0), two = all(2.0), least = all(0x1p-24), weakest = all(scale.weakest);
    const V slice = all(static_cast<double>(slab.window.n));
    const V length_of = all(shading.face_length), per_length = all(1.0 / shading.face_length);
    const auto ramp = [&](V from_two) { return hn::Min(hn::Max(from_two, zero), one); };
    const auto absorbed_by = [&](V alpha) { return absorption(d, hn::Min(alpha, hn::Sub(one, least))); };
    row.for_each(row.alpha, [&](int x, int number, auto visible) {
        const std::ptrdiff_t at = slab.in_plane(row.y) + x;
        const V whole = hn::Sub(slice, hn::LoadU(d, faces.slice + at));
        const V rest = hn::Sub(hn::Load(d, row.share + number), hn::LoadU(d, faces.behind + at));
        const V behind = hn::Mul(hn::Add(whole, rest), per_length);
        const V near = ramp(hn::NegMulAdd(behind, all(1.0 / face_lengths), two));
        if (hn::AllFalse(d, hn::Gt(near, zero))) {
            return;
        }
        const V alpha = hn::Load(d, row.alpha + number);
        const V absorbed = hn::Mul(mixed ? alpha : absorbed_by(alpha), length_of);
        const V thickness = hn::Min(hn::IfThenElse(visible, absorbed, one), all(thickest_face));
        const V through = hn::Div(absorbed_by(hn::LoadU(d, slab.picture.alpha + at)), thickness);
        const V inside = ramp(hn::Sub(two, hn::Sub(behind, through)));
        const V opaque = opacity_of_absorption(d, hn::Mul(all(face_lengths), thickness));
        const V on_face = hn::Mul(hn::Mul(near, inside), opaque);
        const auto against = row.against(d, number);
        const V left = hn::Div(hn::Mul(hn::Sub(one, on_face), weakest), hn::Max(length(d, against), weakest));
        const V face = hn::Mul(on_face, weakest);
        const auto turn = [&](V own, const T* normal, T* to) {
            hn::Store(hn::MulAdd(face, hn::LoadU(d, normal + at), hn::Mul(left, own)), d, to + number);
        };
        turn(against.x, faces.normal[0], row.against_x);
        turn(against.y, faces.normal[1], row.against_y);
        turn(against.z, faces.normal[2], row.against_z);
        hn::Store(hn::Mul(left, hn::Load(d, row.doubt + number)), d, row.doubt + number);
    });
}

template <bool perspective, class T>
HWY_NOINLINE void light(const Slab<T>& slab, EffectRow<T>& row, const GradientScale<T>& scale) {
    const typename Slab<T>::D d;
    row.for_each(row.alpha, [&](int x, int number, auto visible) {
        auto per_size = hn::Zero(d);
        row.set_color(d, number,
                      phong<perspective>(d, slab.shading, row.color(d, number), row.against(d, number), scale.weakest,
                                         slab.template ray_if<perspective>(d, x, row.y), visible, per_size));
        hn::Store(slab.over_size(d, hn::Load(d, row.doubt + number), per_size), d, row.doubt + number);
    });
}

/// The same where shadows or ambient occlusion take from the light.
template <bool perspective, class T>
HWY_NOINLINE void light_dimmed(const Slab<T>& slab, EffectRow<T>& row, const GradientScale<T>& scale) {
    using D = typename Slab<T>::D;
    const D d;
    const Shading<T>& shading = slab.shading;
    const double depth = slab.depth();
    const auto in = [&](const VolumeLookup& lookup) {
        return VolumeRow<T>(lookup, perspective, slab.shape.x, slab.shape.y + row.y, depth, shading.slice_spacing);
    };
    const auto lit = [&](int x, int number, auto visible, const auto& dimming) {
        Color<D> color = row.color(d, number);
        if (shading.lit) {
            auto per_size = hn::Zero(d);
            color = phong<perspective>(d, shading, color, row.against(d, number), scale.weakest,
                                       slab.template ray_if<perspective>(d, x, row.y), visible, per_size, dimming);
            hn::Store(slab.over_size(d, hn::Load(d, row.doubt + number), per_size), d, row.doubt + number);
        } else {
            const auto ambient = dimming.ambient();
            color = {hn::Mul(color.red, ambient), hn::Mul(color.green, ambient), hn::Mul(color.blue, ambient)};
        }
        row.set_color(d, number, color);
    };
    if (!shading.surface_light.groups.empty()) {
        const LightOfRow<T> left(shading, row, in(shading.surface_light.place));
        row.for_each(row.alpha, [&](int x, int number, auto visible) {
            lit(x, number, visible, DimmingBySurfaces<T>{d, left, shading.shadows, number});
        });
        return;
    }
    std::vector<VolumeRow<T>> rows;
    if (shading.shadows) {
        for (const VolumeLookup& lookup : shading.shadow_of) {
            rows.push_back(in(lookup));
        }
    }
    const VolumeRow<T> openness = in(shading.openness);
    row.for_each(row.alpha, [&](int x, int number, auto visible) {
        const Dimming<D> dimming{d,
                                 rows,
                                 shading.occlusion ? &openness : nullptr,
                                 shading.occlusion_strength,
                                 hn::Iota(d, static_cast<T>(x)),
                                 hn::Load(d, row.share + number)};
        lit(x, number, visible, dimming);
    });
}

template <class T>
HWY_NOINLINE void cue(const Slab<T>& slab, EffectRow<T>& row) {
    using V = typename Slab<T>::V;
    const typename Slab<T>::D d;
    const Shading<T>& shading = slab.shading;
    const ShadingInputs& inputs = shading.inputs;
    const auto share_of = [](double share) { return static_cast<T>(std::clamp(share, -1e30, 1e30)); };
    const V at_slice = hn::Set(d, share_of((slab.depth() - inputs.cue_start) * inputs.cue_per_depth));
    const V per_slice = hn::Set(d, share_of(shading.slice_spacing * inputs.cue_per_depth));
    const V strength = hn::Set(d, static_cast<T>(inputs.cue_strength)), zero = hn::Zero(d), one = hn::Set(d, T(1));
    const T to[] = {number<T>(inputs.cue_color.x), number<T>(inputs.cue_color.y), number<T>(inputs.cue_color.z)};
    row.for_each(row.alpha, [&](int, int number, auto) {
        const V way = hn::MulAdd(hn::Load(d, row.share + number), per_slice, at_slice);
        const V share = hn::Mul(hn::Min(hn::Max(way, zero), one), strength);
        const auto color = row.color(d, number);
        const auto towards = [&](V from, T end) { return hn::MulAdd(share, hn::Sub(hn::Set(d, end), from), from); };
        row.set_color(d, number, {towards(color.red, to[0]), towards(color.green, to[1]), towards(color.blue, to[2])});
    });
}

/// Composites opacities above 0, those of `visible`. lit: doubt is what an error of rho of 1 makes of their light.
template <bool surface, class T, class V = typename Slab<T>::V>
HWY_INLINE void put_vector(const Slab<T>& slab, int x, int y, typename Slab<T>::M visible, V alpha, V share,
                           const Color<typename Slab<T>::D>& color, bool lit, V doubt) {
    const typename Slab<T>::D d;
    const std::ptrdiff_t at = slab.in_plane(y) + x;
    V shown = hn::IfThenElseZero(visible, hn::Set(d, T(1)));
    if constexpr (surface) {
        slab.put_surface(d, at, y, visible, share, color);
    } else {
        shown = slab.put_behind(d, at, y, visible, hn::LoadU(d, slab.picture.alpha + at), alpha, color);
    }
    if (lit) {
        slab.doubt(d, shown, doubt);
    }
}

template <bool surface, class T>
HWY_NOINLINE void put(const Slab<T>& slab, const EffectRow<T>& row) {
    const typename Slab<T>::D d;
    row.for_each(row.alpha, [&](int x, int number, auto visible) {
        put_vector<surface>(slab, x, row.y, visible, hn::Load(d, row.alpha + number), hn::Load(d, row.share + number),
                            row.color(d, number), slab.shading.lit, hn::Load(d, row.doubt + number));
    });
}

/// Gradients of what is seen, where there are any.
template <bool perspective, bool between, class T>
HWY_INLINE void find_gradients_of(const Slab<T>& slab, EffectRow<T>& row, const GradientScale<T>& scale) {
    if (slab.shading.gradient) {
        slab.shading.analytic_gradient ? find_gradients<perspective, true, between>(slab, row, scale)
                                       : find_gradients<perspective, false, between>(slab, row, scale);
    }
}

/// From the transfer function's colours to those that are composited.
template <bool perspective, class T>
HWY_INLINE void shade_colors(const Slab<T>& slab, EffectRow<T>& row, const GradientScale<T>& scale) {
    const Shading<T>& shading = slab.shading;
    if (shading.cut_faces) {
        turn_to_faces(slab, row, scale);
    }
    if (shading.shadows || shading.occlusion) {
        light_dimmed<perspective>(slab, row, scale);
    } else if (shading.lit) {
        light<perspective>(slab, row, scale);
    }
    if (shading.depth_cue) {
        cue(slab, row);
    }
}

/// Calls draw(row, here, after) for each row that still changes, of at most EffectRow::room pixels; here, after: the
/// columns that clipping keeps of slices n and n + 1. between: slice n + 1 is looked at.
template <bool between, class T, class Draw>
HWY_INLINE void for_each_row(const Slab<T>& slab, EffectRow<T>& row, const Draw& draw) {
    const Rect& rect = slab.window.rect;
    for (row.y = rect.y0; row.y < rect.y1; ++row.y) {
        if (slab.picture.row_alive[row.y] == 0) {
            continue;
        }
        const Columns whole{rect.x0, rect.x1};
        const Columns here = slab.shading.cuts ? slab.columns_kept(row.y, 0) : whole;
        const Columns after = slab.shading.cuts && between ? slab.columns_kept(row.y, 1) : whole;
        for (row.begin = slab.first_column(); row.begin < rect.x1; row.begin += EffectRow<T>::room) {
            row.past = std::min(row.begin + EffectRow<T>::room, rect.x1);
            draw(here, after);
        }
    }
}

/// All stages, a row at a time. kind: a class of classified-inl.hpp.
template <bool perspective, class Kind, class T>
HWY_NOINLINE void go_through_effects(const Slab<T>& slab, const Kind& kind) {
    const GradientScale<T> scale(slab.shading, slab.group, slab.window.n);
    SuppliedColors<T> colors(slab);
    EffectRow<T> row;
    for_each_row<Kind::between>(slab, row, [&](const Columns& here, const Columns& after) {
        const Columns own = slab.columns_of_group(row.y, 0, here);
        if (!see(slab, kind, row, own, Kind::between ? slab.columns_of_group(row.y, 1, after) : after)) {
            return;
        }
        find_gradients_of<perspective, Kind::between>(slab, row, scale);
        if constexpr (Kind::has_opacity) {
            fade(slab, row, scale);
        }
        if (!classify<perspective, false>(kind, row)) {
            return;
        }
        recolor<Kind::between && Kind::has_opacity, Kind::between>(colors, row);
        shade_colors<perspective>(slab, row, scale);
        put<!Kind::has_opacity>(slab, row);
    });
}

/// A vector of pixels through the stages of scenes without effects. colors: null where the group has its own.
template <bool perspective, bool lit, class Kind, class T>
HWY_INLINE void shade_vector(const Slab<T>& slab, const Kind& kind, const GradientScale<T>& scale,
                             SuppliedColors<T>* colors, int x, int y, typename Slab<T>::M seen) {
    using V = typename Slab<T>::V;
    const typename Slab<T>::D d;
    Color<typename Slab<T>::D> color;
    const V alpha = kind.template opacity<perspective>(x, y, seen, hn::IfThenElseZero(seen, hn::Set(d, T(1))), color);
    const auto visible = hn::Gt(alpha, hn::Zero(d));
    if (hn::AllFalse(d, visible)) {
        return;
    }
    const V share = kind.share(x, y, visible);
    if (HWY_UNLIKELY(colors != nullptr)) {
        colors->template begin_row<Kind::between>(y, {slab.window.rect.x0, slab.window.rect.x1});
        color = colors->template in_place_of < Kind::between && Kind::has_opacity,
        Kind::between > (x, visible, share, color);
    }
    V doubt = hn::Zero(d);
    if constexpr (lit) {
        const auto against = gradient_at<perspective, false, Kind::between>(slab, scale, x, y, share, visible, doubt);
        V per_size;
        color = phong<perspective>(d, slab.shading, color, against, scale.weakest,
                                   slab.template ray_if<perspective>(d, x, y), visible, per_size);
        doubt = slab.over_size(d, doubt, per_size);
    }
    put_vector<!Kind::has_opacity>(slab, x, y, visible, alpha, share, color, lit, doubt);
}

/// The same stages, a vector at a time, in scenes without effects and cuts: frames take 3 to 13 % less time. (kind is a
/// copy, which stores to the picture cannot change.)
template <bool perspective, bool lit, class Kind, class T>
HWY_NOINLINE void go_straight(const Slab<T>& slab, const Kind kind) {
    const typename Slab<T>::D d;
    const GradientScale<T> scale(slab.shading, slab.group, slab.window.n);
    const Rect& rect = slab.window.rect;
    const Columns whole{rect.x0, rect.x1};
    SuppliedColors<T> supplied(slab);
    SuppliedColors<T>* const colors = supplied.none() ? nullptr : &supplied;
    for (int y = rect.y0; y < rect.y1; ++y) {
        if (slab.picture.row_alive[y] == 0) {
            continue;
        }
        for (int x = slab.first_column(); x < rect.x1; x += Slab<T>::lanes) {
            auto seen = kind.may(x, y, whole, whole);
            if (hn::AllFalse(d, seen)) {
                continue;
            }
            seen = slab.unfinished(d, seen, y, x);
            if (!hn::AllFalse(d, seen)) {
                shade_vector<perspective, lit>(slab, kind, scale, colors, x, y, seen);
            }
        }
    }
}

} // namespace sheetsplat::backend_cpu::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif // SHEETSPLAT_CPU_EFFECTS_INL

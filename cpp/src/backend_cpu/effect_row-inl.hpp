// A row of pixels on its way through the effects beyond the papers, and how each kind of picture begins it: which
// points may show, and what their colours and opacities are.

#if defined(SHEETSPLAT_CPU_EFFECT_ROW_INL) == defined(HWY_TARGET_TOGGLE)
#ifdef SHEETSPLAT_CPU_EFFECT_ROW_INL
#undef SHEETSPLAT_CPU_EFFECT_ROW_INL
#else
#define SHEETSPLAT_CPU_EFFECT_ROW_INL
#endif

#include <cstddef>

#include "hwy/highway.h"
#include "math-inl.hpp"
#include "ramp-inl.hpp"
#include "slab-inl.hpp"
#include "transfer-inl.hpp"

HWY_BEFORE_NAMESPACE();
namespace sheetsplat::backend_cpu::HWY_NAMESPACE {

/// Pixels of one row. Each effect is a loop of its own over the row, so that an effect that is off costs nothing and
/// there are as many loops as effects, not as combinations of them.
template <class T>
struct EffectRow {
    using D = typename Slab<T>::D;
    using V = typename Slab<T>::V;
    static constexpr int room = 128;
    int y = 0;
    int begin = 0, past = 0; ///< columns; number x - begin belongs to column x
    HWY_ALIGN T seen[room];  ///< 1: may show; else 0
    HWY_ALIGN T share[room]; ///< where the point that is shaded lies, in slice distances behind slice n
    HWY_ALIGN T faded[room]; ///< what gradient opacity leaves
    HWY_ALIGN T against_x[room];
    HWY_ALIGN T against_y[room];
    HWY_ALIGN T against_z[room];
    HWY_ALIGN T alpha[room]; ///< of the slices as they are composited
    HWY_ALIGN T red[room];
    HWY_ALIGN T green[room];
    HWY_ALIGN T blue[room];
    HWY_ALIGN T weight[room]; ///< what the colours count among those of other groups
    HWY_ALIGN T doubt[room];  ///< of what is lit: how much an error of the gradient of 1 changes colours (Slab::doubt)

    [[nodiscard]] HWY_INLINE Normal<D> against(D d, int number) const {
        return {hn::Load(d, against_x + number), hn::Load(d, against_y + number), hn::Load(d, against_z + number)};
    }
    [[nodiscard]] HWY_INLINE Color<D> color(D d, int number) const {
        return {hn::Load(d, red + number), hn::Load(d, green + number), hn::Load(d, blue + number)};
    }
    HWY_INLINE void set_color(D d, int number, const Color<D>& color) {
        hn::Store(color.red, d, red + number);
        hn::Store(color.green, d, green + number);
        hn::Store(color.blue, d, blue + number);
    }
    HWY_INLINE void fill(T* numbers, T value) const {
        const D d;
        for (int number = 0; number < past - begin; number += Slab<T>::lanes) {
            hn::Store(hn::Set(d, value), d, numbers + number);
        }
    }

    /// Calls visit(column, number in the row, lanes) for vectors with any number above 0 in `wanted`, one of the
    /// arrays.
    template <class Visit>
    HWY_INLINE void for_each(const T* wanted, const Visit& visit) const {
        const D d;
        for (int x = begin; x < past; x += Slab<T>::lanes) {
            const auto there = hn::Gt(hn::Load(d, wanted + (x - begin)), hn::Zero(d));
            if (!hn::AllFalse(d, there)) {
                visit(x, x - begin, there);
            }
        }
    }

    /// Fills `seen` with what may(x) show and still changes, and `share`. Returns whether any point may show.
    template <class May>
    HWY_INLINE bool see_if(const Slab<T>& slab, T share_of_all, const May& may) {
        const D d;
        const V stop = hn::Set(d, slab.shading.stop), one = hn::Set(d, T(1));
        bool any = false;
        for (int x = begin; x < past; x += Slab<T>::lanes) {
            hn::Store(hn::Set(d, share_of_all), d, share + (x - begin));
            auto lanes = may(x);
            if (!hn::AllFalse(d, lanes)) {
                const V alpha_so_far = hn::LoadU(d, slab.picture.alpha + slab.in_plane(y) + x);
                lanes = slab.owned(d, slab.inside(d, hn::And(lanes, hn::Lt(alpha_so_far, stop)), x), y, x);
                any = any || !hn::AllFalse(d, lanes);
            }
            hn::Store(hn::IfThenElseZero(lanes, one), d, seen + (x - begin));
        }
        return any;
    }

    /// Fills `alpha` and the colours of what is seen by looks(x, number, lanes, colour), which returns opacities; of
    /// the rest they are 0. Returns whether any is above 0.
    template <class Looks>
    HWY_INLINE bool classify_by(const Looks& looks) {
        const D d;
        fill(alpha, T(0));
        bool any = false;
        for_each(seen, [&](int x, int number, auto lanes) {
            Color<D> found{hn::Zero(d), hn::Zero(d), hn::Zero(d)};
            const V opacity = looks(x, number, lanes, found);
            hn::Store(opacity, d, alpha + number);
            set_color(d, number, found);
            any = any || !hn::AllFalse(d, hn::Gt(opacity, hn::Zero(d)));
        });
        return any;
    }
};

/// More than any -ln(1 - alpha) that differs from infinity in 1 - alpha.
template <class T>
constexpr T all_absorbed = T(2) * MathOf<T>::all_gone;

/// Reference lengths between two slices along the rays of a vector of pixels.
template <bool perspective, class T, class D, class V = hn::Vec<D>>
HWY_INLINE V exponent_at(D d, const Slab<T>& slab, int x, int y) {
    const V exponent = hn::Set(d, slab.shading.exponent);
    if constexpr (perspective) {
        return hn::Mul(exponent, slab.ray(d, x, y).slant);
    } else {
        return exponent;
    }
}

/// Lanes between whose least and greatest value the transfer function shows something.
template <class T, class D, class V = hn::Vec<D>>
HWY_INLINE hn::Mask<D> may_show(D d, const Slab<T>& slab, V least, V greatest) {
    return hn::And(hn::Gt(greatest, hn::Set(d, slab.group.transfer.below)),
                   hn::Lt(least, hn::Set(d, slab.group.transfer.above)));
}

/// Lanes of `mask` with a point of slice n + ahead that is kept and that some kernel reaches.
template <class T, class D>
HWY_INLINE hn::Mask<D> point_open(D d, const Slab<T>& slab, hn::Mask<D> mask, int y, int x, int ahead,
                                  const Columns& kept) {
    return slab.reached(d, slab.kept(d, mask, ahead, y, x, kept), ahead, y, x);
}
template <class T, class D>
HWY_INLINE hn::Mask<D> any_end_open(D d, const Slab<T>& slab, hn::Mask<D> mask, int y, int x, const Columns& here,
                                    const Columns& after) {
    const hn::Mask<D> open = point_open(d, slab, mask, y, x, 0, here);
    return hn::Or(open, point_open(d, slab, hn::AndNot(open, mask), y, x, 1, after));
}

// What is classified. between: points lie between two slices. see() finds the points that may show; here and after are
// the columns that clipping keeps of slices n and n + 1.
// ---------------------------------------------------------------

/// Points of slice n.
template <class Table>
struct Slices {
    static constexpr bool between = false;
    static constexpr bool has_opacity = true;

    template <class T>
    static HWY_NOINLINE bool see(const Slab<T>& slab, EffectRow<T>& row, const Columns& here,
                                 const Columns& /*after*/) {
        const typename Slab<T>::D d;
        return row.see_if(slab, T(0), [&](int x) {
            const auto rho = slab.rho(d, 1, row.y, x);
            return point_open(d, slab, may_show(d, slab, rho, rho), row.y, x, 0, here);
        });
    }

    template <bool perspective, class T>
    static HWY_NOINLINE bool classify(const Slab<T>& slab, EffectRow<T>& row) {
        using V = typename Slab<T>::V;
        const typename Slab<T>::D d;
        const Table table(slab.group.transfer);
        return row.classify_by([&](int x, int number, auto seen, auto& color) {
            V alpha = opacity(d, slab, row, table, x, number, seen, color);
            if (slab.shading.correct) {
                alpha = corrected_opacity(d, alpha, exponent_at<perspective>(d, slab, x, row.y));
            }
            return alpha;
        });
    }

    /// Of several groups: fills `alpha` with -ln(1 - opacity) instead, and `weight` with tau (conventions, section 4).
    template <bool perspective, class T>
    static HWY_NOINLINE bool absorb(const Slab<T>& slab, EffectRow<T>& row) {
        using V = typename Slab<T>::V;
        const typename Slab<T>::D d;
        const Table table(slab.group.transfer);
        const V one = hn::Set(d, T(1)), most = hn::Set(d, T(1) - T(0x1p-24));
        return row.classify_by([&](int x, int number, auto seen, auto& color) {
            const V a = opacity(d, slab, row, table, x, number, seen, color);
            hn::Store(absorption(d, hn::Min(a, most)), d, row.weight + number);
            const auto clear = hn::Lt(a, one);
            const V thin =
                hn::Mul(exponent_at<perspective>(d, slab, x, row.y), absorption(d, hn::IfThenElseZero(clear, a)));
            return hn::IfThenElse(clear, thin, hn::Set(d, all_absorbed<T>));
        });
    }

  private:
    /// Opacity per reference length, faded; 0 where nothing is seen.
    template <class T, class D, class V = hn::Vec<D>>
    static HWY_INLINE V opacity(D d, const Slab<T>& slab, const EffectRow<T>& row, const Table& table, int x,
                                int number, hn::Mask<D> seen, Color<D>& color) {
        typename Table::Place place;
        const V own = hn::IfThenElseZero(seen, table.opacity(d, slab.rho(d, 1, row.y, x), place));
        color = table.color(d, place);
        return hn::Mul(own, hn::IfThenElseZero(seen, hn::Load(d, row.faded + number)));
    }
};

/// Intervals between slices n and n + 1, pre-integrated.
struct Intervals {
    static constexpr bool between = true;
    static constexpr bool has_opacity = true;

    template <class T>
    static HWY_NOINLINE bool see(const Slab<T>& slab, EffectRow<T>& row, const Columns& here, const Columns& after) {
        const typename Slab<T>::D d;
        return row.see_if(slab, T(0.5), [&](int x) {
            const auto front = slab.rho(d, 1, row.y, x), back = slab.rho(d, 2, row.y, x);
            return any_end_open(d, slab, may_show(d, slab, hn::Min(front, back), hn::Max(front, back)), row.y, x, here,
                                after);
        });
    }

    template <bool perspective, class T>
    static HWY_NOINLINE bool classify(const Slab<T>& slab, EffectRow<T>& row) {
        using V = typename Slab<T>::V;
        const typename Slab<T>::D d;
        return row.classify_by([&](int x, int number, auto seen, auto& color) {
            const V mean = absorption_between(d, slab, row, x, number, seen, color);
            return opacity_of_absorption(d, hn::Mul(exponent_at<perspective>(d, slab, x, row.y), mean));
        });
    }

    /// As Slices::absorb.
    template <bool perspective, class T>
    static HWY_NOINLINE bool absorb(const Slab<T>& slab, EffectRow<T>& row) {
        using V = typename Slab<T>::V;
        const typename Slab<T>::D d;
        return row.classify_by([&](int x, int number, auto seen, auto& color) {
            const V mean = absorption_between(d, slab, row, x, number, seen, color);
            hn::Store(mean, d, row.weight + number);
            return hn::Mul(exponent_at<perspective>(d, slab, x, row.y), mean);
        });
    }

  private:
    /// Mean absorption per reference length, faded.
    template <class T, class D, class V = hn::Vec<D>>
    static HWY_INLINE V absorption_between(D d, const Slab<T>& slab, const EffectRow<T>& row, int x, int number,
                                           hn::Mask<D> seen, Color<D>& color) {
        const V faded = hn::IfThenElseZero(seen, hn::Load(d, row.faded + number));
        return hn::Mul(
            ramp_absorption(d, slab.group.ramps, slab.rho(d, 1, row.y, x), slab.rho(d, 2, row.y, x), seen, color),
            faded);
    }
};

/// The same by Richardson's step from whole to half intervals.
struct SecondOrder {
    static constexpr bool between = true;
    static constexpr bool has_opacity = true;

    template <class T>
    static HWY_NOINLINE bool see(const Slab<T>& slab, EffectRow<T>& row, const Columns& here, const Columns& after) {
        const typename Slab<T>::D d;
        return row.see_if(slab, T(0.5), [&](int x) {
            const auto front = slab.rho(d, 1, row.y, x), back = slab.rho(d, 2, row.y, x);
            const auto between_them = middle(d, slab, front, back, row.y, x);
            return any_end_open(d, slab,
                                may_show(d, slab, hn::Min(between_them, hn::Min(front, back)),
                                         hn::Max(between_them, hn::Max(front, back))),
                                row.y, x, here, after);
        });
    }

    template <bool perspective, class T>
    static HWY_NOINLINE bool classify(const Slab<T>& slab, EffectRow<T>& row) {
        using V = typename Slab<T>::V;
        using C = Color<typename Slab<T>::D>;
        const typename Slab<T>::D d;
        const V zero = hn::Zero(d), one = hn::Set(d, T(1)), half = hn::Set(d, T(0.5));
        return row.classify_by([&](int x, int number, auto seen, auto& color) {
            const V front = slab.rho(d, 1, row.y, x), back = slab.rho(d, 2, row.y, x);
            const V between_them = middle(d, slab, front, back, row.y, x);
            const V faded = hn::IfThenElseZero(seen, hn::Load(d, row.faded + number));
            const V over_all = hn::Mul(exponent_at<perspective>(d, slab, x, row.y), faded);
            const V over_half = hn::Mul(over_all, half);
            const RampHalves<typename Slab<T>::D> ramps =
                ramp_halves(d, slab.group.ramps, front, between_them, back, seen);
            C whole, first, second;
            const auto opacity = [&](const auto& sum, V over, C& looks) {
                return opacity_of_absorption(d, hn::Mul(over, absorption_of(d, sum, looks)));
            };
            const V whole_alpha = opacity(ramps.whole, over_all, whole);
            const V first_alpha = opacity(ramps.front, over_half, first);
            const V second_alpha = hn::Mul(opacity(ramps.back, over_half, second), hn::Sub(one, first_alpha));
            const V four = hn::Set(d, T(4)), third = hn::Set(d, T(1) / T(3));
            const auto step = [&](V halves, V once) { return hn::Mul(hn::MulSub(four, halves, once), third); };
            const V alpha = hn::Min(step(hn::Add(first_alpha, second_alpha), whole_alpha), one);
            // Where next to nothing is left of the opacity, its inverse would leave the format.
            const auto some = hn::And(seen, hn::Gt(alpha, hn::Set(d, T(1e-30))));
            const V per_alpha = hn::Div(one, hn::IfThenElse(some, alpha, one));
            const auto channel = [&](V c, V c1, V c2) {
                const V halves = hn::MulAdd(first_alpha, c1, hn::Mul(second_alpha, c2));
                return hn::Mul(hn::Max(step(halves, hn::Mul(whole_alpha, c)), zero), per_alpha);
            };
            color = {channel(whole.red, first.red, second.red), channel(whole.green, first.green, second.green),
                     channel(whole.blue, first.blue, second.blue)};
            return hn::IfThenElseZero(some, alpha);
        });
    }

  private:
    /// rho in the middle of an interval: of the cubic through four slices.
    template <class T, class D, class V>
    static HWY_INLINE V middle(D d, const Slab<T>& slab, V front, V back, int y, int x) {
        const V outer = hn::Add(slab.rho(d, 0, y, x), slab.rho(d, 3, y, x));
        return hn::Mul(hn::MulSub(hn::Set(d, T(9)), hn::Add(front, back), outer), hn::Set(d, T(0.0625)));
    }
};

/// Crossings of the one isosurface, an opaque one, between slices n and n + 1.
struct Crossings {
    static constexpr bool between = true;
    static constexpr bool has_opacity = false;

    template <class T>
    static HWY_NOINLINE bool see(const Slab<T>& slab, EffectRow<T>& row, const Columns& here, const Columns& after) {
        const typename Slab<T>::D d;
        const auto iso = hn::Set(d, slab.group.surfaces.front().value);
        const bool any = row.see_if(slab, T(0), [&](int x) {
            const auto crossed = hn::Xor(hn::Lt(slab.rho(d, 1, row.y, x), iso), hn::Lt(slab.rho(d, 2, row.y, x), iso));
            return slab.kept(d, slab.kept(d, crossed, 0, row.y, x, here), 1, row.y, x, after);
        });
        row.for_each(row.seen, [&](int x, int number, auto found) {
            hn::Store(crossing(d, slab.rho(d, 1, row.y, x), slab.rho(d, 2, row.y, x), iso, found), d,
                      row.share + number);
        });
        return any;
    }

    template <bool perspective, class T>
    static HWY_NOINLINE bool classify(const Slab<T>& slab, EffectRow<T>& row) {
        const typename Slab<T>::D d;
        return row.classify_by([&](int, int, auto seen, auto& color) {
            color = iso_color(d, slab.group.surfaces.front());
            return hn::IfThenElseZero(seen, hn::Set(d, T(1)));
        });
    }
};

} // namespace sheetsplat::backend_cpu::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif // SHEETSPLAT_CPU_EFFECT_ROW_INL

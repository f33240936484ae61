// What is classified in a slab: points of a slice, intervals between two, or crossings of an isosurface. Of a vector of
// pixels each says which may show, where their points lie, and what their opacities and colours are. Source:
// conventions, sections 4 to 7; [EKE01] for intervals.

#if defined(SHEETSPLAT_CPU_CLASSIFIED_INL) == defined(HWY_TARGET_TOGGLE)
#ifdef SHEETSPLAT_CPU_CLASSIFIED_INL
#undef SHEETSPLAT_CPU_CLASSIFIED_INL
#else
#define SHEETSPLAT_CPU_CLASSIFIED_INL
#endif

#include <cstddef>
#include <type_traits>

#include "backend_cpu/shading.hpp"
#include "hwy/highway.h"
#include "light-inl.hpp"
#include "math-inl.hpp"
#include "ramp-inl.hpp"
#include "slab-inl.hpp"
#include "transfer-inl.hpp"

HWY_BEFORE_NAMESPACE();
namespace sheetsplat::backend_cpu::HWY_NAMESPACE {

/// More than any -ln(1 - alpha) that differs from infinity in 1 - alpha.
template <class T>
constexpr T all_absorbed = T(2) * MathOf<T>::all_gone;

// All have:
//   between         points lie between slices n and n + 1
//   has_opacity     else what is found is an opaque surface
//   may()           lanes that may show; here, after: the columns that clipping keeps of slices n and n + 1
//   share()         where the points of lanes lie, in slice distances behind slice n
//   opacity()       of the slab as it is composited, 0 outside of lanes `seen`; faded: what gradient opacity leaves of
//                   them, 0 outside
// and those that several groups mix
//   absorption()    -ln(1 - opacity) in place of it; weight: tau (conventions, section 4)
template <class T>
class Classified {
  public:
    using D = typename Slab<T>::D;
    using V = typename Slab<T>::V;
    using M = typename Slab<T>::M;
    using C = Color<D>;

    explicit Classified(const Slab<T>& slab) : slab_(slab) {}

  protected:
    [[nodiscard]] static HWY_INLINE V all(T value) { return hn::Set(D(), value); }
    /// rho of slice n + ahead.
    [[nodiscard]] HWY_INLINE V rho(int x, int y, int ahead = 0) const { return slab_.rho(D(), 1 + ahead, y, x); }

    /// Reference lengths between two slices along the rays.
    template <bool perspective>
    [[nodiscard]] HWY_INLINE V exponent(int x, int y) const {
        const V exponent = all(slab_.shading.exponent);
        if constexpr (perspective) {
            return hn::Mul(exponent, slab_.ray(D(), x, y).slant);
        } else {
            return exponent;
        }
    }
    /// Lanes between whose least and greatest value the transfer function shows something.
    [[nodiscard]] HWY_INLINE M shows(V least, V greatest) const {
        return hn::And(hn::Gt(greatest, all(slab_.group.transfer.below)),
                       hn::Lt(least, all(slab_.group.transfer.above)));
    }
    /// Lanes of `mask` with a point of slice n + ahead that is kept and that some kernel reaches.
    [[nodiscard]] HWY_INLINE M open(M mask, int x, int y, int ahead, const Columns& kept) const {
        const D d;
        // (Mostly nothing is there.)
        return hn::AllFalse(d, mask) ? mask : slab_.reached(d, slab_.kept(d, mask, ahead, y, x, kept), ahead, y, x);
    }
    [[nodiscard]] HWY_INLINE M either_open(M mask, int x, int y, const Columns& here, const Columns& after) const {
        const M first = open(mask, x, y, 0, here);
        return hn::Or(first, open(hn::AndNot(first, mask), x, y, 1, after));
    }

    const Slab<T>& slab_;
};

/// Points of slice n.
template <class T, class Table>
class Slices : public Classified<T> {
    using Base = Classified<T>;
    using typename Base::C;
    using typename Base::D;
    using typename Base::M;
    using typename Base::V;

  public:
    static constexpr bool between = false, has_opacity = true;

    explicit Slices(const Slab<T>& slab) : Base(slab), table_(slab.group.transfer) {}

    [[nodiscard]] HWY_INLINE M may(int x, int y, const Columns& here, const Columns& /*after*/) const {
        const V rho = this->rho(x, y);
        return this->open(this->shows(rho, rho), x, y, 0, here);
    }
    [[nodiscard]] HWY_INLINE V share(int /*x*/, int /*y*/, M /*seen*/) const { return hn::Zero(D()); }

    template <bool perspective>
    [[nodiscard]] HWY_INLINE V opacity(int x, int y, M /*seen*/, V faded, C& color) const {
        const V own = of_length(x, y, faded, color);
        return this->slab_.shading.correct ? corrected_opacity(D(), own, this->template exponent<perspective>(x, y))
                                           : own;
    }
    template <bool perspective>
    [[nodiscard]] HWY_INLINE V absorption(int x, int y, M /*seen*/, V faded, C& color, V& weight) const {
        const D d;
        const V a = of_length(x, y, faded, color);
        weight = HWY_NAMESPACE::absorption(d, hn::Min(a, this->all(T(1) - T(0x1p-24))));
        const M clear = hn::Lt(a, this->all(T(1)));
        const V thin = hn::Mul(this->template exponent<perspective>(x, y),
                               HWY_NAMESPACE::absorption(d, hn::IfThenElseZero(clear, a)));
        return hn::IfThenElse(clear, thin, this->all(all_absorbed<T>));
    }

  private:
    /// Opacity per reference length.
    [[nodiscard]] HWY_INLINE V of_length(int x, int y, V faded, C& color) const {
        const D d;
        typename Table::Place place;
        const V own = table_.opacity(d, this->rho(x, y), place);
        color = table_.color(d, place);
        return hn::Mul(own, faded);
    }

    const Table table_;
};

/// Intervals between slices n and n + 1, pre-integrated.
template <class T>
class Intervals : public Classified<T> {
    using Base = Classified<T>;
    using typename Base::C;
    using typename Base::D;
    using typename Base::M;
    using typename Base::V;

  public:
    static constexpr bool between = true, has_opacity = true;

    using Base::Base;

    [[nodiscard]] HWY_INLINE M may(int x, int y, const Columns& here, const Columns& after) const {
        const V front = this->rho(x, y), back = this->rho(x, y, 1);
        return this->either_open(this->shows(hn::Min(front, back), hn::Max(front, back)), x, y, here, after);
    }
    [[nodiscard]] HWY_INLINE V share(int /*x*/, int /*y*/, M /*seen*/) const { return this->all(T(0.5)); }

    template <bool perspective>
    [[nodiscard]] HWY_INLINE V opacity(int x, int y, M seen, V faded, C& color) const {
        V mean;
        return opacity_of_absorption(D(), absorption<perspective>(x, y, seen, faded, color, mean));
    }
    /// mean: per reference length.
    template <bool perspective>
    [[nodiscard]] HWY_INLINE V absorption(int x, int y, M seen, V faded, C& color, V& mean) const {
        const V own = ramp_absorption(D(), this->slab_.group.ramps, this->rho(x, y), this->rho(x, y, 1), seen, color);
        mean = hn::Mul(own, faded);
        return hn::Mul(this->template exponent<perspective>(x, y), mean);
    }
};

/// The same by Richardson's step from whole to half intervals.
template <class T>
class SecondOrder : public Classified<T> {
    using Base = Classified<T>;
    using typename Base::C;
    using typename Base::D;
    using typename Base::M;
    using typename Base::V;

  public:
    static constexpr bool between = true, has_opacity = true;

    using Base::Base;

    [[nodiscard]] HWY_INLINE M may(int x, int y, const Columns& here, const Columns& after) const {
        const V front = this->rho(x, y), back = this->rho(x, y, 1), middle = middle_of(front, back, x, y);
        return this->either_open(
            this->shows(hn::Min(middle, hn::Min(front, back)), hn::Max(middle, hn::Max(front, back))), x, y, here,
            after);
    }
    [[nodiscard]] HWY_INLINE V share(int /*x*/, int /*y*/, M /*seen*/) const { return this->all(T(0.5)); }

    template <bool perspective>
    [[nodiscard]] HWY_INLINE V opacity(int x, int y, M seen, V faded, C& color) const {
        const D d;
        const V zero = hn::Zero(d), one = this->all(T(1)), third = this->all(T(1) / T(3));
        const V front = this->rho(x, y), back = this->rho(x, y, 1);
        const V over_all = hn::Mul(this->template exponent<perspective>(x, y), faded);
        const V over_half = hn::Mul(over_all, this->all(T(0.5)));
        const RampHalves<D> ramps =
            ramp_halves(d, this->slab_.group.ramps, front, middle_of(front, back, x, y), back, seen);
        C whole, first, second;
        const auto opacity_of = [&](const auto& sum, V over, C& looks) {
            return opacity_of_absorption(d, hn::Mul(over, absorption_of(d, sum, looks)));
        };
        const V whole_alpha = opacity_of(ramps.whole, over_all, whole);
        const V first_alpha = opacity_of(ramps.front, over_half, first);
        const V second_alpha = hn::Mul(opacity_of(ramps.back, over_half, second), hn::Sub(one, first_alpha));
        const auto step = [&](V halves, V once) { return hn::Mul(hn::MulSub(this->all(T(4)), halves, once), third); };
        const V alpha = hn::Min(step(hn::Add(first_alpha, second_alpha), whole_alpha), one);
        // Where next to nothing is left of the opacity, its inverse would leave the format.
        const M some = hn::And(seen, hn::Gt(alpha, this->all(T(1e-30))));
        const V per_alpha = hn::Div(one, hn::IfThenElse(some, alpha, one));
        const auto channel = [&](V c, V c1, V c2) {
            const V halves = hn::MulAdd(first_alpha, c1, hn::Mul(second_alpha, c2));
            return hn::Mul(hn::Max(step(halves, hn::Mul(whole_alpha, c)), zero), per_alpha);
        };
        color = {channel(whole.red, first.red, second.red), channel(whole.green, first.green, second.green),
                 channel(whole.blue, first.blue, second.blue)};
        return hn::IfThenElseZero(some, alpha);
    }

  private:
    /// rho in the middle of an interval: of the cubic through four slices.
    [[nodiscard]] HWY_INLINE V middle_of(V front, V back, int x, int y) const {
        const V outer = hn::Add(this->rho(x, y, -1), this->rho(x, y, 2));
        return hn::Mul(hn::MulSub(this->all(T(9)), hn::Add(front, back), outer), this->all(T(0.0625)));
    }
};

/// Crossings of the one isosurface, an opaque one, between slices n and n + 1.
template <class T>
class Crossings : public Classified<T> {
    using Base = Classified<T>;
    using typename Base::C;
    using typename Base::D;
    using typename Base::M;
    using typename Base::V;

  public:
    static constexpr bool between = true, has_opacity = false;

    explicit Crossings(const Slab<T>& slab) : Base(slab), surface_(slab.group.surfaces.front()) {}

    [[nodiscard]] HWY_INLINE M may(int x, int y, const Columns& here, const Columns& after) const {
        const D d;
        const V iso = this->all(surface_.value);
        const M crossed = hn::Xor(hn::Lt(this->rho(x, y), iso), hn::Lt(this->rho(x, y, 1), iso));
        return hn::AllFalse(d, crossed)
                   ? crossed
                   : this->slab_.kept(d, this->slab_.kept(d, crossed, 0, y, x, here), 1, y, x, after);
    }
    [[nodiscard]] HWY_INLINE V share(int x, int y, M seen) const {
        return crossing(D(), this->rho(x, y), this->rho(x, y, 1), this->all(surface_.value), seen);
    }
    template <bool perspective>
    [[nodiscard]] HWY_INLINE V opacity(int /*x*/, int /*y*/, M seen, V /*faded*/, C& color) const {
        color = iso_color(D(), surface_);
        return hn::IfThenElseZero(seen, this->all(T(1)));
    }

  private:
    const ShadingSurface<T>& surface_;
};

/// Calls use(table) with the kind of table that the group's transfer function fits.
template <class T, class Use>
HWY_INLINE void with_table(const Slab<T>& slab, const Use& use) {
    using D = typename Slab<T>::D;
    if (slab.group.transfer.stretches <= Slab<T>::lanes) {
        use(TableInLanes<D>(slab.group.transfer));
    } else {
        use(TableInMemory<D>(slab.group.transfer));
    }
}

/// The same with use(Slices<...>(slab)).
template <class T, class Use>
HWY_INLINE void with_slices(const Slab<T>& slab, const Use& use) {
    with_table(slab, [&](const auto& table) { use(Slices<T, std::decay_t<decltype(table)>>(slab)); });
}

} // namespace sheetsplat::backend_cpu::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif // SHEETSPLAT_CPU_CLASSIFIED_INL

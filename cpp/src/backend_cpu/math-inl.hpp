// Vector functions that classification, shading and splatting need, for float and double and tags of any size.
// Errors are largest ones over the stated arguments, found by tests/cpp/backend_cpu/test_math.cpp against float64 and
// extended arithmetic; u is half a unit in the last place of 1 (6.0e-8, 1.1e-16). For such arguments no lane raises the
// floating-point exceptions invalid, overflow or division by zero.
// Polynomials: interpolation at Chebyshev nodes, error below u / 10 of the result; erf: least largest weighted error.

#if defined(SHEETSPLAT_CPU_MATH_INL) == defined(HWY_TARGET_TOGGLE)
#ifdef SHEETSPLAT_CPU_MATH_INL
#undef SHEETSPLAT_CPU_MATH_INL
#else
#define SHEETSPLAT_CPU_MATH_INL
#endif

#include <cstddef>
#include <cstdint>
#include <limits>
#include <type_traits>

#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace sheetsplat::backend_cpu::HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

/// What the functions know about a number format: polynomials (constant term first) and layout.
template <class T>
struct MathOf;

template <>
struct MathOf<float> {
    using Int = std::int32_t;
    static constexpr int fraction_bits = 23;
    static constexpr Int bias = 127;
    static constexpr Int root_half_bits = 0x3f3504f3; ///< sqrt(1/2)
    static constexpr float round_magic = 12582912.0F; ///< 1.5 2^23: adding it rounds to an integer, in the low bits
    static constexpr float least_exponent = -126.0F;  ///< 2^x is not subnormal from here on
    static constexpr float all_gone = 30.0F;          ///< exp(-x) does not show in 1 - exp(-x) any more
    static constexpr float ln2_high = 0.693359375F;
    static constexpr float ln2_low = -2.12194440e-4F;
    static constexpr float erf_end = 4.0F; ///< from here on erf is 1 within 1.6e-8
    /// (2^x - 1) / x, |x| <= 1/2
    static constexpr float exp2[] = {0.693147188F,    0.2402265076F,   0.05550357114F,
                                     0.009618082557F, 0.001339086336F, 0.0001545316295F};
    /// (exp(x) - 1 - x) / x^2, |x| <= ln(2) / 2
    static constexpr float expm1[] = {0.5F, 0.1666657699F, 0.04166655462F, 0.008363179053F, 0.001392618359F};
    /// (atanh(s) / s - 1) / s^2 in s^2, |s| <= 0.1716
    static constexpr float atanh[] = {0.3333334255F, 0.1999437886F, 0.1479049296F};
    /// -ln(erfc(x)) / x in x / 2 - 1, 0 <= x <= 4
    static constexpr float erf[] = {2.682471408F,   1.735676858F,     0.1116402297F,   -0.04635954992F,
                                    0.01816498203F, -0.001031679193F, 0.008421424115F, 0.004032187099F};
};

template <>
struct MathOf<double> {
    using Int = std::int64_t;
    static constexpr int fraction_bits = 52;
    static constexpr Int bias = 1023;
    static constexpr Int root_half_bits = 0x3fe6a09e667f3bcd;
    static constexpr double round_magic = 6755399441055744.0;
    static constexpr double least_exponent = -1022.0;
    static constexpr double all_gone = 60.0;
    static constexpr double ln2_high = 6.93147180369123816490e-01;
    static constexpr double ln2_low = 1.90821492927058770002e-10;
    static constexpr double erf_end = 6.0;
    static constexpr double exp2[] = {0.693147180559945309,   0.240226506959100982,   0.0555041086648215943,
                                      0.00961812910760688853, 0.00133335581464169353, 0.000154035304417360502,
                                      1.52527338298361184e-5, 1.32154425879216897e-6, 1.01780624458457735e-7,
                                      7.0725859492692237e-9,  4.45496059818651839e-10};
    static constexpr double expm1[] = {0.500000000000000102,   0.166666666666666675,   0.0416666666666241279,
                                       0.00833333333333006183, 0.00138888889172137169, 0.000198412698630536169,
                                       2.48015212959543751e-5, 2.75572684599970648e-6, 2.76200884454097482e-7,
                                       2.51003854955103191e-8};
    static constexpr double atanh[] = {0.333333333333333485, 0.199999999999494453, 0.142857143131269188,
                                       0.111111055446897481, 0.090914462162684356, 0.0766580586102750394,
                                       0.0730890357670866248};
    /// -ln(erfc(x)) / x in x / 3 - 1, 0 <= x <= 6
    static constexpr double erf[] = {3.57345434732779146,      2.73029934170256327,      0.141883314689045172,
                                     -0.0751762944832977395,   0.0386368589345269837,    -0.0187358451674272681,
                                     0.00826861642065441372,   -0.0030720398395606229,   0.000745132126798357342,
                                     0.0000738054499785657447, -0.000657891220418988372, 0.000101309251750490036,
                                     0.000629463999678105917,  0.00302405817850911497,   0.00316786112333852272,
                                     -0.000845557075737153412, -0.00730676366013096675,  -0.0102102517714379076,
                                     -0.00744018604877918077,  -0.00295735037826131269,  -0.000500410729926246033};
};

/// Horner's scheme, constant term first.
template <std::size_t first = 0, class D, class V, std::size_t n>
HWY_INLINE V polynomial(D d, V x, const hn::TFromD<D> (&c)[n]) {
    if constexpr (first + 1 == n) {
        return hn::Set(d, c[first]);
    } else {
        return hn::MulAdd(polynomial<first + 1>(d, x, c), x, hn::Set(d, c[first]));
    }
}

/// A number as integer + rest, |rest| <= 1/2, for |x| < 2^21.
template <class D, class V = hn::Vec<D>>
struct Rounded {
    V whole;
    hn::Vec<hn::RebindToSigned<D>> shifted; ///< the integer, where the exponent stands in a number
};

template <class D, class V = hn::Vec<D>>
HWY_INLINE Rounded<D> rounded(D d, V x) {
    using Math = MathOf<hn::TFromD<D>>;
    const V magic = hn::Set(d, Math::round_magic);
    const V moved = hn::Add(x, magic);
    return {hn::Sub(moved, magic), hn::ShiftLeft<Math::fraction_bits>(hn::BitCast(hn::RebindToSigned<D>(), moved))};
}

/// 2^x for x <= 0; 0 where x < -126 (double: -1022). Relative error 2 u.
template <class D, class V = hn::Vec<D>>
HWY_INLINE V exp2_nonpositive(D d, V x) {
    using Math = MathOf<hn::TFromD<D>>;
    const hn::RebindToSigned<D> di;
    const V least = hn::Set(d, Math::least_exponent);
    const V kept = hn::Max(x, least);
    const Rounded<D> n = rounded(d, kept);
    const V rest = hn::Sub(kept, n.whole);
    const V factor = hn::MulAdd(rest, polynomial(d, rest, Math::exp2), hn::Set(d, hn::TFromD<D>(1)));
    const V power = hn::BitCast(d, hn::Add(hn::BitCast(di, factor), n.shifted));
    return hn::IfThenElseZero(hn::Ge(x, least), power);
}

/// 1 - exp(-x) for x >= 0, with all digits for x -> 0. Relative error 4 u.
template <class D, class V = hn::Vec<D>>
HWY_INLINE V opacity_of_absorption(D d, V x) {
    using T = hn::TFromD<D>;
    using Math = MathOf<T>;
    const hn::RebindToSigned<D> di;
    const V kept = hn::Neg(hn::Min(x, hn::Set(d, Math::all_gone)));
    const Rounded<D> n = rounded(d, hn::Mul(kept, hn::Set(d, T(1.4426950408889634))));
    const V rest =
        hn::NegMulAdd(n.whole, hn::Set(d, Math::ln2_low), hn::NegMulAdd(n.whole, hn::Set(d, Math::ln2_high), kept));
    const V beyond_one = hn::MulAdd(hn::Mul(rest, rest), polynomial(d, rest, Math::expm1), rest);
    const V one = hn::Set(d, T(1));
    const V power = hn::BitCast(d, hn::Add(hn::BitCast(di, one), n.shifted));
    // Where the power is 1 the difference is exactly 0 and all digits are those of the second term.
    return hn::NegMulAdd(power, beyond_one, hn::Sub(one, power));
}

/// ln(x + rest) for normal x > 0 and |rest| <= u, rest = 0 where x < 1/2. Relative error 4 u, near x = 1 too.
template <class D, class V = hn::Vec<D>>
HWY_INLINE V ln_with_rest(D d, V x, V rest) {
    using T = hn::TFromD<D>;
    using Math = MathOf<T>;
    const hn::RebindToSigned<D> di;
    const auto bits = hn::BitCast(di, x);
    const auto exponent = hn::ShiftRight<Math::fraction_bits>(hn::Sub(bits, hn::Set(di, Math::root_half_bits)));
    const V scaled = hn::BitCast(d, hn::Sub(bits, hn::ShiftLeft<Math::fraction_bits>(exponent)));
    // An integer below 2^22 in the low bits of the magic number: no conversion, which double lacks before AVX-512.
    const V magic = hn::Set(d, Math::round_magic);
    const V n = hn::Sub(hn::BitCast(d, hn::Add(hn::BitCast(di, magic), exponent)), magic);
    const V f = hn::Add(hn::Sub(scaled, hn::Set(d, T(1))), rest);
    const V s = hn::Div(f, hn::Add(f, hn::Set(d, T(2))));
    const V z = hn::Mul(s, s);
    const V twice = hn::Add(s, s);
    const V of_rest = hn::MulAdd(hn::Mul(twice, z), polynomial(d, z, Math::atanh), twice);
    return hn::MulAdd(n, hn::Set(d, Math::ln2_high), hn::MulAdd(n, hn::Set(d, Math::ln2_low), of_rest));
}

/// Natural logarithm of normal x > 0. Relative error 4 u, near x = 1 too.
template <class D, class V = hn::Vec<D>>
HWY_INLINE V ln(D d, V x) {
    return ln_with_rest(d, x, hn::Zero(d));
}

/// -ln(1 - a) for 0 <= a < 1, with all digits for a -> 0. Relative error 4 u.
template <class D, class V = hn::Vec<D>>
HWY_INLINE V absorption(D d, V a) {
    const V one = hn::Set(d, hn::TFromD<D>(1));
    const V left = hn::Sub(one, a);
    // What rounding took from 1 - a; exact, as both differences are.
    const V lost = hn::Sub(hn::Sub(one, left), a);
    return hn::Neg(ln_with_rest(d, left, lost));
}

/// base^exponent for 0 <= base <= 1 and 0 < exponent <= 10^30; 0 where base = 0. Relative error 4 u (2 + |ln result|).
template <class D, class V = hn::Vec<D>>
HWY_INLINE V pow_below_one(D d, V base, V exponent) {
    using T = hn::TFromD<D>;
    const V least = hn::Set(d, std::numeric_limits<T>::min());
    const V log2 = hn::Mul(ln(d, hn::Max(base, least)), hn::Set(d, T(1.4426950408889634)));
    return hn::IfThenElseZero(hn::Gt(base, hn::Zero(d)),
                              exp2_nonpositive(d, hn::Min(hn::Mul(exponent, log2), hn::Zero(d))));
}

/// erf(x) for any finite x. Absolute error 1.2e-7 (double: 4e-16); relative error 1.5e-6 (double: 1.5e-14), for x -> 0
/// too.
template <class D, class V = hn::Vec<D>>
HWY_INLINE V erf(D d, V x) {
    using T = hn::TFromD<D>;
    using Math = MathOf<T>;
    const V size = hn::Min(hn::Abs(x), hn::Set(d, Math::erf_end));
    const V place = hn::MulAdd(size, hn::Set(d, T(2) / Math::erf_end), hn::Set(d, T(-1)));
    return hn::CopySign(opacity_of_absorption(d, hn::Mul(size, polynomial(d, place, Math::erf))), x);
}

} // namespace sheetsplat::backend_cpu::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif // SHEETSPLAT_CPU_MATH_INL

// Vector functions against extended arithmetic: the errors that their comments state, for every instruction set that
// was compiled and runs here and for vectors of every size, with floating-point traps on.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "backend_cpu/test_math.cpp"
#include "hwy/foreach_target.h"

#include "math-inl.hpp"

#ifndef SHEETSPLAT_TEST_MATH_CALLS
#define SHEETSPLAT_TEST_MATH_CALLS
namespace sheetsplat::backend_cpu {

/// Arrays of `padded` numbers in and out, a multiple of 16.
template <class T>
struct MathCalls {
    void (*exp2_nonpositive)(const T*, T*);
    void (*opacity_of_absorption)(const T*, T*);
    void (*ln)(const T*, T*);
    void (*absorption)(const T*, T*);
    void (*erf)(const T*, T*);
    void (*pow_below_one)(const T*, const T*, T*);
};
constexpr int most_lanes = 16;

} // namespace sheetsplat::backend_cpu
#endif

HWY_BEFORE_NAMESPACE();
namespace sheetsplat::backend_cpu::HWY_NAMESPACE {
namespace {

template <class D, class T, class F>
void over_vectors(D d, const T* x, T* y, F f) {
    for (int k = 0; k < most_lanes; k += static_cast<int>(hn::Lanes(d))) {
        hn::StoreU(f(d, hn::LoadU(d, x + k)), d, y + k);
    }
}

#define SHEETSPLAT_ONE_ARGUMENT(name)                                                                                  \
    [](const T* x, T* y) { over_vectors(D(), x, y, [](auto d, auto v) { return name(d, v); }); }

template <class D, class T = hn::TFromD<D>>
MathCalls<T> calls_of() {
    return {SHEETSPLAT_ONE_ARGUMENT(exp2_nonpositive),
            SHEETSPLAT_ONE_ARGUMENT(opacity_of_absorption),
            SHEETSPLAT_ONE_ARGUMENT(ln),
            SHEETSPLAT_ONE_ARGUMENT(absorption),
            SHEETSPLAT_ONE_ARGUMENT(erf),
            [](const T* x, const T* e, T* y) {
                const D d;
                for (int k = 0; k < most_lanes; k += static_cast<int>(hn::Lanes(d))) {
                    hn::StoreU(pow_below_one(d, hn::LoadU(d, x + k), hn::LoadU(d, e + k)), d, y + k);
                }
            }};
}

/// For vectors of 2, 4, 8 and 16 lanes at most.
template <class T>
MathCalls<T> calls(int width) {
    return width == 0   ? calls_of<hn::CappedTag<T, 2>>()
           : width == 1 ? calls_of<hn::CappedTag<T, 4>>()
           : width == 2 ? calls_of<hn::CappedTag<T, 8>>()
                        : calls_of<hn::CappedTag<T, 16>>();
}
MathCalls<float> calls_float(int width) { return calls<float>(width); }
MathCalls<double> calls_double(int width) { return calls<double>(width); }

} // namespace
} // namespace sheetsplat::backend_cpu::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE

#include <cfenv>
#include <cmath>
#include <functional>
#include <random>
#include <vector>

#include <gtest/gtest.h>

#include "support/traps.hpp"

namespace sheetsplat::backend_cpu {
namespace {

using test::Traps;

template <class T>
struct Variant {
    const char* name;
    MathCalls<T> calls;
};

#define SHEETSPLAT_VARIANT(target)                                                                                     \
    for (int width = 0; width < 4; ++width) {                                                                          \
        if constexpr (sizeof(T) == 4) {                                                                                \
            found.push_back({#target, target::calls_float(width)});                                                    \
        } else {                                                                                                       \
            found.push_back({#target, target::calls_double(width)});                                                   \
        }                                                                                                              \
    }

template <class T>
std::vector<Variant<T>> variants() {
    std::vector<Variant<T>> found;
#if HWY_TARGETS & HWY_SCALAR
    SHEETSPLAT_VARIANT(N_SCALAR)
#endif
#if HWY_TARGETS & HWY_EMU128
    SHEETSPLAT_VARIANT(N_EMU128)
#endif
#if HWY_TARGETS & HWY_NEON
    SHEETSPLAT_VARIANT(N_NEON)
#endif
#if HWY_TARGETS & HWY_SSE4
    if (__builtin_cpu_supports("sse4.2") && __builtin_cpu_supports("pclmul")) {
        SHEETSPLAT_VARIANT(N_SSE4)
    }
#endif
#if HWY_TARGETS & HWY_AVX2
    if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma") && __builtin_cpu_supports("bmi2")) {
        SHEETSPLAT_VARIANT(N_AVX2)
    }
#endif
#if HWY_TARGETS & HWY_AVX3
    if (__builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512bw") && __builtin_cpu_supports("avx512dq") &&
        __builtin_cpu_supports("avx512vl")) {
        SHEETSPLAT_VARIANT(N_AVX3)
    }
#endif
    return found;
}

using Exact = long double;

class Random {
  public:
    double uniform(double low, double high) { return std::uniform_real_distribution<double>(low, high)(engine_); }
    /// Between e^low and e^high.
    double magnitude(double low, double high) { return std::exp(uniform(low, high)); }
    bool coin() { return uniform(0.0, 1.0) < 0.5; }

  private:
    std::mt19937_64 engine_{3};
};

template <class T>
constexpr T least_exponent = static_cast<T>(std::numeric_limits<T>::min_exponent - 1);
template <class T>
constexpr double unit = static_cast<double>(std::numeric_limits<T>::epsilon()) / 2.0;

/// Largest of what `error` makes of (argument, result), over all variants; `draw` makes arguments.
template <class T>
double largest_error(void (*MathCalls<T>::*function)(const T*, T*), const std::function<double(Random&)>& draw,
                     const std::function<double(T, T)>& error) {
    double largest = 0.0;
    for (const Variant<T>& variant : variants<T>()) {
        Random random;
        for (int k = 0; k < 3000; ++k) {
            T x[most_lanes], y[most_lanes];
            for (T& value : x) {
                value = static_cast<T>(draw(random));
            }
            {
                const Traps traps;
                (variant.calls.*function)(x, y);
            }
            for (int lane = 0; lane < most_lanes; ++lane) {
                const double e = error(x[lane], y[lane]);
                EXPECT_FALSE(std::isnan(e)) << variant.name << " at " << x[lane];
                largest = std::max(largest, e);
            }
        }
    }
    return largest;
}

double relative(Exact found, Exact wanted) {
    return static_cast<double>(wanted == 0 ? std::abs(found) : std::abs((found - wanted) / wanted));
}

template <class T>
class VectorMath : public testing::Test {};
using Formats = testing::Types<float, double>;
TYPED_TEST_SUITE(VectorMath, Formats);

TYPED_TEST(VectorMath, exp2_nonpositive) {
    using T = TypeParam;
    const double end = least_exponent<T>;
    const auto draw = [end](Random& random) {
        return random.coin() ? random.uniform(end, 0.0) : -random.magnitude(-80.0, std::log(-end));
    };
    const double error = largest_error<T>(&MathCalls<T>::exp2_nonpositive, draw, [](T x, T y) {
        return relative(y, x < least_exponent<T> ? Exact(0) : std::exp2(Exact(x)));
    });
    EXPECT_LE(error, 2.0 * unit<T>);
    EXPECT_GE(error, 0.5 * unit<T>) << "better than the format can be";
    // An error of the stated size on top would be noticed.
    const double wrong = largest_error<T>(&MathCalls<T>::exp2_nonpositive, draw, [](T x, T y) {
        return relative(y, x < least_exponent<T> ? Exact(0) : std::exp2(Exact(x)) * (1 + 2 * unit<T>));
    });
    EXPECT_GT(wrong, 2.0 * unit<T>);
}

TYPED_TEST(VectorMath, exp2_is_0_below_the_range_and_1_at_0) {
    using T = TypeParam;
    const double largest = static_cast<double>(std::numeric_limits<T>::max());
    for (const Variant<T>& variant : variants<T>()) {
        T x[most_lanes], y[most_lanes];
        for (int k = 0; k < most_lanes; ++k) {
            x[k] = k == 0   ? T(0)
                   : k == 1 ? -std::numeric_limits<T>::infinity()
                   : k == 2 ? static_cast<T>(-largest)
                   : k == 3 ? static_cast<T>(least_exponent<T> * 1.01)
                   : k == 4 ? least_exponent<T>
                            : static_cast<T>(-k);
        }
        {
            const Traps traps;
            variant.calls.exp2_nonpositive(x, y);
        }
        EXPECT_EQ(y[0], T(1));
        EXPECT_EQ(y[1], T(0));
        EXPECT_EQ(y[2], T(0));
        EXPECT_EQ(y[3], T(0));
        EXPECT_EQ(y[4], std::numeric_limits<T>::min());
        EXPECT_EQ(y[7], std::ldexp(T(1), -7));
    }
}

TYPED_TEST(VectorMath, opacity_of_absorption) {
    using T = TypeParam;
    const auto error = largest_error<T>(
        &MathCalls<T>::opacity_of_absorption,
        [](Random& random) { return random.coin() ? random.uniform(0.0, 50.0) : random.magnitude(-60.0, 75.0); },
        [](T x, T y) { return relative(y, -std::expm1(-Exact(x))); });
    EXPECT_LE(error, 4.0 * unit<T>);
    EXPECT_GE(error, 0.5 * unit<T>);
}

TYPED_TEST(VectorMath, ln) {
    using T = TypeParam;
    const auto error = largest_error<T>(
        &MathCalls<T>::ln,
        [](Random& random) {
            return random.coin() ? random.magnitude(-80.0, 80.0)
                                 : 1.0 + random.uniform(-0.4, 0.6) * random.magnitude(-30.0, 0.0);
        },
        [](T x, T y) { return relative(y, std::log(Exact(x))); });
    EXPECT_LE(error, 4.0 * unit<T>);
    EXPECT_GE(error, 0.5 * unit<T>);
}

TYPED_TEST(VectorMath, absorption) {
    using T = TypeParam;
    const double most = 1.0 - static_cast<double>(std::numeric_limits<T>::epsilon()) / 2.0;
    const auto draw = [most](Random& random) {
        return std::min(most, random.coin() ? random.magnitude(-80.0, 0.0) : 1.0 - random.magnitude(-30.0, 0.0));
    };
    const auto error =
        largest_error<T>(&MathCalls<T>::absorption, draw, [](T x, T y) { return relative(y, -std::log1p(-Exact(x))); });
    EXPECT_LE(error, 4.0 * unit<T>);
    EXPECT_GE(error, 0.5 * unit<T>);
    // What would be left without the digits of a that 1 - a loses.
    const auto careless = largest_error<T>(&MathCalls<T>::absorption, draw,
                                           [](T x, T y) { return relative(y, -std::log(Exact(T(1) - x))); });
    EXPECT_GT(careless, 1e-3);
}

TYPED_TEST(VectorMath, erf) {
    using T = TypeParam;
    const auto draw = [](Random& random) {
        return random.coin() ? random.uniform(-7.0, 7.0) : random.uniform(-1.0, 1.0) * random.magnitude(-60.0, 60.0);
    };
    const bool single = sizeof(T) == 4;
    const auto error = largest_error<T>(&MathCalls<T>::erf, draw, [](T x, T y) {
        return static_cast<double>(std::abs(Exact(y) - std::erf(Exact(x))));
    });
    EXPECT_LE(error, single ? 1.2e-7 : 4e-16);
    EXPECT_GE(error, 0.5 * unit<T>);
    const auto of_value =
        largest_error<T>(&MathCalls<T>::erf, draw, [](T x, T y) { return relative(y, std::erf(Exact(x))); });
    EXPECT_LE(of_value, single ? 1.5e-6 : 1.5e-14);
}

TYPED_TEST(VectorMath, pow_below_one) {
    using T = TypeParam;
    double largest = 0.0;
    for (const Variant<T>& variant : variants<T>()) {
        Random random;
        for (int k = 0; k < 3000; ++k) {
            T x[most_lanes], e[most_lanes], y[most_lanes];
            for (int lane = 0; lane < most_lanes; ++lane) {
                x[lane] = static_cast<T>(lane == 0 ? 0.0 : lane == 1 ? 1.0 : random.uniform(0.0, 1.0));
                e[lane] = static_cast<T>(lane == 2 ? 1e30 : random.magnitude(-4.0, 6.0));
            }
            {
                const Traps traps;
                variant.calls.pow_below_one(x, e, y);
            }
            EXPECT_EQ(y[0], T(0));
            EXPECT_EQ(y[1], T(1));
            EXPECT_EQ(y[2], T(0));
            for (int lane = 3; lane < most_lanes; ++lane) {
                const Exact wanted = std::pow(Exact(x[lane]), Exact(e[lane]));
                if (wanted > 1e-30L) {
                    largest = std::max(largest, relative(y[lane], wanted) /
                                                    (2.0 + static_cast<double>(std::abs(std::log(wanted)))));
                }
            }
        }
    }
    EXPECT_LE(largest, 4.0 * unit<T>);
    EXPECT_GE(largest, 0.5 * unit<T>);
}

} // namespace
} // namespace sheetsplat::backend_cpu

#endif // HWY_ONCE

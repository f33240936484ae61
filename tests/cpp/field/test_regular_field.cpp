#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <ctime>
#include <limits>
#include <string>
#include <vector>

#include "sheetsplat/error.hpp"
#include "sheetsplat/field.hpp"
#include "support.hpp"
#include "support/lattices.hpp"

namespace sheetsplat {
namespace {

using test::expect_parts;
using test::message_of;

constexpr double infinity = std::numeric_limits<double>::infinity();
constexpr double nan = std::numeric_limits<double>::quiet_NaN();

template <class T>
std::vector<T> counted(std::size_t count) {
    std::vector<T> samples(count);
    for (std::size_t n = 0; n < count; ++n) {
        samples[n] = static_cast<T>(n);
    }
    return samples;
}

std::string refused(SampleArray samples, std::array<std::size_t, 3> shape,
                    const RegularFieldOptions& options = test::zero_boundary()) {
    return message_of<InvalidInput>([&] { const RegularField field(std::move(samples), shape, options); });
}

std::string refused_options(const RegularFieldOptions& options) {
    return refused(counted<float>(24), {2, 3, 4}, options);
}

void expect_box(const Box& box, const Vec3& lower, const Vec3& upper) {
    for (int axis = 0; axis < 3; ++axis) {
        EXPECT_DOUBLE_EQ(box.lower[axis], lower[axis]) << axis;
        EXPECT_DOUBLE_EQ(box.upper[axis], upper[axis]) << axis;
    }
}

/// The box of the kernels' centres by position() alone.
Box box_by_positions(const RegularField& field) {
    Box box;
    const auto [nk, nj, ni] = field.shape();
    for (std::size_t k = 0; k < nk; ++k) {
        for (std::size_t j = 0; j < nj; ++j) {
            for (std::size_t i = 0; i < ni; ++i) {
                if (std::isnan(field.value(i, j, k))) {
                    continue;
                }
                const Vec3 p = field.position(i, j, k);
                if (box.empty()) {
                    box = {p, p};
                }
                for (int axis = 0; axis < 3; ++axis) {
                    box.lower[axis] = std::min(box.lower[axis], p[axis]);
                    box.upper[axis] = std::max(box.upper[axis], p[axis]);
                }
            }
        }
    }
    return box;
}

TEST(RegularField, is_indexed_k_j_i_with_i_fastest) {
    RegularFieldOptions options = test::zero_boundary();
    options.spacing = {0.5, 2.0, 3.0};
    options.origin = {10.0, 20.0, 30.0};
    const RegularField field(counted<std::int16_t>(24), {2, 3, 4}, options);
    EXPECT_EQ(field.size(), 24U);
    EXPECT_EQ(field.value(3, 0, 0), 3.0);
    EXPECT_EQ(field.value(0, 1, 0), 4.0);
    EXPECT_EQ(field.value(1, 2, 1), 21.0);
    EXPECT_EQ(field.position(1, 2, 1), Vec3(10.5, 24.0, 33.0));
    expect_box(field.centres_world(), {10.0, 20.0, 30.0}, {11.5, 24.0, 33.0});
    EXPECT_EQ(field.value_range(), (std::array<double, 2>{0.0, 23.0}));
    EXPECT_EQ(field.default_slice_spacing(), 0.5);
    EXPECT_EQ(field.kernel_axes().lengths, Vec3(1.0, 4.0, 6.0));
    expect_box(field.supports_world(), {9.0, 16.0, 24.0}, {12.5, 28.0, 39.0});
    EXPECT_FALSE(field.has_holes());
    EXPECT_EQ(field.kernel().falloff, 5.0);
    EXPECT_GE(field.memory(), 24 * sizeof(std::int16_t) + sizeof(RegularField));
    EXPECT_LE(field.memory(), 24 * sizeof(std::int16_t) + sizeof(RegularField) + 64);
}

TEST(RegularField, bcc_is_two_interleaved_cubic_lattices) {
    RegularFieldOptions options = test::zero_boundary();
    options.lattice = Lattice::bcc;
    options.spacing = {2.0, 77.0, -5.0}; // only the first counts
    options.origin = {1.0, 2.0, 3.0};
    const RegularField field(counted<float>(24), {4, 2, 3}, options);
    EXPECT_EQ(field.position(0, 0, 0), Vec3(1.0, 2.0, 3.0));
    EXPECT_EQ(field.position(2, 1, 0), Vec3(5.0, 4.0, 3.0));
    EXPECT_EQ(field.position(0, 0, 1), Vec3(2.0, 3.0, 4.0));
    EXPECT_EQ(field.position(2, 1, 3), Vec3(6.0, 5.0, 6.0));
    expect_box(field.centres_world(), {1.0, 2.0, 3.0}, {6.0, 5.0, 6.0});
    EXPECT_EQ(field.default_slice_spacing(), 1.0);
    // Every sample's nearest neighbours are a sqrt(3)/2 away; the sample distance is a / sqrt 2 all the same.
    EXPECT_DOUBLE_EQ(field.kernel_axes().lengths.x, 2.0 * 2.0 / std::sqrt(2.0));
    EXPECT_EQ(field.kernel_axes().lengths.x, field.kernel_axes().lengths.z);
}

TEST(RegularField, one_layer_of_bcc_has_no_half_steps) {
    RegularFieldOptions options = test::zero_boundary();
    options.lattice = Lattice::bcc;
    const RegularField field(counted<float>(6), {1, 2, 3}, options);
    expect_box(field.centres_world(), {0.0, 0.0, 0.0}, {2.0, 1.0, 0.0});
}

TEST(RegularField, lattice_constant_is_the_mass_over_the_volume_of_a_sample) {
    RegularFieldOptions options = test::zero_boundary();
    options.spacing = {0.5, 2.0, 3.0};
    options.radius = 2.5;
    options.falloff = 7.0;
    const RegularField cartesian(counted<float>(8), {2, 2, 2}, options);
    const Vec3 axes = cartesian.kernel_axes().lengths;
    EXPECT_DOUBLE_EQ(cartesian.lattice_constant(),
                     Kernel{7.0}.unit_mass() * axes.x * axes.y * axes.z / (0.5 * 2.0 * 3.0));
    options.lattice = Lattice::bcc;
    const RegularField bcc(counted<float>(8), {2, 2, 2}, options);
    EXPECT_DOUBLE_EQ(bcc.lattice_constant(),
                     Kernel{7.0}.unit_mass() * std::pow(bcc.kernel_axes().lengths.x, 3.0) / (std::pow(0.5, 3.0) / 2.0));
}

/// W / C at a point in the middle of a field of ones.
double partition_of_unity(const RegularField& field, const Vec3& offset) {
    const auto [nk, nj, ni] = field.shape();
    const Vec3 x = field.position(ni / 2, nj / 2, nk / 2) + offset;
    const Kernel kernel = field.kernel();
    double sum = 0.0;
    for (std::size_t k = 0; k < nk; ++k) {
        for (std::size_t j = 0; j < nj; ++j) {
            for (std::size_t i = 0; i < ni; ++i) {
                const Vec3 q = (x - field.position(i, j, k)) / field.kernel_axes().lengths;
                const double r2 = q.x * q.x + q.y * q.y + q.z * q.z;
                sum += r2 < 1.0 ? (std::exp(-kernel.falloff * r2) - kernel.edge()) * kernel.gain() : 0.0;
            }
        }
    }
    return sum / field.lattice_constant();
}

TEST(RegularField, kernels_of_ones_sum_to_one_within_the_known_ripple) {
    for (const Lattice lattice : {Lattice::cartesian, Lattice::bcc}) {
        RegularFieldOptions options = test::zero_boundary();
        options.lattice = lattice;
        options.spacing = {0.5, 0.7, 1.1};
        const RegularField field(std::vector<std::uint8_t>(12 * 12 * 12, 1), {12, 12, 12}, options);
        double worst = 0.0;
        for (int n = 0; n < 64; ++n) {
            const Vec3 step = lattice == Lattice::bcc ? Vec3(0.5) : options.spacing;
            worst = std::max(worst,
                             std::abs(partition_of_unity(field, Vec3(n % 4, n / 4 % 4, n / 16) * 0.25 * step) - 1.0));
        }
        EXPECT_LE(worst, 0.008);
        EXPECT_GT(worst, 1e-6);
    }
    // Negative control: with the narrower kernel the same sum ripples beyond that.
    RegularFieldOptions narrow = test::zero_boundary();
    narrow.falloff = 8.0;
    const RegularField field(std::vector<std::uint8_t>(12 * 12 * 12, 1), {12, 12, 12}, narrow);
    EXPECT_GT(std::abs(partition_of_unity(field, Vec3(0.0)) - 1.0), 0.008);
}

template <class T>
class Samples : public testing::Test {};
using SampleTypes = testing::Types<std::uint8_t, std::int16_t, std::uint16_t, float, double>;
TYPED_TEST_SUITE(Samples, SampleTypes);

TYPED_TEST(Samples, range_is_found_at_every_place) {
    // Lengths around the width of vector code, with the extremes at the ends and in the middle.
    for (const std::size_t count : {1U, 2U, 7U, 15U, 16U, 17U, 33U, 127U, 128U, 131U}) {
        for (const std::size_t place : {std::size_t{0}, count / 2, count - 1}) {
            std::vector<TypeParam> samples(count, TypeParam{7});
            samples[place] = TypeParam{3};
            EXPECT_EQ(RegularField(samples, {1, 1, count}, test::zero_boundary()).value_range()[0], 3.0)
                << count << " " << place;
            samples[place] = TypeParam{99};
            EXPECT_EQ(RegularField(samples, {count, 1, 1}, test::zero_boundary()).value_range()[1], 99.0)
                << count << " " << place;
        }
    }
}

TYPED_TEST(Samples, extremes_of_the_type) {
    const auto low = std::numeric_limits<TypeParam>::lowest();
    const auto high = std::numeric_limits<TypeParam>::max();
    if constexpr (std::is_same_v<TypeParam, double>) {
        expect_parts(refused(std::vector<double>{low, high}, {1, 1, 2}), {"1.7976931348623157e+308", "1e+300"});
    } else {
        const RegularField field(std::vector<TypeParam>{high, low}, {1, 1, 2}, test::zero_boundary());
        EXPECT_EQ(field.value_range(), (std::array<double, 2>{static_cast<double>(low), static_cast<double>(high)}));
    }
}

TYPED_TEST(Samples, a_constant_field_is_a_field) {
    const RegularField field(std::vector<TypeParam>(27, TypeParam{5}), {3, 3, 3}, test::zero_boundary());
    EXPECT_EQ(field.value_range(), (std::array<double, 2>{5.0, 5.0}));
}

template <class T>
class OddSamples : public testing::Test {};
using FloatTypes = testing::Types<float, double>;
TYPED_TEST_SUITE(OddSamples, FloatTypes);

TYPED_TEST(OddSamples, are_refused_with_their_index) {
    for (const double odd : {nan, infinity, -infinity}) {
        // Sample (i, j, k) = (3, 0, 7), (1, 4, 2) and the very last.
        for (const auto& [i, j, k] : {std::array<std::size_t, 3>{3, 0, 7}, {1, 4, 2}, {5, 4, 8}}) {
            std::vector<TypeParam> samples = counted<TypeParam>(9 * 5 * 6);
            samples[(k * 5 + j) * 6 + i] = static_cast<TypeParam>(odd);
            const std::string text = refused(samples, {9, 5, 6});
            expect_parts(text, {"RegularField: the samples cannot be used",
                                std::isnan(odd) ? "found NaN at sample"
                                : odd > 0.0     ? "found infinity at sample"
                                                : "found -infinity",
                                "[" + std::to_string(k) + ", " + std::to_string(j) + ", " + std::to_string(i) + "]",
                                "wanted finite numbers"});
            EXPECT_EQ(text.find("pass nan = skip to leave such samples out") != std::string::npos, std::isnan(odd))
                << text;
        }
    }
}

TYPED_TEST(OddSamples, nan_is_no_kernel_where_skipped) {
    RegularFieldOptions options = test::zero_boundary();
    options.nan = NanPolicy::skip;
    options.spacing = {1.0, 2.0, 4.0};
    const auto none = std::numeric_limits<TypeParam>::quiet_NaN();
    std::vector<TypeParam> samples(3 * 4 * 5, none);
    const auto at = [&](std::size_t i, std::size_t j, std::size_t k) -> TypeParam& {
        return samples[(k * 4 + j) * 5 + i];
    };
    at(3, 1, 1) = TypeParam{-7};
    at(1, 2, 1) = TypeParam{11};
    at(2, 2, 2) = TypeParam{4};
    const RegularField field(samples, {3, 4, 5}, options);
    EXPECT_EQ(field.size(), 3U);
    EXPECT_TRUE(field.has_holes());
    EXPECT_EQ(field.value_range(), (std::array<double, 2>{-7.0, 11.0}));
    expect_box(field.centres_world(), {1.0, 2.0, 4.0}, {3.0, 4.0, 8.0});
    EXPECT_TRUE(std::isnan(field.value(0, 0, 0)));
    EXPECT_EQ(field.value(1, 2, 1), 11.0);

    at(0, 0, 0) = std::numeric_limits<TypeParam>::infinity();
    expect_parts(refused(samples, {3, 4, 5}, options), {"infinity at sample [0, 0, 0]"});
}

TYPED_TEST(OddSamples, boxes_are_tight_on_both_lattices_whatever_is_missing) {
    std::uint32_t state = 12345;
    for (int trial = 0; trial < 200; ++trial) {
        RegularFieldOptions options = test::zero_boundary();
        options.nan = NanPolicy::skip;
        options.lattice = trial % 2 == 0 ? Lattice::bcc : Lattice::cartesian;
        options.spacing = {0.3, 0.7, 1.3};
        options.origin = {-5.0, 3.0, 0.1};
        std::vector<TypeParam> samples(4 * 3 * 5, std::numeric_limits<TypeParam>::quiet_NaN());
        for (int kept = 0; kept <= trial % 5; ++kept) {
            state = state * 1664525U + 1013904223U;
            samples[(state >> 8) % samples.size()] = TypeParam{1};
        }
        const RegularField field(samples, {4, 3, 5}, options);
        const Box expected = box_by_positions(field);
        EXPECT_EQ(field.centres_world().lower, expected.lower) << trial;
        EXPECT_EQ(field.centres_world().upper, expected.upper) << trial;
    }
}

TYPED_TEST(OddSamples, a_field_of_nan_has_no_kernel) {
    RegularFieldOptions options = test::zero_boundary();
    options.nan = NanPolicy::skip;
    const RegularField field(std::vector<TypeParam>(8, std::numeric_limits<TypeParam>::quiet_NaN()), {2, 2, 2},
                             options);
    EXPECT_EQ(field.size(), 0U);
    EXPECT_TRUE(field.has_holes());
    EXPECT_TRUE(field.centres_world().empty());
    EXPECT_TRUE(field.supports_world().empty());
    EXPECT_EQ(field.value_range(), (std::array<double, 2>{0.0, 0.0}));
    EXPECT_EQ(field.default_slice_spacing(), 1.0);
}

TYPED_TEST(OddSamples, skipping_changes_nothing_where_there_is_no_nan) {
    RegularFieldOptions options = test::zero_boundary();
    options.nan = NanPolicy::skip;
    const RegularField field(counted<TypeParam>(24), {2, 3, 4}, options);
    EXPECT_FALSE(field.has_holes());
    EXPECT_EQ(field.size(), 24U);
    expect_box(field.centres_world(), {0.0, 0.0, 0.0}, {3.0, 2.0, 1.0});
}

TYPED_TEST(OddSamples, the_smallest_numbers_are_samples) {
    const TypeParam tiny = std::numeric_limits<TypeParam>::denorm_min();
    const RegularField field(std::vector<TypeParam>{tiny, -tiny, TypeParam{0}}, {1, 1, 3}, test::zero_boundary());
    EXPECT_EQ(field.value_range(), (std::array<double, 2>{-static_cast<double>(tiny), static_cast<double>(tiny)}));
}

TEST(RegularFieldChecks, shape) {
    expect_parts(refused(std::vector<float>{}, {0, 0, 0}), {"empty", "shape (0, 0, 0)"});
    expect_parts(refused(std::vector<float>{}, {4, 0, 4}), {"empty", "shape (4, 0, 4)"});
    expect_parts(refused(std::vector<float>(23), {2, 3, 4}), {"23 samples for shape (2, 3, 4)", "wanted 24 samples"});
    expect_parts(refused(std::vector<float>{}, {2, 3, 4}), {"0 samples for shape (2, 3, 4)"});
    // 2^32 * 2^32 * 1 is 0 modulo 2^64.
    constexpr std::size_t large = std::size_t{1} << 32;
    expect_parts(refused(std::vector<float>{}, {large, large, 1}), {"shape (4294967296, 4294967296, 1)", "2^64"});
    expect_parts(refused(std::vector<float>{1.0F}, {1, large, large}), {"2^64"});
    expect_parts(refused(std::vector<float>(2), {large, 1, large / 2 + 1}), {"samples"});
}

TEST(RegularFieldChecks, numbers_of_the_options) {
    for (const double bad : {0.0, -1.0, nan, infinity}) {
        RegularFieldOptions options = test::zero_boundary();
        for (int axis = 0; axis < 3; ++axis) {
            options = {};
            options.spacing[axis] = bad;
            expect_parts(refused_options(options), {"spacing cannot be used", "wanted three finite numbers above 0"});
        }
        options = {};
        options.lattice = Lattice::bcc;
        options.spacing.x = bad;
        expect_parts(refused_options(options), {"spacing cannot be used", "BCC"});
        options = {};
        options.radius = bad;
        expect_parts(refused_options(options), {"radius cannot be used", "above 0"});
        options = {};
        options.falloff = bad;
        expect_parts(refused_options(options), {"falloff cannot be used", "above 0"});
        options = {};
        options.normalization = Normalization::threshold;
        options.w0 = bad;
        expect_parts(refused_options(options), {"w0 cannot be used"});
    }
    RegularFieldOptions options = test::zero_boundary();
    options.origin.y = nan;
    expect_parts(refused_options(options), {"origin cannot be used", "(0, NaN, 0)"});
    options = {};
    options.w0 = infinity;
    expect_parts(refused_options(options), {"w0 cannot be used"});
    options.w0 = 0.0; // has no meaning for the other normalisations
    EXPECT_NO_THROW(RegularField(counted<float>(24), {2, 3, 4}, options));
    options.w0 = 0.25;
    options.normalization = Normalization::threshold;
    EXPECT_EQ(RegularField(counted<float>(24), {2, 3, 4}, options).w0(), 0.25);
}

TEST(RegularFieldChecks, kernels_that_float64_cannot_hold) {
    RegularFieldOptions options = test::zero_boundary();
    options.falloff = 1e-320;
    expect_parts(refused_options(options), {"radius and falloff", "falloff = 1e-320"});
    options = {};
    options.radius = 1e-200;
    expect_parts(refused_options(options), {"radius and falloff", "radius = 1e-200"});
    options.radius = 1e200;
    expect_parts(refused_options(options), {"radius and falloff", "radius = 1e+200"});
}

TEST(RegularFieldChecks, positions_must_be_finite_and_differ) {
    RegularFieldOptions options = test::zero_boundary();
    options.spacing.z = 1e308;
    expect_parts(refused_options(options), {"positions along z", "spacing 1e+308"});
    options = {};
    options.spacing.y = 1e-308;
    expect_parts(refused_options(options), {"positions along y", "spacing 1e-308"});
    options = {};
    options.origin.x = 1e17;
    expect_parts(refused_options(options), {"positions along x", "fall on one float64 number"});
    options.origin.x = -1e17;
    expect_parts(refused_options(options), {"positions along x", "fall on one float64 number"});
    // One unit in the last place of 2^52 is 1: its halves round to the same numbers, whole ones do not.
    options.origin.x = 4503599627370496.0;
    EXPECT_NO_THROW(RegularField(counted<float>(24), {2, 3, 4}, options));
    options.spacing.x = 0.625;
    expect_parts(refused_options(options), {"positions along x", "fall on one float64 number"});
    options.spacing.x = 1.0;
    options.lattice = Lattice::bcc;
    expect_parts(refused_options(options), {"fall on one float64 number"});
    // A single sample has no neighbour to fall upon.
    options.origin = Vec3(1e17);
    options.lattice = Lattice::cartesian;
    EXPECT_NO_THROW(RegularField(std::vector<float>{1.0F}, {1, 1, 1}, options));
}

TEST(RegularFieldChecks, large_coordinates_are_fine) {
    RegularFieldOptions options = test::zero_boundary();
    options.origin = {1e9, -1e9, 1e9};
    options.spacing = Vec3(1e-3);
    const RegularField field(counted<float>(24), {2, 3, 4}, options);
    EXPECT_NEAR(field.centres_world().extent().x, 3e-3, 2e-7);
}

/// Processor time of making a field of 256^3 samples; the fastest of a few, since other programs share the processor.
template <class T>
double seconds_of_survey() {
    constexpr std::size_t edge = 256;
    double best = infinity;
    for (int n = 0; n < 5; ++n) {
        SampleArray samples = std::vector<T>(edge * edge * edge, T{1});
        const std::clock_t start = std::clock();
        const RegularField field(std::move(samples), {edge, edge, edge}, test::zero_boundary());
        best = std::min(best, static_cast<double>(std::clock() - start) / CLOCKS_PER_SEC);
        EXPECT_EQ(field.value_range()[1], 1.0);
    }
    return best;
}

TEST(RegularField, a_large_volume_is_surveyed_in_no_time) {
#if !defined(NDEBUG) || defined(SHEETSPLAT_SANITIZED)
    GTEST_SKIP() << "only a build with optimisation and without sanitizers is fast";
#endif
    const double of_bytes = seconds_of_survey<std::uint8_t>();
    const double of_floats = seconds_of_survey<float>();
    RecordProperty("uint8_milliseconds", std::to_string(1e3 * of_bytes));
    RecordProperty("float_milliseconds", std::to_string(1e3 * of_floats));
    EXPECT_LT(of_bytes, 0.05);
    EXPECT_LT(of_floats, 0.1);
}

} // namespace
} // namespace sheetsplat

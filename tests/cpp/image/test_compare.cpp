#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <vector>

#include "sheetsplat/error.hpp"
#include "sheetsplat/image.hpp"
#include "support.hpp"

namespace sheetsplat {
namespace {

using test::expect_parts;
using test::message_of;

constexpr float infinity = std::numeric_limits<float>::infinity();
constexpr float nan = std::numeric_limits<float>::quiet_NaN();

TEST(Compare, equal_pictures_have_no_distance) {
    const std::vector<float> a{0.1F, 0.2F, 0.3F, 1.0F, 0.0F, 0.0F, 0.0F, 0.0F};
    const Difference d = compare(a, a, 4);
    EXPECT_EQ(d.rmse, 0.0);
    EXPECT_EQ(d.p99_9, 0.0);
    EXPECT_EQ(d.maximum, 0.0);
    EXPECT_EQ(compare({}, {}, 4).maximum, 0.0);
}

TEST(Compare, rmse_is_over_all_channels_and_the_rest_over_the_largest_of_a_pixel) {
    const std::vector<float> reference(8, 0.0F);
    std::vector<float> picture = reference;
    picture[1] = 0.5F;
    picture[2] = -0.25F;
    picture[7] = 0.125F;
    const Difference d = compare(picture, reference, 4);
    EXPECT_DOUBLE_EQ(d.rmse, std::sqrt((0.25 + 0.0625 + 0.015625) / 8.0));
    EXPECT_DOUBLE_EQ(d.maximum, 0.5);
    EXPECT_DOUBLE_EQ(d.p99_9, 0.5);
}

TEST(Compare, p99_9_is_the_nearest_rank) {
    // Pixel p differs by (p + 1) / 4096. Of n pixels, rank ceil(0.999 n) counts.
    const auto rank_of = [](std::size_t pixels) {
        const std::vector<float> reference(4 * pixels, 0.0F);
        std::vector<float> picture = reference;
        for (std::size_t p = 0; p < pixels; ++p) {
            picture[4 * p + p % 4] = static_cast<float>(p + 1) / 4096.0F;
        }
        return compare(picture, reference, 4).p99_9 * 4096.0;
    };
    EXPECT_EQ(rank_of(1), 1.0);
    EXPECT_EQ(rank_of(999), 999.0);
    EXPECT_EQ(rank_of(1000), 999.0);
    EXPECT_EQ(rank_of(1001), 1000.0);
    EXPECT_EQ(rank_of(2000), 1998.0);
    EXPECT_EQ(rank_of(2001), 1999.0);
}

TEST(Compare, scalars_are_divided_by_the_largest_reference_value_if_above_1) {
    EXPECT_DOUBLE_EQ(compare({1.0F, 8.0F}, {2.0F, 10.0F}, 1).maximum, 0.2);
    EXPECT_DOUBLE_EQ(compare({1.0F, 8.0F}, {2.0F, 10.0F}, 1).rmse, std::sqrt((0.01 + 0.04) / 2.0));
    EXPECT_DOUBLE_EQ(compare({0.25F}, {0.5F}, 1).maximum, 0.25);
    // The scale is the reference's alone.
    EXPECT_DOUBLE_EQ(compare({10.0F}, {0.0F}, 1).maximum, 10.0);
    // Colour is never scaled.
    EXPECT_DOUBLE_EQ(compare({8.0F, 0, 0, 0}, {10.0F, 0, 0, 0}, 4).maximum, 2.0);
}

TEST(Compare, nan_and_infinity) {
    EXPECT_EQ(compare({nan}, {nan}, 1).maximum, 0.0);
    EXPECT_EQ(compare({nan}, {1.0F}, 1).maximum, infinity);
    EXPECT_EQ(compare({1.0F}, {nan}, 1).rmse, infinity);
    EXPECT_EQ(compare({nan, 0.0F}, {infinity, 0.0F}, 1).maximum, infinity);
    EXPECT_EQ(compare({infinity}, {infinity}, 1).maximum, 0.0);
    EXPECT_EQ(compare({infinity}, {-infinity}, 1).maximum, infinity);
    EXPECT_EQ(compare({infinity}, {1.0F}, 1).maximum, infinity);
    // An infinite depth does not hide what differs elsewhere.
    EXPECT_DOUBLE_EQ(compare({infinity, 3.0F}, {infinity, 4.0F}, 1).maximum, 0.25);
    EXPECT_EQ(compare({nan, 0, 0, 1}, {0, 0, 0, 1}, 4).p99_9, infinity);
}

TEST(Compare, small_differences_keep_their_digits) {
    const std::vector<float> reference(4000, 1.0F);
    std::vector<float> picture = reference;
    picture[17] = std::nextafter(1.0F, 2.0F);
    const double step = std::numeric_limits<float>::epsilon();
    EXPECT_DOUBLE_EQ(compare(picture, reference, 4).maximum, step);
    EXPECT_DOUBLE_EQ(compare(picture, reference, 4).rmse, step / std::sqrt(4000.0));
    EXPECT_EQ(compare(picture, reference, 4).p99_9, 0.0);
}

TEST(Compare, refuses_what_does_not_fit) {
    expect_parts(message_of<InvalidInput>([] {
                     compare({1.0F}, {1.0F, 2.0F}, 1);
                 }),
                 {"1 numbers against 2", "one size"});
    expect_parts(message_of<InvalidInput>([] { compare({1.0F, 2.0F}, {1.0F, 2.0F}, 4); }), {"multiple of 4"});
    expect_parts(message_of<InvalidInput>([] { compare({1.0F, 2.0F}, {1.0F, 2.0F}, 2); }), {"2 channels"});
    expect_parts(message_of<InvalidInput>([] { compare({}, {}, 0); }), {"0 channels"});
}

} // namespace
} // namespace sheetsplat

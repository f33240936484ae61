#include <gtest/gtest.h>

#include <cstdlib>
#include <limits>

#include "base/checks.hpp"

namespace sheetsplat {
namespace {

constexpr double infinity = std::numeric_limits<double>::infinity();
constexpr double nan = std::numeric_limits<double>::quiet_NaN();

TEST(Checks, is_finite_looks_at_every_component) {
    EXPECT_TRUE(is_finite(1e308));
    EXPECT_FALSE(is_finite(infinity));
    EXPECT_FALSE(is_finite(nan));
    EXPECT_TRUE(is_finite(Vec3(1.0, 2.0, 3.0)));
    for (int axis = 0; axis < 3; ++axis) {
        Vec3 v(0.0);
        v[axis] = nan;
        EXPECT_FALSE(is_finite(v)) << axis;
    }
}

TEST(Checks, numbers_read_back_as_themselves) {
    for (const double value : {0.1, 1.0 / 3.0, 1e9 + 0.25, -5e-324, 1.7976931348623157e308, 0.0}) {
        EXPECT_EQ(std::strtod(text_of(value).c_str(), nullptr), value) << text_of(value);
    }
    EXPECT_EQ(text_of(1.0), "1");
    EXPECT_EQ(text_of(-0.25), "-0.25");
    EXPECT_EQ(text_of(nan), "NaN");
    EXPECT_EQ(text_of(infinity), "infinity");
    EXPECT_EQ(text_of(-infinity), "-infinity");
    EXPECT_EQ(text_of(Vec3(1.0, -0.5, infinity)), "(1, -0.5, infinity)");
}

TEST(Checks, bytes_come_in_readable_units) {
    EXPECT_EQ(text_of_bytes(0), "0 bytes");
    EXPECT_EQ(text_of_bytes(1023), "1023 bytes");
    EXPECT_EQ(text_of_bytes(1024), "1.00 KiB");
    EXPECT_EQ(text_of_bytes(3ULL << 29), "1.50 GiB");
    EXPECT_EQ(text_of_bytes((1ULL << 20) - 1), "1.00 MiB");
    EXPECT_EQ(text_of_bytes(std::numeric_limits<std::uint64_t>::max()), "16.00 EiB");
}

} // namespace
} // namespace sheetsplat

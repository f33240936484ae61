// Each constant of plan/limits_gl.hpp: a scene just within it and one just beyond get different plans.
#include <cmath>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include "support/limit_cases.hpp"

namespace sheetsplat {
namespace {

using namespace test;

// ---- backend gl: refused beyond

class GlRefuses : public testing::TestWithParam<Limit> {};

Case ellipsoid_case() {
    Case one = lit_case(ellipsoids());
    one.view.kernels.ellipsoids = true;
    one.view.kernels.most_ellipsoids = 2;
    one.view.kernels.all = 2;
    one.view.shapes.largest_aspect = 4.0;
    one.view.screen_px.largest_lattice = 0.0;
    one.view.screen_px.smallest = 4.0;
    one.view.overlap.typical = 5.0;
    return one;
}

TEST_P(GlRefuses, Beyond) {
    Case one = ellipsoid_case();
    GetParam().set(one, GetParam().within);
    EXPECT_FALSE(one.refused(Backend::gl));
    one = ellipsoid_case();
    GetParam().set(one, GetParam().beyond);
    EXPECT_TRUE(one.refused(Backend::gl));
}

void make_old(Case& one) {
    one.device.version = "3.3";
    one.device.version_major = one.device.version_minor = 3;
}
void make_papers(Case& one) {
    make_unlit(one);
    one.options.effects = {{"paper_slicing", true}};
}
void make_surface(Case& one) {
    one.scene.mode = Mode::isosurface;
    one.scene.iso_values = {0.1};
}
void set_window(Case& one, double width) {
    one.scene.transfer_function = TransferFunction({{0.0, {1, 1, 1}, 0.0}, {width, {1, 1, 1}, 0.001}});
}
const std::vector<Limit> of_gl{
    {"lights", 64, 65, [](Case& c, double x) { c.scene.lights.resize(static_cast<std::size_t>(x)); }},
    {"groups", 16, 17,
     [](Case& c, double x) {
         const auto groups = static_cast<std::size_t>(x);
         c.scene.fields.assign(groups, c.scene.fields.front());
         for (std::size_t first = 1; first < groups; ++first) {
             c.scene.later_groups.push_back({first, c.scene.transfer_function});
         }
     }},
    {"surfaces", 32, 33,
     [](Case& c, double x) {
         make_surface(c);
         c.scene.iso_values.assign(static_cast<std::size_t>(x), 0.1);
     }},
    {"counted_falloff", 79, 81,
     [](Case& c, double x) {
         c.scene.mode = Mode::average;
         c.scene.fields = {ellipsoids(1.0, 1.0, 1.0, x)};
     }},
    {"shadowing_lights", 16, 17,
     [](Case& c, double x) {
         c.scene.shadows = true;
         c.scene.lights.resize(static_cast<std::size_t>(x));
     }},
    {"light_elements", 64 << 20, (64 << 20) - 1,
     [](Case& c, double x) {
         c.scene.shadows = true;
         c.device.max_buffer_texels = static_cast<int>(x);
     }},
    {"imprecise_slices", 1 << 17, (1 << 17) + 1,
     [](Case& c, double x) {
         make_old(c);
         make_unlit(c);
         c.view.frame.slices = static_cast<std::int64_t>(x);
     }},
    {"falloff", 0.0505, 0.0495, [](Case& c, double x) { c.view.shapes.smallest_falloff = x; }},
    {"sum", 0.99e36, 1.01e36,
     [](Case& c, double x) {
         make_unlit(c);
         c.scene.fields = {ellipsoids(x, x / 33.5)};
     }},
    {"divisor", 1.01e-22, 0.99e-22,
     [](Case& c, double x) {
         make_unlit(c);
         c.scene.fields = {ellipsoids(x, x)};
     }},
    {"plain_aspect", 32500, 33000,
     [](Case& c, double x) {
         make_old(c);
         c.view.shapes.largest_aspect = x;
     }},
    {"plain_px", 1.01e-4, 0.99e-4,
     [](Case& c, double x) {
         make_old(c);
         c.view.screen_px.smallest_ellipsoid = x;
     }},
    {"paper_falloff", 31.8, 32.2,
     [](Case& c, double x) {
         make_papers(c);
         c.scene.fields = {ellipsoids(1.0, 1.0, 1.0, x)};
     }},
    {"paper_aspect", 1020, 1030,
     [](Case& c, double x) {
         make_papers(c);
         c.view.shapes.largest_aspect = x;
     }},
    {"paper_extent", 2040, 2060,
     [](Case& c, double x) {
         make_papers(c);
         c.scene.fields = {ellipsoids(1.0, 1.0, 2.0 * 0.5 * x)};
     }},
    {"paper_extent_in_float32", 510, 515,
     [](Case& c, double x) {
         make_papers(c);
         make_old(c);
         c.scene.fields = {ellipsoids(1.0, 1.0, 2.0 * 0.5 * x)};
     }},
    {"paper_px", 0.99e7, 1.01e7,
     [](Case& c, double x) {
         make_papers(c);
         c.view.screen_px.largest_ellipsoid_at_unit = x;
     }},
    {"alike_unlit", 0.99e5, 1.01e5,
     [](Case& c, double x) {
         make_unlit(c);
         c.view.overlap.alike = x;
     }},
    {"full_gradient", 2.02e-4, 1.98e-4,
     [](Case& c, double x) {
         make_unlit(c);
         c.scene.gradient_opacity = x;
     }},
    {"nearest_end_of_surfaces", 0.99e6, 1.01e6,
     [](Case& c, double x) {
         c.scene.mode = Mode::isosurface;
         c.scene.iso_values = {IsoValue(0.7 - 0.7 / x)};
     }},
    // Weights of 1.
    {"weights_in_slabs", 1.49e5, 1.51e5,
     [](Case& c, double x) {
         make_unlit(c);
         c.scene.fields = {ellipsoids(1.0 / x)};
         c.scene.sampling = Sampling::slab;
         c.view.overlap.densest = c.view.overlap.typical = 0.5;
     }},
    {"crowded_weights_in_slabs", 1.49e5, 1.51e5,
     [](Case& c, double x) {
         make_unlit(c);
         c.scene.fields = {ellipsoids(40.0 / x)};
         c.scene.sampling = Sampling::slab;
         c.view.overlap.densest = 20.0;
     }},
    {"sideways", 99, 101,
     [](Case& c, double x) {
         c.scene.mode = Mode::xray;
         c.scene.sampling = Sampling::slab;
         c.projection = Projection::perspective;
         c.view.frame.largest_slant = c.view.slabs.thickest = x;
     }},
    {"sideways_through_kernels", 99, 101,
     [](Case& c, double x) {
         c.scene.mode = Mode::xray;
         c.scene.sampling = Sampling::slab;
         c.projection = Projection::perspective;
         c.view.frame.largest_slant = 1000.0;
         c.view.slabs.thickest = x;
     }},
    {"place", 3.88e-3, 3.8e-3, [](Case& c, double x) { c.view.screen_px.largest_lattice = x; }},
    {"splat_px", 0.99e12, 1.01e12, [](Case& c, double x) { c.view.screen_px.largest_lattice = x; }},
    {"ellipsoid_px", 0.99e12, 1.01e12, [](Case& c, double x) { c.view.screen_px.largest_ellipsoid_at_unit = x; }},
    {"deep_px", 0.99e15, 1.01e15,
     [](Case& c, double x) {
         c.projection = Projection::perspective;
         c.view.screen_px.largest_ellipsoid_at_unit = x;
     }},
};
INSTANTIATE_TEST_SUITE_P(Limits, GlRefuses, testing::ValuesIn(of_gl), name_of);

// ---- backend gl: sheets of 16 bits

class GlFloat16 : public testing::TestWithParam<Limit> {};

TEST_P(GlFloat16, EndsAt) {
    const auto precision = [&](double number) {
        Case one = ellipsoid_case();
        make_unlit(one);
        GetParam().set(one, number);
        return one.plan(Backend::gl).precision;
    };
    EXPECT_EQ(precision(GetParam().within), Precision::float16);
    EXPECT_EQ(precision(GetParam().beyond), Precision::float32);
}

const std::vector<Limit> of_float16{
    {"scale", 0.101, 0.099, [](Case& c, double x) { c.scene.fields = {ellipsoids(x, x)}; }},
    {"sum", 5.9e4, 6.1e4, [](Case& c, double x) { c.scene.fields = {ellipsoids(1.0, x / 33.5)}; }},
    // The root of 2 x kernels over 4096, times values up to 0.7, against 1 / 510.
    {"bound", 65.0, 66.8, [](Case& c, double x) { c.view.overlap.densest = x; }},
    // The root of 20 kernels over 4096, times values up to 0.7 and the slope, against 1 / 85.
    {"worst", 15.2, 15.6,
     [](Case& c, double x) {
         c.view.overlap.densest = 10.0;
         c.scene.transfer_function = ramp(x, 0.1);
     }},
};
INSTANTIATE_TEST_SUITE_P(Limits, GlFloat16, testing::ValuesIn(of_float16), name_of);

TEST(GlFloat16Refused, WhereEmptyPointsAreToldFromZero) {
    Case one = ellipsoid_case();
    make_unlit(one);
    one.options.precision = Precision::float16;
    EXPECT_FALSE(one.refused(Backend::gl));
    one.scene.transfer_function = TransferFunction({{0.0, {1, 1, 1}, 0.01}, {1.0, {1, 1, 1}, 0.01}});
    EXPECT_TRUE(one.refused(Backend::gl));
}

// ---- backend gl: ways of drawing

TEST(GlChooses, PreciseFrom) {
    Case one = ellipsoid_case();
    const auto precise = [&] { return one.plan(Backend::gl).summary.has("precise_sections"); };
    one.view.shapes.largest_aspect = 4090.0;
    EXPECT_FALSE(precise());
    one.view.shapes.largest_aspect = 4100.0;
    EXPECT_TRUE(precise());
    one = ellipsoid_case();
    one.view.screen_px.smallest_ellipsoid = 1.01e-2;
    EXPECT_FALSE(precise());
    one.view.screen_px.smallest_ellipsoid = 0.99e-2;
    EXPECT_TRUE(precise());
}

TEST(GlChooses, ResidentUpTo) {
    Case one = ellipsoid_case();
    const auto resident = [&] { return one.plan(Backend::gl).resident_sections; };
    one.view.shapes.largest_aspect = 1020.0;
    EXPECT_TRUE(resident());
    one.view.shapes.largest_aspect = 1030.0;
    EXPECT_FALSE(resident());
    one = ellipsoid_case();
    one.view.kernels.most_ellipsoids = 1U << 20;
    EXPECT_TRUE(resident());
    ++one.view.kernels.most_ellipsoids;
    EXPECT_FALSE(resident());
}

TEST(GlChooses, FineGradientsBelow) {
    for (const auto& [pixel, fine] : {std::pair{0.126, false}, std::pair{0.124, true}}) {
        Case one = lit_case();
        one.view.frame.smallest_pixel = pixel * one.view.frame.reference_length;
        EXPECT_EQ(one.plan(Backend::gl).fine_gradient, fine) << pixel;
    }
}

TEST(GlChooses, SeparableUpTo) {
    Case one = lit_case();
    one.view.screen_px.largest_lattice = 0.99e6;
    EXPECT_TRUE(one.plan(Backend::gl).separable);
    one.view.screen_px.largest_lattice = 1.01e6;
    EXPECT_FALSE(one.plan(Backend::gl).separable);
}

TEST(GlChooses, CountsFromTheMiddleFrom) {
    for (const auto& [ratio, apart] : {std::pair{0.95, false}, std::pair{1.05, true}}) {
        Case one = ellipsoid_case();
        one.scene.fields = {ellipsoids(1.0, 1.0, 1.0, 5.0, ratio - 0.7)};
        one.scene.transfer_function = ramp(0.01, 0.01, ratio - 0.7);
        EXPECT_EQ(!one.plan(Backend::gl).own_sheets.empty(), apart) << ratio;
    }
}

TEST(GlChooses, CountsSurfacesFromTheMiddleFrom) {
    for (const auto& [ratio, apart] : {std::pair{1.95, false}, std::pair{2.05, true}}) {
        Case one = ellipsoid_case();
        make_surface(one);
        // Values differ by 0.2.
        one.scene.fields = {ellipsoids(1.0, 1.0, 1.0, 5.0, 0.2 * ratio - 0.7)};
        EXPECT_EQ(!one.plan(Backend::gl).own_sheets.empty(), apart) << ratio;
    }
}

TEST(GlChooses, CountsFromZeroWhereSumsAreLessThanTheMiddle) {
    // Sums of weights are far below w0: 33.5 / 1e4 of values of 0.7, under a width of half of that.
    Case one = ellipsoid_case();
    one.scene.fields = {ellipsoids(1e4)};
    set_window(one, 1e-3);
    EXPECT_TRUE(one.plan(Backend::gl).own_sheets.empty());
}

TEST(GlChooses, CountsFromTheMiddleWhereValuesAreAlike) {
    const auto is_apart = [](double change, double crowd) {
        EllipsoidArrays arrays;
        arrays.centers = {Vec3(0.0), Vec3(1.0, 0.0, 0.0)};
        arrays.scales = {Vec3(1.0, 0.5, 2.0), Vec3(1.0, 0.5, 2.0)};
        arrays.values = {1.0 - 2.0 / change, 1.0};
        EllipsoidFieldOptions options;
        options.normalization = Normalization::threshold;
        Case one = ellipsoid_case();
        one.scene.fields = {std::make_shared<EllipsoidField>(std::move(arrays), options)};
        one.view.overlap.densest = one.view.overlap.typical = crowd;
        return !one.plan(Backend::gl).own_sheets.empty();
    };
    for (const double crowd : {1.0, 10.0}) {
        EXPECT_FALSE(is_apart(31.0, crowd));
        EXPECT_TRUE(is_apart(33.0, crowd));
    }
    // Of one value.
    EXPECT_FALSE(is_apart(1e300, 1.0));
    EXPECT_TRUE(is_apart(1e300, 10.0));
}

TEST(GlChooses, EliminationInSoftwareWhereOpaqueWithinSixteenSlices) {
    // 1 - (1 - 0.2169)^16 is A_stop, 0.98.
    for (const auto& [opacity, eliminates] : {std::pair{0.215, false}, std::pair{0.219, true}}) {
        Case one = lit_case();
        one.device.software = true;
        one.view.frame.slices = 1000;
        one.scene.transfer_function = ramp(opacity, opacity);
        EXPECT_EQ(one.plan(Backend::gl).elimination, eliminates) << opacity;
    }
}

} // namespace
} // namespace sheetsplat

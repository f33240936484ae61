// Limits that depend on the device or on more than a test draws, and those that choose a way of drawing on backend gl:
// a scene just within and one just beyond get different plans. test_limits.py draws pictures on each side of all
// others.
#include <cmath>
#include <functional>
#include <string>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include "plan/make_plan.hpp"
#include "sheetsplat/error.hpp"
#include "support/facts.hpp"
#include "support/lattices.hpp"

namespace sheetsplat {
namespace {

using namespace test;

/// Everything that a plan is made of.
struct Case {
    Scene scene;
    ViewFacts view;
    RendererOptions options;
    Projection projection = Projection::orthographic;
    Capabilities device;

    [[nodiscard]] DrawPlan plan(Backend backend) const {
        return make_plan(scene, surveyed(scene, view), options, {}, projection, backend,
                         backend == Backend::gl ? &device : nullptr);
    }
    [[nodiscard]] bool refused(Backend backend) const {
        try {
            (void)plan(backend);
            return false;
        } catch (const Unsupported&) {
            return true;
        }
    }
};

/// A limit, a number on either side of it, and the case that has that number.
struct Limit {
    std::string name;
    double within, beyond;
    std::function<void(Case&, double)> set;
};
std::ostream& operator<<(std::ostream& out, const Limit& limit) { return out << limit.name; }
std::string name_of(const testing::TestParamInfo<Limit>& info) { return info.param.name; }

std::shared_ptr<const Field> lattice(Normalization normalization = Normalization::lattice, double offset = 0.0,
                                     double falloff = 5.0) {
    RegularFieldOptions options = test::zero_boundary();
    options.normalization = normalization;
    options.falloff = falloff;
    std::vector<double> samples{0.0, 1.0, 0.5, 0.2, 0.1, 0.9, 0.3, 0.4};
    for (double& sample : samples) {
        sample += offset;
    }
    return std::make_shared<RegularField>(std::move(samples), std::array<std::size_t, 3>{2, 2, 2}, options);
}

std::shared_ptr<const Field> ellipsoids(double w0 = 1.0, double weight = 1.0, double distance = 1.0,
                                        double falloff = 5.0, double offset = 0.0) {
    EllipsoidArrays arrays;
    arrays.centers = {Vec3(0.0), Vec3(distance, 0.0, 0.0)};
    arrays.scales = {Vec3(1.0, 0.5, 2.0), Vec3(1.0, 0.5, 2.0)};
    arrays.values = {0.5 + offset, 0.7 + offset};
    arrays.weights = {weight, weight};
    EllipsoidFieldOptions options;
    options.normalization = Normalization::threshold;
    options.w0 = w0;
    options.falloff = falloff;
    return std::make_shared<EllipsoidField>(std::move(arrays), options);
}

/// Opacity rises by `slope` a unit of value, up to `top`, from the value `from` on; the window is 1 wide.
TransferFunction ramp(double slope, double top = 0.01, double from = 0.0) {
    const double end = std::min(top / slope, 1.0);
    std::vector<TransferPoint> points{{from, {1, 1, 1}, 0.0}, {from + end, {1, 1, 1}, std::min(top, slope)}};
    if (end < 1.0) {
        points.push_back({from + 1.0, {1, 1, 1}, std::min(top, slope)});
    }
    return TransferFunction(std::move(points));
}

Case lit_case(std::shared_ptr<const Field> field = lattice()) {
    Case made{Scene{{std::move(field)}, ramp(0.01)}, {}, {}, Projection::orthographic, {}};
    made.scene.lights = {Light{}};
    made.view.frame.size = {64, 64};
    made.view.frame.slices = 6;
    made.view.kernels.all = 8;
    made.view.screen_px.smallest = 2.0;
    made.view.shapes.smallest_falloff = 5.0;
    made.device.renderer = "a device";
    made.device.version = "4.6";
    made.device.version_major = 4;
    made.device.version_minor = 6;
    made.device.max_point_size = 255.0F;
    made.device.max_buffer_texels = 1 << 27;
    return made;
}

void make_unlit(Case& one) { one.scene.lights.clear(); }

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
const std::vector<Limit> of_gl{
    {"light_elements", 64 << 20, (64 << 20) - 1,
     [](Case& c, double x) {
         c.scene.shadows = true;
         c.device.max_buffer_texels = static_cast<int>(x);
     }},
    {"slices", 1 << 17, (1 << 17) + 1,
     [](Case& c, double x) {
         make_old(c);
         make_unlit(c);
         c.view.frame.slices = static_cast<std::int64_t>(x);
     }},
    {"aspect", 32500, 33000,
     [](Case& c, double x) {
         make_old(c);
         c.view.shapes.largest_aspect = x;
     }},
    {"smallest_px", 1.01e-4, 0.99e-4,
     [](Case& c, double x) {
         make_old(c);
         c.view.screen_px.smallest = c.view.screen_px.smallest_ellipsoid = x;
     }},
    {"resident_kernels", 1 << 20, (1 << 20) + 1,
     [](Case& c, double x) {
         make_unlit(c);
         c.options.effects = {{"paper_slicing", true}};
         c.view.kernels.most_ellipsoids = static_cast<std::size_t>(x);
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

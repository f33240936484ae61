// Each constant of plan/limits_*.hpp: a scene just within it and one just beyond get different plans.
#include <cmath>
#include <functional>
#include <string>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include "plan/make_plan.hpp"
#include "plan/slab_nodes.hpp"
#include "sheetsplat/error.hpp"
#include "support/facts.hpp"

namespace sheetsplat {
namespace {

/// Everything that a plan is made of.
struct Case {
    Scene scene;
    ViewFacts view;
    RendererOptions options;
    Projection projection = Projection::orthographic;
    Capabilities device;

    [[nodiscard]] DrawPlan plan(Backend backend) const {
        return make_plan(scene, test::surveyed(scene, view), options, {}, projection, backend,
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
    RegularFieldOptions options;
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
void make_quotients(Case& one) { one.scene.fields = {lattice(Normalization::threshold)}; }
/// Lit ellipsoids that hardly overlap.
void make_sparse(Case& one) {
    one.view.shapes.largest_aspect = 3.0;
    one.view.overlap.typical = 1.0;
    one.view.screen_px.smallest_ellipsoid = 2.0;
}

// ---- backend cpu: float32 up to a limit, float64 beyond

class CpuFloat32 : public testing::TestWithParam<Limit> {};

TEST_P(CpuFloat32, EndsAt) {
    const auto precision = [&](double number) {
        Case one = lit_case();
        GetParam().set(one, number);
        return one.plan(Backend::cpu).precision;
    };
    EXPECT_EQ(precision(GetParam().within), Precision::float32);
    EXPECT_EQ(precision(GetParam().beyond), Precision::float64);
    Case one = lit_case();
    GetParam().set(one, GetParam().beyond);
    EXPECT_TRUE(one.plan(Backend::cpu).summary.has("float64"));
    one.options.precision = Precision::float32;
    EXPECT_TRUE(one.refused(Backend::cpu));
    one.options.allow_inexact = true;
    EXPECT_EQ(one.plan(Backend::cpu).precision, Precision::float32);
}

const std::vector<Limit> of_float32{
    {"close_pixels", 0.127, 0.123, [](Case& c, double x) { c.view.frame.smallest_pixel = x; }},
    {"close_slices", 0.127, 0.123, [](Case& c, double x) { c.view.frame.slice_spacing = x; }},
    {"slices", 16384, 16385, [](Case& c, double x) { c.view.frame.slices = static_cast<std::int64_t>(x); }},
    {"aspect", 510, 514, [](Case& c, double x) { c.view.shapes.largest_aspect = x; }},
    {"px", 0.0505, 0.0495, [](Case& c, double x) { c.view.screen_px.smallest = x; }},
    {"lit_px", 16.1, 15.9,
     [](Case& c, double x) {
         make_sparse(c);
         c.view.screen_px.smallest_ellipsoid = x;
     }},
    {"steep_lit_px", 0.31, 0.29,
     [](Case& c, double x) {
         make_sparse(c);
         c.scene.transfer_function = ramp(20.0, 0.2);
         c.view.screen_px.smallest_ellipsoid = x;
     }},
    {"few_overlaps", 3.05, 2.95,
     [](Case& c, double x) {
         make_sparse(c);
         c.view.overlap.typical = x;
     }},
    {"sphere_aspect", 1.00099, 1.00101,
     [](Case& c, double x) {
         make_sparse(c);
         c.view.shapes.largest_aspect = x;
     }},
    {"gentle_steepness", 10.1, 9.9,
     [](Case& c, double x) {
         make_sparse(c);
         c.scene.transfer_function = ramp(x, 0.2);
     }},
    {"largest_px_of_lattices", 0.99e6, 1.01e6, [](Case& c, double x) { c.view.screen_px.largest_lattice = x; }},
    {"largest_px_of_ellipsoids", 0.99e6, 1.01e6, [](Case& c, double x) { c.view.screen_px.largest_ellipsoid = x; }},
    {"thickest_slab", 99, 101,
     [](Case& c, double x) {
         c.scene.sampling = Sampling::slab;
         c.view.slabs.thickest = x;
     }},
    // epsilon sqrt(33.5) / 1e-4.
    {"gradient_opacity", 3.51e-3, 3.43e-3, [](Case& c, double x) { c.scene.gradient_opacity = x; }},
    {"falloff", 0.505, 0.495, [](Case& c, double x) { c.view.shapes.smallest_falloff = x; }},
    {"sum", 0.99e30, 1.01e30,
     [](Case& c, double x) {
         make_unlit(c);
         c.scene.fields = {ellipsoids(x, x / 33.5)};
     }},
    // 1e-4 / (epsilon / 4 sqrt(33.5)) = 1152.
    {"ratio", 1145, 1160,
     [](Case& c, double x) {
         c.scene.fields = {lattice(Normalization::lattice, x - 1.0)};
         c.scene.transfer_function = ramp(0.01, 0.01, x - 1.0);
     }},
    {"lit_overlap", 990, 1010,
     [](Case& c, double x) {
         make_quotients(c);
         c.view.overlap.typical = x;
     }},
    {"lit_crowd", 990, 1010,
     [](Case& c, double x) {
         make_quotients(c);
         c.view.overlap.densest = x;
     }},
    // 5 reference lengths a pixel times values over the window.
    {"lit_noise", 19.8, 20.2,
     [](Case& c, double x) {
         make_quotients(c);
         c.view.frame.smallest_pixel = 0.2;
         c.scene.transfer_function = TransferFunction({{0.0, {1, 1, 1}, 0.0}, {5.0 / x, {1, 1, 1}, 0.01}});
     }},
    {"steep_lit_noise", 99, 101,
     [](Case& c, double x) {
         make_quotients(c);
         c.view.frame.smallest_pixel = 0.2;
         c.scene.transfer_function =
             TransferFunction({{0.0, {1, 1, 1}, 0.0}, {0.4 / x, {1, 1, 1}, 1.0}, {5.0 / x, {1, 1, 1}, 1.0}});
     }},
    // Values of 1/2 from their middle, over the window.
    {"noise_of_values", 19.8, 20.2,
     [](Case& c, double x) {
         make_quotients(c);
         c.scene.gradient = Gradient::analytic;
         c.scene.transfer_function = TransferFunction({{0.0, {1, 1, 1}, 0.0}, {0.5 / x, {1, 1, 1}, 0.01}});
     }},
    // Values of 0 to 1.
    {"nearest_end", 990, 1010,
     [](Case& c, double x) {
         make_quotients(c);
         c.scene.mode = Mode::isosurface;
         c.scene.gradient = Gradient::analytic;
         c.scene.iso_values = {IsoValue(1.0 - 1.0 / x)};
     }},
    // Weights of 1.
    {"weights_in_slabs", 299, 301,
     [](Case& c, double x) {
         c.scene.fields = {ellipsoids(1.0 / x)};
         c.scene.sampling = Sampling::slab;
     }},
    {"alike", 4990, 5010, [](Case& c, double x) { c.view.overlap.alike = x; }},
    {"alike_lit", 198, 202,
     [](Case& c, double x) {
         make_quotients(c);
         c.view.overlap.alike = x;
     }},
    {"largest_unit", 0.99e8, 1.01e8,
     [](Case& c, double x) {
         c.projection = Projection::perspective;
         c.view.frame.slice_spacing = c.view.frame.smallest_pixel = c.view.frame.reference_length = x;
     }},
    {"least_unit", 1.01e-8, 0.99e-8,
     [](Case& c, double x) {
         c.projection = Projection::perspective;
         c.view.frame.slice_spacing = c.view.frame.smallest_pixel = c.view.frame.reference_length = x;
     }},
    {"shown_sum", 0.99e30, 1.01e30,
     [](Case& c, double x) {
         c.scene.mode = Mode::mip;
         c.scene.fields = {
             std::make_shared<RegularField>(std::vector<double>(8, x), std::array<std::size_t, 3>{2, 2, 2})};
     }},
    {"steepest_falloff", 19.8, 20.2,
     [](Case& c, double x) {
         c.scene.fields = {lattice(Normalization::lattice, 0.0, x)};
         c.scene.transfer_function = TransferFunction({{0.0, {1, 1, 1}, 0.01}, {1.0, {1, 1, 1}, 0.02}});
     }},
};
INSTANTIATE_TEST_SUITE_P(Limits, CpuFloat32, testing::ValuesIn(of_float32), name_of);

// ---- backend cpu: refused beyond

class CpuFloat64 : public testing::TestWithParam<Limit> {};

TEST_P(CpuFloat64, EndsAt) {
    Case one = lit_case();
    GetParam().set(one, GetParam().within);
    EXPECT_FALSE(one.refused(Backend::cpu));
    EXPECT_EQ(one.plan(Backend::cpu).precision, Precision::float64);
    one = lit_case();
    GetParam().set(one, GetParam().beyond);
    EXPECT_TRUE(one.refused(Backend::cpu));
    one.options.allow_inexact = true;
    EXPECT_FALSE(one.refused(Backend::cpu));
}

const std::vector<Limit> of_float64{
    {"largest_px", 0.99e12, 1.01e12, [](Case& c, double x) { c.view.screen_px.largest_lattice = x; }},
    {"falloff", 1.01e-8, 0.99e-8, [](Case& c, double x) { c.view.shapes.smallest_falloff = x; }},
    {"steepest_falloff", 594, 606,
     [](Case& c, double x) {
         c.scene.fields = {lattice(Normalization::lattice, 0.0, x)};
         c.scene.transfer_function = TransferFunction({{0.0, {1, 1, 1}, 0.01}, {1.0, {1, 1, 1}, 0.02}});
     }},
    {"magnification", 0.99e11, 1.01e11, [](Case& c, double x) { c.view.frame.reference_length = x; }},
    // 1.2e-16 sqrt(33.5) / 1e-4.
    {"gradient_opacity", 7.01e-12, 6.88e-12, [](Case& c, double x) { c.scene.gradient_opacity = x; }},
    {"divisor", 1.01e-22, 0.99e-22,
     [](Case& c, double x) {
         c.scene.fields = {ellipsoids(x, x)};
         c.options.precision = Precision::float64;
     }},
    {"sum", 0.99e250, 1.01e250,
     [](Case& c, double x) {
         make_unlit(c);
         c.scene.fields = {ellipsoids(x, x / 33.5)};
     }},
    {"weights_in_slabs", 0.99e11, 1.01e11,
     [](Case& c, double x) {
         c.scene.fields = {ellipsoids(1.0 / x)};
         c.scene.sampling = Sampling::slab;
     }},
    {"lit_ratio", 1.98e10, 2.02e10,
     [](Case& c, double x) {
         c.scene.fields = {lattice(Normalization::threshold, x)};
         c.scene.transfer_function = ramp(0.01, 0.01, x);
     }},
    // 1e-4 / (1.2e-16 / 4 sqrt(33.5)) = 5.76e11.
    {"ratio", 5.7e11, 5.82e11,
     [](Case& c, double x) {
         c.scene.fields = {lattice(Normalization::lattice, x)};
         c.scene.transfer_function = ramp(0.01, 0.01, x);
     }},
};
INSTANTIATE_TEST_SUITE_P(Limits, CpuFloat64, testing::ValuesIn(of_float64), name_of);

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
/// Lit by splatted differences: `pixels` of them to a reference length.
void make_close(Case& one, double pixels) {
    one.view.frame.smallest_pixel = one.view.frame.largest_pixel = one.view.frame.reference_length / pixels;
}
void make_analytic(Case& one) { one.scene.gradient = Gradient::analytic; }
void make_surface(Case& one) {
    one.scene.mode = Mode::isosurface;
    one.scene.iso_values = {0.1};
}
/// Values are no larger than what is resolved: the window, or at isosurfaces their spread.
void set_weight_range(Case& one, double range) {
    const double offset = one.scene.mode == Mode::isosurface ? -0.5 : 0.0;
    one.scene.fields = {ellipsoids(1.0 / range, 1.0, 1.0, 5.0, offset)};
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
    {"alike_lit", 990, 1010, [](Case& c, double x) { c.view.overlap.alike = x; }},
    {"fine_alike_factor", 99, 101,
     [](Case& c, double x) {
         c.options.effects = {{"fine_gradient", true}};
         c.view.overlap.alike = x;
     }},
    {"least_alike", 63.5, 64.5,
     [](Case& c, double x) {
         c.scene.fields = {ellipsoids(1.0, 1.0, 1.0, 5.0, 19.5)};
         c.scene.transfer_function = ramp(0.01, 0.01, 19.5);
         c.view.overlap.alike = x;
     }},
    {"alike_unlit", 0.99e5, 1.01e5,
     [](Case& c, double x) {
         make_unlit(c);
         c.view.overlap.alike = x;
     }},
    {"densest_lit", 1.98e5, 2.02e5, [](Case& c, double x) { c.view.overlap.densest = x; }},
    {"lit_ratio", 39.5, 40.5,
     [](Case& c, double x) {
         EllipsoidArrays arrays;
         arrays.centers = {Vec3(0.0), Vec3(1.0, 0.0, 0.0)};
         arrays.radii = {1.0, 1.0};
         arrays.values = {-x, x};
         c.scene.fields = {std::make_shared<EllipsoidField>(std::move(arrays))};
     }},
    {"full_gradient", 2.02e-4, 1.98e-4,
     [](Case& c, double x) {
         make_unlit(c);
         c.scene.gradient_opacity = x;
     }},
    {"differences_gentle", 49.5, 50.5,
     [](Case& c, double x) {
         make_close(c, 10.0);
         set_weight_range(c, x);
     }},
    {"differences_steep", 693, 707,
     [](Case& c, double x) {
         make_close(c, 10.0);
         c.scene.transfer_function = ramp(20.0, 0.2);
         set_weight_range(c, x);
     }},
    {"derivatives_gentle", 99, 101,
     [](Case& c, double x) {
         make_analytic(c);
         set_weight_range(c, x);
     }},
    // Values of 0.5 to 0.7, beside 0.
    {"nearest_end", 990, 1010,
     [](Case& c, double x) {
         make_analytic(c);
         c.scene.mode = Mode::isosurface;
         c.scene.fields = {ellipsoids()};
         c.scene.iso_values = {IsoValue(0.7 - 0.7 / x)};
     }},
    // The root of 33.5 kernels at a point, times values of 1/2 from their middle, over the semi-axis in reference
    // lengths.
    {"noise_of_derivatives", 34.7, 35.3,
     [](Case& c, double x) {
         make_quotients(c);
         make_analytic(c);
         c.view.screen_px.smallest = 0.5 * std::sqrt(33.5) / x;
     }},
    {"derived_aspect", 63, 65,
     [](Case& c, double x) {
         make_analytic(c);
         c.scene.fields = {ellipsoids()};
         c.view.shapes.largest_aspect = x;
     }},
    {"derivatives_steep", 9900, 10100,
     [](Case& c, double x) {
         make_analytic(c);
         c.scene.transfer_function = ramp(20.0, 0.2);
         set_weight_range(c, x);
     }},
    {"gentle_steepness", 10.1, 9.9,
     [](Case& c, double x) {
         make_close(c, 10.0);
         c.scene.transfer_function = ramp(x, 0.2);
         set_weight_range(c, 300.0);
     }},
    {"gentle_pixels", 101, 99,
     [](Case& c, double x) {
         make_close(c, x);
         set_weight_range(c, 300.0);
     }},
    {"isosurface_gentle", 2.97e4, 3.03e4,
     [](Case& c, double x) {
         make_surface(c);
         make_close(c, 10.0);
         set_weight_range(c, x);
     }},
    {"isosurface_steep", 0.99e5, 1.01e5,
     [](Case& c, double x) {
         make_surface(c);
         make_close(c, 150.0);
         set_weight_range(c, x);
     }},
    // 3e4 over the square of 250 reference lengths over 100.
    {"magnified_isosurface", 4750, 4850,
     [](Case& c, double x) {
         make_surface(c);
         make_close(c, 1000.0);
         set_weight_range(c, x);
     }},
    {"isosurface_of_derivatives", 19.8, 20.2,
     [](Case& c, double x) {
         make_surface(c);
         make_analytic(c);
         make_close(c, 10.0);
         set_weight_range(c, x);
     }},
    {"by_semi_axis_gentle", 39.6, 40.4,
     [](Case& c, double x) {
         make_surface(c);
         make_analytic(c);
         make_close(c, 10.0);
         c.view.screen_px.smallest = 10.0;
         set_weight_range(c, x);
     }},
    {"by_semi_axis_steep", 990, 1010,
     [](Case& c, double x) {
         make_surface(c);
         make_analytic(c);
         make_close(c, 150.0);
         c.view.screen_px.smallest = 150.0;
         set_weight_range(c, x);
     }},
    // 25,000 over the root of 1,000 kernels.
    {"magnified_quotients", 783, 798,
     [](Case& c, double x) {
         make_close(c, x);
         c.view.overlap.densest = 1000.0;
         c.view.frame.slices = 1000;
         c.view.screen_px.smallest = 1.0;
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

TEST(GlChooses, SeparableUpTo) {
    Case one = lit_case();
    one.view.screen_px.largest_lattice = 0.99e6;
    EXPECT_TRUE(one.plan(Backend::gl).separable);
    one.view.screen_px.largest_lattice = 1.01e6;
    EXPECT_FALSE(one.plan(Backend::gl).separable);
}

TEST(GlChooses, CountsFromTheMiddleFrom) {
    for (const auto& [ratio, apart] : {std::pair{1.95, false}, std::pair{2.05, true}}) {
        Case one = ellipsoid_case();
        one.scene.fields = {ellipsoids(1.0, 1.0, 1.0, 5.0, ratio - 0.7)};
        one.scene.transfer_function = ramp(0.01, 0.01, ratio - 0.7);
        EXPECT_EQ(!one.plan(Backend::gl).own_sheets.empty(), apart) << ratio;
    }
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

// ---- quadrature

TEST(SlabNodes, KeepSevenDigits) {
    struct Rule {
        int nodes;
        std::vector<double> at, share;
    };
    // Gauss-Legendre on [-1, 1].
    const std::vector<Rule> rules{{4,
                                   {-0.8611363115940526, -0.3399810435848563, 0.3399810435848563, 0.8611363115940526},
                                   {0.3478548451374538, 0.6521451548625461, 0.6521451548625461, 0.3478548451374538}},
                                  {6,
                                   {-0.9324695142031521, -0.6612093864662645, -0.2386191860831969, 0.2386191860831969,
                                    0.6612093864662645, 0.9324695142031521},
                                   {0.1713244923791704, 0.3607615730481386, 0.4679139345726910, 0.4679139345726910,
                                    0.3607615730481386, 0.1713244923791704}}};
    const auto worst = [](const Rule& rule, double width) {
        double largest = 0.0;
        for (double start = -4.0; start <= 4.0; start += 0.01) {
            double sum = 0.0;
            for (std::size_t n = 0; n < rule.at.size(); ++n) {
                const double x = start + 0.5 * width * (rule.at[n] + 1.0);
                sum += 0.5 * rule.share[n] * std::exp(-x * x);
            }
            const double exact = 0.5 * std::sqrt(std::acos(-1.0)) * (std::erf(start + width) - std::erf(start)) / width;
            largest = std::max(largest, std::abs(sum - exact));
        }
        return largest;
    };
    for (const auto& [rule, widest] : {std::pair{rules[0], four_node_slab}, std::pair{rules[1], six_node_slab}}) {
        EXPECT_EQ(slab_nodes(0.99 * widest), rule.nodes);
        EXPECT_NE(slab_nodes(widest), rule.nodes);
        EXPECT_LT(worst(rule, widest), 2e-8);
        EXPECT_GT(worst(rule, 1.5 * widest), 1e-7) << "the limits are not far too small";
    }
    EXPECT_EQ(slab_nodes(2.0), 0);
    EXPECT_EQ(slab_pieces(0.1), 1);
    EXPECT_EQ(slab_pieces(1.6), 2);
    EXPECT_EQ(slab_pieces(100.0), 4);
}

} // namespace
} // namespace sheetsplat

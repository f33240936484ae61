// Each constant of plan/limits_cpu.hpp and limits_common.hpp: a scene just within it and one just beyond get different
// plans.
#include <vector>

#include <gtest/gtest.h>

#include "support/lattices.hpp"
#include "support/limit_cases.hpp"

namespace sheetsplat {
namespace {

using namespace test;

/// Lit ellipsoids that hardly overlap.
void make_sparse(Case& one) {
    one.view.shapes.largest_aspect = 3.0;
    one.view.overlap.typical = 1.0;
    one.view.screen_px.smallest_ellipsoid = 2.0;
}

/// Kernels that are not divided by their weights.
std::shared_ptr<const Field> undivided_ellipsoids() {
    EllipsoidArrays arrays;
    arrays.centers = {Vec3(0.0), Vec3(1.0, 0.0, 0.0)};
    arrays.scales = {Vec3(1.0), Vec3(1.0)};
    arrays.values = {1.0, 0.5};
    EllipsoidFieldOptions options;
    options.normalization = Normalization::none;
    return std::make_shared<EllipsoidField>(std::move(arrays), options);
}

std::shared_ptr<const Field> flat_lattice() {
    return std::make_shared<RegularField>(std::vector<double>(8, 1.0), std::array<std::size_t, 3>{2, 2, 2},
                                          test::zero_boundary());
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
    // 400^(-2/3): values of a block of samples reach over the whole window.
    {"close_pixels", 0.0186, 0.0182, [](Case& c, double x) { c.view.frame.smallest_pixel = x; }},
    {"close_slices", 0.0186, 0.0182, [](Case& c, double x) { c.view.frame.slice_spacing = x; }},
    // The same of values that do not change: times 0.003^(-1/3).
    {"close_pixels_of_flat_fields", 0.1287, 0.1269,
     [](Case& c, double x) {
         c.scene.fields = {flat_lattice()};
         c.view.frame.smallest_pixel = x;
     }},
    {"close_pixels_of_scattered_kernels", 0.1287, 0.1269,
     [](Case& c, double x) {
         c.scene.fields = {undivided_ellipsoids()};
         c.view.frame.smallest_pixel = x;
     }},
    {"noise_of_sums", 396, 404,
     [](Case& c, double x) {
         c.scene.transfer_function = TransferFunction({{0.0, {1, 1, 1}, 0.0}, {1.0 / x, {1, 1, 1}, 0.01}});
     }},
    {"steep_noise_of_sums", 0.00635, 0.00625,
     [](Case& c, double x) {
         c.scene.transfer_function = ramp(20.0, 0.2);
         c.view.frame.smallest_pixel = x;
     }},
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
         make_unlit(c);
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
    {"lit_noise", 7.92, 8.08,
     [](Case& c, double x) {
         make_quotients(c);
         c.view.frame.smallest_pixel = 0.2;
         c.scene.transfer_function = TransferFunction({{0.0, {1, 1, 1}, 0.0}, {5.0 / x, {1, 1, 1}, 0.01}});
     }},
    {"steep_lit_noise", 15.9, 16.1,
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
    {"nearest_end_of_surfaces", 0.99e6, 1.01e6,
     [](Case& c, double x) {
         c.scene.mode = Mode::isosurface;
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
         c.scene.fields = {std::make_shared<RegularField>(std::vector<double>(8, x),
                                                          std::array<std::size_t, 3>{2, 2, 2}, test::zero_boundary())};
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
    {"weights_in_slabs", 1.48e11, 1.52e11,
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

} // namespace
} // namespace sheetsplat

// Each constant of plan/limits_cpu.hpp and limits_common.hpp: a scene just within it and one just beyond get different
// plans.
#include <vector>

#include <gtest/gtest.h>

#include "support/lattices.hpp"
#include "support/limit_cases.hpp"

namespace sheetsplat {
namespace {

using namespace test;

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
    {"slices", 16384, 16385, [](Case& c, double x) { c.view.frame.slices = static_cast<std::int64_t>(x); }},
    {"aspect", 510, 514, [](Case& c, double x) { c.view.shapes.largest_aspect = x; }},
    {"px", 0.0505, 0.0495, [](Case& c, double x) { c.view.screen_px.smallest = x; }},
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

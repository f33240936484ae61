// Scattered ellipsoids on the backends gl and cpu against the float64 reference.
#include <functional>
#include <map>
#include <string>
#include <tuple>

#include <gtest/gtest.h>

#include "support/ellipsoid_scenes.hpp"

namespace sheetsplat {
namespace {

using namespace testing;

constexpr Projection ortho = Projection::orthographic;
constexpr Projection persp = Projection::perspective;

Camera fitted(const Field& field, Projection projection, double margin) {
    return Camera::fit(field.supports_world(), Vec3(-0.5, -0.35, -0.8), Vec3(0, 1, 0), projection, margin, 40.0);
}

class Ellipsoids : public ::testing::TestWithParam<std::tuple<double, Mode, Sampling, Projection>> {};

TEST_P(Ellipsoids, AreTheReferencesPicture) {
    const auto [aspect, mode, sampling, projection] = GetParam();
    const auto field = cloud(120, 0.14, aspect);
    Scene scene = scene_of(field);
    scene.mode = mode;
    scene.sampling = sampling;
    scene.iso_values = {0.4};
    scene.slice_spacing = 0.03;
    const std::string name = "aspect " + std::to_string(static_cast<int>(aspect)) +
                             (mode == Mode::composite    ? " composite"
                              : mode == Mode::isosurface ? " iso"
                                                         : " xray") +
                             (sampling == Sampling::slab ? " slab" : " point") +
                             (projection == Projection::perspective ? " persp " : " ortho ");
    const Judged view(scene, fitted(*field, projection, 0.8), {56, 48});
    const bool jumps = mode == Mode::isosurface;
    for (const Way way : ways()) {
        const Difference difference = view.from(options_of(way), name + to_string(way));
        EXPECT_LT(difference.rmse, jumps ? 1e-4 : 2e-5) << to_string(way);
        EXPECT_LT(difference.p99_9, jumps ? 1e-3 : 2e-4) << to_string(way);
    }
}

INSTANTIATE_TEST_SUITE_P(All, Ellipsoids,
                         ::testing::Combine(::testing::Values(1.0, 5.0, 1000.0),
                                            ::testing::Values(Mode::composite, Mode::isosurface, Mode::xray),
                                            ::testing::Values(Sampling::point, Sampling::slab),
                                            ::testing::Values(Projection::orthographic, Projection::perspective)));

class EllipsoidDrawing : public ::testing::TestWithParam<Draw> {};

/// One view of each cloud for all ways of drawing it.
const Judged& saturating_view(double aspect, Projection projection) {
    static std::map<std::pair<double, Projection>, Judged> made;
    const std::pair key{aspect, projection};
    auto found = made.find(key);
    if (found == made.end()) {
        const auto field = cloud(300, 0.16, aspect);
        Scene scene = scene_of(field);
        // What looks for opaque pixels has some to find.
        scene.transfer_function = saturating();
        scene.slice_spacing = 0.02;
        found = made.emplace(key, Judged(scene, fitted(*field, projection, 0.7), {61, 47})).first;
    }
    return found->second;
}

TEST_P(EllipsoidDrawing, IsTheReferencesPicture) {
    const Draw& draw = GetParam();
    if (draw.backend == Backend::gl && !gl_available()) {
        GTEST_SKIP() << "no OpenGL context can be made here";
    }
    for (const double aspect : {1.0, 20.0}) {
        for (const Projection projection : {Projection::orthographic, Projection::perspective}) {
            Difference difference;
            try {
                difference = saturating_view(aspect, projection)
                                 .from(options_of(draw), std::string(draw.name) + " aspect " + std::to_string(aspect));
            } catch (const Unsupported& error) {
                if (draw.tagging == Tagging::depth_bounds) {
                    GTEST_SKIP() << error.what();
                }
                throw;
            }
            EXPECT_LT(difference.rmse, 2e-5);
            EXPECT_LT(difference.p99_9, 2e-4);
        }
    }
}

INSTANTIATE_TEST_SUITE_P(
    All, EllipsoidDrawing,
    ::testing::Values(
        Draw{"wide tiles", Packing::wide, Tagging::tiles}, Draw{"wide off", Packing::wide, Tagging::off},
        Draw{"wide equal", Packing::wide, Tagging::depth_equal},
        Draw{"wide depth_bounds", Packing::wide, Tagging::depth_bounds},
        Draw{"paper equal", Packing::paper, Tagging::depth_equal}, Draw{"paper off", Packing::paper, Tagging::off},
        Draw{"wide elimination", Packing::wide, Tagging::tiles, {{"elimination", true}}},
        Draw{"no elimination", Packing::wide, Tagging::tiles, {{"elimination", false}}},
        Draw{"paper elimination", Packing::paper, Tagging::depth_equal, {{"elimination", true}}},
        Draw{"restarted tags", Packing::wide, Tagging::depth_equal, {}, 0, 3},
        Draw{"small tiles", Packing::wide, Tagging::tiles, {}, 17},
        Draw{"small tiles of paper", Packing::paper, Tagging::tiles, {}, 17},
        Draw{"resident", Packing::wide, Tagging::tiles, {{"resident_sections", true}}},
        Draw{"resident in paper", Packing::paper, Tagging::depth_equal, {{"resident_sections", true}}},
        Draw{"resident in small tiles", Packing::wide, Tagging::tiles, {{"resident_sections", true}}, 17},
        Draw{
            "resident and fine", Packing::wide, Tagging::tiles, {{"resident_sections", true}, {"fine_gradient", true}}},
        Draw{"opacity buffer", Packing::wide, Tagging::tiles, {{"opacity_buffer", true}}},
        Draw{"no culling", Packing::wide, Tagging::tiles, {{"culling", false}}},
        Draw{"fine", Packing::wide, Tagging::tiles, {{"fine_gradient", true}}, 0, 0},
        Draw{"everything",
             Packing::wide,
             Tagging::depth_equal,
             {{"empty_test", true},
              {"weight", true},
              {"specular", true},
              {"opacity_correction", true},
              {"opacity_stop", true},
              {"compensation", true}}},
        on_cpu("cpu"), on_cpu("cpu in small tiles", 17), on_cpu("cpu in tiny tiles", 8),
        on_cpu("cpu float64", 0, Precision::float64), on_cpu("cpu float64 in small tiles", 17, Precision::float64),
        on_cpu("cpu one thread", 0, Precision::automatic, 1), on_cpu("cpu five threads", 17, Precision::automatic, 5),
        on_cpu("cpu no culling", 0, Precision::automatic, 0, {{"culling", false}}),
        on_cpu("cpu everything", 0, Precision::automatic, 0,
               {{"empty_test", true},
                {"weight", true},
                {"specular", true},
                {"opacity_correction", true},
                {"opacity_stop", true}})));

struct View {
    const char* name;
    std::function<std::pair<Scene, Camera>()> make;
    double rmse = 2e-5, p99_9 = 2e-4;
    Size size{50, 44};
};
std::ostream& operator<<(std::ostream& out, const View& view) { return out << view.name; }

class EllipsoidCase : public ::testing::TestWithParam<View> {};

TEST_P(EllipsoidCase, IsTheReferencesPicture) {
    const auto [scene, camera] = GetParam().make();
    Outputs outputs;
    outputs.coverage = scene.fields.size() == 1;
    const Judged view(scene, camera, GetParam().size, outputs);
    for (const Way way : ways()) {
        const Difference difference =
            view.from(options_of(way), std::string(GetParam().name) + " " + to_string(way), way != Way::paper);
        EXPECT_LT(difference.rmse, GetParam().rmse);
        EXPECT_LT(difference.p99_9, GetParam().p99_9);
    }
}

std::pair<Scene, Camera> seen(const std::shared_ptr<const Field>& field, Projection projection,
                              const std::function<void(Scene&)>& change = {}) {
    Scene scene = scene_of(field);
    if (change) {
        change(scene);
    }
    return {scene, fitted(*field, projection, 0.8)};
}

TransferFunction for_low_sums() { return TransferFunction({{0.0, {0.9, 0.1, 0.1}, 0.0}, {0.3, {1.0, 0.8, 0.2}, 0.4}}); }

INSTANTIATE_TEST_SUITE_P(
    All, EllipsoidCase,
    ::testing::Values(
        View{"weights", [] { return seen(cloud(200, 0.14, 5.0, 7, {}, true), ortho); }},
        View{"small w0",
             [] { return seen(cloud(200, 0.14, 5.0, 7, normalized(Normalization::threshold, 0.05)), persp); }},
        View{"none", [] { return seen(cloud(200, 0.1, 5.0, 7, normalized(Normalization::none)), ortho); }},
        View{"opaque at 0",
             [] { return seen(cloud(60, 0.14, 3.0), ortho, [](Scene& s) { s.transfer_function = opaque_at_0(); }); },
             1e-4, 1e-3},
        View{"preintegrated",
             [] { return seen(cloud(100, 0.14, 3.0), persp, [](Scene& s) { s.preintegration = true; }); }},
        View{"ewa",
             [] {
                 return seen(cloud(200, 0.02, 10.0), ortho, [](Scene& s) {
                     s.filter = Filter::ewa;
                     s.transfer_function = for_low_sums();
                 });
             }},
        View{"ewa slab",
             [] {
                 return seen(cloud(200, 0.02, 10.0), persp, [](Scene& s) {
                     s.filter = Filter::ewa;
                     s.sampling = Sampling::slab;
                     s.transfer_function = for_low_sums();
                 });
             }},
        View{"ewa of a lattice",
             [] {
                 return seen(lattice(Normalization::lattice, Lattice::bcc), persp,
                             [](Scene& s) { s.filter = Filter::ewa; });
             }},
        View{"two quotients",
             [] {
                 return seen(cloud(100, 0.14, 5.0, 7), ortho,
                             [](Scene& s) { s.fields.push_back(cloud(100, 0.1, 2.0, 8)); });
             }},
        View{"cartesian, bcc and ellipsoids",
             [] {
                 return seen(cloud(100, 0.14, 5.0, 7), persp, [](Scene& s) {
                     s.fields.push_back(lattice(Normalization::lattice));
                     s.fields.push_back(lattice(Normalization::threshold, Lattice::bcc));
                     s.sampling = Sampling::slab;
                 });
             }},
        View{"three fields, opaque at 0",
             [] {
                 return seen(cloud(40, 0.14, 5.0, 7), ortho, [](Scene& s) {
                     s.fields.push_back(lattice(Normalization::lattice));
                     s.fields.push_back(cloud(40, 0.1, 2.0, 8));
                     s.transfer_function = opaque_at_0();
                 });
             },
             1e-4, 1e-3},
        View{"far away", [] { return seen(moved(1.0, Vec3(1e9, -2e9, 0.5e9)), ortho); }, 1e-4, 1e-3},
        View{"tiny world",
             [] { return seen(moved(1e-6, Vec3(0.0)), persp, [](Scene& s) { s.slice_spacing = 0.03e-6; }); }},
        View{"huge world",
             [] { return seen(moved(1e6, Vec3(0.0)), ortho, [](Scene& s) { s.slice_spacing = 0.03e6; }); }},
        View{"close-up",
             [] {
                 auto [scene, camera] = seen(cloud(200, 0.14, 5.0), ortho);
                 return std::pair<Scene, Camera>{
                     scene, Camera::orthographic({0.5, 0.5, 3.0}, {0.5, 0.5, 0.0}, {0, 1, 0}, 1e-3)};
             }},
        View{"close-up of slabs",
             [] {
                 auto [scene, camera] =
                     seen(cloud(200, 0.14, 5.0), persp, [](Scene& s) { s.sampling = Sampling::slab; });
                 return std::pair<Scene, Camera>{
                     scene, Camera::perspective({0.5, 0.5, 3.0}, {0.5, 0.5, 0.0}, {0, 1, 0}, 0.02)};
             },
             2e-5,
             2e-4,
             {16, 14}},
        View{"thin slices",
             [] {
                 return seen(cloud(30, 0.14, 5.0), persp, [](Scene& s) {
                     s.slice_spacing = 0.002;
                     s.reference_length = 0.03;
                 });
             }},
        View{"inside",
             [] {
                 auto [scene, camera] = seen(cloud(200, 0.2, 5.0), persp);
                 return std::pair<Scene, Camera>{
                     scene, Camera::perspective({0.5, 0.5, 0.5}, {0.5, 0.6, 0.0}, {0, 1, 0}, 80.0)};
             },
             1e-4, 1e-3},
        View{"inside, slabs",
             [] {
                 auto [scene, camera] =
                     seen(cloud(200, 0.2, 5.0), persp, [](Scene& s) { s.sampling = Sampling::slab; });
                 return std::pair<Scene, Camera>{
                     scene, Camera::perspective({0.5, 0.5, 0.5}, {0.5, 0.6, 0.0}, {0, 1, 0}, 80.0)};
             },
             1e-4,
             1e-3,
             {26, 22}},
        View{"needles of 1:100,000",
             [] {
                 const auto needles = cloud(3000, 0.05, 1e5, 5, normalized(Normalization::none));
                 auto [scene, camera] = seen(needles, persp, [](Scene& s) { s.transfer_function = for_low_sums(); });
                 return std::pair<Scene, Camera>{scene, Camera::fit(Box{Vec3(0.0), Vec3(1.0)}, Vec3(-0.5, -0.35, -0.8),
                                                                    Vec3(0, 1, 0), persp, 1.0, 40.0)};
             },
             1e-4, 1e-3}));

} // namespace
} // namespace sheetsplat

// The backends gl and cpu against the float64 reference, over everything that a regular field can be asked for.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <random>
#include <string>

#include <gtest/gtest.h>

#include "sheetsplat/error.hpp"
#include "support/against_reference.hpp"
#include "support/lattices.hpp"

namespace sheetsplat {
namespace {

using namespace testing;

/// A soft random volume: a few blobs, some noise.
std::shared_ptr<const RegularField> blobs(RegularFieldOptions options, std::size_t n = 14, unsigned seed = 3) {
    std::mt19937 random(seed);
    std::uniform_real_distribution<double> uniform(0.0, 1.0);
    std::vector<float> samples(n * n * n);
    std::vector<std::array<double, 5>> centres;
    for (int b = 0; b < 5; ++b) {
        centres.push_back({uniform(random) * double(n), uniform(random) * double(n), uniform(random) * double(n),
                           1.5 + 2.0 * uniform(random), 0.4 + 0.6 * uniform(random)});
    }
    for (std::size_t k = 0; k < n; ++k) {
        for (std::size_t j = 0; j < n; ++j) {
            for (std::size_t i = 0; i < n; ++i) {
                double value = 0.0;
                for (const auto& c : centres) {
                    const double d2 =
                        std::pow(double(i) - c[0], 2) + std::pow(double(j) - c[1], 2) + std::pow(double(k) - c[2], 2);
                    value += c[4] * std::exp(-d2 / (2 * c[3] * c[3]));
                }
                samples[(k * n + j) * n + i] = static_cast<float>(value + 0.02 * uniform(random));
            }
        }
    }
    return std::make_shared<RegularField>(std::move(samples), std::array<std::size_t, 3>{n, n, n}, options);
}

TransferFunction ramp() {
    return TransferFunction({{0.1, {0.1, 0.2, 0.9}, 0.0}, {0.5, {0.2, 0.9, 0.3}, 0.15}, {1.1, {1.0, 0.8, 0.2}, 0.6}});
}

Scene scene_of(const std::shared_ptr<const RegularField>& field) {
    Scene scene{{field}, ramp()};
    scene.lights = {Light{{0.3, 0.5, 1.0}, {1.0, 1.0, 1.0}, LightSpace::eye}};
    scene.material = Material{0.2, 0.7, 0.3, 20.0, false};
    return scene;
}

Camera askew(const Field& field, Projection projection) {
    return Camera::fit(field.supports_world(), Vec3(-0.5, -0.35, -0.8), Vec3(0, 1, 0), projection, 1.0, 40.0);
}

/// Something to see is in all of these pictures.
Judged judged(const Scene& scene, const Camera& camera, Size size, const Outputs& outputs = {}) {
    return {scene, camera, size, outputs, 0.05};
}

/// Options of each backend that is here.
std::vector<RendererOptions> each_backend() {
    std::vector<RendererOptions> all;
    if (gl_available()) {
        all.push_back(options_of(Way::wide));
    }
    all.push_back(options_of(Way::cpu));
    return all;
}

class Matrix : public ::testing::TestWithParam<std::tuple<Mode, Sampling, Projection, Lattice, Normalization>> {};

TEST_P(Matrix, IsTheReferencesPicture) {
    const auto [mode, sampling, projection, lattice, normalization] = GetParam();
    RegularFieldOptions field_options = test::zero_boundary();
    field_options.lattice = lattice;
    field_options.normalization = normalization;
    field_options.spacing = lattice == Lattice::bcc ? Vec3(1.2) : Vec3(1.0, 1.0, 1.0);
    auto field = blobs(field_options);
    Scene scene = scene_of(field);
    scene.mode = mode;
    scene.sampling = sampling;
    scene.iso_values = {0.45};
    if (normalization == Normalization::none) {
        const double c = field->lattice_constant();
        scene.transfer_function = TransferFunction(
            {{0.1 * c, {0.1, 0.2, 0.9}, 0.0}, {0.5 * c, {0.2, 0.9, 0.3}, 0.15}, {1.1 * c, {1.0, 0.8, 0.2}, 0.6}});
        scene.iso_values = {0.45 * c};
    }
    const std::string name = std::string(mode == Mode::composite    ? "composite"
                                         : mode == Mode::isosurface ? "iso"
                                         : mode == Mode::xray       ? "xray"
                                                                    : "mip") +
                             (sampling == Sampling::slab ? " slab" : " point") +
                             (projection == Projection::perspective ? " persp" : " ortho") +
                             (lattice == Lattice::bcc ? " bcc" : " cart") +
                             (normalization == Normalization::none      ? " none"
                              : normalization == Normalization::lattice ? " lattice"
                                                                        : " threshold");
    const Judged view = judged(scene, askew(*field, projection), {48, 40});
    const bool jumps = mode == Mode::isosurface;
    for (const Way way : ways()) {
        const Difference difference = view.from(options_of(way), name + " " + to_string(way));
        EXPECT_LT(difference.rmse, jumps ? 1e-4 : 2e-5) << to_string(way);
        EXPECT_LT(difference.p99_9, jumps ? 1e-3 : 2e-4) << to_string(way);
    }
}

INSTANTIATE_TEST_SUITE_P(All, Matrix,
                         ::testing::Combine(::testing::Values(Mode::composite, Mode::isosurface, Mode::xray, Mode::mip),
                                            ::testing::Values(Sampling::point, Sampling::slab),
                                            ::testing::Values(Projection::orthographic, Projection::perspective),
                                            ::testing::Values(Lattice::cartesian, Lattice::bcc),
                                            ::testing::Values(Normalization::none, Normalization::lattice,
                                                              Normalization::threshold)));

class Drawing : public ::testing::TestWithParam<Draw> {};

/// Saturates, so that everything that looks for opaque pixels has something to find.
Scene dense(const std::shared_ptr<const RegularField>& field) {
    Scene scene = scene_of(field);
    scene.transfer_function =
        TransferFunction({{0.1, {0.1, 0.2, 0.9}, 0.0}, {0.3, {0.2, 0.9, 0.3}, 0.5}, {1.1, {1.0, 0.8, 0.2}, 0.9}});
    return scene;
}

/// One view of the dense scene for all ways of drawing it.
const Judged& dense_view(Mode mode, Projection projection) {
    static std::map<std::pair<Mode, Projection>, Judged> made;
    const std::pair key{mode, projection};
    auto found = made.find(key);
    if (found == made.end()) {
        const auto field = blobs({});
        Scene scene = dense(field);
        scene.mode = mode;
        scene.iso_values = {0.45};
        found = made.emplace(key, judged(scene, askew(*field, projection), {48, 44})).first;
    }
    return found->second;
}

TEST_P(Drawing, IsTheReferencesPicture) {
    const Draw& draw = GetParam();
    if (draw.backend == Backend::gl && !gl_available()) {
        GTEST_SKIP() << "no OpenGL context can be made here";
    }
    const RendererOptions options = options_of(draw);
    if (draw.tagging == Tagging::depth_bounds) {
        try {
            Renderer probe(options);
            auto field = blobs({});
            static_cast<void>(probe.plan(scene_of(field), askew(*field, Projection::orthographic), {8, 8}));
        } catch (const Unsupported&) {
            GTEST_SKIP() << "the device has no depth-bounds test";
        }
    }
    // A way of drawing meets each mode in one projection, and in the other one with elimination; `Matrix` has all
    // pairs.
    const auto found = draw.effects.find("elimination");
    const bool swapped = found != draw.effects.end() && found->second;
    for (const Projection projection : {Projection::orthographic, Projection::perspective}) {
        const Mode mode = (projection == Projection::orthographic) == swapped ? Mode::isosurface : Mode::composite;
        const Difference difference =
            dense_view(mode, projection)
                .from(options, std::string(draw.name) + (mode == Mode::composite ? " composite" : " iso") +
                                   (projection == Projection::perspective ? " persp" : " ortho"));
        EXPECT_LT(difference.rmse, 1e-4) << draw.name;
        EXPECT_LT(difference.p99_9, 1e-3) << draw.name;
    }
}

std::vector<Draw> draws() {
    const std::map<std::string, bool> everything{{"weight", true},       {"empty_test", true},
                                                 {"specular", true},     {"opacity_correction", true},
                                                 {"opacity_stop", true}, {"general_sections", true}};
    std::vector<Draw> list;
    for (const Packing packing : {Packing::wide, Packing::paper}) {
        for (const Tagging tagging : {Tagging::off, Tagging::tiles, Tagging::depth_equal, Tagging::depth_bounds}) {
            for (const bool elimination : {false, true}) {
                const std::map<std::string, bool> effects{{"elimination", elimination}};
                static std::vector<std::string> names;
                names.reserve(200);
                const auto add = [&](const std::string& more, std::map<std::string, bool> with, int tile, int tags) {
                    names.push_back(std::string(to_string(packing)) + " " + to_string(tagging) +
                                    (elimination ? " elimination" : "") + more);
                    with.insert(effects.begin(), effects.end());
                    list.push_back({names.back().c_str(), packing, tagging, with, tile, tags});
                };
                add("", {}, 0, 0);
                add(" in tiles", {}, 21, 0);
                if (tagging == Tagging::depth_equal || tagging == Tagging::depth_bounds) {
                    add(" restarted tags", {}, 0, 3);
                }
                if (tagging == Tagging::tiles) {
                    add(" opacity buffer", {{"opacity_buffer", true}}, 0, 0);
                    add(" everything on", everything, 0, 0);
                    add(" no culling", {{"culling", false}}, 0, 0);
                    add(" fine gradient", {{"fine_gradient", true}}, 0, 0);
                    add(" fine gradient and weights", {{"fine_gradient", true}, {"weight", true}}, 0, 0);
                }
            }
        }
    }
    for (const Draw& draw :
         {on_cpu("cpu"), on_cpu("cpu in tiles", 21), on_cpu("cpu in small tiles", 8),
          on_cpu("cpu float64", 0, Precision::float64), on_cpu("cpu float64 in tiles", 21, Precision::float64),
          on_cpu("cpu one thread", 0, Precision::automatic, 1), on_cpu("cpu five threads", 17, Precision::automatic, 5),
          on_cpu("cpu no culling", 0, Precision::automatic, 0, {{"culling", false}}),
          on_cpu("cpu everything on", 0, Precision::automatic, 0, everything)}) {
        list.push_back(draw);
    }
    return list;
}

INSTANTIATE_TEST_SUITE_P(All, Drawing, ::testing::ValuesIn(draws()), [](const auto& parameter) {
    std::string name = parameter.param.name;
    std::replace(name.begin(), name.end(), ' ', '_');
    return name;
});

// The bounds above must be able to fail: pictures that are wrong by a little lie outside.
TEST(AgainstReference, PicturesThatAreWrongByALittleFail) {
    auto field = blobs({});
    const Scene right = scene_of(field);
    const Camera camera = askew(*field, Projection::orthographic);
    RendererOptions exact;
    exact.backend = Backend::reference;
    Renderer reference(exact);
    const Image judge = reference.render(right, camera, {48, 40});
    const auto error_of = [&](const Scene& wrong, const Camera& from) {
        return compare(reference.render(wrong, from, {48, 40}).rgba, judge.rgba, 4).rmse;
    };
    EXPECT_EQ(error_of(right, camera), 0.0);
    RegularFieldOptions options = test::zero_boundary();
    options.falloff = 5.05;
    EXPECT_GT(error_of(scene_of(blobs(options)), camera), 2e-5) << "falloff";
    Scene wrong = right;
    wrong.lights[0].direction.x += 1e-3;
    EXPECT_GT(error_of(wrong, camera), 2e-5) << "light";
    wrong = right;
    wrong.slice_spacing = right.slice_distance() * 1.001;
    EXPECT_GT(error_of(wrong, camera), 2e-5) << "slice spacing";
    wrong = right;
    wrong.transfer_function =
        TransferFunction({{0.1, {0.1, 0.2, 0.9}, 0.0}, {0.5, {0.2, 0.9, 0.3}, 0.1502}, {1.1, {1.0, 0.8, 0.2}, 0.6}});
    EXPECT_GT(error_of(wrong, camera), 2e-5) << "opacity";
    const Vec3 aside = camera.eye() + 1e-3 * camera.right_world();
    EXPECT_GT(error_of(right, Camera::orthographic(aside, camera.target() + 1e-3 * camera.right_world(), camera.up(),
                                                   camera.height())),
              2e-5)
        << "camera";
}

TEST(AgainstReference, OpacityBufferDropsKernelsAndNoPixel) {
    if (!gl_available()) {
        GTEST_SKIP() << "no OpenGL context can be made here";
    }
    auto field = blobs({}, 24);
    Scene scene = dense(field);
    scene.transfer_function =
        TransferFunction({{0.05, {0.1, 0.2, 0.9}, 0.0}, {0.1, {0.2, 0.9, 0.3}, 0.9}, {1.1, {1.0, 0.8, 0.2}, 1.0}});
    RendererOptions options;
    options.backend = Backend::gl;
    const Camera camera = Camera::fit(field->supports_world(), Vec3(0, 0, -1), Vec3(0, 1, 0));
    scene.slice_spacing = 0.5;
    const Image plain = Renderer(options).render(scene, camera, {96, 96});
    options.effects = {{"opacity_buffer", true}};
    const Image buffered = Renderer(options).render(scene, camera, {96, 96});
    std::printf("opacity buffer: %.0f kernels hidden of %.0f\n", buffered.stats.at("kernels_hidden"),
                buffered.stats.at("kernels_drawn"));
    EXPECT_GT(buffered.stats.at("kernels_hidden"), 0.0);
    EXPECT_LT(compare(buffered.rgba, plain.rgba, 4).maximum, 1e-6);
}

TEST(AgainstReference, ThickSlabsReachWhereTheirChordsDo) {
    // Opacity above 0 at 0: a point that a support just meets is not empty, however little it adds.
    for (const auto& [spacing, falloff] : {std::pair{1.0, 20.0}, {2.0, 5.0}, {1.0, 10.0}}) {
        RegularFieldOptions options = test::zero_boundary();
        options.falloff = falloff;
        Scene scene = scene_of(blobs(options));
        scene.sampling = Sampling::slab;
        scene.slice_spacing = spacing;
        scene.lights.clear();
        scene.opacity_stop = 1.0;
        scene.transfer_function = TransferFunction({{0.0, {0.1, 0.2, 0.9}, 0.1}, {1.1, {1.0, 0.8, 0.2}, 0.2}});
        const Judged view = judged(scene, askew(*scene.fields[0], Projection::orthographic), {64, 64});
        for (const RendererOptions& backend : each_backend()) {
            const Difference difference = view.from(backend, "thick slabs, falloff " + std::to_string(falloff));
            EXPECT_LT(difference.maximum, 1e-3);
            EXPECT_LT(difference.rmse, 2e-5);
        }
    }
}

TEST(AgainstReference, OpaqueIntervalsKeepTheirAbsorption) {
    auto field = blobs({});
    Scene scene = scene_of(field);
    scene.preintegration = true;
    scene.reference_length = 10.0;
    scene.opacity_stop = 1.0;
    scene.transfer_function = TransferFunction({{0.1, {0.1, 0.2, 0.9}, 0.0}, {0.3, {0.2, 0.9, 0.3}, 1.0}});
    const Judged view = judged(scene, askew(*field, Projection::orthographic), {48, 40});
    for (RendererOptions options : each_backend()) {
        for (const bool compensated : {false, true}) {
            if (compensated && options.backend == Backend::cpu) {
                continue;
            }
            options.effects = {{"compensation", compensated}};
            const Difference difference =
                view.from(options, compensated ? "opaque intervals, compensated" : "opaque intervals");
            EXPECT_LT(difference.rmse, 2e-5);
            EXPECT_LT(difference.p99_9, 2e-4);
        }
    }
}

TEST(AgainstReference, NarrowWindowsFarFromZeroAreDrawnInFloat64) {
    RegularFieldOptions field_options = test::zero_boundary();
    field_options.normalization = Normalization::threshold;
    std::vector<float> samples(6 * 6 * 6);
    for (std::size_t n = 0; n < samples.size(); ++n) {
        samples[n] = 100000.0F + static_cast<float>(n % 7) / 7.0F;
    }
    auto field = std::make_shared<RegularField>(std::move(samples), std::array<std::size_t, 3>{6, 6, 6}, field_options);
    Scene scene = scene_of(field);
    scene.transfer_function = TransferFunction({{100000.0, {1, 1, 1}, 0.0}, {100001.0, {1, 0, 0}, 0.5}});
    scene.iso_values = {100000.5};
    RendererOptions options;
    const Camera camera = askew(*field, Projection::orthographic);
    for (const Mode mode : {Mode::composite, Mode::isosurface}) {
        scene.mode = mode;
        if (gl_available()) {
            options.backend = Backend::gl;
            EXPECT_EQ(Renderer(options).plan(scene, camera, {16, 16}).backend, Backend::cpu) << "handed over";
        }
        options.backend = Backend::cpu;
        EXPECT_TRUE(Renderer(options).plan(scene, camera, {16, 16}).has("float64"));
        EXPECT_LT(judged(scene, camera, {16, 16}).from(options, "narrow window").rmse, 1e-4);
        options.precision = Precision::float32;
        EXPECT_THROW(static_cast<void>(Renderer(options).render(scene, camera, {16, 16})), Unsupported);
        options.precision = Precision::automatic;
    }
}

TEST(AgainstReference, ExtremesAreRightOrRefused) {
    auto field = blobs(test::zero_boundary());
    const Scene unlit = [&] {
        Scene scene = scene_of(field);
        scene.lights.clear();
        return scene;
    }();
    const Vec3 centre = field->centres_world().centre();
    const auto look = [&](double height, double distance) {
        return Camera::orthographic(centre + Vec3(0, 0, distance), centre, Vec3(0, 1, 0), height);
    };
    for (const RendererOptions& options : each_backend()) {
        const auto error = [&](const Scene& scene, const Camera& camera, const std::string& name) {
            return judged(scene, camera, {32, 32}).from(options, name);
        };
        // Magnified until a kernel spans a thousand million pixels; beyond a bound, refused.
        for (const double height : {1e-3, 1e-6, 1e-8}) {
            EXPECT_LT(error(unlit, look(height, 30.0), "height " + std::to_string(std::log10(height))).rmse, 1e-4);
        }
        Renderer renderer(options);
        EXPECT_THROW(static_cast<void>(renderer.render(unlit, look(1e-20, 30.0), {32, 32})), Unsupported);
        // So far away that float32 does not know where a kernel lies on the screen.
        EXPECT_TRUE(renderer.plan(unlit, look(1e5, 30.0), {33, 33}).has("float64"));
        // Depths that float64 cannot tell apart.
        EXPECT_THROW(static_cast<void>(renderer.render(unlit, look(12.0, 1e17), {32, 32})), InvalidInput);
        EXPECT_LT(error(unlit, look(16.0, 1e8), "far eye").rmse, 1e-4);
        // A reference length that float32 cannot hold.
        Scene tiny = unlit;
        tiny.reference_length = 1e-40;
        EXPECT_LT(error(tiny, look(16.0, 30.0), "tiny reference length").p99_9, 1e-3);
        // A stop that float32 cannot hold: pixels stop at their first opacity, but they are not black.
        Scene stop = unlit;
        stop.opacity_stop = 1e-40;
        const Image stopped = renderer.render(stop, look(16.0, 30.0), {32, 32});
        EXPECT_GT(*std::max_element(stopped.rgba.begin(), stopped.rgba.end()), 0.01F);
        RegularFieldOptions flat = test::zero_boundary();
        flat.falloff = 0.05;
        Scene flat_scene = unlit;
        flat_scene.fields = {blobs(flat)};
        EXPECT_LT(error(flat_scene, look(16.0, 30.0), "falloff 0.05").rmse, 1e-4);
        flat.falloff = 1e-6;
        flat_scene.fields = {blobs(flat)};
        if (options.backend == Backend::gl) {
            EXPECT_EQ(renderer.plan(flat_scene, look(16.0, 30.0), {32, 32}).backend, Backend::cpu) << "handed over";
        } else {
            EXPECT_LT(error(flat_scene, look(16.0, 30.0), "falloff 1e-6").rmse, 1e-4);
        }
    }
}

TEST(AgainstReference, PreintegrationCoverageDepthAndBackground) {
    auto field = blobs({});
    for (const Projection projection : {Projection::orthographic, Projection::perspective}) {
        for (const bool preintegration : {false, true}) {
            Scene scene = dense(field);
            scene.preintegration = preintegration;
            scene.slice_spacing = 1.7;
            scene.background = Vec3(0.2, 0.3, 0.4);
            scene.transfer_function = TransferFunction(
                {{-0.2, {0, 0, 1}, 0.05}, {0.3, {0, 1, 0}, 0.05}, {0.3, {1, 1, 0}, 0.5}, {0.8, {1, 0, 0}, 1.0}});
            const Judged view = judged(scene, askew(*field, projection), {48, 40}, {true, true});
            for (const RendererOptions& options : each_backend()) {
                const Difference difference =
                    view.from(options, std::string("all outputs") + (preintegration ? " preintegrated" : "") +
                                           (projection == Projection::perspective ? " persp" : " ortho"));
                EXPECT_LT(difference.rmse, 1e-4);
                EXPECT_LT(difference.p99_9, 1e-3);
            }
        }
    }
}

class CloseUps : public ::testing::TestWithParam<std::tuple<Projection, Sampling>> {};

TEST_P(CloseUps, AreTheReferencesPicture) {
    const auto [projection, sampling] = GetParam();
    const bool orthographic = projection == Projection::orthographic;
    RegularFieldOptions uneven = test::zero_boundary();
    uneven.spacing = Vec3(1.0, 0.6, 2.3);
    RegularFieldOptions thresholded = test::zero_boundary();
    thresholded.normalization = Normalization::threshold;
    const auto stretched = blobs(uneven), cube = blobs({}), few = blobs({}, 7), weighted = blobs(thresholded, 7);
    const std::string words =
        std::string(sampling == Sampling::slab ? " slab" : " point") + (orthographic ? " ortho " : " persp ");
    const auto expect_alike = [&, sampling = sampling](Scene scene, const Camera& camera, Size size,
                                                       const std::string& name) {
        scene.sampling = sampling;
        const Judged view = judged(scene, camera, size);
        for (const Way way : ways()) {
            const Difference difference = view.from(options_of(way), name + words + to_string(way));
            EXPECT_LT(difference.rmse, 2e-5) << name << words << to_string(way);
            EXPECT_LT(difference.p99_9, 2e-4) << name << words << to_string(way);
        }
    };
    expect_alike(scene_of(stretched), askew(*stretched, projection), {48, 40}, "unequal spacing");
    // Every pixel sums hundreds of kernels on many slices: few pixels tell as much as many.
    const auto zoomed = [&](const Field& field, double zoom) {
        const Vec3 centre = field.centres_world().centre();
        const Vec3 eye = centre + Vec3(11, 8, 17);
        return orthographic ? Camera::orthographic(eye, centre, Vec3(0, 1, 0), 14.0 * zoom)
                            : Camera::perspective(eye, centre, Vec3(0, 1, 0), 40.0 * zoom);
    };
    for (const double zoom : {0.1, 1e-3}) {
        Scene close = scene_of(weighted);
        close.slice_spacing = zoom == 0.1 ? 1.0 : 0.05;
        expect_alike(close, zoomed(*weighted, zoom), {5, 4}, "threshold zoom " + std::to_string(zoom));
    }
    for (const double zoom : {0.1, 1e-2, 1e-3, 1e-4, 1e-6}) {
        expect_alike(scene_of(cube), zoomed(*cube, zoom), {16, 16}, "zoom " + std::to_string(zoom));
    }
    // A hundred slices are many even of few kernels.
    for (const double spacing : {0.3, 0.1, 0.01}) {
        const auto& field = spacing < 0.3 ? few : cube;
        Scene thin = scene_of(field);
        thin.slice_spacing = spacing;
        expect_alike(thin, askew(*field, projection), {16, 14}, "slices " + std::to_string(spacing));
    }
}

INSTANTIATE_TEST_SUITE_P(All, CloseUps,
                         ::testing::Combine(::testing::Values(Projection::orthographic, Projection::perspective),
                                            ::testing::Values(Sampling::point, Sampling::slab)),
                         [](const auto& parameter) {
                             const bool slab = std::get<1>(parameter.param) == Sampling::slab;
                             return std::string(std::get<0>(parameter.param) == Projection::perspective ? "persp"
                                                                                                        : "ortho") +
                                    (slab ? "_slab" : "_point");
                         });

} // namespace
} // namespace sheetsplat

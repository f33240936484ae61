// The two ways of drawing ellipsoids that are kept for comparison, the 2006 paper's step by step and gathering by
// pixels, against the float64 reference.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <functional>
#include <map>
#include <random>
#include <string>

#include <gtest/gtest.h>

#include "sheetsplat/device.hpp"
#include "sheetsplat/error.hpp"
#include "sheetsplat/renderer.hpp"

namespace sheetsplat {
namespace {

const bool gl_available = [] {
    const auto reports = devices();
    return std::any_of(reports.begin(), reports.end(),
                       [](const DeviceReport& report) { return report.backend == "gl" && report.available; });
}();

/// Kernels in the unit cube whose volumes are those of balls of `radius`; aspect: longest over shortest semi-axis.
std::shared_ptr<const EllipsoidField> cloud(std::size_t n, double radius, double aspect, unsigned seed = 5,
                                            EllipsoidFieldOptions options = {}, bool weights = false) {
    std::mt19937 random(seed);
    std::uniform_real_distribution<double> uniform(0.0, 1.0);
    std::normal_distribution<double> normal;
    EllipsoidArrays arrays;
    for (std::size_t i = 0; i < n; ++i) {
        const Vec3 at(uniform(random), uniform(random), uniform(random));
        arrays.centers.push_back(at);
        arrays.values.push_back(0.2 + 0.8 * std::exp(-8.0 * glm::dot(at - 0.5, at - 0.5)));
        if (aspect == 1.0) {
            arrays.radii.push_back(radius * (0.6 + 0.8 * uniform(random)));
        } else {
            const double own = std::pow(aspect, uniform(random));
            Vec3 axes = uniform(random) < 0.5 ? Vec3(own, 1.0, 1.0) : Vec3(own, own, 1.0);
            axes *= radius / std::cbrt(axes.x * axes.y * axes.z);
            arrays.scales.push_back(axes);
            const glm::dquat q(normal(random), normal(random), normal(random), normal(random));
            arrays.rotations.push_back(glm::normalize(q));
        }
        if (weights) {
            arrays.weights.push_back(std::pow(10.0, 2.0 * uniform(random) - 1.0));
        }
    }
    return std::make_shared<EllipsoidField>(std::move(arrays), options);
}

Scene scene_of(const std::shared_ptr<const Field>& field) {
    Scene scene{
        {field},
        TransferFunction({{0.05, {0.1, 0.2, 0.9}, 0.0}, {0.5, {0.2, 0.9, 0.3}, 0.08}, {1.0, {1.0, 0.8, 0.2}, 0.4}})};
    scene.lights = {Light{{0.3, 0.5, 1.0}, {1.0, 1.0, 1.0}, LightSpace::eye}};
    scene.material = Material{0.2, 0.7, 0.3, 20.0, false};
    scene.slice_spacing = 0.03;
    return scene;
}

Camera askew(double height = 1.6) {
    const Vec3 middle(0.5);
    return Camera::orthographic(middle + Vec3(1.5, 1.05, 2.4), middle, Vec3(0, 1, 0), height);
}

/// mode: an effect of backend gl, or "cpu".
RendererOptions with(const std::string& mode, std::map<std::string, bool> effects = {}) {
    RendererOptions options;
    if (mode == "cpu") {
        options.backend = Backend::cpu;
        options.effects = std::move(effects);
        return options;
    }
    options.backend = Backend::gl;
    options.effects = std::move(effects);
    options.effects[mode] = true;
    return options;
}

Difference between(const Image& picture, const Image& judge, const std::string& name) {
    const bool scalar = !judge.scalar.empty();
    double largest = 0.0;
    for (float value : scalar ? judge.scalar : judge.rgba) {
        largest = std::max(largest, std::abs(double(value)));
    }
    EXPECT_GT(largest, 0.01) << name;
    const Difference difference =
        scalar ? compare(picture.scalar, judge.scalar, 1) : compare(picture.rgba, judge.rgba, 4);
    std::printf("%-60s rmse %.2e p99.9 %.2e max %.2e (largest %.3f)\n", name.c_str(), difference.rmse, difference.p99_9,
                difference.maximum, largest);
    return difference;
}

Image by_reference(const Scene& scene, const Camera& camera, Size size, const Outputs& outputs = {}) {
    RendererOptions exact;
    exact.backend = Backend::reference;
    return Renderer(exact).render(scene, camera, size, outputs);
}

const std::vector<std::string> modes{"paper_slicing", "gather"};
const std::vector<std::string> modes_and_cpu{"paper_slicing", "gather", "cpu"};
bool is_here(const std::string& mode) { return mode == "cpu" || gl_available; }

struct Trial {
    const char* name;
    std::size_t kernels;
    double radius, aspect;
    double slice_spacing = 0.03;
    Size size{56, 48};
};
std::ostream& operator<<(std::ostream& out, const Trial& trial) { return out << trial.name; }

class RandomFields : public ::testing::TestWithParam<Trial> {};

TEST_P(RandomFields, AreTheReferencesPicture) {
    const Trial& trial = GetParam();
    Scene scene = scene_of(cloud(trial.kernels, trial.radius, trial.aspect));
    scene.slice_spacing = trial.slice_spacing;
    const Image judge = by_reference(scene, askew(), trial.size);
    for (const std::string& mode : modes_and_cpu) {
        if (!is_here(mode)) {
            continue;
        }
        Renderer renderer(with(mode));
        Image picture;
        try {
            picture = renderer.render(scene, askew(), trial.size);
        } catch (const Unsupported& error) {
            // OpenGL before 4.0 slices in float32.
            EXPECT_NE(std::string(error.what()).find("1:512 at most"), std::string::npos) << error.what();
            EXPECT_GE(trial.aspect, 1000.0);
            continue;
        }
        const Difference difference = between(picture, judge, mode + " " + trial.name);
        EXPECT_LT(difference.rmse, 2e-5);
        EXPECT_LT(difference.p99_9, 2e-4);
        EXPECT_TRUE(mode == "cpu" || picture.plan->has(mode));
    }
}

INSTANTIATE_TEST_SUITE_P(All, RandomFields,
                         ::testing::Values(Trial{"1 sphere", 1, 0.4, 1.0, 0.1, {40, 36}},
                                           Trial{"1 of 1:1,000", 1, 0.3, 1000.0}, Trial{"100 spheres", 100, 0.14, 1.0},
                                           Trial{"120 of 1:5", 120, 0.14, 5.0}, Trial{"300 of 1:50", 300, 0.14, 50.0},
                                           Trial{"300 of 1:1,000", 300, 0.14, 1000.0},
                                           Trial{"10,000 of 1:20", 10000, 0.045, 20.0, 0.05, {40, 36}},
                                           Trial{"10,000 of 1:1,000", 10000, 0.045, 1000.0, 0.05, {40, 36}}));

struct Case {
    const char* name;
    std::function<void(Scene&)> change;
    std::vector<std::string> drawn_by = modes_and_cpu;
    std::map<std::string, bool> effects{};
    std::function<void(RendererOptions&)> choose{};
    double rmse = 2e-5, p99_9 = 2e-4;
};
std::ostream& operator<<(std::ostream& out, const Case& one) { return out << one.name; }

class EllipsoidModes : public ::testing::TestWithParam<Case> {};

TEST_P(EllipsoidModes, AreTheReferencesPicture) {
    const Case& one = GetParam();
    Scene scene = scene_of(cloud(150, 0.14, 5.0, 7));
    one.change(scene);
    Outputs outputs;
    outputs.coverage = scene.fields.size() == 1;
    outputs.depth = scene.mode == Mode::isosurface;
    const Vec3 middle = scene.fields.front()->centres_world().centre();
    const Vec3 extent = scene.fields.front()->centres_world().extent();
    const double scale = std::max({extent.x, extent.y, extent.z});
    const Camera camera =
        Camera::orthographic(middle + scale * Vec3(1.5, 1.05, 2.4), middle, Vec3(0, 1, 0), 1.5 * scale);
    const Image judge = by_reference(scene, camera, {50, 44}, outputs);
    for (const std::string& mode : one.drawn_by) {
        if (!is_here(mode)) {
            continue;
        }
        RendererOptions options = with(mode, one.effects);
        if (one.choose) {
            one.choose(options);
        }
        const Image picture = Renderer(options).render(scene, camera, {50, 44}, outputs);
        const Difference difference = between(picture, judge, mode + " " + one.name);
        EXPECT_LT(difference.rmse, one.rmse);
        EXPECT_LT(difference.p99_9, one.p99_9);
        if (outputs.coverage) {
            EXPECT_LT(compare(picture.coverage, judge.coverage, 1).rmse, 2e-5);
        }
    }
}

EllipsoidFieldOptions normalized(Normalization normalization, double w0 = 1.0, double falloff = 8.0) {
    EllipsoidFieldOptions options;
    options.normalization = normalization;
    options.w0 = w0;
    options.falloff = falloff;
    return options;
}

std::shared_ptr<const EllipsoidField> moved(double scale, const Vec3& by) {
    EllipsoidArrays arrays = cloud(150, 0.14, 5.0, 7)->arrays();
    for (Vec3& center : arrays.centers) {
        center = center * scale + by;
    }
    for (Vec3& axes : arrays.scales) {
        axes *= scale;
    }
    return std::make_shared<EllipsoidField>(std::move(arrays));
}

TransferFunction saturating() {
    return TransferFunction({{0.05, {0.1, 0.2, 0.9}, 0.0}, {0.3, {0.2, 0.9, 0.3}, 0.5}, {1.0, {1.0, 0.8, 0.2}, 0.9}});
}

TransferFunction opaque_at_0() { return TransferFunction({{0.0, {0.9, 0.1, 0.1}, 0.05}, {1.0, {1.0, 0.8, 0.2}, 0.4}}); }

std::shared_ptr<const RegularField> lattice(Normalization normalization) {
    std::vector<float> samples(8 * 8 * 8);
    for (std::size_t i = 0; i < samples.size(); ++i) {
        samples[i] = static_cast<float>(0.3 + 0.2 * std::sin(0.7 * double(i)));
    }
    RegularFieldOptions options;
    options.normalization = normalization;
    options.spacing = Vec3(0.13);
    return std::make_shared<RegularField>(std::move(samples), std::array<std::size_t, 3>{8, 8, 8}, options);
}

const std::vector<std::string> paper{"paper_slicing"};
const std::vector<std::string> gathering{"gather"};

INSTANTIATE_TEST_SUITE_P(
    All, EllipsoidModes,
    ::testing::Values(
        Case{"isosurface",
             [](Scene& s) {
                 s.mode = Mode::isosurface;
                 s.iso_value = 0.4;
             },
             modes_and_cpu,
             {},
             {},
             1e-4,
             1e-3},
        Case{"xray", [](Scene& s) { s.mode = Mode::xray; }}, Case{"mip", [](Scene& s) { s.mode = Mode::mip; }},
        Case{"preintegrated", [](Scene& s) { s.preintegration = true; }},
        Case{"weights", [](Scene& s) { s.fields = {cloud(150, 0.14, 5.0, 7, {}, true)}; }},
        Case{"small w0",
             [](Scene& s) { s.fields = {cloud(150, 0.14, 5.0, 7, normalized(Normalization::threshold, 0.05))}; }},
        Case{"none", [](Scene& s) { s.fields = {cloud(150, 0.1, 5.0, 7, normalized(Normalization::none))}; }},
        Case{"falloff 1",
             [](Scene& s) { s.fields = {cloud(150, 0.14, 5.0, 7, normalized(Normalization::threshold, 1.0, 1.0))}; }},
        Case{"falloff 30",
             [](Scene& s) { s.fields = {cloud(150, 0.25, 5.0, 7, normalized(Normalization::threshold, 0.5, 30.0))}; }},
        Case{"opaque at 0", [](Scene& s) { s.transfer_function = opaque_at_0(); }, modes_and_cpu, {}, {}, 1e-4, 1e-3},
        Case{"saturating, eliminated",
             [](Scene& s) { s.transfer_function = saturating(); },
             modes,
             {{"elimination", true}}},
        Case{"saturating, opacity buffer",
             [](Scene& s) { s.transfer_function = saturating(); },
             modes,
             {{"opacity_buffer", true}}},
        Case{"without tags", [](Scene&) {}, modes, {}, [](RendererOptions& o) { o.tagging = Tagging::off; }},
        Case{"small tiles", [](Scene&) {}, modes_and_cpu, {}, [](RendererOptions& o) { o.tile_size = 17; }},
        Case{"depth tags", [](Scene&) {}, paper, {}, [](RendererOptions& o) { o.tagging = Tagging::depth_equal; }},
        Case{"restarted depth tags",
             [](Scene&) {},
             paper,
             {},
             [](RendererOptions& o) {
                 o.tagging = Tagging::depth_equal;
                 o.tags_per_clear = 3;
             }},
        Case{"far away",
             [](Scene& s) { s.fields = {moved(1.0, Vec3(1e9, -2e9, 0.5e9))}; },
             modes_and_cpu,
             {},
             {},
             1e-4,
             1e-3},
        Case{"tiny world",
             [](Scene& s) {
                 s.fields = {moved(1e-6, Vec3(0.0))};
                 s.slice_spacing = 0.03e-6;
             }},
        Case{"huge world",
             [](Scene& s) {
                 s.fields = {moved(1e6, Vec3(0.0))};
                 s.slice_spacing = 0.03e6;
             }},
        Case{"two quotients",
             [](Scene& s) {
                 s.fields.push_back(cloud(100, 0.1, 2.0, 8, normalized(Normalization::threshold, 1.0, 5.0)));
             },
             paper},
        Case{"a lattice among them", [](Scene& s) { s.fields.push_back(lattice(Normalization::lattice)); }, paper},
        Case{"nobody in sight", // the kernels' own scene, then one whose kernels all lie beside the picture
             [](Scene& s) { s.fields.push_back(moved(1.0, Vec3(30.0, 0.0, 0.0))); }, paper},
        Case{"gathered in one cell", [](Scene& s) { s.fields = {cloud(3, 0.3, 2.0)}; }, gathering}));

TEST(EllipsoidModeControls, WrongPicturesFail) {
    if (!gl_available) {
        GTEST_SKIP() << "no OpenGL context can be made here";
    }
    const auto field = cloud(150, 0.14, 5.0);
    const Image judge = by_reference(scene_of(field), askew(), {56, 48});
    const auto wrong = [&](const std::function<void(EllipsoidArrays&)>& change) {
        EllipsoidArrays arrays = field->arrays();
        change(arrays);
        return std::make_shared<EllipsoidField>(std::move(arrays));
    };
    const auto spoilt = {
        wrong([](EllipsoidArrays& a) { a.values[17] *= 1.01; }),
        wrong([](EllipsoidArrays& a) { a.centers[17] += Vec3(1e-3, 0.0, 0.0); }),
        wrong([](EllipsoidArrays& a) { a.scales[17] *= 1.01; }),
    };
    for (const std::string& mode : modes) {
        for (const auto& one : spoilt) {
            const Image picture = Renderer(with(mode)).render(scene_of(one), askew(), {56, 48});
            const Difference difference = between(picture, judge, mode + ", one kernel of 150 spoilt");
            EXPECT_TRUE(difference.rmse > 2e-5 || difference.p99_9 > 2e-4);
        }
    }
}

TEST(EllipsoidModeControls, AreListedAndOffUnlessAskedFor) {
    if (!gl_available) {
        GTEST_SKIP() << "no OpenGL context can be made here";
    }
    const Scene scene = scene_of(cloud(50, 0.2, 5.0));
    RendererOptions options;
    options.backend = Backend::gl;
    const RenderPlan plan = Renderer(options).plan(scene, askew(), {40, 40});
    const Image plain = Renderer(options).render(scene, askew(), {40, 40});
    for (const std::string& mode : modes) {
        const auto found = std::find_if(plan.effects.begin(), plan.effects.end(),
                                        [&](const Effect& effect) { return effect.name == mode; });
        ASSERT_NE(found, plan.effects.end()) << mode;
        EXPECT_FALSE(found->on);
        EXPECT_NE(found->reason.find("not asked for"), std::string::npos) << found->reason;
        const RenderPlan forced = Renderer(with(mode)).plan(scene, askew(), {40, 40});
        EXPECT_TRUE(forced.has(mode));
        options.effects = {{mode, false}};
        const Image off = Renderer(options).render(scene, askew(), {40, 40});
        EXPECT_EQ(off.rgba, plain.rgba) << mode;
        EXPECT_EQ(off.stats.at("bytes_device"), plain.stats.at("bytes_device")) << mode;
    }
    EXPECT_EQ(Renderer(with("paper_slicing")).plan(scene, askew(), {40, 40}).packing, Packing::paper);
    EXPECT_FALSE(Renderer(with("paper_slicing")).plan(scene, askew(), {40, 40}).has("four_channels"));
}

TEST(EllipsoidModeControls, ThePaperDrawsOneQuadAKernelAndSlice) {
    if (!gl_available) {
        GTEST_SKIP() << "no OpenGL context can be made here";
    }
    const Scene scene = scene_of(cloud(200, 0.1, 5.0));
    const Camera camera = askew(4.0); // all of every kernel is in the picture
    RendererOptions single = with("count_fragments", {{"four_channels", false}, {"points", false}});
    const Image one_by_one = Renderer(single).render(scene, camera, {64, 64});
    const Image paper_way =
        Renderer(with("paper_slicing", {{"count_fragments", true}})).render(scene, camera, {64, 64});
    EXPECT_EQ(paper_way.stats.at("splats"), one_by_one.stats.at("splats"));
    // The polygon of equation 13 is the square around the unit sphere's disc, whatever the section's own radius.
    EXPECT_GT(paper_way.stats.at("fragments"), one_by_one.stats.at("fragments"));
    EXPECT_LT(paper_way.stats.at("fragments"), 4.0 * one_by_one.stats.at("fragments"));
}

TEST(EllipsoidModeControls, AnotherViewOrFieldLeavesNothingBehind) {
    if (!gl_available) {
        GTEST_SKIP() << "no OpenGL context can be made here";
    }
    const Camera turned = Camera::orthographic({-2.0, 0.9, 1.0}, {0.5, 0.5, 0.5}, {0, 1, 0}, 1.4);
    for (const std::string& mode : modes) {
        Renderer kept(with(mode));
        for (const unsigned seed : {3U, 4U}) {
            const Scene scene = scene_of(cloud(60 + 1500 * (seed - 3), 0.12, 5.0, seed));
            static_cast<void>(kept.render(scene, askew(), {40, 36}));
            EXPECT_EQ(kept.render(scene, turned, {40, 36}).rgba,
                      Renderer(with(mode)).render(scene, turned, {40, 36}).rgba)
                << mode;
        }
    }
}

struct Refusal {
    const char* name;
    std::function<void(Scene&)> change;
    std::string words;
    std::map<std::string, bool> effects{};
    std::function<void(RendererOptions&)> choose{};
    Projection projection = Projection::orthographic;
    std::vector<std::string> by = modes;
};
std::ostream& operator<<(std::ostream& out, const Refusal& refusal) { return out << refusal.name; }

class EllipsoidModeRefusals : public ::testing::TestWithParam<Refusal> {};

TEST_P(EllipsoidModeRefusals, SayWhy) {
    if (!gl_available) {
        GTEST_SKIP() << "no OpenGL context can be made here";
    }
    const Refusal& refusal = GetParam();
    Scene scene = scene_of(cloud(20, 0.2, 5.0));
    refusal.change(scene);
    const Camera camera = refusal.projection == Projection::orthographic
                              ? askew()
                              : Camera::perspective({2.0, 1.5, 3.0}, {0.5, 0.5, 0.5}, {0, 1, 0}, 30.0);
    for (const std::string& mode : refusal.by) {
        RendererOptions options = with(mode, refusal.effects);
        if (refusal.choose) {
            refusal.choose(options);
        }
        try {
            static_cast<void>(Renderer(options).plan(scene, camera, {40, 40}));
            ADD_FAILURE() << mode << " drew it";
        } catch (const Unsupported& error) {
            const std::string what = error.what();
            std::printf("%s\n", what.c_str());
            EXPECT_NE(what.find("effect " + mode), std::string::npos) << what;
            EXPECT_NE(what.find(refusal.words), std::string::npos) << what;
        }
    }
}

const auto as_it_is = [](Scene&) {};

INSTANTIATE_TEST_SUITE_P(
    All, EllipsoidModeRefusals,
    ::testing::Values(
        Refusal{"perspective", as_it_is, "a perspective camera", {}, {}, Projection::perspective},
        Refusal{"slabs", [](Scene& s) { s.sampling = Sampling::slab; }, "slab sampling"},
        Refusal{"filter", [](Scene& s) { s.filter = Filter::ewa; }, "a filter"},
        Refusal{"fine gradient", as_it_is, "fine_gradient", {{"fine_gradient", true}}},
        Refusal{"a lattice alone", [](Scene& s) { s.fields = {lattice(Normalization::lattice)}; },
                "without scattered ellipsoids"},
        Refusal{"bare fill",
                as_it_is,
                "bare_fill",
                {{"bare_fill", true}},
                [](RendererOptions& o) { o.allow_inexact = true; }},
        Refusal{"both", as_it_is, "gather at once", {{"gather", true}}, {}, Projection::orthographic, paper},
        Refusal{"wide packing",
                as_it_is,
                "packing wide",
                {},
                [](RendererOptions& o) { o.packing = Packing::wide; },
                Projection::orthographic,
                paper},
        Refusal{
            "four channels", as_it_is, "four_channels", {{"four_channels", true}}, {}, Projection::orthographic, paper},
        Refusal{"falloff",
                [](Scene& s) { s.fields = {cloud(20, 0.2, 5.0, 5, normalized(Normalization::none, 1.0, 33.0))}; },
                "a falloff of 33",
                {},
                {},
                Projection::orthographic,
                paper},
        Refusal{"needles",
                [](Scene& s) { s.fields = {cloud(20, 0.2, 1e4)}; },
                "kernels of 1:",
                {},
                {},
                Projection::orthographic,
                paper},
        Refusal{"small kernels",
                [](Scene& s) {
                    s.fields = {cloud(20, 2e-4, 1.0)};
                    s.slice_spacing = 1e-4;
                    s.lights.clear();
                },
                "a semi-axis of",
                {},
                {},
                Projection::orthographic,
                paper},
        Refusal{"longer needles",
                [](Scene& s) { s.fields = {cloud(20, 0.2, 1e6)}; },
                "kernels of 1:",
                {},
                {},
                Projection::orthographic,
                gathering},
        Refusal{"several fields",
                [](Scene& s) { s.fields.push_back(cloud(5, 0.2, 1.0)); },
                "several fields",
                {},
                {},
                Projection::orthographic,
                gathering},
        Refusal{"paper packing",
                as_it_is,
                "packing paper",
                {},
                [](RendererOptions& o) { o.packing = Packing::paper; },
                Projection::orthographic,
                gathering},
        Refusal{"one channel",
                as_it_is,
                "four_channels off",
                {{"four_channels", false}},
                {},
                Projection::orthographic,
                gathering},
        Refusal{"depth tags",
                as_it_is,
                "depth buffer",
                {},
                [](RendererOptions& o) { o.tagging = Tagging::depth_equal; },
                Projection::orthographic,
                gathering}));

} // namespace
} // namespace sheetsplat

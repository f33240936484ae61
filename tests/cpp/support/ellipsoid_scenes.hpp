// Scenes of scattered ellipsoids, and the cases that other ways of drawing them than splats are tested by.
#pragma once

#include <algorithm>
#include <cmath>
#include <functional>
#include <map>
#include <random>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "sheetsplat/error.hpp"
#include "support.hpp"
#include "support/against_reference.hpp"
#include "support/draws.hpp"
#include "support/lattices.hpp"

namespace sheetsplat::testing {

/// Kernels in the unit cube whose volumes are those of balls of `radius`; aspect: longest over shortest semi-axis.
inline std::shared_ptr<const EllipsoidField> cloud(std::size_t n, double radius, double aspect, unsigned seed = 5,
                                                   EllipsoidFieldOptions options = {}, bool weights = false) {
    std::mt19937 random(seed);
    std::uniform_real_distribution<double> uniform(0.0, 1.0);
    std::normal_distribution<double> normal;
    EllipsoidArrays arrays;
    for (std::size_t i = 0; i < n; ++i) {
        const Vec3 at = test::three([&] { return uniform(random); });
        arrays.centers.push_back(at);
        arrays.values.push_back(0.2 + 0.8 * std::exp(-8.0 * glm::dot(at - 0.5, at - 0.5)));
        if (aspect == 1.0) {
            arrays.radii.push_back(radius * (0.6 + 0.8 * uniform(random)));
        } else {
            const double own = std::pow(aspect, uniform(random));
            Vec3 axes = uniform(random) < 0.5 ? Vec3(own, 1.0, 1.0) : Vec3(own, own, 1.0);
            axes *= radius / std::cbrt(axes.x * axes.y * axes.z);
            arrays.scales.push_back(axes);
            arrays.rotations.push_back(test::rotation([&] { return normal(random); }));
        }
        if (weights) {
            arrays.weights.push_back(std::pow(10.0, 2.0 * uniform(random) - 1.0));
        }
    }
    return std::make_shared<EllipsoidField>(std::move(arrays), options);
}

inline Scene scene_of(const std::shared_ptr<const Field>& field) {
    Scene scene{
        {field},
        TransferFunction({{0.05, {0.1, 0.2, 0.9}, 0.0}, {0.5, {0.2, 0.9, 0.3}, 0.08}, {1.0, {1.0, 0.8, 0.2}, 0.4}})};
    scene.lights = {Light{{0.3, 0.5, 1.0}, {1.0, 1.0, 1.0}, LightSpace::eye}};
    scene.material = Material{0.2, 0.7, 0.3, 20.0, false};
    scene.slice_spacing = 0.03;
    return scene;
}

inline Camera askew(double height = 1.6) {
    const Vec3 middle(0.5);
    return Camera::orthographic(middle + Vec3(1.5, 1.05, 2.4), middle, Vec3(0, 1, 0), height);
}

struct Trial {
    const char* name;
    std::size_t kernels;
    double radius, aspect;
    double slice_spacing = 0.03;
    Size size{56, 48};
};
inline std::ostream& operator<<(std::ostream& out, const Trial& trial) { return out << trial.name; }

inline std::vector<Trial> trials() {
    return {Trial{"1 sphere", 1, 0.4, 1.0, 0.1, {40, 36}},
            Trial{"1 of 1:1,000", 1, 0.3, 1000.0},
            Trial{"100 spheres", 100, 0.14, 1.0},
            Trial{"120 of 1:5", 120, 0.14, 5.0},
            Trial{"300 of 1:50", 300, 0.14, 50.0},
            Trial{"300 of 1:1,000", 300, 0.14, 1000.0},
            Trial{"10,000 of 1:20", 10000, 0.045, 20.0, 0.05, {40, 36}},
            Trial{"10,000 of 1:1,000", 10000, 0.045, 1000.0, 0.05, {40, 36}}};
}

inline EllipsoidFieldOptions normalized(Normalization normalization, double w0 = 1.0, double falloff = 8.0) {
    EllipsoidFieldOptions options;
    options.normalization = normalization;
    options.w0 = w0;
    options.falloff = falloff;
    return options;
}

inline std::shared_ptr<const EllipsoidField> moved(double scale, const Vec3& by) {
    EllipsoidArrays arrays = cloud(150, 0.14, 5.0, 7)->arrays();
    for (Vec3& center : arrays.centers) {
        center = center * scale + by;
    }
    for (Vec3& axes : arrays.scales) {
        axes *= scale;
    }
    return std::make_shared<EllipsoidField>(std::move(arrays));
}

inline TransferFunction saturating() {
    return TransferFunction({{0.05, {0.1, 0.2, 0.9}, 0.0}, {0.3, {0.2, 0.9, 0.3}, 0.5}, {1.0, {1.0, 0.8, 0.2}, 0.9}});
}

inline TransferFunction opaque_at_0() {
    return TransferFunction({{0.0, {0.9, 0.1, 0.1}, 0.05}, {1.0, {1.0, 0.8, 0.2}, 0.4}});
}

inline std::shared_ptr<const RegularField> lattice(Normalization normalization, Lattice lattice = Lattice::cartesian) {
    std::vector<float> samples(8 * 8 * 8);
    for (std::size_t i = 0; i < samples.size(); ++i) {
        samples[i] = static_cast<float>(0.3 + 0.2 * std::sin(0.7 * double(i)));
    }
    RegularFieldOptions options = test::zero_boundary();
    options.lattice = lattice;
    options.normalization = normalization;
    options.spacing = Vec3(0.13);
    return std::make_shared<RegularField>(std::move(samples), std::array<std::size_t, 3>{8, 8, 8}, options);
}

/// A change of scene_of(cloud(150, 0.14, 5.0, 7)), effects and options that it is drawn with, and bounds.
struct Case {
    const char* name;
    std::function<void(Scene&)> change;
    std::map<std::string, bool> effects{};
    std::function<void(RendererOptions&)> choose{};
    double rmse = 2e-5, p99_9 = 2e-4;
};
inline std::ostream& operator<<(std::ostream& out, const Case& one) { return out << one.name; }

inline std::vector<Case> cases() {
    return {
        Case{"isosurface",
             [](Scene& s) {
                 s.mode = Mode::isosurface;
                 s.iso_values = {0.4};
             },
             {},
             {},
             1e-4,
             1e-3},
        Case{"xray", [](Scene& s) { s.mode = Mode::xray; }},
        Case{"mip", [](Scene& s) { s.mode = Mode::mip; }},
        Case{"preintegrated", [](Scene& s) { s.preintegration = true; }},
        Case{"weights", [](Scene& s) { s.fields = {cloud(150, 0.14, 5.0, 7, {}, true)}; }},
        Case{"small w0",
             [](Scene& s) { s.fields = {cloud(150, 0.14, 5.0, 7, normalized(Normalization::threshold, 0.05))}; }},
        Case{"none", [](Scene& s) { s.fields = {cloud(150, 0.1, 5.0, 7, normalized(Normalization::none))}; }},
        Case{"falloff 1",
             [](Scene& s) { s.fields = {cloud(150, 0.14, 5.0, 7, normalized(Normalization::threshold, 1.0, 1.0))}; }},
        Case{"falloff 30",
             [](Scene& s) { s.fields = {cloud(150, 0.25, 5.0, 7, normalized(Normalization::threshold, 0.5, 30.0))}; }},
        Case{"opaque at 0", [](Scene& s) { s.transfer_function = opaque_at_0(); }, {}, {}, 1e-4, 1e-3},
        Case{"saturating, eliminated", [](Scene& s) { s.transfer_function = saturating(); }, {{"elimination", true}}},
        Case{"saturating, opacity buffer",
             [](Scene& s) { s.transfer_function = saturating(); },
             {{"opacity_buffer", true}}},
        Case{"without tags", [](Scene&) {}, {}, [](RendererOptions& o) { o.tagging = Tagging::off; }},
        Case{"small tiles", [](Scene&) {}, {}, [](RendererOptions& o) { o.tile_size = 17; }},
        Case{"far away", [](Scene& s) { s.fields = {moved(1.0, Vec3(1e9, -2e9, 0.5e9))}; }, {}, {}, 1e-4, 1e-3},
        Case{"tiny world",
             [](Scene& s) {
                 s.fields = {moved(1e-6, Vec3(0.0))};
                 s.slice_spacing = 0.03e-6;
             }},
        Case{"huge world", [](Scene& s) {
                 s.fields = {moved(1e6, Vec3(0.0))};
                 s.slice_spacing = 0.03e6;
             }}};
}

using Drawer = std::function<Image(const RendererOptions&, const Scene&, const Camera&, Size, const Outputs&)>;

/// Draws a case on backend gl, and where it is no option of that backend alone on backend cpu, and compares the
/// pictures with the reference.
inline void expect_the_references_picture(const Case& one, const Drawer& draw, bool on_cpu = false) {
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
    RendererOptions options;
    options.backend = Backend::gl;
    options.effects = one.effects;
    if (one.choose) {
        one.choose(options);
    }
    const auto expect_alike = [&](const Image& picture, const std::string& name) {
        const Difference difference = between(picture, judge, name);
        EXPECT_LT(difference.rmse, one.rmse);
        EXPECT_LT(difference.p99_9, one.p99_9);
        if (outputs.coverage) {
            EXPECT_LT(compare(picture.coverage, judge.coverage, 1).rmse, 2e-5);
        }
    };
    if (gl_available()) {
        expect_alike(draw(options, scene, camera, {50, 44}, outputs), one.name);
    }
    if (on_cpu && options.effects.empty() && options.tagging == Tagging::automatic) {
        options.backend = Backend::cpu;
        expect_alike(Renderer(options).render(scene, camera, {50, 44}, outputs), std::string("cpu ") + one.name);
    }
}

/// Draws pictures of fields with one spoilt kernel, which must lie outside the bounds of the cases.
inline void expect_spoilt_pictures_to_fail(const Drawer& draw) {
    const auto field = cloud(150, 0.14, 5.0);
    const Image judge = by_reference(scene_of(field), askew(), {56, 48});
    const std::vector<std::function<void(EllipsoidArrays&)>> changes{
        [](EllipsoidArrays& a) { a.values[17] *= 1.01; },
        [](EllipsoidArrays& a) { a.centers[17] += Vec3(1e-3, 0.0, 0.0); },
        [](EllipsoidArrays& a) { a.scales[17] *= 1.01; },
    };
    RendererOptions options;
    options.backend = Backend::gl;
    for (const auto& change : changes) {
        EllipsoidArrays arrays = field->arrays();
        change(arrays);
        const Scene scene = scene_of(std::make_shared<EllipsoidField>(std::move(arrays)));
        const Difference difference =
            between(draw(options, scene, askew(), {56, 48}, {}), judge, "one kernel of 150 spoilt");
        EXPECT_TRUE(difference.rmse > 2e-5 || difference.p99_9 > 2e-4);
    }
}

/// What a way of drawing refuses: a change of scene_of(cloud(20, 0.2, 5.0)) or of the options, and words of the reason.
struct Refusal {
    const char* name;
    std::function<void(Scene&)> change;
    std::string words;
    std::function<void(RendererOptions&)> choose{};
    Projection projection = Projection::orthographic;
};
inline std::ostream& operator<<(std::ostream& out, const Refusal& refusal) { return out << refusal.name; }

inline void as_it_is(Scene&) {}

/// What each way but splats refuses.
inline std::vector<Refusal> common_refusals() {
    return {Refusal{"perspective", as_it_is, "a perspective camera", {}, Projection::perspective},
            Refusal{"slabs", [](Scene& s) { s.sampling = Sampling::slab; }, "slab sampling"},
            Refusal{"filter", [](Scene& s) { s.filter = Filter::ewa; }, "a filter"},
            Refusal{"a lattice alone", [](Scene& s) { s.fields = {lattice(Normalization::lattice)}; },
                    "without scattered ellipsoids"}};
}

/// Expects attempt(options, scene, camera) to throw Unsupported, which names the `subject` and the reason.
template <class Attempt>
void expect_refusal(const Refusal& refusal, const std::string& subject, const Attempt& attempt) {
    Scene scene = scene_of(cloud(20, 0.2, 5.0));
    refusal.change(scene);
    const Camera camera = refusal.projection == Projection::orthographic
                              ? askew()
                              : Camera::perspective({2.0, 1.5, 3.0}, {0.5, 0.5, 0.5}, {0, 1, 0}, 30.0);
    RendererOptions options;
    options.backend = Backend::gl;
    if (refusal.choose) {
        refusal.choose(options);
    }
    test::expect_parts(test::message_of<Unsupported>([&] { attempt(options, scene, camera); }),
                       {subject, refusal.words});
}

} // namespace sheetsplat::testing

// The discretisation error shrinks at its known order (conventions, section 8).
#include <gtest/gtest.h>

#include "support.hpp"
#include "support/lattices.hpp"

namespace sheetsplat::reference::testing {

namespace {

constexpr Size size{12, 10};
constexpr double coarsest = 0.5;

struct Orders {
    double right = 0.0;
    double wrong = 0.0; ///< of a picture whose weight (or depth) is off by a share of the step
    double finest = 0.0;
};

/// Slope of the error over four halvings of the distance of slices, against a picture of very thin slices.
Orders orders(Scene scene, const Camera& camera, bool depth = false) {
    const double length = 1.0;
    Request request;
    request.depth = depth;
    const auto values = [&](double spacing, double mistake) {
        scene.slice_spacing = spacing;
        scene.reference_length = length * (1.0 + mistake * spacing);
        Picture picture = render(scene, camera, size, request);
        for (double& value : picture.depth) {
            value += mistake * spacing;
        }
        return depth ? picture.depth : picture.rgba;
    };
    const auto limit = values(coarsest / 16.0 / 12.0, 0.0);
    std::vector<double> steps, right, wrong;
    for (int halving = 0; halving <= 4; ++halving) {
        const double spacing = coarsest / (1 << halving);
        steps.push_back(spacing);
        right.push_back(root_mean_square(values(spacing, 0.0), limit));
        wrong.push_back(root_mean_square(values(spacing, 0.3), limit));
    }
    return {fitted_order(steps, right), fitted_order(steps, wrong), right.back()};
}

void report(const char* name, const Orders& found) {
    std::printf("%s: order %.2f, finest error %.1e; with a wrong weight %.2f\n", name, found.right, found.finest,
                found.wrong);
}

const Camera perspective_camera =
    Camera::perspective(Vec3(4.0, 3.5, 3.0) + Vec3(6.0, 4.0, 10.0), Vec3(4.0, 3.5, 3.0), Vec3(0.1, 1.0, 0.0), 50.0);

} // namespace

TEST(Orders, CompositeOfPointsAndSlabs) {
    for (const bool lights : {false, true}) {
        for (const Sampling sampling : {Sampling::point, Sampling::slab}) {
            Scene scene = make_scene(blobs());
            scene.sampling = sampling;
            scene.lights = lights ? two_lights() : std::vector<Light>{};
            const Orders found = orders(scene, lights ? perspective_camera : oblique_camera());
            report(sampling == Sampling::point ? "composite of points" : "composite of slabs", found);
            EXPECT_GE(found.right, 1.7);
            EXPECT_LT(found.wrong, 1.4);
        }
    }
}

TEST(Orders, Preintegration) {
    Scene scene = make_scene(blobs());
    scene.preintegration = true;
    const Orders found = orders(scene, oblique_camera());
    report("pre-integration", found);
    EXPECT_GE(found.right, 1.7);
    EXPECT_LT(found.wrong, 1.4);
}

TEST(Orders, SecondOrderOfPreintegration) {
    // Kernels whose edges are so low that rho bends nowhere, and a function without corners inside its range.
    RegularFieldOptions options = test::zero_boundary();
    options.radius = 3.0;
    options.falloff = 20.0;
    Scene scene = make_scene(blobs(options),
                             TransferFunction({{0.0, Vec3(0.1, 0.2, 0.9), 0.0}, {3.0, Vec3(1.0, 0.5, 0.1), 0.9}}));
    scene.preintegration = true;
    const Orders first = orders(scene, oblique_camera());
    scene.second_order = true;
    const Orders second = orders(scene, oblique_camera());
    report("pre-integration of first order", first);
    report("pre-integration of second order", second);
    EXPECT_GE(second.right, 2.7);
    EXPECT_LT(second.finest, 1e-2 * first.finest);
    EXPECT_LT(second.wrong, 1.4);
    EXPECT_GE(first.right, 1.7);
    EXPECT_LT(first.right, 2.3) << "what the first order cannot";
}

TEST(Orders, SheetsTendToAnalyticGradients) {
    // Pixel and distance of slices are halved together: differences of second order.
    RegularFieldOptions options = test::zero_boundary();
    options.falloff = 12.0;
    options.radius = 2.5;
    Scene scene = make_scene(blobs(options));
    scene.lights = two_lights();
    scene.mode = Mode::isosurface;
    scene.iso_values = {0.05};
    std::vector<double> steps, errors, one_sided;
    for (int halving = 0; halving < 4; ++halving) {
        const double step = 0.4 / (1 << halving);
        scene.slice_spacing = step;
        // One pixel, as wide as a slice is thick.
        const Camera camera =
            Camera::orthographic(Vec3(4.3, 4.2, 20.0), Vec3(4.3, 4.2, 3.0), Vec3(0.0, 1.0, 0.0), step);
        scene.gradient = Gradient::sheets;
        const Picture sheets = render(scene, camera, Size{1, 1});
        scene.gradient = Gradient::analytic;
        const Picture analytic = render(scene, camera, Size{1, 1});
        steps.push_back(step);
        errors.push_back(root_mean_square(sheets.rgba, analytic.rgba));
        // A camera half a pixel beside: what differences that are not central would show.
        const Camera beside = Camera::orthographic(Vec3(4.3 + 0.5 * step, 4.2, 20.0), Vec3(4.3 + 0.5 * step, 4.2, 3.0),
                                                   Vec3(0.0, 1.0, 0.0), step);
        one_sided.push_back(root_mean_square(sheets.rgba, render(scene, beside, Size{1, 1}).rgba));
    }
    std::printf("sheets to analytic gradients: order %.2f, finest %.1e; beside %.2f\n", fitted_order(steps, errors),
                errors.back(), fitted_order(steps, one_sided));
    EXPECT_GE(fitted_order(steps, errors), 1.7);
    EXPECT_LT(fitted_order(steps, one_sided), 1.4);
}

TEST(Orders, StepsAndOpacityStopCostAnOrder) {
    Scene steps = make_scene(
        blobs(),
        TransferFunction({{0.0, Vec3(0.2), 0.0}, {0.3, Vec3(0.2), 0.0}, {0.3, Vec3(0.9), 0.4}, {1.0, Vec3(0.5), 0.4}}));
    const Orders stepped = orders(steps, oblique_camera());
    report("composite with a step", stepped);
    EXPECT_GE(stepped.right, 0.6);
    EXPECT_LT(stepped.right, 1.7);
    Scene stops = make_scene(blobs());
    stops.opacity_stop = 0.5;
    const Orders stopped = orders(stops, oblique_camera());
    report("composite that stops", stopped);
    EXPECT_GE(stopped.right, 0.6);
    EXPECT_LT(stopped.right, 1.7);
}

TEST(Orders, IsosurfaceDepth) {
    // Pixels well inside the outline of a surface.
    Scene scene = make_scene(blobs());
    scene.mode = Mode::isosurface;
    scene.iso_values = {0.15};
    const Orders found =
        orders(scene, Camera::orthographic(Vec3(11.0, 8.0, 16.0), Vec3(4.0, 3.5, 3.0), Vec3(0.0, 1.0, 0.0), 2.0), true);
    report("isosurface depth", found);
    EXPECT_GE(found.right, 1.7);
    EXPECT_LT(found.wrong, 1.4);
}

} // namespace sheetsplat::reference::testing

// The discretisation error shrinks at its known order (IMAGE FORMATION section 8).
#include <gtest/gtest.h>

#include "support.hpp"

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
    scene.iso_value = 0.15;
    const Orders found =
        orders(scene, Camera::orthographic(Vec3(11.0, 8.0, 16.0), Vec3(4.0, 3.5, 3.0), Vec3(0.0, 1.0, 0.0), 2.0), true);
    report("isosurface depth", found);
    EXPECT_GE(found.right, 1.7);
    EXPECT_LT(found.wrong, 1.4);
}

} // namespace sheetsplat::reference::testing

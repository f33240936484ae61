// Lines towards lights through a grid of rho: which surfaces they count, and where they end.
#include "light/surface_lines.hpp"

#include <cmath>
#include <limits>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

namespace sheetsplat {
namespace {

constexpr double far = std::numeric_limits<double>::max();

/// A wall with rho = 2 from x = 4.2 to 8.2 in a cube of edge 20, on elements half a unit apart.
LightVolumes wall() {
    LightVolume grid;
    grid.counts = {41, 41, 41};
    grid.per_step = {Vec3(2, 0, 0), Vec3(0, 2, 0), Vec3(0, 0, 2)};
    for (int w = 0; w < 41; ++w) {
        for (int v = 0; v < 41; ++v) {
            for (int u = 0; u < 41; ++u) {
                const double x = 0.5 * u;
                grid.values.push_back(x > 4.2 && x < 8.2 ? 2.0F : 0.0F);
            }
        }
    }
    LightVolumes volumes;
    volumes.groups = {std::make_shared<const LightVolume>(std::move(grid))};
    return volumes;
}

Scene scene_with(const std::vector<IsoValue>& values) {
    Scene scene{{}, TransferFunction({{0.0, Vec3(1.0), 0.0}, {1.0, Vec3(1.0), 1.0}})};
    scene.mode = Mode::isosurface;
    scene.iso_values = values;
    scene.lights = {{Vec3(3, 0, 0), Vec3(1.0), LightSpace::world}};
    scene.ambient_occlusion = AmbientOcclusion{3.0, 1.0};
    return scene;
}

Camera camera() { return Camera::orthographic({10, 10, 40}, {10, 10, 0}, {0, 1, 0}, 20.0); }

double left(const Scene& scene, const Vec3& from, const Vec3& direction, double steps = far, double spacing = 1.0) {
    const LightVolumes volumes = wall();
    const LightVolume& grid = *volumes.groups.front();
    const SurfaceLines lines = make_surface_lines(scene, camera(), grid, spacing, 2.0);
    return lines.left_along(volumes, grid.place_of(from), 2.0 * spacing * direction, steps);
}

TEST(SurfaceLines, EachCrossingTakesItsOpacity) {
    const Vec3 start(1, 10, 10), right(1, 0, 0);
    // rho is counted in units of 2 here, so the wall's is 4.
    for (const double opacity : {0.25, 0.9}) {
        const double through = 1.0 - opacity;
        EXPECT_NEAR(left(scene_with({{1.0, opacity}}), start, right), through * through, 1e-12);
        EXPECT_NEAR(left(scene_with({{1.0, opacity}}), Vec3(6, 10, 10), right), through, 1e-12);
        EXPECT_EQ(left(scene_with({{1.0, opacity}}), Vec3(9, 10, 10), right), 1.0);
        EXPECT_EQ(left(scene_with({{4.5, opacity}}), start, right), 1.0);
    }
    EXPECT_NEAR(left(scene_with({{3.0, 0.5}, {1.0, 0.2}, {1.0, 0.1}, {9.0, 1.0}, {2.0, 0.0}}), start, right),
                std::pow(0.5 * 0.8 * 0.9, 2.0), 1e-12);
    EXPECT_EQ(left(scene_with({1.0}), start, right), 0.0);
    EXPECT_EQ(left(scene_with({{3.0, 0.5}, 1.0}), Vec3(6, 10, 10), right), 0.0);
    EXPECT_EQ(left(scene_with({1.0}), start, Vec3(0, 1, 0)), 1.0);
}

TEST(SurfaceLines, BeginAStepAwayAndEndWhereTheyAreTold) {
    const Scene scene = scene_with({{1.0, 0.5}});
    // The front of the wall, where rho is 1, lies at x = 4.125; steps of one unit.
    EXPECT_NEAR(left(scene, Vec3(3.2, 10, 10), Vec3(1, 0, 0)), 0.5, 1e-12)
        << "the front is nearer than the first point";
    EXPECT_NEAR(left(scene, Vec3(3.1, 10, 10), Vec3(1, 0, 0)), 0.25, 1e-12);
    EXPECT_NEAR(left(scene, Vec3(1.0, 10, 10), Vec3(1, 0, 0), 4.0), 0.5, 1e-12);
    EXPECT_EQ(left(scene, Vec3(1.0, 10, 10), Vec3(1, 0, 0), 3.0), 1.0);
    EXPECT_EQ(left(scene, Vec3(1.0, 10, 10), Vec3(1, 0, 0), 1.0), 1.0);
    // Long steps pass the wall between two points.
    EXPECT_EQ(left(scene, Vec3(1.0, 10, 10), Vec3(1, 0, 0), far, 8.0), 1.0);
}

TEST(SurfaceLines, EndWhereAClipEndsThem) {
    Scene scene = scene_with({{1.0, 0.5}});
    scene.clip.planes = {{Vec3(-2, 0, 0), -12.0}};
    EXPECT_NEAR(left(scene, Vec3(1, 10, 10), Vec3(1, 0, 0)), 0.5, 1e-12) << "the wall is cut open at 6";
    scene.clip.planes = {{Vec3(-2, 0, 0), -8.0}};
    EXPECT_EQ(left(scene, Vec3(1, 10, 10), Vec3(1, 0, 0)), 1.0);
    // A point on the plane is kept: the crossing from 4 to 5 counts.
    scene.clip.planes = {{Vec3(-1, 0, 0), -5.0}};
    EXPECT_NEAR(left(scene, Vec3(1, 10, 10), Vec3(1, 0, 0)), 0.5, 1e-12);
    EXPECT_EQ(left(scene, Vec3(0.999, 10, 10), Vec3(1, 0, 0)), left(scene, Vec3(1, 10, 10), Vec3(1, 0, 0)));
}

TEST(SurfaceLines, CountCrossingsOfAGroupInsideOfItsEndAlone) {
    Scene scene = scene_with({{101.0, 0.5}});
    scene.counted.emplace();
    scene.counted->bases = {100.0};
    const auto left_inside = [&](double from, double to) {
        scene.counted->ends = {Box{Vec3(from, 0, 0), Vec3(to, 20, 20)}};
        return left(scene, Vec3(1, 10, 10), Vec3(1, 0, 0));
    };
    // Points at 2, 3 ...: the wall begins between 4 and 5, and ends between 8 and 9.
    EXPECT_NEAR(left_inside(0, 20), 0.25, 1e-12);
    EXPECT_NEAR(left_inside(0, 8.5), 0.5, 1e-12) << "the back lies outside";
    EXPECT_NEAR(left_inside(4.5, 20), 0.5, 1e-12) << "the line enters behind the front";
    EXPECT_NEAR(left_inside(4.0, 20), 0.25, 1e-12) << "a point on a face is inside";
    EXPECT_EQ(left_inside(4.5, 8.5), 1.0);
    EXPECT_EQ(left_inside(14.0, 20), 1.0);
    scene.counted->ends = {std::nullopt};
    EXPECT_NEAR(left(scene, Vec3(1, 10, 10), Vec3(1, 0, 0)), 0.25, 1e-12);
    scene.counted->ends = {Box{Vec3(0, 0, 0), Vec3(20, 9, 20)}};
    EXPECT_EQ(left(scene, Vec3(1, 10, 10), Vec3(1, 0, 0)), 1.0) << "beside the end";
}

TEST(SurfaceLines, KnowLightsAndDirections) {
    const LightVolumes volumes = wall();
    const SurfaceLines lines = make_surface_lines(scene_with({1.0}), camera(), *volumes.groups.front(), 0.75, 1.0);
    ASSERT_EQ(lines.to_lights.size(), 1U);
    EXPECT_EQ(lines.to_lights.front(), Vec3(1.5, 0, 0));
    EXPECT_EQ(lines.around_steps, 4);
    Vec3 sum(0.0);
    for (const Vec3& step : lines.around) {
        EXPECT_NEAR(std::sqrt(step.x * step.x + step.y * step.y + step.z * step.z), 1.5, 1e-12);
        sum += step;
    }
    EXPECT_NEAR(std::abs(sum.x) + std::abs(sum.y) + std::abs(sum.z), 0.0, 1e-12);
    EXPECT_EQ(occlusion_steps({0.1, 1.0}, 1.0), 1.0);
    EXPECT_EQ(occlusion_steps({0.3, 1.0}, 0.1), 3.0);
}

} // namespace
} // namespace sheetsplat

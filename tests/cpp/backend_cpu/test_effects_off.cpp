// A scene without lights never touches what gradients are made of: counted on what is handed to the shading of a slab.
#include <algorithm>
#include <array>
#include <limits>
#include <memory>
#include <vector>

#include <gtest/gtest.h>

#include "backend_cpu/tile_task.hpp"
#include "base/instruction_set.hpp"
#include "plan/make_plan.hpp"
#include "support/facts.hpp"
#include "support/lattices.hpp"

namespace sheetsplat::backend_cpu {
namespace {

constexpr float nan = std::numeric_limits<float>::quiet_NaN();
constexpr int edge = 12;

Scene scene_of(bool lit) {
    const auto field = std::make_shared<RegularField>(std::vector<float>{0, 1, 0, 1, 0, 1, 0, 1},
                                                      std::array<std::size_t, 3>{2, 2, 2}, test::zero_boundary());
    Scene scene{{field}, TransferFunction({{0.0, {1, 0.5, 0}, 0.0}, {1.0, {0, 0.5, 1}, 0.6}})};
    if (lit) {
        scene.lights = {Light{{1, 2, 3}, {1, 1, 1}, LightSpace::world}};
        scene.material.specular = 0.3;
    }
    return scene;
}

/// A tile whose slice holds 0 to 1 inside, and around it, in the border that gradients reach, this value.
struct Tile {
    TileShape shape{0, 0, edge, edge, 48};
    std::vector<float> sheet, planes[4];
    std::vector<int> alive;

    explicit Tile(float around) : sheet(shape.sheet_elements(), around), alive(edge, edge) {
        for (int y = 0; y < edge; ++y) {
            for (int x = 0; x < edge; ++x) {
                sheet[static_cast<std::size_t>((y + 1) * shape.stride + x + 1)] =
                    static_cast<float>(x + y) / (2.0F * edge);
            }
        }
        for (auto& plane : planes) {
            plane.assign(shape.picture_elements(), 0.0F);
        }
    }

    void shade(const Shading<float>& shading, const float* before, const float* after) {
        SlabWindow<float> window;
        window.rho[0] = before;
        window.rho[1] = sheet.data();
        window.rho[2] = after;
        window.rect = {0, 0, edge, edge};
        TilePicture<float> picture;
        picture.red = planes[0].data();
        picture.green = planes[1].data();
        picture.blue = planes[2].data();
        picture.alpha = planes[3].data();
        picture.row_alive = alive.data();
        picture.alive = edge * edge;
        tile_functions<float>(chosen_instruction_set())->shade(shading, shape, window, picture);
    }

    [[nodiscard]] std::vector<float> pixels() const {
        std::vector<float> all;
        for (const auto& plane : planes) {
            for (int y = 0; y < edge; ++y) {
                for (int x = 0; x < edge; ++x) {
                    all.push_back(plane[static_cast<std::size_t>(y * shape.stride + x)]);
                }
            }
        }
        return all;
    }
};

Shading<float> shading_of(const Scene& scene) {
    ViewFacts view;
    view.frame.size = {edge, edge};
    view.frame.slices = 4;
    Frame frame;
    frame.size = view.frame.size;
    frame.slices = 4;
    const Camera camera = Camera::orthographic({0.0, 0.0, 5.0}, {0.0, 0.0, 0.0}, {0.0, 1.0, 0.0}, 2.0);
    RendererOptions options;
    options.precision = Precision::float32;
    const DrawPlan plan =
        make_plan(scene, test::surveyed(scene, view), options, {}, Projection::orthographic, Backend::cpu, nullptr);
    return make_shading<float>(scene, camera, frame, plan);
}

TEST(EffectsOff, AnUnlitSceneHandsNothingToGradients) {
    const Shading<float> dark = shading_of(scene_of(false));
    EXPECT_FALSE(dark.lit || dark.gradient || dark.by_effects || dark.specular || dark.two_sided);
    EXPECT_TRUE(dark.lights.empty());
    EXPECT_EQ(dark.gradient_across, 0.0);
    EXPECT_EQ(dark.gradient_along, 0.0);
    EXPECT_EQ(dark.groups.front().weakest_gradient, 0.0);
}

TEST(EffectsOff, AnUnlitSceneReadsNoNeighbours) {
    Shading<float> dark = shading_of(scene_of(false));
    Tile plain(0.0F);
    const std::vector<float> empty(plain.sheet.size(), 0.0F);
    plain.shade(dark, empty.data(), empty.data());

    // Neither the slices before and after, which are not even there, nor the pixels around, nor any number of light.
    dark.gradient_across = dark.gradient_along = dark.groups.front().weakest_gradient =
        dark.groups.front().full_gradient = std::numeric_limits<double>::quiet_NaN();
    dark.ambient = dark.shininess = nan;
    Tile poisoned(nan);
    poisoned.shade(dark, nullptr, nullptr);
    EXPECT_EQ(poisoned.pixels(), plain.pixels());
    EXPECT_GT(*std::max_element(plain.planes[3].begin(), plain.planes[3].end()), 0.3F);
}

TEST(EffectsOff, ALitSceneReadsThem) {
    const Shading<float> lit = shading_of(scene_of(true));
    EXPECT_TRUE(lit.lit && lit.gradient && lit.specular);
    EXPECT_GT(lit.gradient_across, 0.0);
    Tile plain(0.0F), poisoned(nan);
    const std::vector<float> empty(plain.sheet.size(), 0.0F);
    plain.shade(lit, empty.data(), empty.data());
    poisoned.shade(lit, empty.data(), empty.data());
    EXPECT_NE(poisoned.pixels(), plain.pixels());
}

} // namespace
} // namespace sheetsplat::backend_cpu

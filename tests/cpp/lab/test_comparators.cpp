// The other comparators: those that must draw the product's picture draw it, the others differ by what they leave out.
#include <cstdio>

#include "lab/comparators.hpp"
#include "lab/fill_test.hpp"
#include "support/ellipsoid_scenes.hpp"
#include "support/lattices.hpp"

namespace sheetsplat::lab {
namespace {

using namespace sheetsplat::testing;

RendererOptions on_gl(std::map<std::string, bool> effects = {}) {
    RendererOptions options;
    options.backend = Backend::gl;
    options.effects = std::move(effects);
    return options;
}

Image by(const std::vector<std::string>& names, const Scene& scene, const Camera& camera, Size size,
         const RendererOptions& options = on_gl()) {
    Renderer renderer(options);
    return render(renderer, comparators_of(names), scene, camera, size);
}

class ComparatorTests : public WithGl {};

std::shared_ptr<const RegularField> blobs(std::size_t n) {
    std::vector<float> samples;
    for (std::size_t k = 0; k < n; ++k) {
        for (std::size_t j = 0; j < n; ++j) {
            for (std::size_t i = 0; i < n; ++i) {
                const auto at = [&](std::size_t index) { return (double(index) + 0.5) / double(n) - 0.5; };
                const double r2 = at(i) * at(i) + 1.5 * at(j) * at(j) + at(k) * at(k);
                samples.push_back(static_cast<float>(std::exp(-12.0 * r2)));
            }
        }
    }
    RegularFieldOptions options = test::zero_boundary();
    options.spacing = Vec3(1.0 / double(n));
    return std::make_shared<RegularField>(std::move(samples), std::array<std::size_t, 3>{n, n, n}, options);
}

Camera of(const Field& field, const Vec3& direction = Vec3(0.4, -0.3, -1.0)) {
    return Camera::fit(field.supports_world(), direction, Vec3(0, 1, 0));
}

TEST_F(ComparatorTests, OtherWaysOfDrawingGiveTheReferencesPicture) {
    const auto volume = blobs(14);
    for (const std::shared_ptr<const Field>& field :
         {std::shared_ptr<const Field>(volume), std::shared_ptr<const Field>(cloud(150, 0.14, 5.0)),
          std::shared_ptr<const Field>(cloud(150, 0.14, 1.0))}) {
        for (const bool perspective : {false, true}) {
            const Vec3 middle = field->centres_world().centre();
            const Camera camera = perspective
                                      ? Camera::perspective(middle + Vec3(1.0, 0.8, 2.5), middle, Vec3(0, 1, 0), 35.0)
                                      : of(*field);
            const Scene scene = scene_of(field);
            const Image judge = by_reference(scene, camera, {50, 44});
            for (const std::vector<std::string>& names :
                 {std::vector<std::string>{"quads"}, {"single_calls"}, {"one_slab"}, {"quads", "single_calls"}}) {
                const Difference difference = between(by(names, scene, camera, {50, 44}), judge, names.front());
                EXPECT_LT(difference.rmse, 2e-5) << names.front();
                EXPECT_LT(difference.p99_9, 2e-4) << names.front();
            }
        }
    }
}

TEST_F(ComparatorTests, QuadsAndSingleCallsChangeNoTexel) {
    const auto field = blobs(14);
    const Scene scene = scene_of(field);
    const Image plain = Renderer(on_gl()).render(scene, of(*field), {60, 52});
    EXPECT_EQ(by({"single_calls"}, scene, of(*field), {60, 52}).rgba, plain.rgba);
    EXPECT_EQ(by({"quads", "single_calls"}, scene, of(*field), {60, 52}).rgba,
              by({"quads"}, scene, of(*field), {60, 52}).rgba);
}

TEST_F(ComparatorTests, PreshadedSplattingIsAnotherPicture) {
    const auto field = blobs(24);
    const Scene scene = scene_of(field);
    const Camera camera = of(*field, Vec3(0, 0, -1));
    const Image post = Renderer(on_gl()).render(scene, camera, {96, 96});
    const Image pre = by({"preshaded"}, scene, camera, {96, 96});
    const Difference difference = compare(pre.rgba, post.rgba, 4);
    std::printf("pre-shaded against post-shaded: rmse %.3f max %.3f\n", difference.rmse, difference.maximum);
    EXPECT_GT(difference.rmse, 1e-3);
    EXPECT_LT(difference.rmse, 0.2);
    Scene ellipsoids = scene_of(cloud(20, 0.2, 2.0));
    EXPECT_THROW(by({"preshaded"}, ellipsoids, askew(), {40, 40}), Unsupported);
    Scene xray = scene;
    xray.mode = Mode::xray;
    EXPECT_THROW(by({"preshaded"}, xray, camera, {40, 40}), Unsupported);
}

TEST_F(ComparatorTests, AverageOpacityDropsMoreKernels) {
    const auto field = blobs(24);
    Scene scene = scene_of(field);
    scene.transfer_function = saturating();
    scene.slice_spacing = 0.5 / 24.0;
    const Camera camera = of(*field, Vec3(0, 0, -1));
    const RendererOptions buffered = on_gl({{"opacity_buffer", true}});
    const Image exact = Renderer(buffered).render(scene, camera, {96, 96});
    const Image average = by({"average_opacity"}, scene, camera, {96, 96}, buffered);
    std::printf("hidden: %.0f exactly, %.0f by the average\n", exact.stats.at("kernels_hidden"),
                average.stats.at("kernels_hidden"));
    EXPECT_GT(exact.stats.at("kernels_hidden"), 0.0);
    EXPECT_GE(average.stats.at("kernels_hidden"), exact.stats.at("kernels_hidden"));
    EXPECT_LT(compare(average.rgba, exact.rgba, 4).rmse, 0.05);
}

TEST_F(ComparatorTests, BareFillsBlendTheFramesFragments) {
    const Scene scene = scene_of(cloud(200, 0.1, 5.0));
    const Image frame = by({"count_fragments"}, scene, askew(4.0), {64, 64});
    const Image bare = by({"bare_fill", "count_fragments"}, scene, askew(4.0), {64, 64});
    EXPECT_GT(frame.stats.at("fragments"), 0.0);
    EXPECT_EQ(bare.stats.at("fragments"), frame.stats.at("fragments"));
    EXPECT_EQ(bare.stats.at("splats"), frame.stats.at("splats"));
    for (const float value : bare.rgba) {
        EXPECT_EQ(value, 0.0F) << "nothing is shaded";
    }
    EXPECT_EQ(Renderer(on_gl()).render(scene, askew(4.0), {64, 64}).stats.count("fragments"), 0U);
}

TEST_F(ComparatorTests, ThePaperDrawsOneQuadAKernelAndSlice) {
    const Scene scene = scene_of(cloud(200, 0.1, 5.0));
    const Camera camera = askew(4.0); // all of every kernel is in the picture
    const Image one_by_one = by({"one_slab", "quads", "count_fragments"}, scene, camera, {64, 64});
    const Image paper_way = by({"count_fragments"}, scene, camera, {64, 64}, on_gl({{"paper_slicing", true}}));
    EXPECT_EQ(paper_way.stats.at("splats"), one_by_one.stats.at("splats"));
    // The polygon of equation 13 is the square around the unit sphere's disc, whatever the section's own radius.
    EXPECT_GT(paper_way.stats.at("fragments"), one_by_one.stats.at("fragments"));
    EXPECT_LT(paper_way.stats.at("fragments"), 4.0 * one_by_one.stats.at("fragments"));
}

TEST_F(ComparatorTests, AreGoneAfterAnError) {
    const Scene scene = scene_of(cloud(50, 0.2, 5.0));
    Renderer renderer(on_gl());
    const Image plain = renderer.render(scene, askew(), {40, 40});
    const auto stop = [](double share) { return share < 0.3; };
    EXPECT_THROW(render(renderer, comparators_of({"gather", "count_fragments"}), scene, askew(), {40, 40}, {}, stop),
                 Cancelled);
    EXPECT_EQ(renderer.render(scene, askew(), {40, 40}).rgba, plain.rgba);
}

TEST(Comparators, HaveNames) {
    EXPECT_EQ(comparator_names().size(), 9U);
    EXPECT_TRUE(comparators_of({"gather", "quads"}).quads);
    EXPECT_FALSE(comparators_of({"gather"}).quads);
    EXPECT_THROW(comparators_of({"gathering"}), InvalidInput);
}

TEST_F(ComparatorTests, FillTestsTakeTime) {
    EXPECT_GT(fill_test(1000, 5.0, 64, 64, 2, 3).wall, 0.0);
    EXPECT_THROW(fill_test(10, 5.0, 64, 64, 5), InvalidInput);
    EXPECT_THROW(fill_test(10, 0.5, 64, 64), InvalidInput);
}

} // namespace
} // namespace sheetsplat::lab

// What a plan is told of fields and views.
#include <array>
#include <cmath>
#include <cstdint>
#include <memory>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include "facts/extreme_blocks.hpp"
#include "facts/view_facts.hpp"
#include "support/lattices.hpp"

namespace sheetsplat {
namespace {

TEST(EllipsoidFacts, CountWhatAPlanAsksFor) {
    EllipsoidArrays arrays;
    arrays.centers = {Vec3(-1.0, -1.0, -1.0), Vec3(1.0, 1.0, 1.0), Vec3(0.0), Vec3(0.5, 0.0, 0.0)};
    arrays.scales = {Vec3(0.5), Vec3(0.5, 0.25, 0.125), Vec3(0.01, 0.5, 0.5), Vec3(0.04, 0.05, 0.04)};
    arrays.values = {1.0, 1.0, 1.0, 1.0};
    const auto field = std::make_shared<const EllipsoidField>(std::move(arrays));
    const Camera camera = Camera::orthographic(Vec3(0.0, 0.0, 5.0), Vec3(0.0), Vec3(0.0, 1.0, 0.0), 4.0);
    const auto seen = [&](const Camera& by, Size size, double slice_spacing) {
        Scene scene{{field}, TransferFunction({{0.0, {1, 1, 1}, 0.0}, {1.0, {1, 1, 1}, 0.5}})};
        scene.slice_spacing = slice_spacing;
        return make_frame(scene, by, size);
    };
    const Frame frame = seen(camera, {80, 80}, 0.1); // pixels of 0.05
    const auto survey = [](const EllipsoidField& of, const Camera& by, const Frame& in) {
        return survey_ellipsoids(of, survey_kernels(of), by, in);
    };
    const EllipsoidFacts facts = survey(*field, camera, frame);
    const KernelFacts kernels = survey_kernels(*field);
    EXPECT_NEAR(kernels.largest_aspect, 50.0, 1e-12);
    EXPECT_EQ(facts.unresolved, 2U) << "the disc is thinner than a pixel, the last one than a slice distance";
    // The filter adds twice the slice distance at a falloff of 8.
    EXPECT_NEAR(facts.largest_change, 400.0, 1e-9);
    EXPECT_NEAR(facts.smallest_px, 0.2, 1e-12);
    const Box box = field->supports_world();
    const Vec3 edge = box.extent();
    const double volume = 4.0 / 3.0 * 3.14159265358979323846 * (0.125 + 0.015625 + 0.0025 + 0.00008);
    EXPECT_NEAR(kernels.mean_overlap, volume / (edge.x * edge.y * edge.z), 1e-12);
    // In perspective a pixel grows with depth.
    const Camera deep = Camera::perspective(Vec3(0.0, 0.0, 50.0), Vec3(0.0), Vec3(0.0, 1.0, 0.0), 10.0);
    const Frame far = seen(deep, {80, 80}, 0.001);
    const EllipsoidFacts seen_deep = survey(*field, deep, far);
    EXPECT_EQ(seen_deep.unresolved, 2U) << "pixels of 0.11: the disc and the last one";
    EXPECT_NEAR(seen_deep.smallest_px, 0.01 / (50.0 * far.pixel), 1e-12) << "the disc's own depth";
    // Where bounds tell, no kernel is looked at: a picture in which all are resolved, and one in which none is.
    EXPECT_EQ(survey(*field, camera, seen(camera, {8000, 8000}, 0.001)).unresolved, 0U);
    EXPECT_EQ(survey(*field, camera, seen(camera, {2, 2}, 0.001)).unresolved, 4U);
    const EllipsoidField empty(EllipsoidArrays{});
    const EllipsoidFacts nothing = survey(empty, camera, frame);
    EXPECT_EQ(nothing.unresolved, 0U);
    EXPECT_EQ(survey_kernels(empty).mean_overlap, 0.0);
}

TEST(WeightFacts, AreExtremesOverTheKernels) {
    EllipsoidArrays arrays;
    arrays.centers = {Vec3(0.0), Vec3(1.0), Vec3(2.0)};
    arrays.radii = {1.0, 1.0, 0.5};
    arrays.values = {2.0, -3.0, 5.0};
    arrays.weights = {0.5, 4.0, 0.0};
    const EllipsoidField field(std::move(arrays));
    const WeightFacts weights = survey_weights(field);
    EXPECT_EQ(weights.low, -12.0);
    EXPECT_EQ(weights.high, 1.0);
    EXPECT_EQ(weights.most, 4.0);
    EXPECT_EQ(weights.least, 0.5);
    EXPECT_EQ(weights.alone, 3.0);
    // A filter leaves the mass of a kernel, in a volume of a pixel by a pixel by a slice spacing.
    const WeightFacts filtered = survey_filtered_weights(field, {2.0, 4.0});
    EXPECT_NEAR(filtered.most, 4.0 / 16.0, 1e-15);
    EXPECT_NEAR(filtered.low, -12.0 / 16.0, 1e-15);
    EXPECT_EQ(survey_filtered_weights(field, {0.1, 0.1}).low, weights.low) << "kernels are never heightened";
}

TEST(ExtremeFacts, TellFewSamplesFromMany) {
    const auto facts = [](bool few, bool smallest = false, const std::vector<Clip::Plane>& kept = {}) {
        constexpr std::size_t edge = 40;
        std::vector<std::uint8_t> samples(edge * edge * edge, 0);
        for (std::size_t at = 0; at < samples.size(); at += few ? 50 : 1) {
            samples[at] = few ? 255 : static_cast<std::uint8_t>(1 + at % 7);
        }
        const auto field = std::make_shared<const RegularField>(
            std::move(samples), std::array<std::size_t, 3>{edge, edge, edge}, test::zero_boundary());
        Scene scene{{field}, TransferFunction({{0.0, {1, 1, 1}, 0.0}, {1.0, {1, 1, 1}, 0.5}})};
        const Camera camera = Camera::fit(field->supports_world(), Vec3(0.4, 0.3, -1.0), Vec3(0.0, 1.0, 0.0));
        return extreme_facts(*field, 1.01, smallest ? 1.0 : -1.0, false, kept, camera,
                             make_frame(scene, camera, {60, 60}));
    };
    const ExtremeFacts few = facts(true), many = facts(false);
    EXPECT_NEAR(few.drawn, 0.02, 0.01);
    EXPECT_EQ(many.drawn, 1.0);
    EXPECT_GT(few.left, 0.3);
    EXPECT_GT(many.left, 0.9) << "noise";
    const ExtremeFacts least = facts(true, true), least_of_many = facts(false, true);
    EXPECT_LT(least.left, 0.02) << "nothing is below 0";
    EXPECT_LT(least.asked, 0.2) << "nor is it asked for";
    EXPECT_EQ(few.asked, 1.0);
    EXPECT_LT(least_of_many.left, 0.8) << "what is above 0 is least where kernels end";
    EXPECT_EQ(facts(false, false, {{Vec3(0.0, 0.0, 1.0), 1e3}}).drawn, 0.0) << "all is cut off";
    const double cut = facts(true, true, {{Vec3(1.0, 1.0, 0.0), 40.0}}).asked;
    EXPECT_GT(cut, 0.0);
    EXPECT_LT(cut, 0.5) << "of the kept points too, few are asked for";
}

TEST(ViewFacts, GatherTheExtremesOfAllFields) {
    const auto lattice = std::make_shared<RegularField>(std::vector<float>(8, 1.0F),
                                                        std::array<std::size_t, 3>{2, 2, 2}, test::zero_boundary());
    EllipsoidArrays arrays;
    arrays.centers = {Vec3(0.5), Vec3(0.6)};
    arrays.scales = {Vec3(1.0, 0.5, 0.25), Vec3(0.5)};
    arrays.values = {1.0, 1.0};
    arrays.weights = {1.0, 2.0};
    const auto scattered = std::make_shared<EllipsoidField>(std::move(arrays));
    Scene scene{{lattice, scattered}, TransferFunction({{0.0, {1, 1, 1}, 0.0}, {1.0, {1, 1, 1}, 0.5}})};
    scene.slice_spacing = 0.5;
    const Camera camera = Camera::orthographic(Vec3(0.5, 0.5, 9.0), Vec3(0.5), Vec3(0.0, 1.0, 0.0), 8.0);
    const Frame frame = make_frame(scene, camera, {40, 40}); // pixels of 0.2
    FieldSurveys surveys;
    const ViewFacts facts = view_facts(scene, camera, frame, surveys);
    EXPECT_EQ(facts.frame.size.width, 40);
    EXPECT_EQ(facts.frame.slices, frame.slices);
    EXPECT_NEAR(facts.frame.smallest_step(), 0.2, 1e-12);
    EXPECT_EQ(facts.frame.farthest_depth, frame.depth_of(frame.slices));
    EXPECT_EQ(facts.kernels.all, 10U);
    EXPECT_TRUE(facts.kernels.ellipsoids);
    EXPECT_EQ(facts.kernels.most_ellipsoids, 2U);
    EXPECT_EQ(facts.kernels.unresolved, 0U);
    EXPECT_NEAR(facts.shapes.largest_aspect, 4.0, 1e-12);
    EXPECT_NEAR(facts.shapes.largest_filtering, 16.0, 1e-12)
        << "what the filter adds along the view over the shortest semi-axis, squared";
    EXPECT_NEAR(facts.screen_px.largest_lattice, 10.0, 1e-9) << "a radius of 2";
    EXPECT_NEAR(facts.screen_px.largest_ellipsoid, 5.0, 1e-9);
    EXPECT_NEAR(facts.screen_px.smallest, 0.25 / 0.2, 1e-9);
    EXPECT_NEAR(facts.slabs.thickest, 2.0, 1e-12) << "a slab over the shortest semi-axis";
    EXPECT_NEAR(facts.slabs.widest, std::sqrt(lattice->kernel().falloff) * 0.25, 1e-12);
    EXPECT_EQ(facts.weights.at(scattered.get()).most, 2.0);
    EXPECT_GT(facts.lattice_peaks.at(lattice.get()), 0.9);
    const Camera near = Camera::perspective(Vec3(0.5, 0.5, 9.0), Vec3(0.5), Vec3(0.0, 1.0, 0.0), 170.0);
    const Frame wide = make_frame(scene, near, {40, 40});
    EXPECT_NEAR(view_facts(scene, near, wide, surveys).slabs.thickest, 2.0 * wide.largest_slant(), 1e-9);
    scene.filter = Filter::ewa;
    EXPECT_NEAR(view_facts(scene, near, wide, surveys).slabs.thickest, 2.0 * wide.largest_slope(), 1e-9);
    const Frame coarse = make_frame(scene, camera, {4, 4});
    const ViewFacts filtered = view_facts(scene, camera, coarse, surveys);
    EXPECT_LT(filtered.weights.at(scattered.get()).most, 2.0) << "kernels flatten";
    EXPECT_EQ(filtered.slabs.thickest, 0.0) << "kernels are as thick as a slab";
}

TEST(FieldSurveys, OthersAreDroppedUnlessTheyAreSparedAndExist) {
    const auto field = [] {
        EllipsoidArrays arrays;
        arrays.centers = {Vec3(0.0)};
        arrays.radii = {1.0};
        arrays.values = {1.0};
        return std::make_shared<const EllipsoidField>(std::move(arrays));
    };
    const std::shared_ptr<const Field> drawn = field(), other = field();
    std::shared_ptr<const Field> gone = field();
    std::vector<std::unique_ptr<FieldSurvey>> entries;
    for (const auto& one : {other, drawn, gone}) {
        entries.push_back(std::make_unique<FieldSurvey>());
        entries.back()->field = one;
    }
    gone.reset();
    const auto left = [&](bool spared) {
        keep_fields(entries, {drawn}, [spared](const FieldSurvey&, const Field&) { return spared; });
        std::vector<std::shared_ptr<const Field>> fields;
        for (const auto& entry : entries) {
            fields.push_back(entry->field.lock());
        }
        return fields;
    };
    EXPECT_EQ(left(true), (std::vector<std::shared_ptr<const Field>>{other, drawn}));
    EXPECT_EQ(left(false), std::vector<std::shared_ptr<const Field>>{drawn});
}

} // namespace
} // namespace sheetsplat

// Slices, and which kernels are drawn for which slab.
#include <cmath>
#include <map>
#include <random>
#include <set>

#include <gtest/gtest.h>

#include "sheetsplat/error.hpp"
#include "support/lattices.hpp"
#include "view/slab_batches.hpp"

namespace sheetsplat {
namespace {

std::shared_ptr<const RegularField> random_field(Lattice lattice, Vec3 spacing, unsigned seed) {
    std::mt19937 random(seed);
    std::uniform_real_distribution<float> uniform(0.1F, 1.0F);
    const std::array<std::size_t, 3> shape{5, 6, 7};
    std::vector<float> samples(5 * 6 * 7);
    for (float& sample : samples) {
        sample = uniform(random) < 0.3F ? 0.0F : uniform(random);
    }
    RegularFieldOptions options = test::zero_boundary();
    options.lattice = lattice;
    options.spacing = spacing;
    options.origin = Vec3(100.0, -3.0, 7.0);
    return std::make_shared<RegularField>(std::move(samples), shape, options);
}

Scene scene_of(const std::shared_ptr<const RegularField>& field, double spacing) {
    Scene scene{{field}, TransferFunction({{0.0, {1, 1, 1}, 0.0}, {1.0, {1, 1, 1}, 0.5}})};
    scene.slice_spacing = spacing;
    return scene;
}

struct Setup {
    Lattice lattice;
    Vec3 spacing;
    double slice_spacing;
    Projection projection;
    Sampling sampling;
    BatchLayout layout;
};

TEST(SlabBatches, DrawEveryKernelOnceInEverySlabThatItMeets) {
    std::mt19937 random(5);
    std::uniform_real_distribution<double> uniform(-1.0, 1.0);
    int checked = 0;
    for (const Lattice lattice : {Lattice::cartesian, Lattice::bcc}) {
        for (const Vec3 spacing : {Vec3(1.0), Vec3(1.0, 0.5, 2.5)}) {
            for (const double slice_spacing : {1.0, 0.37, 2.9}) {
                for (const Projection projection : {Projection::orthographic, Projection::perspective}) {
                    for (const Sampling sampling : {Sampling::point, Sampling::slab}) {
                        for (const BatchLayout layout : {BatchLayout{4, 8}, BatchLayout{1, 4}, BatchLayout{1, 1}}) {
                            auto field = random_field(lattice, spacing, static_cast<unsigned>(++checked));
                            const Scene scene = scene_of(field, slice_spacing);
                            const Vec3 direction(uniform(random), uniform(random), uniform(random) - 1.5);
                            const Camera camera =
                                Camera::fit(field->supports_world(), direction, Vec3(0, 1, 0), projection);
                            const Frame frame = make_frame(scene, camera, {40, 30});
                            const FieldView view = make_field_view(*field, camera, frame, sampling, 1.0);
                            const VisibleRuns runs = VisibleRuns::of(*field, VisibilityQuery{});
                            const SlabBatches batches = SlabBatches::of(view, runs, frame, sampling, layout);
                            // sample -> slabs that it is drawn to
                            std::map<std::uint32_t, std::multiset<std::int64_t>> drawn;
                            for (std::size_t batch = 0; batch < batches.batches(); ++batch) {
                                for (const std::uint32_t* entry = batches.begin(batch); entry != batches.end(batch);
                                     ++entry) {
                                    for (int slab = 0; slab < layout.covered; ++slab) {
                                        drawn[*entry].insert(static_cast<std::int64_t>(batch) * layout.stride + slab);
                                    }
                                }
                            }
                            const auto& shape = field->shape();
                            std::size_t kernels = 0;
                            for (std::size_t k = 0; k < shape[0]; ++k) {
                                for (std::size_t j = 0; j < shape[1]; ++j) {
                                    for (std::size_t i = 0; i < shape[2]; ++i) {
                                        const auto sample =
                                            static_cast<std::uint32_t>((k * shape[1] + j) * shape[2] + i);
                                        if (field->value(i, j, k) == 0.0) {
                                            EXPECT_EQ(drawn.count(sample), 0U);
                                            continue;
                                        }
                                        const double depth = -camera.to_eye(field->position(i, j, k)).z;
                                        bool met = false;
                                        for (std::int64_t slice = 0; slice < frame.slices; ++slice) {
                                            const double away = std::abs(frame.depth_of(slice) - depth);
                                            const double reach =
                                                view.half_depth +
                                                (sampling == Sampling::slab ? 0.5 * slice_spacing : 0.0);
                                            const std::size_t times = drawn[sample].count(slice);
                                            EXPECT_LE(times, 1U) << "drawn twice into slab " << slice;
                                            if (away < reach * (1.0 - 1e-9)) {
                                                EXPECT_EQ(times, 1U) << "missing in slab " << slice;
                                                met = true;
                                            }
                                        }
                                        kernels += met ? 1 : 0;
                                    }
                                }
                            }
                            EXPECT_EQ(batches.kernels(), kernels);
                        }
                    }
                }
            }
        }
    }
    EXPECT_EQ(checked, 144);
}

TEST(Frame, AnchorsSlicesAtTheCentreOfAllKernels) {
    auto field = random_field(Lattice::cartesian, Vec3(1.0), 3);
    const Scene scene = scene_of(field, 0.7);
    for (const Vec3 direction : {Vec3(0, 0, -1), Vec3(1, 2, -3), Vec3(-1, 0.2, 0.4)}) {
        const Camera camera = Camera::fit(field->supports_world(), direction, Vec3(0, 1, 0));
        const Frame frame = make_frame(scene, camera, {8, 8});
        const double centre = -camera.to_eye(field->centres_world().centre()).z;
        const double n = (frame.depth_of(0) - centre) / 0.7 - 0.5;
        EXPECT_NEAR(n, static_cast<double>(frame.first_slice), 1e-9);
        // Every kernel lies between the first and the last slab.
        const FieldView view = make_field_view(*field, camera, frame, Sampling::point, 1.0);
        const auto& shape = field->shape();
        for (const std::size_t k : {std::size_t{0}, shape[0] - 1}) {
            const double depth = -view.eye_position(0, 0, k).z;
            EXPECT_GE(depth - view.half_depth, frame.depth_of(0) - 0.35 - 1e-9);
            EXPECT_LE(depth + view.half_depth, frame.depth_of(frame.slices - 1) + 0.35 + 1e-9);
        }
    }
}

TEST(Frame, HasNoSliceAtOrBeforeNear) {
    auto field = random_field(Lattice::cartesian, Vec3(1.0), 3);
    const Scene scene = scene_of(field, 0.5);
    const Vec3 centre = field->centres_world().centre();
    const Camera camera = Camera::perspective(centre, centre + Vec3(0, 0, -1), Vec3(0, 1, 0), 60.0, 0.25);
    const Frame frame = make_frame(scene, camera, {8, 8});
    EXPECT_TRUE(frame.cut_by_near);
    EXPECT_GT(frame.depth_of(0), 0.25);
    EXPECT_LE(frame.depth_of(-1), 0.25);
}

TEST(Frame, RefusesTooManySlicesAndEmptySizes) {
    auto field = random_field(Lattice::cartesian, Vec3(1.0), 3);
    const Camera camera = Camera::fit(field->supports_world(), Vec3(0, 0, -1), Vec3(0, 1, 0));
    EXPECT_THROW(make_frame(scene_of(field, 1e-8), camera, {8, 8}), InvalidInput);
    EXPECT_THROW(make_frame(scene_of(field, 1.0), camera, {0, 8}), InvalidInput);
}

TEST(FieldView, SlicesTheSupportWhereItsEquationDoes) {
    // A point of the cross-section's edge satisfies |M^-1 (x - c)| = 1, for unequal spacing seen askew.
    auto field = random_field(Lattice::cartesian, Vec3(1.0, 0.4, 2.7), 3);
    const Scene scene = scene_of(field, 0.5);
    const Camera camera = Camera::fit(field->supports_world(), Vec3(1.0, -0.7, -0.4), Vec3(0.1, 1, 0));
    const Frame frame = make_frame(scene, camera, {40, 40});
    const FieldView view = make_field_view(*field, camera, frame, Sampling::point, 1.0);
    EXPECT_TRUE(view.sheared);
    const Vec3 axes = field->kernel_axes().lengths;
    const glm::dmat2 plane = glm::inverse(view.to_unit);
    for (double s = -0.9; s < 1.0; s += 0.3) {
        for (double angle = 0.0; angle < 6.0; angle += 0.7) {
            const double radius = std::sqrt(1.0 - s * s);
            const glm::dvec2 ab(radius * std::cos(angle), radius * std::sin(angle));
            const glm::dvec2 xy = plane * (ab + s * view.shear);
            // s is the height: z relative to the centre is s h.
            const Vec3 world =
                xy.x * camera.right_world() + xy.y * camera.up_world() + s * view.half_depth * camera.back_world();
            const Vec3 unit = world / axes;
            EXPECT_NEAR(std::sqrt(unit.x * unit.x + unit.y * unit.y + unit.z * unit.z), 1.0, 1e-12);
        }
    }
}

} // namespace
} // namespace sheetsplat

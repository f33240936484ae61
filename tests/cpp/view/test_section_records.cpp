// What the GPU gets of ellipsoids.
#include <array>
#include <cmath>
#include <limits>
#include <memory>
#include <vector>

#include <gtest/gtest.h>

#include "view/ellipsoid_views.hpp"

namespace sheetsplat {
namespace {

struct Decoded {
    glm::dvec2 center, u, v;
    double s;
};
Decoded decoded(const SectionRecord& record, const Frame& frame, std::int64_t slice) {
    const double since = static_cast<double>(slice) - static_cast<double>(record.first);
    glm::dvec2 moved = since * glm::dvec2(record.step_x, record.step_y);
    if (frame.projection == Projection::perspective) {
        moved /= frame.depth_of(slice);
    }
    Decoded section;
    section.center = glm::dvec2(record.whole_x, record.whole_y) + (glm::dvec2(record.part_x, record.part_y) + moved);
    section.u = glm::dvec2(record.ux, record.uy);
    section.v = glm::dvec2(record.vx, record.vy);
    section.s = static_cast<double>(record.s) - since * static_cast<double>(record.step_s);
    return section;
}

/// The same in float64, straight from the kernel.
Decoded exact(const EyeKernel& kernel, const Frame& frame, std::int64_t slice) {
    const double depth = frame.depth_of(slice);
    const double scale = frame.projection == Projection::perspective ? depth : 1.0;
    const auto screen = [&](const glm::dvec2& eye) { return glm::dvec2(eye.x, -eye.y) / frame.pixel; };
    Decoded section;
    section.s = (-kernel.center.z - depth) / kernel.half_depth;
    section.center = screen(glm::dvec2(kernel.center) + section.s * kernel.lean) / scale;
    section.u = screen(kernel.axis_u);
    section.v = screen(kernel.axis_v);
    return section;
}

/// Largest distance of a section's parts in the plane of the unit sphere: place, axes and height.
double distance(const Decoded& a, const Decoded& b, double scale) {
    const auto in_plane = [&](const glm::dvec2& px) {
        return std::hypot(glm::dot(px, b.u) / glm::dot(b.u, b.u), glm::dot(px, b.v) / glm::dot(b.v, b.v));
    };
    return std::max(
        {scale * in_plane(a.center - b.center), in_plane(a.u - b.u), in_plane(a.v - b.v), std::abs(a.s - b.s)});
}

struct Far {
    const char* name;
    bool deep;
    double height; ///< of the picture in world units, or per unit of depth
    double offset; ///< of the kernels from the optical axis, world units
};

class Records : public testing::TestWithParam<Far> {};

TEST_P(Records, HoldTheSectionsOfABatch) {
    const Far& far = GetParam();
    for (const double aspect : {1.0, 2.0, 50.0, 1000.0}) {
        Random random(6);
        const double spacing = 0.05;
        const Vec3 target(0.3, -0.2, 0.1);
        const Camera camera = far.deep ? Camera::perspective(target + Vec3(3.0, 1.4, 2.2), target, Vec3(0.1, 1.0, 0.2),
                                                             2.0 * std::atan(0.5 * far.height) * 180.0 / pi, 0.01)
                                       : orthographic(far.height, target);
        EllipsoidArrays arrays;
        for (int n = 0; n < 40; ++n) {
            arrays.centers.push_back(target + random.in_cube() +
                                     far.offset * (random.chance(0.5) ? camera.right_world() : camera.up_world()));
            arrays.scales.push_back(random_axes(random, 2.0 / aspect, aspect));
            arrays.rotations.push_back(test::random_rotation(random));
            arrays.values.push_back(random.uniform(-1.0, 1.0));
            arrays.weights.push_back(random.uniform(0.0, 2.0));
        }
        const Look look(field_of(std::move(arrays)), camera, {512, 512}, spacing, Sampling::point, Filter::none, 0.5);
        double worst = 0.0, farthest = 0.0, worst_edge = 0.0;
        for (std::size_t i = 0; i < look.field->size(); ++i) {
            const EyeKernel kernel = look.view.kernel(i);
            const EllipsoidView::Span span = look.view.span(look.view.depths(i));
            // Record by record for batches of eight slabs, and one for all.
            for (std::int64_t first = -4; first <= span.last; first = first < 0 ? span.first / 4 * 4 : first + 8) {
                const std::int64_t begin = std::max<std::int64_t>(first, 0);
                const std::int64_t last =
                    first < 0 ? look.frame.slices - 1 : std::min(first + 7, look.frame.slices - 1);
                const SectionRecord record = look.view.record(i, kernel, look.view.anchor(kernel, begin, last));
                EXPECT_GE(record.part_x, 0.0F);
                EXPECT_LE(record.part_x, 1.0F);
                EXPECT_EQ(record.whole_y, std::floor(record.whole_y));
                for (std::int64_t slice = std::max(begin, span.first); slice <= std::min(last, span.last); ++slice) {
                    const double scale = far.deep ? look.frame.depth_of(slice) : 1.0;
                    const Decoded got = decoded(record, look.frame, slice);
                    const Decoded wanted = exact(kernel, look.frame, slice);
                    worst = std::max(worst, distance(got, wanted, scale));
                    farthest = std::max(farthest, glm::length(wanted.center));
                    // And its edge lies on the ellipsoid itself.
                    const double radius = std::sqrt(std::max(0.0, 1.0 - got.s * got.s));
                    for (const double angle : {0.2, 1.7, 3.5, 5.1}) {
                        const glm::dvec2 px =
                            got.center * scale + radius * (std::cos(angle) * got.u + std::sin(angle) * got.v);
                        const Vec3 eye(px.x * look.frame.pixel, -px.y * look.frame.pixel, -look.frame.depth_of(slice));
                        const double r = unit_radius(look.rotation(i), look.field->semi_axes(i),
                                                     look.world(eye) - look.field->center(i));
                        worst_edge = std::max(worst_edge, std::abs(r - 1.0));
                    }
                }
                EXPECT_NEAR(static_cast<double>(record.value),
                            look.field->value(i) * look.field->weight(i) * look.view.value_scale(), 1e-6);
                EXPECT_NEAR(static_cast<double>(record.weight), look.field->weight(i) * look.view.weight_scale(), 1e-6);
            }
        }
        EXPECT_LE(worst, std::max(1e-7, 6e-8 * aspect)) << "more than float32's own steps";
        EXPECT_LE(worst_edge, std::max(1e-7, 2e-8 * aspect));
        EXPECT_GT(worst_edge, 1e-9) << "float32 cannot be so good: nothing was compared";
        if (far.offset > 0.0) {
            EXPECT_GT(farthest, 1e6);
        }
    }
}

INSTANTIATE_TEST_SUITE_P(Far, Records,
                         testing::Values(Far{"whole", false, 3.0, 0.0}, Far{"zoomed", false, 1e-3, 0.0},
                                         Far{"aside", false, 1e-3, 5.0}, Far{"perspective", true, 0.9, 0.0},
                                         Far{"perspective_zoomed", true, 3e-4, 0.0},
                                         Far{"perspective_aside", true, 3e-4, 3.0}),
                         [](const auto& one) { return std::string(one.param.name); });

TEST(EllipsoidView, RecordsHoldWhereTheEyeIsInsideTheKernel) {
    // The first slices may lie as close to the eye as the near plane allows, where places on the screen are huge.
    for (const double near : {1e-2, 1e-4, 1e-6}) {
        for (const double aspect : {1.0, 20.0}) {
            Random random(7);
            EllipsoidArrays arrays;
            const Camera camera = Camera::perspective(Vec3(0.0), Vec3(1.0, 2.0, -0.5), Vec3(0.0, 0.0, 1.0), 60.0, near);
            for (int n = 0; n < 200; ++n) {
                arrays.centers.push_back(4.0 * random.in_cube());
                arrays.scales.push_back(random_axes(random, 8.0 / aspect, aspect));
                arrays.rotations.push_back(test::random_rotation(random));
                arrays.values.push_back(1.0);
            }
            const Look look(field_of(std::move(arrays)), camera, {64, 64}, 0.125);
            double worst = 0.0, closest = 1.0;
            for (std::size_t i = 0; i < look.field->size(); ++i) {
                const EyeKernel kernel = look.view.kernel(i);
                const EllipsoidView::Span span = look.view.span(look.view.depths(i));
                Frame frame = look.frame;
                // Slices as they may happen to lie: the first one just behind the near plane.
                frame.first_depth = 1.01 * near;
                const EllipsoidView view(*look.field, camera, frame, Sampling::point, Filter::none, 1.0, 1.0);
                for (std::int64_t first = -4; first <= span.last; first = first < 0 ? span.first / 4 * 4 : first + 8) {
                    const std::int64_t begin = std::max<std::int64_t>(first, 0);
                    const std::int64_t last = first < 0 ? frame.slices - 1 : std::min(first + 7, frame.slices - 1);
                    const SectionRecord record = view.record(i, kernel, view.anchor(kernel, begin, last));
                    for (std::int64_t slice = std::max(begin, span.first); slice <= std::min(last, span.last);
                         ++slice) {
                        const double depth = frame.depth_of(slice);
                        closest = std::min(closest, depth);
                        worst = std::max(worst,
                                         distance(decoded(record, frame, slice), exact(kernel, frame, slice), depth));
                    }
                }
            }
            EXPECT_LE(worst, std::max(2e-7, 6e-8 * aspect));
            EXPECT_LT(closest, 1.1 * near);
        }
    }
}

TEST(EllipsoidView, CountedValuesAreTheWeightsThemselvesAtTheEndsOfTheRange) {
    Random random(15);
    EllipsoidArrays arrays;
    for (int n = 0; n < 200; ++n) {
        arrays.centers.push_back(random.in_cube());
        arrays.radii.push_back(0.1);
        arrays.values.push_back(n % 3 == 0 ? 0.1 : n % 3 == 1 ? 0.7 : 0.1 + 0.6 * random.uniform(0.0, 1.0));
        arrays.weights.push_back(n % 30 == 2 ? 0.0 : 0.01 + random.uniform(0.0, 1.0));
    }
    const Look look(field_of(std::move(arrays)), perspective(), {50, 50}, 0.1);
    const std::array<double, 2> range = look.field->value_range();
    const Counting counting{0.5 * range[0] + 0.5 * range[1], 0.5 * range[1] - 0.5 * range[0]};
    for (std::size_t i = 0; i < look.field->size(); ++i) {
        const EyeKernel kernel = look.view.kernel(i);
        const SectionRecord plain = look.view.record(i, kernel, 0);
        const SectionRecord record = look.view.record(i, kernel, 0, nullptr, counting);
        EXPECT_EQ(record.weight, plain.weight);
        // A weight of 0 reaches as one of next to nothing, and a value of 0.
        const double value = i % 30 == 2 ? 0.0 : look.field->value(i), weight = static_cast<double>(record.weight);
        EXPECT_GT(weight, 0.0);
        if (i % 3 == 2) {
            const double restored = counting.pivot + counting.half_range * static_cast<double>(record.value) / weight;
            EXPECT_NEAR(restored, value, 1e-7);
        } else {
            EXPECT_EQ(record.value, i % 3 == 0 ? -record.weight : record.weight) << "kernel " << i;
        }
    }
    // Without a range all values are the pivot.
    EXPECT_EQ((Counting{0.3, 1.0}.amount(0.3, 0.7F, 1.0)), 0.0F);
}

TEST(EllipsoidView, RecordsKeepPlacesBeyondTwoToThe24Pixels) {
    EllipsoidArrays arrays;
    arrays.centers = {Vec3(1234567890.123, -9876543210.456, 0.0)};
    arrays.radii = {1e10};
    arrays.values = {1.0};
    const Camera camera = Camera::orthographic(Vec3(0.0, 0.0, 5.0), Vec3(0.0), Vec3(0.0, 1.0, 0.0), 50.0);
    const Look look(field_of(std::move(arrays)), camera, {50, 50}, 1e9); // pixels of 1
    SectionRest rest{};
    const SectionRecord record = look.view.record(0, look.view.kernel(0), 10, &rest);
    const auto sum = [](float whole, float part, float left) {
        return static_cast<double>(whole) + static_cast<double>(part) + static_cast<double>(left);
    };
    EXPECT_NEAR(sum(record.whole_x, record.part_x, rest.part_x), 1234567890.123, 1e-5);
    EXPECT_NEAR(sum(record.whole_y, record.part_y, rest.part_y), 9876543210.456, 1e-5);
}

TEST(EllipsoidView, RecordsWithTheirRestsKeepNeedlesOfOneToAHundredThousand) {
    Random random(14);
    for (const bool deep : {false, true}) {
        EllipsoidArrays arrays;
        for (int n = 0; n < 40; ++n) {
            arrays.centers.push_back(random.in_cube());
            arrays.scales.push_back(random_axes(random, 1e-5, 1e5));
            arrays.rotations.push_back(test::random_rotation(random));
            arrays.values.push_back(1.0);
        }
        const Look look(field_of(std::move(arrays)), deep ? perspective() : orthographic(), {500, 500}, 0.01);
        double rough = 0.0, fine = 0.0;
        for (std::size_t i = 0; i < look.field->size(); ++i) {
            const EyeKernel kernel = look.view.kernel(i);
            const EllipsoidView::Span span = look.view.span(look.view.depths(i));
            for (std::int64_t first = span.first / 4 * 4; first <= span.last; first += 8) {
                const std::int64_t last = std::min(first + 7, look.frame.slices - 1);
                SectionRest rest{};
                const SectionRecord record = look.view.record(i, kernel, look.view.anchor(kernel, first, last), &rest);
                for (std::int64_t slice = std::max(first, span.first); slice <= std::min(last, span.last); ++slice) {
                    const double scale = deep ? look.frame.depth_of(slice) : 1.0;
                    const Decoded wanted = exact(kernel, look.frame, slice);
                    Decoded got = decoded(record, look.frame, slice);
                    rough = std::max(rough, distance(got, wanted, scale));
                    const double since = static_cast<double>(slice) - static_cast<double>(record.first);
                    got.center +=
                        glm::dvec2(rest.part_x, rest.part_y) + since * glm::dvec2(rest.step_x, rest.step_y) / scale;
                    got.u += glm::dvec2(rest.ux, rest.uy);
                    got.v += glm::dvec2(rest.vx, rest.vy);
                    got.s += static_cast<double>(rest.s) - since * static_cast<double>(rest.step_s);
                    fine = std::max(fine, distance(got, wanted, scale));
                }
            }
        }
        EXPECT_LE(fine, 1e-7);
        EXPECT_GT(rough, 1e-4) << "float32 alone would do";
    }
}

TEST(EllipsoidView, CompactKernelsStayInFloat32) {
    // The polynomial of four slabs has exponents up to k log2(e) times (3/2 + 3/2 step)^2, and slopes of three times
    // that over the way: 2^115 at most.
    int compact = 0, plain = 0;
    for (const double falloff : {1.0, 8.0, 30.0}) {
        for (const double spacing : {0.01, 0.05, 0.3}) {
            const auto scattered = random_field(13, 80, 20.0);
            EllipsoidFieldOptions options;
            options.falloff = falloff;
            const auto field = field_of(scattered->arrays(), options);
            const Look look(field, orthographic(), {50, 50}, spacing);
            const Look deep(field, perspective(), {50, 50}, spacing);
            for (std::size_t i = 0; i < field->size(); ++i) {
                EXPECT_EQ(deep.view.group(i, deep.view.depths(i), 0.0, never), SectionGroup::plain);
                const double step = glm::length(glm::inverse(look.in_eye(i)) * Vec3(0.0, 0.0, 1.0)) * spacing;
                const double far = 1.5 * (1.0 + step), exponent = 1.4426950408889634 * falloff;
                const bool fits = step <= 1.0 && exponent * far * std::max(far, 3.0 * step) < 115.0;
                EXPECT_EQ(look.view.group(i, look.view.depths(i), 0.0, never),
                          fits ? SectionGroup::compact : SectionGroup::plain)
                    << step;
                ++(fits ? compact : plain);
            }
        }
    }
    EXPECT_GT(compact, 50);
    EXPECT_GT(plain, 50);
}

TEST(EllipsoidView, ScalesValuesAndWeights) {
    EllipsoidArrays arrays;
    arrays.centers = {Vec3(0.0), Vec3(1.0)};
    arrays.radii = {0.5, 0.5};
    arrays.values = {3.0, -2.0};
    arrays.weights = {2.0, 0.0};
    const Camera camera = orthographic();
    const auto field = field_of(arrays);
    const Look look(field, camera, {8, 8}, 0.1);
    const double gain = field->kernel().gain();
    const EllipsoidView view(*field, camera, look.frame, Sampling::point, Filter::none, 0.25, 5.0);
    EXPECT_NEAR(view.weight_scale(), gain / 5.0, 1e-15);
    EXPECT_NEAR(view.value_scale(), gain / 5.0 / 0.25, 1e-14);
    const SectionRecord first = view.record(0, view.kernel(0), 0);
    EXPECT_NEAR(first.value, 6.0 * gain / 5.0 / 0.25, 1e-5);
    EXPECT_NEAR(first.weight, 2.0 * gain / 5.0, 1e-6);
    const SectionRecord second = view.record(1, view.kernel(1), 0);
    EXPECT_EQ(second.value, 0.0F);
    EXPECT_GT(second.weight, 0.0F) << "a weight of 0 still reaches";
    EXPECT_LT(second.weight, 1e-20F);

    EllipsoidFieldOptions options;
    options.normalization = Normalization::lattice;
    options.cell_volume = 0.3;
    const auto lattice = field_of(arrays, options);
    const EllipsoidView divided(*lattice, camera, look.frame, Sampling::point, Filter::none, 0.25, 5.0);
    EXPECT_NEAR(divided.value_scale(), view.value_scale() / lattice->lattice_constant(), 1e-12);
    EXPECT_NEAR(divided.weight_scale(), view.weight_scale(), 1e-15);
}

} // namespace
} // namespace sheetsplat

// The slices of a frame are those of the reference: it looks at every kernel's support, and where a frame took bounds
// instead, surfaces would be cut open by a near plane that removes nothing, and depths would lie in front of the first
// slice.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <memory>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include <glm/common.hpp>
#include <glm/geometric.hpp>

#include "facts/frame.hpp"
#include "reference/slices.hpp"
#include "support/draws.hpp"
#include "support/lattices.hpp"

namespace sheetsplat::test {
namespace {

constexpr double none = std::numeric_limits<double>::quiet_NaN();
constexpr Size size{24, 18};

enum class Kind { cartesian, ball_among_nan, bcc, bcc_with_nan, spheres, ellipsoids };

class Draws {
  public:
    explicit Draws(unsigned seed) : engine_(seed) {}
    double uniform(double low, double high) { return std::uniform_real_distribution<double>(low, high)(engine_); }
    double normal() { return std::normal_distribution<double>()(engine_); }
    std::size_t whole(std::size_t low, std::size_t high) {
        return std::uniform_int_distribution<std::size_t>(low, high)(engine_);
    }
    bool chance(double probability) { return uniform(0.0, 1.0) < probability; }
    Vec3 place(double half) {
        return three([&] { return uniform(-half, half); });
    }
    Vec3 direction() {
        return glm::normalize(three([&] { return normal(); }));
    }

  private:
    std::mt19937 engine_;
};

std::shared_ptr<const Field> lattice(Draws& draws, Kind kind) {
    RegularFieldOptions options = test::zero_boundary();
    const bool bcc = kind == Kind::bcc || kind == Kind::bcc_with_nan;
    options.lattice = bcc ? Lattice::bcc : Lattice::cartesian;
    options.boundary = Boundary::zero;
    options.nan = NanPolicy::skip;
    const double edge = draws.uniform(0.3, 1.0);
    options.spacing = bcc ? Vec3(edge) : edge * Vec3(1.0, draws.uniform(0.5, 1.5), draws.uniform(0.5, 1.5));
    options.origin = draws.place(1.0);
    const std::array<std::size_t, 3> shape{draws.whole(1, 6), draws.whole(1, 6), draws.whole(1, 6)};
    std::vector<float> values;
    const Vec3 middle = 0.5 * Vec3(shape[2], shape[1], shape[0]) - 0.5;
    const double radius = 0.6 * std::max({middle.x, middle.y, middle.z, 1.0});
    for (std::size_t k = 0; k < shape[0]; ++k) {
        for (std::size_t j = 0; j < shape[1]; ++j) {
            for (std::size_t i = 0; i < shape[2]; ++i) {
                const bool missing = kind == Kind::ball_among_nan ? glm::length(Vec3(i, j, k) - middle) > radius
                                                                  : kind == Kind::bcc_with_nan && draws.chance(0.4);
                values.push_back(static_cast<float>(missing ? none : draws.uniform(0.0, 1.0)));
            }
        }
    }
    values[values.size() / 2] = 1.0F;
    return std::make_shared<const RegularField>(values, shape, options);
}

std::shared_ptr<const Field> scattered(Draws& draws, Kind kind) {
    EllipsoidArrays arrays;
    const std::size_t count = draws.whole(1, 12);
    for (std::size_t n = 0; n < count; ++n) {
        arrays.centers.push_back(draws.place(1.0));
        arrays.values.push_back(draws.uniform(0.0, 1.0));
        if (kind == Kind::spheres) {
            arrays.radii.push_back(draws.uniform(0.05, 0.8));
        } else {
            arrays.scales.push_back(three([&] { return draws.uniform(0.05, 0.8); }));
            arrays.rotations.push_back(rotation([&] { return draws.normal(); }));
        }
    }
    return std::make_shared<const EllipsoidField>(std::move(arrays), EllipsoidFieldOptions{});
}

std::shared_ptr<const Field> field_of(Draws& draws, Kind kind) {
    return kind == Kind::spheres || kind == Kind::ellipsoids ? scattered(draws, kind) : lattice(draws, kind);
}

Scene scene_of(std::vector<std::shared_ptr<const Field>> fields, double slice_spacing) {
    Scene scene{std::move(fields), TransferFunction({{0.0, Vec3(1.0), 0.0}, {1.0, Vec3(1.0), 1.0}})};
    scene.slice_spacing = slice_spacing;
    return scene;
}

/// The slices that both have: the frame's begin with slabs that only touch a support.
void expect_same(const Scene& scene, const Camera& camera, const std::string& which) {
    const Frame frame = make_frame(scene, camera, size);
    const reference::Slices slices = reference::find_slices(scene, camera, reference::Screen(camera, size), 1.0);
    if (slices.count == 0) {
        return;
    }
    EXPECT_EQ(frame.cut_by_near, slices.cut_by_near) << which;
    EXPECT_EQ(frame.first_slice + frame.first_met, slices.first) << which;
    EXPECT_NEAR(frame.depth_of(frame.first_met), slices.depth(slices.first), 1e-9) << which;
    EXPECT_LE(frame.first_slice, slices.first) << which;
    EXPECT_GE(frame.first_slice + frame.slices - 1, slices.last()) << which;
    // A slab on either side may touch what it does not meet.
    EXPECT_LE(frame.slices, slices.count + 2) << which;
}

class FrameSlices : public testing::TestWithParam<Kind> {};

TEST_P(FrameSlices, AreThoseOfTheReference) {
    std::size_t cut = 0;
    for (unsigned seed = 0; seed < 500; ++seed) {
        Draws draws(1000 * static_cast<unsigned>(GetParam()) + seed);
        Scene scene = scene_of({field_of(draws, GetParam())}, 1.0);
        if (draws.chance(0.3)) {
            scene.fields.push_back(field_of(draws, GetParam()));
        }
        scene.slice_spacing = draws.uniform(0.1, 1.0);
        scene.filter = draws.chance(0.4) ? Filter::ewa : Filter::none;
        const Vec3 eye = draws.uniform(1.0, 12.0) * draws.direction();
        const Vec3 target = draws.place(0.3), up = draws.direction();
        const bool perspective = draws.chance(0.7);
        Camera camera =
            perspective ? Camera::perspective(eye, target, up, 50.0, 1e-3) : Camera::orthographic(eye, target, up, 3.0);
        if (perspective && draws.chance(0.7)) {
            // A near plane within half a slice of where supports begin: whether it removes any depends on their ends.
            const reference::Slices all = reference::find_slices(scene, camera, reference::Screen(camera, size), 1.0);
            const double near = all.depth(all.first) + draws.uniform(-1.0, 0.5) * all.spacing;
            camera = near > 0.0 ? Camera::perspective(eye, target, up, 50.0, near) : camera;
        }
        expect_same(scene, camera, "seed " + std::to_string(seed));
        cut += make_frame(scene, camera, size).cut_by_near ? 1 : 0;
    }
    EXPECT_GT(cut, 50U);
    EXPECT_LT(cut, 350U);
}

std::string name_of_kind(const testing::TestParamInfo<Kind>& tried) {
    static const std::array<const char*, 6> names{"Cartesian",  "BallAmongNan", "Bcc",
                                                  "BccWithNan", "Spheres",      "Ellipsoids"};
    return names[static_cast<std::size_t>(tried.param)];
}

INSTANTIATE_TEST_SUITE_P(All, FrameSlices,
                         testing::Values(Kind::cartesian, Kind::ball_among_nan, Kind::bcc, Kind::bcc_with_nan,
                                         Kind::spheres, Kind::ellipsoids),
                         name_of_kind);

/// What boxes reach is farther than what kernels do.
TEST_P(FrameSlices, ControlBoundsOfBoxesAreFound) {
    const auto box = [](const Field& field, const Vec3& from, const Vec3& direction) {
        const Box supports = field.supports_world();
        const double middle = glm::dot(supports.centre() - from, direction);
        const double half = 0.5 * glm::dot(supports.extent(), glm::abs(direction));
        return std::array<double, 2>{middle - half, middle + half};
    };
    std::size_t found = 0;
    for (unsigned seed = 0; seed < 100; ++seed) {
        Draws draws(seed);
        const Scene scene = scene_of({field_of(draws, GetParam())}, 0.3);
        const Camera camera = Camera::perspective(9.0 * draws.direction(), Vec3(0.0), draws.direction(), 50.0, 1e-3);
        const Frame bounds = make_frame(scene, camera, size, box), exact = make_frame(scene, camera, size);
        found += bounds.first_slice + bounds.first_met != exact.first_slice + exact.first_met ? 1 : 0;
    }
    EXPECT_GT(found, 30U);
}

/// Supports end exactly where slabs do, seen along an axis: all numbers are whole halves.
TEST(FrameSlices, SupportsThatEndOnTheBordersOfSlabs) {
    for (unsigned seed = 0; seed < 300; ++seed) {
        Draws draws(seed);
        Scene scene = scene_of({}, draws.chance(0.5) ? 1.0 : 0.5);
        const bool bcc = draws.chance(0.3);
        if (draws.chance(0.5)) {
            RegularFieldOptions options = test::zero_boundary();
            options.lattice = bcc ? Lattice::bcc : Lattice::cartesian;
            options.boundary = Boundary::zero;
            options.nan = NanPolicy::skip;
            const std::array<std::size_t, 3> shape{draws.whole(1, 5), draws.whole(1, 5), draws.whole(1, 5)};
            std::vector<float> values(shape[0] * shape[1] * shape[2], 1.0F);
            for (float& value : values) {
                value = draws.chance(0.2) ? static_cast<float>(none) : value;
            }
            values.front() = 1.0F;
            scene.fields.push_back(std::make_shared<const RegularField>(values, shape, options));
        } else {
            EllipsoidArrays arrays;
            for (std::size_t n = draws.whole(1, 6); n > 0; --n) {
                arrays.centers.push_back(three([&] { return static_cast<double>(draws.whole(0, 8)) / 2.0; }));
                arrays.radii.push_back(static_cast<double>(draws.whole(1, 4)) / 2.0);
                arrays.values.push_back(1.0);
            }
            scene.fields.push_back(std::make_shared<const EllipsoidField>(std::move(arrays), EllipsoidFieldOptions{}));
        }
        Vec3 eye(0.0);
        const std::size_t axis = draws.whole(0, 2);
        eye[static_cast<int>(axis)] = draws.chance(0.5) ? 16.0 : -16.0;
        const Vec3 up = axis == 1 ? Vec3(1.0, 0.0, 0.0) : Vec3(0.0, 1.0, 0.0);
        const double near = static_cast<double>(draws.whole(1, 72)) / 4.0;
        const Camera camera = draws.chance(0.7) ? Camera::perspective(eye, Vec3(0.0), up, 50.0, near)
                                                : Camera::orthographic(eye, Vec3(0.0), up, 3.0);
        expect_same(scene, camera, "seed " + std::to_string(seed));
    }
}

} // namespace
} // namespace sheetsplat::test

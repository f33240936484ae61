// The ripple's bounds hold everywhere, and are not much wider than the truth.
#include <gtest/gtest.h>

#include "index/brute_force.hpp"
#include "support/lattices.hpp"

namespace sheetsplat::test {
namespace {

RegularFieldOptions lattice_options(Lattice lattice, double radius, double falloff) {
    RegularFieldOptions options = test::zero_boundary();
    options.lattice = lattice;
    options.radius = radius;
    options.falloff = falloff;
    return options;
}

Ripple ripple_of(Lattice lattice, double radius, double falloff) {
    return lattice_ripple(RegularField(std::vector<float>{1.0F}, {1, 1, 1}, lattice_options(lattice, radius, falloff)));
}

/// Least and largest W / C found in the middle of a lattice large enough to have no borders there.
Ripple found(Lattice lattice, double radius, double falloff, int points) {
    const std::size_t n = 2 * static_cast<std::size_t>(std::ceil(radius)) + 4;
    const std::array<std::size_t, 3> shape{2 * n, n, n};
    const RegularField field(std::vector<float>(2 * n * n * n, 1.0F), shape, lattice_options(lattice, radius, falloff));
    const BruteForce brute_force(field);
    const Vec3 corner = field.position(n / 2, n / 2, lattice == Lattice::bcc ? n : n / 2);
    Ripple result{1e300, 0.0};
    Random random(5);
    const auto look = [&](const Vec3& offset) {
        const double weight = brute_force.at(corner + offset, nullptr).weights / field.lattice_constant();
        result.lower = std::min(result.lower, weight);
        result.upper = std::max(result.upper, weight);
    };
    for (int n_point = 0; n_point < points; ++n_point) {
        look(0.5 * (random.in_cube() + 1.0));
    }
    for (const double x : {0.0, 0.25, 0.5}) {
        for (const double y : {0.0, 0.25, 0.5}) {
            for (const double z : {0.0, 0.25, 0.5}) {
                look({x, y, z});
            }
        }
    }
    return result;
}

TEST(LatticeRipple, FiguresOfTheImageFormationPage) {
    const auto largest = [](double radius, double falloff) {
        const Ripple ripple = ripple_of(Lattice::cartesian, radius, falloff);
        return 100.0 * std::max(1.0 - ripple.lower, ripple.upper - 1.0);
    };
    // The page's percentages; the bounds may add what they are allowed to.
    EXPECT_NEAR(largest(2.0, 5.0), 0.8, 0.05);
    EXPECT_NEAR(largest(2.0, 8.0), 4.5, 0.05);
    EXPECT_NEAR(largest(2.5, 7.0), 0.06, 0.03);
    EXPECT_NEAR(largest(3.0, 8.0), 0.05, 0.03);
}

// Of kernels in use.
TEST(LatticeRipple, BoundsHoldAndAreNear) {
    for (const Lattice lattice : {Lattice::cartesian, Lattice::bcc}) {
        for (const auto& [radius, falloff] : {std::pair{2.0, 5.0}, {2.0, 8.0}, {2.5, 7.0}, {3.0, 8.0}, {3.5, 5.0}}) {
            const Ripple bound = ripple_of(lattice, radius, falloff);
            const Ripple real = found(lattice, radius, falloff, 3000);
            EXPECT_GE(bound.upper, real.upper) << radius << " " << falloff;
            EXPECT_LE(bound.lower, real.lower) << radius << " " << falloff;
            EXPECT_LE(bound.upper - real.upper, 1e-3) << radius << " " << falloff;
            EXPECT_LE(real.lower - bound.lower, 1e-3) << radius << " " << falloff;
        }
    }
}

// A filter widens kernels to ellipsoids of the same mass, of any orientation.
TEST(LatticeRipple, FilteredSumsStayBelowTheirBound) {
    Random random(11);
    for (const auto& [radius, falloff] : {std::pair{2.0, 5.0}, {2.0, 8.0}, {1.2, 5.0}, {0.6, 3.0}}) {
        const RegularField field(std::vector<float>{1.0F}, {1, 1, 1},
                                 lattice_options(Lattice::cartesian, radius, falloff));
        const double bound = largest_filtered_sum(field);
        EXPECT_GE(bound, lattice_ripple(field).upper) << radius << " " << falloff;
        for (int filter = 0; filter < 12; ++filter) {
            const Vec3 along = glm::normalize(random.in_cube());
            const double across = 0.4 * filter, deep = 3.0 * std::abs(random.in_cube().x);
            // B B^T = r^2 + across^2 (1 - a a^T) + deep^2 a a^T; the inverse is of the same form.
            const double side = radius * radius + across * across, depth = radius * radius + deep * deep;
            const double amplitude = radius * radius * radius / (side * std::sqrt(depth));
            const int reach = static_cast<int>(std::sqrt(std::max(side, depth))) + 2;
            for (int point = 0; point < 12; ++point) {
                const Vec3 at = point == 0 ? Vec3(0.0) : 0.5 * random.in_cube();
                double sum = 0.0;
                for (int z = -reach; z <= reach; ++z) {
                    for (int y = -reach; y <= reach; ++y) {
                        for (int x = -reach; x <= reach; ++x) {
                            const Vec3 from = at - Vec3(x, y, z);
                            const double part = glm::dot(from, along);
                            const double r2 = (glm::dot(from, from) - part * part) / side + part * part / depth;
                            sum += r2 < 1.0 ? std::exp(-falloff * r2) - std::exp(-falloff) : 0.0;
                        }
                    }
                }
                EXPECT_LE(amplitude * field.kernel().gain() * sum / field.lattice_constant(), bound)
                    << radius << " " << falloff << " filter " << filter;
            }
        }
    }
}

TEST(LatticeRipple, Gaps) {
    // Alone in its support, a kernel's peak is 1.
    for (const Lattice lattice : {Lattice::cartesian, Lattice::bcc}) {
        const RegularField field(std::vector<float>{1.0F}, {1, 1, 1}, lattice_options(lattice, 0.4, 5.0));
        EXPECT_EQ(lattice_ripple(field).lower, 0.0);
        EXPECT_DOUBLE_EQ(lattice_ripple(field).upper, 1.0 / field.lattice_constant());
    }
    EXPECT_EQ(ripple_of(Lattice::cartesian, 0.8, 5.0).lower, 0.0);
    EXPECT_GT(ripple_of(Lattice::cartesian, 1.2, 5.0).lower, 0.0);
}

TEST(LatticeRipple, UnusualKernels) {
    for (const auto& [radius, falloff] :
         {std::pair{0.6, 5.0}, {1.5, 2.0}, {2.2, 0.5}, {1.0, 0.01}, {2.0, 300.0}, {2.0, 600.0}, {0.51, 1e-6}}) {
        for (const Lattice lattice : {Lattice::cartesian, Lattice::bcc}) {
            const Ripple bound = ripple_of(lattice, radius, falloff);
            const Ripple real = found(lattice, radius, falloff, 2000);
            EXPECT_GE(bound.upper, real.upper) << radius << " " << falloff;
            EXPECT_LE(bound.lower, real.lower) << radius << " " << falloff;
            EXPECT_LE(bound.upper, 1.05 * real.upper) << radius << " " << falloff;
        }
    }
    // Beyond sampling: bounds still, if wide ones.
    const Ripple wide = ripple_of(Lattice::cartesian, 1000.0, 5.0);
    EXPECT_EQ(wide.lower, 0.0);
    EXPECT_GE(wide.upper, 1.0);
    EXPECT_LE(wide.upper, 1.2);
}

TEST(LatticeRipple, SpacingAndOriginDoNotMatter) {
    RegularFieldOptions options = lattice_options(Lattice::cartesian, 2.0, 5.0);
    options.spacing = Vec3(0.2, 3.0, 7.0);
    options.origin = Vec3(1e6, -5.0, 0.1);
    const Ripple moved = lattice_ripple(RegularField(std::vector<float>{1.0F}, {1, 1, 1}, options));
    const Ripple plain = ripple_of(Lattice::cartesian, 2.0, 5.0);
    EXPECT_EQ(moved.lower, plain.lower);
    EXPECT_EQ(moved.upper, plain.upper);
}

} // namespace
} // namespace sheetsplat::test

// Needles and discs thinner than a pixel, and kernels from a thousandth of a pixel to a million, by every instruction
// set.
#include <cmath>
#include <string>

#include <glm/geometric.hpp>
#include <gtest/gtest.h>

#include "renderer_scenes.hpp"

namespace sheetsplat::backend_cpu {
namespace {

/// Needles and discs thinner than a pixel, almost along rows or columns: what a row holds is far from the next one.
TEST(CpuRenderer, ThinEllipsoidsKeepTheirRows) {
    const SetChoice choice;
    const int size = 40;
    for (const double half_width : {0.06, 0.15, 0.25, 0.3, 0.45, 0.8}) {
        for (const double turn : {0.0, pi / 2}) {
            EllipsoidArrays arrays;
            for (int n = 0; n < 24; ++n) {
                arrays.centers.push_back(Vec3(0.05 * n, 1.5 * n - 17.0 + 0.041 * n, 0.2 * n));
                if (turn != 0.0) {
                    std::swap(arrays.centers.back().x, arrays.centers.back().y);
                }
                // Thin across the row, and leaning a little so that sections move.
                arrays.scales.push_back(Vec3(15.0, half_width, n % 2 == 0 ? 4.0 : half_width * 2.0));
                const double angle = turn + 0.002 * (n % 5 - 2);
                arrays.rotations.push_back(glm::angleAxis(angle, Vec3(0, 0, 1)) * glm::angleAxis(0.3, Vec3(0, 1, 0)) *
                                           glm::angleAxis(0.2, Vec3(1, 0, 0)));
                arrays.values.push_back(1.0);
            }
            EllipsoidFieldOptions options;
            options.normalization = Normalization::none;
            const auto field = std::make_shared<const EllipsoidField>(arrays, options);
            for (const bool perspective : {false, true}) {
                const Camera camera = perspective
                                          ? Camera::perspective(Vec3(0, 0, 100), Vec3(0), Vec3(0, 1, 0),
                                                                2.0 * std::atan(0.5 * size / 100.0) * 180.0 / pi)
                                          : Camera::orthographic(Vec3(0, 0, 100), Vec3(0), Vec3(0, 1, 0), size);
                Shot shot = shot_of({field}, camera);
                shot.size = {size, size};
                shot.scene.mode = Mode::xray;
                shot.scene.slice_spacing = 0.5;
                const reference::Picture judge = test::reference_of(shot);
                EXPECT_GT(test::largest(judge.scalar), 0.05);
                for (const Precision precision : {Precision::float32, Precision::float64}) {
                    const CpuDrawing drawing(shot, precision);
                    for (const std::string& set : instruction_sets()) {
                        choose_instruction_set(set);
                        const Raised raised;
                        const Distance off = distance(drawing.draw(), judge);
                        const bool fine = precision == Precision::float64;
                        const std::string name = std::to_string(half_width) + (turn != 0.0 ? " upright " : " lying ") +
                                                 (perspective ? "perspective " : "") +
                                                 (fine ? "float64 " : "float32 ") + set;
                        EXPECT_EQ(raised.names(), "") << name;
                        EXPECT_LE(off.rms, fine ? 3e-8 : 5e-6) << name;
                        EXPECT_LE(off.most, fine ? 1.3e-7 : 1e-4) << name;
                    }
                }
            }
        }
    }
}

/// Kernels as large as a million pixels, small as a thousandth of one, and far beside, behind and before the picture.
TEST(CpuRenderer, ExtremeKernelsRaiseNothing) {
    const SetChoice choice;
    const int size = 30;
    for (const bool ellipsoids : {false, true}) {
        EllipsoidArrays arrays;
        const auto add = [&](const Vec3& at, double radius, double value) {
            arrays.centers.push_back(at);
            arrays.values.push_back(value);
            if (ellipsoids) {
                arrays.scales.push_back(radius * Vec3(1.0, 0.3, 2.0));
                arrays.rotations.push_back(glm::angleAxis(0.1 * static_cast<double>(arrays.values.size()),
                                                          glm::normalize(Vec3(1.0, 2.0, 3.0))));
            } else {
                arrays.radii.push_back(radius);
            }
        };
        for (int n = 0; n < 40; ++n) {
            add(Vec3(std::sin(3.0 * n), std::cos(5.0 * n), std::sin(7.0 * n + 1.0)) * 9.0, 2.0 + 0.1 * n, 0.5);
            add(Vec3(std::sin(2.0 * n), std::cos(1.0 * n), std::sin(4.0 * n + 1.0)) * 9.0, 1e-3, 1.0);
        }
        for (const double far : {1e2, 1e4, 1e7}) {
            for (int axis = 0; axis < 3; ++axis) {
                for (const double sign : {-1.0, 1.0}) {
                    Vec3 at(0.1);
                    at[axis] = axis == 2 ? sign * std::min(far, 40.0) : sign * far;
                    add(at, 3.0, 1.0);
                }
            }
        }
        const auto plain = std::make_shared<const EllipsoidField>(arrays);
        add(Vec3(0.3, 0.2, 0.1), 1e6, 0.4);
        arrays.values.back() = 0.4;
        const auto huge = std::make_shared<const EllipsoidField>(arrays);
        for (const bool perspective : {false, true}) {
            const Camera camera = perspective ? Camera::perspective(Vec3(0, 0, 30), Vec3(0), Vec3(0, 1, 0), 50.0, 1e-2)
                                              : Camera::orthographic(Vec3(0, 0, 60), Vec3(0), Vec3(0, 1, 0), size);
            for (const bool with_huge : {false, true}) {
                Shot shot = shot_of({with_huge ? huge : plain}, camera);
                shot.size = {size, size};
                // The huge kernel alone would make slices without number.
                shot.scene.slice_spacing = with_huge ? 2e3 : 1.0;
                shot.scene.reference_length = 1.0;
                for (const Sampling sampling : {Sampling::point, Sampling::slab}) {
                    for (const Mode mode : {Mode::composite, Mode::xray}) {
                        shot.scene.sampling = sampling;
                        shot.scene.mode = mode;
                        const reference::Picture judge = test::reference_of(shot);
                        const CpuDrawing drawing(shot, Precision::float64);
                        for (const std::string& set : instruction_sets()) {
                            choose_instruction_set(set);
                            const Raised raised;
                            const Image image = drawing.draw();
                            const std::string name = std::string(ellipsoids ? "ellipsoids" : "spheres") +
                                                     (with_huge ? " huge" : "") + (perspective ? " perspective" : "") +
                                                     (sampling == Sampling::slab ? " slab" : "") +
                                                     (mode == Mode::xray ? " xray " : " ") + set;
                            EXPECT_EQ(raised.names(), "") << name;
                            EXPECT_LE(distance(image, judge).rms, 3e-8) << name;
                        }
                    }
                }
            }
        }
    }
}

} // namespace
} // namespace sheetsplat::backend_cpu

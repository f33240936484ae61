// What must not change pictures of scattered ellipsoids: lattices as kernels, moved, scaled and turned worlds, split
// kernels.
#include <gtest/gtest.h>

#include "reference/ellipsoid_scenes.hpp"
#include "reference/kernels.hpp"
#include "reference/support.hpp"
#include "support/lattices.hpp"

namespace sheetsplat::reference::testing {

namespace {

TEST(Ellipsoids, ARegularLatticeIsTheSameAsItsKernels) {
    for (const Lattice lattice : {Lattice::cartesian, Lattice::bcc}) {
        RegularFieldOptions options = test::zero_boundary();
        options.lattice = lattice;
        options.spacing = lattice == Lattice::bcc ? Vec3(1.25) : Vec3(1.0, 0.75, 1.5);
        options.origin = Vec3(-4.0, -3.0, -3.5);
        const auto regular = blobs(options);
        EllipsoidArrays arrays;
        for (std::size_t k = 0; k < 7; ++k) {
            for (std::size_t j = 0; j < 8; ++j) {
                for (std::size_t i = 0; i < 9; ++i) {
                    arrays.centers.push_back(regular->position(i, j, k));
                    if (lattice == Lattice::bcc) {
                        arrays.radii.push_back(2.0 * 1.25 / std::sqrt(2.0));
                    } else {
                        arrays.scales.push_back(2.0 * options.spacing);
                    }
                    arrays.values.push_back(regular->value(i, j, k));
                }
            }
        }
        EllipsoidFieldOptions same;
        same.falloff = 5.0;
        same.normalization = Normalization::lattice;
        same.cell_volume = lattice == Lattice::bcc ? 1.25 * 1.25 * 1.25 / 2.0 : 1.0 * 0.75 * 1.5;
        const auto ellipsoids = make_ellipsoids(arrays, same);
        Request request;
        request.coverage = request.depth = true;
        for (const bool perspective : {false, true}) {
            for (const Sampling sampling : {Sampling::point, Sampling::slab}) {
                for (const Filter filter : {Filter::none, Filter::ewa}) {
                    Scene a = full_scene(regular);
                    a.sampling = sampling;
                    a.filter = filter;
                    Scene b = a;
                    b.fields = {ellipsoids};
                    const Picture first = render(a, camera_of(perspective), size, request),
                                  second = render(b, camera_of(perspective), size, request);
                    EXPECT_GT(largest_of(first.rgba), 0.2);
                    EXPECT_LE(largest_difference(first.rgba, second.rgba), 1e-12);
                    EXPECT_LE(largest_difference(first.coverage, second.coverage), 1e-12);
                    EXPECT_EQ(first.slices, second.slices);
                    EXPECT_EQ(first.first_slice, second.first_slice);
                    EXPECT_EQ(first.kernels_drawn, second.kernels_drawn);
                    // Half of the one and half of the other, scalars added before they are classified.
                    Scene both = a;
                    both.fields = {regular, ellipsoids};
                    std::vector<TransferPoint> points = a.transfer_function.points();
                    for (TransferPoint& point : points) {
                        point.value *= 2.0;
                    }
                    both.transfer_function = TransferFunction(points);
                    const double doubled =
                        largest_difference(first.rgba, render(both, camera_of(perspective), size).rgba);
                    EXPECT_LE(doubled, 1e-12);
                }
            }
            // Another falloff is another picture.
            Scene other = full_scene(regular);
            EllipsoidFieldOptions narrower = same;
            narrower.falloff = 5.0 + 1e-8;
            Scene near = other;
            near.fields = {make_ellipsoids(arrays, narrower)};
            EXPECT_GT(largest_difference(render(other, camera_of(perspective), size).rgba,
                                         render(near, camera_of(perspective), size).rgba),
                      1e-11);
        }
    }
}

TEST(Ellipsoids, MovedWorldKeepsItsDetail) {
    // Coordinates of 1e9 with detail of 1: numbers that float64 holds exactly there (multiples of 1/256) must give the
    // same picture to the last digits but a few.
    EllipsoidArrays arrays = scattered(12, 8);
    for (Vec3& center : arrays.centers) {
        center = glm::round(center * 256.0) / 256.0;
    }
    for (const bool perspective : {false, true}) {
        for (const Filter filter : {Filter::none, Filter::ewa}) {
            const auto picture = [&](const Vec3& shift, double mistake) {
                EllipsoidArrays moved = arrays;
                for (Vec3& center : moved.centers) {
                    center += shift;
                }
                Scene scene = full_scene(make_ellipsoids(moved, thresholded()));
                scene.filter = filter;
                scene.sampling = perspective ? Sampling::slab : Sampling::point;
                return render(scene, camera_of(perspective, shift + Vec3(0.0, 0.0, mistake)), size).rgba;
            };
            const auto here = picture(Vec3(0.0), 0.0);
            EXPECT_GT(largest_of(here), 0.3);
            EXPECT_LE(largest_difference(here, picture(Vec3(1e9, -1e9, 2e9), 0.0)), 1e-12);
            EXPECT_GT(largest_difference(here, picture(Vec3(0.0), 1e-9)), 1e-12);
        }
    }
}

TEST(Ellipsoids, ScaleOfTheWorld) {
    for (const bool perspective : {false, true}) {
        for (const Filter filter : {Filter::none, Filter::ewa}) {
            const auto picture = [&](double scale, double mistake = 1.0) {
                EllipsoidArrays arrays = scattered(12, 9);
                for (std::size_t n = 0; n < 12; ++n) {
                    arrays.centers[n] *= scale;
                    arrays.scales[n] *= scale;
                }
                Scene scene = full_scene(make_ellipsoids(arrays, thresholded()));
                scene.filter = filter;
                scene.slice_spacing.reset();
                scene.reference_length = scale * mistake;
                return render(scene, camera_of(perspective, Vec3(0.0), scale), size).rgba;
            };
            const auto here = picture(1.0);
            EXPECT_GT(largest_of(here), 0.2);
            for (const double scale : {1e6, 1e-6, 1e60, 1e-60}) {
                EXPECT_LE(largest_difference(here, picture(scale)), 1e-11) << scale;
            }
            EXPECT_GT(largest_difference(here, picture(1.0, 1.0 + 1e-9)), 1e-11);
        }
    }
}

TEST(Ellipsoids, TurningTheWorldWithTheCamera) {
    // All axes turned round (x to y, y to z, z to x) by the quaternion (1, 1, 1, 1) / 2, which is exact.
    const glm::dquat turn(0.5, 0.5, 0.5, 0.5);
    const auto turned = [](const Vec3& v) { return Vec3(v.z, v.x, v.y); };
    EllipsoidArrays arrays = scattered(12, 10), other = arrays;
    for (std::size_t n = 0; n < 12; ++n) {
        other.centers[n] = turned(arrays.centers[n]);
        other.rotations[n] = turn * arrays.rotations[n];
    }
    Scene a = full_scene(make_ellipsoids(arrays)), b = full_scene(make_ellipsoids(other));
    for (Light& light : b.lights) {
        light.direction = light.space == LightSpace::world ? turned(light.direction) : light.direction;
    }
    const Vec3 eye(4.0, 3.0, 8.0), target(0.2, 0.1, 0.0), up(0.1, 1.0, 0.3);
    const auto first = render(a, Camera::perspective(eye, target, up, 40.0), size).rgba;
    const auto second = render(b, Camera::perspective(turned(eye), turned(target), turned(up), 40.0), size).rgba;
    EXPECT_GT(largest_of(first), 0.3);
    EXPECT_LE(largest_difference(first, second), 1e-12);
    // The same kernels turned, but not their own axes.
    other.rotations = arrays.rotations;
    b.fields = {make_ellipsoids(other)};
    EXPECT_GT(largest_difference(
                  first, render(b, Camera::perspective(turned(eye), turned(target), turned(up), 40.0), size).rgba),
              1e-3);
}

TEST(Ellipsoids, SplittingAndOrderChangeNothing) {
    const EllipsoidArrays arrays = scattered(12, 13);
    EllipsoidArrays halves = arrays, reversed, unequal = arrays;
    for (std::size_t n = 0; n < 12; ++n) {
        halves.centers.push_back(arrays.centers[n]);
        halves.scales.push_back(arrays.scales[n]);
        halves.rotations.push_back(arrays.rotations[n]);
        halves.values.push_back(arrays.values[n]);
        halves.weights[n] *= 0.5;
        halves.weights.push_back(0.5 * arrays.weights[n]);
        const std::size_t from_end = 11 - n;
        reversed.centers.push_back(arrays.centers[from_end]);
        reversed.scales.push_back(arrays.scales[from_end]);
        reversed.rotations.push_back(arrays.rotations[from_end]);
        reversed.values.push_back(arrays.values[from_end]);
        reversed.weights.push_back(arrays.weights[from_end]);
    }
    unequal.weights[3] *= 1.0 + 1e-9;
    Request request;
    request.coverage = true;
    for (const Filter filter : {Filter::none, Filter::ewa}) {
        for (const EllipsoidFieldOptions& options : {plain_ellipsoids(), thresholded()}) {
            for (const Mode mode : {Mode::composite, Mode::xray, Mode::mip, Mode::isosurface}) {
                const auto picture = [&](const EllipsoidArrays& kernels) {
                    Scene scene = full_scene(make_ellipsoids(kernels, options));
                    scene.filter = filter;
                    scene.mode = mode;
                    scene.iso_values = {0.3};
                    return render(scene, camera_of(true), size, request);
                };
                const Picture plain = picture(arrays);
                for (const EllipsoidArrays* same : {&halves, &reversed}) {
                    const Picture also = picture(*same);
                    EXPECT_LE(largest_difference(plain.rgba, also.rgba), 1e-11);
                    EXPECT_LE(largest_difference(plain.scalar, also.scalar), 1e-12);
                    EXPECT_LE(largest_difference(plain.coverage, also.coverage), 1e-12);
                    EXPECT_EQ(plain.slices, also.slices);
                }
                EXPECT_GT(largest_difference(plain.coverage, picture(unequal).coverage), 1e-11);
            }
        }
    }
}

} // namespace

} // namespace sheetsplat::reference::testing

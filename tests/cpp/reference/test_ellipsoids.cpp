// Scattered ellipsoids: closed forms, what must not change their pictures, and hard cases.
#include <gtest/gtest.h>

#include "reference/kernels.hpp"
#include "reference/support.hpp"
#include "sheetsplat/error.hpp"

namespace sheetsplat::reference::testing {

namespace {

constexpr Size size{24, 18};

Scene full_scene(std::shared_ptr<const Field> field) {
    Scene scene = make_scene(std::move(field));
    scene.lights = two_lights();
    scene.material = {0.2, 0.7, 0.4, 12.0, true};
    scene.slice_spacing = 0.5;
    scene.reference_length = 0.9;
    return scene;
}

Camera camera_of(bool perspective, const Vec3& target = Vec3(0.0), double scale = 1.0) {
    const Vec3 eye = target + scale * Vec3(4.0, 3.0, 8.0), up(0.125, 1.0, 0.0);
    return perspective ? Camera::perspective(eye, target, up, 45.0, 0.5 * scale)
                       : Camera::orthographic(eye, target, up, 7.0 * scale);
}

EllipsoidFieldOptions thresholded(double w0 = 0.6) {
    EllipsoidFieldOptions options;
    options.normalization = Normalization::threshold;
    options.w0 = w0;
    return options;
}

/// Integral of m g along each pixel's whole ray, from the ray in the kernel's unit-sphere space (by a general inverse).
std::vector<double> line_integrals(const EllipsoidField& field, const Camera& camera, double falloff) {
    std::vector<double> integrals;
    for (int j = 0; j < size.height; ++j) {
        for (int i = 0; i < size.width; ++i) {
            const double x = (2.0 * (i + 0.5) / size.width - 1.0) * size.width / size.height,
                         y = 1.0 - 2.0 * (j + 0.5) / size.height;
            const double h = camera.half_height();
            const Vec3 aside = h * (x * camera.right_world() + y * camera.up_world());
            const bool perspective = camera.projection() == Projection::perspective;
            const Vec3 ray = glm::normalize((perspective ? aside : Vec3(0.0)) - camera.back_world());
            const Vec3 start = camera.eye() + (perspective ? Vec3(0.0) : aside);
            double sum = 0.0;
            for (std::size_t n = 0; n < field.size(); ++n) {
                const Mat3 inverse = glm::inverse(field.shape(n));
                const Vec3 q = inverse * (start - field.center(n)), v = inverse * ray;
                const double b = glm::length(glm::cross(q, v)) / glm::length(v);
                sum += field.weight(n) * field.value(n) * chord_integral(b, falloff) / glm::length(v);
            }
            integrals.push_back(sum);
        }
    }
    return integrals;
}

} // namespace

TEST(Ellipsoids, ValuesAtPoints) {
    // Semi-axes 3 along (0, 0.6, 0.8), 1 along x, 2 along (0, -0.8, 0.6).
    EllipsoidArrays arrays = one_ellipsoid(Vec3(1.0, 2.0, 3.0), Vec3(1.0, 2.0, 3.0),
                                           // About x, so that z becomes (0, 0.6, 0.8): by minus acos 0.8.
                                           glm::dquat(3.0 / std::sqrt(10.0), -1.0 / std::sqrt(10.0), 0.0, 0.0));
    arrays.values = {4.0};
    arrays.weights = {0.5};
    const auto field = make_ellipsoids(arrays);
    const auto expect_r = [&](const Vec3& from_centre, double r) {
        const Sums sums = sums_at(*field, Vec3(1.0, 2.0, 3.0) + from_centre);
        EXPECT_EQ(sums.empty, r >= 1.0);
        EXPECT_NEAR(sums.w, 0.5 * kernel_value(r, 8.0), 1e-15);
        EXPECT_NEAR(sums.d, 2.0 * kernel_value(r, 8.0), 4e-15);
    };
    expect_r(Vec3(0.0), 0.0);
    expect_r(3.0 * Vec3(0.0, 0.6, 0.8) * 0.3, 0.3);
    expect_r(Vec3(0.7, 0.0, 0.0), 0.7);
    expect_r(2.0 * Vec3(0.0, -0.8, 0.6) * 0.5, 0.5);
    expect_r(Vec3(0.3, 0.0, 0.0) + 2.0 * Vec3(0.0, -0.8, 0.6) * 0.4, 0.5);
    expect_r(Vec3(0.0, 0.6, 0.8) * 3.0001, 1.1);
    // Turned the other way it is another value.
    EXPECT_LT(sums_at(*field, Vec3(1.0, 2.0, 3.0) + 3.0 * Vec3(0.0, -0.6, 0.8) * 0.3).w, 0.4 * kernel_value(0.3, 8.0));
}

TEST(Ellipsoids, SumsOfBothKindsOfField) {
    // The lattice as scattered spheres: the same sums anywhere.
    RegularFieldOptions options = plain_options(2.0, 5.0);
    const auto lattice = blobs(options);
    EllipsoidArrays arrays;
    for (std::size_t k = 0; k < 7; ++k) {
        for (std::size_t j = 0; j < 8; ++j) {
            for (std::size_t i = 0; i < 9; ++i) {
                arrays.centers.push_back(lattice->position(i, j, k));
                arrays.radii.push_back(2.0);
                arrays.values.push_back(lattice->value(i, j, k));
            }
        }
    }
    const auto spheres = make_ellipsoids(arrays, plain_ellipsoids(5.0));
    for (int n = 0; n < 20; ++n) {
        const Vec3 point(0.4 * n, 7.0 - 0.31 * n, 0.17 * n);
        const Sums a = sums_at(*lattice, point), b = sums_at(*spheres, point);
        EXPECT_NEAR(a.d, b.d, 1e-14);
        EXPECT_NEAR(a.w, b.w, 1e-13);
        EXPECT_EQ(a.empty, b.empty);
        EXPECT_GT(a.w, 0.5);
    }
}

TEST(Ellipsoids, PointSamplingAtTheCentre) {
    // A slice through the kernel's centre, a pixel on it: exactly m f. Two kernels put the box's middle, the anchor,
    // half a slice in front of the first one.
    EllipsoidArrays arrays = one_ellipsoid(Vec3(0.0), Vec3(0.2, 0.1, 0.15), glm::dquat(0.5, 0.5, -0.5, 0.5));
    arrays.centers.emplace_back(0.0, 30.0, 0.5);
    arrays.scales.emplace_back(0.1);
    arrays.rotations.emplace_back(1.0, 0.0, 0.0, 0.0);
    arrays.values = {3.0, 1.0};
    arrays.weights = {0.25, 1.0};
    Scene scene = make_scene(make_ellipsoids(arrays, plain_ellipsoids()));
    scene.mode = Mode::mip;
    scene.slice_spacing = 0.5;
    const Picture picture = render(scene, front_camera(1.0), Size{3, 3});
    EXPECT_LE(largest_difference(picture.scalar, {0.0, 0.0, 0.0, 0.0, 0.75, 0.0, 0.0, 0.0, 0.0}), 2e-16);
    // The anchor a quarter elsewhere, and the slice misses the centre.
    arrays.centers[1].z += 0.1;
    scene.fields = {make_ellipsoids(arrays, plain_ellipsoids())};
    EXPECT_LT(render(scene, front_camera(1.0), Size{3, 3}).scalar[4], 0.7);
}

TEST(Ellipsoids, XrayOfSlabsIsTheLineIntegralAtAnySpacing) {
    const auto field = make_ellipsoids(scattered(20, 11), plain_ellipsoids(6.0));
    Scene scene = make_scene(field);
    scene.mode = Mode::xray;
    scene.sampling = Sampling::slab;
    for (const bool perspective : {false, true}) {
        const Camera camera = camera_of(perspective);
        const std::vector<double> expected = line_integrals(*field, camera, 6.0);
        ASSERT_GT(largest_of(expected), 0.5);
        for (const double spacing : {0.004, 0.1, 0.37, 1.0, 3.3, 15.0}) {
            scene.slice_spacing = spacing;
            EXPECT_LE(largest_difference(render(scene, camera, size).scalar, expected), 1e-12) << spacing;
        }
        EXPECT_GT(largest_difference(line_integrals(*field, camera, 6.0 + 1e-9), expected), 1e-11);
        scene.slice_spacing = 0.3;
        Scene points = scene;
        points.sampling = Sampling::point;
        EXPECT_GT(largest_difference(render(points, camera, size).scalar, expected), 1e-4);
    }
}

TEST(Ellipsoids, CoverageIsTheLineIntegralOfTheWeight) {
    // Values 0: there for their weight alone.
    EllipsoidArrays arrays = scattered(6, 12), ones = arrays;
    for (std::size_t n = 0; n < 6; ++n) {
        arrays.values[n] = 0.0;
        ones.values[n] = 1.0;
    }
    Scene scene = make_scene(make_ellipsoids(arrays, thresholded()));
    scene.sampling = Sampling::slab;
    Request request;
    request.coverage = true;
    for (const bool perspective : {false, true}) {
        const Picture picture = render(scene, camera_of(perspective), size, request);
        const std::vector<double> expected = line_integrals(*make_ellipsoids(ones), camera_of(perspective), 8.0);
        ASSERT_GT(largest_of(expected), 0.5);
        EXPECT_LE(largest_difference(picture.coverage, expected), 1e-12);
        EXPECT_EQ(largest_of(picture.rgba), 0.0);
        // The coverage of several fields is their sum.
        Scene twice = scene;
        twice.fields.push_back(scene.fields.front());
        const std::vector<double> more = render(twice, camera_of(perspective), size, request).coverage;
        for (std::size_t n = 0; n < more.size(); ++n) {
            EXPECT_NEAR(more[n], 2.0 * expected[n], 1e-12);
        }
    }
}

TEST(Ellipsoids, ThresholdIsAWeightedMeanWhereThereIsWeight) {
    // Two kernels on one spot: D / W between their values; alone and thin, D / w0.
    EllipsoidArrays arrays;
    arrays.centers = {Vec3(0.0), Vec3(0.0)};
    arrays.radii = {2.0, 2.0};
    arrays.values = {1.0, 4.0};
    arrays.weights = {2.0, 1.0};
    const double k = 8.0;
    EllipsoidFieldOptions options = thresholded(0.3);
    Scene scene = make_scene(make_ellipsoids(arrays, options));
    scene.mode = Mode::mip;
    scene.slice_spacing = 0.2; // the nearest slice is 0.1 from the centres
    const Picture picture = render(scene, front_camera(4.0), Size{5, 1});
    for (std::size_t n = 0; n < 5; ++n) {
        // On rays 0.8 apart.
        const double x = 0.8 * (static_cast<double>(n) - 2.0) * 5.0;
        double expected = 0.0;
        for (int slice = 0; slice < 10; ++slice) {
            const double g = kernel_value(std::hypot(x, 0.1 + 0.2 * slice) / 2.0, k);
            expected = std::max(expected, 6.0 * g / std::max(0.3, 3.0 * g));
        }
        EXPECT_NEAR(picture.scalar[n], expected, 1e-14);
    }
    EXPECT_NEAR(picture.scalar[2], 2.0, 1e-14);
}

TEST(Ellipsoids, LatticeNormalisation) {
    // A constant lattice of spheres reconstructs its constant; with half the cell's volume, half of it.
    EllipsoidArrays arrays;
    for (int k = -4; k <= 4; ++k) {
        for (int j = -4; j <= 4; ++j) {
            for (int i = -4; i <= 4; ++i) {
                arrays.centers.emplace_back(i, j, k);
                arrays.radii.push_back(2.0);
                arrays.values.push_back(0.6);
            }
        }
    }
    const auto middle = [&](double volume, double nudge) {
        EllipsoidFieldOptions options;
        options.falloff = 5.0;
        options.normalization = Normalization::lattice;
        options.cell_volume = volume;
        Scene scene = make_scene(make_ellipsoids(arrays, options));
        scene.mode = Mode::mip;
        scene.slice_spacing = 0.5;
        Request request;
        request.nudge_radius = nudge;
        return render(scene, front_camera(1.0), Size{1, 1}, request).scalar[0];
    };
    EXPECT_NEAR(middle(1.0, 0.0), 0.6, 0.6 * 0.009);
    EXPECT_NEAR(middle(0.5, 0.0), 0.3, 0.3 * 0.009);
    // C follows the radius.
    EXPECT_NEAR(middle(1.0, 0.1), 0.6, 0.6 * 0.009);
}

TEST(Ellipsoids, OfWeightZeroReach) {
    // Opaque at 0: a kernel of weight 0 is seen though it adds nothing; opaque nowhere near 0, it is left out.
    EllipsoidArrays arrays;
    arrays.centers = {Vec3(-1.0, 0.0, 0.0), Vec3(1.0, 0.0, 0.0)};
    arrays.radii = {0.5, 0.5};
    arrays.values = {0.0, 5.0};
    arrays.weights = {1.0, 0.0};
    for (const EllipsoidFieldOptions& options : {plain_ellipsoids(), thresholded()}) {
        Scene scene = make_scene(make_ellipsoids(arrays, options),
                                 TransferFunction({{0.0, Vec3(1.0), 0.5}, {1.0, Vec3(1.0), 0.5}}));
        scene.slice_spacing = 0.5;
        scene.reference_length = 0.5;
        const Picture picture = render(scene, front_camera(1.0, 5.0), Size{3, 1});
        EXPECT_EQ(picture.kernels_drawn, 2U);
        // One slice a quarter before the centre and one behind it.
        EXPECT_NEAR(picture.rgba[3], 0.75, 1e-15);
        EXPECT_EQ(picture.rgba[7], 0.0);
        EXPECT_NEAR(picture.rgba[11], 0.75, 1e-15);
    }
    Scene scene = make_scene(make_ellipsoids(arrays, plain_ellipsoids()));
    EXPECT_EQ(render(scene, front_camera(1.0, 5.0), Size{3, 1}).kernels_drawn, 0U);
}

TEST(Ellipsoids, WithoutKernelsAddNothing) {
    const auto none = make_ellipsoids({});
    Request request;
    request.coverage = request.depth = true;
    Scene empty = make_scene(none, TransferFunction({{0.0, Vec3(1.0), 1.0}}));
    for (const Filter filter : {Filter::none, Filter::ewa}) {
        empty.filter = filter;
        for (const bool perspective : {false, true}) {
            const Picture picture = render(empty, camera_of(perspective), Size{3, 2}, request);
            EXPECT_EQ(picture.slices, 0);
            EXPECT_EQ(picture.kernels_drawn, 0U);
            EXPECT_EQ(picture.rgba, std::vector<double>(24, 0.0));
            EXPECT_EQ(picture.coverage, std::vector<double>(6, 0.0));
            EXPECT_EQ(picture.depth, std::vector<double>(6, std::numeric_limits<double>::infinity()));
        }
    }
    EXPECT_TRUE(sums_at(*none, Vec3(0.0)).empty);
    // Beside another field it changes nothing.
    const auto some = make_ellipsoids(scattered(9, 4));
    Scene alone = full_scene(some), beside = alone;
    beside.fields = {none, some, none};
    const Picture a = render(alone, camera_of(true), size, request), b = render(beside, camera_of(true), size, request);
    EXPECT_GT(largest_of(a.rgba), 0.1);
    EXPECT_EQ(a.rgba, b.rgba);
    EXPECT_EQ(a.coverage, b.coverage);
    EXPECT_EQ(a.slices, b.slices);
}

TEST(Ellipsoids, ARegularLatticeIsTheSameAsItsKernels) {
    for (const Lattice lattice : {Lattice::cartesian, Lattice::bcc}) {
        RegularFieldOptions options;
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
                    scene.iso_value = 0.3;
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

TEST(Ellipsoids, NeedlesOfOneInAHundredThousand) {
    // A view of a few units onto the middle, the flank and the tip of needles and plates a hundred thousand times as
    // long as thick, against long double from the same numbers; and what the covariance would have made of it.
    std::mt19937_64 generator(17);
    double worst = 0.0, by_covariance = 0.0;
    for (int n = 0; n < 24; ++n) {
        const glm::dquat rotation = random_rotation(generator);
        const Vec3 s = n % 2 == 0 ? Vec3(1e5, 1.0, 1.3) : Vec3(1e5, 0.7e5, 1.0);
        const auto field = make_ellipsoids(one_ellipsoid(Vec3(0.0), s, rotation), plain_ellipsoids());
        const Mat3 m = field->shape(0);
        const Mat3 form = glm::inverse(m * glm::transpose(m));
        using Wide = glm::mat<3, 3, long double, glm::defaultp>;
        const glm::dquat& q = field->arrays().rotations[0];
        const long double w = q.w, x = q.x, y = q.y, z = q.z;
        const Wide r(1.0L - 2.0L * (y * y + z * z), 2.0L * (x * y + w * z), 2.0L * (x * z - w * y),
                     2.0L * (x * y - w * z), 1.0L - 2.0L * (x * x + z * z), 2.0L * (y * z + w * x),
                     2.0L * (x * z + w * y), 2.0L * (y * z - w * x), 1.0L - 2.0L * (x * x + y * y));
        for (const double along : {0.0, 0.4, 0.9}) {
            const Vec3 place = along * m[0];
            for (int point = 0; point < 30; ++point) {
                const Vec3 at =
                    place + random_real(generator, -0.6, 0.6) * m[1] + random_real(generator, -0.6, 0.6) * m[2];
                long double r_squared = 0.0L;
                for (int axis = 0; axis < 3; ++axis) {
                    const long double part =
                        (r[axis][0] * at.x + r[axis][1] * at.y + r[axis][2] * at.z) / static_cast<long double>(s[axis]);
                    r_squared += part * part;
                }
                const double g = kernel_value(static_cast<double>(std::sqrt(r_squared)), 8.0);
                worst = std::max(worst, std::abs(sums_at(*field, at).d - g));
                by_covariance = std::max(
                    by_covariance, std::abs(kernel_value(std::sqrt(std::max(0.0, glm::dot(at, form * at))), 8.0) - g));
            }
        }
    }
    std::printf("needles and plates of 1:1e5: off by %.1e, by the covariance %.1e\n", worst, by_covariance);
    EXPECT_LE(worst, 1e-10);
    EXPECT_GT(by_covariance, 1e-8);
}

TEST(Ellipsoids, NeedlesInAPicture) {
    // Pixels and slices find all of a needle wherever it leans, near its middle and near its tip: nearly across the
    // view, cut into slabs thinner than it is, and at 45 degrees, cut into few.
    std::mt19937_64 generator(18);
    for (int n = 0; n < 24; ++n) {
        const bool perspective = n % 2 == 1, leaning = n % 4 >= 2;
        const double place = n % 3 == 0 ? 0.0 : n % 3 == 1 ? 0.5 : -0.9;
        EllipsoidArrays arrays = one_ellipsoid(Vec3(0.0), Vec3(1e5, 1.0, 1.3), random_rotation(generator));
        arrays.values = {1.0 / kernel_value(place, 8.0)};
        const auto field = make_ellipsoids(arrays, plain_ellipsoids());
        const Mat3 m = field->shape(0);
        const Vec3 along = glm::normalize(m[0]), target = place * m[0];
        const Vec3 aside = glm::normalize(m[1] + 0.3 * m[2] + (leaning ? 1.0 : 1e-3) * along);
        const Vec3 up = along + random_real(generator, -1.0, 1.0) * m[2];
        const Camera camera = perspective ? Camera::perspective(target + 20.0 * aside, target, up, 12.0)
                                          : Camera::orthographic(target + 20.0 * aside, target, up, 4.0);
        Scene scene = make_scene(field);
        scene.mode = Mode::xray;
        scene.sampling = Sampling::slab;
        // The slab that holds the target must lie behind the near plane by more than half.
        scene.slice_spacing = !leaning ? 0.5 : perspective ? 30.0 : 500.0;
        const std::vector<double> expected = line_integrals(*field, camera, 8.0);
        EXPECT_GT(largest_of(expected), 0.2) << n;
        EXPECT_LE(largest_difference(render(scene, camera, size).scalar, expected), 1e-9) << n;
        EXPECT_GT(largest_difference(line_integrals(*field, camera, 8.0 + 1e-6), expected), 1e-9);
        if (!leaning) {
            scene.sampling = Sampling::point;
            scene.slice_spacing = 0.05;
            EXPECT_LE(largest_difference(render(scene, camera, size).scalar, expected), 1e-3) << n;
        }
    }
}

TEST(Ellipsoids, SizesFarApartInOneField) {
    // From 1e-8 to 1e3 on one ray: each adds its own line integral.
    EllipsoidArrays arrays;
    for (int n = 0; n < 12; ++n) {
        const double radius = std::pow(10.0, n - 8);
        arrays.centers.emplace_back(0.0, 0.0, -3.0 * n);
        arrays.radii.push_back(radius);
        arrays.values.push_back(1.0 / radius);
    }
    Scene scene = make_scene(make_ellipsoids(arrays, plain_ellipsoids()));
    scene.mode = Mode::xray;
    scene.sampling = Sampling::slab;
    scene.slice_spacing = 5.0;
    const Picture picture = render(scene, front_camera(1e-10), Size{1, 1});
    EXPECT_NEAR(picture.scalar[0], 12.0 * chord_integral(0.0, 8.0), 1e-12);
    EXPECT_EQ(picture.kernels_drawn, 12U);
    EXPECT_GT(std::abs(11.0 * chord_integral(0.0, 8.0) - picture.scalar[0]), 0.1);
}

TEST(Ellipsoids, EveryKernelHasItsOwnHalfDepth) {
    // A disc that faces the camera and one on edge: slices are those of the deepest only.
    EllipsoidArrays arrays;
    arrays.centers = {Vec3(-3.0, 0.0, 0.0), Vec3(3.0, 0.0, 0.0)};
    arrays.scales = {Vec3(1.0, 1.0, 0.1), Vec3(0.1, 1.0, 0.9)};
    arrays.values = {1.0, 1.0};
    const auto slices = [&](double spacing) {
        Scene scene = make_scene(make_ellipsoids(arrays));
        scene.slice_spacing = spacing;
        return render(scene, front_camera(8.0), Size{8, 8});
    };
    EXPECT_EQ(slices(0.3).slices, 6);
    EXPECT_EQ(slices(0.3).first_slice, -3);
    EXPECT_EQ(slices(0.25).slices, 8);
    arrays.centers[1].z = 3.0;
    arrays.centers[0].z = -3.0;
    // Seen along -z the second is in front: from 0.9 before it to 0.1 behind the first.
    EXPECT_EQ(slices(0.5).first_slice, -8);
    EXPECT_EQ(slices(0.5).slices, 15);
}

TEST(Ellipsoids, NudgedRadiusIsThatOfLargerSemiAxes) {
    EllipsoidArrays arrays = scattered(10, 20), larger = arrays;
    for (Vec3& scale : larger.scales) {
        scale *= 1.001;
    }
    for (const Filter filter : {Filter::none, Filter::ewa}) {
        Scene scene = full_scene(make_ellipsoids(arrays, thresholded())), other = scene;
        other.fields = {make_ellipsoids(larger, thresholded())};
        scene.filter = other.filter = filter;
        Request request;
        request.nudge_radius = 1e-3;
        const auto nudged = render(scene, camera_of(true), size, request).rgba;
        EXPECT_LE(largest_difference(nudged, render(other, camera_of(true), size).rgba), 1e-12);
        EXPECT_GT(largest_difference(nudged, render(scene, camera_of(true), size).rgba), 1e-6);
    }
}

TEST(Ellipsoids, AmbiguousPixelsAreThoseOnTheEdge) {
    // Opaque at 0: the edge of the support is a jump.
    EllipsoidArrays arrays = one_ellipsoid(Vec3(0.0), Vec3(2.0, 1.0, 1.0), glm::dquat(1.0, 0.0, 0.0, 0.0));
    Scene scene = make_scene(make_ellipsoids(arrays), TransferFunction({{0.0, Vec3(1.0), 0.5}, {1.0, Vec3(1.0), 0.5}}));
    scene.slice_spacing = 0.5;
    const double end = 2.0 * std::sqrt(1.0 - 0.25 * 0.25);
    const auto marks = [&](double distance) { return ambiguous_pixels(scene, front_camera(distance), Size{3, 1}); };
    EXPECT_EQ(marks(end * (1.0 + 1e-6)), (std::vector<unsigned char>{1, 0, 1}));
    EXPECT_EQ(marks(end * 1.001), (std::vector<unsigned char>{0, 0, 0}));
}

TEST(Ellipsoids, SumsBeyondFloat64AreRefused) {
    EllipsoidArrays arrays;
    arrays.centers = {Vec3(0.0), Vec3(1.0, 0.0, 0.0)};
    arrays.radii = {1.0, 1.0};
    arrays.values = {1e200, 1.0};
    arrays.weights = {1.0, 1e200};
    Scene scene = make_scene(make_ellipsoids(arrays));
    EXPECT_THROW((void)render(scene, front_camera(4.0), Size{2, 2}), InvalidInput);
    arrays.weights = {1.0, 1e100};
    scene.fields = {make_ellipsoids(arrays)};
    EXPECT_NO_THROW((void)render(scene, front_camera(4.0), Size{2, 2}));
}

} // namespace sheetsplat::reference::testing

// Bases, mirrored samples, ends of fields and holes: closed forms and invariants. Source: conventions, sections 2, 3, 5
// and 7.
#include <gtest/gtest.h>

#include "reference/counted.hpp"
#include "reference/kernels.hpp"
#include "reference/points.hpp"
#include "reference/screen.hpp"
#include "scene/mode_rules.hpp"
#include "support.hpp"

namespace sheetsplat::reference::testing {

namespace {

RegularFieldOptions edge_options(Lattice lattice = Lattice::cartesian) {
    RegularFieldOptions options;
    options.boundary = Boundary::edge;
    options.lattice = lattice;
    return options;
}

RegularFieldOptions zero_options() {
    RegularFieldOptions options;
    options.boundary = Boundary::zero;
    return options;
}

/// Opaque from 0 on, a little.
TransferFunction fog(double at = 0.0) {
    return TransferFunction({{at - 1.0, Vec3(0.2, 0.4, 0.6), 0.1}, {at + 1.0, Vec3(0.9, 0.5, 0.1), 0.3}});
}

/// Halves and quarters, so that adding 1024 loses nothing.
std::vector<double> coarse_samples(std::array<std::size_t, 3> shape, double added) {
    return sampled(shape, [added](int i, int j, int k) { return added + 0.25 * ((3 * i + 5 * j + 7 * k) % 11); });
}

double scalar_at_middle(const Scene& scene, double x, double y = 0.0) {
    const Camera camera = Camera::orthographic(Vec3(x, y, 30.0), Vec3(x, y, 0.0), Vec3(0.0, 1.0, 0.0), 1e-3);
    return render(scene, camera, Size{1, 1}).scalar[0];
}

} // namespace

TEST(Edge, AConstantFieldIsConstantUpToWhereItEnds) {
    for (const Lattice lattice : {Lattice::cartesian, Lattice::bcc}) {
        RegularFieldOptions options = edge_options(lattice);
        const std::array<std::size_t, 3> shape{4, 3, 5};
        Scene scene = make_scene(make_field(std::vector<double>(60, 7.3), shape, options));
        EXPECT_EQ(scene.fields[0]->base(), 7.3);
        scene.slice_spacing = 0.3;
        const Box domain = as_regular(scene.fields[0].get())->domain()->box;
        const double y = domain.centre().y;
        for (const double x : {domain.lower.x + 1e-3, domain.centre().x, domain.upper.x - 1e-3}) {
            for (const Mode mode : {Mode::mip, Mode::minimum, Mode::average}) {
                scene.mode = mode;
                EXPECT_NEAR(scalar_at_middle(scene, x, y), 7.3, 1e-14);
            }
        }
        scene.mode = Mode::minimum;
        EXPECT_TRUE(std::isnan(scalar_at_middle(scene, domain.lower.x - 1e-3, y)));
        EXPECT_TRUE(std::isnan(scalar_at_middle(scene, domain.upper.x + 1e-3, y)));
        // One that ends nowhere falls to its base, 0.
        options.boundary = Boundary::zero;
        scene.fields = {make_field(std::vector<double>(60, 7.3), shape, options)};
        EXPECT_LT(scalar_at_middle(scene, domain.centre().x, y), 1.0);
    }
}

TEST(Edge, AnXrayIsTheLengthInsideTimesTheValue) {
    Scene scene = make_scene(make_field(std::vector<double>(60, 7.0), {4, 3, 5}, edge_options()));
    scene.mode = Mode::xray;
    // Layers at 0 ... 3 end at -0.5 and 3.5; slices are anchored at 1.5, so that 16 of them fill it exactly.
    scene.slice_spacing = 0.25;
    EXPECT_NEAR(scalar_at_middle(scene, 2.0, 1.0), 28.0, 1e-13);
    EXPECT_EQ(scalar_at_middle(scene, -0.51, 1.0), 0.0);
    // Coverage is of what is inside, too: W is C there, up to the ripple.
    Request request;
    request.coverage = true;
    const Camera camera = Camera::orthographic(Vec3(2.0, 1.0, 30.0), Vec3(2.0, 1.0, 0.0), Vec3(0.0, 1.0, 0.0), 1e-3);
    const double coverage = render(scene, camera, Size{1, 1}, request).coverage[0];
    const double expected = 4.0 * as_regular(scene.fields[0].get())->lattice_constant();
    EXPECT_NEAR(coverage / expected, 1.0, 0.01);
    scene.fields = {make_field(std::vector<double>(60, 7.0), {4, 3, 5}, zero_options())};
    EXPECT_GT(std::abs(scalar_at_middle(scene, 2.0, 1.0) - 28.0), 0.1);
}

TEST(Edge, CoefficientsPassThroughSamplesOfTheBoundaryToo) {
    for (const Boundary boundary : {Boundary::edge, Boundary::zero}) {
        RegularFieldOptions options = edge_options();
        options.boundary = boundary;
        options.prefilter = true;
        const auto field = make_field(coarse_samples({5, 4, 6}, 3.0), {5, 4, 6}, options);
        for (const Vec3& sample : {Vec3(0.0), Vec3(5.0, 3.0, 4.0), Vec3(0.0, 2.0, 4.0), Vec3(2.0, 1.0, 0.0)}) {
            const double expected =
                3.0 +
                0.25 * static_cast<double>(static_cast<int>(3.0 * sample.x + 5.0 * sample.y + 7.0 * sample.z) % 11);
            EXPECT_NEAR(field->base() + sums_at(*field, sample).d, expected, 1e-5);
        }
    }
}

TEST(Edge, SumsAreMirrorImagesInTheOutermostLayers) {
    std::mt19937_64 generator(5);
    for (const Lattice lattice : {Lattice::cartesian, Lattice::bcc}) {
        for (const Boundary boundary : {Boundary::edge, Boundary::zero}) {
            RegularFieldOptions options = edge_options(lattice);
            options.boundary = boundary;
            options.base = 0.0;
            options.nan = NanPolicy::skip;
            options.radius = 2.4;
            if (lattice == Lattice::cartesian) {
                options.spacing = Vec3(1.0, 0.7, 1.3);
            }
            std::vector<double> samples = coarse_samples({4, 3, 5}, 1.0);
            samples[17] = samples[3] = no_number;
            const auto field = make_field(samples, {4, 3, 5}, options);
            const Box layers = lattice == Lattice::bcc ? Box{Vec3(0.0), Vec3(4.5, 2.5, 1.5)}
                                                       : Box{Vec3(0.0), Vec3(4.0, 2.0, 3.0) * options.spacing};
            double largest = 0.0;
            for (int n = 0; n < 60; ++n) {
                // No farther beyond a layer than the domain.
                Vec3 point;
                for (int axis = 0; axis < 3; ++axis) {
                    point[axis] = random_real(generator, layers.lower[axis], layers.upper[axis]);
                }
                const int axis = n % 3;
                const bool last = n % 2 == 1;
                const double plane = last ? layers.upper[axis] : layers.lower[axis];
                point[axis] = plane + (last ? 1.0 : -1.0) * random_real(generator, 0.0, 0.2);
                Vec3 image = point;
                image[axis] = 2.0 * plane - point[axis];
                largest = std::max(largest, std::abs(sums_at(*field, point).d - sums_at(*field, image).d));
                largest = std::max(largest, std::abs(sums_at(*field, point).w - sums_at(*field, image).w));
            }
            if (boundary == Boundary::edge) {
                EXPECT_LT(largest, 1e-12);
            } else {
                EXPECT_GT(largest, 0.1);
            }
        }
    }
}

TEST(Edge, MirrorsAreLookedIntoAsOftenAsItTakes) {
    // Two layers 1 apart, 0 and 1, and a kernel of radius 5: with both mirrors they alternate for ever.
    RegularFieldOptions options = edge_options();
    options.radius = 5.0;
    options.base = 0.0;
    const auto two = make_field({0.0, 1.0}, {1, 1, 2}, options);
    std::vector<double> many;
    for (int i = 0; i < 40 * 31 * 31; ++i) {
        many.push_back(i % 40 % 2 == 0 ? 0.0 : 1.0);
    }
    options.boundary = Boundary::zero;
    options.origin = Vec3(-20.0, -15.0, -15.0);
    const auto plain = make_field(many, {31, 31, 40}, options);
    for (const double x : {-0.5, 0.0, 0.3, 1.2}) {
        const Vec3 point(x, 0.3, -0.2);
        EXPECT_NEAR(sums_at(*two, point).d, sums_at(*plain, point).d, 1e-12 * sums_at(*plain, point).w);
        EXPECT_NEAR(sums_at(*two, point).w, sums_at(*plain, point).w, 1e-12 * sums_at(*plain, point).w);
    }
    options.boundary = Boundary::zero;
    options.origin = Vec3(0.0);
    EXPECT_LT(sums_at(*make_field({0.0, 1.0}, {1, 1, 2}, options), Vec3(0.3)).w, 3.0);
}

TEST(Edge, TheReferenceAndTheFieldAgreeOnWhatIsMirrored) {
    for (const Lattice lattice : {Lattice::cartesian, Lattice::bcc}) {
        for (const double radius : {0.8, 1.7, 2.0, 3.3}) {
            RegularFieldOptions options = edge_options(lattice);
            options.radius = radius;
            options.nan = NanPolicy::skip;
            std::vector<double> samples = coarse_samples({4, 3, 5}, 0.0);
            samples[7] = no_number;
            const auto field = make_field(samples, {4, 3, 5}, options);
            const auto mirrored = field->with_mirrored();
            std::size_t kernels = 0;
            const WorldKernels world(*field);
            for (std::uint64_t number = 0; number < world.numbers(); ++number) {
                kernels += world.at(number) ? 1 : 0;
            }
            EXPECT_EQ(kernels, mirrored->size());
            EXPECT_GT(kernels, field->size());
            for (const Vec3& point : {Vec3(-0.4, 0.3, 0.2), Vec3(2.1, 1.4, 0.6), Vec3(3.0, 3.0, 2.0), Vec3(-2.0)}) {
                EXPECT_NEAR(sums_at(*field, point).d, sums_at(*mirrored, point).d, 1e-13);
                EXPECT_NEAR(sums_at(*field, point).w, sums_at(*mirrored, point).w, 1e-13);
            }
        }
    }
}

TEST(Edge, ABccLatticeOfOneLayerEndsNowhere) {
    const RegularFieldOptions options = edge_options(Lattice::bcc);
    const auto one = make_field(coarse_samples({1, 3, 4}, 1.0), {1, 3, 4}, options);
    EXPECT_FALSE(one->domain().has_value());
    EXPECT_EQ(WorldKernels(*one).numbers(), 12U);
    EXPECT_GT(WorldKernels(*make_field(coarse_samples({2, 3, 4}, 1.0), {2, 3, 4}, options)).numbers(), 24U);
}

TEST(Base, AddingAConstantToEverythingChangesNoPixel) {
    constexpr double added = 1024.0;
    const std::array<std::size_t, 3> shape{5, 4, 6};
    const auto scene_at = [&](double at, Mode mode, Boundary boundary, double function_at) {
        RegularFieldOptions options = edge_options();
        options.boundary = boundary;
        options.base = at + 0.5;
        Scene scene = make_scene(make_field(coarse_samples(shape, at), shape, options),
                                 TransferFunction({{function_at, Vec3(0.1, 0.2, 0.9), 0.0},
                                                   {function_at + 1.0, Vec3(0.3, 0.9, 0.2), 0.3},
                                                   {function_at + 2.5, Vec3(1.0, 0.5, 0.1), 0.6}}));
        scene.lights = two_lights();
        scene.slice_spacing = 0.4;
        scene.mode = mode;
        scene.iso_values = {{function_at + 1.125, 0.5}};
        return scene;
    };
    const Camera camera = oblique_camera(8.0);
    for (const Boundary boundary : {Boundary::edge, Boundary::zero}) {
        for (const Mode mode : {Mode::composite, Mode::isosurface, Mode::mip, Mode::minimum, Mode::average}) {
            for (const bool preintegrated : {false, mode == Mode::composite}) {
                Scene here = scene_at(0.0, mode, boundary, 0.0), there = scene_at(added, mode, boundary, added);
                here.shadows = there.shadows = !sheetsplat::is_scalar(mode);
                if (sheetsplat::is_scalar(mode)) {
                    here.lights.clear(), there.lights.clear();
                }
                here.preintegration = there.preintegration = preintegrated;
                const Picture a = render(here, camera, Size{12, 10});
                Picture b = render(there, camera, Size{12, 10});
                for (double& value : b.scalar) {
                    value -= added;
                }
                EXPECT_LE(largest_difference(a.rgba, b.rgba), 1e-12) << static_cast<int>(mode);
                EXPECT_LE(largest_difference(a.scalar, b.scalar), 1e-12) << static_cast<int>(mode);
                // Not where the base stays behind.
                RegularFieldOptions options = edge_options();
                options.boundary = boundary;
                options.base = 0.5;
                there.fields = {make_field(coarse_samples(shape, added), shape, options)};
                b = render(there, camera, Size{12, 10});
                for (double& value : b.scalar) {
                    value -= added;
                }
                EXPECT_GT(largest_difference(a.rgba, b.rgba) + largest_difference(a.scalar, b.scalar), 1e-3)
                    << static_cast<int>(mode);
            }
        }
    }
}

TEST(Base, OfGroupsAddUpAndShowOnlyWhereAFieldReaches) {
    EllipsoidFieldOptions options;
    options.base = 2.0;
    const auto two = make_ellipsoids(one_ellipsoid(Vec3(0.0), Vec3(1.0), glm::dquat(1.0, 0.0, 0.0, 0.0)), options);
    options.base = 3.0;
    const auto three =
        make_ellipsoids(one_ellipsoid(Vec3(4.0, 0.0, 0.0), Vec3(1.0), glm::dquat(1.0, 0.0, 0.0, 0.0)), options);
    Scene scene = make_scene(two, fog(5.0));
    scene.fields.push_back(three);
    scene.slice_spacing = 0.25;
    scene.mode = Mode::average;
    // Slices at 1/8, 3/8 ... from the middle; rho = 5 + (1 - 2) g.
    double expected = 0.0;
    for (int n = 0; n < 4; ++n) {
        expected += 5.0 - kernel_value(0.125 + 0.25 * n, 8.0);
    }
    EXPECT_NEAR(scalar_at_middle(scene, 0.0), expected / 4.0, 1e-12);
    scene.mode = Mode::xray;
    EXPECT_NEAR(scalar_at_middle(scene, 0.0), expected * 0.5, 1e-12);
    EXPECT_EQ(scalar_at_middle(scene, 2.0), 0.0);
    scene.mode = Mode::composite;
    const Camera camera = Camera::orthographic(Vec3(2.0, 0.0, 30.0), Vec3(2.0, 0.0, 0.0), Vec3(0.0, 1.0, 0.0), 1e-3);
    EXPECT_EQ(render(scene, camera, Size{1, 1}).rgba, (std::vector<double>{0.0, 0.0, 0.0, 0.0}));
}

TEST(Domain, CutsAsAClipDoes) {
    // The same lattice, its mirrored samples given, clipped by a box: no pixel differs but by rounding.
    const std::array<std::size_t, 3> shape{4, 4, 4};
    const auto field = make_field(coarse_samples(shape, 1.0), shape, edge_options());
    const auto whole = field->with_mirrored();
    for (const bool perspective : {false, true}) {
        const Camera camera = perspective
                                  ? Camera::perspective(Vec3(6.0, 4.0, 9.0), Vec3(1.5), Vec3(0.0, 1.0, 0.0), 40.0, 0.1)
                                  : oblique_camera(9.0);
        for (const Mode mode : {Mode::composite, Mode::isosurface, Mode::xray, Mode::mip}) {
            for (const Sampling sampling : {Sampling::point, Sampling::slab}) {
                for (const bool preintegrated : {false, mode == Mode::composite}) {
                    Scene scene = make_scene(field, fog(1.0));
                    scene.lights = sheetsplat::is_scalar(mode) ? std::vector<Light>{} : two_lights();
                    scene.mode = mode;
                    scene.sampling = sampling;
                    scene.preintegration = preintegrated;
                    scene.iso_values = {{2.0, 0.6}};
                    scene.slice_spacing = 0.3;
                    scene.reference_length = 1.0;
                    Scene clipped = scene;
                    clipped.fields = {whole};
                    clipped.clip.box = field->domain();
                    // Slices are anchored at the box of the centres that were given, whose middle is that of all.
                    Request request;
                    request.coverage = true;
                    const Picture a = render(scene, camera, Size{16, 12}, request);
                    const Picture b = render(clipped, camera, Size{16, 12}, request);
                    EXPECT_LE(largest_difference(a.rgba, b.rgba), 1e-11);
                    EXPECT_LE(largest_difference(a.scalar, b.scalar), 1e-11);
                    EXPECT_LE(largest_difference(a.coverage, b.coverage), 1e-11);
                    clipped.clip.box->box.upper.x -= 0.2;
                    const Picture c = render(clipped, camera, Size{16, 12}, request);
                    EXPECT_GT(largest_difference(a.coverage, c.coverage), 1e-3);
                }
            }
        }
    }
}

TEST(Domain, ItsFacesAreInside) {
    // A ray in a face of the domain: within a millionth of a slice distance it is inside.
    Scene scene = make_scene(make_field(std::vector<double>(27, 2.0), {3, 3, 3}, edge_options()));
    scene.mode = Mode::average;
    EXPECT_NEAR(scalar_at_middle(scene, -0.5, 1.0), 2.0, 1e-12);
    EXPECT_NEAR(scalar_at_middle(scene, 2.5 + 0.9e-6, 1.0), 2.0, 1e-12);
    EXPECT_TRUE(std::isnan(scalar_at_middle(scene, 2.5 + 1.1e-6, 1.0)));
    EXPECT_TRUE(std::isnan(scalar_at_middle(scene, -0.5 - 1.1e-6, 1.0)));
}

TEST(Domain, SurfacesAreOpenThere) {
    // A field of 2 has no surface of 1 with `edge`, and one around it with `zero`.
    Scene scene = make_scene(make_field(std::vector<double>(64, 2.0), {4, 4, 4}, edge_options()), fog());
    scene.mode = Mode::isosurface;
    scene.iso_values = {1.0};
    const Picture open = render(scene, oblique_camera(9.0), Size{16, 12});
    EXPECT_EQ(largest_of(open.rgba), 0.0);
    scene.fields = {make_field(std::vector<double>(64, 2.0), {4, 4, 4}, zero_options())};
    EXPECT_GT(largest_of(render(scene, oblique_camera(9.0), Size{16, 12}).rgba), 0.9);
}

TEST(Domain, OfOneGroupsIsNotThatOfAnother) {
    // Two groups, side by side: each ends where its own field does; in scalar modes each adds what it has inside.
    RegularFieldOptions left = edge_options(), right = edge_options();
    right.origin = Vec3(2.0, 0.0, 0.0);
    const auto one = make_field(std::vector<double>(27, 1.0), {3, 3, 3}, left);
    const auto four = make_field(std::vector<double>(27, 4.0), {3, 3, 3}, right);
    Scene scene = make_scene(one, fog());
    scene.fields.push_back(four);
    scene.later_groups = {{1, fog()}};
    scene.mode = Mode::average;
    EXPECT_NEAR(scalar_at_middle(scene, 0.0, 1.0), 1.0, 1e-12);
    EXPECT_NEAR(scalar_at_middle(scene, 2.0, 1.0), 5.0, 1e-12);
    EXPECT_NEAR(scalar_at_middle(scene, 3.0, 1.0), 4.0, 1e-12);
    EXPECT_TRUE(std::isnan(scalar_at_middle(scene, 4.6, 1.0)));
    // In one group they end nowhere, and count from 0.
    scene.later_groups.clear();
    const CountedScene counted(scene);
    EXPECT_EQ(counted.scene().fields[0]->base(), 0.0);
    EXPECT_TRUE(counted.end_of_field(0).empty());
    EXPECT_FALSE(std::isnan(scalar_at_middle(scene, 4.6, 1.0)));
    scene.fields = {one, make_field(std::vector<double>(27, 4.0), {3, 3, 3}, left)};
    EXPECT_EQ(CountedScene(scene).scene().fields[0]->base(), 1.0);
    EXPECT_NEAR(scalar_at_middle(scene, 0.0, 1.0), 5.0, 1e-12);
}

TEST(Holes, ShowNoValueBetweenTheDataAndNothing) {
    // Values of 5 and 6 about a hole: nothing is below 5, and the middle of the hole is empty.
    std::vector<double> samples = sampled({9, 9, 9}, [](int i, int j, int k) {
        const int far = std::max({std::abs(i - 4), std::abs(j - 4), std::abs(k - 4)});
        return far < 2 ? no_number : 5.0 + (i + j + k) % 2;
    });
    for (const Boundary boundary : {Boundary::edge, Boundary::zero}) {
        RegularFieldOptions options = edge_options();
        options.boundary = boundary;
        options.nan = NanPolicy::skip;
        options.base = 0.0;
        Scene scene = make_scene(make_field(samples, {9, 9, 9}, options), fog(5.0));
        scene.slice_spacing = 0.25;
        scene.mode = Mode::minimum;
        const double least = scalar_at_middle(scene, 4.0, 4.0);
        const auto* lattice = as_regular(scene.fields[0].get());
        EXPECT_LT(sums_at(*lattice, Vec3(4.0, 4.0, 4.2)).w, 0.5 * lattice->lattice_constant());
        EXPECT_FALSE(sums_at(*lattice, Vec3(4.0, 4.0, 4.5)).empty);
        if (boundary == Boundary::edge) {
            EXPECT_GE(least, 5.0 - 1e-12);
        } else {
            EXPECT_LT(least, 1.0);
        }
        // With light from all sides of a point in the hole, light passes what is empty.
        scene.mode = Mode::composite;
        const Camera camera = front_camera(2.0);
        const CountedScene counted(scene);
        const Screen screen(camera, Size{3, 3});
        const PointSums sums(*counted.scene().fields[0], counted.scene(), camera, screen, 1.0);
        const Vec3 in_hole = camera.to_eye(Vec3(4.0, 4.0, 4.5));
        EXPECT_FALSE(sums.sums_at(in_hole).empty);
        EXPECT_EQ(sums.at(in_hole).empty, boundary == Boundary::edge);
    }
}

TEST(ScalarModes, AreNoNumberWhereNothingCounts) {
    // Values below 0 stay below 0.
    Scene scene = make_scene(make_field(std::vector<double>(27, -2.0), {3, 3, 3}, zero_options()));
    scene.mode = Mode::mip;
    EXPECT_LT(scalar_at_middle(scene, 1.0, 1.0), 0.0);
    for (const Mode mode : {Mode::mip, Mode::minimum, Mode::average}) {
        scene.mode = mode;
        EXPECT_TRUE(std::isnan(scalar_at_middle(scene, 20.0, 1.0)));
    }
    scene.mode = Mode::xray;
    EXPECT_EQ(scalar_at_middle(scene, 20.0, 1.0), 0.0);
    // A kernel whose value is the base adds nothing, and counts.
    EllipsoidFieldOptions options;
    options.base = 3.0;
    EllipsoidArrays arrays = one_ellipsoid(Vec3(0.0), Vec3(1.0), glm::dquat(1.0, 0.0, 0.0, 0.0));
    arrays.values = {3.0};
    scene.fields = {make_ellipsoids(arrays, options)};
    scene.slice_spacing = 0.5;
    for (const double weight : {1.0, 0.0}) {
        arrays.centers = {Vec3(0.0), Vec3(9.0, 0.0, 0.0)};
        arrays.scales = {Vec3(1.0), Vec3(1.0)};
        arrays.rotations.clear();
        arrays.values = {3.0, 3.0};
        arrays.weights = {weight, 1.0};
        scene.fields = {make_ellipsoids(arrays, options)};
        EXPECT_NEAR(scalar_at_middle(scene, 0.0), weight > 0.0 ? 6.0 : 0.0, 1e-12);
    }
}

TEST(Shading, WeakGradientsAreThoseOfTheWindowOrOfTheRange) {
    // A window of one value: g0 is 1e-3 / 4096 of the range.
    Scene scene =
        make_scene(make_field({0.0, 8.192}, {1, 1, 2}, plain_options()), TransferFunction({{1.0, Vec3(1.0), 1.0}}));
    EXPECT_NEAR(CountedScene(scene).weakest_difference(scene.groups()[0]), 2e-6, 1e-18);
    scene.transfer_function = TransferFunction({{1.0, Vec3(1.0), 1.0}, {2.0, Vec3(1.0), 1.0}});
    EXPECT_NEAR(CountedScene(scene).weakest_difference(scene.groups()[0]), 1e-3, 1e-15);
    // Of several fields the largest.
    scene.transfer_function = TransferFunction({{1.0, Vec3(1.0), 1.0}});
    scene.fields.push_back(make_field({0.0, -16.384}, {1, 1, 2}, plain_options()));
    EXPECT_NEAR(CountedScene(scene).weakest_difference(scene.groups()[0]), 4e-6, 1e-18);
}

} // namespace sheetsplat::reference::testing

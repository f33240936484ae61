// Effects beyond the papers (conventions, section 10), each against a closed form or against numbers
// that are found in another way.
#include <gtest/gtest.h>

#include "reference/classify.hpp"
#include "reference/clip.hpp"
#include "reference/points.hpp"
#include "reference/slices.hpp"
#include "reference/sums.hpp"
#include "reference/surroundings.hpp"
#include "sheetsplat/error.hpp"
#include "support.hpp"
#include "support/lattices.hpp"

namespace sheetsplat::reference::testing {

namespace {

constexpr Size size{11, 9};

Camera side_camera(bool perspective, double sideways = 0.0, double up = 0.0) {
    const Vec3 target(0.2, -0.1, 0.3), away = glm::normalize(Vec3(0.5, 0.3, 0.9));
    const Camera straight = Camera::orthographic(target + 12.0 * away, target, Vec3(0.1, 1.0, 0.0), 5.0);
    if (perspective) {
        return Camera::perspective(straight.eye(), target, Vec3(0.1, 1.0, 0.0), 25.0);
    }
    const Vec3 shift = sideways * straight.right_world() + up * straight.up_world();
    return Camera::orthographic(straight.eye() + shift, target + shift, Vec3(0.1, 1.0, 0.0), 5.0);
}

/// Kernels whose edges are so low that derivatives hardly jump there.
std::shared_ptr<const EllipsoidField> smooth_cloud(Normalization normalization) {
    EllipsoidFieldOptions options;
    options.falloff = 20.0;
    options.normalization = normalization;
    options.w0 = 0.2;
    EllipsoidArrays arrays = scattered(30, 5);
    if (normalization == Normalization::lattice) {
        options.cell_volume = 0.4;
        std::fill(arrays.scales.begin(), arrays.scales.end(), Vec3(1.7, 1.2, 0.8));
    }
    return make_ellipsoids(arrays, options);
}

/// One sheet of the field, gradients included.
Sheet sheet_of(const Scene& scene, const Camera& camera, std::int64_t n, Slices& slices) {
    const Screen screen(camera, size);
    slices = find_slices(scene, camera, screen, 1.0);
    FieldSums sums(*scene.fields.front(), {}, scene, camera, screen, slices, 1.0, ZeroKernels::drawn);
    Sheet sheet(screen, {false, false, true});
    SheetSums scratch(sheet);
    for (std::int64_t at = slices.first; at <= n; ++at) {
        sheet.clear();
        sums.add_next(sheet, scratch);
    }
    return sheet;
}

/// Derivative of fourth order by differences, two distances and Richardson's step.
double derivative(const std::function<double(double)>& function) {
    constexpr double h = 2e-3;
    const double wide = (function(h) - function(-h)) / (2.0 * h);
    const double narrow = (function(0.5 * h) - function(-0.5 * h)) / h;
    return (4.0 * narrow - wide) / 3.0;
}

} // namespace

TEST(PointSums, AreTheSumsOfAllKernels) {
    for (const Normalization normalization : {Normalization::none, Normalization::threshold}) {
        EllipsoidFieldOptions options;
        options.normalization = normalization;
        options.w0 = 0.4;
        const auto field = make_ellipsoids(scattered(80, 3), options);
        const Scene scene = make_scene(field);
        const Camera camera = side_camera(true);
        const PointSums sums(*field, scene, camera, Screen(camera, size), 1.0);
        std::mt19937_64 generator(1);
        int reached = 0;
        for (int n = 0; n < 500; ++n) {
            const Vec3 world(random_real(generator, -5.0, 5.0), random_real(generator, -5.0, 5.0),
                             random_real(generator, -5.0, 5.0));
            const Vec3 from_eye = world - camera.eye();
            const Vec3 eye(glm::dot(from_eye, camera.right_world()), glm::dot(from_eye, camera.up_world()),
                           glm::dot(from_eye, camera.back_world()));
            const Sums wanted = sums_at(*field, world);
            const double rho =
                normalization == Normalization::none ? wanted.d : wanted.d / std::max(options.w0, wanted.w);
            const PointSums::Value found = sums.at(eye);
            EXPECT_EQ(found.empty, wanted.empty);
            EXPECT_NEAR(found.rho, rho, 1e-12);
            reached += wanted.empty ? 0 : 1;
        }
        EXPECT_GT(reached, 100);
        EXPECT_LT(reached, 450);
    }
}

// Thin kernels are left out of most cells that the boxes around them meet, never out of one that has a point of them.
TEST(PointSums, HaveNeedlesInAllTheirCells) {
    for (const double thin : {1e-1, 1e-3}) {
        EllipsoidArrays arrays = scattered(400, 11);
        for (Vec3& scales : arrays.scales) {
            scales *= Vec3(thin, thin, 1.0);
        }
        const auto field = make_ellipsoids(arrays, plain_ellipsoids());
        const Scene scene = make_scene(field);
        const Camera camera = side_camera(false);
        const PointSums sums(*field, scene, camera, Screen(camera, size), 1.0);
        std::mt19937_64 generator(3);
        for (std::size_t n = 0; n < field->size(); ++n) {
            const Vec3 unit(random_real(generator, -0.5, 0.5), random_real(generator, -0.5, 0.5),
                            random_real(generator, -0.7, 0.7));
            const Vec3 world = arrays.centers[n] + glm::mat3_cast(arrays.rotations[n]) * (arrays.scales[n] * unit);
            const PointSums::Value found = sums.at(camera.to_eye(world));
            EXPECT_FALSE(found.empty);
            EXPECT_NEAR(found.rho, sums_at(*field, world).d, 1e-12 / thin);
        }
    }
}

TEST(PointSums, AreTheSheetsAtTheirPoints) {
    for (const bool perspective : {false, true}) {
        for (const Filter filter : {Filter::none, Filter::ewa}) {
            Scene scene = make_scene(blobs());
            scene.filter = filter;
            const Camera camera = Camera::perspective(Vec3(9.0, 9.0, 14.0), Vec3(4.0, 3.5, 3.0), Vec3(0.0, 1.0, 0.0),
                                                      perspective ? 40.0 : 1.0);
            const Screen screen(camera, size);
            Slices slices;
            const Sheet sheet = sheet_of(scene, camera, 0, slices);
            const PointSums sums(*scene.fields.front(), scene, camera, screen, 1.0);
            double largest = 0.0;
            for (int row = 0; row < size.height; ++row) {
                for (int column = 0; column < size.width; ++column) {
                    const double rho = sums.at(screen.point(column, row, slices.depth(0))).rho;
                    EXPECT_NEAR(rho, sheet.rho[sheet.index(column, row)], 1e-13);
                    largest = std::max(largest, rho);
                }
            }
            EXPECT_GT(largest, 0.3);
        }
    }
}

TEST(AnalyticGradient, IsTheDerivativeOfRhoAtPoints) {
    for (const bool perspective : {false, true}) {
        for (const Filter filter : {Filter::none, Filter::ewa}) {
            for (const Normalization normalization :
                 {Normalization::none, Normalization::lattice, Normalization::threshold}) {
                Scene scene = make_scene(smooth_cloud(normalization));
                scene.filter = filter;
                scene.slice_spacing = 0.3;
                const Camera camera = side_camera(perspective);
                const Screen screen(camera, size);
                Slices slices;
                const Sheet sheet = sheet_of(scene, camera, 0, slices);
                const PointSums sums(*scene.fields.front(), scene, camera, screen, 1.0);
                double farthest = 0.0, turned = 0.0, steepest = 0.0;
                for (int row = 0; row < size.height; ++row) {
                    for (int column = 0; column < size.width; ++column) {
                        const Vec3 point = screen.point(column, row, slices.depth(0));
                        const Vec3 found = sheet.gradient[sheet.index(column, row)] / scene.reference_distance();
                        Vec3 wanted(0.0);
                        for (int axis = 0; axis < 3; ++axis) {
                            wanted[axis] = derivative([&](double h) {
                                Vec3 moved = point;
                                moved[axis] += h;
                                return sums.at(moved).rho;
                            });
                        }
                        // max(w0, W) has an edge, where no difference is a derivative.
                        if (normalization == Normalization::threshold && glm::distance(found, wanted) > 1e-2) {
                            continue;
                        }
                        farthest = std::max(farthest, glm::distance(found, wanted));
                        turned = std::max(turned, glm::distance(found * Vec3(1.0, 1.0, -1.0), wanted));
                        steepest = std::max(steepest, glm::length(wanted));
                    }
                }
                EXPECT_LT(farthest, 1e-5 * std::max(1.0, steepest));
                EXPECT_GT(turned, 0.1) << "a gradient with a turned depth must differ";
            }
        }
    }
}

TEST(AnalyticGradient, OfSlabsIsTheMean) {
    // Of D, sideways: the derivative of the mean; along the ray: the difference of the slab's ends over its length.
    for (const Filter filter : {Filter::none, Filter::ewa}) {
        Scene scene = make_scene(smooth_cloud(Normalization::none));
        scene.filter = filter;
        scene.sampling = Sampling::slab;
        scene.slice_spacing = 0.3;
        const Camera camera = side_camera(false);
        const Screen screen(camera, size);
        Slices slices;
        const Sheet sheet = sheet_of(scene, camera, 1, slices);
        const PointSums sums(*scene.fields.front(), scene, camera, screen, 1.0);
        std::array<Sheet, 4> beside{sheet, sheet, sheet, sheet};
        constexpr double h = 1e-3;
        beside[0] = sheet_of(scene, side_camera(false, h, 0.0), 1, slices);
        beside[1] = sheet_of(scene, side_camera(false, -h, 0.0), 1, slices);
        beside[2] = sheet_of(scene, side_camera(false, 0.0, h), 1, slices);
        beside[3] = sheet_of(scene, side_camera(false, 0.0, -h), 1, slices);
        double farthest = 0.0, of_points = 0.0;
        scene.sampling = Sampling::point;
        const Sheet plane = sheet_of(scene, camera, 1, slices);
        for (int row = 0; row < size.height; ++row) {
            for (int column = 0; column < size.width; ++column) {
                const std::size_t at = sheet.index(column, row);
                const double back = sums.at(screen.point(column, row, slices.back(1))).rho;
                const double front = sums.at(screen.point(column, row, slices.front(1))).rho;
                const Vec3 wanted((beside[0].rho[at] - beside[1].rho[at]) / (2.0 * h),
                                  (beside[2].rho[at] - beside[3].rho[at]) / (2.0 * h), (front - back) / 0.3);
                farthest = std::max(farthest, glm::distance(sheet.gradient[at] / scene.reference_distance(), wanted));
                of_points = std::max(of_points, glm::distance(plane.gradient[at] / scene.reference_distance(), wanted));
            }
        }
        EXPECT_LT(farthest, 1e-3);
        EXPECT_GT(of_points, 3e-2);
    }
}

TEST(AnalyticGradient, OfSlabsDividesMeans) {
    const auto parts = [](Normalization normalization, bool ones) {
        EllipsoidFieldOptions options;
        options.falloff = 20.0;
        options.normalization = normalization;
        options.w0 = 0.05;
        EllipsoidArrays arrays = scattered(60, 5);
        if (ones) {
            std::fill(arrays.values.begin(), arrays.values.end(), 1.0);
        }
        Scene scene = make_scene(make_ellipsoids(arrays, options));
        scene.sampling = Sampling::slab;
        scene.slice_spacing = 0.3;
        Slices slices;
        return sheet_of(scene, side_camera(true), 0, slices);
    };
    const Sheet d = parts(Normalization::none, false), w = parts(Normalization::none, true);
    const Sheet quotient = parts(Normalization::threshold, false);
    int thick = 0, thin = 0;
    for (std::size_t at = 0; at < d.rho.size(); ++at) {
        const Vec3 wanted = w.rho[at] > 0.05
                                ? (d.gradient[at] * w.rho[at] - d.rho[at] * w.gradient[at]) / (w.rho[at] * w.rho[at])
                                : d.gradient[at] / 0.05;
        EXPECT_LT(glm::distance(quotient.gradient[at], wanted), 1e-12 * std::max(1.0, glm::length(wanted)));
        (w.rho[at] > 0.05 ? thick : thin) += w.rho[at] > 0.0 ? 1 : 0;
    }
    EXPECT_GE(thick, 5);
    EXPECT_GT(thin, 10);
}

TEST(AnalyticGradient, OfThinSlabsKeepsItsDigits) {
    // A slab a millionth of the kernel's size: the mean is the value in its middle.
    Scene scene = make_scene(
        make_ellipsoids(one_ellipsoid(Vec3(0.0), Vec3(1.5, 1.0, 0.7), glm::dquat(1, 0, 0, 0)), plain_ellipsoids()));
    const Profile profile(8.0);
    const KernelShape shape(Mat3(1.0), Vec3(1.5, 1.0, 0.7));
    for (const double middle : {0.0, 0.1, -0.33}) {
        const Vec3 beside(0.4, -0.2, 0.0);
        const Chord chord = shape.mean(profile, beside, 0.0, 0.0, middle - 5e-7, middle + 5e-7, true);
        const Vec3 q = shape.to_unit(beside + Vec3(0.0, 0.0, -middle));
        const Vec3 wanted = shape.slope_to_eye(profile.slope(glm::dot(q, q)) * q);
        EXPECT_LT(glm::distance(chord.slope, wanted), 1e-11);
    }
}

TEST(Clipping, KeepsWhatIsOnAPlaneHoweverItIsRounded) {
    Scene scene = make_scene(one_kernel());
    scene.slice_spacing = 0.1;
    const Camera camera = front_camera(2.0);
    for (const double length : {1.0, 3.0, 1e200, 1e-200}) {
        scene.clip.planes = {{length * Vec3(0.0, 0.0, 1.0), length * 0.3}};
        const Clipping clipping(scene, camera);
        EXPECT_TRUE(clipping.keeps(Vec3(0.1, 0.2, 0.3 - 20.0)));
        EXPECT_TRUE(clipping.keeps(Vec3(0.1, 0.2, 0.3 - 20.0 - 0.5e-7)));
        EXPECT_FALSE(clipping.keeps(Vec3(0.1, 0.2, 0.3 - 20.0 - 2e-7)));
    }
}

TEST(Clipping, HalvesAnXRay) {
    Scene scene = make_scene(one_kernel());
    scene.mode = Mode::xray;
    scene.sampling = Sampling::slab;
    scene.slice_spacing = 0.1;
    const Camera camera = front_camera(3.0);
    Request request;
    request.coverage = true;
    const Picture whole = render(scene, camera, size, request);
    const auto share = [&](const Vec3& normal, double offset) {
        scene.clip.planes = {{normal, offset}};
        const Picture cut = render(scene, camera, size, request);
        EXPECT_LT(largest_difference(cut.scalar, cut.coverage), 1e-15) << "one kernel of value and weight 1";
        return cut.scalar[4 * 11 + 5] / whole.scalar[4 * 11 + 5];
    };
    EXPECT_NEAR(share(Vec3(0.0, 0.0, 2.0), 0.0), 0.5, 1e-13);
    EXPECT_NEAR(share(Vec3(0.0, 0.0, -1.0), 0.0), 0.5, 1e-13);
    EXPECT_LT(share(Vec3(0.0, 0.0, 1.0), 0.051), 0.49) << "another slice is gone";
    // Beside the view: whole pixels go.
    EXPECT_EQ(share(Vec3(1.0, 0.0, 0.0), 0.1), 0.0);
    EXPECT_EQ(share(Vec3(1.0, 0.0, 0.0), -0.1), 1.0);
    scene.clip = Clip{};
    scene.clip.box = Box{Vec3(-1.0, -1.0, -0.2), Vec3(1.0, 1.0, 0.2)};
    const double middle = integrate([](double t) { return kernel_value(std::abs(t) / 2.0, 5.0); }, -0.2, 0.2, 1e-15);
    EXPECT_NEAR(render(scene, camera, size).scalar[4 * 11 + 5], middle, 1e-12);
}

TEST(Clipping, OfABoxIsThatOfSixPlanes) {
    Scene scene = make_scene(blobs());
    scene.lights = two_lights();
    Scene planes = scene;
    scene.clip.box = Box{Vec3(1.2, 1.7, 2.1), Vec3(5.3, 4.9, 4.0)};
    for (const Clip::Plane& plane : scene.clip.half_spaces()) {
        planes.clip.planes.push_back({2.5 * plane.normal, 2.5 * plane.offset});
    }
    ASSERT_EQ(planes.clip.planes.size(), 6U);
    const Picture boxed = render(scene, oblique_camera(), size), cut = render(planes, oblique_camera(), size);
    EXPECT_LT(largest_difference(boxed.rgba, cut.rgba), 1e-14);
    planes.clip.planes.pop_back();
    EXPECT_GT(largest_difference(boxed.rgba, render(planes, oblique_camera(), size).rgba), 1e-2);
}

TEST(CutFaces, OfOpaqueMatterAreLitByTheirNormal) {
    RegularFieldOptions options = test::zero_boundary();
    options.origin = Vec3(-8.0, -8.0, -8.0);
    // What varies inside is opaque all the same.
    const auto rough = make_field(
        sampled({17, 17, 17}, [](int i, int j, int k) { return 2.0 + std::sin(1.0 + 2.0 * i + 3.0 * j - 4.0 * k); }),
        {17, 17, 17}, options);
    Scene scene = make_scene(rough, TransferFunction({{0.1, Vec3(1.0), 1.0}, {4.0, Vec3(1.0), 1.0}}));
    scene.material.ambient = 0.25;
    scene.material.diffuse = 0.5;
    scene.material.specular = 0.0;
    scene.lights = {{Vec3(0.6, 0.0, 0.8), Vec3(1.0), LightSpace::eye}};
    scene.clip.planes = {{Vec3(1.0, 0.0, -1.0), 0.0}};
    const Picture without = render(scene, front_camera(4.0), size);
    scene.cut_faces = true;
    const Picture faces = render(scene, front_camera(4.0), size);
    const double lit = 0.25 + 0.5 * (0.8 - 0.6) / std::sqrt(2.0);
    double moved = 0.0;
    for (std::size_t at = 0; at < faces.rgba.size(); at += 4) {
        EXPECT_NEAR(faces.rgba[at], lit, 1e-14);
        moved = std::max(moved, std::abs(faces.rgba[at] - without.rgba[at]));
    }
    EXPECT_GT(moved, 0.2);
}

TEST(GradientOpacity, OfARamp) {
    // rho = x / 4 far from the borders, so that a is multiplied by 1 / (4 g1) there; below g1 = 1/4 by 1.
    RegularFieldOptions options = test::zero_boundary();
    options.normalization = Normalization::threshold;
    options.w0 = 1e-6;
    options.radius = 3.0;
    options.falloff = 8.0;
    options.origin = Vec3(-8.0, -8.0, -8.0);
    const auto ramp = make_field(sampled({17, 17, 17}, [](int i, int, int) { return i / 4.0; }), {17, 17, 17}, options);
    Scene scene =
        make_scene(ramp, TransferFunction({{0.0, Vec3(0.3, 0.5, 0.7), 0.2}, {4.0, Vec3(0.3, 0.5, 0.7), 0.2}}));
    scene.clip.box = Box{Vec3(-1.0, -1.0, -2.0), Vec3(1.0, 1.0, 2.0)};
    const auto opacity = [&](double g1) {
        scene.gradient_opacity = g1;
        return render(scene, front_camera(1.0), Size{1, 1}).rgba[3];
    };
    for (const Gradient gradient : {Gradient::sheets, Gradient::analytic}) {
        scene.gradient = gradient;
        // Four slices, each an opacity of 0.2 times the share.
        EXPECT_NEAR(opacity(0.5), 1.0 - std::pow(1.0 - 0.2 * 0.5, 4.0), 2e-3);
        EXPECT_NEAR(opacity(0.1), 1.0 - std::pow(1.0 - 0.2, 4.0), 1e-12);
        EXPECT_GT(std::abs(opacity(0.6) - (1.0 - std::pow(1.0 - 0.2 * 0.5, 4.0))), 2e-2);
    }
    // Means of extinction are multiplied, not opacities: over the four lengths between slices that are kept, and one
    // on either side.
    scene.preintegration = true;
    const double wanted = 1.0 - std::pow(1.0 - 0.2, 0.5 * 5.0);
    EXPECT_NEAR(opacity(0.5), wanted, 5e-3);
}

TEST(DepthCue, MixesByDepth) {
    // A slice at a time: unlit colours of a homogeneous block, front face at depth 20 - 1.
    Scene scene =
        make_scene(blobs(), TransferFunction({{0.0, Vec3(0.8, 0.4, 0.2), 0.0}, {1.0, Vec3(0.8, 0.4, 0.2), 1.0}}));
    scene.mode = Mode::isosurface;
    scene.iso_values = {0.2};
    Request request;
    request.depth = true;
    const Picture plain = render(scene, oblique_camera(6.0), size, request);
    const double start = 13.0, end = 15.5;
    scene.depth_cue = DepthCue{start, end, Vec3(0.1, 0.9, 0.5), 0.7};
    const Picture cued = render(scene, oblique_camera(6.0), size, request);
    double between = 0.0;
    for (std::size_t pixel = 0; pixel < plain.depth.size(); ++pixel) {
        if (std::isinf(plain.depth[pixel])) {
            continue;
        }
        const double share = 0.7 * std::clamp((plain.depth[pixel] - start) / (end - start), 0.0, 1.0);
        const Vec3 wanted = Vec3(0.8, 0.4, 0.2) + share * (Vec3(0.1, 0.9, 0.5) - Vec3(0.8, 0.4, 0.2));
        for (int channel = 0; channel < 3; ++channel) {
            EXPECT_NEAR(cued.rgba[4 * pixel + static_cast<std::size_t>(channel)], wanted[channel], 1e-14);
        }
        between += share > 0.0 && share < 0.7 ? 1.0 : 0.0;
    }
    EXPECT_GT(between, 10.0);
}

TEST(SecondOrder, OfOneColourIsExact) {
    // Where a does not change, attenuation does not either: 1 - (1 - a)^lengths.
    const TransferFunction flat({{0.0, Vec3(0.4, 0.5, 0.6), 0.3}, {1.0, Vec3(0.4, 0.5, 0.6), 0.3}});
    const ColorOpacity found = preintegrate_second_order(flat, {0.1, 0.9, 0.4, 0.7}, 2.5);
    EXPECT_NEAR(found.opacity, 1.0 - std::pow(0.7, 2.5), 1e-14);
    EXPECT_NEAR(found.color.y, 0.5, 1e-14);
}

TEST(SecondOrder, FollowsTheIntegral) {
    // One interval in which rho is a cubic, against light and opacity by adaptive integration along it. What an
    // interval is off by falls one order faster than a picture.
    const TransferFunction function = smooth_function();
    const auto rho = [](double x) { return 0.15 + 0.1 * x + 0.03 * x * x - 0.015 * x * x * x; };
    const auto tau = [&](double x) { return -std::log1p(-look_up(function, rho(x)).opacity); };
    const auto depth = [&](double x) { return integrate(tau, 0.0, x, 1e-14); };
    const auto off = [&](double h) {
        const double opacity = -std::expm1(-depth(h));
        const double red = integrate(
            [&](double x) { return tau(x) * look_up(function, rho(x)).color.x * std::exp(-depth(x)); }, 0.0, h, 1e-14);
        const ColorOpacity first = preintegrate(function, rho(0.0), rho(h), h);
        const ColorOpacity second = preintegrate_second_order(function, {rho(-h), rho(0.0), rho(h), rho(2.0 * h)}, h);
        return std::array<double, 3>{std::abs(first.opacity * first.color.x - red),
                                     std::abs(second.opacity * second.color.x - red),
                                     std::abs(second.opacity - opacity)};
    };
    const std::array<double, 3> wide = off(0.8), narrow = off(0.2);
    const auto order = [&](std::size_t n) { return 0.5 * std::log2(wide[n] / narrow[n]); };
    std::printf("of an interval: first order %.2f, second %.2f, its opacity %.2f\n", order(0), order(1), order(2));
    EXPECT_LT(order(0), 3.3);
    EXPECT_GT(order(1), 3.7);
    EXPECT_GT(order(2), 3.7);
    EXPECT_LT(narrow[1], 0.02 * narrow[0]);
}

TEST(SecondOrder, KeepsItsRange) {
    std::mt19937_64 generator(4);
    const TransferFunction function(
        {{0.0, Vec3(0.0, 1.0, 0.0), 0.0}, {0.5, Vec3(0.0), 1.0}, {0.5, Vec3(1.0), 0.0}, {1.0, Vec3(1.0), 1.0}});
    for (int n = 0; n < 2000; ++n) {
        std::array<double, 4> rho{};
        for (double& value : rho) {
            value = random_real(generator, -0.5, 1.5);
        }
        const ColorOpacity found = preintegrate_second_order(function, rho, random_real(generator, 0.0, 3.0));
        EXPECT_GE(found.opacity, 0.0);
        EXPECT_LE(found.opacity, 1.0);
        EXPECT_GE(found.color.x, 0.0);
        EXPECT_TRUE(std::isfinite(found.color.y));
    }
}

namespace {

/// Constant opacity 0.2 per length, wherever a kernel reaches, in a box of 13^3 samples around the origin.
Scene block(double spacing) {
    RegularFieldOptions options = test::zero_boundary();
    options.normalization = Normalization::threshold;
    options.origin = Vec3(-6.0);
    Scene scene = make_scene(make_field(std::vector<double>(13 * 13 * 13, 1.0), {13, 13, 13}, options),
                             TransferFunction({{0.0, Vec3(1.0), 0.2}, {1.0, Vec3(1.0), 0.2}}));
    scene.slice_spacing = spacing;
    scene.reference_length = 1.0;
    scene.lights = {Light{}};
    return scene;
}

double left_towards(const Scene& scene, const Vec3& world, const Vec3& direction) {
    const Camera camera = front_camera(4.0);
    const Clipping clipping(scene, camera);
    const CountedScene counted(scene);
    const Surroundings surroundings(counted, camera, Screen(camera, size), clipping, 1.0);
    return surroundings.light(world - Vec3(0.0, 0.0, 20.0), glm::normalize(direction), 0.0);
}

} // namespace

TEST(Shadow, OfAHomogeneousBlock) {
    // Supports end 2 beyond the samples: at 8 along an axis (r < 1: the point at 8 itself is empty).
    EXPECT_NEAR(left_towards(block(1.0), Vec3(0.0), Vec3(0.0, 0.0, 1.0)), std::pow(0.8, 7.0), 1e-13);
    EXPECT_NEAR(left_towards(block(1.0), Vec3(0.0, 0.0, 3.5), Vec3(0.0, 0.0, 2.0)), std::pow(0.8, 4.0), 1e-13);
    EXPECT_NEAR(left_towards(block(0.25), Vec3(0.0), Vec3(-1.0, 0.0, 0.0)), std::pow(0.8, 31.0 / 4.0), 1e-13);
    // From outside, towards it and away from it.
    EXPECT_NEAR(left_towards(block(1.0), Vec3(0.0, 0.0, -20.5), Vec3(0.0, 0.0, 1.0)), std::pow(0.8, 16.0), 1e-13);
    EXPECT_EQ(left_towards(block(1.0), Vec3(0.0, 0.0, 9.0), Vec3(0.0, 0.0, 1.0)), 1.0);
    // What clipping cuts off casts none.
    Scene cut = block(1.0);
    cut.clip.planes = {{Vec3(0.0, 0.0, -1.0), -2.5}};
    EXPECT_NEAR(left_towards(cut, Vec3(0.0), Vec3(0.0, 0.0, 1.0)), std::pow(0.8, 2.0), 1e-13);
    // Through opaque points comes nothing.
    Scene opaque = block(1.0);
    opaque.transfer_function = TransferFunction({{0.0, Vec3(1.0), 1.0}, {1.0, Vec3(1.0), 1.0}});
    EXPECT_EQ(left_towards(opaque, Vec3(0.0), Vec3(0.0, 0.0, 1.0)), 0.0);
}

TEST(Shadow, OfSurfacesIsWhatTheyShow) {
    // A surface in the plane z = 2, and a curtain beside the view, 2 thick (and its kernels' reach of 2 on either
    // side), between it and a light that comes in at 45 degrees. Value 1 is the surface's, 0.1 the curtain's.
    RegularFieldOptions options = test::zero_boundary();
    options.normalization = Normalization::threshold;
    options.w0 = 1e-9;
    options.origin = Vec3(-4.0, -4.0, -8.0);
    const auto ground = make_field(std::vector<double>(9 * 9 * 9, 1.0), {9, 9, 9}, options);
    options.origin = Vec3(7.0, -15.0, 3.0);
    const auto curtain = make_field(std::vector<double>(31 * 31 * 3, 0.1), {31, 31, 3}, options);
    Scene scene = make_scene(ground, TransferFunction({{0.0, Vec3(1.0), 1.0}, {1.0, Vec3(1.0), 1.0}}));
    scene.fields.push_back(curtain);
    scene.mode = Mode::isosurface;
    scene.slice_spacing = 0.05;
    scene.reference_length = 1.0;
    scene.lights = {Light{Vec3(1.0, 0.0, 1.0), Vec3(1.0), LightSpace::world}};
    scene.material.ambient = 0.0;
    scene.material.diffuse = 1.0;
    const auto light = [&](bool shadows) {
        scene.shadows = shadows;
        return render(scene, front_camera(1.0), Size{1, 1}).rgba[0];
    };
    const auto left = [&](std::vector<IsoValue> surfaces) {
        scene.iso_values = std::move(surfaces);
        const double free = light(false);
        EXPECT_GT(free, 0.1);
        return light(true) / free;
    };
    // The curtain's value does not reach the surface's, and the transfer function's opacity casts nothing.
    EXPECT_EQ(left({0.5}), 1.0);
    // Into the curtain and out of it.
    EXPECT_NEAR(left({0.5, {0.08, 0.4}}), 0.6 * 0.6, 1e-12);
    EXPECT_NEAR(left({0.5, {0.08, 0.4}, {0.05, 0.1}}), 0.6 * 0.6 * 0.9 * 0.9, 1e-12);
    EXPECT_EQ(left({0.5, {0.08, 0.0}}), 1.0);
    EXPECT_EQ(left({0.5, 0.08}), 0.0);
    // Cut in its middle, it has no way out; cut off from there to the light, no way in either where both points of
    // the crossing have to be kept.
    scene.clip.planes = {{Vec3(-1.0, 0.0, 0.0), -8.0}};
    EXPECT_NEAR(left({0.5, {0.08, 0.4}}), 0.6, 1e-12);
    scene.clip.planes = {{Vec3(-1.0, 0.0, 0.0), -4.9}};
    EXPECT_EQ(left({0.5, {0.08, 0.4}}), 1.0);
    // As fields with transfer functions of their own.
    scene.clip.planes.clear();
    scene.later_groups = {{1, TransferFunction({{0.0, Vec3(0.0), 0.0}, {1.0, Vec3(0.0), 0.0}})}};
    EXPECT_NEAR(left({0.5, {0.08, 0.4}}), 0.6 * 0.6, 1e-12);
    scene.later_groups.clear();
    scene.fields.pop_back();
    EXPECT_EQ(left({0.5, {0.08, 0.4}}), 1.0) << "without a curtain";
}

TEST(Shadow, CanBeStoppedInsideASlice) {
    Scene scene = block(1.0);
    Request request;
    int calls = 0, wanted = -1;
    request.progress = [&](double) { return ++calls != wanted; };
    const Picture plain = render(scene, front_camera(4.0), size, request);
    EXPECT_EQ(calls, plain.slices + 1);
    scene.shadows = true;
    calls = 0;
    wanted = 4;
    EXPECT_THROW(render(scene, front_camera(4.0), size, request), Cancelled);
    EXPECT_EQ(calls, wanted);
    calls = 0;
    wanted = -1;
    const Picture shadowed = render(scene, front_camera(4.0), size, request);
    EXPECT_EQ(calls, (plain.slices + 1) * (1 + size.height));
    EXPECT_GT(largest_difference(shadowed.rgba, plain.rgba), 1e-2);
    for (std::size_t at = 0; at < plain.rgba.size(); ++at) {
        EXPECT_LE(shadowed.rgba[at], plain.rgba[at]);
    }
}

TEST(AmbientOcclusion, InsideAHomogeneousBlock) {
    for (const double radius : {0.3, 1.0, 3.0, 3.9}) {
        Scene scene = block(0.5);
        scene.ambient_occlusion = AmbientOcclusion{radius, 0.6};
        const Camera camera = front_camera(4.0);
        const Clipping clipping(scene, camera);
        const CountedScene counted(scene);
        const Surroundings surroundings(counted, camera, Screen(camera, size), clipping, 1.0);
        const double steps = std::max(1.0, std::floor(radius / 0.5));
        const double open = std::pow(0.8, 0.5 * steps);
        EXPECT_NEAR(surroundings.ambient(Vec3(0.0, 0.0, -20.0), 0.0), 1.0 - 0.6 * (1.0 - open), 1e-13);
        // Far away nothing occludes; in front of the middle of a face five directions of 14 are free.
        EXPECT_EQ(surroundings.ambient(Vec3(30.0, 0.0, -20.0), 0.0), 1.0);
        const double at_face = 1.0 - 0.6 * 9.0 / 14.0 * (1.0 - open);
        EXPECT_NEAR(surroundings.ambient(Vec3(0.0, 0.0, 7.85 - 20.0), 0.0), at_face, 1e-13);
    }
}

TEST(AmbientOcclusion, OfSurfacesCountsCrossingsWithinTheRadius) {
    // A surface all but where the block ends, 8 from its middle; the first points are half a length away.
    Scene scene = block(0.5);
    scene.mode = Mode::isosurface;
    scene.iso_values = {{1e-6, 0.7}};
    const Camera camera = front_camera(4.0);
    const auto ambient = [&](double z, double radius) {
        scene.ambient_occlusion = AmbientOcclusion{radius, 0.6};
        const Clipping clipping(scene, camera);
        const CountedScene counted(scene);
        const Surroundings surroundings(counted, camera, Screen(camera, size), clipping, 1.0);
        return surroundings.ambient(Vec3(0.0, 0.0, z - 20.0), 0.0);
    };
    EXPECT_EQ(ambient(0.0, 3.0), 1.0);
    // From 7.2 along +z the surface at 8 lies between 7.7 and 8.2, the points of M = 1 and 2.
    EXPECT_EQ(ambient(7.2, 0.5), 1.0);
    EXPECT_EQ(ambient(7.2, 0.9), 1.0);
    EXPECT_NEAR(ambient(7.2, 1.0), 1.0 - 0.6 * 0.7 / 14.0, 1e-13);
    // And from 7.6 between the point itself and the first one, which does not count, but for four diagonals.
    EXPECT_NEAR(ambient(7.6, 1.0), 1.0 - 0.6 * 0.7 * 4.0 / 14.0, 1e-13);
}

TEST(AmbientOcclusion, TakesAmbientLightOnly) {
    // Deep inside, all directions alike: U is known, and lights at a gradient of 0 add nothing.
    Scene scene = block(0.5);
    scene.clip.box = Box{Vec3(-1.0, -1.0, -0.3), Vec3(1.0, 1.0, 0.3)};
    const auto red = [&](double ambient) {
        scene.material.ambient = ambient;
        const Picture picture = render(scene, front_camera(1.0), Size{1, 1});
        return picture.rgba[0] / picture.rgba[3];
    };
    EXPECT_NEAR(red(0.4), 0.4, 1e-13);
    // Cut down to two slices at +- 1/4, one of which is the other's neighbour along z, and free elsewhere: along +-x
    // and
    // +-y one step of 1/2 stays within.
    scene.ambient_occlusion = AmbientOcclusion{0.5, 1.0};
    const double share = 1.0 - 9.0 / 14.0 * (1.0 - std::pow(0.8, 0.5));
    EXPECT_NEAR(red(0.4), 0.4 * share, 1e-13);
    scene.lights.clear();
    EXPECT_NEAR(red(0.4), share, 1e-13) << "without lights all is ambient";
}

} // namespace sheetsplat::reference::testing

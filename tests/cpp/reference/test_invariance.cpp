// What must not change a picture.
#include <gtest/gtest.h>

#include "support.hpp"
#include "support/lattices.hpp"

namespace sheetsplat::reference::testing {

namespace {

/// A scene that uses everything that a composite can: lights of both kinds, highlights, two sides.
Scene full_scene(std::shared_ptr<const RegularField> field) {
    Scene scene = make_scene(std::move(field));
    scene.lights = two_lights();
    scene.material = {0.2, 0.7, 0.4, 12.0, true};
    scene.slice_spacing = 0.6;
    scene.reference_length = 0.9;
    return scene;
}

/// Turns the axes round: x to y, y to z, z to x.
Vec3 turned(const Vec3& v) { return {v.z, v.x, v.y}; }

constexpr Size size{24, 18};

} // namespace

TEST(Invariance, TranslationOfTheWorld) {
    const auto picture = [](const Vec3& shift, double mistake) {
        RegularFieldOptions options = test::zero_boundary();
        options.origin = shift;
        Scene scene = full_scene(blobs(options));
        const Vec3 target = Vec3(4.0, 3.5, 3.0) + shift;
        const Camera camera =
            Camera::perspective(target + Vec3(7.0, 4.0, 12.0 + mistake), target, Vec3(0.1, 1.0, 0.0), 40.0, 1.0);
        return render(scene, camera, size).rgba;
    };
    const auto there = picture(Vec3(1e6, -1e6, 1e6), 0.0), here = picture(Vec3(0.0), 0.0);
    EXPECT_GT(largest_of(here), 0.3);
    EXPECT_LE(largest_difference(here, there), 1e-8);
    EXPECT_GT(largest_difference(here, picture(Vec3(0.0), 1e-6)), 1e-8);
}

TEST(Invariance, ScaleOfTheWorld) {
    for (const bool perspective : {false, true}) {
        for (const Lattice lattice : {Lattice::cartesian, Lattice::bcc}) {
            for (const Sampling sampling : {Sampling::point, Sampling::slab}) {
                const auto picture = [&](double scale, double mistake = 1.0) {
                    RegularFieldOptions options = test::zero_boundary();
                    options.spacing = scale * Vec3(1.0, lattice == Lattice::bcc ? 1.0 : 0.8, 1.0);
                    options.lattice = lattice;
                    Scene scene = full_scene(blobs(options));
                    scene.sampling = sampling;
                    scene.slice_spacing.reset();
                    scene.reference_length = scale * mistake;
                    const Vec3 target = scale * Vec3(4.0, 3.0, 2.5), eye = target + scale * Vec3(7.0, 4.0, 9.0);
                    const Vec3 up(0.1, 1.0, 0.0);
                    const Camera camera = perspective ? Camera::perspective(eye, target, up, 50.0)
                                                      : Camera::orthographic(eye, target, up, 11.0 * scale);
                    return render(scene, camera, size).rgba;
                };
                const auto here = picture(1.0);
                EXPECT_GT(largest_of(here), 0.3);
                EXPECT_LE(largest_difference(here, picture(1e6)), 1e-11);
                EXPECT_LE(largest_difference(here, picture(1e-6)), 1e-11);
                EXPECT_GT(largest_difference(here, picture(1e6, 1.0 + 1e-9)), 1e-11);
            }
        }
    }
}

TEST(Invariance, OrderOfAxes) {
    // The same samples stored with the axes turned round, seen by a camera turned round with them.
    const std::array<std::size_t, 3> shape{4, 5, 6};
    const auto samples =
        sampled(shape, [](int i, int j, int k) { return 0.5 + 0.5 * std::sin(1.3 * i + 2.1 * j * k + 0.7 * k); });
    const auto at = [&](int i, int j, int k) { return samples[static_cast<std::size_t>((k * 5 + j) * 6 + i)]; };
    RegularFieldOptions options = test::zero_boundary();
    options.spacing = Vec3(1.0, 1.3, 0.7);
    options.origin = Vec3(-2.0, -1.0, 0.5);
    RegularFieldOptions other = options;
    other.spacing = turned(options.spacing);
    other.origin = turned(options.origin);
    // New (i, j, k) = old (k, i, j).
    const auto rolled =
        make_field(sampled({5, 6, 4}, [&](int i, int j, int k) { return at(j, k, i); }), {5, 6, 4}, other);
    Scene first = full_scene(make_field(samples, shape, options)), second = full_scene(rolled);
    for (Light& light : second.lights) {
        if (light.space == LightSpace::world) {
            light.direction = turned(light.direction);
        }
    }
    const Vec3 eye(6.0, 5.0, 9.0), target(0.5, 1.6, 1.5), up(0.2, 1.0, 0.1);
    const auto a = render(first, Camera::perspective(eye, target, up, 35.0), size).rgba;
    const auto b = render(second, Camera::perspective(turned(eye), turned(target), turned(up), 35.0), size).rgba;
    EXPECT_GT(largest_of(a), 0.3);
    EXPECT_LE(largest_difference(a, b), 1e-12);
    EXPECT_GT(largest_difference(a, render(second, Camera::perspective(eye, target, up, 35.0), size).rgba), 1e-2);
}

TEST(Invariance, OrderOfSamples) {
    // The same kernels from the other end: x and y turned by half a turn, and the camera with them.
    const std::array<std::size_t, 3> shape{4, 5, 6};
    const auto samples =
        sampled(shape, [](int i, int j, int k) { return 0.5 + 0.5 * std::sin(1.3 * i + 2.1 * j * k + 0.7 * k); });
    const auto reversed = sampled(
        shape, [&](int i, int j, int k) { return samples[static_cast<std::size_t>((k * 5 + 4 - j) * 6 + 5 - i)]; });
    RegularFieldOptions options, other;
    // Not that of the first sample, which is another one from the other end.
    options.base = other.base = 0.4;
    options.origin = Vec3(0.3, 0.2, 0.1);
    other.origin = Vec3(-0.3 - 5.0, -0.2 - 4.0, 0.1);
    const auto half_turn = [](const Vec3& v) { return Vec3(-v.x, -v.y, v.z); };
    Scene first = full_scene(make_field(samples, shape, options)),
          second = full_scene(make_field(reversed, shape, other));
    for (Light& light : second.lights) {
        light.direction = light.space == LightSpace::world ? half_turn(light.direction) : light.direction;
    }
    const Vec3 eye(6.0, 5.0, 9.0), target(2.5, 2.0, 1.5), up(0.2, 1.0, 0.1);
    const auto a = render(first, Camera::orthographic(eye, target, up, 6.0), size).rgba;
    const auto b =
        render(second, Camera::orthographic(half_turn(eye), half_turn(target), half_turn(up), 6.0), size).rgba;
    EXPECT_GT(largest_of(a), 0.3);
    EXPECT_LE(largest_difference(a, b), 1e-12);
}

TEST(Invariance, SplittingKernels) {
    // Two fields on one lattice whose values add up; an empty point is empty in both.
    const std::array<std::size_t, 3> shape{4, 5, 6};
    const auto samples =
        sampled(shape, [](int i, int j, int k) { return 0.5 + 0.5 * std::sin(1.3 * i + 2.1 * j * k + 0.7 * k); });
    auto part = sampled(shape, [](int i, int j, int k) { return std::cos(0.9 * i * j + k); }), rest = samples;
    for (std::size_t n = 0; n < rest.size(); ++n) {
        rest[n] -= part[n];
    }
    for (const Normalization normalization : {Normalization::none, Normalization::lattice}) {
        for (const Mode mode : {Mode::composite, Mode::isosurface, Mode::xray, Mode::mip}) {
            RegularFieldOptions options = test::zero_boundary();
            options.normalization = normalization;
            Scene whole = full_scene(make_field(samples, shape, options));
            whole.transfer_function =
                TransferFunction({{0.0, Vec3(0.1, 0.2, 0.3), 0.1}, {1.0, Vec3(0.9, 0.8, 0.1), 0.8}});
            whole.mode = mode;
            whole.iso_values = {0.6};
            Scene split = whole;
            split.fields = {make_field(part, shape, options), make_field(rest, shape, options)};
            const Camera camera =
                Camera::orthographic(Vec3(6.0, 5.0, 9.0), Vec3(2.5, 2.0, 1.5), Vec3(0.0, 1.0, 0.0), 7.0);
            const Picture a = render(whole, camera, size), b = render(split, camera, size);
            EXPECT_LE(largest_difference(a.rgba, b.rgba), 1e-11);
            EXPECT_LE(largest_difference(a.scalar, b.scalar), 1e-12);
            split.fields.pop_back();
            EXPECT_GT(std::max(largest_difference(a.rgba, render(split, camera, size).rgba),
                               largest_difference(a.scalar, render(split, camera, size).scalar)),
                      1e-2);
        }
    }
}

TEST(Invariance, StretchedAlongTheView) {
    // Samples twice as far apart along z, slices too, opacity for twice the length: the same picture.
    const auto picture = [](double stretch) {
        RegularFieldOptions options = test::zero_boundary();
        options.spacing = Vec3(1.0, 1.0, stretch);
        Scene scene = make_scene(blobs(options));
        scene.slice_spacing = 0.5 * stretch;
        scene.reference_length = stretch;
        const Vec3 target(4.0, 3.5, 3.0 * stretch);
        return render(scene, Camera::orthographic(target + Vec3(0.0, 0.0, 30.0), target, Vec3(0.0, 1.0, 0.0), 11.0),
                      size)
            .rgba;
    };
    const auto plain = picture(1.0);
    EXPECT_GT(largest_of(plain), 0.3);
    EXPECT_LE(largest_difference(plain, picture(2.0)), 1e-13);
    EXPECT_LE(largest_difference(plain, picture(0.3)), 1e-13);
}

TEST(Invariance, StretchedAcrossTheView) {
    // Samples three times as far apart along x, a picture three times as wide: every third column, the middle one of
    // three.
    const auto picture = [](int stretch) {
        RegularFieldOptions options = test::zero_boundary();
        options.spacing = Vec3(stretch, 1.0, 1.0);
        Scene scene = make_scene(blobs(options));
        scene.slice_spacing = 0.5;
        scene.reference_length = 1.0;
        const Vec3 target(4.0 * stretch, 3.5, 3.0);
        return render(scene, Camera::orthographic(target + Vec3(0.0, 0.0, 30.0), target, Vec3(0.0, 1.0, 0.0), 11.0),
                      Size{stretch * size.width, size.height})
            .rgba;
    };
    const auto narrow = picture(1), wide = picture(3);
    std::vector<double> thirds, beside;
    for (std::size_t pixel = 0; pixel < narrow.size() / 4; ++pixel) {
        for (std::size_t c = 0; c < 4; ++c) {
            thirds.push_back(wide[4 * (3 * pixel + 1) + c]);
            beside.push_back(wide[4 * (3 * pixel) + c]);
        }
    }
    EXPECT_GT(largest_of(narrow), 0.3);
    EXPECT_LE(largest_difference(narrow, thirds), 1e-13);
    EXPECT_GT(largest_difference(narrow, beside), 1e-2);
}

TEST(Invariance, BorderPixelsAreThoseOfALargerPicture) {
    // The same grid of pixels with three more on every side: neighbours beyond the edge are computed, not clamped.
    constexpr int more = 3;
    for (const bool perspective : {false, true}) {
        for (const bool preintegration : {false, true}) {
            const auto picture = [&](int extra) {
                Scene scene = full_scene(blobs());
                scene.preintegration = preintegration;
                const double factor = static_cast<double>(size.height + 2 * extra) / size.height;
                const Vec3 target(4.0, 3.5, 3.0), eye = target + Vec3(2.0, 3.0, 9.0), up(0.0, 1.0, 0.0);
                const double fov = 2.0 * std::atan(factor * std::tan(10.0 * pi / 180.0)) * 180.0 / pi;
                const Camera camera = perspective ? Camera::perspective(eye, target, up, fov, 0.1)
                                                  : Camera::orthographic(eye, target, up, 4.0 * factor);
                return render(scene, camera, Size{size.width + 2 * extra, size.height + 2 * extra}).rgba;
            };
            const auto small = picture(0), large = picture(more);
            const auto cut = [&](int dx) {
                std::vector<double> part;
                for (int j = 0; j < size.height; ++j) {
                    for (int i = 0; i < 4 * size.width; ++i) {
                        part.push_back(large[static_cast<std::size_t>(
                            4 * ((j + more) * (size.width + 2 * more) + more + dx) + i)]);
                    }
                }
                return part;
            };
            // Something is at the edges.
            EXPECT_GT(small[3], 0.1);
            EXPECT_GT(small.back(), 0.1);
            EXPECT_LE(largest_difference(small, cut(0)), 1e-12);
            EXPECT_GT(largest_difference(small, cut(1)), 1e-2);
        }
    }
}

TEST(Invariance, PerspectiveFromAfarIsOrthographic) {
    Scene scene = full_scene(blobs());
    scene.sampling = Sampling::slab;
    const Vec3 target(4.0, 3.5, 3.0), direction = glm::normalize(Vec3(0.5, 0.3, 0.9)), up(0.0, 1.0, 0.0);
    const auto flat = render(scene, Camera::orthographic(target + 20.0 * direction, target, up, 11.0), size).rgba;
    std::vector<double> distances, differences;
    for (double distance = 1e3; distance < 2e6; distance *= 10.0) {
        const double fov = 2.0 * std::atan(5.5 / distance) * 180.0 / pi;
        const auto far = render(scene, Camera::perspective(target + distance * direction, target, up, fov), size).rgba;
        distances.push_back(distance);
        differences.push_back(largest_difference(flat, far));
    }
    EXPECT_LE(differences.back(), 1e-5);
    EXPECT_NEAR(fitted_order(distances, differences), -1.0, 0.1);
}

} // namespace sheetsplat::reference::testing

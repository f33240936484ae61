// What the tests of the reference share: small scenes, distances of pictures, numerical integrals.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <initializer_list>
#include <limits>
#include <memory>
#include <numeric>
#include <random>
#include <vector>

#include <glm/geometric.hpp>
#include <glm/gtc/quaternion.hpp>

#include "reference/reference.hpp"
#include "support/lattices.hpp"

namespace sheetsplat::reference::testing {

constexpr double pi = 3.14159265358979323846;
/// What modes mip, minimum and average show where no slice counts.
constexpr double no_number = std::numeric_limits<double>::quiet_NaN();

inline std::shared_ptr<const RegularField> make_field(std::vector<double> samples, std::array<std::size_t, 3> shape,
                                                      const RegularFieldOptions& options = test::zero_boundary()) {
    return std::make_shared<const RegularField>(SampleArray(std::move(samples)), shape, options);
}

/// Options whose rho is the plain sum of kernels.
inline RegularFieldOptions plain_options(double radius = 2.0, double falloff = 5.0) {
    RegularFieldOptions options = test::zero_boundary();
    options.radius = radius;
    options.falloff = falloff;
    options.normalization = Normalization::none;
    return options;
}

/// One kernel of value 1 at the origin.
inline std::shared_ptr<const RegularField> one_kernel(double radius = 2.0, double falloff = 5.0) {
    return make_field({1.0}, {1, 1, 1}, plain_options(radius, falloff));
}

/// nk * nj * ni samples, function(i, j, k).
inline std::vector<double> sampled(std::array<std::size_t, 3> shape,
                                   const std::function<double(int, int, int)>& function) {
    std::vector<double> samples;
    for (int k = 0; k < static_cast<int>(shape[0]); ++k) {
        for (int j = 0; j < static_cast<int>(shape[1]); ++j) {
            for (int i = 0; i < static_cast<int>(shape[2]); ++i) {
                samples.push_back(function(i, j, k));
            }
        }
    }
    return samples;
}

inline std::shared_ptr<const EllipsoidField> make_ellipsoids(EllipsoidArrays arrays,
                                                             const EllipsoidFieldOptions& options = {}) {
    return std::make_shared<const EllipsoidField>(std::move(arrays), options);
}

/// Options whose rho is the plain sum of kernels.
inline EllipsoidFieldOptions plain_ellipsoids(double falloff = 8.0) {
    EllipsoidFieldOptions options;
    options.falloff = falloff;
    options.normalization = Normalization::none;
    return options;
}

/// One kernel of value 1.
inline EllipsoidArrays one_ellipsoid(const Vec3& center, const Vec3& scale, const glm::dquat& rotation) {
    EllipsoidArrays arrays;
    arrays.centers = {center};
    arrays.scales = {scale};
    arrays.rotations = {rotation};
    arrays.values = {1.0};
    return arrays;
}

inline glm::dquat random_rotation(std::mt19937_64& generator) {
    std::normal_distribution<double> normal;
    const double w = normal(generator), x = normal(generator), y = normal(generator), z = normal(generator);
    const double length = std::sqrt(w * w + x * x + y * y + z * z);
    return glm::dquat(w / length, x / length, y / length, z / length);
}

inline double random_real(std::mt19937_64& generator, double from, double to) {
    return std::uniform_real_distribution<double>(from, to)(generator);
}

/// `count` kernels in a box of 6 around the origin, semi-axes from 0.3 to 1.8, values from 0 to 1.
inline EllipsoidArrays scattered(std::size_t count, unsigned seed) {
    std::mt19937_64 generator(seed);
    const auto real = [&](double from, double to) { return random_real(generator, from, to); };
    EllipsoidArrays arrays;
    for (std::size_t n = 0; n < count; ++n) {
        const double x = real(-3.0, 3.0), y = real(-3.0, 3.0), z = real(-3.0, 3.0);
        arrays.centers.emplace_back(x, y, z);
        const double a = real(0.3, 1.8), b = real(0.3, 1.8), c = real(0.3, 1.8);
        arrays.scales.emplace_back(a, b, c);
        arrays.rotations.push_back(random_rotation(generator));
        arrays.values.push_back(real(0.0, 1.0));
        arrays.weights.push_back(real(0.2, 1.5));
    }
    return arrays;
}

/// Opacity and colour that rise with the value: continuous, 0 at 0.
inline TransferFunction smooth_function() {
    return TransferFunction(
        {{0.0, Vec3(0.1, 0.2, 0.9), 0.0}, {0.4, Vec3(0.3, 0.9, 0.2), 0.2}, {1.0, Vec3(1.0, 0.5, 0.1), 0.6}});
}

inline Scene make_scene(std::shared_ptr<const Field> field, TransferFunction function = smooth_function()) {
    Scene scene{{std::move(field)}, std::move(function)};
    scene.opacity_stop = 1.0;
    return scene;
}

/// Looks along -z at the origin from `distance`.
inline Camera front_camera(double height, double distance = 20.0) {
    return Camera::orthographic(Vec3(0.0, 0.0, distance), Vec3(0.0), Vec3(0.0, 1.0, 0.0), height);
}

/// Smooth blobs, 9 * 8 * 7 samples in [0, 1], 0 at most borders.
inline std::shared_ptr<const RegularField> blobs(const RegularFieldOptions& options = test::zero_boundary()) {
    const std::array<std::size_t, 3> shape{7, 8, 9};
    return make_field(sampled(shape,
                              [](int i, int j, int k) {
                                  const double x = i - 3.7, y = j - 3.2, z = k - 3.4;
                                  const double u = i - 5.2, v = j - 4.6, w = k - 2.1;
                                  return 0.8 * std::exp(-0.25 * (x * x + 0.7 * y * y + 0.5 * z * z)) +
                                         0.4 * std::exp(-0.4 * (u * u + v * v + w * w));
                              }),
                      shape, options);
}

/// Looks obliquely at the middle of blobs() with unit spacing.
inline Camera oblique_camera(double height = 14.0) {
    return Camera::orthographic(Vec3(4.0, 3.5, 3.0) + 15.0 * Vec3(0.5, 0.3, 0.9), Vec3(4.0, 3.5, 3.0),
                                Vec3(0.1, 1.0, 0.0), height);
}

inline std::vector<Light> two_lights() {
    return {Light{Vec3(0.3, 0.5, 1.0), Vec3(0.9, 0.8, 0.7), LightSpace::eye},
            Light{Vec3(-1.0, 0.2, 0.4), Vec3(0.2, 0.3, 0.5), LightSpace::world}};
}

/// Largest difference of two arrays of one length; infinite where only one is NaN or infinite, or where the lengths
/// differ; none between two NaN.
inline double largest_difference(const std::vector<double>& a, const std::vector<double>& b) {
    if (a.size() != b.size()) {
        return std::numeric_limits<double>::infinity();
    }
    double largest = 0.0;
    for (std::size_t n = 0; n < a.size(); ++n) {
        if (!(a[n] == b[n]) && !(std::isnan(a[n]) && std::isnan(b[n]))) {
            const double difference = std::abs(a[n] - b[n]);
            largest = std::isnan(difference) ? std::numeric_limits<double>::infinity() : std::max(largest, difference);
        }
    }
    return largest;
}

inline double root_mean_square(const std::vector<double>& a, const std::vector<double>& b) {
    double sum = 0.0;
    for (std::size_t n = 0; n < a.size(); ++n) {
        sum += (a[n] - b[n]) * (a[n] - b[n]);
    }
    return std::sqrt(sum / static_cast<double>(a.size()));
}

/// NaN left out.
inline double largest_of(const std::vector<double>& values) {
    return std::accumulate(values.begin(), values.end(), -std::numeric_limits<double>::infinity(),
                           [](double a, double b) { return std::isnan(b) ? a : std::max(a, b); });
}

/// Adaptive Gauss-Legendre, eight points: an integral to about `tolerance`, by nothing but function values.
inline double integrate(const std::function<double(double)>& function, double from, double to, double tolerance,
                        int depth = 40) {
    constexpr double places[] = {0.18343464249564980, 0.52553240991632899, 0.79666647741362674, 0.96028985649753623};
    constexpr double weights[] = {0.36268378337836198, 0.31370664587788729, 0.22238103445337447, 0.10122853629037626};
    const auto rule = [&](double a, double b) {
        double sum = 0.0;
        for (int n = 0; n < 4; ++n) {
            const double h = 0.5 * (b - a) * places[n], middle = 0.5 * (a + b);
            sum += weights[n] * (function(middle - h) + function(middle + h));
        }
        return 0.5 * (b - a) * sum;
    };
    const double middle = 0.5 * (from + to);
    const double whole = rule(from, to), halves = rule(from, middle) + rule(middle, to);
    // Rounding is the floor; the parts' errors shrink so fast that the tolerance need not be shared out.
    if (depth == 0 || std::abs(whole - halves) <= std::max(tolerance, 1e-14 * std::abs(halves))) {
        return halves;
    }
    return integrate(function, from, middle, tolerance, depth - 1) +
           integrate(function, middle, to, tolerance, depth - 1);
}

/// g of conventions, section 2.
inline double kernel_value(double r, double falloff) {
    return r >= 1.0 ? 0.0 : (std::exp(-falloff * r * r) - std::exp(-falloff)) / (1.0 - std::exp(-falloff));
}

/// Integral of g over the whole chord at distance b from the centre, both in units of the radius.
inline double chord_integral(double b, double falloff) {
    if (b >= 1.0) {
        return 0.0;
    }
    const double h = std::sqrt(1.0 - b * b), root = std::sqrt(falloff);
    return (std::exp(-falloff * b * b) * std::sqrt(pi) / root * std::erf(root * h) - 2.0 * h * std::exp(-falloff)) /
           (1.0 - std::exp(-falloff));
}

/// Slope of log(error) over log(step), least squares.
inline double fitted_order(const std::vector<double>& steps, const std::vector<double>& errors) {
    double sx = 0.0, sy = 0.0, sxx = 0.0, sxy = 0.0;
    for (std::size_t n = 0; n < steps.size(); ++n) {
        const double x = std::log(steps[n]), y = std::log(errors[n]);
        sx += x, sy += y, sxx += x * x, sxy += x * y;
    }
    const double count = static_cast<double>(steps.size());
    return (count * sxy - sx * sy) / (count * sxx - sx * sx);
}

} // namespace sheetsplat::reference::testing

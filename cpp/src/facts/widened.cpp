#include "facts/widened.hpp"

#include <algorithm>
#include <array>
#include <cmath>

namespace sheetsplat {

namespace {

/// R of a QR factorisation of the stacked rows of B^T and diag(d), by Householder reflections: R^T R = B B^T + d^2.
/// columns: 3 columns of 6 numbers. Returns R's rows.
std::array<Vec3, 3> stacked_qr(std::array<std::array<double, 6>, 3> columns) {
    std::array<Vec3, 3> r{Vec3(0.0), Vec3(0.0), Vec3(0.0)};
    for (std::size_t c = 0; c < 3; ++c) {
        double largest = 0.0;
        for (std::size_t i = c; i < 6; ++i) {
            largest = std::max(largest, std::abs(columns[c][i]));
        }
        if (largest == 0.0) {
            continue;
        }
        double squares = 0.0;
        for (std::size_t i = c; i < 6; ++i) {
            const double part = columns[c][i] / largest;
            squares += part * part;
        }
        const double length = largest * std::sqrt(squares);
        const double alpha = columns[c][c] > 0.0 ? -length : length;
        std::array<double, 6> reflector{};
        for (std::size_t i = c; i < 6; ++i) {
            reflector[i] = columns[c][i] / largest;
        }
        reflector[c] -= alpha / largest;
        double norm = 0.0;
        for (std::size_t i = c; i < 6; ++i) {
            norm += reflector[i] * reflector[i];
        }
        for (std::size_t other = c; other < 3; ++other) {
            double dot = 0.0;
            for (std::size_t i = c; i < 6; ++i) {
                dot += reflector[i] * columns[other][i];
            }
            for (std::size_t i = c; i < 6; ++i) {
                columns[other][i] -= 2.0 * dot / norm * reflector[i];
            }
            r[c][static_cast<int>(other)] = columns[other][c];
        }
    }
    return r;
}

double log_volume(const Vec3& axes) { return std::log(axes.x) + std::log(axes.y) + std::log(axes.z); }

} // namespace

WidenedShape widened(const ShapeRows& rows, const Vec3& semi_axes, const FilterWidth& width) {
    if (semi_axes.x == semi_axes.y && semi_axes.y == semi_axes.z) {
        // A sphere turned in its own coordinates is the same sphere.
        const double r = semi_axes.x, across = std::hypot(r, width.across), along = std::hypot(r, width.along);
        return {{Vec3(across, 0.0, 0.0), Vec3(0.0, across, 0.0), Vec3(0.0, 0.0, along)},
                (r / across) * (r / across) * (r / along)};
    }
    std::array<std::array<double, 6>, 3> columns{};
    const std::array<const Vec3*, 3> each{&rows.x, &rows.y, &rows.z};
    const std::array<double, 3> more{width.across, width.across, width.along};
    for (std::size_t axis = 0; axis < 3; ++axis) {
        for (int i = 0; i < 3; ++i) {
            columns[axis][static_cast<std::size_t>(i)] = (*each[axis])[i];
        }
        columns[axis][3 + axis] = more[axis];
    }
    const std::array<Vec3, 3> r = stacked_qr(columns);
    const double amplitude = std::exp(log_volume(semi_axes) - std::log(std::abs(r[0].x)) - std::log(std::abs(r[1].y)) -
                                      std::log(std::abs(r[2].z)));
    // B' = R^T.
    return {{Vec3(r[0].x, 0.0, 0.0), Vec3(r[0].y, r[1].y, 0.0), Vec3(r[0].z, r[1].z, r[2].z)}, amplitude};
}

} // namespace sheetsplat

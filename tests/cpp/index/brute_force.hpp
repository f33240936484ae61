// The field as conventions, section 2 writes it, with all kernels or with some, in float64 and without any index;
// and random fields and transfer functions to try the index on.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <memory>
#include <random>
#include <vector>

#include <glm/geometric.hpp>

#include "index/visible_runs.hpp"
#include "support/lattices.hpp"

namespace sheetsplat::test {

using Mask = std::vector<std::uint8_t>; ///< one entry a sample, in memory order

/// Sums of kernels at a point, or their means over a segment.
struct Sums {
    double values = 0.0, weights = 0.0;
    bool empty = true;
};

class BruteForce {
  public:
    explicit BruteForce(const RegularField& field) : field_(field) {
        const auto& shape = field.shape();
        for (std::size_t k = 0; k < shape[0]; ++k) {
            for (std::size_t j = 0; j < shape[1]; ++j) {
                for (std::size_t i = 0; i < shape[2]; ++i) {
                    centres_.push_back(field.position(i, j, k));
                    values_.push_back(field.value(i, j, k));
                }
            }
        }
    }

    [[nodiscard]] std::size_t size() const { return values_.size(); }
    [[nodiscard]] Vec3 centre(std::size_t n) const { return centres_[n]; }
    [[nodiscard]] double value(std::size_t n) const { return values_[n]; }

    /// drawn: null for all kernels.
    [[nodiscard]] Sums at(const Vec3& x, const Mask* drawn) const {
        const Vec3 axes = field_.kernel_axes().lengths;
        const bool bcc = field_.lattice() == Lattice::bcc;
        const Vec3 step = bcc ? field_.options().spacing.x * Vec3(1.0, 1.0, 0.5) : field_.options().spacing;
        const Vec3 middle = (x - field_.options().origin) / step;
        // Kernels beyond one more sample than the support are only looked at for nothing.
        const Vec3 first = glm::max(Vec3(0.0), glm::ceil(middle - axes / step - 1.0));
        const double falloff = field_.kernel().falloff, edge = std::exp(-falloff);
        const auto& shape = field_.shape();
        const auto end = [&](int axis, std::size_t samples) {
            const double last = std::floor(middle[axis] + axes[axis] / step[axis] + 1.0);
            return last < 0.0 ? std::size_t{0} : std::min(samples, static_cast<std::size_t>(last) + 1);
        };
        Sums sums;
        for (auto k = static_cast<std::size_t>(first.z); k < end(2, shape[0]); ++k) {
            for (auto j = static_cast<std::size_t>(first.y); j < end(1, shape[1]); ++j) {
                for (auto i = static_cast<std::size_t>(first.x); i < end(0, shape[2]); ++i) {
                    const std::size_t n = (k * shape[1] + j) * shape[2] + i;
                    if (std::isnan(values_[n]) || (drawn != nullptr && (*drawn)[n] == 0)) {
                        continue;
                    }
                    const Vec3 q = (x - centres_[n]) / axes;
                    const double square = glm::dot(q, q);
                    if (square < 1.0) {
                        const double g = (std::exp(-falloff * square) - edge) / (1.0 - edge);
                        sums.values += values_[n] * g;
                        sums.weights += g;
                        sums.empty = false;
                    }
                }
            }
        }
        return sums;
    }

    /// Means over the segment from x to x + step; over x alone where the step is 0.
    [[nodiscard]] Sums over(const Vec3& x, const Vec3& step, const Mask* drawn) const {
        constexpr int points = 5;
        if (step == Vec3(0.0)) {
            return at(x, drawn);
        }
        Sums mean;
        for (int n = 0; n < points; ++n) {
            const Sums here = at(x + (n / (points - 1.0)) * step, drawn);
            mean.values += here.values / points;
            mean.weights += here.weights / points;
            mean.empty = mean.empty && here.empty;
        }
        return mean;
    }

    [[nodiscard]] double rho(const Sums& sums) const {
        switch (field_.normalization()) {
        case Normalization::none:
            return sums.values;
        case Normalization::lattice:
            return sums.values / field_.lattice_constant();
        case Normalization::threshold:
            break;
        }
        return sums.values / std::max(field_.w0(), sums.weights);
    }

  private:
    const RegularField& field_;
    std::vector<Vec3> centres_;
    std::vector<double> values_;
};

inline Mask mask_of(const VisibleRuns& runs, const RegularField& field) {
    const std::size_t ni = field.shape()[2];
    Mask mask(field.shape()[0] * field.shape()[1] * ni, 0);
    for (std::size_t row = 0; row < runs.rows(); ++row) {
        for (const Run* run = runs.begin(row); run != runs.end(row); ++run) {
            std::fill(mask.begin() + static_cast<std::ptrdiff_t>(row * ni + run->begin),
                      mask.begin() + static_cast<std::ptrdiff_t>(row * ni + run->end), std::uint8_t{1});
        }
    }
    return mask;
}

inline std::size_t count(const Mask& mask) {
    return static_cast<std::size_t>(std::count(mask.begin(), mask.end(), std::uint8_t{1}));
}

class Random {
  public:
    explicit Random(unsigned seed) : engine_(seed) {}
    double uniform(double low, double high) { return std::uniform_real_distribution<double>(low, high)(engine_); }
    std::size_t whole(std::size_t low, std::size_t high) {
        return std::uniform_int_distribution<std::size_t>(low, high)(engine_);
    }
    bool chance(double probability) { return uniform(0.0, 1.0) < probability; }
    template <typename T>
    T one_of(std::initializer_list<T> choices) {
        return *(choices.begin() + static_cast<std::ptrdiff_t>(whole(0, choices.size() - 1)));
    }
    Vec3 in_cube() { return {uniform(-1.0, 1.0), uniform(-1.0, 1.0), uniform(-1.0, 1.0)}; }
    Vec3 in_ball() {
        for (;;) {
            const Vec3 v = in_cube();
            if (glm::dot(v, v) <= 1.0) {
                return v;
            }
        }
    }

  private:
    std::mt19937 engine_;
};

/// Blobs of both signs, noise, patches of 0; NaN where holes are asked for.
inline std::vector<double> random_values(Random& random, const std::array<std::size_t, 3>& shape, bool holes) {
    const auto size = Vec3(shape[2], shape[1], shape[0]);
    struct Blob {
        Vec3 centre;
        double height, width;
    };
    std::vector<Blob> blobs(random.whole(1, 4));
    const bool negative = random.chance(0.5);
    for (Blob& blob : blobs) {
        blob = {0.5 * (random.in_cube() + 1.0) * size, random.uniform(negative ? -120.0 : 20.0, 120.0),
                random.uniform(1.0, 5.0)};
    }
    const double noise = random.chance(0.5) ? random.uniform(0.0, 20.0) : 0.0;
    const double zero_below = random.chance(0.6) ? random.uniform(0.0, 40.0) : 0.0;
    const double background = random.chance(0.3) ? random.uniform(0.0, 60.0) : 0.0;
    std::vector<double> values;
    for (std::size_t k = 0; k < shape[0]; ++k) {
        for (std::size_t j = 0; j < shape[1]; ++j) {
            for (std::size_t i = 0; i < shape[2]; ++i) {
                double value = background;
                for (const Blob& blob : blobs) {
                    const Vec3 d = (Vec3(i, j, k) - blob.centre) / blob.width;
                    value += blob.height * std::exp(-glm::dot(d, d));
                }
                value += noise > 0.0 ? random.uniform(negative ? -noise : 0.0, noise) : 0.0;
                value = std::abs(value) < zero_below ? 0.0 : value;
                values.push_back(holes && random.chance(0.1) ? std::numeric_limits<double>::quiet_NaN() : value);
            }
        }
    }
    return values;
}

template <typename T>
std::vector<T> rounded(const std::vector<double>& values) {
    std::vector<T> result;
    for (const double value : values) {
        const double low = static_cast<double>(std::numeric_limits<T>::lowest());
        const double high = static_cast<double>(std::numeric_limits<T>::max());
        result.push_back(static_cast<T>(std::clamp(std::round(value), low, high)));
    }
    return result;
}

inline std::shared_ptr<const RegularField> random_field(Random& random, Lattice lattice) {
    const std::array<std::size_t, 3> shape{random.whole(1, 24), random.whole(4, 16), random.whole(4, 20)};
    RegularFieldOptions options = test::zero_boundary();
    options.lattice = lattice;
    options.radius = random.one_of({0.6, 1.0, 1.0, 1.5, 2.0, 2.0, 2.5, 3.5});
    options.falloff = random.one_of({2.0, 5.0, 5.0, 8.0});
    options.normalization = random.one_of({Normalization::none, Normalization::lattice, Normalization::threshold});
    options.w0 = random.one_of({0.3, 1.0, 2.0});
    options.origin = 10.0 * random.in_cube();
    options.spacing = Vec3(random.uniform(0.5, 2.0));
    if (random.chance(0.5)) {
        options.spacing = Vec3(random.uniform(0.3, 3.0), random.uniform(0.3, 3.0), random.uniform(0.3, 3.0));
    }
    const bool holes = random.chance(0.3);
    options.nan = NanPolicy::skip;
    const std::vector<double> values = random_values(random, shape, holes);
    if (holes || random.chance(0.2)) {
        if (random.chance(0.5)) {
            return std::make_shared<RegularField>(values, shape, options);
        }
        return std::make_shared<RegularField>(std::vector<float>(values.begin(), values.end()), shape, options);
    }
    switch (random.whole(0, 2)) {
    case 0:
        return std::make_shared<RegularField>(rounded<std::uint8_t>(values), shape, options);
    case 1:
        return std::make_shared<RegularField>(rounded<std::int16_t>(values), shape, options);
    default:
        return std::make_shared<RegularField>(rounded<std::uint16_t>(values), shape, options);
    }
}

/// Points in and around the range of rho, most of them transparent, some with a step; nearly always transparent at 0.
inline TransferFunction random_transfer_function(Random& random, const RegularField& field) {
    const double scale = field.normalization() == Normalization::none ? field.lattice_constant() : 1.0;
    const double low = std::min(-10.0, 1.3 * scale * field.value_range()[0]);
    const double high = std::max(10.0, 1.3 * scale * field.value_range()[1]);
    for (;;) {
        std::vector<double> values(random.whole(1, 7));
        for (double& value : values) {
            value = random.chance(0.05) ? 0.0 : random.uniform(low, high);
        }
        std::sort(values.begin(), values.end());
        std::vector<TransferPoint> points;
        for (const double value : values) {
            points.push_back({value, Vec3(1.0), random.chance(0.6) ? 0.0 : random.uniform(0.0, 1.0)});
            if (random.chance(0.15)) {
                points.push_back({value, Vec3(1.0), random.chance(0.5) ? 0.0 : random.uniform(0.0, 1.0)});
            }
        }
        TransferFunction result(points);
        if (result.max_opacity() > 0.0 && (result.at(0.0).opacity == 0.0 || random.chance(0.05))) {
            return result;
        }
    }
}

} // namespace sheetsplat::test

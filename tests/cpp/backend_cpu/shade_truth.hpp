// A plain float64 statement of conventions, sections 4 to 7 for one slab: what test_shade compares vectors with.
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include <glm/geometric.hpp>

#include "backend_cpu/shading.hpp"
#include "backend_cpu/tile.hpp"
#include "plan/make_plan.hpp"
#include "support/traps.hpp"

namespace sheetsplat::backend_cpu {

using test::Traps;

class Random {
  public:
    explicit Random(unsigned seed) : engine_(seed) {}
    double uniform(double low, double high) { return std::uniform_real_distribution<double>(low, high)(engine_); }
    int whole(int low, int high) { return std::uniform_int_distribution<int>(low, high)(engine_); }
    bool chance(double p) { return uniform(0.0, 1.0) < p; }

  private:
    std::mt19937 engine_;
};

/// Exactly a float, so that both number formats start from the same.
inline double single(double value) { return static_cast<double>(static_cast<float>(value)); }

// What a picture must be, pixel by pixel ------------------------------------------------------------------------------

using Exact = long double;

struct Looks {
    Vec3 color{0.0};
    double opacity = 0.0;
};

struct Pixel {
    Vec3 color{0.0};
    double alpha = 0.0, scalar = 0.0, depth = std::numeric_limits<double>::infinity(), coverage = 0.0;
};

struct Case {
    Scene scene{{}, TransferFunction({{0.0, Vec3(1.0), 0.0}, {1.0, Vec3(1.0), 1.0}})};
    Camera camera = Camera::orthographic({0.0, 0.0, 5.0}, {0.0, 0.0, 0.0}, {0.0, 1.0, 0.0}, 2.0);
    Frame frame;
    DrawPlan plan;
    TileShape shape;
    std::int64_t n = 0;
    Rect rect;
    std::vector<double> rho[4]; ///< in the sheets' unit, exactly floats
    std::vector<double> weight[2];
    std::vector<Pixel> before; ///< the picture so far, width times height
};

class Truth {
  public:
    explicit Truth(const Case& c) : c_(c) {}

    [[nodiscard]] Pixel pixel(int x, int y) const {
        Pixel p = c_.before[static_cast<std::size_t>(y) * static_cast<std::size_t>(c_.shape.width) +
                            static_cast<std::size_t>(x)];
        if (x < c_.rect.x0 || x >= c_.rect.x1 || y < c_.rect.y0 || y >= c_.rect.y1) {
            return p;
        }
        const double step = c_.frame.slice_spacing * secant(x, y);
        if (c_.plan.coverage && c_.n >= 0) {
            p.coverage += weight(0, x, y) * step;
        }
        if (c_.plan.mode == Mode::xray) {
            p.scalar += value(1, x, y) * step;
        } else if (c_.plan.mode == Mode::mip) {
            p.scalar = weight(0, x, y) == 0.0 ? p.scalar : std::max(p.scalar, value(1, x, y));
        } else if (c_.plan.mode == Mode::isosurface) {
            cross(p, x, y);
        } else {
            composite(p, x, y, step / c_.frame.reference_length);
        }
        return p;
    }
    [[nodiscard]] bool alive(const Pixel& p) const {
        return c_.plan.mode == Mode::isosurface ? p.alpha == 0.0 : p.alpha < stop();
    }
    /// True where rounding may decide whether a pixel ends.
    [[nodiscard]] bool on_the_verge(const Pixel& p, double rounding) const {
        return c_.plan.mode == Mode::composite && std::abs(p.alpha - stop()) < rounding;
    }

  private:
    [[nodiscard]] double stop() const { return c_.plan.stop ? c_.scene.opacity_stop : 1.0; }
    [[nodiscard]] std::size_t at(int x, int y) const {
        return static_cast<std::size_t>(y + 1) * static_cast<std::size_t>(c_.shape.stride) +
               static_cast<std::size_t>(x + 1);
    }
    /// In world units. sheet: 1 is slice n.
    [[nodiscard]] double value(int sheet, int x, int y) const { return c_.rho[sheet][at(x, y)] * c_.plan.value_unit; }
    [[nodiscard]] double weight(int ahead, int x, int y) const { return c_.weight[ahead][at(x, y)]; }
    [[nodiscard]] bool perspective() const { return c_.frame.projection == Projection::perspective; }
    [[nodiscard]] Vec3 slope(int x, int y) const {
        if (!perspective()) {
            return Vec3(0.0);
        }
        return {(c_.shape.x + x + 0.5 - 0.5 * c_.frame.size.width) * c_.frame.pixel,
                (0.5 * c_.frame.size.height - (c_.shape.y + y + 0.5)) * c_.frame.pixel, 0.0};
    }
    [[nodiscard]] double secant(int x, int y) const {
        const Vec3 s = slope(x, y);
        return std::sqrt(1.0 + s.x * s.x + s.y * s.y);
    }
    [[nodiscard]] double depth(int ahead) const { return c_.frame.depth_of(c_.n + ahead); }

    [[nodiscard]] Looks look_up(double v) const {
        const auto& p = c_.scene.transfer_function.points();
        if (v < p.front().value) {
            return {p.front().color, p.front().opacity};
        }
        std::size_t last = 0;
        for (std::size_t n = 0; n < p.size(); ++n) {
            last = p[n].value <= v ? n : last;
        }
        if (last + 1 == p.size()) {
            return {p.back().color, p.back().opacity};
        }
        const double x = (v - p[last].value) / (p[last + 1].value - p[last].value);
        return {p[last].color + x * (p[last + 1].color - p[last].color),
                p[last].opacity + x * (p[last + 1].opacity - p[last].opacity)};
    }

    /// Places and weights of tanh-sinh quadrature on [0, 1].
    static const std::vector<std::pair<Exact, Exact>>& nodes() {
        static const std::vector<std::pair<Exact, Exact>> made = [] {
            constexpr Exact h = 1.0L / 16.0L, half_pi = 1.5707963267948966192L;
            std::vector<std::pair<Exact, Exact>> list;
            for (int k = -56; k <= 56; ++k) {
                const Exact s = std::sinh(k * h) * half_pi;
                list.emplace_back(0.5L + 0.5L * std::tanh(s),
                                  0.5L * h * half_pi * std::cosh(k * h) / (std::cosh(s) * std::cosh(s)));
            }
            return list;
        }();
        return made;
    }

    /// Means of tau l and tau l c over a ramp, by tanh-sinh quadrature between all the places where something bends.
    void ramp(double from, double to, double& mean, Vec3& color) const {
        constexpr double limit = 1.0 - 0x1p-24;
        const auto& p = c_.scene.transfer_function.points();
        std::vector<double> ends{from, to};
        const auto add = [&](double v) {
            if (v > from && v < to) {
                ends.push_back(v);
            }
        };
        for (std::size_t n = 0; n < p.size(); ++n) {
            add(p[n].value);
            if (n > 0 && (p[n].opacity > limit) != (p[n - 1].opacity > limit)) {
                add(p[n - 1].value +
                    (limit - p[n - 1].opacity) / (p[n].opacity - p[n - 1].opacity) * (p[n].value - p[n - 1].value));
            }
        }
        std::sort(ends.begin(), ends.end());
        Exact sum = 0.0L, sums[3] = {0.0L, 0.0L, 0.0L};
        if (from == to) {
            const Looks looks = look_up(from);
            mean = -std::log1p(-std::min(looks.opacity, limit));
            color = mean * looks.color;
            return;
        }
        for (std::size_t n = 0; n + 1 < ends.size(); ++n) {
            const double low = ends[n], high = ends[n + 1];
            if (!(high > low)) {
                continue;
            }
            // The two points around the piece; in extended arithmetic, as 1 - opacity may be small.
            std::size_t after = 0;
            while (after < p.size() && p[after].value <= 0.5 * (low + high)) {
                ++after;
            }
            const TransferPoint& from_point = p[after == 0 ? 0 : after - 1];
            const TransferPoint& to_point = p[std::min(after, p.size() - 1)];
            const Exact width = Exact(to_point.value) - from_point.value;
            for (const auto& [x, weight] : nodes()) {
                const Exact share = weight * (Exact(high) - low) / (Exact(to) - from);
                const Exact place =
                    width > 0.0L ? (low + x * (Exact(high) - low) - from_point.value) / width : Exact(0.0L);
                const auto mix = [&](double a, double b) { return a + place * (Exact(b) - a); };
                const Exact tau =
                    -std::log1p(-std::clamp(mix(from_point.opacity, to_point.opacity), Exact(0.0L), Exact(limit)));
                sum += share * tau;
                for (int channel = 0; channel < 3; ++channel) {
                    sums[channel] += share * tau * mix(from_point.color[channel], to_point.color[channel]);
                }
            }
        }
        mean = static_cast<double>(sum);
        color = {static_cast<double>(sums[0]), static_cast<double>(sums[1]), static_cast<double>(sums[2])};
    }

    [[nodiscard]] Vec3 gradient(int ahead, int x, int y) const {
        const double two = 2.0 * c_.frame.pixel * (perspective() ? depth(ahead) : 1.0);
        const int here = 1 + ahead;
        const double over_x = value(here, x + 1, y) - value(here, x - 1, y);
        const double over_y = value(here, x, y - 1) - value(here, x, y + 1);
        const double dx = over_x == 0.0 ? 0.0 : over_x / two, dy = over_y == 0.0 ? 0.0 : over_y / two;
        const double along = (value(here + 1, x, y) - value(here - 1, x, y)) / (2.0 * c_.frame.slice_spacing);
        const Vec3 s = slope(x, y);
        return {dx, dy, s.x * dx + s.y * dy - along};
    }

    [[nodiscard]] Vec3 shade(const Vec3& color, const Vec3& gradient, int x, int y) const {
        if (!c_.plan.gradient) {
            return color;
        }
        const auto& function = c_.scene.transfer_function;
        const double weakest = 1e-3 * (function.v_max() - function.v_min()) / c_.frame.reference_length;
        const double size = std::hypot(gradient.x, gradient.y, gradient.z);
        const Vec3 normal = size > 0.0 ? -gradient / std::max(size, weakest) : Vec3(0.0);
        const Vec3 s = slope(x, y);
        const Vec3 viewer = glm::normalize(Vec3(-s.x, -s.y, 1.0));
        const Material& m = c_.scene.material;
        Vec3 sum = color * m.ambient;
        for (const Light& light : c_.scene.lights) {
            Vec3 l = glm::normalize(light.direction);
            if (light.space == LightSpace::world) {
                l = {glm::dot(l, c_.camera.right_world()), glm::dot(l, c_.camera.up_world()),
                     glm::dot(l, c_.camera.back_world())};
            }
            Vec3 side = normal;
            if (c_.plan.two_sided && glm::dot(side, l) < 0.0) {
                side = -side;
            }
            const double facing = std::max(0.0, glm::dot(side, l));
            const Vec3 mirrored = 2.0 * facing * side - l;
            const double shine =
                c_.plan.specular ? m.specular * std::pow(std::max(0.0, glm::dot(mirrored, viewer)), m.shininess) : 0.0;
            sum += light.color * facing * (color * m.diffuse + Vec3(shine));
        }
        return sum;
    }

    void composite(Pixel& p, int x, int y, double lengths) const {
        if (p.alpha >= stop()) {
            return;
        }
        const bool front_empty = weight(0, x, y) == 0.0, back_empty = weight(1, x, y) == 0.0;
        if (c_.plan.empty_test && front_empty && (!c_.plan.preintegration || back_empty)) {
            return;
        }
        Looks looks;
        Vec3 slope(0.0);
        if (c_.plan.preintegration) {
            const double a = value(1, x, y), b = value(2, x, y);
            double mean = 0.0;
            ramp(std::min(a, b), std::max(a, b), mean, looks.color);
            if (!(mean > 0.0)) {
                return;
            }
            looks.color /= mean;
            looks.opacity = -std::expm1(-mean * lengths);
            slope = 0.5 * (gradient(0, x, y) + gradient(1, x, y));
        } else {
            looks = look_up(value(1, x, y));
            looks.opacity = -std::expm1(lengths * std::log1p(-looks.opacity));
            slope = gradient(0, x, y);
        }
        if (looks.opacity == 0.0) {
            return;
        }
        const double share = (1.0 - p.alpha) * looks.opacity;
        p.color += share * shade(looks.color, slope, x, y);
        const double old = p.alpha;
        p.alpha += share;
        if (c_.plan.depth && old < 0.5 && p.alpha >= 0.5) {
            // Of an interval its middle, but nothing in front of the first slice (section 7).
            p.depth = c_.plan.preintegration
                          ? std::max(depth(0) + 0.5 * c_.frame.slice_spacing, c_.frame.depth_of(c_.frame.first_met))
                          : depth(0);
        }
    }

    void cross(Pixel& p, int x, int y) const {
        const double iso = c_.scene.iso_values.front().value, a = value(1, x, y), b = value(2, x, y);
        if (p.alpha != 0.0 || (a < iso) == (b < iso)) {
            return;
        }
        const double share = (iso - a) / (b - a);
        const Vec3 slope = (1.0 - share) * gradient(0, x, y) + share * gradient(1, x, y);
        p.color = shade(look_up(iso).color, slope, x, y);
        p.alpha = 1.0;
        p.depth = c_.plan.depth ? depth(0) + share * c_.frame.slice_spacing : p.depth;
    }

    const Case& c_;
};

// What is drawn -------------------------------------------------------------------------------------------------------

} // namespace sheetsplat::backend_cpu

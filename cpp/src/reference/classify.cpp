#include "reference/classify.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

#include <glm/common.hpp>

namespace sheetsplat::reference {

namespace {

// [EKE01] as section 4 has it: extinction stays finite where a = 1.
constexpr double largest_opacity = 1.0 - 0x1p-24;

Vec3 mix(const Vec3& from, const Vec3& to, double x) { return from + (to - from) * x; }
double mix(double from, double to, double x) { return from + (to - from) * x; }

ColorOpacity looks_of(const TransferPoint& point) { return {point.color, point.opacity}; }

// Between two neighbouring points of different value.
ColorOpacity between(const TransferPoint& before, const TransferPoint& after, double value) {
    if (value >= after.value) {
        return looks_of(after);
    }
    const double x = (value - before.value) / (after.value - before.value);
    return {mix(before.color, after.color, x), mix(before.opacity, after.opacity, x)};
}

// Number of the first point whose value is larger.
std::size_t points_up_to(const std::vector<TransferPoint>& points, double value) {
    return static_cast<std::size_t>(std::upper_bound(points.begin(), points.end(), value,
                                                     [](double v, const TransferPoint& p) { return v < p.value; }) -
                                    points.begin());
}

// Moments over x from 0 to 1 of the extinction -ln(1 - a(x)), a linear in x.
struct Moments {
    double zeroth = 0.0; // of -ln(1 - a)
    double first = 0.0;  // of -ln(1 - a) x
};

// Ten points: exact to rounding as long as 1 - a changes by no more than a factor of two (the logarithm's singularity
// is then at least three half-lengths away, and the error falls as 5.8^-20).
Moments moments_by_quadrature(double a0, double a1) {
    constexpr double places[] = {0.14887433898163122, 0.43339539412924719, 0.67940956829902441, 0.86506336668898451,
                                 0.97390652851717172};
    constexpr double weights[] = {0.29552422471475287, 0.26926671930999636, 0.21908636251598204, 0.14945134915058059,
                                  0.06667134430868814};
    Moments moments;
    for (int n = 0; n < 5; ++n) {
        for (const double sign : {-1.0, 1.0}) {
            const double x = 0.5 + 0.5 * sign * places[n];
            const double extinction = -std::log1p(-mix(a0, a1, x));
            moments.zeroth += 0.5 * weights[n] * extinction;
            moments.first += 0.5 * weights[n] * extinction * x;
        }
    }
    return moments;
}

// With y = 1 - a from y0 to y1 and h = y1 - y0:
//   integral of ln y dx   = [y ln y - y] / h
//   integral of x ln y dx = [y^2 / 2 ln y - y^2 / 4 - y0 (y ln y - y)] / h^2
Moments moments_by_closed_form(double y0, double y1) {
    const double h = y1 - y0;
    const auto plain = [](double y) { return y * std::log(y) - y; };
    const auto weighted = [&](double y) { return 0.5 * y * y * std::log(y) - 0.25 * y * y - y0 * plain(y); };
    return {-(plain(y1) - plain(y0)) / h, -(weighted(y1) - weighted(y0)) / (h * h)};
}

Moments moments(double a0, double a1) {
    const double y0 = 1.0 - a0, y1 = 1.0 - a1;
    const bool far_apart = std::max(y0, y1) > 2.0 * std::min(y0, y1);
    return far_apart ? moments_by_closed_form(y0, y1) : moments_by_quadrature(a0, a1);
}

// Means of tau l and tau l c over the ramp (l the reference length).
struct Means {
    double extinction = 0.0;
    Vec3 emission{0.0};

    // A part of the ramp, `share` of its length, over which colour and opacity are linear and the opacity is not
    // limited.
    void add_below_limit(double share, const ColorOpacity& from, const ColorOpacity& to) {
        const Moments part = moments(from.opacity, to.opacity);
        extinction += share * part.zeroth;
        emission += share * (from.color * part.zeroth + (to.color - from.color) * part.first);
    }

    void add_at_limit(double share, const ColorOpacity& from, const ColorOpacity& to) {
        const double largest = -std::log1p(-largest_opacity);
        extinction += share * largest;
        emission += share * largest * 0.5 * (from.color + to.color);
    }

    void add(double share, const ColorOpacity& from, const ColorOpacity& to) {
        const bool from_limited = from.opacity > largest_opacity, to_limited = to.opacity > largest_opacity;
        if (from_limited && to_limited) {
            add_at_limit(share, from, to);
        } else if (!from_limited && !to_limited) {
            add_below_limit(share, from, to);
        } else {
            const double x = (largest_opacity - from.opacity) / (to.opacity - from.opacity);
            const ColorOpacity middle{mix(from.color, to.color, x), largest_opacity};
            if (from_limited) {
                add_at_limit(share * x, from, middle);
                add_below_limit(share * (1.0 - x), middle, to);
            } else {
                add_below_limit(share * x, from, middle);
                add_at_limit(share * (1.0 - x), middle, to);
            }
        }
    }
};

// Means over a ramp from lower to upper, lower < upper; a ramp that falls has the same.
Means means_over(const std::vector<TransferPoint>& points, double lower, double upper) {
    Means means;
    double at = lower;
    for (std::size_t next = points_up_to(points, lower); at < upper; ++next) {
        const double end = next < points.size() ? std::min(upper, points[next].value) : upper;
        if (end > at) {
            const double share = (end - at) / (upper - lower);
            if (next == 0) {
                means.add(share, looks_of(points.front()), looks_of(points.front()));
            } else if (next == points.size()) {
                means.add(share, looks_of(points.back()), looks_of(points.back()));
            } else {
                means.add(share, between(points[next - 1], points[next], at),
                          between(points[next - 1], points[next], end));
            }
        }
        at = end;
    }
    return means;
}

} // namespace

ColorOpacity look_up(const TransferFunction& function, double value) {
    const std::vector<TransferPoint>& points = function.points();
    const std::size_t next = points_up_to(points, value);
    if (next == 0) {
        return looks_of(points.front());
    }
    if (next == points.size()) {
        return looks_of(points.back());
    }
    return between(points[next - 1], points[next], value);
}

double opacity_over(double opacity, double lengths) { return -std::expm1(lengths * std::log1p(-opacity)); }

double extinction_of(double opacity) { return -std::log1p(-std::min(opacity, largest_opacity)); }

void Mixture::add(const Vec3& color, double extinction, double weight) {
    parts_.push_back({color, weight});
    extinction_ += extinction;
    weight_ += weight;
}

double Mixture::opacity() const { return -std::expm1(-extinction_); }

Vec3 Mixture::color() const {
    Vec3 sum(0.0);
    for (const Part& part : parts_) {
        // The share of a single part is exactly 1.
        sum += part.weight / weight_ * part.color;
    }
    return sum;
}

ColorExtinction mean_over_ramp(const TransferFunction& function, double front, double back) {
    Means means;
    if (front == back) {
        const ColorOpacity looks = look_up(function, front);
        means.add(1.0, looks, looks);
    } else {
        means = means_over(function.points(), std::min(front, back), std::max(front, back));
    }
    if (means.extinction <= 0.0) {
        return {};
    }
    return {means.emission / means.extinction, means.extinction};
}

ColorOpacity preintegrate(const TransferFunction& function, double front, double back, double lengths) {
    const ColorExtinction mean = mean_over_ramp(function, front, back);
    return {mean.color, -std::expm1(-lengths * mean.extinction)};
}

ColorOpacity preintegrate_second_order(const TransferFunction& function, const std::array<double, 4>& rho,
                                       double lengths) {
    const double middle = (9.0 * (rho[1] + rho[2]) - rho[0] - rho[3]) / 16.0;
    const ColorOpacity whole = preintegrate(function, rho[1], rho[2], lengths);
    const ColorOpacity front = preintegrate(function, rho[1], middle, 0.5 * lengths);
    const ColorOpacity back = preintegrate(function, middle, rho[2], 0.5 * lengths);

    const double left = (1.0 - front.opacity) * back.opacity;
    const Vec3 of_halves = front.opacity * front.color + left * back.color;
    const double opacity = std::clamp((4.0 * (front.opacity + left) - whole.opacity) / 3.0, 0.0, 1.0);
    if (opacity == 0.0) {
        return {};
    }
    const Vec3 premultiplied = glm::max((4.0 * of_halves - whole.opacity * whole.color) / 3.0, Vec3(0.0));
    return {premultiplied / opacity, opacity};
}

} // namespace sheetsplat::reference

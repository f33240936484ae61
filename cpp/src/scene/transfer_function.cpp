#include "sheetsplat/transfer_function.hpp"

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>

#include "base/checks.hpp"
#include "sheetsplat/error.hpp"

namespace sheetsplat {
namespace {

std::string text_of_point(std::size_t number, const TransferPoint& p) {
    return "point " + text_of_count(number) + " at value " + text_of(p.value) + ", colour " + text_of(p.color) +
           ", opacity " + text_of(p.opacity);
}

/// Linear from a (t = 0) to b (t = 1), never outside the two.
double between(double a, double b, double t) { return std::clamp(a + t * (b - a), std::min(a, b), std::max(a, b)); }

/// Of three and more points at one value only the first (limit from the left) and the last (value and limit from the
/// right) show.
bool shows(const std::vector<TransferPoint>& points, std::size_t n) {
    const bool same_before = n > 0 && points[n - 1].value == points[n].value;
    const bool same_after = n + 1 < points.size() && points[n + 1].value == points[n].value;
    return !(same_before && same_after);
}

} // namespace

TransferFunction::TransferFunction(std::vector<TransferPoint> points) : points_(std::move(points)) {
    if (points_.empty()) {
        throw InvalidInput(Complaint{"TransferFunction: the points cannot be used", "no points", "at least one point",
                                     "give points (value, r, g, b, opacity)"});
    }
    for (std::size_t n = 0; n < points_.size(); ++n) {
        const TransferPoint& p = points_[n];
        if (!is_finite(p.value) || !is_finite(p.color) || !is_finite(p.opacity)) {
            throw InvalidInput(
                Complaint{"TransferFunction: a point cannot be used", text_of_point(n, p), "finite numbers"});
        }
        if (p.opacity < 0.0 || p.opacity > 1.0) {
            throw InvalidInput(Complaint{"TransferFunction: a point cannot be used", text_of_point(n, p),
                                         "an opacity from 0 to 1",
                                         "opacity is per reference length: change " + option_ref("reference_length") +
                                             " to make the volume denser"});
        }
        if (n > 0 && p.value < points_[n - 1].value) {
            throw InvalidInput(Complaint{"TransferFunction: the points are not sorted",
                                         "value " + text_of(p.value) + " of point " + text_of_count(n) +
                                             " after value " + text_of(points_[n - 1].value),
                                         "values that do not decrease", "sort the points by value"});
        }
    }
    if (!is_finite(v_max() - v_min())) {
        throw InvalidInput(Complaint{"TransferFunction: the points cannot be used",
                                     "values from " + text_of(v_min()) + " to " + text_of(v_max()),
                                     "values whose difference is a finite number", "choose another unit"});
    }
}

TransferPoint TransferFunction::at(double value) const {
    const auto after = std::upper_bound(points_.begin(), points_.end(), value,
                                        [](double v, const TransferPoint& point) { return v < point.value; });
    TransferPoint result = after == points_.begin() ? points_.front() : *(after - 1);
    if (after != points_.begin() && after != points_.end()) {
        const TransferPoint& before = *(after - 1);
        const double t = (value - before.value) / (after->value - before.value);
        for (int c = 0; c < 3; ++c) {
            result.color[c] = between(before.color[c], after->color[c], t);
        }
        result.opacity = between(before.opacity, after->opacity, t);
    }
    result.value = value;
    return result;
}

bool TransferFunction::transparent_over(double lower, double upper) const {
    // An interval that makes no sense (NaN, reversed) is no reason to leave anything out.
    if (!(lower <= upper)) {
        return false;
    }
    if ((lower <= v_min() && points_.front().opacity > 0.0) || (upper >= v_max() && points_.back().opacity > 0.0)) {
        return false;
    }
    for (std::size_t n = 0; n + 1 < points_.size(); ++n) {
        const TransferPoint& p = points_[n];
        const TransferPoint& q = points_[n + 1];
        if (p.value == q.value || lower > q.value || upper < p.value) {
            continue;
        }
        // A segment that is only touched at one end counts there with its limit, else it is 0 inside only if 0 at both
        // ends.
        const bool from_p = lower < q.value;
        const bool from_q = upper > p.value;
        const bool inside = from_p && from_q;
        if ((p.opacity > 0.0 && (inside || !from_q)) || (q.opacity > 0.0 && (inside || !from_p))) {
            return false;
        }
    }
    return true;
}

double TransferFunction::max_opacity() const {
    double largest = 0.0;
    for (std::size_t n = 0; n < points_.size(); ++n) {
        if (shows(points_, n)) {
            largest = std::max(largest, points_[n].opacity);
        }
    }
    return largest;
}

bool TransferFunction::has_steps() const {
    for (std::size_t n = 0; n + 1 < points_.size(); ++n) {
        const TransferPoint& p = points_[n];
        const TransferPoint& q = points_[n + 1];
        if (p.value == q.value && (p.color != q.color || p.opacity != q.opacity)) {
            return true;
        }
    }
    return false;
}

double TransferFunction::steepest() const {
    double largest = 0.0;
    for (std::size_t n = 0; n + 1 < points_.size(); ++n) {
        const TransferPoint& p = points_[n];
        const TransferPoint& q = points_[n + 1];
        if (p.value < q.value) {
            double change = std::abs(q.opacity - p.opacity);
            for (int c = 0; c < 3; ++c) {
                change = std::max(change, std::abs(q.color[c] - p.color[c]));
            }
            largest = std::max(largest, change / (q.value - p.value));
        }
    }
    return largest;
}

} // namespace sheetsplat

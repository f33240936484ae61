#include "backend_cpu/transfer_table.hpp"
#include "backend_cpu/measured.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>

#include "backend_cpu/number.hpp"

namespace sheetsplat::backend_cpu {

namespace {

/// Least 1 - a in pre-integration (section 4; [EKE01]).
constexpr double clearest = 0x1p-24;

/// Slopes and scales: so small that products with differences of rho stay finite.
template <class T>
T factor(double value) {
    const double largest = std::sqrt(static_cast<double>(std::numeric_limits<T>::max())) * 1e10;
    return static_cast<T>(std::clamp(value, -largest, largest));
}

/// Points with values in the sheets' unit, as the number format has them.
template <class T>
std::vector<TransferPoint> points_in(const TransferFunction& function, double value_unit) {
    std::vector<TransferPoint> points = function.points();
    for (TransferPoint& point : points) {
        point.value = static_cast<double>(number<T>(point.value / value_unit));
    }
    return points;
}

template <class T>
struct Stretch {
    TransferPoint from, to; ///< linear from one to the other
    bool constant = false;  ///< colour and opacity of `from`
};

/// As TransferTable describes them.
template <class T>
std::vector<Stretch<T>> stretches_of(const std::vector<TransferPoint>& points) {
    std::vector<Stretch<T>> stretches;
    TransferPoint end = points.back();
    end.value = std::numeric_limits<double>::infinity();
    if (points.size() > 1 && points[1].value == points[0].value) {
        // A step at the first value: smaller values have the first point's colour and opacity.
        stretches.push_back({points[0], points[0], true});
    }
    for (std::size_t n = 0; n + 1 < points.size(); ++n) {
        if (points[n + 1].value > points[n].value) {
            stretches.push_back({points[n], points[n + 1], false});
        }
    }
    stretches.push_back({points.back(), end, true});
    return stretches;
}

template <class T>
void find_limits(const std::vector<Stretch<T>>& stretches, TransferTable<T>& table) {
    constexpr T infinity = std::numeric_limits<T>::infinity();
    const auto clear = [](const Stretch<T>& s) { return s.from.opacity == 0.0 && (s.constant || s.to.opacity == 0.0); };
    table.below = infinity;
    table.above = -infinity;
    for (std::size_t n = 0; n < stretches.size(); ++n) {
        if (!clear(stretches[n])) {
            const T start = static_cast<T>(stretches[n].from.value);
            table.below = stretches[n].from.opacity == 0.0 ? start
                          : n == 0                         ? -infinity
                                                           : std::nextafter(start, -infinity);
            break;
        }
    }
    for (std::size_t n = stretches.size(); n-- > 0;) {
        if (!clear(stretches[n])) {
            table.above = static_cast<T>(stretches[n].to.value);
            break;
        }
    }
}

/// starts: of all stretches; the first one's does not count, since it holds for all smaller values.
template <class T>
Cells<T> make_cells(const std::vector<T>& starts, int record) {
    Cells<T> made;
    const std::size_t count = std::min(most_cells, cells_per_stretch * starts.size());
    made.first = starts.size() > 1 ? starts[1] : T(0);
    made.last = starts.size() > 1 ? starts.back() : T(0);
    made.last_cell = static_cast<T>(count - 1);
    // A little fewer than `count` over the whole range: the starts of evenly spaced stretches then lie at the very end
    // of the cell before, and the search almost never goes on from where it begins.
    const double margin = 8.0 * static_cast<double>(std::numeric_limits<T>::epsilon());
    const double span = static_cast<double>(made.last) - static_cast<double>(made.first);
    made.per_unit = span > 0.0 ? factor<T>(static_cast<double>(count) / span * (1.0 - margin)) : T(0);
    made.records.assign(count, 0);
    // Values of a cell may be smaller than a start that lies in it, never than one that lies in a cell before.
    std::size_t cell = 0;
    for (std::size_t n = 1; n < starts.size(); ++n) {
        const T place = (std::clamp(starts[n], made.first, made.last) - made.first) * made.per_unit;
        const auto start = static_cast<std::size_t>(std::min(place, made.last_cell));
        for (; cell <= start; ++cell) {
            made.records[cell] = static_cast<std::int32_t>(n - 1) * record;
        }
    }
    made.records.resize(cell);
    made.records.resize(count + 1, static_cast<std::int32_t>(starts.size() - 1) * record);
    return made;
}

template <class T>
RampStretch<T> ramp(double from, double to, const TransferPoint& first, const TransferPoint& last, bool constant) {
    RampStretch<T> r;
    r.from = number<T>(from);
    r.to = number<T>(to);
    const double width = static_cast<double>(r.to) - static_cast<double>(r.from);
    r.per_width = constant || !(width > 0.0) ? T(0) : factor<T>(1.0 / width);
    r.opacity = static_cast<T>(std::min(first.opacity, 1.0 - clearest));
    r.clearness = static_cast<T>(std::max(1.0 - first.opacity, clearest));
    if (!constant) {
        r.opacity_step = static_cast<T>(std::min(last.opacity, 1.0 - clearest)) - r.opacity;
        r.clearness_step = static_cast<T>(std::max(1.0 - last.opacity, clearest)) - r.clearness;
    }
    for (int c = 0; c < 3; ++c) {
        r.color[c] = number<T>(first.color[c]);
        r.color_step[c] = constant ? T(0) : number<T>(last.color[c] - first.color[c]);
    }
    return r;
}

/// The whole axis. Where opacity passes the largest one that is allowed a stretch ends, so that it stays linear.
template <class T>
std::vector<RampStretch<T>> ramps_of(const std::vector<TransferPoint>& points) {
    constexpr auto largest = static_cast<double>(std::numeric_limits<T>::max());
    constexpr double limit = 1.0 - clearest;
    std::vector<RampStretch<T>> ramps;
    ramps.push_back(ramp<T>(-largest, points.front().value, points.front(), points.front(), true));
    for (std::size_t n = 0; n + 1 < points.size(); ++n) {
        const TransferPoint& p = points[n];
        const TransferPoint& q = points[n + 1];
        if (!(q.value > p.value)) {
            continue;
        }
        if ((p.opacity > limit) != (q.opacity > limit)) {
            const double x = (limit - p.opacity) / (q.opacity - p.opacity);
            const TransferPoint middle{p.value + x * (q.value - p.value), p.color + (q.color - p.color) * x, limit};
            ramps.push_back(ramp<T>(p.value, middle.value, p, middle, false));
            ramps.push_back(ramp<T>(middle.value, q.value, middle, q, false));
        } else {
            ramps.push_back(ramp<T>(p.value, q.value, p, q, false));
        }
    }
    ramps.push_back(ramp<T>(points.back().value, largest, points.back(), points.back(), true));
    return ramps;
}

/// Cuts a stretch where 1 - opacity has changed by most_change, as evenly as the number format allows.
template <class T>
void cut(const RampStretch<T>& whole, std::vector<RampStretch<T>>& pieces) {
    const double from = static_cast<double>(whole.from), width = static_cast<double>(whole.to) - from;
    const double clear = static_cast<double>(whole.clearness), step = static_cast<double>(whole.clearness_step);
    const auto looks_at = [&](double value) {
        const double x = (value - from) / width;
        TransferPoint point;
        point.value = value;
        // Near 0 opacity has the digits, near 1 what it leaves.
        const double opacity = static_cast<double>(whole.opacity) + x * static_cast<double>(whole.opacity_step);
        point.opacity = opacity < 0.5 ? opacity : 1.0 - (clear + x * step);
        for (int c = 0; c < 3; ++c) {
            point.color[c] = static_cast<double>(whole.color[c]) + x * static_cast<double>(whole.color_step[c]);
        }
        return point;
    };
    const double change = std::log((clear + step) / clear);
    const auto count = static_cast<int>(std::ceil(std::abs(change) / std::log(most_change<T>)));
    TransferPoint before = looks_at(from);
    for (int n = 1; n <= count; ++n) {
        const double share = clear * std::expm1(change * n / count) / step;
        const auto end = n < count ? static_cast<T>(from + std::clamp(share, 0.0, 1.0) * width) : whole.to;
        if (static_cast<double>(end) > before.value) {
            const TransferPoint after = looks_at(static_cast<double>(end));
            pieces.push_back(ramp<T>(before.value, after.value, before, after, false));
            before = after;
        }
    }
}

template <class T>
std::vector<RampStretch<T>> cut_all(const std::vector<RampStretch<T>>& stretches) {
    std::vector<RampStretch<T>> pieces;
    for (const RampStretch<T>& s : stretches) {
        const double from = static_cast<double>(s.clearness), to = from + static_cast<double>(s.clearness_step);
        if (std::max(from, to) > most_change<T> * std::min(from, to)) {
            cut(s, pieces);
        } else {
            pieces.push_back(s);
        }
    }
    return pieces;
}

/// -ln(1 - opacity) over a stretch, as a polynomial of the share x of its width: by interpolation at the ends and at
/// Chebyshev's points between them.
template <int degree>
struct AbsorptionTerms {
    long double term[degree + 1] = {};

    template <class T>
    explicit AbsorptionTerms(const RampStretch<T>& s) {
        const auto at = [&](long double x) {
            const long double opacity =
                static_cast<long double>(s.opacity) + x * static_cast<long double>(s.opacity_step);
            const long double clear =
                static_cast<long double>(s.clearness) + x * static_cast<long double>(s.clearness_step);
            return opacity < 0.5L ? -std::log1p(-opacity) : -std::log(clear);
        };
        long double x[degree + 1], difference[degree + 1];
        for (int n = 0; n <= degree; ++n) {
            x[n] = 0.5L - 0.5L * std::cos(3.14159265358979323846L * static_cast<long double>(n) / degree);
            difference[n] = at(x[n]);
        }
        // Newton's divided differences, then Horner's scheme over polynomials.
        for (int order = 1; order <= degree; ++order) {
            for (int n = degree; n >= order; --n) {
                difference[n] = (difference[n] - difference[n - 1]) / (x[n] - x[n - order]);
            }
        }
        for (int n = degree; n >= 0; --n) {
            for (int power = degree; power > 0; --power) {
                term[power] = term[power - 1] - x[n] * term[power];
            }
            term[0] = difference[n] - x[n] * term[0];
        }
    }

    /// The mean of the polynomial times x^power over the stretch.
    [[nodiscard]] long double mean(int power) const {
        long double sum = 0.0L;
        for (int n = 0; n <= degree; ++n) {
            sum += term[n] / static_cast<long double>(n + 1 + power);
        }
        return sum;
    }
};

} // namespace

template <class T>
TransferTable<T> make_transfer_table(const TransferFunction& function, double value_unit) {
    constexpr int record = TransferTable<T>::record;
    const std::vector<Stretch<T>> stretches = stretches_of<T>(points_in<T>(function, value_unit));
    TransferTable<T> table;
    table.stretches = static_cast<int>(stretches.size());
    table.records.assign(stretches.size() * record, T(0));
    for (std::size_t n = 0; n < stretches.size(); ++n) {
        const Stretch<T>& s = stretches[n];
        const double width = s.to.value - s.from.value;
        const auto slope = [&](double from, double to) { return s.constant ? T(0) : factor<T>((to - from) / width); };
        T* out = table.records.data() + n * record;
        out[0] = static_cast<T>(s.from.value);
        out[1] = static_cast<T>(s.to.value);
        out[2] = static_cast<T>(s.from.opacity);
        out[3] = slope(s.from.opacity, s.to.opacity);
        for (int c = 0; c < 3; ++c) {
            out[4 + 2 * c] = number<T>(s.from.color[c]);
            out[5 + 2 * c] = slope(s.from.color[c], s.to.color[c]);
        }
        for (std::size_t k = 0; k < TransferTable<T>::numbers && n < TransferTable<T>::most_in_lanes; ++k) {
            table.lanes[k][n] = out[k];
        }
    }
    find_limits(stretches, table);
    std::vector<T> starts;
    for (const Stretch<T>& s : stretches) {
        starts.push_back(static_cast<T>(s.from.value));
    }
    table.cells = make_cells(starts, record);
    return table;
}

template <class T>
RampTable<T> make_ramp_table(const TransferFunction& function, double value_unit) {
    RampTable<T> table;
    table.stretches = ramps_of<T>(points_in<T>(function, value_unit));
    if (table.stretches.size() <= most_stretches_to_walk) {
        return table;
    }
    table.stretches = cut_all(table.stretches);
    constexpr auto record = static_cast<std::size_t>(RampTable<T>::record);
    const std::size_t count = table.stretches.size();
    table.records.assign((count + 1) * record, T(0));
    std::vector<T> starts;
    long double sums[4] = {};
    for (std::size_t n = 0; n < count; ++n) {
        const RampStretch<T>& s = table.stretches[n];
        starts.push_back(s.from);
        T* out = table.records.data() + n * record;
        const T numbers[] = {s.from,          s.to,       s.per_width,     s.color[2],     s.color[0],
                             s.color_step[0], s.color[1], s.color_step[1], s.color_step[2]};
        std::copy(std::begin(numbers), std::end(numbers), out);
        const AbsorptionTerms<RampTable<T>::degree> absorption(s);
        for (int power = 0; power <= RampTable<T>::degree; ++power) {
            out[RampTable<T>::first_term + power] =
                static_cast<T>(absorption.term[power] / static_cast<long double>(power + 1));
        }
        for (std::size_t k = 0; k < 4; ++k) {
            T* integral = out + RampTable<T>::first_integral + 2 * k;
            integral[0] = static_cast<T>(sums[k]);
            integral[1] = static_cast<T>(sums[k] - static_cast<long double>(integral[0]));
        }
        // The outermost stretches have no end: no ramp goes all through them.
        if (n > 0 && n + 1 < count) {
            const long double width = static_cast<long double>(s.to) - static_cast<long double>(s.from);
            const long double plain = absorption.mean(0), weighted = absorption.mean(1);
            sums[0] += width * plain;
            for (std::size_t c = 0; c < 3; ++c) {
                sums[c + 1] += width * (static_cast<long double>(s.color[c]) * plain +
                                        static_cast<long double>(s.color_step[c]) * weighted);
            }
        }
    }
    table.cells = make_cells(starts, RampTable<T>::record);
    return table;
}

template TransferTable<float> make_transfer_table<float>(const TransferFunction&, double);
template TransferTable<double> make_transfer_table<double>(const TransferFunction&, double);
template RampTable<float> make_ramp_table<float>(const TransferFunction&, double);
template RampTable<double> make_ramp_table<double>(const TransferFunction&, double);

} // namespace sheetsplat::backend_cpu

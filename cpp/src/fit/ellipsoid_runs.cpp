#include "ellipsoid_runs.hpp"

#include <algorithm>
#include <cstdint>
#include <type_traits>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "ellipsoid_runs.cpp"
#include "hwy/foreach_target.h"
// (foreach_target includes this file once for each set, ahead of the others.)
#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace sheetsplat::fitting::HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;
using D = hn::ScalableTag<double>;
using V = hn::Vec<D>;

/// 2^y for -1000 <= y <= 0: y's whole part as exponent, and a polynomial (2^t - 1) / t of the rest (interpolation at
/// Chebyshev nodes, error below 1e-17).
HWY_INLINE V power_of_two(D d, V y) {
    constexpr double series[] = {0.693147180559945309,   0.240226506959100982,   0.0555041086648215943,
                                 0.00961812910760688853, 0.00133335581464169353, 0.000154035304417360502,
                                 1.52527338298361184e-5, 1.32154425879216897e-6, 1.01780624458457735e-7,
                                 7.0725859492692237e-9,  4.45496059818651839e-10};
    const hn::RebindToSigned<D> di;
    // Adding 1.5 2^52 rounds to an integer, in the low bits.
    const V magic = hn::Set(d, 6755399441055744.0);
    const V moved = hn::Add(y, magic);
    const V t = hn::Sub(y, hn::Sub(moved, magic));
    V sum = hn::Set(d, series[10]);
    for (int n = 9; n >= 0; --n) {
        sum = hn::MulAdd(sum, t, hn::Set(d, series[n]));
    }
    const V factor = hn::MulAdd(sum, t, hn::Set(d, 1.0));
    return hn::BitCast(d, hn::Add(hn::BitCast(di, factor), hn::ShiftLeft<52>(hn::BitCast(di, moved))));
}

/// Samples side by side, and the first one's place in the kernel's space.
struct Run {
    std::size_t first = 0, count = 0;
    double q0 = 0.0, q1 = 0.0, q2 = 0.0; ///< of samples of a lattice, along whose rows q1 and q2 do not change
};

/// The indices from `low` to `high`, within `first` to `last` - 1.
struct Span {
    std::size_t begin, end;
    Span(double low, double high, std::size_t first, std::size_t last) : begin(first), end(first) {
        const auto f = static_cast<double>(first), l = static_cast<double>(last);
        // (Comparisons that are false for NaN.)
        if (low < l && high >= f) {
            begin = static_cast<std::size_t>(std::ceil(std::max(low, f)));
            end = static_cast<std::size_t>(std::floor(std::min(high, l - 1.0))) + 1;
        }
    }
};

/// The samples from index `first` to `last` - 1 of a row of a lattice that the kernel reaches.
HWY_INLINE Run run_in_row(const LatticePlaces& places, const FreeEllipsoid& kernel, std::size_t k, std::size_t j,
                          std::size_t first, std::size_t last) {
    const auto& [xx, yy, zz, xy, xz, yz] = kernel.frame;
    const Vec3& c = kernel.center;
    const double dz = static_cast<double>(k) - c.z, dy = static_cast<double>(j) - c.y;
    const double q2 = zz * dz, q1 = yy * dy + yz * dz, shift = xy * dy + xz * dz;
    const double reach = std::sqrt(std::max(0.0, 1.0 - q2 * q2 - q1 * q1));
    const Span span(c.x + (-reach - shift) / xx, c.x + (reach - shift) / xx, first, last);
    return {places.begin(k, j) + span.begin, span.begin < span.end ? span.end - span.begin : 0,
            xx * (static_cast<double>(span.begin) - c.x) + shift, q1, q2};
}

/// act(k, j) for every row of samples in a tile that the kernel may reach.
template <class Act>
HWY_INLINE void each_row(const FreeEllipsoid& kernel, const Tile& tile, Act&& act) {
    const auto& [xx, yy, zz, xy, xz, yz] = kernel.frame;
    const Vec3& c = kernel.center;
    const Span layers(c.z - 1.0 / zz, c.z + 1.0 / zz, tile.k0, tile.k1);
    for (std::size_t k = layers.begin; k < layers.end; ++k) {
        const double dz = static_cast<double>(k) - c.z, q2 = zz * dz;
        const double reach = std::sqrt(std::max(0.0, 1.0 - q2 * q2)), shift = yz * dz;
        const Span rows(c.y + (-reach - shift) / yy, c.y + (reach - shift) / yy, tile.j0, tile.j1);
        for (std::size_t j = rows.begin; j < rows.end; ++j) {
            act(k, j);
        }
    }
}

/// act(run) for every row of samples in a tile that the kernel reaches, without those that it does not reach.
template <class Act>
HWY_INLINE void each_run(const LatticePlaces& places, const FreeEllipsoid& kernel, const Tile& tile, Act&& act) {
    each_row(kernel, tile, [&](std::size_t k, std::size_t j) {
        const Run run = run_in_row(places, kernel, k, j, 0, places.columns);
        if (run.count > 0) {
            act(run);
        }
    });
}

/// Half the sides of the box around a kernel.
HWY_INLINE Vec3 half_sides(const FreeEllipsoid& kernel) {
    const auto& [xx, yy, zz, xy, xz, yz] = kernel.frame;
    // The rows of U^-1.
    const double z = 1.0 / zz, y = 1.0 / yy, x = 1.0 / xx;
    const double y_z = -yz * y * z, x_y = -xy * x * y, x_z = (xy * yz * y - xz) * x * z;
    return {std::sqrt(x * x + x_y * x_y + x_z * x_z), std::sqrt(y * y + y_z * y_z), z};
}

/// act(first, others) for every row that both kernels reach: runs of the samples that both reach.
template <class Act>
HWY_INLINE void each_common_run(const LatticePlaces& places, const FreeEllipsoid& first, const FreeEllipsoid& other,
                                Act&& act) {
    const Vec3 half = half_sides(other);
    const Vec3& c = other.center;
    const Span layers(c.z - half.z, c.z + half.z, 0, places.layers), rows(c.y - half.y, c.y + half.y, 0, places.rows);
    each_row(first, Tile{layers.begin, layers.end, rows.begin, rows.end}, [&](std::size_t k, std::size_t j) {
        const std::size_t row = places.begin(k, j);
        const Run widest = run_in_row(places, first, k, j, 0, places.columns);
        const std::size_t begin = widest.first - row;
        const Run of_other = run_in_row(places, other, k, j, begin, begin + widest.count);
        if (of_other.count > 0) {
            const std::size_t from = of_other.first - row;
            act(run_in_row(places, first, k, j, from, from + of_other.count), of_other);
        }
    });
}

/// act(run) for the points of every row of cells in a tile that the box around the kernel reaches.
template <class Act>
HWY_INLINE void each_run(const ScatteredPlaces& places, const FreeEllipsoid& kernel, const Tile& tile, Act&& act) {
    const Vec3 half = half_sides(kernel);
    const auto span = [&](int axis, std::size_t first, std::size_t last) {
        const auto a = static_cast<std::size_t>(axis);
        const double from = kernel.center[axis] - half[axis] - places.origin[a];
        return Span(std::floor(from / places.cell[a]), (from + 2.0 * half[axis]) / places.cell[a], first, last);
    };
    const Span layers = span(2, tile.k0, tile.k1), rows = span(1, tile.j0, tile.j1), cells = span(0, 0, places.columns);
    for (std::size_t k = layers.begin; k < layers.end; ++k) {
        for (std::size_t j = rows.begin; j < rows.end && cells.begin < cells.end; ++j) {
            const std::size_t row = (k * places.rows + j) * places.columns;
            const std::size_t first = places.starts[row + cells.begin], end = places.starts[row + cells.end];
            if (first < end) {
                act(Run{first, end - first});
            }
        }
    }
}

template <class Act>
HWY_INLINE void each_common_run(const ScatteredPlaces& places, const FreeEllipsoid& first,
                                const FreeEllipsoid& /*other*/, Act&& act) {
    each_run(places, first, Tile{0, places.layers, 0, places.rows}, [&](const Run& run) { act(run, run); });
}

/// Places in the kernel's space, exp(-k r^2) there, and which of them are within the support.
struct Here {
    V q0, q1, q2, e;
    hn::Mask<D> inside;
};

/// Passes the samples of a run, vector by vector.
class LatticeWalk {
  public:
    static constexpr bool along_row = true;
    LatticeWalk(D d, const LatticePlaces& /*places*/, const Profile& profile, const FreeEllipsoid& kernel)
        : rate_(-profile.falloff * 1.4426950408889634), sample_(kernel.frame[0]),
          vector_(kernel.frame[0] * static_cast<double>(hn::Lanes(d))),
          lanes_(hn::Mul(hn::Iota(d, 0.0), hn::Set(d, kernel.frame[0]))),
          per_lane_(power(d, hn::Mul(lanes_, hn::Set(d, 2.0 * rate_ * vector_)))),
          per_step_(power(d, hn::Set(d, 2.0 * rate_ * vector_ * vector_))), q0_(lanes_), e_(lanes_), ratio_(lanes_) {}

    HWY_INLINE Here at(D d, const Run& run, std::size_t n) {
        if (n % (hn::Lanes(d) * steps) == 0) {
            const double first = run.q0 + static_cast<double>(n) * sample_;
            q0_ = hn::Add(hn::Set(d, first), lanes_);
            const V r2 = hn::MulAdd(q0_, q0_, hn::Set(d, run.q1 * run.q1 + run.q2 * run.q2));
            e_ = power(d, hn::Mul(r2, hn::Set(d, rate_)));
            if (run.count - n > hn::Lanes(d)) {
                ratio_ = hn::Mul(per_lane_, power(d, hn::Set(d, rate_ * vector_ * (2.0 * first + vector_))));
            }
        } else {
            // exp(-k (q + h)^2) = exp(-k q^2) exp(-k (2 q h + h^2)), and so on for the second factor.
            q0_ = hn::Add(q0_, hn::Set(d, vector_));
            e_ = hn::Mul(e_, ratio_);
            ratio_ = hn::Mul(ratio_, per_step_);
        }
        // (Runs end where the support does.)
        return {q0_, hn::Set(d, run.q1), hn::Set(d, run.q2), e_, hn::FirstN(d, run.count - n)};
    }

  private:
    /// Vectors until the exponential is computed again, so that the error of the products stays below 1e-13.
    static constexpr std::size_t steps = 16;
    static HWY_INLINE V power(D d, V y) { return power_of_two(d, hn::Max(y, hn::Set(d, -1000.0))); }
    double rate_, sample_, vector_;
    V lanes_, per_lane_, per_step_, q0_, e_, ratio_;
};

class ScatteredWalk {
  public:
    static constexpr bool along_row = false;
    ScatteredWalk(D /*d*/, const ScatteredPlaces& places, const Profile& profile, const FreeEllipsoid& kernel)
        : rate_(-profile.falloff * 1.4426950408889634), places_(places), kernel_(kernel) {}
    HWY_INLINE Here at(D d, const Run& run, std::size_t n) {
        const auto& [xx, yy, zz, xy, xz, yz] = kernel_.frame;
        const std::size_t i = run.first + n;
        const V dx = hn::Sub(hn::LoadU(d, places_.at[0].data() + i), hn::Set(d, kernel_.center.x));
        const V dy = hn::Sub(hn::LoadU(d, places_.at[1].data() + i), hn::Set(d, kernel_.center.y));
        const V dz = hn::Sub(hn::LoadU(d, places_.at[2].data() + i), hn::Set(d, kernel_.center.z));
        const V q0 = hn::MulAdd(hn::Set(d, xx), dx, hn::MulAdd(hn::Set(d, xy), dy, hn::Mul(hn::Set(d, xz), dz)));
        const V q1 = hn::MulAdd(hn::Set(d, yy), dy, hn::Mul(hn::Set(d, yz), dz));
        const V q2 = hn::Mul(hn::Set(d, zz), dz);
        const V r2 = hn::MulAdd(q0, q0, hn::MulAdd(q1, q1, hn::Mul(q2, q2)));
        const V e = power_of_two(d, hn::Max(hn::Mul(r2, hn::Set(d, rate_)), hn::Set(d, -1000.0)));
        return {q0, q1, q2, e, hn::And(hn::Lt(r2, hn::Set(d, 1.0)), hn::FirstN(d, run.count - n))};
    }

  private:
    double rate_;
    const ScatteredPlaces& places_;
    const FreeEllipsoid& kernel_;
};

template <class Places>
using Walk = std::conditional_t<std::is_same_v<Places, LatticePlaces>, LatticeWalk, ScatteredWalk>;

/// A quadratic polynomial of q with the coefficients of 1, q, q q.
struct Quadratic {
    double one, q0, q1, q2, q00, q11, q22, q01, q02, q12;
};

template <class Places>
HWY_NOINLINE void add(const Places& places, const Profile& profile, const FreeEllipsoid& kernel,
                      const EllipsoidChange& change, const Tile& tile, double* out) {
    const D d;
    Walk<Places> walk(d, places, profile, kernel);
    const double slope = 2.0 * profile.falloff * profile.gain * kernel.value;
    const Vec3& t = change.center;
    const auto& [xx, yy, zz, xy, xz, yz] = change.frame;
    // The change is exp(-k r^2) times this, less what the edge takes.
    const Quadratic p{change.value * profile.gain,
                      slope * t.x,
                      slope * t.y,
                      slope * t.z,
                      -slope * xx,
                      -slope * yy,
                      -slope * zz,
                      -slope * xy,
                      -slope * xz,
                      -slope * yz};
    const V edge = hn::Set(d, change.value * profile.gain * profile.edge);
    each_run(places, kernel, tile, [&](const Run& run) {
        const double one = p.one + p.q1 * run.q1 + p.q2 * run.q2 + p.q11 * run.q1 * run.q1 + p.q22 * run.q2 * run.q2 +
                           p.q12 * run.q1 * run.q2;
        const V row_0 = hn::Set(d, one), row_1 = hn::Set(d, p.q0 + p.q01 * run.q1 + p.q02 * run.q2);
        const V row_2 = hn::Set(d, p.q00);
        double* const to = out + run.first;
        for (std::size_t n = 0; n < run.count; n += hn::Lanes(d)) {
            const Here q = walk.at(d, run, n);
            V factor;
            if constexpr (Walk<Places>::along_row) {
                factor = hn::MulAdd(hn::MulAdd(row_2, q.q0, row_1), q.q0, row_0);
            } else {
                const V of_0 = hn::MulAdd(
                    hn::Set(d, p.q00), q.q0,
                    hn::MulAdd(hn::Set(d, p.q01), q.q1, hn::MulAdd(hn::Set(d, p.q02), q.q2, hn::Set(d, p.q0))));
                const V of_1 =
                    hn::MulAdd(hn::Set(d, p.q11), q.q1, hn::MulAdd(hn::Set(d, p.q12), q.q2, hn::Set(d, p.q1)));
                const V of_2 = hn::MulAdd(hn::Set(d, p.q22), q.q2, hn::Set(d, p.q2));
                factor = hn::MulAdd(of_0, q.q0, hn::MulAdd(of_1, q.q1, hn::MulAdd(of_2, q.q2, hn::Set(d, p.one))));
            }
            const V part = hn::IfThenElseZero(q.inside, hn::MulSub(q.e, factor, edge));
            if (n + hn::Lanes(d) <= run.count) {
                hn::StoreU(hn::Add(hn::LoadU(d, to + n), part), d, to + n);
            } else {
                HWY_ALIGN double numbers[hn::MaxLanes(D())];
                hn::Store(part, d, numbers);
                for (std::size_t m = n; m < run.count; ++m) {
                    to[m] += numbers[m - n];
                }
            }
        }
    });
}

HWY_INLINE double total(D d, V sum) { return hn::GetLane(hn::SumOfLanes(d, sum)); }

template <class Places>
HWY_NOINLINE EllipsoidChange project(const Places& places, const Profile& profile, const FreeEllipsoid& kernel,
                                     const double* field) {
    const D d;
    Walk<Places> walk(d, places, profile, kernel);
    const V gain = hn::Set(d, profile.gain), edge = hn::Set(d, profile.edge * profile.gain);
    const V zero = hn::Zero(d);
    // Of field times exp(-k r^2): times q, times q q; of field times g.
    V of_g = zero, of_q[3] = {zero, zero, zero}, of_qq[6] = {zero, zero, zero, zero, zero, zero};
    each_run(places, kernel, Tile{0, places.layers, 0, places.rows}, [&](const Run& run) {
        V one = zero, first = zero, second = zero;
        for (std::size_t n = 0; n < run.count; n += hn::Lanes(d)) {
            const Here q = walk.at(d, run, n);
            const auto mask = q.inside;
            const V weight = hn::IfThenElseZero(mask, hn::LoadU(d, field + run.first + n));
            const V e = q.e;
            of_g = hn::MulAdd(weight, hn::MulSub(e, gain, edge), of_g);
            const V part = hn::Mul(weight, e);
            const V part_0 = hn::Mul(part, q.q0);
            if constexpr (Walk<Places>::along_row) {
                one = hn::Add(one, part);
                first = hn::Add(first, part_0);
                second = hn::MulAdd(part_0, q.q0, second);
            } else {
                const V part_1 = hn::Mul(part, q.q1), part_2 = hn::Mul(part, q.q2);
                of_q[0] = hn::Add(of_q[0], part_0);
                of_q[1] = hn::Add(of_q[1], part_1);
                of_q[2] = hn::Add(of_q[2], part_2);
                of_qq[0] = hn::MulAdd(part_0, q.q0, of_qq[0]);
                of_qq[1] = hn::MulAdd(part_1, q.q1, of_qq[1]);
                of_qq[2] = hn::MulAdd(part_2, q.q2, of_qq[2]);
                of_qq[3] = hn::MulAdd(part_0, q.q1, of_qq[3]);
                of_qq[4] = hn::MulAdd(part_0, q.q2, of_qq[4]);
                of_qq[5] = hn::MulAdd(part_1, q.q2, of_qq[5]);
            }
        }
        if constexpr (Walk<Places>::along_row) {
            const double q1 = run.q1, q2 = run.q2;
            const auto add_to = [&](V& sum, V part, double factor) { sum = hn::MulAdd(part, hn::Set(d, factor), sum); };
            add_to(of_q[0], first, 1.0);
            add_to(of_q[1], one, q1);
            add_to(of_q[2], one, q2);
            add_to(of_qq[0], second, 1.0);
            add_to(of_qq[1], one, q1 * q1);
            add_to(of_qq[2], one, q2 * q2);
            add_to(of_qq[3], first, q1);
            add_to(of_qq[4], first, q2);
            add_to(of_qq[5], one, q1 * q2);
        }
    });
    const double slope = 2.0 * profile.falloff * profile.gain * kernel.value;
    EllipsoidChange sums;
    sums.center = slope * Vec3(total(d, of_q[0]), total(d, of_q[1]), total(d, of_q[2]));
    for (std::size_t n = 0; n < 6; ++n) {
        sums.frame[n] = -slope * total(d, of_qq[n]);
    }
    sums.value = total(d, of_g);
    return sums;
}

/// Along a row each derivative by place and shape is exp(-k r^2) times a factor times a power of q0.
struct OnRow {
    double factor;
    std::size_t power;
};

template <class Places>
HWY_NOINLINE Block block(const Places& places, const Profile& profile, const FreeEllipsoid& kernel,
                         const double* weights) {
    const D d;
    Walk<Places> walk(d, places, profile, kernel);
    const double slope = 2.0 * profile.falloff * profile.gain * kernel.value;
    const V gain = hn::Set(d, profile.gain), edge = hn::Set(d, profile.edge * profile.gain);
    const V scale = hn::Set(d, slope), zero = hn::Zero(d), unit = hn::Set(d, 1.0);
    constexpr std::size_t last = numbers_of_ellipsoid - 1;
    Block sums{};
    V vectors[numbers_of_block];
    std::fill(std::begin(vectors), std::end(vectors), zero);
    each_run(places, kernel, Tile{0, places.layers, 0, places.rows}, [&](const Run& run) {
        // Sums of s s q0^n, of s g q0^n and of g g, where s is the common factor of the derivatives.
        V ss[5] = {zero, zero, zero, zero, zero}, sg[3] = {zero, zero, zero}, gg = zero;
        for (std::size_t n = 0; n < run.count; n += hn::Lanes(d)) {
            const Here q = walk.at(d, run, n);
            const V weight =
                hn::IfThenElseZero(q.inside, weights != nullptr ? hn::LoadU(d, weights + run.first + n) : unit);
            const V e = q.e;
            const V g = hn::MulSub(e, gain, edge), s = hn::Mul(e, scale);
            if constexpr (Walk<Places>::along_row) {
                V power = hn::Mul(weight, hn::Mul(s, g));
                gg = hn::MulAdd(weight, hn::Mul(g, g), gg);
                for (V& one : sg) {
                    one = hn::Add(one, power);
                    power = hn::Mul(power, q.q0);
                }
                power = hn::Mul(weight, hn::Mul(s, s));
                for (V& one : ss) {
                    one = hn::Add(one, power);
                    power = hn::Mul(power, q.q0);
                }
            } else {
                const V s0 = hn::Mul(s, q.q0), s1 = hn::Mul(s, q.q1), s2 = hn::Mul(s, q.q2);
                const V slopes[numbers_of_ellipsoid] = {s0,
                                                        s1,
                                                        s2,
                                                        hn::Neg(hn::Mul(s0, q.q0)),
                                                        hn::Neg(hn::Mul(s1, q.q1)),
                                                        hn::Neg(hn::Mul(s2, q.q2)),
                                                        hn::Neg(hn::Mul(s0, q.q1)),
                                                        hn::Neg(hn::Mul(s0, q.q2)),
                                                        hn::Neg(hn::Mul(s1, q.q2)),
                                                        g};
                std::size_t at = 0;
                for (std::size_t a = 0; a <= last; ++a) {
                    const V weighted = hn::Mul(weight, slopes[a]);
                    for (std::size_t b = a; b <= last; ++b, ++at) {
                        vectors[at] = hn::MulAdd(weighted, slopes[b], vectors[at]);
                    }
                }
            }
        }
        if constexpr (Walk<Places>::along_row) {
            const double q1 = run.q1, q2 = run.q2;
            const OnRow slopes[last] = {{1.0, 1},      {q1, 0},  {q2, 0},  {-1.0, 2},    {-q1 * q1, 0},
                                        {-q2 * q2, 0}, {-q1, 1}, {-q2, 1}, {-q1 * q2, 0}};
            double of_ss[5], of_sg[3];
            for (int n = 0; n < 5; ++n) {
                of_ss[n] = total(d, ss[n]);
            }
            for (int n = 0; n < 3; ++n) {
                of_sg[n] = total(d, sg[n]);
            }
            std::size_t at = 0;
            for (std::size_t a = 0; a < last; ++a) {
                for (std::size_t b = a; b < last; ++b, ++at) {
                    sums[at] += slopes[a].factor * slopes[b].factor * of_ss[slopes[a].power + slopes[b].power];
                }
                sums[at++] += slopes[a].factor * of_sg[slopes[a].power];
            }
            sums[at] += total(d, gg);
        }
    });
    if constexpr (!Walk<Places>::along_row) {
        for (std::size_t n = 0; n < numbers_of_block; ++n) {
            sums[n] = total(d, vectors[n]);
        }
    }
    return sums;
}

template <class Places>
HWY_NOINLINE double overlap(const Places& places, const Profile& profile, const FreeEllipsoid& first,
                            const FreeEllipsoid& other, const double* weights) {
    const D d;
    Walk<Places> along_first(d, places, profile, first), along_other(d, places, profile, other);
    const V gain = hn::Set(d, profile.gain), edge = hn::Set(d, profile.edge * profile.gain), unit = hn::Set(d, 1.0);
    V sum = hn::Zero(d);
    each_common_run(places, first, other, [&](const Run& of_first, const Run& of_other) {
        for (std::size_t n = 0; n < of_first.count; n += hn::Lanes(d)) {
            const Here a = along_first.at(d, of_first, n), b = along_other.at(d, of_other, n);
            const V product = hn::Mul(hn::MulSub(a.e, gain, edge), hn::MulSub(b.e, gain, edge));
            const V weight = weights != nullptr ? hn::LoadU(d, weights + of_first.first + n) : unit;
            sum = hn::Add(sum, hn::IfThenElseZero(hn::And(a.inside, b.inside), hn::Mul(weight, product)));
        }
    });
    return total(d, sum);
}

template <class Places>
const Loops<Places>& of_this_set() {
    static constexpr Loops<Places> all{&add<Places>, &project<Places>, &block<Places>, &overlap<Places>};
    return all;
}

} // namespace sheetsplat::fitting::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE

namespace sheetsplat::fitting {

template <class Places>
const Loops<Places>& loops(InstructionSet set) {
    switch (set) {
#if HWY_TARGETS & HWY_SSE4
    case InstructionSet::sse4:
        return N_SSE4::of_this_set<Places>();
#endif
#if HWY_TARGETS & HWY_AVX2
    case InstructionSet::avx2:
        return N_AVX2::of_this_set<Places>();
#endif
#if HWY_TARGETS & HWY_AVX3
    case InstructionSet::avx512:
        return N_AVX3::of_this_set<Places>();
#endif
#if HWY_TARGETS & HWY_NEON
    case InstructionSet::neon:
        return N_NEON::of_this_set<Places>();
#endif
    default:
        return HWY_STATIC_DISPATCH(of_this_set<Places>)();
    }
}

template const Loops<LatticePlaces>& loops<LatticePlaces>(InstructionSet set);
template const Loops<ScatteredPlaces>& loops<ScatteredPlaces>(InstructionSet set);

} // namespace sheetsplat::fitting

#endif

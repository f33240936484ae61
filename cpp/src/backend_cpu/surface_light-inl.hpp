// What shadows and ambient occlusion leave of the light in mode isosurface: along the lines of light/surface_lines.

#if defined(SHEETSPLAT_CPU_SURFACE_LIGHT_INL) == defined(HWY_TARGET_TOGGLE)
#ifdef SHEETSPLAT_CPU_SURFACE_LIGHT_INL
#undef SHEETSPLAT_CPU_SURFACE_LIGHT_INL
#else
#define SHEETSPLAT_CPU_SURFACE_LIGHT_INL
#endif

#include <algorithm>
#include <cstddef>
#include <vector>

#include "backend_cpu/shading.hpp"
#include "effect_row-inl.hpp"
#include "hwy/highway.h"
#include "light/surface_lines.hpp"
#include "light_volume-inl.hpp"
#include "math-inl.hpp"

HWY_BEFORE_NAMESPACE();
namespace sheetsplat::backend_cpu::HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

/// b(rho) of light/surface_lines.
template <class D, class T = hn::TFromD<D>, class V = hn::Vec<D>>
HWY_INLINE V absorbed_below(D d, const typename SurfaceLight<T>::Group& group, V rho) {
    V sum = hn::Zero(d);
    for (const auto& surface : group.surfaces) {
        const V absorption = hn::Set(d, surface.absorption);
        sum = hn::Add(sum, hn::IfThenElseZero(hn::Ge(rho, hn::Set(d, surface.value)), absorption));
    }
    return sum;
}

/// Steps; grids end before.
template <class T>
constexpr T farthest_step = T(1e6);

/// SurfaceLines::last_step_in_grid of a vector of lines, at most `steps`. place, step: in elements.
template <class D, class T = hn::TFromD<D>, class V = hn::Vec<D>>
HWY_INLINE V last_step(D d, const SurfaceLight<T>& light, const V (&place)[3], const V (&step)[3], T steps) {
    const V zero = hn::Zero(d), one = hn::Set(d, T(1)), farthest = hn::Set(d, farthest_step<T>);
    V last = farthest;
    for (std::size_t axis = 0; axis < 3; ++axis) {
        const auto moves = hn::Ne(step[axis], zero);
        const V end = hn::Set(d, static_cast<T>(light.groups.front().rho->counts[axis] - 1));
        const V face = hn::IfThenElseZero(hn::Gt(step[axis], zero), end);
        const V way = hn::Div(hn::Sub(face, place[axis]), hn::IfThenElse(moves, step[axis], one));
        last = hn::Min(last, hn::IfThenElse(moves, way, farthest));
    }
    return hn::Min(hn::Add(hn::Floor(last), one), hn::Set(d, steps));
}

/// SurfaceLines::run_kept of a vector of lines, as far as `last`.
template <class D, class T = hn::TFromD<D>, class V = hn::Vec<D>>
struct RunKept {
    V first, last;

    HWY_INLINE RunKept(D d, const typename SurfaceLight<T>::Group& group, const V (&place)[3], const V (&step)[3],
                       V end)
        : first(hn::Set(d, T(1))), last(end) {
        const V zero = hn::Zero(d), one = hn::Set(d, T(1)), level = hn::Set(d, T(1e-6));
        for (const auto& half : group.kept) {
            V rise = zero, height = hn::Set(d, half.distance);
            for (std::size_t axis = 0; axis < 3; ++axis) {
                const V normal = hn::Set(d, half.normal[axis]);
                rise = hn::MulAdd(normal, step[axis], rise);
                height = hn::MulAdd(normal, place[axis], height);
            }
            const auto rises = hn::Gt(rise, level), falls = hn::Lt(rise, hn::Neg(level));
            const V meets = hn::Div(height, hn::IfThenElse(hn::Or(rises, falls), hn::Neg(rise), one));
            first = hn::IfThenElse(rises, hn::Max(first, hn::Ceil(meets)), first);
            last = hn::IfThenElse(falls, hn::Min(last, hn::Floor(meets)), last);
            const auto outside = hn::AndNot(hn::Or(rises, falls), hn::Lt(height, zero));
            last = hn::IfThenElse(outside, zero, last);
        }
    }
};

/// What is left of light whose absorptions add up to `absorbed`.
template <class D, class V = hn::Vec<D>>
HWY_INLINE V left_of_absorbed(D d, V absorbed) {
    const V opaque = hn::Set(d, static_cast<hn::TFromD<D>>(SurfaceLines::opaque));
    const V left = exp2_nonpositive(d, hn::Neg(hn::Min(absorbed, opaque)));
    return hn::IfThenElseZero(hn::Lt(absorbed, opaque), left);
}

/// What is left of light that comes along lines through points 1 to `end`, a line a lane.
template <class D, class T = hn::TFromD<D>, class V = hn::Vec<D>>
HWY_INLINE V left_along(D d, const SurfaceLight<T>& light, const V (&place)[3], const V (&step)[3], V end) {
    const V opaque = hn::Set(d, static_cast<T>(SurfaceLines::opaque));
    V absorbed = hn::Zero(d);
    for (const auto& group : light.groups) {
        const RunKept<D> run(d, group, place, step, end);
        V before = hn::Zero(d);
        for (T point = T(1);; point += T(1)) {
            const V at = hn::Set(d, point);
            const auto open = hn::And(hn::Ge(run.last, at), hn::Lt(absorbed, opaque));
            if (hn::AllFalse(d, open)) {
                break;
            }
            const V here[3] = {hn::MulAdd(at, step[0], place[0]), hn::MulAdd(at, step[1], place[1]),
                               hn::MulAdd(at, step[2], place[2])};
            const V below = absorbed_below(d, group, look_up(d, *group.rho, here));
            const auto crossing = hn::And(open, hn::Gt(at, run.first));
            absorbed = hn::Add(absorbed, hn::IfThenElseZero(crossing, hn::Abs(hn::Sub(below, before))));
            before = below;
        }
    }
    return left_of_absorbed(d, absorbed);
}

/// The same of a single line, a point a lane.
template <class D, class T = hn::TFromD<D>, class V = hn::Vec<D>>
HWY_INLINE T left_along_one(D d, const SurfaceLight<T>& light, const T (&from)[3],
                            const typename SurfaceLight<T>::Line& line, T steps) {
    constexpr int lanes = static_cast<int>(hn::MaxLanes(D()));
    constexpr T opaque = static_cast<T>(SurfaceLines::opaque);
    const V place[3] = {hn::Set(d, from[0]), hn::Set(d, from[1]), hn::Set(d, from[2])};
    const V step[3] = {hn::Set(d, line.step[0]), hn::Set(d, line.step[1]), hn::Set(d, line.step[2])};
    const V end = last_step(d, light, place, step, steps);
    T absorbed = T(0);
    for (const auto& group : light.groups) {
        const RunKept<D> run(d, group, place, step, end);
        const T start = hn::GetLane(run.first), last = hn::GetLane(run.last);
        T below[lanes + 1] = {}; // Of the point before the first lane, and of the lanes.
        for (T first = start; first <= last && absorbed < opaque; first += static_cast<T>(lanes)) {
            const V at = hn::Iota(d, first);
            const V here[3] = {hn::MulAdd(at, step[0], place[0]), hn::MulAdd(at, step[1], place[1]),
                               hn::MulAdd(at, step[2], place[2])};
            const V own = absorbed_below(d, group, look_up(d, *group.rho, here));
            below[0] = first > start ? below[lanes] : hn::GetLane(own);
            hn::StoreU(own, d, below + 1);
            const V change = hn::Abs(hn::Sub(own, hn::LoadU(d, below)));
            absorbed += hn::GetLane(hn::SumOfLanes(d, hn::IfThenElseZero(hn::Le(at, run.last), change)));
        }
    }
    return hn::GetLane(left_of_absorbed(d, hn::Set(d, absorbed)));
}

/// What is left of light at the pixels of a row that show a surface. These are few in a slice: vectors hold the points
/// of one long line, or short lines of several directions and pixels.
template <class T>
class LightOfRow {
  public:
    using D = typename EffectRow<T>::D;
    static constexpr int room = EffectRow<T>::room;

    LightOfRow(const Shading<T>& shading, const EffectRow<T>& row, const VolumeRow<T>& places) {
        const D d;
        const SurfaceLight<T>& light = shading.surface_light;
        HWY_ALIGN T shown[room];
        row.fill(shown, T(0));
        row.for_each(row.alpha, [&](int x, int number, auto visible) {
            const auto column = hn::Iota(d, static_cast<T>(x)), share = hn::Load(d, row.share + number);
            for (int axis = 0; axis < 3; ++axis) {
                hn::Store(places.place(d, axis, column, share), d, place_[axis] + number);
            }
            hn::Store(hn::IfThenElseZero(visible, hn::Set(d, T(1))), d, shown + number);
        });
        int numbers[room];
        const auto choose = [&](const auto& is_wanted) {
            int count = 0;
            for (int number = 0; number < row.past - row.begin; ++number) {
                if (shown[number] > T(0) && is_wanted(number)) {
                    numbers[count++] = number;
                }
            }
            return count;
        };
        const std::size_t lights = shading.shadows ? light.to_lights.size() : 0;
        left_.assign((lights + 1) * room, T(1));
        for (std::size_t n = 0; n < lights; ++n) {
            const T* towards = shading.lights[n].direction;
            // Light that comes from behind needs no line.
            const int count = choose([&](int number) {
                const T facing = row.against_x[number] * towards[0] + row.against_y[number] * towards[1] +
                                 row.against_z[number] * towards[2];
                return facing > T(0) || (shading.two_sided && facing < T(0));
            });
            follow(light, numbers, count, &light.to_lights[n], 1, farthest_step<T>, left_.data() + n * room);
        }
        open_ = left_.data() + lights * room;
        if (shading.occlusion) {
            const int count = choose([](int) { return true; });
            follow(light, numbers, count, light.around.data(), light.around.size(), light.around_steps, open_);
            for (int n = 0; n < count; ++n) {
                T& open = open_[numbers[n]];
                open = T(1) - shading.occlusion_strength * (T(1) - open);
            }
        }
    }

    [[nodiscard]] const T* light(std::size_t number) const { return left_.data() + number * room; }
    [[nodiscard]] const T* ambient() const { return open_; }

  private:
    using Line = typename SurfaceLight<T>::Line;
    static constexpr int lanes = static_cast<int>(hn::MaxLanes(D()));

    /// Means over some lines of what they leave.
    void follow(const SurfaceLight<T>& light, const int* numbers, int count, const Line* lines, std::size_t line_count,
                T steps, T* left) const {
        for (int n = 0; n < count; ++n) {
            left[numbers[n]] = T(0);
        }
        if (steps > static_cast<T>(lanes)) {
            follow_each(light, numbers, count, lines, line_count, steps, left);
        } else {
            follow_together(light, numbers, count, lines, line_count, steps, left);
        }
        const T share = T(1) / static_cast<T>(line_count);
        for (int n = 0; n < count; ++n) {
            left[numbers[n]] *= share;
        }
    }

    HWY_NOINLINE void follow_each(const SurfaceLight<T>& light, const int* numbers, int count, const Line* lines,
                                  std::size_t line_count, T steps, T* sums) const {
        for (int n = 0; n < count; ++n) {
            const int number = numbers[n];
            const T from[3] = {place_[0][number], place_[1][number], place_[2][number]};
            for (std::size_t line = 0; line < line_count; ++line) {
                sums[number] += left_along_one(D(), light, from, lines[line], steps);
            }
        }
    }

    HWY_NOINLINE void follow_together(const SurfaceLight<T>& light, const int* numbers, int count, const Line* lines,
                                      std::size_t line_count, T steps, T* sums) const {
        const D d;
        HWY_ALIGN T from[3][lanes], towards[3][lanes], found[lanes];
        int whose[lanes], used = 0;
        const auto look = [&] {
            // Unused lanes follow the first line.
            for (int lane = used; lane < lanes; ++lane) {
                for (int axis = 0; axis < 3; ++axis) {
                    from[axis][lane] = from[axis][0];
                    towards[axis][lane] = towards[axis][0];
                }
            }
            using V = hn::Vec<D>;
            const V place[3] = {hn::Load(d, from[0]), hn::Load(d, from[1]), hn::Load(d, from[2])};
            const V step[3] = {hn::Load(d, towards[0]), hn::Load(d, towards[1]), hn::Load(d, towards[2])};
            hn::Store(left_along(d, light, place, step, last_step(d, light, place, step, steps)), d, found);
            for (int lane = 0; lane < used; ++lane) {
                sums[whose[lane]] += found[lane];
            }
            used = 0;
        };
        for (int n = 0; n < count; ++n) {
            for (std::size_t line = 0; line < line_count; ++line) {
                whose[used] = numbers[n];
                for (int axis = 0; axis < 3; ++axis) {
                    from[axis][used] = place_[axis][numbers[n]];
                    towards[axis][used] = lines[line].step[axis];
                }
                if (++used == lanes) {
                    look();
                }
            }
        }
        if (used > 0) {
            look();
        }
    }

    HWY_ALIGN T place_[3][room]; ///< of pixels that show a surface, in elements
    std::vector<T> left_;        ///< a row of each light, and of ambient light
    T* open_ = nullptr;
};

/// What it leaves at one vector of pixels.
template <class T>
struct DimmingBySurfaces {
    static constexpr bool anything = true;
    using D = typename EffectRow<T>::D;
    D d;
    const LightOfRow<T>& row;
    bool shadows;
    int number; ///< of the first pixel in the row

    [[nodiscard]] HWY_INLINE hn::Vec<D> light(std::size_t n) const {
        return shadows ? hn::LoadU(d, row.light(n) + number) : hn::Set(d, T(1));
    }
    [[nodiscard]] HWY_INLINE hn::Vec<D> ambient() const { return hn::LoadU(d, row.ambient() + number); }
};

} // namespace sheetsplat::backend_cpu::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif // SHEETSPLAT_CPU_SURFACE_LIGHT_INL

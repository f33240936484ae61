// What shadows and ambient occlusion leave of the light in mode isosurface: along the lines of view/surface_lines.

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
#include "light_volume-inl.hpp"
#include "math-inl.hpp"
#include "view/surface_lines.hpp"

HWY_BEFORE_NAMESPACE();
namespace sheetsplat::backend_cpu::HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

/// A vector of lines from places in the grid.
template <class D>
struct Lines {
    using T = hn::TFromD<D>;
    using V = hn::Vec<D>;
    using M = hn::Mask<D>;
    using Line = typename SurfaceLight<T>::Line;
    static constexpr T farthest = T(1e6); ///< steps; grids end before

    D d;
    const SurfaceLight<T>& light;
    M wanted;   ///< lanes that are looked at
    V place[3]; ///< where they start, in elements

    /// What is left of light that comes along a line through points 1 to `steps`.
    [[nodiscard]] HWY_INLINE V left_along(const Line& line, T steps) const {
        const V last = last_step(line, steps), opaque = hn::Set(d, static_cast<T>(SurfaceLines::opaque));
        V absorbed = hn::Zero(d);
        for (const LightVolume* group : light.groups) {
            V before = hn::Zero(d);
            for (T point = T(1);; point += T(1)) {
                const V at = hn::Set(d, point);
                const M reached = hn::And(hn::Ge(last, at), hn::Lt(absorbed, opaque));
                if (hn::AllFalse(d, reached)) {
                    break;
                }
                const V here[3] = {hn::MulAdd(at, hn::Set(d, line.step[0]), place[0]),
                                   hn::MulAdd(at, hn::Set(d, line.step[1]), place[1]),
                                   hn::MulAdd(at, hn::Set(d, line.step[2]), place[2])};
                const V below = absorbed_below(look_up(d, *group, here));
                if (point > T(1)) {
                    absorbed = hn::Add(absorbed, hn::IfThenElseZero(reached, hn::Abs(hn::Sub(below, before))));
                }
                before = below;
            }
        }
        const V left = exp2_nonpositive(d, hn::Neg(hn::Min(absorbed, opaque)));
        return hn::IfThenElseZero(hn::Lt(absorbed, opaque), left);
    }

  private:
    /// The last step that matters, as SurfaceLines::last_step has it; 0 outside of `wanted`.
    [[nodiscard]] HWY_INLINE V last_step(const Line& line, T steps) const {
        V last = hn::Set(d, farthest);
        for (std::size_t axis = 0; axis < 3; ++axis) {
            const T step = line.step[axis];
            if (step != T(0)) {
                const T face = step > T(0) ? static_cast<T>(light.groups.front()->counts[axis] - 1) : T(0);
                last = hn::Min(last, hn::Mul(hn::Sub(hn::Set(d, face), place[axis]), hn::Set(d, T(1) / step)));
            }
        }
        last = hn::Min(hn::Add(hn::Floor(last), hn::Set(d, T(1))), hn::Set(d, steps));
        for (const auto& half : light.kept) {
            T nearer = T(0);
            V above = hn::Set(d, half.distance);
            for (std::size_t axis = 0; axis < 3; ++axis) {
                nearer -= half.normal[axis] * line.step[axis];
                above = hn::MulAdd(hn::Set(d, half.normal[axis]), place[axis], above);
            }
            if (nearer > T(1e-6)) {
                last = hn::Min(last, hn::Floor(hn::Mul(above, hn::Set(d, T(1) / nearer))));
            }
        }
        return hn::IfThenElseZero(wanted, last);
    }

    [[nodiscard]] HWY_INLINE V absorbed_below(V rho) const {
        V sum = hn::Zero(d);
        for (const auto& surface : light.surfaces) {
            const V absorption = hn::Set(d, surface.absorption);
            sum = hn::Add(sum, hn::IfThenElseZero(hn::Ge(rho, hn::Set(d, surface.value)), absorption));
        }
        return sum;
    }
};

/// What is left of light at the pixels of a row that show a surface. These are few in a slice: their lines are followed
/// side by side, wherever in the row they are.
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
            follow(light, numbers, count, &light.to_lights[n], 1, Lines<D>::farthest, left_.data() + n * room);
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
    /// Means over some lines of what they leave.
    HWY_NOINLINE void follow(const SurfaceLight<T>& light, const int* numbers, int count,
                             const typename SurfaceLight<T>::Line* lines, std::size_t line_count, T steps,
                             T* left) const {
        const D d;
        constexpr int lanes = static_cast<int>(hn::MaxLanes(D()));
        const auto share = hn::Set(d, T(1) / static_cast<T>(line_count));
        for (int first = 0; first < count; first += lanes) {
            HWY_ALIGN T from[3][lanes];
            HWY_ALIGN T found[lanes];
            const int past = std::min(lanes, count - first);
            for (int lane = 0; lane < lanes; ++lane) {
                const int number = numbers[first + std::min(lane, past - 1)];
                for (int axis = 0; axis < 3; ++axis) {
                    from[axis][lane] = place_[axis][number];
                }
            }
            const Lines<D> vector{d,
                                  light,
                                  hn::FirstN(d, static_cast<std::size_t>(past)),
                                  {hn::Load(d, from[0]), hn::Load(d, from[1]), hn::Load(d, from[2])}};
            auto sum = hn::Zero(d);
            for (std::size_t line = 0; line < line_count; ++line) {
                sum = hn::Add(sum, vector.left_along(lines[line], steps));
            }
            hn::Store(hn::Mul(sum, share), d, found);
            for (int lane = 0; lane < past; ++lane) {
                left[numbers[first + lane]] = found[lane];
            }
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

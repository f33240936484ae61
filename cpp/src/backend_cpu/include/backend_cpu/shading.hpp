// Everything that turns finished slices into a picture, made once a frame in the number format of the sheets: the
// transfer function, lights, material, scales. Source: IMAGE FORMATION sections 4 to 7.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "facts/frame.hpp"
#include "sheetsplat/camera.hpp"
#include "sheetsplat/scene.hpp"
#include "view/light_volume.hpp"

namespace sheetsplat {
struct DrawPlan;
}

namespace sheetsplat::backend_cpu {

/// Where to look for the stretch that a value is in: the cell of a value, put between first and last, is
/// (value - first) * per_unit, rounded down and not above last_cell.
template <class T>
struct Cells {
    /// Of each cell the place, in records, of the stretch that its smallest values are in.
    std::vector<std::int32_t> records;
    T first = T(0), last = T(0), per_unit = T(0), last_cell = T(0);
};

/// The transfer function over rho in the sheets' unit, as stretches over which colour and opacity are linear, stretches
/// of no width left out: exact, steps not smeared, of two points at one value the later one holds from there on. The
/// first stretch holds with its first looks for all smaller values too, the last one for all larger ones.
template <class T>
struct TransferTable {
    /// Stretches that fit registers, one a lane.
    static constexpr int most_in_lanes = 16;
    /// Numbers of one stretch: from, to, opacity, its slope | red, slope, green, slope | blue, slope, 0, 0.
    static constexpr int record = 12;
    static constexpr int numbers = 10;

    int stretches = 0;
    std::vector<T> records;
    /// By number of `record`, then by stretch: the same for up to most_in_lanes stretches.
    alignas(64) T lanes[numbers][most_in_lanes] = {};
    Cells<T> cells;
    /// Opacity is 0 where rho <= below and where rho >= above.
    T below = T(0), above = T(0);
};

/// A stretch of the transfer function for means over ramps: opacity is at most 1 - 2^-24 and linear.
template <class T>
struct RampStretch {
    T from = T(0), to = T(0);
    T per_width = T(0); ///< 1 / (to - from); 0 where everything is constant
    T opacity = T(0), opacity_step = T(0);
    T clearness = T(0), clearness_step = T(0); ///< 1 - opacity, with its own digits
    T color[3] = {}, color_step[3] = {};
};

/// All stretches of RampStretch, from the smallest number to the largest.
template <class T>
struct RampTable {
    std::vector<RampStretch<T>> stretches;
    /// Up to so many are gone through one after the other, of more each ramp looks for its first and last one.
    static constexpr std::size_t most_to_walk = 12;
    /// Numbers of one stretch: from, to, per_width, 0 | opacity, step, clearness, step | red, step, green, step | blue,
    /// step, then the integrals over rho up to `from` of absorption and of absorption times red, green and blue, each
    /// as a number and what it has lost: two more fours and a half. One record more than stretches; only where there
    /// are many.
    static constexpr int record = 24;
    std::vector<T> records;
    Cells<T> cells;
};

/// A directional light, with what the material makes of it.
template <class T>
struct ShadingLight {
    T direction[3] = {}; ///< eye space, unit length, towards the light
    T diffuse[3] = {};   ///< colour times diffuse coefficient
    T specular[3] = {};  ///< colour times specular coefficient
};

/// A half space that is kept, in eye space: dot(normal, x) + distance >= 0. World units.
struct KeptHalfSpace {
    Vec3 normal{0.0};
    double distance = 0.0; ///< with what a point on the plane is allowed
};

/// How much of the light from somewhere reaches a point: a number between 0 and 1 in a LightVolume. The places of its
/// elements follow from pixel (i, j) of the picture and depth t: orthographic constant + i by_column + j by_row + t
/// by_depth, perspective constant + t (i by_column + j by_row + by_depth). In float64: rounded once they are relative
/// to a row of a tile.
struct VolumeLookup {
    const LightVolume* volume = nullptr; ///< null: everything is reached
    Vec3 constant{0.0}, by_column{0.0}, by_row{0.0}, by_depth{0.0};
};

/// What shade_slab reads. Lengths of gradients are in reference lengths.
template <class T>
struct Shading {
    Mode mode = Mode::composite;
    bool perspective = false;
    bool preintegration = false;
    bool second_order = false;
    bool empty_test = false;
    bool gradient = false; ///< for light, or for opacity
    bool lit = false;
    /// Rows go through the effects one after the other: of what follows, anything is on, or preintegration of second
    /// order.
    bool by_effects = false;
    bool clip = false;
    bool analytic_gradient = false;
    bool gradient_opacity = false;
    bool depth_cue = false;
    bool shadows = false;
    bool occlusion = false;
    bool specular = false;
    bool two_sided = false;
    bool gray = false;    ///< all lights are
    bool correct = false; ///< a slice is not one reference length thick everywhere

    T exponent = T(1); ///< slice spacing over reference length
    /// Pixels end at this opacity; isosurface: anything between 0 and 1.
    T stop = T(1);
    /// The picture's scalars in world units: xray: world value times world length that 1 in a sheet adds; mip: world
    /// value that 1 in a sheet stands for.
    T scalar_step = T(1);
    T coverage_step = T(1); ///< slice spacing, world units

    TransferTable<T> transfer;
    RampTable<T> ramps; ///< preintegration only

    T iso_value = T(0);
    T iso_color[3] = {};

    std::vector<ShadingLight<T>> lights;
    T ambient = T(1);
    T shininess = T(1);
    /// Components of the gradient are differences of rho times these; in perspective that across is divided by the
    /// depth. In float64: a slab's own scale is put in before they are rounded.
    double gradient_across = 0.0, gradient_along = 0.0;
    double weakest_gradient = 0.0; ///< g0
    double full_gradient = 1.0;    ///< g1

    std::vector<KeptHalfSpace> kept;     ///< all of them
    std::vector<VolumeLookup> shadow_of; ///< a light
    VolumeLookup openness;               ///< what ambient occlusion leaves open of a point's surroundings
    T occlusion_strength = T(0);
    /// Depth cue: its share at depth t is cue_strength clamp((t - cue_start) cue_per_depth, 0, 1).
    double cue_start = 0.0, cue_per_depth = 0.0;
    T cue_strength = T(0);
    T cue_color[3] = {};

    double first_depth = 0.0, slice_spacing = 1.0; ///< world units
    /// Perspective: slope of the ray of pixel (i, j) is ((i - axis_x) pixel, (axis_y - j) pixel).
    double axis_x = 0.0, axis_y = 0.0, pixel = 0.0;
};

/// volumes: where the plan has shadows or ambient occlusion; not owned.
template <class T>
Shading<T> make_shading(const Scene& scene, const Camera& camera, const Frame& frame, const DrawPlan& plan,
                        const LightVolumes* volumes = nullptr);

extern template Shading<float> make_shading<float>(const Scene&, const Camera&, const Frame&, const DrawPlan&,
                                                   const LightVolumes*);
extern template Shading<double> make_shading<double>(const Scene&, const Camera&, const Frame&, const DrawPlan&,
                                                     const LightVolumes*);

/// For tests: the transfer function alone. value_unit: the amount of rho that sheets call 1.
template <class T>
TransferTable<T> make_transfer_table(const TransferFunction& function, double value_unit);

extern template TransferTable<float> make_transfer_table<float>(const TransferFunction&, double);
extern template TransferTable<double> make_transfer_table<double>(const TransferFunction&, double);

} // namespace sheetsplat::backend_cpu

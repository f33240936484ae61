// What each mode makes of the slices. The only home of these rules in C++. Source: conventions, section 7.
#pragma once

#include "sheetsplat/scene.hpp"

namespace sheetsplat {

/// The picture is rho itself, its sum or its maximum along each ray: no colours, opacities or light.
constexpr bool is_scalar(Mode mode) { return mode == Mode::xray || mode == Mode::mip; }

/// Slices are classified and composited by their opacities: what opacity_stop, gradient_opacity, preintegration and
/// the opacity correction act on.
constexpr bool is_composited(Mode mode) { return mode == Mode::composite; }

/// Each slice is shaded together with the one before it: crossings of an iso value, or pre-integrated intervals.
constexpr bool uses_intervals(Mode mode, bool preintegration) {
    return mode == Mode::isosurface || (is_composited(mode) && preintegration);
}

/// What a scalar mode shows of a sheet's 1. value_unit: the amount of rho that sheets call 1; slice_spacing: world
/// units, by which an x-ray integrates.
constexpr double scalar_unit(Mode mode, double value_unit, double slice_spacing) {
    return mode == Mode::xray ? value_unit * slice_spacing : value_unit;
}

} // namespace sheetsplat

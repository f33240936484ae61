// What each mode uses and computes. C++ code asks these functions instead of comparing modes. Source: conventions,
// section 7.
#pragma once

#include <cstddef>
#include <vector>

#include "sheetsplat/scene.hpp"

namespace sheetsplat {

constexpr const char* name_of(Mode mode) {
    switch (mode) {
    case Mode::composite:
        return "composite";
    case Mode::isosurface:
        return "isosurface";
    case Mode::xray:
        return "xray";
    case Mode::mip:
        return "mip";
    case Mode::minimum:
        return "minimum";
    case Mode::average:
        return "average";
    }
    return "unknown";
}

/// The picture is made of rho itself along each ray, its sum, largest, smallest or mean value: no colours, opacities or
/// light.
constexpr bool is_scalar(Mode mode) { return mode != Mode::composite && mode != Mode::isosurface; }

/// Only slices where the weights of all fields add up to more than 0 count; without one a pixel is no number.
constexpr bool counts_weighted_slices(Mode mode) {
    return mode == Mode::mip || mode == Mode::minimum || mode == Mode::average;
}

/// Slices are classified and composited by their opacities: what gradient_opacity, preintegration and the opacity
/// correction act on.
constexpr bool is_composited(Mode mode) { return mode == Mode::composite; }

/// Each slice is shaded together with the one before it: crossings of an iso value, or pre-integrated intervals.
constexpr bool uses_intervals(Mode mode, bool preintegration) {
    return mode == Mode::isosurface || (is_composited(mode) && preintegration);
}

/// The scalars of all groups add up, wherever their points are: in scalar modes where fields end in one place.
bool adds_all_fields(const Scene& scene);
/// The groups whose scalars are classified, or end, apart: the scene's, or one of all fields. Valid while the scene is.
std::vector<Group> groups_drawn(const Scene& scene);
/// Which of groups_drawn a field belongs to.
std::size_t group_drawn_of(const Scene& scene, std::size_t field);

/// A transfer function has one value: gradients below a share of the window are shaded as weaker ones (conventions,
/// section 5), and there none is.
bool has_window_of_one_value(const Group& group);
bool has_window_of_one_value(const Scene& scene);

/// The scene's iso values as a group's fields are summed: counted from its base where the scene is.
std::vector<IsoValue> iso_values_of(const Scene& scene, std::size_t group);

/// g0 of a group times the reference length (conventions, section 5): gradients below it are lit as weaker ones.
double weakest_difference(const Scene& scene, const Group& group);

/// What a scalar mode shows of a sheet's 1. value_unit: the amount of rho that sheets call 1; slice_spacing: world
/// units, by which an x-ray integrates.
constexpr double scalar_unit(Mode mode, double value_unit, double slice_spacing) {
    return mode == Mode::xray ? value_unit * slice_spacing : value_unit;
}

} // namespace sheetsplat

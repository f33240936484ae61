// What each mode uses and computes. C++ code asks these functions instead of comparing modes. Source: conventions,
// section 7.
#pragma once

#include <cstddef>
#include <limits>
#include <vector>

#include "sheetsplat/scene.hpp"

namespace sheetsplat {

constexpr const char* name_of(Mode mode) { return traits_of(mode).name; }

/// The picture is made of rho itself along each ray: no colours, opacities or light.
constexpr bool is_scalar(Mode mode) { return traits_of(mode).fold >= Fold::sum; }

/// Only slices where the weights of all fields add up to more than 0 count; without one a pixel is no number.
constexpr bool counts_weighted_slices(Mode mode) { return traits_of(mode).counts; }

/// Slices are classified and composited by their opacities: what gradient_opacity, preintegration and the opacity
/// correction act on.
constexpr bool is_composited(Mode mode) { return traits_of(mode).fold == Fold::opacities; }

/// Crossings of iso values are shown.
constexpr bool shows_surfaces(Mode mode) { return traits_of(mode).fold == Fold::surfaces; }

/// Pixels are sums over slices, or means of them.
constexpr bool adds_slices(Mode mode) { return traits_of(mode).fold == Fold::sum; }

/// Pixels are one of the slices' numbers, the largest or the smallest.
constexpr bool is_extreme(Mode mode) { return traits_of(mode).fold > Fold::sum; }

/// Bounds of blocks of samples tell where it may be found: the largest or the smallest number.
constexpr bool has_bounds(Mode mode) {
    return traits_of(mode).fold == Fold::largest || traits_of(mode).fold == Fold::smallest;
}

/// Of an extreme, what rho is multiplied by so that the smallest is looked for.
constexpr double sign_of_extreme(Mode mode) { return traits_of(mode).fold == Fold::largest ? -1.0 : 1.0; }

/// The number of a ray before its first slice: of an extreme, what any other replaces.
constexpr double start_of(Mode mode) {
    return is_extreme(mode) ? sign_of_extreme(mode) * std::numeric_limits<double>::infinity() : 0.0;
}

/// Each slice is shaded together with the one before it: crossings of an iso value, or pre-integrated intervals.
constexpr bool uses_intervals(Mode mode, bool preintegration) {
    return shows_surfaces(mode) || (is_composited(mode) && preintegration);
}

/// The scalars of all groups add up, wherever their points are: in scalar modes where fields end in one place.
bool adds_all_fields(const Scene& scene);
/// The groups whose scalars are classified, or end, apart: the scene's, or one of all fields. Valid while the scene is.
std::vector<Group> groups_drawn(const Scene& scene);
/// Which of groups_drawn a field belongs to.
std::size_t group_drawn_of(const Scene& scene, std::size_t field);

/// [first, last) of a scene's groups.
struct GroupRange {
    std::size_t first = 0, last = 0;
};
/// Its transfer function, or its surfaces, are what a picture of colours shows.
inline bool is_classified(const Group& group) {
    return group.use.role == GroupRole::shown || group.use.role == GroupRole::label;
}
/// Its field is 1 at the samples of a label.
inline bool is_label(const Group& group) {
    return group.use.role == GroupRole::label || group.use.role == GroupRole::compared;
}
/// Mode composite: points of a sum of 0 show something, so that points that no kernel reaches must be told from them.
/// (Labels are below 0 where none of their kernels reaches.)
inline bool shows_at_base(const Group& group) {
    return group.use.role == GroupRole::shown && !group.transfer_function->transparent_over(0.0, 0.0);
}
/// In place of the value 0 of a label's surface: where numbers are 0 there is none.
constexpr double just_above_labels = 1e-30;
/// Its kernels are drawn for what other groups need of them, whatever its own transfer function says.
inline bool serves_others(const Group& group) { return group.use.role != GroupRole::shown; }
/// The sets of labels, each of groups that are compared with each other.
std::vector<GroupRange> label_sets(const std::vector<Group>& groups);
/// The groups whose colours take the place of those of a group.
GroupRange colors_of(const std::vector<Group>& groups, std::size_t number);

/// A transfer function has one value: gradients below a share of the window are shaded as weaker ones (conventions,
/// section 5), and there none is.
bool has_window_of_one_value(const Group& group);
bool has_window_of_one_value(const Scene& scene);

/// The scene's iso values as a group's fields are summed: counted from its base where the scene is.
std::vector<IsoValue> iso_values_of(const Scene& scene, std::size_t group);

/// g0 of a group times the reference length (conventions, section 5): gradients below it are lit as weaker ones.
double weakest_difference(const Scene& scene, const Group& group);

/// What a scalar mode shows of a sheet's 1. value_unit: the amount of rho that sheets call 1; slice_spacing: world
/// units, by which modes integrate.
constexpr double scalar_unit(Mode mode, double value_unit, double slice_spacing) {
    return traits_of(mode).integrates ? value_unit * slice_spacing : value_unit;
}

} // namespace sheetsplat

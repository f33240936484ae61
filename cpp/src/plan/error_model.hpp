// What the sums of a scene's kernels amount to, and the errors that follow.
#pragma once

#include <limits>

#include "plan/limits_common.hpp"
#include "plan/make_plan.hpp"

namespace sheetsplat {

/// What the sums of a scene come to, against what its picture resolves; of several groups the worst of each, but
/// largest and resolved those whose ratio is.
struct SumFacts {
    double overlap = 0.0;      ///< kernels at a point
    double largest = 0.0;      ///< bound on |rho|
    double resolved = 1.0;     ///< the transfer function's window; for an isosurface the spread of the values
    double ratio = 1.0;        ///< of the former two
    double sum = 0.0;          ///< bound on sums of weights, and of weighted values in the sheets' unit
    double steepness = 1.0;    ///< of opacity and colours over the window, a slice
    double least_scale = 0.0;  ///< of fields that are divided: the larger of w0 and the smallest weight above 0
    double weight_range = 0.0; ///< of fields that are divided: largest m / w0
    double crowd = 1.0; ///< kernels at a point where they are densest: exact for lattices, else twice an estimate
    double bend = 1.0;  ///< root mean square of colours' and opacity's slopes over the values that occur, at least 1
    /// Least distance of an iso value from 0 and from the ends of a field's values, where it is not 0.
    double nearest_end = std::numeric_limits<double>::infinity();
};
SumFacts sum_facts(const Scene& scene, const ViewFacts& view, const DrawPlan& plan);

/// Largest values of fields that are divided over what is resolved, counted from their pivots. resolved: where one
/// transfer function classifies all fields; else it follows from each group's.
double ratio_from_pivots(const Scene& scene, const DrawPlan& plan, double resolved);

/// Root mean square error that a picture's pixels may have (conventions, section 9).
double bound_of(const ViewFacts& view, const SumFacts& sums);

/// Error of a lit picture over its doubt (DrawPlan::lit_rounding): what the rounding of sums, of what they are counted
/// from and of places makes of rho, in the sheets' unit, times what all lights can make of a turned normal. Fills
/// DrawPlan::gradient_doubt. from_middle: values of fields that are divided are counted from their middle.
double lit_rounding(const Scene& scene, const ViewFacts& view, DrawPlan& plan, const SumFacts& sums, bool from_middle);

/// DrawPlan::extremes_rounding.
double extremes_rounding(Mode mode, const SumFacts& sums);

/// Largest weight over w0, times values over what is resolved, where means over slabs are divided; 0 elsewhere. The
/// means are differences, known to the rounding of 1 however small they are.
double weights_in_slabs(Sampling sampling, const SumFacts& sums);

/// Whether the cubic of second order shows something between two ends that are 0.
bool shows_between_zeros(const Scene& scene, const SumFacts& sums, const DrawPlan& plan);

/// Whether an interval that is empty must be distinguished from one whose ends are 0: where clipping, or the end of a
/// group's volumes, leaves one end of an interval, which shows only if a kernel reaches it, and where there is
/// something between two ends that are 0.
bool intervals_may_be_empty(const Scene& scene, const SumFacts& sums, const DrawPlan& plan);

/// True where quotients of sums are lit.
bool lights_quotients(const DrawPlan& plan);

/// Root mean square rounding of the sum of so many kernels, over its size. `truncates`: stores in 16 bits cut off.
double sum_noise(Precision precision, bool truncates, double crowd);

/// The shares of sums, of the gradients made of them, and of the picture. noise: of sum_noise.
void expect_errors(const ViewFacts& view, const SumFacts& sums, double noise, DrawPlan& plan);

/// The amount of rho that the sheets of a group call 1.
double unit_of_values(const Scene& scene, const ViewFacts& view, const Group& group);

/// Bound on |rho| of any group.
double largest_rho(const Scene& scene, const ViewFacts& view);

/// The shares of light that is left, looked up in volumes. What their numbers differ by from sums along each ray grows
/// with what a step takes away. opacity: largest that occurs.
void expect_light_errors(const Scene& scene, const ViewFacts& view, double opacity, DrawPlan& plan);

} // namespace sheetsplat

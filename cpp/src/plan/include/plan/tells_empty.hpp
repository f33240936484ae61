// Where it decides what is seen whether a point is empty. All that leave out kernels because of what these add to sums
// ask here.
#pragma once

#include "plan/make_plan.hpp"
#include "scene/mode_rules.hpp"

namespace sheetsplat {

/// Weights say which points no kernel reaches (conventions, section 2), and that decides what is seen there: with an
/// opacity at 0, and in intervals of which one end is cut off or that show something between two ends of 0. Kernels
/// that add nothing to sums, those of weight 0 among them, are drawn.
inline bool reach_decides(const DrawPlan& plan) { return plan.weight && plan.empty_test; }

/// Weights say which points have W > 0, and only these count (conventions, section 7): kernels of weight 0 are not
/// drawn, those of value 0 are.
inline bool weight_decides(const DrawPlan& plan) { return plan.weight && counts_weighted_slices(plan.mode); }

/// Either: it is told apart from a sum of 0 where kernels end.
inline bool tells_empty(const DrawPlan& plan) { return reach_decides(plan) || weight_decides(plan); }

} // namespace sheetsplat

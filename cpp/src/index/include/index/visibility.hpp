// What decides which samples of a lattice and which scattered kernels are drawn. A kernel is left out only where it
// cannot matter (conventions, section 2).
#pragma once

#include <memory>
#include <vector>

#include "sheetsplat/field.hpp"
#include "sheetsplat/transfer_function.hpp"

namespace sheetsplat {

/// A lattice beside whose samples something shows, and from which numbers on, counted from 0 or from its base.
struct SeenBeside {
    std::shared_ptr<const Field> field;
    double above = 0.0, below = 0.0; ///< at f - b >= above and f - b <= -below; 0: at all that are not 0
    bool in_cells = false;           ///< it shows in the cells alone that have such a sample as a corner

    friend bool operator==(const SeenBeside& a, const SeenBeside& b) {
        return a.field == b.field && a.above == b.above && a.below == b.below && a.in_cells == b.in_cells;
    }
};

struct VisibilityQuery {
    /// Of the field's group. Null: every value is visible (scalar modes).
    const TransferFunction* transfer_function = nullptr;
    /// The weight sum is needed where something is visible: kernels of value 0 are drawn too. Normalisation threshold
    /// implies it. A coverage output needs the weights everywhere: cull = false.
    bool weights_matter = false;
    /// What kernels add to the weight sum says which points are not empty, and that decides what is seen there: kernels
    /// that add nothing to sums (of value 0, of weight 0) are drawn where something beside them is visible.
    bool reach_matters = false;
    bool cull = true; ///< false: every kernel is drawn
    /// Isosurface: visible is where two points of a pixel's ray lie on different sides of one of iso_values; then the
    /// transfer function is not used.
    bool isosurface = false;
    std::vector<double> iso_values;
    /// Lattices of the same samples: unless there are none, only kernels matter that may share a visible point with one
    /// of the samples that are said (labels, and fields that give colours: conventions, section 4).
    std::vector<SeenBeside> only_near;
    bool alone = true; ///< false: other fields add to this one, so that only kernels that add nothing can be dropped
    /// Values between slices are looked at too, on cubics through four slices (conventions, second order): up to
    /// 9/16 + 9/16 + 1/16 + 1/16 times as large as the largest absolute value there.
    bool cubic = false;
    /// 0: no filter. >= 1: a filter widens kernels at the same mass, by widths that differ from kernel to kernel (with
    /// depth, in perspective) and so raise sums over the lattice by at most this factor.
    double filter_gain = 0.0;
    /// World units, >= 0: how far a visible point may lie from the supports of kernels that matter to it. The sum of
    /// what stencils of gradients, crossings, pre-integrated intervals and slabs reach, and of twice what a filter
    /// widens a support by. In perspective a step of depth runs along the ray and is as much longer.
    double reach_world = 0.0;
};

/// Where something becomes visible on the way from 0 up and down, both positive: at rho >= above, at rho <= -below.
struct VisibleFrom {
    double above, below;
};
/// For a query with a transfer function or iso values.
VisibleFrom visible_from(const VisibilityQuery& query);

/// Throws InvalidInput for a reach_world that is negative or no number.
void check_reach(const VisibilityQuery& query);

} // namespace sheetsplat

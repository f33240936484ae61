// From a plan to shader variants: which #defines and outputs each stage is compiled with. No branch on an effect is
// left in a shader.
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "gl/program.hpp"
#include "plan/make_plan.hpp"
#include "view/ellipsoid_view.hpp"
#include "view/field_view.hpp"
#include "view/slab_batches.hpp"

namespace sheetsplat::backend_gl {

/// A program's stages, before it is compiled.
struct ShaderVariant {
    std::string vertex, fragment; ///< files
    gl::Defines defines;
    std::vector<std::string> outputs; ///< of the fragment stage, in the order of their targets
};

/// Where the slices of one shading pass stand.
struct Steps {
    int slices = 4;          ///< shaded in one pass
    int slabs = 8;           ///< read in one pass
    std::int64_t passes = 0; ///< a batch is splatted and finished slices are shaded in each
    int history = 2;         ///< batches before the newest whose splats can lie in the slabs that a pass shows
    int stride = 4;          ///< slabs between two batches

    /// First slab of the array that pass `pass` reads.
    [[nodiscard]] std::int64_t first_slab(std::int64_t pass) const { return slabs == 8 ? 4 * pass - 4 : pass - 3; }
};

/// How kernels are batched for a plan.
BatchLayout make_layout(const DrawPlan& plan);

/// Radius in pixels up to which a plan draws spheres as point sprites; 0: none.
double largest_sprite(const DrawPlan& plan, const Capabilities& capabilities);

Steps make_steps(const DrawPlan& plan, const Frame& frame);

/// What one field's splats add to.
struct SplatTarget {
    int own = -1;               ///< number of the field's own sheets; -1: the sheets of its group
    bool weight = false;        ///< weights go along
    bool narrow = false;        ///< one sheet instead of two
    bool weights_alone = false; ///< the second splat pass where changes are splatted: weights, and theirs
    std::size_t group = 0;      ///< of groups_drawn
    std::size_t field = 0;
};
/// Changes along x, y and z are splatted beside the sums: differences between neighbours, or derivatives.
bool splats_slopes(const DrawPlan& plan);
/// How the values of each field are counted in the sheets that it is splatted to, in the scalar's unit. A group's rho
/// is shaded less the sum of the pivots, which group_pivots has.
std::vector<Counting> counting_of(const DrawPlan& plan, const Scene& scene);
std::vector<double> group_pivots(const DrawPlan& plan, const Scene& scene);
gl::Defines splat_defines(const DrawPlan& plan, const FieldView& view, const SplatTarget& target);
gl::Defines ellipsoid_defines(const DrawPlan& plan, SectionGroup group, const SplatTarget& target);
std::vector<std::string> splat_outputs(const DrawPlan& plan, const SplatTarget& target);
/// How many of what the shading program has arrays for.
struct ShadedParts {
    std::size_t lights = 0;
    std::size_t groups = 1;     ///< that are classified apart
    std::size_t surfaces = 0;   ///< of all groups, each as many as any has; 0: one opaque surface at most
    bool ends = false;          ///< fields of groups end in different places
    bool labels = false;        ///< scalars of labels are compared
    bool serving = false;       ///< some groups give colours to others, or are compared and not shown
    bool least_weights = false; ///< points of a group of one field are empty where W is too small

    /// More than one group and one opaque surface: lib/slices_of_groups.glsl.
    [[nodiscard]] bool several() const { return groups > 1 || surfaces > 0; }
};
ShadedParts shaded_parts(const Scene& scene);
/// What lines towards lights meet in mode isosurface: sizes of the arrays of lib/light_volume.glsl.
struct LineCounts {
    std::size_t groups = 0, surfaces = 0, half_spaces = 0; ///< the last two a group, the most of any
};
LineCounts line_counts(const DrawPlan& plan, const Scene& scene);
gl::Defines shade_defines(const DrawPlan& plan, const ShadedParts& parts, int phase, const LineCounts& lines = {});
std::vector<std::string> shade_outputs(const DrawPlan& plan);

/// Offsets of the four channels' slabs from the batch's first one: in order (wide), or rotated so that slab m lies in
/// channel m mod 4 (paper). Channels beyond the slabs that a batch covers lie where no kernel reaches.
std::array<float, 4> channel_offsets(const BatchLayout& layout, std::int64_t first_slab);

} // namespace sheetsplat::backend_gl

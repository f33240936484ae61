// The numbers that turn finished slices into a picture: opacity correction, lights, gradient scales, isosurface, depth
// cue. Derived once a frame, in float64, for every backend, which only rounds them to its own number format. What is
// drawn for want of a number that a format can hold is decided here. Source: conventions, sections 4 to 7 and 10.
#pragma once

#include <vector>

#include "facts/frame.hpp"
#include "sheetsplat/camera.hpp"
#include "sheetsplat/scene.hpp"

namespace sheetsplat {

struct DrawPlan;

/// Values of rho are in the sheets' unit (DrawPlan::unit_of), lengths of gradients in reference lengths, everything
/// else in world units.
struct ShadingInputs {
    /// A directional light in eye space: unit length, towards the light.
    struct EyeLight {
        Vec3 direction{0.0}, color{0.0};
    };

    /// Opacity correction: reference lengths between two slices, at most 1e30. Larger ones change no opacity, and
    /// infinity times an opacity of 0 would be no number.
    double exponent = 1.0;
    /// Pixels are finished at this opacity; above 0 in float32 too, so that an empty pixel goes on. 1 where the plan
    /// stops nowhere.
    double opacity_stop = 1.0;
    /// What 1 in a sheet stands for in the picture's scalars: x-ray: world value times world length; else world value.
    double scalar_step = 1.0;

    /// A surface of mode isosurface.
    struct Surface {
        double value = 0.0;
        Vec3 color{0.0}; ///< the transfer function's
        double opacity = 1.0;
    };
    /// What each of groups_drawn has for itself.
    struct OfGroup {
        std::vector<Surface> surfaces;
        double weakest_gradient = 0.0; ///< g0
        double full_gradient = 1.0;    ///< g1
        /// Of a group of one field: points with a smaller W are empty. 0: those that no kernel reaches.
        double least_weight = 0.0;
        double base = 0.0; ///< of groups that end in different places, in scalar modes
    };
    std::vector<OfGroup> groups;

    std::vector<EyeLight> lights; ///< as in the scene; none where the plan has no gradient
    Material material{};          ///< shininess at most 1e30

    /// Gradients are differences of rho between neighbours times these; in perspective that across is divided by the
    /// depth.
    double gradient_across = 0.0, gradient_along = 0.0;

    /// Depth cue: the share of its colour at depth t is cue_strength clamp((t - cue_start) cue_per_depth, 0, 1).
    double cue_start = 0.0, cue_per_depth = 0.0, cue_strength = 0.0;
    Vec3 cue_color{0.0};

    /// Slice distances to the length by which faces of cuts count: those of a reference length, 1 to 1e30.
    double face_length = 1.0;

    double occlusion_strength = 0.0; ///< of ambient occlusion
};

/// pivots: what the sheets' values of each group are less by than rho, in the scalar's unit; none: 0.
ShadingInputs make_shading_inputs(const Scene& scene, const Camera& camera, const Frame& frame, const DrawPlan& plan,
                                  const std::vector<double>& pivots = {});

} // namespace sheetsplat

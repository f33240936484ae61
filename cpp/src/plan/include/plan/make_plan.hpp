// From a scene to what will run: which effects, channels, formats and passes it calls for, each with its reason.
#pragma once

#include <cstddef>
#include <cstdint>
#include <limits>
#include <string>
#include <vector>

#include "base/capabilities.hpp"
#include "facts/view_facts.hpp"
#include "sheetsplat/camera.hpp"
#include "sheetsplat/render_plan.hpp"
#include "sheetsplat/renderer.hpp"
#include "sheetsplat/scene.hpp"

namespace sheetsplat {

/// Everything that the slice loops switch on: one flag for each effect. The summary lists the effects with their
/// reasons. Ways of drawing that only OpenGL has stay off on the processor.
struct DrawPlan {
    RenderPlan summary;

    // The scene.
    Projection projection = Projection::orthographic;
    Sampling sampling = Sampling::point;
    Mode mode = Mode::composite;
    bool clip = false;        ///< points outside Scene::clip are transparent
    bool depth_limit = false; ///< points at Scene::depth_limit or behind it are transparent
    bool blank = false;       ///< clip or depth limit leave nothing: the picture is empty whatever else is on
    bool owned = false;       ///< points outside Part::cell are not drawn: they belong to other parts of a whole
    bool counts = false;      ///< the picture says which slices counted (parts, modes minimum and average)
    bool filter = false;      ///< kernels are widened by pixel and slice distance
    bool coverage = false;    ///< an output
    bool depth = false;       ///< an output

    /// Some points of slices are cut off.
    [[nodiscard]] bool cuts() const { return clip || depth_limit; }

    // Sums and their division.
    bool weight = false;    ///< sums of weights are kept
    bool threshold = false; ///< the one field is divided by its weight sum where it is shaded
    /// Points that no kernel reaches must be distinguished from points whose sum is 0; without `weight` by the places
    /// of samples, at points beside others of which some are shown.
    bool empty_test = false;
    /// Several fields: for each the number of its own sheets, where it is divided before all are added; -1: it adds to
    /// the sheets of all.
    std::vector<int> own_sheets;
    double value_unit = 1.0; ///< the amount of rho that sheets call 1; of several groups, those of the first one
    /// Several groups: the same for each field, by its group's transfer function.
    std::vector<double> field_units;
    [[nodiscard]] double unit_of(std::size_t field) const {
        return field_units.empty() ? value_unit : field_units[field];
    }
    Precision precision = Precision::float32;
    /// Root mean square error that a tile may have (conventions, section 9).
    double bound = 1e-4;
    /// Of lit pictures: error of a tile over its doubt (backend_cpu, Slab::doubt) and over the rounding of a number.
    double lit_rounding = 0.0;
    /// Modes mip and minimum: error of a shown number over the rounding of a number. What is shown may be small beside
    /// the sums that it was found among.
    double extremes_rounding = 0.0;
    double gradient_doubt = 1.0; ///< error of a slab's gradient, as it is scaled, over that of rho
    bool exact_tiles = false;    ///< tiles beyond the bound are drawn again in float64; else the picture is refused
    bool inexact = false;        ///< nothing is refused

    // Gradients and light.
    bool gradient = false;          ///< gradients are made, for light or for gradient_opacity
    bool analytic_gradient = false; ///< gradients are sums of the kernels' own derivatives
    bool fine_gradient = false;     ///< differences between neighbouring samples are splatted
    bool fine_across = false;       ///< pixels are small: differences along x and y are splatted
    bool fine_along = false;        ///< slices are close: differences over depth are splatted
    bool gradient_opacity = false;  ///< opacity is multiplied by min(1, |grad rho| / g1)
    bool lit = false;               ///< colours are multiplied by light: gradient is on too
    bool ambient_only = false; ///< with lights that change nothing: colours are multiplied by the ambient coefficient
    bool specular = false;
    bool two_sided = false;
    bool cut_faces = false; ///< where clip or ends cut what is opaque, normals are those of the cut
    bool shadows = false;
    bool ambient_occlusion = false;
    bool depth_cue = false; ///< colours fade with depth

    // Compositing.
    bool opacity_correction = false;
    bool preintegration = false;
    bool second_order = false; ///< of pre-integration
    bool stop = false;         ///< pixels end at A_stop
    bool open_front = false;   ///< isosurfaces end where the near plane cuts them: nothing crosses before slice 0
    bool read_image = false;   ///< the picture so far is an input of the shading pass
    bool compensated = false;  ///< rounding errors of the picture are carried along

    // What is skipped.
    bool culling = true; ///< kernels that cannot be seen
    bool elimination = false;
    bool opacity_buffer = false;
    Tagging tagging = Tagging::off;

    // Splatting.
    bool compute = false;      ///< tiles are drawn by compute programs, which keep their sheets on the chip
    bool ray_extremes = false; ///< modes mip and minimum: rays look up rho at slice points, and no sheets are summed
    Packing packing = Packing::wide;
    bool general = false;  ///< sections move or scale from slab to slab (perspective, leaning ellipsoids)
    bool points = true;    ///< point sprites
    bool separable = true; ///< one Gaussian on the screen serves all sections of a kernel
    /// Ellipsoids are sliced by one pass over all of them on the device, where the sections stay; else by the
    /// processor, batch by batch.
    bool resident_sections = false;
    bool precise_sections = false; ///< some ellipsoids are so slender or small that float64 places them
    bool paper_slicing = false;    ///< ellipsoids are sliced and drawn step by step as in [NM06]
    int gaussian_cells = 1024;     ///< of the texture of the Gaussian, along each axis
    /// Longest over shortest semi-axis from which on an ellipsoid is placed in float64.
    double precise_aspect = std::numeric_limits<double>::infinity();
    int slab_nodes = 0;  ///< quadrature nodes of slab means; 0: erf
    int slab_pieces = 1; ///< pieces that differences of slab means are integrated in
};

/// The plan of a scene for one backend. view: facts of the scene from this camera; capabilities: of the device, null
/// unless the backend is gl. Throws InvalidInput where options.effects has an unknown name or one that cannot be forced
/// on this backend, and Unsupported where the backend cannot render the scene within its error bound (conventions,
/// section 9).
DrawPlan make_plan(const Scene& scene, const ViewFacts& view, const RendererOptions& options, const Outputs& outputs,
                   Projection projection, Backend backend, const Capabilities* capabilities);

} // namespace sheetsplat

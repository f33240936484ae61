// From a scene to what will run: which effects, channels, formats and passes it calls for, each with its reason.
#pragma once

#include <cstdint>
#include <limits>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "base/capabilities.hpp"
#include "sheetsplat/camera.hpp"
#include "sheetsplat/render_plan.hpp"
#include "sheetsplat/renderer.hpp"
#include "sheetsplat/scene.hpp"

namespace sheetsplat {

/// What the weights m and values f of a scattered field come to: the same in every view.
struct WeightFacts {
    double low = 0.0, high = 0.0;                           ///< of m f
    double most = 0.0;                                      ///< largest m
    double least = std::numeric_limits<double>::infinity(); ///< smallest m above 0
    double alone = 0.0;                                     ///< largest |m f| / max(w0, m): one kernel's rho
};
WeightFacts survey_weights(const EllipsoidField& field);

/// Slabs this many times thicker than a leaning kernel's half-depth: beyond, float32 loses where the kernel is in them
/// (at 1e4 the 99.9th percentile was seen at 1.2e-3).
constexpr double thick_slab = 3e3;

/// What the plan needs to know of a view. Lengths in world units.
struct ViewFacts {
    Size size{};
    std::int64_t first_slice = 0;
    std::int64_t slices = 0;
    double slice_spacing = 1.0;
    double reference_length = 1.0;
    double smallest_pixel = 1.0;
    double largest_pixel = 1.0;
    double largest_slant = 1.0; ///< largest s = 1 / cos(theta) over the picture
    bool cut_by_near = false;
    bool sheared = false; ///< cross-sections of some field lean (unequal spacing, seen askew)
    double largest_splat_px =
        1.0; ///< largest radius of a kernel on the screen, pixels (perspective: at the nearest slice)
    double smallest_falloff = 8.0; ///< over the fields
    double widest_slab = 1.0;      ///< largest sqrt(k) |w| ds / h over the fields
    std::int64_t longest_span = 4; ///< most slices that one kernel meets
    bool ellipsoids = false;       ///< some field is scattered
    double largest_aspect = 1.0;   ///< longest over shortest semi-axis of one ellipsoid
    /// Smallest semi-axis of an ellipsoid in pixels at its centre's depth.
    double smallest_px = std::numeric_limits<double>::infinity();
    std::size_t most_ellipsoids = 0; ///< kernels of the largest scattered field
    std::size_t unresolved = 0;      ///< ellipsoids smaller than a pixel or thinner than a slice distance
    double largest_filtering = 0.0;  ///< largest square of pixel or slice distance over a semi-axis
    double largest_overlap = 33.5;   ///< kernels that overlap at a point: a bound or an estimate
    double densest_overlap = 0.0;    ///< the same of scattered kernels where they are densest: an estimate
    double most_alike = 0.0;         ///< ellipsoids of one size at one place
    /// Longest semi-axis of an ellipsoid in pixels; in perspective in those at a distance of one unit of length.
    double largest_px = 0.0;
    double thin_loss = 0.0; ///< of leaning ellipsoids thinner than 1 / thick_slab: see survey_slabs
    double thin_peak = 0.0;
    double largest_weight = 1.0;
    /// Longest semi-axis of an ellipsoid in pixels of the nearest slice.
    double largest_radius_px = 0.0;
    /// Smallest semi-axis of any kernel in pixels, lattices included.
    double smallest_radius_px = std::numeric_limits<double>::infinity();
    double thickest_slab = 0.0; ///< sampling slab: largest ds / h of any kernel, or a bound of it
    std::size_t kernels = 0;    ///< of all fields
    /// What is known of weighted fields; of others it is looked for in all kernels.
    std::map<const Field*, WeightFacts> weights{};
    /// What is known of lattices: largest W / C; of others it is computed.
    std::map<const Field*, double> lattice_peaks{};
    /// Depths between which slices, slabs and crossings lie, world units.
    double nearest_depth = -std::numeric_limits<double>::infinity();
    double farthest_depth = std::numeric_limits<double>::infinity();
};

/// Everything that the slice loops switch on. One flag an effect; the summary lists them with reasons. What is a way of
/// drawing on GL stays off on the processor.
struct DrawPlan {
    RenderPlan summary;
    Projection projection = Projection::orthographic;
    Sampling sampling = Sampling::point;
    Mode mode = Mode::composite;
    bool weight = false;
    bool empty_test =
        false;              ///< opacity at 0 > 0: points that no kernel reaches must be told from points whose sum is 0
    bool threshold = false; ///< the one field is divided by its weight sum where it is shaded
    /// Several fields: for each the number of its own sheets, where it is divided before all are added; -1: it adds to
    /// the sheets of all.
    std::vector<int> own_sheets;
    /// Ellipsoids are sliced by one pass over all of them on the device, where the sections stay; else by the
    /// processor, batch by batch.
    bool resident_sections = false;
    bool paper_slicing = false; ///< ellipsoids are sliced and drawn step by step as in [NM06]
    int gaussian_cells = 1024;  ///< of the texture of the Gaussian, along each axis
    /// Longest over shortest semi-axis from which on an ellipsoid is placed in float64.
    double precise_aspect = std::numeric_limits<double>::infinity();
    bool filter = false;   ///< kernels are widened by pixel and slice distance
    bool gradient = false; ///< gradients are made, for light or for gradient_opacity
    bool lit = false;      ///< colours are multiplied by light: gradient is on too
    /// Lights, lit by none of which anything changes: colours are multiplied by the ambient coefficient and no more.
    bool ambient_only = false;
    bool analytic_gradient = false; ///< gradients are sums of the kernels' own derivatives
    bool gradient_opacity = false;  ///< opacity is multiplied by min(1, |grad rho| / g1)
    bool clip = false;              ///< points outside Scene::clip are transparent
    bool depth_cue = false;         ///< colours fade with depth
    bool second_order = false;      ///< of pre-integration
    bool shadows = false;
    bool ambient_occlusion = false;
    bool blank = false; ///< the clip leaves nothing: the picture is empty whatever else is on
    bool specular = false;
    bool two_sided = false;
    bool opacity_correction = false;
    bool preintegration = false;
    bool stop = false;       ///< A_stop is looked at
    bool read_image = false; ///< the picture so far is an input of the shading pass
    bool elimination = false;
    bool opacity_buffer = false;
    bool coverage = false;
    bool depth = false;
    bool compensated = false; ///< rounding errors of the picture are carried along
    bool general = false;     ///< sections move or scale from slab to slab (perspective, leaning ellipsoids)
    bool points = true;
    bool separable = true; ///< one Gaussian on the screen serves all sections of a kernel
    bool fine_gradient = false;
    bool fine_across = false; ///< pixels are small: differences along x and y are splatted
    bool fine_along = false;  ///< slices are close: differences over depth are splatted
    bool culling = true;
    int slab_nodes = 0;      ///< quadrature nodes of slab means; 0: erf
    int slab_pieces = 1;     ///< pieces that differences of slab means are integrated in
    double value_unit = 1.0; ///< the amount of rho that sheets call 1
    Packing packing = Packing::wide;
    Tagging tagging = Tagging::off;
    Precision precision = Precision::float32;
};

/// The radius in unit-sphere space and the like are the caller's; this decides. capabilities: null for backend
/// reference. Throws InvalidInput for names of effects that do not exist; Unsupported for what this backend cannot do
/// within its bound.
DrawPlan make_plan(const Scene& scene, const ViewFacts& view, const RendererOptions& options, const Outputs& outputs,
                   Projection projection, Backend backend, const Capabilities* capabilities);

} // namespace sheetsplat

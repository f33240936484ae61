// The plan of backend gl: ways of drawing, sheets and their precision.
#include <algorithm>
#include <cmath>
#include <cstdlib>

#include "bounds_gl.hpp"
#include "error_model.hpp"
#include "parts.hpp"
#include "plan/compute_path.hpp"
#include "plan/limits_gl.hpp"
#include "plan/pivot.hpp"
#include "plan/slab_nodes.hpp"
#include "scene/mode_rules.hpp"
#include "sheetsplat/error.hpp"

namespace sheetsplat {

using namespace gl_limits;

namespace {

Tagging choose_tagging(const RendererOptions& options, const Capabilities& capabilities) {
    if (options.tagging == Tagging::depth_bounds && !capabilities.depth_bounds) {
        throw Unsupported(Complaint{
            "the plan cannot be made",
            "tagging depth_bounds on " + capabilities.renderer + ", which lacks GL_EXT_depth_bounds_test",
            "a device that has it",
            "use another " + option_ref("tagging") + ", for example " + option_ref("tagging", "tiles"), "tagging"});
    }
    if (options.tagging != Tagging::automatic) {
        return options.tagging;
    }
    return capabilities.depth_bounds && !capabilities.software ? Tagging::depth_bounds : Tagging::tiles;
}

const char* why_tagged(Tagging tagging) {
    return tagging == Tagging::depth_bounds  ? "the depth buffer marks touched pixels, and the device tests its bounds"
           : tagging == Tagging::depth_equal ? "the depth buffer marks touched pixels, and passes test for equal depth"
           : tagging == Tagging::tiles       ? "each pass draws only the tiles that kernels touch"
                                             : "turned off: each pass draws the whole picture";
}

/// The option, or the environment's choice where it is automatic.
Path requested_path(Path option) {
    const char* name = std::getenv("SHEETSPLAT_GL_PATH");
    if (option != Path::automatic || name == nullptr || *name == '\0') {
        return option;
    }
    for (const Path path : {Path::automatic, Path::raster, Path::compute}) {
        if (std::string(name) == to_string(path)) {
            return path;
        }
    }
    throw InvalidInput(Complaint{"the plan cannot be made", std::string("SHEETSPLAT_GL_PATH=") + name,
                                 "auto, raster or compute", "correct the environment variable, or unset it"});
}

/// Whether compute programs draw what they can.
bool prefers_compute(const RendererOptions& options, const Capabilities& capabilities, const ViewFacts& view) {
    if (capabilities.compute_memory == 0 || options.packing == Packing::paper) {
        return false;
    }
    const Path path = requested_path(options.path);
    const auto& seconds = capabilities.rates.of(view.kernels.ellipsoids);
    const bool faster = capabilities.rates.known ? seconds[DeviceRates::compute] < seconds[DeviceRates::raster]
                                                 : !capabilities.software;
    return path == Path::compute || (path == Path::automatic && faster);
}

/// Which fields have sheets of their own, and how slabs are packed into channels.
void plan_sheets(const Scene& scene, const ViewFacts& view, const RendererOptions& options, const Outputs& outputs,
                 const Capabilities& capabilities, Effects& effects, DrawPlan& plan) {
    const bool groups = groups_drawn(scene).size() > 1;
    // In sheets of their own, quotients and their derivatives are taken before slabs are shaded, and values are counted
    // from their middle, which keeps the digits that differences need: but where they come to less from 0, as of
    // weights far below w0. Shading divides by one w0 at most.
    const bool lit = lights_quotients(plan) && !plan.fine_gradient && !effects.forced_on(EffectId::paper_slicing);
    const SumFacts sums = lit ? sum_facts(scene, view, plan) : SumFacts{};
    const bool counted = lit && ratio_from_pivots(scene, plan, sums.resolved) <= sums.ratio;
    divide_apart(scene, outputs, effects, plan, counted || plan.analytic_gradient || groups);
    if (plan.fine_gradient && !plan.own_sheets.empty()) {
        throw Unsupported(
            Complaint{"the scene cannot be drawn with backend gl",
                      "a lit close-up of several fields, one with " + option_ref("normalization", "threshold") +
                          ", whose pixels or slices are closer "
                          "than an eighth of the reference length",
                      "such a close-up of one field, or of fields with " + option_ref("normalization", "none") +
                          " or " + option_ref("normalization", "lattice"),
                      "use " + option_ref("gradient", "analytic") + ", a larger " + option_ref("slice_spacing") +
                          " or a smaller " + option_ref("reference_length")});
    }
    // Differences of values and of weights of two sheets at once would take more texture units than every device has.
    // (Compute programs keep sheets in shared memory.)
    const bool computes = capabilities.max_texture_units > 20 && prefers_compute(options, capabilities, view);
    const bool crowded = plan.fine_gradient && plan.threshold && !computes;
    plan.packing = options.packing == Packing::automatic ? crowded ? Packing::paper : Packing::wide : options.packing;
    if (groups && plan.packing == Packing::paper) {
        throw Unsupported(Complaint{"the plan cannot be made",
                                    "packing paper for " + text_of_count(groups_drawn(scene).size()) +
                                        " transfer functions: its buffers hold one sum of values",
                                    option_ref("packing", "auto") + " or " + option_ref("packing", "wide"),
                                    "leave out " + option_ref("packing"), "packing"});
    }
    if (crowded && plan.packing == Packing::wide && capabilities.max_texture_units <= 20) {
        throw Unsupported(Complaint{
            "the plan cannot be made",
            "packing wide for a close-up of a field with normalization threshold, which needs 21 texture units of " +
                std::to_string(capabilities.max_texture_units),
            option_ref("packing", "auto") + " or " + option_ref("packing", "paper"),
            "leave out " + option_ref("packing"), "packing"});
    }
}

/// What is skipped: kernels that cannot be seen, and what opaque pixels hide.
void plan_skipping(const Scene& scene, const ViewFacts& view, const Outputs& outputs, const Capabilities& capabilities,
                   const SceneCalls& calls, Effects& effects, DrawPlan& plan) {
    plan.culling = effects.decide(EffectId::culling, true, "kernels that cannot be seen are skipped");
    const bool possible = calls.stops && !outputs.coverage;
    // On a rasteriser in software depth tests cost more than they save, unless pixels become opaque within few slices.
    const bool soon = shows_surfaces(scene.mode) || saturates_within(scene, view, soon_opaque_slices, calls.opacity);
    const bool eliminate = possible && (!capabilities.software || soon);
    plan.elimination = effects.decide(EffectId::elimination, eliminate,
                                      !calls.stops       ? "no pixel can become opaque enough to stop"
                                      : outputs.coverage ? "coverage counts kernels behind opaque pixels"
                                      : eliminate        ? "opaque pixels are skipped by the depth test"
                                                         : "depth tests cost more than they save on this device") &&
                       possible;
    plan.opacity_buffer =
        effects.decide(EffectId::opacity_buffer, false, "reading opacities back usually costs more than it saves") &&
        possible;
}

/// [NM06] step by step.
void plan_paper_slicing(const Scene& scene, const ViewFacts& view, const RendererOptions& options, Effects& effects,
                        DrawPlan& plan) {
    plan.paper_slicing =
        effects.decide(EffectId::paper_slicing, false, "not asked for: it draws the same picture, for comparison");
    if (!plan.paper_slicing) {
        return;
    }
    check_paper_slicing(view, options, effects, plan);
    double falloff = 8.0;
    for (const auto& field : scene.fields) {
        falloff = as_ellipsoids(field.get()) != nullptr ? std::max(falloff, field->kernel().falloff) : falloff;
    }
    plan.packing = Packing::paper;
    plan.gaussian_cells = static_cast<int>(std::ceil(paper_cells_at_8 * std::sqrt(falloff / 8.0)));
    const std::string texels = std::to_string(plan.gaussian_cells + 1);
    plan.summary.error_budget.push_back(
        {"the Gaussian as a texture of " + texels + " x " + texels,
         0.5 * falloff / (static_cast<double>(plan.gaussian_cells) * plan.gaussian_cells),
         name_of(EffectId::paper_slicing)});
}

/// True where groups with units of their own hold the same field.
bool shares_fields(const Scene& scene, const DrawPlan& plan) {
    return !plan.field_units.empty() &&
           std::any_of(scene.fields.begin(), scene.fields.end(), [&](const std::shared_ptr<const Field>& field) {
               return std::count(scene.fields.begin(), scene.fields.end(), field) > 1;
           });
}

/// How sections of kernels are drawn and placed.
void plan_sections(const Scene& scene, const ViewFacts& view, const Capabilities& capabilities, const SceneCalls& calls,
                   Effects& effects, DrawPlan& plan) {
    const bool perspective = plan.projection == Projection::perspective;
    const bool sprites =
        !perspective && 2.0 * view.screen_px.largest_lattice + 1.0 <= static_cast<double>(capabilities.max_point_size);
    const bool slopes = plan.fine_gradient || plan.analytic_gradient;
    const bool point_sampled = plan.sampling == Sampling::point && !slopes;
    plan.points = sprites && (calls.lattices || (calls.spheres && point_sampled));
    effects.state(EffectId::points, plan.points,
                  perspective      ? "kernels differ in size on the screen: quads fit them"
                  : !sprites       ? "kernels are larger than the largest point sprite: quads"
                  : calls.lattices ? "point sprites need one vertex a kernel"
                  : plan.points    ? "spheres that are small enough are point sprites of one vertex each"
                                   : "ellipsoids are drawn as rectangles along the axes of their sections");
    plan.separable = !plan.general && point_sampled && view.screen_px.largest_lattice < largest_separable_px;
    const bool slender = view.shapes.largest_aspect > least_precise_aspect;
    const bool tiny = !plan.filter && view.screen_px.smallest_ellipsoid < least_plain_px;
    const bool exact_places = (slender || tiny) && capabilities.at_least(4, 0);
    const bool precise =
        effects.decide(EffectId::precise_sections, exact_places,
                       !view.kernels.ellipsoids ? "no field holds ellipsoids"
                       : !slender && !tiny      ? "float32 resolves the sections of all ellipsoids"
                       : !exact_places          ? "OpenGL " + capabilities.version + " has no float64"
                       : tiny ? "ellipsoids of less than " + number(least_plain_px) + " pixels are placed in float64"
                              : "ellipsoids of more than 1:" + number(least_precise_aspect) + " are placed in float64",
                       true);
    if (precise && exact_places) {
        plan.precise_aspect = least_precise_aspect;
    }
    const std::string kernels_of_aspect = "kernels of 1:" + number(view.shapes.largest_aspect);
    const std::string why_not =
        plan.filter                    ? "filtered kernels are sliced by the processor"
        : !view.kernels.ellipsoids     ? "no field holds ellipsoids"
        : plan.paper_slicing           ? "kernels are sliced as in the 2006 paper"
        : shares_fields(scene, plan)   ? "a field that two groups hold has other sections in each"
        : !capabilities.at_least(4, 1) ? "OpenGL " + capabilities.version + " has no float64 vertex programs"
        : tiny
            ? "kernels of less than " + number(least_plain_px) + " pixels are sliced for each batch, to keep precision"
        : view.shapes.largest_aspect > largest_resident_aspect
            ? kernels_of_aspect + " are sliced for each batch, to keep precision"
        : view.kernels.most_ellipsoids > most_resident_kernels
            ? kernels(view.kernels.most_ellipsoids) + " are sliced batch by batch, in bounded memory"
            : "";
    plan.resident_sections = effects.decide(
        EffectId::resident_sections, why_not.empty() && !capabilities.software,
        !why_not.empty()        ? why_not
        : capabilities.software ? "a device in software slices no faster than the processor that it runs on"
                                : "one pass on the device slices all kernels: nothing is uploaded or read back");
    if (plan.resident_sections && !why_not.empty()) {
        throw Unsupported(Complaint{"the plan cannot be made", "resident_sections forced on: " + why_not,
                                    "ellipsoids that the device can slice", "leave it out of " + option_ref("effects"),
                                    "effects"});
    }
    plan.slab_nodes = slab_nodes(view.slabs.widest);
    plan.slab_pieces = slab_pieces(view.slabs.widest);
}

/// The precision of the sheets and of the picture.
void plan_precision(const Scene& scene, const ViewFacts& view, const RendererOptions& options,
                    const Capabilities& capabilities, Effects& effects, DrawPlan& plan) {
    const std::string why_not = why_float32(scene, view, capabilities, plan);
    if (options.precision == Precision::automatic && why_not.empty()) {
        plan.precision = Precision::float16;
    }
    effects.state(EffectId::float16, plan.precision == Precision::float16,
                  options.precision != Precision::automatic
                      ? std::string("precision ") + to_string(options.precision) + " was asked for"
                  : why_not.empty()
                      ? "16 bits keep their bound over the whole picture, and this device is faster with them"
                      : why_not);
    check_precision(scene, view, options, capabilities, plan);
    effects.state(EffectId::sums, true, std::string("kernels are summed in sheets of ") + to_string(plan.precision));
}

std::string milliseconds(double seconds) { return std::isfinite(seconds) ? number(1e3 * seconds) + " ms" : "failed"; }

/// What was asked for that raster passes alone have; "" where nothing was.
std::string why_raster_was_asked_for(const RendererOptions& options, const Effects& effects) {
    if (options.tagging != Tagging::automatic) {
        return std::string("tagging ") + to_string(options.tagging) + " belongs to raster passes";
    }
    for (const EffectId effect : {EffectId::elimination, EffectId::resident_sections}) {
        if (effects.forced_off(effect)) {
            return std::string("effect ") + name_of(effect) + ", forced off, can be left out by raster passes alone";
        }
    }
    return "";
}

/// What compute programs do in place of the ways of raster passes that were decided before.
void restate_computed(const ViewFacts& view, const DrawPlan& plan, Effects& effects) {
    effects.restate(EffectId::tagging, true, "each tile reads only the kernels that reach it");
    if ((plan.stop || shows_surfaces(plan.mode)) && !plan.coverage) {
        effects.restate(EffectId::elimination, true, "tiles end when all of their pixels are opaque");
    }
    effects.restate(EffectId::points, false, "compute programs draw no primitives");
    effects.restate(EffectId::precise_sections, plan.precise_sections,
                    plan.precise_sections      ? "ellipsoids are placed in float64"
                    : !view.kernels.ellipsoids ? "no field holds ellipsoids"
                                               : "float32 resolves the sections of all ellipsoids");
    effects.restate(EffectId::resident_sections, view.kernels.ellipsoids,
                    !view.kernels.ellipsoids ? "no field holds ellipsoids"
                    : plan.filter            ? "the processor slices filtered kernels once a view, and uploads them"
                                             : "one pass on the device slices all kernels");
}

/// Whether compute programs draw the tiles.
void plan_path(const Scene& scene, const ViewFacts& view, const RendererOptions& options,
               const Capabilities& capabilities, Effects& effects, DrawPlan& plan) {
    const std::string asked = why_raster_was_asked_for(options, effects);
    std::string why_not = asked.empty() ? why_not_computed(scene, capabilities, plan) : asked;
    // Where compute programs were not asked for by the caller, what they may refuse later is drawn by raster passes.
    if (why_not.empty() && options.path != Path::compute) {
        why_not = why_too_many(scene, capabilities);
    }
    if (options.path == Path::compute && !why_not.empty()) {
        throw Unsupported(Complaint{"the plan cannot be made", option_ref("path", "compute") + ": " + why_not,
                                    "a scene that compute programs draw", "use " + option_ref("path", "auto"), "path"});
    }
    const Path path = requested_path(options.path);
    const auto& seconds = capabilities.rates.of(view.kernels.ellipsoids);
    plan.compute = why_not.empty() && prefers_compute(options, capabilities, view);
    effects.state(EffectId::computed_tiles, plan.compute,
                  !why_not.empty()           ? why_not
                  : path != Path::automatic  ? std::string("path ") + to_string(path) + " was asked for"
                  : capabilities.rates.known ? "measured on this device, small pictures: compute " +
                                                   milliseconds(seconds[DeviceRates::compute]) + ", raster " +
                                                   milliseconds(seconds[DeviceRates::raster]) + ", processor " +
                                                   milliseconds(seconds[DeviceRates::processor])
                  : plan.compute ? "the device is hardware: its compute units sum kernels faster than its rasteriser"
                                 : "software draws raster passes faster than compute programs");
    if (plan.compute) {
        plan.precise_sections =
            (view.kernels.ellipsoids || plan.filter) &&
            (view.shapes.largest_aspect > largest_resident_aspect ||
             view.screen_px.smallest_ellipsoid < least_plain_px || effects.forced_on(EffectId::precise_sections));
        plan.resident_sections = true;
        plan.elimination = false;
        plan.tagging = Tagging::off;
        plan.points = false;
        restate_computed(view, plan, effects);
    }
}

std::uint64_t memory_of(const Scene& scene, const ViewFacts& view, const DrawPlan& plan) {
    const bool slopes = plan.fine_gradient || plan.analytic_gradient;
    const bool wide = plan.packing == Packing::wide;
    const std::uint64_t texel = plan.precision == Precision::float32   ? 16
                                : plan.precision == Precision::float16 ? 8
                                                                       : 4;
    const auto own = static_cast<std::uint64_t>(
        std::count_if(plan.own_sheets.begin(), plan.own_sheets.end(), [](int number) { return number >= 0; }));
    const std::uint64_t values = slopes ? 4 : 1;
    const std::uint64_t weights = !plan.weight ? 0 : slopes && plan.threshold ? 4 : 1;
    const std::uint64_t sheets = plan.compute ? 0
                                              : groups_drawn(scene).size() * (wide ? 3U : 2U) * (values + weights) +
                                                    own * (wide ? 3U : 1U) * (slopes ? 8U : 2U);
    const std::uint64_t faces = plan.cut_faces ? 16 * groups_drawn(scene).size() : 0;
    return static_cast<std::uint64_t>(view.frame.size.width + 2) *
           static_cast<std::uint64_t>(view.frame.size.height + 2) * (sheets * texel + faces + 16 + 4 + 16);
}

} // namespace

void plan_gl(const PlanInputs& inputs, Effects& effects, DrawPlan& plan) {
    const auto& [scene, view, options, outputs, device, calls] = inputs;
    const Capabilities& capabilities = *device;
    plan_sheets(scene, view, options, outputs, capabilities, effects, plan);
    plan.tagging = choose_tagging(options, capabilities);
    effects.state(EffectId::tagging, plan.tagging != Tagging::off, why_tagged(plan.tagging));
    plan.precision = options.precision == Precision::automatic ? Precision::float32 : options.precision;
    if (plan.precision == Precision::float64) {
        throw Unsupported(Complaint{"the plan cannot be made",
                                    "precision float64 with backend gl, whose targets blend 32 bits at most",
                                    "auto, uint8, float16 or float32", "", "precision"});
    }
    plan_skipping(scene, view, outputs, capabilities, calls, effects, plan);
    plan_paper_slicing(scene, view, options, effects, plan);
    plan_sections(scene, view, capabilities, calls, effects, plan);
    const bool many = view.frame.slices > most_plain_slices && is_composited(scene.mode);
    plan.compensated = effects.decide(EffectId::compensation, many,
                                      many ? "plain float32 sums over so many slices would drift"
                                           : "plain float32 sums over these slices are accurate enough",
                                      true) &&
                       is_composited(scene.mode);
    plan.read_image = plan.compensated || plan.stop || shows_surfaces(scene.mode) || is_scalar(scene.mode) ||
                      plan.depth || plan.coverage || plan.cut_faces;
    check_coverage(scene, plan);
    if (!options.allow_inexact) {
        effects.refuse_dropped();
    }
    plan_precision(scene, view, options, capabilities, effects, plan);
    plan_path(scene, view, options, capabilities, effects, plan);
    if (plan.precision == Precision::float32 && !options.allow_inexact) {
        const SumFacts sums = sum_facts(scene, view, plan);
        plan.bound = bound_of(view, sums);
        plan.lit_rounding = plan.lit ? lit_rounding(scene, view, plan, sums, counts_from_pivots(plan)) : 0.0;
        plan.extremes_rounding = extremes_rounding(plan.mode, sums);
    }

    RenderPlan& summary = plan.summary;
    summary.precision = plan.precision;
    summary.packing = plan.packing;
    summary.tagging = plan.tagging;
    summary.path = plan.compute ? Path::compute : Path::raster;
    summary.device = capabilities.renderer + ", OpenGL " + capabilities.version + ", by " + capabilities.platform;
    summary.memory = memory_of(scene, view, plan);
}

} // namespace sheetsplat

// The plan of backend cpu: no ways of drawing to choose from, and float64 where float32 would not keep its bound.
#include <algorithm>
#include <array>
#include <cmath>

#include "facts/extreme_blocks.hpp"
#include "limits.hpp"
#include "parts.hpp"
#include "plan/tells_empty.hpp"
#include "scene/mode_rules.hpp"
#include "sheetsplat/error.hpp"

namespace sheetsplat {

namespace {

/// Gaussians of a column each follow from the one before: relative error, as seen. Test:
/// PlanOfCpu.ErrorsExpectedOfScatteredKernels.
constexpr double walked_noise = 2e-7;
/// Bytes of a kernel while it is drawn: a flag, and its place in the lists of one or two tiles. Test:
/// PlanOfCpu.CountsItsMemory.
constexpr std::uint64_t kernel_bytes = 24;

// ---- ways of drawing: speed alone (test: PlanOfCpu.ExtremesAreLookedUpWhereThatTakesLess)

/// Seconds, one thread. Modes mip and minimum by rays: a slice point whose bound is asked for, one that is looked up,
/// by samples that are read for it. By sheets: a kernel, a section of it, and a pixel of a section.
constexpr double asked_seconds = 1.5e-9;
constexpr double looked_up_seconds = 30e-9, looked_up_sample_seconds = 1.1e-9;
constexpr double kernel_seconds = 20e-9, section_seconds = 25e-9, splat_seconds = 0.4e-9;
/// Mode minimum by sheets: a slice point, which counts whether anything is drawn there or not.
constexpr double counted_seconds = 1e-9;
/// The same over that where sections lean or scale from slab to slab.
constexpr double general_price = 2.0;

/// Ways of drawing that only backend gl has.
void refuse_ways_of_gl(const RendererOptions& options) {
    if (options.tagging != Tagging::automatic && options.tagging != Tagging::tiles) {
        throw Unsupported(Complaint{"the plan cannot be made",
                                    std::string("tagging ") + to_string(options.tagging) + " with backend cpu",
                                    "auto or tiles, the one way in which it skips empty space",
                                    "leave out " + option_ref("tagging"), "tagging"});
    }
    if (options.packing == Packing::paper) {
        throw Unsupported(Complaint{"the plan cannot be made", "packing paper with backend cpu",
                                    "auto or wide: slices are not packed into colour channels",
                                    "leave out " + option_ref("packing"), "packing"});
    }
    if (options.path != Path::automatic) {
        throw Unsupported(Complaint{"the plan cannot be made",
                                    std::string("path ") + to_string(options.path) + " with backend cpu",
                                    "auto: it has one way of drawing", "leave out " + option_ref("path"), "path"});
    }
    if (options.precision == Precision::float16 || options.precision == Precision::uint8) {
        throw Unsupported(Complaint{"the plan cannot be made",
                                    std::string("precision ") + to_string(options.precision) + " with backend cpu",
                                    "auto, float32 or float64", "", "precision"});
    }
}

/// Bytes of the grids on which light is kept, with a step of a slice distance, as far as they may grow.
double memory_of_light(const Scene& scene, const ViewFacts& view, const DrawPlan& plan) {
    double elements = 1.0;
    const Vec3 extent = scene.centres_world().extent();
    for (int axis = 0; axis < 3; ++axis) {
        elements *= extent[axis] / std::max(view.frame.slice_spacing, view.frame.smallest_pixel) + 8.0;
    }
    // A grid that is not along the world's axes is larger.
    elements *= 2.0;
    if (shows_surfaces(plan.mode)) {
        // rho, on a grid of half the step.
        const double most = std::min(8.0 * elements, static_cast<double>(most_light_elements));
        return sizeof(float) * std::min(most * static_cast<double>(scene.later_groups.size() + 1),
                                        static_cast<double>(most_light_elements_of_all));
    }
    const auto at_most = [&](std::int64_t most) { return std::min(elements, static_cast<double>(most)); };
    const double of_lights =
        plan.shadows ? at_most(most_light_elements) * static_cast<double>(scene.lights.size()) : 0.0;
    const double of_occlusion = plan.ambient_occlusion ? at_most(most_occlusion_elements) : 0.0;
    return sizeof(float) * std::min(of_lights + of_occlusion, static_cast<double>(most_light_elements_of_all));
}

std::uint64_t memory_of(const Scene& scene, const ViewFacts& view, const DrawPlan& plan) {
    const std::uint64_t pixels =
        static_cast<std::uint64_t>(view.frame.size.width) * static_cast<std::uint64_t>(view.frame.size.height);
    const std::uint64_t channels = 4U + (plan.coverage ? 1U : 0U) + (plan.depth ? 1U : 0U);
    const std::uint64_t light =
        plan.shadows || plan.ambient_occlusion ? static_cast<std::uint64_t>(memory_of_light(scene, view, plan)) : 0;
    return pixels * channels * sizeof(float) + view.kernels.all * kernel_bytes + light;
}

/// Seconds for each slice point of a lattice, on one thread, by rays that look up a share of them and by sheets of the
/// samples that are not 0.
struct SecondsOfExtremes {
    double by_rays, by_sheets;
};
SecondsOfExtremes seconds_of_extremes(const RegularField& field, const ViewFacts& view, bool general) {
    const ExtremeFacts& extremes = *view.extremes;
    const double radius = field.options().radius;
    const double window = 2.0 * std::max(2.0, std::ceil(radius));
    const double cell = field.step_volume();
    const double kernels =
        extremes.drawn * view.frame.smallest_pixel * view.frame.largest_pixel * view.frame.slice_spacing / cell;
    const double sections = 1.0 + 2.0 * radius * std::cbrt(cell) / view.frame.slice_spacing;
    const double overlaps = extremes.drawn * 4.0 / 3.0 * 3.14159265358979323846 * radius * radius * radius;
    return {extremes.asked * asked_seconds +
                extremes.left * (looked_up_seconds + looked_up_sample_seconds * window * window * window),
            counted_seconds + (general ? general_price : 1.0) *
                                  (kernels * (kernel_seconds + sections * section_seconds) + splat_seconds * overlaps)};
}

/// Modes mip and minimum by rays in place of sheets.
void plan_extremes(const Scene& scene, const ViewFacts& view, Effects& effects, DrawPlan& plan) {
    const std::string why_not = !has_bounds(plan.mode)    ? "the mode shows no maximum or minimum"
                                : scene.fields.size() > 1 ? "there are several fields"
                                : !view.extremes          ? "rho has no bounds by blocks: they are those of "
                                                            "Cartesian lattices without a division by weights"
                                                            ", of a radius of at most " +
                                                       number(ExtremeBlocks::largest_radius)
                                : plan.sampling != Sampling::point ? "slices are means over slabs"
                                : plan.owned                       ? "a part of a whole is drawn"
                                : plan.filter                      ? "the filter widens kernels"
                                : plan.coverage || plan.weight     ? "weights are summed"
                                : view.frame.slices == 0           ? "there are no slices"
                                                                   : "";
    if (!why_not.empty()) {
        plan.ray_extremes = effects.decide_given(EffectId::ray_extremes, false, false, why_not);
        return;
    }
    const SecondsOfExtremes seconds = seconds_of_extremes(*as_regular(scene.fields.front().get()), view, plan.general);
    const bool less = seconds.by_rays <= seconds.by_sheets;
    plan.ray_extremes = effects.decide(
        EffectId::ray_extremes, less,
        "bounds of blocks leave " + number(std::round(100.0 * view.extremes->left)) +
            " % of the slice points of a few rays, and " + number(std::round(100.0 * view.extremes->drawn)) +
            " % of the samples beside them differ from the base: " + (less ? "looking these up" : "summing sheets") +
            " takes less time");
}

} // namespace

void plan_cpu(const PlanInputs& inputs, Effects& effects, DrawPlan& plan) {
    const auto& [scene, view, options, outputs, capabilities, calls] = inputs;
    refuse_ways_of_gl(options);
    divide_apart(scene, outputs, effects, plan);
    plan.culling = effects.decide(EffectId::culling, true, "kernels that cannot be seen are skipped");
    plan.points = false;
    plan.separable = false;
    // A gradient that was forced on and that nothing asks for changes nothing.
    plan.gradient = plan.lit || plan.gradient_opacity;
    plan.packing = Packing::wide;
    plan.tagging = Tagging::tiles;
    const bool ends = plan.stop || shows_surfaces(plan.mode);
    effects.state(EffectId::elimination, ends, "rows, blocks and tiles whose pixels are all opaque are skipped",
                  "no pixel can become opaque enough to stop");
    effects.state(EffectId::opacity_buffer, false, "opaque blocks and tiles are skipped without a buffer");
    effects.state(EffectId::tagging, true, "tiles: pixels that no kernel of a tile touches are skipped");

    plan_extremes(scene, view, effects, plan);

    const SumFacts sums = sum_facts(scene, view, plan);
    const std::optional<Beyond> beyond = first_beyond({scene, view, plan, sums}, Way::float32);
    const std::string why = !beyond ? "" : beyond->found + " (float32: " + beyond->wanted + ")";
    const bool asked = options.precision == Precision::float64;
    const bool kept = options.precision == Precision::float32;
    plan.precision = asked || (!kept && !why.empty()) ? Precision::float64 : Precision::float32;
    plan.bound = bound_of(view, sums);
    plan.lit_rounding = plan.lit ? lit_rounding(scene, view, plan, sums, true) : 0.0;
    plan.extremes_rounding = extremes_rounding(plan.mode, sums);
    plan.inexact = options.allow_inexact;
    plan.exact_tiles = plan.precision == Precision::float32 && !kept;
    effects.state(EffectId::float64, plan.precision == Precision::float64,
                  asked          ? "precision float64 was asked for"
                  : !why.empty() ? why
                  : plan.lit     ? "float32 keeps the error bound, but for tiles whose light would show its rounding"
                                 : "float32 keeps the error bound");
    if (!options.allow_inexact) {
        effects.refuse_dropped();
        refuse_beyond({scene, view, plan, sums, float64_epsilon}, Way::float64, false);
        if (kept && !why.empty()) {
            throw Unsupported(
                Complaint{"the picture cannot be made within its error bound with precision float32", why,
                          option_ref("precision", "float64"),
                          "leave out " + option_ref("precision") + ", or pass " + option_ref("allow_inexact", "true"),
                          "precision"});
        }
    }

    RenderPlan& summary = plan.summary;
    expect_errors(view, sums, sum_noise(plan.precision, false, sums.crowd), plan);
    if (view.kernels.ellipsoids && plan.precision == Precision::float32) {
        summary.error_budget.push_back({"Gaussians computed from their neighbours",
                                        walked_noise * sums.ratio * sums.bend, name_of(EffectId::scattered_kernels)});
    }
    effects.state(EffectId::sums, true, std::string("kernels are summed in ") + to_string(plan.precision));
    summary.precision = plan.precision;
    summary.packing = plan.packing;
    summary.tagging = plan.tagging;
    summary.device = "processor";
    summary.memory = memory_of(scene, view, plan);
}

} // namespace sheetsplat

// The plan of backend cpu: no ways of drawing to choose from, and float64 where float32 would not keep its bound.
#include <algorithm>
#include <array>
#include <cmath>

#include "facts/extreme_blocks.hpp"
#include "limits_cpu.hpp"
#include "parts.hpp"
#include "plan/tells_empty.hpp"
#include "scene/mode_rules.hpp"
#include "sheetsplat/error.hpp"

namespace sheetsplat {

namespace limits = cpu_limits;

namespace {

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
    if (options.precision == Precision::float16 || options.precision == Precision::uint8) {
        throw Unsupported(Complaint{"the plan cannot be made",
                                    std::string("precision ") + to_string(options.precision) + " with backend cpu",
                                    "auto, float32 or float64", "", "precision"});
    }
}

/// Error of a picture that sums add, root mean square. Errors of single slices partly cancel along a ray; what a steep
/// ramp adds, it adds at few pixels.
double picture_error(const SumFacts& sums, double epsilon) {
    return 0.25 * epsilon * std::sqrt(sums.overlap) * sums.ratio * std::min(sums.steepness, 4.0);
}

/// Least g1 of gradient opacity whose pictures keep their bound: what rounding makes of a gradient of 0 may not be
/// seen.
double least_faded(const Scene& scene, const ViewFacts& view, const SumFacts& sums, double epsilon) {
    const double shortest = view.frame.smallest_step();
    double rho = largest_rho(scene, view);
    for (const Group& group : scene.groups()) {
        rho = std::max(rho, group.transfer_function->v_max() - group.transfer_function->v_min());
    }
    return epsilon * std::sqrt(std::max(1.0, sums.overlap)) * rho / shortest / limits::least_seen;
}

/// Why float32 would not keep its bound; empty where it does.
std::string why_float64(const Scene& scene, const ViewFacts& view, const DrawPlan& plan, const SumFacts& sums) {
    if (view.kernels.all == 0 || view.frame.slices == 0) {
        return "";
    }
    if (is_composited(plan.mode) && view.frame.slices > most_plain_slices) {
        return std::to_string(view.frame.slices) + " slices would make float32 sums drift";
    }
    if (view.shapes.largest_aspect > limits::largest_aspect) {
        return "float32 would not resolve sections of ellipsoids of 1:" + number(view.shapes.largest_aspect);
    }
    if (!plan.filter && view.screen_px.smallest < limits::least_px) {
        return "float32 would not resolve the positions of kernels of " + number(view.screen_px.smallest) + " pixels";
    }
    if (view.screen_px.largest() > limits::largest_px) {
        return "float32 would not resolve distances in kernels of " + number(view.screen_px.largest()) + " pixels";
    }
    if (scene.sampling == Sampling::slab && view.slabs.thickest > limits::thickest_slab) {
        return "rays go through a slab on " + number(view.slabs.thickest) + " times the length of half a kernel";
    }
    if (weights_in_slabs(scene.sampling, sums) > limits::widest_weights_in_slabs) {
        return "weights of up to " + number(sums.weight_range) +
               " times w0: where these are w0, the rounding of float32 means over slabs would show";
    }
    if (shows_surfaces(plan.mode) && sums.largest > farthest_surface * sums.nearest_end) {
        return "an iso value is " + number(sums.nearest_end) + " from the end of values of up to " +
               number(sums.largest) + ": float32 would lose where the surface is";
    }
    if (plan.gradient_opacity && least_faded(scene, view, sums, float32_epsilon) > *scene.gradient_opacity) {
        return "gradient_opacity " + number(*scene.gradient_opacity) + " is within the rounding of float32 gradients";
    }
    if (view.shapes.smallest_falloff < limits::least_falloff) {
        return "float32 would not resolve the profile of a falloff of " + number(view.shapes.smallest_falloff);
    }
    if (sums.sum > limits::largest_sum) {
        return "sums reach " + number(sums.sum);
    }
    if (picture_error(sums, float32_epsilon) > float32_bound) {
        return "values reach " + number(sums.largest) + ", but the transfer function distinguishes " +
               number(sums.resolved);
    }
    const double alike = view.overlap.alike * std::max(1.0, sums.ratio);
    if (alike > limits::most_alike) {
        return "float32 sums of " + number(view.overlap.alike) + " ellipsoids of one size at one place would drift";
    }
    const double unit = view.frame.slice_spacing;
    if (plan.projection == Projection::perspective &&
        (unit > limits::largest_unit || unit < 1.0 / limits::largest_unit)) {
        return "squares of lengths in steps of " + number(unit) + " leave float32";
    }
    const double shown = scalar_unit(plan.mode, plan.value_unit, unit);
    if (is_scalar(plan.mode) && shown > limits::largest_sum) {
        return "numbers of " + number(shown) + " leave float32";
    }
    if (tells_empty(plan) && steepest_falloff(scene) > limits::steepest_falloff) {
        return "float32 would not resolve the ends of kernels of a falloff of " + number(steepest_falloff(scene));
    }
    return "";
}

void refuse_beyond_float64(const Scene& scene, const ViewFacts& view, const DrawPlan& plan, const SumFacts& sums) {
    const auto refuse = [](const Words& found, const Words& wanted, const Words& advice) {
        throw Unsupported(Complaint{"the scene cannot be drawn within its error bound with backend cpu", found, wanted,
                                    advice + ", or pass " + option_ref("allow_inexact", "true")});
    };
    if (view.kernels.all == 0 || view.frame.slices == 0) {
        return;
    }
    const bool deep = plan.projection == Projection::perspective;
    const double radius_px = deep ? view.screen_px.largest_lattice : view.screen_px.largest();
    if (radius_px > largest_splat_px) {
        refuse("kernels of " + number(radius_px) + " pixels", "at most " + number(largest_splat_px), "magnify less");
    }
    if (view.shapes.smallest_falloff < limits::least_falloff_float64) {
        refuse("a falloff of " + number(view.shapes.smallest_falloff) + ", whose differences float64 cannot resolve",
               "at least " + number(limits::least_falloff_float64), "use a larger " + option_ref("falloff"));
    }
    if (tells_empty(plan) && steepest_falloff(scene) > limits::steepest_falloff_float64) {
        refuse("a falloff of " + number(steepest_falloff(scene)) + " where empty points differ from those of 0",
               "at most " + number(limits::steepest_falloff_float64) +
                   (plan.empty_test ? " where opacity at 0 is above 0" : " in this mode"),
               "use a smaller " + option_ref("falloff") + (plan.empty_test ? ", or an opacity of 0 at 0" : ""));
    }
    if (plan.gradient_opacity) {
        const double least = least_faded(scene, view, sums, float64_epsilon);
        if (least > *scene.gradient_opacity) {
            refuse(option_ref("gradient_opacity", number(*scene.gradient_opacity)) +
                       ", not larger than rounding errors of the gradient",
                   "at least " + number(least), "use a larger " + option_ref("gradient_opacity"));
        }
    }
    if (sums.least_scale < least_divisor) {
        refuse("a w0 and weights below " + number(least_divisor), "a w0 or weights of at least that",
               "scale the weights and " + option_ref("w0") + " by one factor");
    }
    if (sums.sum > limits::largest_sum_float64) {
        refuse("sums of weights, or of weighted values over what is resolved, of up to " + number(sums.sum),
               "at most " + number(limits::largest_sum_float64), "scale the values or the weights");
    }
    if (weights_in_slabs(scene.sampling, sums) > limits::widest_weights_in_slabs_float64) {
        refuse("means over slabs with weights of up to " + number(sums.weight_range) + " times w0",
               "at most " + number(limits::widest_weights_in_slabs_float64 / std::max(1.0, sums.ratio)) + " times",
               "use a larger " + option_ref("w0") + ", or leave out " + option_ref("sampling", "slab"));
    }
    const double error = picture_error(sums, float64_epsilon);
    if (error > float32_bound) {
        refuse("values up to " + number(sums.largest) + ", of which the transfer function distinguishes " +
                   number(sums.resolved),
               "values of at most " + number(sums.ratio * float32_bound / error) + " times that",
               "subtract an offset from the values");
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
    return pixels * channels * sizeof(float) + view.kernels.all * limits::kernel_bytes + light;
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
    const Vec3 spacing = field.options().spacing;
    const double kernels = extremes.drawn * view.frame.smallest_pixel * view.frame.largest_pixel *
                           view.frame.slice_spacing / (spacing.x * spacing.y * spacing.z);
    const double sections =
        1.0 + 2.0 * radius * std::cbrt(spacing.x * spacing.y * spacing.z) / view.frame.slice_spacing;
    const double overlaps = extremes.drawn * 4.0 / 3.0 * 3.14159265358979323846 * radius * radius * radius;
    return {extremes.asked * limits::asked_seconds +
                extremes.left *
                    (limits::looked_up_seconds + limits::looked_up_sample_seconds * window * window * window),
            limits::counted_seconds + (general ? limits::general_price : 1.0) *
                                          (kernels * (limits::kernel_seconds + sections * limits::section_seconds) +
                                           limits::splat_seconds * overlaps)};
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
    const std::string why = why_float64(scene, view, plan, sums);
    const bool asked = options.precision == Precision::float64;
    const bool kept = options.precision == Precision::float32;
    plan.precision = asked || (!kept && !why.empty()) ? Precision::float64 : Precision::float32;
    plan.bound = bound_of(view, sums);
    plan.lit_rounding = plan.lit ? lit_rounding(scene, view, plan, sums, true) : 0.0;
    plan.inexact = options.allow_inexact;
    plan.exact_tiles = plan.precision == Precision::float32 && !kept;
    effects.state(EffectId::float64, plan.precision == Precision::float64,
                  asked          ? "precision float64 was asked for"
                  : !why.empty() ? why
                  : plan.lit     ? "float32 keeps the error bound, but for tiles whose light would show its rounding"
                                 : "float32 keeps the error bound");
    if (!options.allow_inexact) {
        effects.refuse_dropped();
        refuse_beyond_float64(scene, view, plan, sums);
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
                                        limits::walked_noise * sums.ratio * sums.bend,
                                        name_of(EffectId::scattered_kernels)});
    }
    effects.state(EffectId::sums, true, std::string("kernels are summed in ") + to_string(plan.precision));
    summary.precision = plan.precision;
    summary.packing = plan.packing;
    summary.tagging = plan.tagging;
    summary.device = "processor";
    summary.memory = memory_of(scene, view, plan);
}

} // namespace sheetsplat

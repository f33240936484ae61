#include "bounds_gl.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "limits.hpp"
#include "plan/limits_gl.hpp"
#include "plan/pivot.hpp"
#include "scene/mode_rules.hpp"
#include "sheetsplat/error.hpp"

namespace sheetsplat {

using namespace gl_limits;

namespace {

bool sums_go_beyond(const Scene& scene) {
    return std::any_of(scene.fields.begin(), scene.fields.end(),
                       [](const auto& field) { return field->normalization() != Normalization::lattice; });
}

/// Why the slicing of [NM06] cannot draw a scene; empty where it can.
std::string unfit_for_paper_slicing(const ViewFacts& view, const RendererOptions& options, const Effects& effects,
                                    const DrawPlan& plan) {
    return !view.kernels.ellipsoids                     ? "a scene without scattered ellipsoids"
           : plan.projection == Projection::perspective ? "a perspective camera"
           : plan.sampling == Sampling::slab            ? "slab sampling"
           : plan.filter                                ? "a filter"
           : plan.fine_gradient                         ? "effect fine_gradient, whose differences it does not draw"
           : plan.analytic_gradient                     ? "analytic gradients, whose derivatives it does not draw"
           : effects.forced_on(EffectId::resident_sections)
               ? "effect resident_sections, which slices kernels in another way"
           : options.packing == Packing::wide ? "packing wide"
                                              : "";
}

} // namespace

std::string why_float32(const Scene& scene, const ViewFacts& view, const Capabilities& capabilities,
                        const DrawPlan& plan) {
    if (capabilities.software) {
        return "a rasteriser in software gains nothing by 16 bits";
    }
    if (!capabilities.float16_blend_rounds) {
        return "this device cuts off sums in 16 bits";
    }
    if (!is_composited(plan.mode) || plan.coverage) {
        return "the values themselves are shown, which 16 bits would round";
    }
    if (plan.gradient) {
        return "gradients are differences of sums, which 16 bits would lose";
    }
    if (groups_drawn(scene).size() > 1) {
        return "errors of several transfer functions would add up";
    }
    if (plan.empty_test || !plan.own_sheets.empty() || plan.paper_slicing) {
        return "this way of drawing tells sums apart that 16 bits would not";
    }
    const SumFacts facts = sum_facts(scene, view, plan);
    if (facts.least_scale < least_float16_scale || facts.sum > largest_float16) {
        return "weights or sums leave what 16 bits hold";
    }
    const double noise = sum_noise(Precision::float16, false, facts.crowd) * facts.ratio;
    if (noise * facts.bend > float16_bound || noise * facts.steepness > float16_worst) {
        return "up to " + number(facts.crowd) + " kernels at a point and values of " + number(facts.ratio) +
               " times the window would make an error of " + number(noise * facts.bend) + " in 16 bits, and of " +
               number(noise * facts.steepness) + " where colours are steepest";
    }
    return "";
}

void check_precision(const Scene& scene, const ViewFacts& view, const RendererOptions& options,
                     const Capabilities& capabilities, DrawPlan& plan) {
    Measures measures{scene, view, plan, sum_facts(scene, view, plan), float32_epsilon, &capabilities};
    SumFacts& facts = measures.sums;
    // Sheets of 8 bits end at 1, which sums of weights, and of values that are not divided, go beyond.
    const bool ends = plan.precision == Precision::uint8 && sums_go_beyond(scene);
    if (plan.precision == Precision::float32 && !capabilities.float32_blend) {
        throw Unsupported(Complaint{"the picture cannot be made with float32 sheets",
                                    capabilities.renderer + ", which cannot blend 32-bit floats", "a device that can",
                                    "", "backend"});
    }
    const double noise = ends ? 1.0 : sum_noise(plan.precision, !capabilities.float16_blend_rounds, facts.crowd);
    expect_errors(view, facts, noise, plan);
    if (!options.allow_inexact) {
        // What is counted from the middle of values is rounded by half their range, however little of it sums come to.
        facts.ratio =
            std::max(facts.ratio, counts_from_pivots(plan) ? ratio_from_pivots(scene, plan, facts.resolved) : 0.0);
        const double expected = plan.summary.expected_error();
        const double worst = noise * facts.ratio * facts.steepness;
        // Whether a kernel reaches a point shows: 16 bits lose the smallest weights.
        const bool loses_ends = plan.precision == Precision::float16 && plan.empty_test;
        if (plan.precision == Precision::uint8 ||
            (plan.precision == Precision::float16 &&
             (expected > float16_bound || worst > float16_worst || loses_ends || facts.sum > largest_float16))) {
            throw Unsupported(Complaint{
                std::string("the picture cannot be made with ") + to_string(plan.precision) + " sheets",
                "an expected error of " + number(expected) + ", and of " + number(worst) +
                    " where colours are steepest: up to " + number(facts.crowd) +
                    " kernels at a point, sums of up to " + number(facts.sum) +
                    (loses_ends ? ", and an opacity above 0 where there is nothing" : ""),
                "at most " + number(float16_bound) + " and " + number(float16_worst) + ", and sums of " +
                    number(largest_float16),
                "use " + option_ref("precision", "float32") + ", or pass " + option_ref("allow_inexact", "true"),
                "precision"});
        }
    }
    refuse_beyond(measures, Way::sheets, options.allow_inexact);
    if (!capabilities.at_least(4, 0)) {
        refuse_beyond(measures, Way::old_sheets, options.allow_inexact);
    }
    if (plan.paper_slicing) {
        refuse_beyond(measures, Way::papers, options.allow_inexact);
    }
}

void check_coverage(const Scene& scene, const DrawPlan& plan) {
    for (const Group& group : plan.coverage ? groups_drawn(scene) : std::vector<Group>{}) {
        for (std::size_t field = group.first; field < group.last && group.last - group.first > 1; ++field) {
            if (scene.fields[field]->least_weight() > 0.0) {
                throw Unsupported(
                    Complaint{"the scene cannot be drawn with backend gl",
                              // Its sheets hold one sum of weights, which cannot tell that each of the fields is empty.
                              "the output coverage of fields that add up, where samples of one are missing",
                              "fields without missing samples, or one field", "leave out the output"});
            }
        }
    }
}

void check_paper_slicing(const ViewFacts& view, const RendererOptions& options, const Effects& effects,
                         const DrawPlan& plan) {
    const std::string unfit = unfit_for_paper_slicing(view, options, effects, plan);
    if (!unfit.empty()) {
        throw Unsupported(Complaint{"the plan cannot be made with effect paper_slicing", unfit,
                                    "ellipsoids in orthographic view, point-sampled, unfiltered, packing paper",
                                    "leave it out of " + option_ref("effects"), "effects"});
    }
}

} // namespace sheetsplat

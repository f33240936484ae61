#include "bounds_gl.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "plan/limits_gl.hpp"
#include "plan/pivot.hpp"
#include "scene/mode_rules.hpp"
#include "sheetsplat/error.hpp"

namespace sheetsplat {

using namespace gl_limits;

namespace {

/// advice: what helps beside allow_inexact, which follows.
[[noreturn]] void refuse_sheets(const Words& found, const Words& wanted, const Words& advice,
                                const std::string& option = {}) {
    throw Unsupported(Complaint{"the picture cannot be made within its error bound in 32-bit sheets", found, wanted,
                                advice + ", or pass " + option_ref("allow_inexact", "true"), option});
}

[[noreturn]] void refuse_scene(const Words& found, const Words& wanted, const Words& advice) {
    throw Unsupported(Complaint{"the scene cannot be drawn with backend gl", found, wanted, advice});
}

bool sums_go_beyond(const Scene& scene) {
    return std::any_of(scene.fields.begin(), scene.fields.end(),
                       [](const auto& field) { return field->normalization() != Normalization::lattice; });
}

/// The range that scenes of this steepness and magnification are held to.
double limit_of(const BySteepness& range, const ViewFacts& view, const SumFacts& facts) {
    return bound_of(view, facts) == gentle_bound ? range.gentle : range.steep;
}

/// Why the slicing of [NM06] cannot draw a scene; empty where it can.
std::string unfit_for_paper_slicing(const Scene& scene, const ViewFacts& view, const RendererOptions& options,
                                    const Effects& effects, const DrawPlan& plan, bool float64) {
    if (!view.kernels.ellipsoids) {
        return "a scene without scattered ellipsoids";
    }
    if (groups_drawn(scene).size() > 1) {
        return text_of_count(groups_drawn(scene).size()) + " transfer functions";
    }
    if (plan.projection == Projection::perspective) {
        return "a perspective camera";
    }
    if (plan.sampling == Sampling::slab) {
        return "slab sampling";
    }
    if (plan.filter) {
        return "a filter";
    }
    if (plan.fine_gradient) {
        return "effect fine_gradient, whose differences it does not draw";
    }
    if (plan.analytic_gradient) {
        return "analytic gradients, whose derivatives it does not draw";
    }
    if (view.screen_px.largest_ellipsoid_at_unit > largest_paper_px && !options.allow_inexact) {
        return "kernels of " + number(view.screen_px.largest_ellipsoid_at_unit) + " pixels, of " +
               number(largest_paper_px) + " at most";
    }
    if (view.kernels.most_ellipsoids > most_resident_kernels) {
        return number(static_cast<double>(view.kernels.most_ellipsoids)) + " kernels in one field, of " +
               number(static_cast<double>(most_resident_kernels)) + " at most";
    }
    if (effects.forced_on(EffectId::resident_sections)) {
        return "effect resident_sections, which slices kernels in another way";
    }
    const double most = float64 ? largest_paper_extent : largest_paper_extent_in_float32;
    for (const auto& field : scene.fields) {
        const EllipsoidField* ellipsoids = as_ellipsoids(field.get());
        if (ellipsoids == nullptr) {
            continue;
        }
        if (field->kernel().falloff > largest_paper_falloff) {
            return "a falloff of " + number(field->kernel().falloff) + ", where a texture of the Gaussian serves " +
                   number(largest_paper_falloff) + " at most";
        }
        const Vec3 extent = ellipsoids->centres_world().extent();
        const double half = 0.5 * std::max({extent.x, extent.y, extent.z});
        if (half > most * ellipsoids->scale_range()[0] && !options.allow_inexact) {
            return "a semi-axis of " + number(ellipsoids->scale_range()[0]) + " in a field that reaches " +
                   number(half) + " from its centre, where float32 textures know centres for 1:" + number(most) +
                   " at most";
        }
    }
    if (view.shapes.largest_aspect > largest_paper_aspect && !options.allow_inexact) {
        return "kernels of 1:" + number(view.shapes.largest_aspect) +
               ", where float32 textures know rotations for 1:" + number(largest_paper_aspect) + " at most";
    }
    if (view.screen_px.smallest_ellipsoid < least_plain_px && !options.allow_inexact) {
        return "kernels of " + number(view.screen_px.smallest_ellipsoid) + " pixels, of " + number(least_plain_px) +
               " at least";
    }
    return options.packing == Packing::wide ? "packing wide" : "";
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
    const SumFacts facts = sum_facts(scene, view, plan);
    const auto& [overlap, largest, resolved, ratio, sum, steepness, least_scale, weight_range, crowd, bend,
                 nearest_end] = facts;
    const bool lost = least_scale < least_divisor;
    const double sums = float32_epsilon * std::sqrt(overlap) * ratio;
    // Sheets of 8 bits end at 1, which sums of weights, and of values that are not divided, go beyond.
    const bool ends = plan.precision == Precision::uint8 && sums_go_beyond(scene);
    if (plan.precision == Precision::float32 && !capabilities.float32_blend) {
        throw Unsupported(Complaint{"the picture cannot be made with float32 sheets",
                                    capabilities.renderer + ", which cannot blend 32-bit floats", "a device that can",
                                    "", "backend"});
    }
    const double noise = ends ? 1.0 : sum_noise(plan.precision, !capabilities.float16_blend_rounds, crowd);
    expect_errors(view, facts, noise, plan);
    if (options.allow_inexact) {
        return;
    }
    const double expected = plan.summary.expected_error();
    // What is counted from the middle of values is rounded by half their range, however little of it sums come to.
    const double half_range = counts_from_pivots(plan) ? ratio_from_pivots(scene, plan, resolved) : 0.0;
    const double worst = noise * std::max(ratio, half_range) * steepness;
    // Whether a kernel reaches a point shows: 16 bits lose the smallest weights.
    const bool loses_ends = plan.precision == Precision::float16 && plan.empty_test;
    if (plan.precision == Precision::uint8 ||
        (plan.precision == Precision::float16 && (expected > float16_bound || worst > float16_worst || loses_ends))) {
        throw Unsupported(
            Complaint{std::string("the picture cannot be made with ") + to_string(plan.precision) + " sheets",
                      "an expected error of " + number(expected) + ", and of " + number(worst) +
                          " where colours are steepest: up to " + number(crowd) + " kernels at a point" +
                          (loses_ends ? ", and an opacity above 0 where there is nothing" : ""),
                      "at most " + number(float16_bound) + " and " + number(float16_worst),
                      "use " + option_ref("precision", "float32") + ", or pass " + option_ref("allow_inexact", "true"),
                      "precision"});
    }
    const double largest_sum = plan.precision == Precision::float16 ? largest_float16 : largest_float32;
    if (sum > largest_sum || lost) {
        throw Unsupported(
            Complaint{std::string("the picture cannot be made with ") + to_string(plan.precision) + " sheets",
                      lost ? "a w0 and weights below " + number(least_divisor)
                           : "sums of weights, or of weighted values over what is resolved, of up to " + number(sum),
                      lost ? "a w0 or weights of at least that" : "at most " + number(largest_sum),
                      "scale the weights and " + option_ref("w0") + " by one factor, or pass " +
                          option_ref("allow_inexact", "true")});
    }
    // Errors of single slices partly cancel along a ray; what a steep ramp adds, it adds at few pixels.
    const double picture =
        0.25 * float32_epsilon * std::sqrt(overlap) * std::max(ratio, half_range) * std::min(steepness, 4.0);
    if (plan.precision == Precision::float32 && picture > float32_bound) {
        refuse_sheets("values up to " + number(std::max(largest, half_range * resolved)) + " where " +
                          number(resolved) + " is resolved",
                      "values of at most " + number(4.0 * float32_bound / (sums / ratio) / std::min(steepness, 4.0)) +
                          " times that",
                      "use a wider transfer function or " + option_ref("clim") +
                          ", or subtract an offset from values that are all far from 0");
    }
    if (plan.gradient_opacity) {
        const double nearest = view.frame.smallest_step();
        const bool differences = !plan.analytic_gradient && !plan.fine_gradient;
        const double least = least_full_gradient * std::max({1.0, ratio, half_range}) *
                             (differences ? std::max(1.0, view.frame.reference_length / nearest) : 1.0);
        double unit = plan.value_unit;
        for (const double of_field : plan.field_units) {
            unit = std::max(unit, of_field);
        }
        if (*scene.gradient_opacity * view.frame.reference_length < least * unit) {
            refuse_sheets(option_ref("gradient_opacity", number(*scene.gradient_opacity)) +
                              ", near which gradients are lost to rounding",
                          "at least " + number(least * unit / view.frame.reference_length), "use a larger one",
                          "gradient_opacity");
        }
    }
    const double reach = std::max(largest, half_range * resolved);
    if (shows_surfaces(plan.mode) && reach > farthest_surface * nearest_end) {
        refuse_sheets("an iso value that is " + number(nearest_end) + " from the end of values of up to " +
                          number(reach),
                      "at least " + number(reach / farthest_surface), Words());
    }
    if (view.overlap.alike * std::max(1.0, ratio) > most_alike_unlit) {
        refuse_sheets("about " + number(view.overlap.alike) + " ellipsoids of one size at one place",
                      "at most " + number(std::floor(most_alike_unlit / std::max(1.0, ratio))),
                      "make one kernel of them");
    }
    const double measure = traits_of(plan.mode).integrates ? view.frame.slice_spacing : 1.0;
    const double seen = is_scalar(plan.mode) ? std::max(1.0, measure * view.slabs.ellipsoids.peak) : resolved;
    if (plan.sampling == Sampling::slab && !plan.filter &&
        measure * view.slabs.ellipsoids.loss / seen * std::min(steepness, 4.0) > thick_slab) {
        refuse_sheets("slabs of " + number(view.frame.slice_spacing) +
                          ", in which float32 loses the place of ellipsoids that are so much thinner",
                      "slabs of at most " + number(thick_slab) + " times the half-depth of ellipsoids that show",
                      "use a smaller " + option_ref("slice_spacing") + " or " + option_ref("filter", "ewa"));
    }
    if (plan.sampling == Sampling::slab && is_scalar(plan.mode) && !plan.filter &&
        std::min(view.frame.largest_slant, view.slabs.thickest) > longest_in_slab) {
        refuse_sheets("rays that go through a slab on up to " +
                          number(std::min(view.frame.largest_slant, view.slabs.thickest)) + " times its thickness",
                      "at most " + number(longest_in_slab) + " times",
                      "use a smaller " + option_ref("fov_y") + " or a narrower picture, or leave out " +
                          option_ref("sampling", "slab"),
                      "fov_y");
    }
    const double most_in_slabs = limit_of(widest_weights_in_slabs, view, facts);
    if (weights_in_slabs(plan.sampling, facts) * crowd > most_in_slabs) {
        refuse_sheets("means over slabs with weights of up to " + number(weight_range) + " times w0, " + number(crowd) +
                          " of them at a point",
                      "at most " + number(most_in_slabs / (std::max(1.0, ratio) * crowd)) + " times",
                      "use a larger " + option_ref("w0") + ", or leave out " + option_ref("sampling", "slab"));
    }
}

void check_parts(const Scene& scene, const DrawPlan& plan) {
    const std::vector<Group> all = groups_drawn(scene);
    const std::size_t groups = all.size();
    for (const Group& group : plan.coverage ? all : std::vector<Group>{}) {
        for (std::size_t field = group.first; field < group.last && group.last - group.first > 1; ++field) {
            if (scene.fields[field]->least_weight() > 0.0) {
                // Its sheets hold one sum of weights, which cannot tell that each of the fields is empty.
                refuse_scene("the output coverage of fields that add up, where samples of one are missing",
                             "fields without missing samples, or one field", "leave out the output");
            }
        }
    }
    if (groups > most_groups) {
        refuse_scene(std::to_string(groups) + " transfer functions", "at most " + std::to_string(most_groups),
                     "give more fields one transfer function");
    }
    const std::size_t surfaces = shows_surfaces(scene.mode) ? groups * scene.iso_values.size() : 0;
    if (surfaces > most_surfaces) {
        refuse_scene(std::to_string(surfaces) + " surfaces: iso values times transfer functions",
                     "at most " + std::to_string(most_surfaces), "use fewer iso values");
    }
}

void check_lights(const Scene& scene, const Capabilities& capabilities, const DrawPlan& plan) {
    if (scene.lights.size() > most_lights) {
        refuse_scene(std::to_string(scene.lights.size()) + " lights", "at most " + std::to_string(most_lights),
                     "use fewer lights");
    }
    if (plan.shadows && scene.lights.size() > most_shadowing_lights) {
        refuse_scene(std::to_string(scene.lights.size()) + " lights with shadows",
                     "at most " + std::to_string(most_shadowing_lights),
                     "use fewer lights, or leave out " + option_ref("shadows"));
    }
    if ((plan.shadows || plan.ambient_occlusion) && capabilities.max_buffer_texels < most_light_elements_of_all) {
        refuse_scene(
            "shadows or ambient occlusion on a device whose buffer textures hold " +
                std::to_string(capabilities.max_buffer_texels) + " texels",
            "at least " + std::to_string(most_light_elements_of_all) + ", for the opacity along rays to lights", "");
    }
}

void check_kernels(const Scene& scene, const ViewFacts& view, const Capabilities& capabilities, const DrawPlan& plan) {
    const bool float64 = capabilities.at_least(4, 0);
    if (!float64 && view.shapes.largest_aspect > largest_plain_aspect) {
        throw Unsupported(
            Complaint{"the scene cannot be drawn within its error bound",
                      "ellipsoids of 1:" + number(view.shapes.largest_aspect) + " on OpenGL " + capabilities.version,
                      "OpenGL 4.0 for places in float64, or at most 1:" + number(largest_plain_aspect),
                      "pass " + option_ref("min_scale", "...") + " to the field"});
    }
    if (!plan.filter && !float64 && view.screen_px.smallest_ellipsoid < smallest_plain_px) {
        throw Unsupported(Complaint{
            "the scene cannot be drawn within its error bound",
            "ellipsoids of " + number(view.screen_px.smallest_ellipsoid) + " pixels on OpenGL " + capabilities.version,
            "OpenGL 4.0 for places in float64, or at least " + number(smallest_plain_px),
            "pass " + option_ref("min_scale", "...") + " to the field, or use " + option_ref("filter", "ewa")});
    }
    if (view.frame.slices > most_imprecise_slices && !float64) {
        throw Unsupported(Complaint{"the scene cannot be drawn within its error bound",
                                    std::to_string(view.frame.slices) + " slices on OpenGL " + capabilities.version,
                                    "OpenGL 4.0 for compensated sums, or at most " +
                                        std::to_string(most_imprecise_slices) + " slices",
                                    "use a larger " + option_ref("slice_spacing")});
    }
    const bool deep = plan.projection == Projection::perspective;
    if (view.frame.slices > 0 &&
        view.screen_px.largest_ellipsoid_at_unit > (deep ? largest_deep_px : largest_splat_px)) {
        refuse_scene("ellipsoids of " + number(view.screen_px.largest_ellipsoid_at_unit) + " pixels" +
                         (deep ? " at a distance of one unit of length" : ""),
                     "at most " + number(deep ? largest_deep_px : largest_splat_px),
                     deep ? "use a larger unit of length" : "magnify less");
    }
    if (view.screen_px.largest_lattice > largest_splat_px) {
        refuse_scene("kernels of " + number(view.screen_px.largest_lattice) + " pixels",
                     "at most " + number(largest_splat_px), "magnify less");
    }
    const double place_error = std::max(view.frame.size.width, view.frame.size.height) * float32_epsilon;
    if (view.frame.slices > 0 && view.screen_px.largest_lattice > 0.0 &&
        place_error > largest_place_error * view.screen_px.largest_lattice) {
        refuse_scene("kernels of " + number(view.screen_px.largest_lattice) +
                         " pixels, whose positions float32 resolves to " + number(place_error),
                     "positions resolved to " + number(largest_place_error) + " of a radius", "move the camera closer");
    }
    if (view.shapes.smallest_falloff < smallest_falloff) {
        refuse_scene("a falloff of " + number(view.shapes.smallest_falloff) +
                         ", whose differences float32 cannot resolve",
                     "at least " + number(smallest_falloff), "use a larger " + option_ref("falloff"));
    }
    if (counts_weighted_slices(scene.mode) && steepest_falloff(scene) > largest_counted_falloff) {
        refuse_scene("a falloff of " + number(steepest_falloff(scene)) + " in mode " + name_of(scene.mode) +
                         ", which shows where kernels end",
                     "at most " + number(largest_counted_falloff), "use a smaller " + option_ref("falloff"));
    }
}

void check_paper_slicing(const Scene& scene, const ViewFacts& view, const RendererOptions& options,
                         const Effects& effects, const DrawPlan& plan, bool float64) {
    const std::string unfit = unfit_for_paper_slicing(scene, view, options, effects, plan, float64);
    if (!unfit.empty()) {
        throw Unsupported(Complaint{"the plan cannot be made with effect paper_slicing", unfit,
                                    "ellipsoids in orthographic view, point-sampled, unfiltered, packing paper",
                                    "leave it out of " + option_ref("effects"), "effects"});
    }
}

} // namespace sheetsplat

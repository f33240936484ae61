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

/// Rounding errors of sums of many equal numbers add up; those of different numbers partly cancel.
void check_crowds(const ViewFacts& view, const DrawPlan& plan, bool lit_quotient, double ratio) {
    const double times = std::max(1.0, ratio);
    double most = most_alike_unlit / times;
    if (lit_quotient) {
        const double nearest = view.frame.smallest_step();
        most = most_alike_lit / times / std::max(1.0, view.frame.reference_length / nearest) /
               (plan.fine_gradient ? fine_alike_factor : 1.0);
    }
    most = std::max(most, least_alike);
    const std::string advice =
        std::string("make one kernel of them") +
        (lit_quotient ? ", of their weights' sum and the mean of their values, or leave out the lights" : "");
    if (view.overlap.alike > most) {
        refuse_sheets("about " + number(view.overlap.alike) + " ellipsoids of one size at one place",
                      "at most " + number(std::floor(most)) + (lit_quotient ? " where they are lit" : ""), advice);
    }
    if (lit_quotient && view.overlap.densest * times > densest_lit) {
        refuse_sheets("about " + number(view.overlap.densest) + " ellipsoids at a point",
                      "at most " + number(densest_lit / times) + " where they are lit",
                      "use fewer or smaller ellipsoids, or leave out the lights");
    }
}

bool sums_go_beyond(const Scene& scene) {
    return std::any_of(scene.fields.begin(), scene.fields.end(),
                       [](const auto& field) { return field->normalization() != Normalization::lattice; });
}

/// What float32 makes of quotients of the kernels' own derivatives where rho is the same all around, over its rounding:
/// values from their pivots over what is resolved (ratio), times the root of the kernels at a point, times the
/// reference length over the shortest semi-axis.
double noise_of_derivatives(const ViewFacts& view, const SumFacts& sums, double ratio) {
    const double axis = view.screen_px.smallest * view.frame.smallest_pixel;
    const double crowd = std::max(sums.overlap, view.overlap.densest);
    return ratio * std::sqrt(crowd) * std::max(1.0, view.frame.reference_length / axis);
}

/// The range that scenes of this steepness and magnification are held to.
double limit_of(const BySteepness& range, const ViewFacts& view, const SumFacts& facts) {
    return bound_of(view, facts) == gentle_bound ? range.gentle : range.steep;
}

/// Whether light shows the rounding of quotients: under a transfer function of one value it shows gradients however
/// weak they are. One field of one value has none of it, and at a surface differences are no rounding.
bool lights_rounding(const Scene& scene, const DrawPlan& plan) {
    if (!plan.lit || !lights_quotients(plan) || !(plan.mode == Mode::composite || plan.analytic_gradient)) {
        return false;
    }
    for (const Group& group : groups_drawn(scene)) {
        if (!has_window_of_one_value(group)) {
            continue;
        }
        for (std::size_t number = group.first; number < group.last; ++number) {
            const Field& field = *scene.fields[number];
            const std::array<double, 2> values = field.value_range();
            const bool exact = group.last - group.first == 1 && values[0] == values[1];
            if (!exact && field.normalization() == Normalization::threshold && field.size() > 0) {
                return true;
            }
        }
    }
    return false;
}

/// Whether values of a field are so often those of others that it has plateaus: of a lattice those of neighbours, of
/// scattered kernels any. Looks at a few thousand.
bool has_plateaus(const Field& field) {
    constexpr std::size_t most = 4096;
    const std::size_t step = std::max<std::size_t>(1, field.size() / most);
    std::size_t equal = 0, compared = 0;
    if (const RegularField* lattice = as_regular(&field)) {
        const auto& [nk, nj, ni] = lattice->shape();
        for (std::size_t at = 0; at < nk * nj * ni; at += step) {
            const std::size_t i = at % ni, j = at / ni % nj, k = at / ni / nj;
            if (i + 1 < ni) {
                ++compared;
                equal += lattice->value(i, j, k) == lattice->value(i + 1, j, k) ? 1 : 0;
            }
        }
    }
    if (const EllipsoidField* ellipsoids = as_ellipsoids(&field)) {
        std::vector<double> values;
        for (std::size_t kernel = 0; kernel < field.size(); kernel += step) {
            values.push_back(ellipsoids->value(kernel));
        }
        std::sort(values.begin(), values.end());
        for (std::size_t kernel = 1; kernel < values.size(); ++kernel) {
            ++compared;
            equal += values[kernel - 1] == values[kernel] ? 1 : 0;
        }
    }
    return static_cast<double>(equal) > least_repeated * static_cast<double>(compared);
}

/// Under a transfer function that is narrow beside the values, what is rounded of quotients is lit wherever these
/// hardly change. ratio: of values, as they are counted, over the width of the transfer function.
void check_plateaus(const Scene& scene, const ViewFacts& view, const DrawPlan& plan, const SumFacts& facts,
                    double ratio) {
    if (plan.mode != Mode::composite || view.kernels.all == 0 || view.frame.slices == 0 ||
        facts.ratio <= narrow_window) {
        return;
    }
    const bool by_kernels = plan.analytic_gradient || plan.fine_gradient;
    const double length = by_kernels ? view.screen_px.smallest * view.frame.smallest_pixel : view.frame.smallest_step();
    const double noise = ratio * std::max(1.0, view.frame.reference_length / length);
    const double most =
        limit_of(by_kernels ? noise_of_plateaus_by_kernels : noise_of_plateaus_by_differences, view, facts);
    const auto is_lit = [&](const auto& field) {
        return field->normalization() == Normalization::threshold &&
               (noise > noise_of_any_values || has_plateaus(*field));
    };
    if (noise > most && std::any_of(scene.fields.begin(), scene.fields.end(), is_lit)) {
        // A little more than the limit, so that the number as it is printed is enough.
        const double width = 1.001 * facts.largest / narrow_window;
        refuse_sheets("lit quotients of sums of values of up to " + number(facts.largest) +
                          " under a transfer function of a width of " + number(facts.resolved) +
                          ": where they hardly change, as where many are equal, their rounding would be lit",
                      "a width of at least " + number(width),
                      "use a wider transfer function or " + option_ref("clim") + ", or leave out the lights",
                      "transfer_function");
    }
}

/// What float32 loses of gradients of quotients that are near their kernels' ends, or far magnified. ratio: of values
/// over what is resolved.
void check_quotients(const ViewFacts& view, const DrawPlan& plan, const SumFacts& facts, double ratio) {
    if (view.kernels.all == 0 || view.frame.slices == 0 || !(plan.fine_gradient || plan.analytic_gradient)) {
        return;
    }
    const double ell = view.frame.reference_length;
    const auto most_of = [&](const BySteepness& range) { return limit_of(range, view, facts) / std::max(1.0, ratio); };
    const bool isosurface = plan.mode == Mode::isosurface;
    const double axis = view.screen_px.smallest * view.frame.smallest_pixel;
    double most = most_of(plan.analytic_gradient ? widest_derivatives
                          : isosurface           ? widest_isosurface
                                                 : widest_differences);
    const double change = std::max(axis, view.frame.smallest_pixel);
    if (isosurface && plan.fine_gradient && ell > magnified_isosurface * change) {
        const double times = ell / change / magnified_isosurface;
        most = std::min(most, widest_magnified_isosurface / times / times / std::max(1.0, ratio));
    }
    if (isosurface && plan.analytic_gradient) {
        const double by_axis = most_of(widest_by_semi_axis) / (ell / axis) / (ell / axis);
        most = std::min(most, std::max(by_axis, widest_isosurface_of_derivatives / std::max(1.0, ratio)));
    }
    const Words way_out =
        (plan.analytic_gradient
             ? "leave out " + option_ref("gradient", "analytic") + ", or use a larger " + option_ref("w0")
             : "use a larger " + option_ref("w0") + " or " + option_ref("gradient", "analytic"));
    if (plan.analytic_gradient) {
        const Words calmer = "leave out " + option_ref("gradient", "analytic");
        const double noise = noise_of_derivatives(view, facts, ratio);
        if (noise > largest_noise_of_derivatives) {
            refuse_sheets("lit derivatives of quotients where values of " + number(ratio) +
                              " times the range of the transfer function from their middle, times reference lengths "
                              "over semi-axes, times the root of the kernels at a point are " +
                              number(noise),
                          "at most " + number(largest_noise_of_derivatives), calmer);
        }
        if (view.shapes.largest_aspect > largest_derived_aspect) {
            refuse_sheets("lit derivatives of quotients of kernels of 1:" + number(view.shapes.largest_aspect),
                          "at most 1:" + number(largest_derived_aspect), calmer);
        }
    }
    if (facts.weight_range > most) {
        refuse_sheets("weights of up to " + number(facts.weight_range) +
                          " times w0: near the ends of kernels light would show rounding errors",
                      "at most " + number(most) + " times w0", way_out);
    }
    // What a ray goes through is no more opaque than its length lets it be. Surfaces are where differences are large.
    const double seen = std::min(ell, view.frame.slice_spacing * static_cast<double>(view.frame.slices));
    const double magnified = std::max(1.0, ratio) * seen / change;
    const double most_magnified = magnified_quotients / std::sqrt(std::max(1.0, view.overlap.densest));
    if (plan.fine_gradient && !isosurface && magnified > most_magnified) {
        refuse_sheets("quotients of sums that are lit where a reference length is " + number(magnified) +
                          " pixels or semi-axes",
                      "at most " + number(std::floor(most_magnified)) + " with about " + number(view.overlap.densest) +
                          " ellipsoids at a point",
                      "use " + option_ref("gradient", "analytic") + " or a smaller " + option_ref("reference_length"));
    }
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
    if (plan.mode != Mode::composite || plan.coverage) {
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
    const bool lit_quotient = lights_quotients(plan);
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
    const double lit_ratio = counts_from_pivots(plan) ? half_range : ratio;
    // Errors of single slices partly cancel along a ray; what a steep ramp adds, it adds at few pixels.
    const double picture =
        0.25 * float32_epsilon * std::sqrt(overlap) * std::max(ratio, half_range) * std::min(steepness, 4.0);
    const bool too_far = lit_quotient && lit_ratio > largest_lit_ratio;
    const double most_times = 4.0 * float32_bound / (sums / ratio) / std::min(steepness, 4.0);
    if (plan.precision == Precision::float32 && (picture > float32_bound || too_far)) {
        refuse_sheets("values up to " + number(std::max(largest, half_range * resolved)) + " where " +
                          number(resolved) + " is resolved",
                      "values of at most " + number(too_far ? std::min(largest_lit_ratio, most_times) : most_times) +
                          " times that",
                      "use a wider transfer function or " + option_ref("clim") +
                          ", or subtract an offset from values that are all far from 0");
    }
    if (plan.gradient_opacity) {
        const double nearest = view.frame.smallest_step();
        const bool differences = !plan.analytic_gradient && !plan.fine_gradient;
        const double least = least_full_gradient * std::max(1.0, lit_ratio) *
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
    if (is_near_the_end(plan, facts) ||
        (plan.mode == Mode::isosurface && half_range * resolved > farthest_from_end(plan) * nearest_end)) {
        const double reach = std::max(largest, half_range * resolved);
        refuse_sheets("an iso value that is " + number(nearest_end) + " from the end of values of up to " +
                          number(reach),
                      "at least " + number(reach / farthest_from_end(plan)),
                      plan.analytic_gradient ? "leave out " + option_ref("gradient", "analytic") : Words());
    }
    if (lights_rounding(scene, plan)) {
        refuse_sheets(
            "quotients of sums that are lit under a transfer function of one value: no gradient is too weak to "
            "be lit, not even one of rounding",
            "a transfer function over a range of values", "move its points apart, or leave out the lights",
            "transfer_function");
    }
    if (lit_quotient) {
        check_plateaus(scene, view, plan, facts, lit_ratio);
        check_quotients(view, plan, facts, lit_ratio);
    }
    check_crowds(view, plan, lit_quotient, ratio);
    const double measure = plan.mode == Mode::xray ? view.frame.slice_spacing : 1.0;
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
    const std::size_t surfaces = scene.mode == Mode::isosurface ? groups * scene.iso_values.size() : 0;
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

// The plan of backend gl: ways of drawing, sheets and their precision, and what a device cannot do within its bound.
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <utility>

#include "effects.hpp"
#include "plan/pivot.hpp"
#include "sheetsplat/error.hpp"

namespace sheetsplat {

namespace {

/// IMAGE FORMATION section 9.
constexpr double float16_bound = 1.0 / 510.0;
constexpr double float16_worst = 1.0 / 85.0;
/// Below, quotients would see the steps of small weights in 16 bits.
constexpr double least_float16_scale = 0.1;
constexpr std::size_t most_lights = 64;
/// Each of them is looked up in eight places at every point.
constexpr std::size_t most_shadowing_lights = 16;
/// Elements of all light volumes of a scene; engine/light_volumes makes no more.
constexpr int least_buffer_texels = 64 << 20;
/// Sections in float32 are known to 6e-8 of the aspect; a picture of kernels of 1:100,000 was seen 1e-3 off at its
/// worst pixels.
constexpr double least_precise_aspect = 4096.0;
constexpr double largest_plain_aspect = 32768.0;
/// float32 knows places to 6e-8 of a pixel: kernels smaller than this are placed in float64.
constexpr double least_plain_px = 1e-2;
/// Where there is no float64: at 1e-5 the 99.9th percentile was seen at 1e-2.
constexpr double smallest_plain_px = 1e-4;
/// A record that serves all slices of a kernel knows its sections to 6e-8 of the aspect.
constexpr double largest_resident_aspect = 1024.0;
constexpr std::size_t most_resident_kernels = 1U << 20;
/// Bilinear mixing is off by at most falloff / 2 over the square of a texture's cells: 4e-6.
constexpr double largest_paper_falloff = 32.0;
constexpr int paper_cells_at_8 = 1024;
/// A quaternion in float32 turns a needle by 6e-8 of its length: at 1:1,000 the 99.9th percentile was seen at 1e-4.
constexpr double largest_paper_aspect = 1024.0;
/// Half a field's extent over its smallest semi-axis. Centres in float32 are known to 6e-8 of the former: seen were
/// 4e-8 times the quotient where they are moved in float64, 1.5e-7 where in float32.
constexpr double largest_paper_extent = 2048.0;
constexpr double largest_paper_extent_in_float32 = 512.0;
/// Kernels of one size at one place, where quotients of sums are lit, times the values over the window and the
/// reference length over the distance of samples: their errors add up. At 3,300 the 99.9th percentile was seen at 9e-4.
constexpr double most_alike_lit = 1000.0;
/// Differences that are splatted lose more: at 2,000 kernels 1.9e-2.
constexpr double fine_alike_factor = 10.0;
/// A few always are.
constexpr double least_alike = 64.0;
/// The same in the dark: at 100,000 the 99.9th percentile was seen at 8e-4.
constexpr double most_alike_unlit = 1e5;
/// Values over the window beyond which quotients that are lit are counted from the middle of the values. At 31
/// the 99.9th percentile was seen at 4e-4, and then at 2e-5.
constexpr double largest_plain_lit_ratio = 8.0;
/// g1 of gradient opacity, in windows per reference length, where quotients are divided: where the kernels that overlap
/// have one value their gradient is rounding alone. At 1e-4 the 99.9th percentile was seen at 7e-4.
constexpr double least_full_gradient = 2e-4;
/// Largest weight over w0, where gradients of quotients are lit that are made of splatted differences or derivatives:
/// quotients of next to nothing, near where kernels end, turn rounding into light. Gentle scenes are held to 2e-4 in
/// the 99.9th percentile, others to 1e-3. Seen were, of differences 1e-4 at 30, 3e-4 at 200, 9e-4 at 1,000 and 4e-3 at
/// 10,000; of derivatives 1e-4 at 10, 2e-4 at 100, 8e-4 at 10,000 and 5e-3 at 1e6; of differences at isosurfaces 3e-5
/// at 10,000, 3e-4 at 300,000 and 3e-3 at 1e6. Plain differences of neighbouring quotients keep their bound throughout.
struct WeightRange {
    double gentle, steep;
};
constexpr WeightRange widest_differences{50.0, 700.0};
constexpr WeightRange widest_derivatives{100.0, 1e4};
constexpr WeightRange widest_isosurface{3e4, 1e5};
/// ... times the square of this many reference lengths over what quotients change over: 1e-3 was seen at 280 with a
/// range of 10,000, 2e-3 at 2,880 with one of 100.
constexpr double magnified_isosurface = 100.0, widest_magnified_isosurface = 3e4;
/// Derivatives at isosurfaces in the shells where kernels end, beyond this: seen was 3e-5 times the root of the range
/// and the reference length over the smallest semi-axis.
constexpr double widest_isosurface_of_derivatives = 20.0;
constexpr WeightRange widest_by_semi_axis{40.0, 1000.0};
constexpr double gentle_steepness = 10.0, gentle_pixels = 100.0;
/// Reference lengths over what sums of quotients change over, where they are lit by splatted differences, times the
/// root of the kernels at a point: of 1,000 kernels the 99.9th percentile was seen at 3e-4 at 288, at 3.5e-3 at 2,880;
/// of 7 it was 4e-9 at 3,300.
constexpr double magnified_quotients = 25e3;
/// Kernels at a point, where quotients are lit: at 100,000 the 99.9th percentile was seen at 3e-4, at 500,000
/// at 1.3e-3.
constexpr double densest_lit = 2e5;
/// Places that textures know in float32; seen at 1e8 to be right, at 1e9 1e-2 off.
constexpr double largest_paper_px = 1e7;
/// Seen at 1e15 to be right; at 1e21 their squares leave float32.
constexpr double largest_deep_px = 1e15;
/// Beyond, the square of a distance in pixels leaves float32.
constexpr double largest_separable_px = 1e6;
/// What sums in a sheet may come to.
constexpr double largest_float16 = 6e4;
constexpr double largest_float32 = 1e36;
/// Share of a kernel's radius that its place on the screen may be off.
constexpr double largest_place_error = 1e-3;
constexpr std::int64_t most_imprecise_slices = 1 << 17;
/// On a rasteriser in software, elimination pays where pixels can become opaque within so many slices (measured: 0.65
/// to 0.76 of the time).
constexpr std::int64_t soon_opaque_slices = 16;

Tagging choose_tagging(const RendererOptions& options, const Capabilities& capabilities) {
    switch (options.tagging) {
    case Tagging::automatic:
        return capabilities.software       ? Tagging::tiles
               : capabilities.depth_bounds ? Tagging::depth_bounds
                                           : Tagging::tiles;
    case Tagging::depth_bounds:
        if (!capabilities.depth_bounds) {
            throw Unsupported(Complaint{
                "the plan cannot be made",
                "tagging depth_bounds on " + capabilities.renderer + ", which lacks GL_EXT_depth_bounds_test",
                "a device that has it",
                "use another " + option_ref("tagging") + ", for example " + option_ref("tagging", "tiles"), "tagging"});
        }
        return options.tagging;
    default:
        return options.tagging;
    }
}

const char* why_tagged(Tagging tagging) {
    switch (tagging) {
    case Tagging::depth_bounds:
        return "the depth buffer marks touched pixels, and the device tests its bounds";
    case Tagging::depth_equal:
        return "the depth buffer marks touched pixels, and passes test for equal depth";
    case Tagging::tiles:
        return "passes draw the tiles that kernels touch and no others";
    default:
        return "turned off: passes draw whole pictures";
    }
}

/// Sums of many equal numbers drift, where those of different ones walk at random.
void check_crowds(const ViewFacts& view, const DrawPlan& plan, bool lit_quotient, double ratio) {
    const double times = std::max(1.0, ratio);
    double most = most_alike_unlit / times;
    if (lit_quotient) {
        const double nearest = std::min(view.smallest_pixel, view.slice_spacing);
        most = most_alike_lit / times / std::max(1.0, view.reference_length / nearest) /
               (plan.fine_gradient ? fine_alike_factor : 1.0);
    }
    most = std::max(most, least_alike);
    const Words advice =
        lit_quotient ? "make one kernel of them, of their weights' sum and the mean of their values, leave "
                       "out the lights, use " +
                           option_ref("backend", "reference") + ", or pass " + option_ref("allow_inexact", "true")
                     : "make one kernel of them, use " + option_ref("backend", "reference") + ", or pass " +
                           option_ref("allow_inexact", "true");
    const char* failed = "the picture cannot be made within its error bound in 32-bit sheets";
    if (view.most_alike > most) {
        throw Unsupported(Complaint{failed, "about " + number(view.most_alike) + " ellipsoids of one size at one place",
                                    "at most " + number(std::floor(most)) + (lit_quotient ? " where they are lit" : ""),
                                    advice});
    }
    if (lit_quotient && view.densest_overlap * times > densest_lit) {
        throw Unsupported(Complaint{failed, "about " + number(view.densest_overlap) + " ellipsoids at a point",
                                    "at most " + number(densest_lit / times) + " where they are lit",
                                    "use fewer or smaller ellipsoids, leave out the lights, use " +
                                        option_ref("backend", "reference") +
                                        ", or "
                                        "pass " +
                                        option_ref("allow_inexact", "true")});
    }
}

/// Why sheets stay 32-bit; empty where 16 bits keep their bound over the whole picture, on a device that gains by them.
std::string why_float32(const Scene& scene, const ViewFacts& view, const Capabilities& capabilities,
                        const DrawPlan& plan) {
    if (capabilities.software) {
        return "a rasteriser in software gains nothing by 16 bits";
    }
    if (!capabilities.float16_blend_rounds) {
        return "this device cuts off sums in 16 bits";
    }
    if (plan.mode != Mode::composite || plan.coverage) {
        return "numbers are shown, which 16 bits would round";
    }
    if (plan.gradient) {
        return "gradients are differences of sums, which 16 bits would lose";
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

bool sums_go_beyond(const Scene& scene) {
    return std::any_of(scene.fields.begin(), scene.fields.end(),
                       [](const auto& field) { return field->normalization() != Normalization::lattice; });
}

/// Largest values over what is resolved where those of quotients are counted from their middle.
double ratio_from_middle(const Scene& scene, double resolved) {
    double largest = 0.0;
    for (const auto& field : scene.fields) {
        if (field->normalization() == Normalization::threshold) {
            const double pivot = pivot_of(*field);
            const std::array<double, 2> range = field->value_range();
            largest = std::max({largest, std::abs(range[0] - pivot), std::abs(range[1] - pivot)});
        }
    }
    return largest / resolved;
}

/// What float32 loses of gradients of quotients that are near their kernels' ends, or far magnified. ratio: of values
/// over what is resolved.
void check_quotients(const ViewFacts& view, const DrawPlan& plan, const SumFacts& facts, double ratio) {
    if (view.kernels == 0 || view.slices == 0 || !(plan.fine_gradient || plan.analytic_gradient)) {
        return;
    }
    const char* failed = "the picture cannot be made within its error bound in 32-bit sheets";
    const double ell = view.reference_length;
    const bool gentle = facts.steepness <= gentle_steepness && ell <= gentle_pixels * view.smallest_pixel;
    const auto most_of = [&](const WeightRange& range) {
        return (gentle ? range.gentle : range.steep) / std::max(1.0, ratio);
    };
    const bool isosurface = plan.mode == Mode::isosurface;
    const double axis = view.smallest_radius_px * view.smallest_pixel;
    double most = most_of(plan.analytic_gradient ? widest_derivatives
                          : isosurface           ? widest_isosurface
                                                 : widest_differences);
    const double change = std::max(axis, view.smallest_pixel);
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
             ? "leave out " + option_ref("gradient", "analytic") + ", use a larger " + option_ref("w0")
             : "use a larger " + option_ref("w0") + " or " + option_ref("gradient", "analytic")) +
        Words(", use " + option_ref("backend", "cpu") + ", or pass " + option_ref("allow_inexact", "true"));
    if (facts.weight_range > most) {
        throw Unsupported(Complaint{failed,
                                    "weights of up to " + number(facts.weight_range) +
                                        " times w0, whose quotients are lit where kernels end",
                                    "at most " + number(most) + " times w0", way_out});
    }
    // What a ray goes through is no more opaque than its length lets it be. Surfaces are where differences are large.
    const double seen = std::min(ell, view.slice_spacing * static_cast<double>(view.slices));
    const double magnified = std::max(1.0, ratio) * seen / change;
    const double most_magnified = magnified_quotients / std::sqrt(std::max(1.0, view.densest_overlap));
    if (plan.fine_gradient && !isosurface && magnified > most_magnified) {
        throw Unsupported(Complaint{
            failed,
            "quotients of sums that are lit where a reference length is " + number(magnified) + " pixels or semi-axes",
            "at most " + number(std::floor(most_magnified)) + " with about " + number(view.densest_overlap) +
                " ellipsoids at a point",
            "use " + option_ref("gradient", "analytic") + ", a smaller " + option_ref("reference_length") + " or " +
                option_ref("backend", "cpu") + ", or pass " + option_ref("allow_inexact", "true")});
    }
}

void check_precision(const Scene& scene, const ViewFacts& view, const RendererOptions& options,
                     const Capabilities& capabilities, DrawPlan& plan) {
    const SumFacts facts = sum_facts(scene, view, plan);
    const auto& [overlap, largest, resolved, ratio, sum, steepness, least_scale, weight_range, crowd, bend] = facts;
    const bool lost = least_scale < least_divisor;
    const double sums = float32_epsilon * std::sqrt(overlap) * ratio;
    // Sheets of 8 bits end at 1, which sums of weights, and of values that are not divided, go beyond.
    const bool ends = plan.precision == Precision::uint8 && sums_go_beyond(scene);
    const double noise = ends ? 1.0 : sum_noise(plan.precision, !capabilities.float16_blend_rounds, crowd);
    expect_errors(view, facts, noise, plan);
    if (options.allow_inexact) {
        return;
    }
    const double expected = plan.summary.expected_error();
    const double worst = noise * ratio * steepness;
    if (plan.precision == Precision::uint8 ||
        (plan.precision == Precision::float16 && (expected > float16_bound || worst > float16_worst))) {
        throw Unsupported(
            Complaint{std::string("the picture cannot be made with ") + to_string(plan.precision) + " sheets",
                      "an expected error of " + number(expected) + ", and of " + number(worst) +
                          " where colours are steepest: up to " + number(crowd) + " kernels at a point",
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
                      "scale the weights and " + option_ref("w0") + " by one factor, use " +
                          option_ref("backend", "reference") + ", or pass " + option_ref("allow_inexact", "true")});
    }
    // Errors of single slices partly cancel along a ray; what a steep ramp adds, it adds at few pixels.
    const double picture = 0.25 * sums * std::min(steepness, 4.0);
    const bool lit_quotient = lights_quotients(plan);
    // Quotients in sheets of their own are counted from the middle of the values, however far that is from 0.
    const bool from_middle = !plan.own_sheets.empty() && !plan.paper_slicing;
    const double lit_ratio = from_middle ? std::min(ratio, ratio_from_middle(scene, resolved)) : ratio;
    const bool too_far = lit_quotient && lit_ratio > largest_lit_ratio;
    const double most_times = 4.0 * float32_bound / (sums / ratio) / std::min(steepness, 4.0);
    if (plan.precision == Precision::float32 && (picture > float32_bound || too_far)) {
        throw Unsupported(Complaint{"the picture cannot be made within its error bound in 32-bit sheets",
                                    "values up to " + number(largest) + " where " + number(resolved) + " is resolved",
                                    "values of at most " +
                                        number(too_far ? std::min(largest_lit_ratio, most_times) : most_times) +
                                        " times that",
                                    "subtract an offset from the values, use " + option_ref("backend", "reference") +
                                        ", or pass " + option_ref("allow_inexact", "true")});
    }
    if (plan.gradient_opacity) {
        const double nearest = std::min(view.smallest_pixel, view.slice_spacing);
        const bool differences = !plan.analytic_gradient && !plan.fine_gradient;
        const double least = least_full_gradient * std::max(1.0, lit_ratio) *
                             (differences ? std::max(1.0, view.reference_length / nearest) : 1.0);
        if (*scene.gradient_opacity * view.reference_length < least * plan.value_unit) {
            throw Unsupported(Complaint{"the picture cannot be made within its error bound in 32-bit sheets",
                                        option_ref("gradient_opacity", number(*scene.gradient_opacity)) +
                                            ", near which gradients are lost to rounding",
                                        "at least " + number(least * plan.value_unit / view.reference_length),
                                        "use a larger one, use " + option_ref("backend", "reference") + ", or pass " +
                                            option_ref("allow_inexact", "true"),
                                        "gradient_opacity"});
        }
    }
    if (lit_quotient) {
        check_quotients(view, plan, facts, lit_ratio);
    }
    check_crowds(view, plan, lit_quotient, ratio);
    const double measure = plan.mode == Mode::xray ? view.slice_spacing : 1.0;
    const double seen =
        plan.mode == Mode::xray || plan.mode == Mode::mip ? std::max(1.0, measure * view.thin_peak) : resolved;
    if (plan.sampling == Sampling::slab && !plan.filter &&
        measure * view.thin_loss / seen * std::min(steepness, 4.0) > thick_slab) {
        throw Unsupported(
            Complaint{"the picture cannot be made within its error bound in 32-bit sheets",
                      "slabs of " + number(view.slice_spacing) +
                          ", in which float32 loses the place of ellipsoids that are so much thinner",
                      "slabs of at most " + number(thick_slab) + " times the half-depth of ellipsoids that show",
                      "use a smaller " + option_ref("slice_spacing") + ", " + option_ref("filter", "ewa") + " or " +
                          option_ref("backend", "reference") + ", or pass " + option_ref("allow_inexact", "true")});
    }
}

/// Why the slicing of [NM06] cannot draw a scene; empty where it can.
std::string unfit_for_paper_slicing(const Scene& scene, const ViewFacts& view, const RendererOptions& options,
                                    const DrawPlan& plan, bool float64) {
    if (!view.ellipsoids) {
        return "a scene without scattered ellipsoids";
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
    if (view.largest_px > largest_paper_px && !options.allow_inexact) {
        return "kernels of " + number(view.largest_px) + " pixels, of " + number(largest_paper_px) + " at most";
    }
    if (view.most_ellipsoids > most_resident_kernels) {
        return number(static_cast<double>(view.most_ellipsoids)) + " kernels in one field, of " +
               number(static_cast<double>(most_resident_kernels)) + " at most";
    }
    const auto resident = options.effects.find("resident_sections");
    if (resident != options.effects.end() && resident->second) {
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
    if (view.largest_aspect > largest_paper_aspect && !options.allow_inexact) {
        return "kernels of 1:" + number(view.largest_aspect) +
               ", where float32 textures know rotations for 1:" + number(largest_paper_aspect) + " at most";
    }
    if (view.smallest_px < least_plain_px && !options.allow_inexact) {
        return "kernels of " + number(view.smallest_px) + " pixels, of " + number(least_plain_px) + " at least";
    }
    return options.packing == Packing::wide ? "packing wide" : "";
}

} // namespace

void plan_gl(const Scene& scene, const ViewFacts& view, const RendererOptions& options, const Outputs& outputs,
             const Capabilities& capabilities, const SceneCalls& calls, Effects& effects, DrawPlan& plan) {
    RenderPlan& summary = plan.summary;
    const Projection projection = plan.projection;
    const bool scalar = scene.mode == Mode::xray || scene.mode == Mode::mip;
    // Derivatives of quotients are taken where the quotients are, before slabs are shaded. There values that lie far
    // from 0 are counted from their middle, too, and keep the digits that differences need.
    const auto forced = [&](const char* name) {
        const auto found = options.effects.find(name);
        return found != options.effects.end() && found->second;
    };
    const bool far_off = lights_quotients(plan) && !plan.fine_gradient && !forced("paper_slicing") &&
                         sum_facts(scene, view, plan).ratio > largest_plain_lit_ratio;
    divide_apart(scene, outputs, effects, plan, plan.analytic_gradient || far_off);
    if (plan.fine_gradient && !plan.own_sheets.empty()) {
        throw Unsupported(Complaint{
            "the scene cannot be drawn with backend gl",
            "a lit close-up of several fields, one with " + option_ref("normalization", "threshold") +
                ", whose pixels or slices are closer "
                "than an eighth of the reference length",
            "such a close-up of one field, or of fields with " + option_ref("normalization", "none") + " or " +
                option_ref("normalization", "lattice"),
            "use " + option_ref("gradient", "analytic") + ", a larger " + option_ref("slice_spacing") + ", a smaller " +
                option_ref("reference_length") + ", or " + option_ref("backend", "reference")});
    }
    // Differences of values and of weights of two sheets at once would take more texture units than every device has.
    const bool crowded = plan.fine_gradient && plan.threshold;
    plan.packing = options.packing == Packing::automatic ? crowded ? Packing::paper : Packing::wide : options.packing;
    if (crowded && plan.packing == Packing::wide && capabilities.max_texture_units <= 20) {
        throw Unsupported(Complaint{
            "the plan cannot be made",
            "packing wide for a close-up of a field with normalization threshold, which needs 21 texture units of " +
                std::to_string(capabilities.max_texture_units),
            option_ref("packing", "auto") + " or " + option_ref("packing", "paper"),
            "leave out " + option_ref("packing"), "packing"});
    }
    plan.tagging = choose_tagging(options, capabilities);
    plan.precision = options.precision == Precision::automatic ? Precision::float32 : options.precision;
    if (plan.precision == Precision::float64) {
        throw Unsupported(Complaint{
            "the plan cannot be made", "precision float64 with backend gl, whose targets blend 32 bits at most",
            "auto, uint8, float16 or float32", "use " + option_ref("backend", "cpu") + " for float64", "precision"});
    }
    plan.culling = effects.decide("culling", true, "kernels that cannot matter are not drawn");
    // Depth tests slow a rasteriser in software more than they save where little becomes opaque: there it must happen
    // within a few slices.
    const bool soon =
        scene.mode == Mode::isosurface || saturates_within(scene, view, soon_opaque_slices, calls.opacity);
    const bool eliminate = calls.stops && !outputs.coverage && (!capabilities.software || soon);
    plan.elimination = effects.decide("elimination", eliminate,
                                      !calls.stops       ? "nothing can become opaque enough to stop"
                                      : outputs.coverage ? "coverage looks behind opaque pixels"
                                      : eliminate        ? "opaque pixels take no more splats"
                                                         : "depth tests cost more than they save on this rasteriser") &&
                       calls.stops && !outputs.coverage;
    plan.opacity_buffer = effects.decide("opacity_buffer", false,
                                         "reading opacity back costs more than it saves as a rule; ask for it") &&
                          calls.stops && !outputs.coverage;
    const bool sprites = projection == Projection::orthographic &&
                         2.0 * view.largest_splat_px + 1.0 <= static_cast<double>(capabilities.max_point_size);
    const bool slopes = plan.fine_gradient || plan.analytic_gradient;
    const bool round = calls.spheres && plan.sampling == Sampling::point && !slopes;
    plan.points = sprites && (calls.lattices || round);
    effects.state("points", plan.points,
                  projection == Projection::perspective ? "kernels differ in size: quads fit them"
                  : !sprites                            ? "kernels are larger than the largest point sprite: quads"
                  : calls.lattices                      ? "point sprites need one vertex a kernel"
                  : round ? "spheres that are small enough are point sprites of one vertex each"
                          : "ellipsoids are drawn as rectangles along the axes of their sections");
    plan.separable =
        !plan.general && plan.sampling == Sampling::point && !slopes && view.largest_splat_px < largest_separable_px;
    plan.paper_slicing =
        effects.decide("paper_slicing", false, "the 2006 paper's slicing step by step, for comparison: not asked for");
    if (plan.paper_slicing) {
        const std::string unfit = unfit_for_paper_slicing(scene, view, options, plan, capabilities.at_least(4, 0));
        if (!unfit.empty()) {
            throw Unsupported(Complaint{"the plan cannot be made with effect paper_slicing", unfit,
                                        "ellipsoids in orthographic view, point-sampled, unfiltered, packing paper",
                                        "leave it out of " + option_ref("effects"), "effects"});
        }
        double falloff = 8.0;
        for (const auto& field : scene.fields) {
            falloff = as_ellipsoids(field.get()) != nullptr ? std::max(falloff, field->kernel().falloff) : falloff;
        }
        plan.packing = Packing::paper;
        plan.gaussian_cells = static_cast<int>(std::ceil(paper_cells_at_8 * std::sqrt(falloff / 8.0)));
        summary.error_budget.push_back(
            {"the Gaussian as a texture of " + std::to_string(plan.gaussian_cells + 1) + " x " +
                 std::to_string(plan.gaussian_cells + 1),
             0.5 * falloff / (static_cast<double>(plan.gaussian_cells) * plan.gaussian_cells), "paper_slicing"});
    }
    const bool slender = view.largest_aspect > least_precise_aspect;
    const bool tiny = !plan.filter && view.smallest_px < least_plain_px;
    const bool exact_places = (slender || tiny) && capabilities.at_least(4, 0);
    if (effects.decide("precise_sections", exact_places,
                       !view.ellipsoids    ? "no field holds ellipsoids"
                       : !slender && !tiny ? "no ellipsoid is so slender that float32 would lose its sections"
                       : exact_places && tiny
                           ? "ellipsoids of less than " + number(least_plain_px) + " pixels are placed in float64"
                       : exact_places
                           ? "ellipsoids of more than 1:" + number(least_precise_aspect) + " are placed in float64"
                           : "OpenGL " + capabilities.version + " has no float64",
                       true) &&
        exact_places) {
        plan.precise_aspect = least_precise_aspect;
    }
    if (slender && !exact_places && view.largest_aspect > largest_plain_aspect && !options.allow_inexact) {
        throw Unsupported(Complaint{
            "the scene cannot be drawn within its error bound",
            "ellipsoids of 1:" + number(view.largest_aspect) + " on OpenGL " + capabilities.version,
            "OpenGL 4.0 for places in float64, or at most 1:" + number(largest_plain_aspect),
            "pass " + option_ref("min_scale", "...") + " to the field, or use " + option_ref("backend", "reference")});
    }
    if (tiny && !exact_places && view.smallest_px < smallest_plain_px && !options.allow_inexact) {
        throw Unsupported(
            Complaint{"the scene cannot be drawn within its error bound",
                      "ellipsoids of " + number(view.smallest_px) + " pixels on OpenGL " + capabilities.version,
                      "OpenGL 4.0 for places in float64, or at least " + number(smallest_plain_px),
                      "pass " + option_ref("min_scale", "...") + " to the field, use " + option_ref("filter", "ewa") +
                          ", or use " + option_ref("backend", "reference")});
    }
    const bool can_reside = !plan.paper_slicing && view.ellipsoids && !plan.filter && !tiny &&
                            capabilities.at_least(4, 1) && view.largest_aspect <= largest_resident_aspect &&
                            view.most_ellipsoids <= most_resident_kernels;
    const std::string why_resident =
        plan.filter                    ? "filtered kernels are sliced by the processor"
        : !view.ellipsoids             ? "no field holds ellipsoids"
        : plan.paper_slicing           ? "kernels are sliced as in the 2006 paper"
        : !capabilities.at_least(4, 1) ? "OpenGL " + capabilities.version + " has no float64 vertex programs"
        : tiny                         ? "kernels of less than " + number(least_plain_px) +
                     " pixels are sliced anew for each batch, to keep "
                     "their digits"
        : view.largest_aspect > largest_resident_aspect
            ? "kernels of 1:" + number(view.largest_aspect) + " are sliced anew for each batch, to keep their digits"
        : view.most_ellipsoids > most_resident_kernels
            ? kernels(view.most_ellipsoids) + " are sliced batch by batch, in bounded memory"
        : capabilities.software ? "a device in software slices no faster than the processor that it runs on"
                                : "one pass on the device slices all kernels, and nothing is uploaded or read back";
    plan.resident_sections = effects.decide("resident_sections", can_reside && !capabilities.software, why_resident);
    if (plan.resident_sections && !can_reside) {
        throw Unsupported(Complaint{"the plan cannot be made", "resident_sections forced on: " + why_resident,
                                    "ellipsoids that the device can slice", "leave it out of " + option_ref("effects"),
                                    "effects"});
    }
    plan.slab_nodes = view.widest_slab < 0.6 ? 4 : view.widest_slab < 1.5 ? 6 : 0;
    // Six nodes are exact to 1e-7 over 1.5 of the Gaussian's own lengths; a chord is at most 2 sqrt(k) of them long.
    plan.slab_pieces = static_cast<int>(std::clamp(std::ceil(view.widest_slab / 1.5), 1.0, 4.0));
    const bool many = view.slices > most_plain_slices && scene.mode == Mode::composite;
    plan.compensated = effects.decide("compensation", many,
                                      many ? "so many slices would let plain float32 sums drift"
                                           : "sums over these slices keep their digits",
                                      true) &&
                       scene.mode == Mode::composite;
    if (view.slices > most_imprecise_slices && !capabilities.at_least(4, 0) && !options.allow_inexact) {
        throw Unsupported(Complaint{"the scene cannot be drawn within its error bound",
                                    std::to_string(view.slices) + " slices on OpenGL " + capabilities.version,
                                    "OpenGL 4.0 for compensated sums, or at most " +
                                        std::to_string(most_imprecise_slices) + " slices",
                                    "use a larger slice_spacing, or backend reference"});
    }
    plan.read_image =
        plan.compensated || plan.stop || scene.mode == Mode::isosurface || scalar || plan.depth || plan.coverage;
    effects.state("background", scene.background.has_value() && !scalar,
                  scene.background ? "a background was given" : "no background was given");
    effects.state("coverage", plan.coverage, plan.coverage ? "asked for" : "not asked for");
    effects.state("depth", outputs.depth, outputs.depth ? "asked for" : "not asked for");

    if (scene.lights.size() > most_lights) {
        throw Unsupported(Complaint{"the scene cannot be drawn with backend gl",
                                    std::to_string(scene.lights.size()) + " lights", "at most 64",
                                    "use fewer lights, or " + option_ref("backend", "reference")});
    }
    if (plan.shadows && scene.lights.size() > most_shadowing_lights) {
        throw Unsupported(Complaint{
            "the scene cannot be drawn with backend gl", std::to_string(scene.lights.size()) + " lights with shadows",
            "at most " + std::to_string(most_shadowing_lights),
            "use fewer lights, leave out " + option_ref("shadows") + ", or use " + option_ref("backend", "reference")});
    }
    if ((plan.shadows || plan.ambient_occlusion) && capabilities.max_buffer_texels < least_buffer_texels) {
        throw Unsupported(
            Complaint{"the scene cannot be drawn with backend gl",
                      "shadows or ambient occlusion on a device whose buffer textures hold " +
                          std::to_string(capabilities.max_buffer_texels) + " texels",
                      "at least " + std::to_string(least_buffer_texels) + ", for the opacity along rays to lights",
                      "use " + option_ref("backend", "cpu")});
    }
    if (!options.allow_inexact) {
        effects.refuse_dropped();
    }
    const bool deep = projection == Projection::perspective;
    if (view.slices > 0 && view.largest_px > (deep ? largest_deep_px : largest_splat_px) && !options.allow_inexact) {
        throw Unsupported(Complaint{"the scene cannot be drawn with backend gl",
                                    "ellipsoids of " + number(view.largest_px) + " pixels" +
                                        (deep ? " at a distance of one unit of length" : ""),
                                    "at most " + number(deep ? largest_deep_px : largest_splat_px),
                                    deep ? "use a larger unit of length, or " + option_ref("backend", "reference")
                                         : "magnify less, or use " + option_ref("backend", "reference")});
    }
    if (view.largest_splat_px > largest_splat_px && !options.allow_inexact) {
        throw Unsupported(Complaint{
            "the scene cannot be drawn with backend gl", "kernels of " + number(view.largest_splat_px) + " pixels",
            "at most " + number(largest_splat_px), "magnify less, or use " + option_ref("backend", "reference")});
    }
    const double place_error = std::max(view.size.width, view.size.height) * float32_epsilon;
    if (view.slices > 0 && view.largest_splat_px > 0.0 && place_error > largest_place_error * view.largest_splat_px &&
        !options.allow_inexact) {
        throw Unsupported(Complaint{"the scene cannot be drawn with backend gl",
                                    "kernels of " + number(view.largest_splat_px) +
                                        " pixels, whose positions float32 resolves to " + number(place_error),
                                    "positions resolved to " + number(largest_place_error) + " of a radius",
                                    "move the camera closer, or use " + option_ref("backend", "reference")});
    }
    if (view.smallest_falloff < smallest_falloff && !options.allow_inexact) {
        throw Unsupported(
            Complaint{"the scene cannot be drawn with backend gl",
                      "a falloff of " + number(view.smallest_falloff) + ", whose differences float32 cannot resolve",
                      "at least " + number(smallest_falloff),
                      "use a larger " + option_ref("falloff") + ", or " + option_ref("backend", "reference")});
    }
    const std::string wide = why_float32(scene, view, capabilities, plan);
    if (options.precision == Precision::automatic && wide.empty()) {
        plan.precision = Precision::float16;
    }
    effects.state("float16", plan.precision == Precision::float16,
                  options.precision != Precision::automatic
                      ? std::string("precision ") + to_string(options.precision) + " was asked for"
                  : wide.empty() ? "16 bits keep their bound over the whole picture, and this device gains by them"
                                 : wide);
    check_precision(scene, view, options, capabilities, plan);
    effects.state("tagging", plan.tagging != Tagging::off, why_tagged(plan.tagging));
    effects.state("sums", true, std::string("kernels are summed in sheets of ") + to_string(plan.precision));

    summary.precision = plan.precision;
    summary.packing = plan.packing;
    summary.tagging = plan.tagging;
    summary.device = capabilities.renderer + ", OpenGL " + capabilities.version + ", by " + capabilities.platform;
    const std::uint64_t texel = plan.precision == Precision::float32   ? 16
                                : plan.precision == Precision::float16 ? 8
                                                                       : 4;
    const auto own = static_cast<std::uint64_t>(
        std::count_if(plan.own_sheets.begin(), plan.own_sheets.end(), [](int number) { return number >= 0; }));
    const std::uint64_t sheets =
        (plan.packing == Packing::wide ? 3U : 2U) * ((slopes ? 4U : 1U) + (!plan.weight               ? 0U
                                                                           : slopes && plan.threshold ? 4U
                                                                                                      : 1U)) +
        own * (plan.packing == Packing::wide ? 3U : 1U) * (slopes ? 8U : 2U);
    summary.memory = static_cast<std::uint64_t>(view.size.width + 2) *
                     static_cast<std::uint64_t>(view.size.height + 2) * (sheets * texel + 16 + 4 + 16);
}

} // namespace sheetsplat

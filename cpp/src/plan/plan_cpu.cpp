// The plan of backend cpu: no ways of drawing to choose from, and float64 where float32 would not keep its bound.
#include <algorithm>
#include <array>
#include <cmath>

#include "effects.hpp"
#include "sheetsplat/error.hpp"

namespace sheetsplat {

namespace {

/// Gaussians of a column each follow from the one before: relative error, as seen.
constexpr double walked_noise = 2e-7;
/// Sections of slender ellipsoids are known to epsilon times the aspect.
constexpr double largest_float32_aspect = 512.0;
/// Places are counted from the corner of an image tile: float32 knows them to some 4e-6 pixels.
constexpr double least_float32_px = 0.05;
/// Where leaning ellipsoids that hardly overlap are lit, gradients in their middles are 0, and what rounding of places
/// makes of them shows, in scenes of either bound: needles of 1:3 of 0.8 to 2.1 pixels, a pixel in the middle of each,
/// were seen at 2e-4 to 4e-4 in the 99.9th percentile. Larger ones have too few middles for that.
constexpr double least_lit_float32_px = 16.0, least_steep_lit_float32_px = 0.3;
constexpr double few_overlaps = 3.0;
constexpr double gentle_steepness = 10.0;
/// Longest over shortest semi-axis of what is as good as a sphere.
constexpr double sphere_aspect = 1.001;
/// Beyond, a quotient of sums that is lit loses digits to the many kernels that it is made of.
constexpr double largest_lit_overlap = 1000.0;
/// Slab distance over half depth, above which differences of erf lose what a thin kernel adds.
constexpr double thickest_float32_slab = 100.0;
/// Distances on the screen in pixels whose squares float32 resolves beside a pixel's.
constexpr double largest_float32_px = 1e6;
/// The profile is a difference of nearly equal numbers, enlarged: at 0.07 and 0.2 pictures were seen at their bounds.
constexpr double least_float32_falloff = 0.5;
constexpr double largest_float32_sum = 1e30;
constexpr double largest_float64_sum = 1e250;
constexpr double smallest_float64_falloff = 1e-8;
/// Steeper kernels, with weights of 0 too, leave nothing in the sheets near their ends, which tells empty points.
constexpr double steepest_float32 = 20.0;
constexpr double steepest_float64 = 600.0;
/// Kernels of one size at one place round alike: so many, times values over what is resolved, drift through a picture.
constexpr double most_alike_float32 = 5000.0;
/// The same where quotients are lit, times the reference length over a pixel or slice distance: at 700 the picture's
/// error was seen at its bound.
constexpr double most_alike_lit_float32 = 200.0;
constexpr double few_alike = 3.0;
/// Where quotients hardly change, their rounding is lit: root mean square 1e-6 of the picture times values over what is
/// resolved, the root of the kernels at a point, and the reference length over a pixel or slice distance.
constexpr double largest_lit_noise = 80.0;
/// Reference lengths over a pixel or slice distance: beyond, differences of float64 sums lose gradients that show.
constexpr double largest_float64_magnification = 1e11;
/// Slice distances in perspective, and their inverses: squares of lengths a unit of depth leave float32 beyond.
constexpr double largest_float32_unit = 1e8;
/// Quotients that are lit lose epsilon times this: the same share of the digits in both precisions.
constexpr double largest_float64_lit_ratio = largest_lit_ratio * (float32_epsilon / float64_epsilon);

constexpr std::array<const char*, 7> of_gl = {"fine_gradient", "resident_sections", "precise_sections",
                                              "paper_slicing", "opacity_buffer",    "elimination",
                                              "compensation"};

void refuse_ways_of_gl(const RendererOptions& options) {
    for (const char* name : of_gl) {
        const auto found = options.effects.find(name);
        if (found != options.effects.end() && found->second) {
            throw Unsupported(Complaint{
                "the plan cannot be made", std::string("effect ") + name + " forced on with backend cpu",
                "effects that backend cpu has",
                "use " + option_ref("backend", "gl") + ", or leave the effect out of " + option_ref("effects"),
                "effects"});
        }
    }
    if (options.tagging != Tagging::automatic && options.tagging != Tagging::tiles) {
        throw Unsupported(Complaint{
            "the plan cannot be made", std::string("tagging ") + to_string(options.tagging) + " with backend cpu",
            "auto or tiles, the one way in which it skips empty space",
            "use " + option_ref("backend", "gl") + ", or leave out " + option_ref("tagging"), "tagging"});
    }
    if (options.packing == Packing::paper) {
        throw Unsupported(Complaint{"the plan cannot be made", "packing paper with backend cpu",
                                    "auto or wide: slices are not packed into colour channels",
                                    "use " + option_ref("backend", "gl") + ", or leave out " + option_ref("packing"),
                                    "packing"});
    }
    if (options.precision == Precision::float16 || options.precision == Precision::uint8) {
        throw Unsupported(Complaint{
            "the plan cannot be made", std::string("precision ") + to_string(options.precision) + " with backend cpu",
            "auto, float32 or float64", "use " + option_ref("backend", "gl") + " for lower precision", "precision"});
    }
}

/// Error of a picture that sums add, root mean square. Errors of single slices partly cancel along a ray; what a steep
/// ramp adds, it adds at few pixels.
double picture_error(const SumFacts& sums, double epsilon) {
    return 0.25 * epsilon * std::sqrt(sums.overlap) * sums.ratio * std::min(sums.steepness, 4.0);
}

double largest_radius_px(const ViewFacts& view) { return std::max(view.largest_splat_px, view.largest_radius_px); }

double steepest_falloff(const Scene& scene) {
    double steepest = 0.0;
    for (const auto& field : scene.fields) {
        steepest = std::max(steepest, field->size() > 0 ? field->kernel().falloff : 0.0);
    }
    return steepest;
}

/// Least g1 of gradient opacity whose pictures keep their bound: what rounding makes of a gradient of 0 may not be
/// seen.
double least_faded(const Scene& scene, const ViewFacts& view, const SumFacts& sums, double epsilon) {
    constexpr double seen = 1e-4;
    const double shortest = std::min(view.smallest_pixel, view.slice_spacing);
    const double window = scene.transfer_function.v_max() - scene.transfer_function.v_min();
    const double rho = std::max(sums.largest, window);
    return epsilon * std::sqrt(std::max(1.0, sums.overlap)) * rho / shortest / seen;
}

/// Why float32 would not keep its bound; empty where it does.
std::string why_float64(const Scene& scene, const ViewFacts& view, const DrawPlan& plan, const SumFacts& sums) {
    const std::string ell = number(view.reference_length) + " (the reference length)";
    if (view.kernels == 0 || view.slices == 0) {
        return "";
    }
    if (plan.gradient && !plan.analytic_gradient &&
        std::min(view.smallest_pixel, view.slice_spacing) < fine_gradient_below * view.reference_length) {
        return "a pixel of " + number(view.smallest_pixel) + " or a slice distance of " + number(view.slice_spacing) +
               " is below an eighth of " + ell + ": differences of float32 sums would lose the gradient";
    }
    if (plan.mode == Mode::composite && view.slices > most_plain_slices) {
        return std::to_string(view.slices) + " slices would let float32 sums drift";
    }
    if (view.largest_aspect > largest_float32_aspect) {
        return "float32 would lose sections of ellipsoids of 1:" + number(view.largest_aspect);
    }
    if (!plan.filter && view.smallest_radius_px < least_float32_px) {
        return "float32 would lose the places of kernels of " + number(view.smallest_radius_px) + " pixels";
    }
    const double least_lit_px = sums.steepness > gentle_steepness ? least_steep_lit_float32_px : least_lit_float32_px;
    if (plan.gradient && !plan.filter && view.largest_aspect > sphere_aspect && view.largest_overlap < few_overlaps &&
        view.smallest_px < least_lit_px) {
        return "float32 would lose the gradients in the middle of ellipsoids of " + number(view.smallest_px) +
               " pixels";
    }
    if (largest_radius_px(view) > largest_float32_px) {
        return "float32 would lose distances in kernels of " + number(largest_radius_px(view)) + " pixels";
    }
    if (scene.sampling == Sampling::slab && !plan.filter && view.thickest_slab > thickest_float32_slab) {
        return "a slab is " + number(view.thickest_slab) + " times as thick as half a kernel";
    }
    if (plan.gradient_opacity && least_faded(scene, view, sums, float32_epsilon) > *scene.gradient_opacity) {
        return "gradient_opacity " + number(*scene.gradient_opacity) + " is what float32 sums lose of a gradient";
    }
    if (view.smallest_falloff < least_float32_falloff) {
        return "float32 would lose the profile of a falloff of " + number(view.smallest_falloff);
    }
    if (sums.sum > largest_float32_sum) {
        return "sums reach " + number(sums.sum);
    }
    if (picture_error(sums, float32_epsilon) > float32_bound) {
        return "values reach " + number(sums.largest) + " where " + number(sums.resolved) + " is resolved";
    }
    if (lights_quotients(plan) && sums.ratio > largest_lit_ratio) {
        return "quotients that reach " + number(sums.largest) + " are lit where " + number(sums.resolved) +
               " is resolved";
    }
    const double alike = view.most_alike * std::max(1.0, sums.ratio);
    // Where differences are taken, of neighbouring pixels; derivatives change over kernels.
    const double change = plan.analytic_gradient ? view.smallest_radius_px * view.smallest_pixel
                                                 : std::min(view.smallest_pixel, view.slice_spacing);
    const double magnified = std::max(1.0, view.reference_length / change);
    if (alike > most_alike_float32 ||
        (lights_quotients(plan) && view.most_alike > few_alike && alike * magnified > most_alike_lit_float32)) {
        return "float32 sums of " + number(view.most_alike) + " ellipsoids of one size at one place drift";
    }
    const double unit = view.slice_spacing;
    if (plan.projection == Projection::perspective &&
        (unit > largest_float32_unit || unit < 1.0 / largest_float32_unit)) {
        return "squares of lengths in steps of " + number(unit) + " leave float32";
    }
    const double shown = plan.mode == Mode::xray ? plan.value_unit * unit : plan.value_unit;
    if ((plan.mode == Mode::xray || plan.mode == Mode::mip) && shown > largest_float32_sum) {
        return "numbers of " + number(shown) + " leave float32";
    }
    if (plan.empty_test && steepest_falloff(scene) > steepest_float32) {
        return "float32 would lose where kernels of a falloff of " + number(steepest_falloff(scene)) + " end";
    }
    const double crowd = std::max(sums.overlap, view.densest_overlap);
    if (lights_quotients(plan) &&
        (crowd > largest_lit_overlap || std::max(1.0, sums.ratio) * std::sqrt(crowd) * magnified > largest_lit_noise)) {
        return "quotients of " + number(crowd) + " kernels at a point, of up to " + number(sums.ratio) +
               " times what is resolved, are lit where " + number(magnified) +
               " pixels or slice distances are a reference length";
    }
    return "";
}

void refuse_beyond_float64(const Scene& scene, const ViewFacts& view, const DrawPlan& plan, const SumFacts& sums) {
    const auto refuse = [](const Words& found, const Words& wanted, const Words& advice) {
        throw Unsupported(Complaint{"the scene cannot be drawn within its error bound with backend cpu", found, wanted,
                                    advice + ", use " + option_ref("backend", "reference") + ", or pass " +
                                        option_ref("allow_inexact", "true")});
    };
    if (view.kernels == 0 || view.slices == 0) {
        return;
    }
    const bool deep = plan.projection == Projection::perspective;
    const double radius_px = deep ? view.largest_splat_px : largest_radius_px(view);
    if (radius_px > largest_splat_px) {
        refuse("kernels of " + number(radius_px) + " pixels", "at most " + number(largest_splat_px), "magnify less");
    }
    if (view.smallest_falloff < smallest_float64_falloff) {
        refuse("a falloff of " + number(view.smallest_falloff) + ", whose differences float64 cannot resolve",
               "at least " + number(smallest_float64_falloff), "use a larger " + option_ref("falloff"));
    }
    if (plan.empty_test && steepest_falloff(scene) > steepest_float64) {
        refuse("a falloff of " + number(steepest_falloff(scene)) + " where empty points differ from those of 0",
               "at most " + number(steepest_float64) + " where opacity at 0 is above 0",
               "use a smaller " + option_ref("falloff") + ", or an opacity of 0 at 0");
    }
    const double nearest = std::min(view.smallest_pixel, view.slice_spacing);
    if (plan.gradient && !plan.analytic_gradient && view.reference_length > largest_float64_magnification * nearest) {
        refuse("a pixel or a slice distance of " + number(nearest) + " beside a reference length of " +
                   number(view.reference_length) + ", whose gradients float64 loses",
               "at least " + number(1.0 / largest_float64_magnification) + " times that where it is lit",
               "pass " + option_ref("reference_length", "...") + ", or leave out the lights");
    }
    if (plan.gradient_opacity) {
        const double least = least_faded(scene, view, sums, float64_epsilon);
        if (least > *scene.gradient_opacity) {
            refuse(option_ref("gradient_opacity", number(*scene.gradient_opacity)) + ", which rounding reaches",
                   "at least " + number(least), "use a larger " + option_ref("gradient_opacity"));
        }
    }
    if (sums.least_scale < least_divisor) {
        refuse("a w0 and weights below " + number(least_divisor), "a w0 or weights of at least that",
               "scale the weights and " + option_ref("w0") + " by one factor");
    }
    if (sums.sum > largest_float64_sum) {
        refuse("sums of weights, or of weighted values over what is resolved, of up to " + number(sums.sum),
               "at most " + number(largest_float64_sum), "scale the values or the weights");
    }
    const bool lit = lights_quotients(plan) && sums.ratio > largest_float64_lit_ratio;
    const double error = picture_error(sums, float64_epsilon);
    if (lit || error > float32_bound) {
        refuse("values up to " + number(sums.largest) + " where " + number(sums.resolved) + " is resolved",
               "values of at most " + number(lit ? largest_float64_lit_ratio : sums.ratio * float32_bound / error) +
                   " times that",
               "subtract an offset from the values");
    }
}

/// Bytes of the grids on which light is kept, with a step of a slice distance, as far as they may grow.
double memory_of_light(const Scene& scene, const ViewFacts& view, const DrawPlan& plan) {
    constexpr double most_of_one = 96.0 * (1 << 20), most_open = 16.0 * (1 << 20), most = 256.0 * (1 << 20);
    double elements = 1.0;
    const Vec3 extent = scene.centres_world().extent();
    for (int axis = 0; axis < 3; ++axis) {
        elements *= extent[axis] / std::max(view.slice_spacing, view.smallest_pixel) + 8.0;
    }
    // (Askew to the world's axes a grid that holds them all is larger.)
    const double bytes = 2.0 * elements * sizeof(float);
    const double lights = plan.shadows ? std::min(bytes, most_of_one) * static_cast<double>(scene.lights.size()) : 0.0;
    return std::min(lights + (plan.ambient_occlusion ? std::min(bytes, most_open) : 0.0), most);
}

std::uint64_t memory_of(const Scene& scene, const ViewFacts& view, const DrawPlan& plan) {
    const std::uint64_t pixels =
        static_cast<std::uint64_t>(view.size.width) * static_cast<std::uint64_t>(view.size.height);
    // A flag a kernel, and its place in the lists of one or two tiles.
    constexpr std::uint64_t kernel_bytes = 24;
    const std::uint64_t channels = 4U + (plan.coverage ? 1U : 0U) + (plan.depth ? 1U : 0U);
    const std::uint64_t light =
        plan.shadows || plan.ambient_occlusion ? static_cast<std::uint64_t>(memory_of_light(scene, view, plan)) : 0;
    return pixels * channels * sizeof(float) + view.kernels * kernel_bytes + light;
}

} // namespace

void plan_cpu(const Scene& scene, const ViewFacts& view, const RendererOptions& options, const Outputs& outputs,
              Effects& effects, DrawPlan& plan) {
    refuse_ways_of_gl(options);
    // What casts shadows on an isosurface is classified, though the picture is not.
    plan.weight = plan.weight || (plan.mode == Mode::isosurface && (plan.shadows || plan.ambient_occlusion) &&
                                  !scene.transfer_function.transparent_over(0.0, 0.0));
    divide_apart(scene, outputs, effects, plan);
    plan.culling = effects.decide("culling", true, "kernels that cannot matter are not drawn");
    plan.points = false;
    plan.separable = false;
    // A gradient that was forced on and that nothing asks for changes nothing.
    plan.gradient = plan.lit || plan.gradient_opacity;
    plan.slab_nodes = view.widest_slab < 0.6 ? 4 : view.widest_slab < 1.5 ? 6 : 0;
    plan.packing = Packing::wide;
    plan.tagging = Tagging::tiles;
    const bool scalar = scene.mode == Mode::xray || scene.mode == Mode::mip;
    effects.state("background", scene.background.has_value() && !scalar,
                  scene.background ? "a background was given" : "no background was given");
    effects.state("coverage", plan.coverage, plan.coverage ? "asked for" : "not asked for");
    effects.state("depth", outputs.depth, outputs.depth ? "asked for" : "not asked for");

    const bool ends = plan.stop || plan.mode == Mode::isosurface;
    effects.state("elimination", ends,
                  ends ? "rows, blocks and tiles whose pixels are all finished are skipped"
                       : "nothing can become opaque enough to stop");
    effects.state("opacity_buffer", false, "finished blocks and tiles are skipped without one");
    effects.state("tagging", true, "tiles: what no kernel of a tile touches is not looked at");

    const SumFacts sums = sum_facts(scene, view, plan);
    const std::string why = why_float64(scene, view, plan, sums);
    const bool asked = options.precision == Precision::float64;
    const bool kept = options.precision == Precision::float32;
    plan.precision = asked || (!kept && !why.empty()) ? Precision::float64 : Precision::float32;
    effects.state("float64", plan.precision == Precision::float64,
                  asked          ? "precision float64 was asked for"
                  : !why.empty() ? why
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
    if (view.ellipsoids && plan.precision == Precision::float32) {
        summary.error_budget.push_back(
            {"Gaussians from one another", walked_noise * sums.ratio * sums.bend, "scattered_kernels"});
    }
    effects.state("sums", true, std::string("kernels are summed in ") + to_string(plan.precision));
    summary.precision = plan.precision;
    summary.packing = plan.packing;
    summary.tagging = plan.tagging;
    summary.device = "processor";
    summary.memory = memory_of(scene, view, plan);
}

} // namespace sheetsplat

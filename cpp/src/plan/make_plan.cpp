#include "plan/make_plan.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <sstream>
#include <utility>

#include "effects.hpp"
#include "sheetsplat/error.hpp"

namespace sheetsplat {

namespace {

/// Kernels that overlap at a point of a lattice at radius 2: 4/3 pi 2^3.
constexpr double usual_overlap = 33.5;
/// IMAGE FORMATION section 9.
constexpr double float16_bound = 1.0 / 510.0;
constexpr std::size_t most_lights = 64;
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
/// One record serves all slices of a kernel: at 1:10,000 the 99.9th percentile was seen at 7e-5.
constexpr double largest_gather_aspect = 16384.0;
/// Half a field's extent over its smallest semi-axis. Centres in float32 are known to 6e-8 of the former: seen were
/// 4e-8 times the quotient where they are moved in float64, 1.5e-7 where in float32.
constexpr double largest_paper_extent = 2048.0;
constexpr double largest_paper_extent_in_float32 = 512.0;
/// Below this share of a semi-axis, squared, the filter changes nothing within any bound.
constexpr double least_filtering = 1e-6;
/// Kernels of one size at one place, where quotients of sums are lit, times the values over the window and the
/// reference length over the distance of samples: their errors add up. At 3,300 the 99.9th percentile was seen at 9e-4.
constexpr double most_alike_lit = 1000.0;
/// Differences that are splatted lose more: at 2,000 kernels 1.9e-2.
constexpr double fine_alike_factor = 10.0;
/// A few always are.
constexpr double least_alike = 64.0;
/// The same in the dark: at 100,000 the 99.9th percentile was seen at 8e-4.
constexpr double most_alike_unlit = 1e5;
/// Kernels at a point, where quotients are lit: at 100,000 the 99.9th percentile was seen at 3e-4, at 500,000
/// at 1.3e-3.
constexpr double densest_lit = 2e5;
/// Places that textures and pixels that look for kernels know in float32; seen at 1e8 to be right, at 1e9 1e-2 off.
constexpr double largest_compared_px = 1e7;
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

constexpr std::array<const char*, 24> forcible = {"weight",
                                                  "gradient",
                                                  "specular",
                                                  "two_sided",
                                                  "opacity_correction",
                                                  "opacity_stop",
                                                  "elimination",
                                                  "culling",
                                                  "opacity_buffer",
                                                  "opacity_buffer_average",
                                                  "points",
                                                  "vertex_arrays",
                                                  "four_channels",
                                                  "fine_gradient",
                                                  "preshaded",
                                                  "general_sections",
                                                  "empty_test",
                                                  "compensation",
                                                  "count_fragments",
                                                  "bare_fill",
                                                  "resident_sections",
                                                  "precise_sections",
                                                  "paper_slicing",
                                                  "gather"};

} // namespace

std::string number(double value) {
    std::ostringstream text;
    text.precision(4);
    text << value;
    return text.str();
}

std::string kernels(std::size_t count) { return std::to_string(count) + (count == 1 ? " kernel" : " kernels"); }

Effects::Effects(const std::map<std::string, bool>& forced, std::vector<Effect>& list) : forced_(forced), list_(list) {
    for (const auto& [name, on] : forced) {
        if (std::find(forcible.begin(), forcible.end(), name) == forcible.end()) {
            std::string names;
            for (const char* known : forcible) {
                names += names.empty() ? known : std::string(", ") + known;
            }
            throw InvalidInput(Complaint{"the effects cannot be forced", "the name \"" + name + "\"", "one of " + names,
                                         "correct effects="});
        }
    }
}

bool Effects::decide(const char* name, bool on, const std::string& reason, bool needed) {
    const auto found = forced_.find(name);
    if (found == forced_.end()) {
        list_.push_back({name, on, reason, false});
        return on;
    }
    if (needed && on && !found->second) {
        dropped_.push_back(name);
    }
    list_.push_back({name, found->second,
                     std::string(found->second ? "forced on" : "forced off") + "; the scene says " +
                         (on ? "on" : "off") + ": " + reason,
                     true});
    return found->second;
}

void Effects::refuse_dropped() const {
    if (dropped_.empty()) {
        return;
    }
    std::string names;
    for (const std::string& name : dropped_) {
        names += names.empty() ? name : ", " + name;
    }
    throw Unsupported(Complaint{"the plan cannot be made", "effects forced off that the scene calls for: " + names,
                                "a picture within its error bound",
                                "leave them to the plan, or pass allow_inexact=True"});
}

namespace {

/// What the kernels of a field are worth in sums.
struct Amounts {
    double low = 0.0, high = 0.0; ///< of what a kernel stands for in rho: f where weights are divided out, else m f
    double largest = 0.0;         ///< bound on its part of |rho|
    double heaviest = 0.0;        ///< largest of |m f|
    double most_weight = 0.0;     ///< largest m
    double least_weight = std::numeric_limits<double>::infinity(); ///< smallest m above 0
};

double overlap_of(const ViewFacts& view) { return std::max(usual_overlap, view.largest_overlap); }

/// What a filter leaves of a kernel's height, at most: its mass in a kernel of a pixel's and a slice distance's size.
double filtered_height(const Scene& scene, const ViewFacts& view, const Vec3& axes) {
    if (scene.filter == Filter::none) {
        return 1.0;
    }
    return std::min(1.0, axes.x / view.smallest_pixel * (axes.y / view.smallest_pixel) * (axes.z / view.slice_spacing));
}

template <class Height>
WeightFacts survey_weights(const EllipsoidField& field, Height&& height) {
    WeightFacts facts;
    facts.low = std::numeric_limits<double>::infinity();
    facts.high = -facts.low;
    for (std::size_t i = 0; i < field.size(); ++i) {
        const double weight = field.weight(i) * height(field.semi_axes(i));
        const double product = weight * field.value(i);
        facts.low = std::min(facts.low, product);
        facts.high = std::max(facts.high, product);
        facts.most = std::max(facts.most, weight);
        if (weight > 0.0) {
            facts.least = std::min(facts.least, weight);
        }
        // m f g / max(w0, W), where W is at least m g.
        facts.alone = std::max(facts.alone, std::abs(product) / std::max(field.w0(), weight));
    }
    return facts;
}

Amounts amounts_of(const Field& field, const Scene& scene, const ViewFacts& view) {
    const double overlap = overlap_of(view);
    Amounts amounts;
    const auto [low, high] = field.value_range();
    amounts.low = low;
    amounts.high = high;
    amounts.largest = amounts.heaviest = std::max(std::abs(low), std::abs(high));
    amounts.most_weight = amounts.least_weight = 1.0;
    const EllipsoidField* ellipsoids = as_ellipsoids(&field);
    const bool divided = field.normalization() == Normalization::threshold;
    if (ellipsoids == nullptr || ellipsoids->size() == 0) {
        return amounts;
    }
    if (ellipsoids->arrays().weights.empty()) {
        amounts.largest *= divided ? std::min(1.0, overlap / std::max(field.w0(), 1.0)) : 1.0;
        return amounts;
    }
    const auto known = view.weights.find(&field);
    const WeightFacts weights =
        scene.filter == Filter::none && known != view.weights.end()
            ? known->second
            : survey_weights(*ellipsoids, [&](const Vec3& axes) { return filtered_height(scene, view, axes); });
    Amounts weighted;
    weighted.low = weights.low;
    weighted.high = weights.high;
    weighted.most_weight = weights.most;
    weighted.least_weight = weights.least;
    weighted.heaviest = std::max(std::abs(weighted.low), std::abs(weighted.high));
    // A mean is never larger than the largest value; where w0 divides, it is no larger than what overlaps adds up to.
    weighted.largest = divided ? std::min(amounts.largest, overlap * weights.alone) : weighted.heaviest;
    if (divided) {
        weighted.low = low;
        weighted.high = high;
    }
    return weighted;
}

double unit_of_values(const Scene& scene, const ViewFacts& view) {
    double largest = 0.0;
    for (const auto& field : scene.fields) {
        largest = std::max(largest, amounts_of(*field, scene, view).largest);
    }
    if (largest == 0.0) {
        largest = 1.0;
    }
    if (scene.mode == Mode::composite) {
        const double window = scene.transfer_function.v_max() - scene.transfer_function.v_min();
        // A window wider than the values would push them towards 0 of the sheets' range; nothing is gained by that.
        return window > 0.0 ? window : largest;
    }
    return largest;
}

/// True where opacity can reach A_stop along some ray of this many slices.
bool saturates_within(const Scene& scene, const ViewFacts& view, std::int64_t slices) {
    if (scene.mode == Mode::isosurface) {
        return true;
    }
    const double a = scene.transfer_function.max_opacity();
    if (a >= 1.0) {
        return true;
    }
    const double exponent = view.slice_spacing / view.reference_length * view.largest_slant;
    const double reach = -std::expm1(std::log1p(-a) * exponent * static_cast<double>(std::min(slices, view.slices)));
    return reach >= scene.opacity_stop;
}

bool tagging_by_depth(Tagging tagging) { return tagging == Tagging::depth_bounds || tagging == Tagging::depth_equal; }

Tagging choose_tagging(const RendererOptions& options, const Capabilities& capabilities) {
    switch (options.tagging) {
    case Tagging::automatic:
        return capabilities.software       ? Tagging::tiles
               : capabilities.depth_bounds ? Tagging::depth_bounds
                                           : Tagging::tiles;
    case Tagging::depth_bounds:
        if (!capabilities.depth_bounds) {
            throw Unsupported(
                Complaint{"the plan cannot be made",
                          "tagging depth_bounds on " + capabilities.renderer + ", which lacks GL_EXT_depth_bounds_test",
                          "a device that has it", "use tagging auto, tiles, depth_equal or off"});
        }
        return options.tagging;
    default:
        return options.tagging;
    }
}

} // namespace

WeightFacts survey_weights(const EllipsoidField& field) {
    return survey_weights(field, [](const Vec3&) { return 1.0; });
}

SumFacts sum_facts(const Scene& scene, const ViewFacts& view, const DrawPlan& plan) {
    const double unit = plan.value_unit;
    SumFacts facts;
    facts.overlap = overlap_of(view);
    facts.least_scale = std::numeric_limits<double>::infinity();
    double spread = 0.0;
    for (const auto& field : scene.fields) {
        const Amounts amounts = amounts_of(*field, scene, view);
        facts.largest = std::max(facts.largest, amounts.largest);
        spread = std::max(spread, amounts.high - amounts.low);
        facts.sum = std::max({facts.sum, facts.overlap * amounts.heaviest / unit, facts.overlap * amounts.most_weight});
        if (field->normalization() == Normalization::threshold) {
            facts.least_scale = std::min(facts.least_scale, std::max(field->w0(), amounts.least_weight));
        }
    }
    facts.resolved = plan.mode == Mode::isosurface && spread > 0.0 ? spread : unit;
    facts.ratio = facts.largest / facts.resolved;
    const bool scalar = plan.mode == Mode::xray || plan.mode == Mode::mip;
    const double per_length = view.slice_spacing * view.largest_slant / view.reference_length;
    facts.steepness = scalar || plan.mode == Mode::isosurface
                          ? 1.0
                          : std::max(1.0, scene.transfer_function.steepest() * unit * per_length);
    return facts;
}

void divide_apart(const Scene& scene, const Outputs& outputs, Effects& effects, DrawPlan& plan) {
    // Quotients add up only once each is taken.
    if (scene.fields.size() > 1 && plan.threshold) {
        int next = 0;
        for (const auto& field : scene.fields) {
            plan.own_sheets.push_back(field->normalization() == Normalization::threshold ? next++ : -1);
        }
        plan.threshold = false;
        plan.weight = outputs.coverage || plan.empty_test;
    }
    effects.state("separate_normalization", !plan.own_sheets.empty(),
                  !plan.own_sheets.empty() ? "fields are divided by their own weight sums before they are added"
                                           : "one division, or none, serves the whole scene");
}

bool lights_quotients(const DrawPlan& plan) { return plan.gradient && (plan.threshold || !plan.own_sheets.empty()); }

namespace {

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
    const char* next = lit_quotient
                           ? "make one kernel of them, of their weights' sum and the mean of their values, leave "
                             "out the lights, use backend reference, or pass allow_inexact=True"
                           : "make one kernel of them, use backend reference, or pass allow_inexact=True";
    const char* failed = "the picture cannot be made within its error bound in 32-bit sheets";
    if (view.most_alike > most) {
        throw Unsupported(Complaint{failed, "about " + number(view.most_alike) + " ellipsoids of one size at one place",
                                    "at most " + number(std::floor(most)) + (lit_quotient ? " where they are lit" : ""),
                                    next});
    }
    if (lit_quotient && view.densest_overlap * times > densest_lit) {
        throw Unsupported(Complaint{failed, "about " + number(view.densest_overlap) + " ellipsoids at a point",
                                    "at most " + number(densest_lit / times) + " where they are lit",
                                    "use fewer or smaller ellipsoids, leave out the lights, use backend reference, or "
                                    "pass allow_inexact=True"});
    }
}

void check_precision(const Scene& scene, const ViewFacts& view, const RendererOptions& options,
                     const Capabilities* capabilities, DrawPlan& plan) {
    const auto [overlap, largest, resolved, ratio, sum, steepness, least_scale] = sum_facts(scene, view, plan);
    const bool lost = least_scale < least_divisor;

    const double sums = float32_epsilon * std::sqrt(overlap) * ratio;
    double noise = sums;
    if (plan.precision == Precision::float16) {
        // Stores that cut off instead of rounding drift by half a step an overlap; rounding ones walk at random.
        const bool truncates = capabilities != nullptr && capabilities->software;
        noise = ratio * (truncates ? overlap * 0.5 / 1024.0 : std::sqrt(overlap) / 4096.0);
        if (plan.gradient) {
            noise *= 8.0;
        }
    } else if (plan.precision == Precision::uint8) {
        noise = std::max(1.0, ratio) * overlap * 0.5 / 255.0;
    }
    plan.summary.error_budget.push_back({std::string("sums in ") + to_string(plan.precision), noise * steepness});
    if (options.allow_inexact) {
        return;
    }
    if (plan.precision == Precision::uint8 ||
        (plan.precision == Precision::float16 && noise * steepness > float16_bound)) {
        throw Unsupported(
            Complaint{std::string("the picture cannot be made with ") + to_string(plan.precision) + " sheets",
                      "an estimated error of " + number(noise * steepness), "at most " + number(float16_bound),
                      "use precision float32, or pass allow_inexact=True"});
    }
    const double largest_sum = plan.precision == Precision::float16 ? largest_float16 : largest_float32;
    if (sum > largest_sum || lost) {
        throw Unsupported(
            Complaint{std::string("the picture cannot be made with ") + to_string(plan.precision) + " sheets",
                      lost ? "a w0 and weights below " + number(least_divisor)
                           : "sums of weights, or of weighted values over what is resolved, of up to " + number(sum),
                      lost ? "a w0 or weights of at least that" : "at most " + number(largest_sum),
                      "scale the weights and w0 by one factor, use backend reference, or pass allow_inexact=True"});
    }
    // Errors of single slices partly cancel along a ray; what a steep ramp adds, it adds at few pixels.
    const double picture = 0.25 * sums * std::min(steepness, 4.0);
    const bool lit_quotient = lights_quotients(plan);
    const double most_times = 4.0 * float32_bound / (sums / ratio) / std::min(steepness, 4.0);
    if (plan.precision == Precision::float32 &&
        (picture > float32_bound || (lit_quotient && ratio > largest_lit_ratio))) {
        throw Unsupported(
            Complaint{"the picture cannot be made within its error bound in 32-bit sheets",
                      "values up to " + number(largest) + " where " + number(resolved) + " is resolved",
                      "values of at most " +
                          number(lit_quotient ? std::min(largest_lit_ratio, most_times) : most_times) + " times that",
                      "subtract an offset from the values, use backend reference, or pass allow_inexact=True"});
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
                      "use a smaller slice_spacing, filter=\"ewa\", backend reference, or pass allow_inexact=True"});
    }
}

/// Why the ways of drawing ellipsoids that are kept for comparison cannot draw a scene; empty where they can.
std::string unfit_for_comparison(const Scene& scene, const ViewFacts& view, const RendererOptions& options,
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
        return "effect fine_gradient, whose differences they do not draw";
    }
    const std::string tiny =
        view.smallest_px < least_plain_px && !options.allow_inexact
            ? "kernels of " + number(view.smallest_px) + " pixels, of " + number(least_plain_px) + " at least"
            : "";
    if (view.largest_px > largest_compared_px && !options.allow_inexact) {
        return "kernels of " + number(view.largest_px) + " pixels, of " + number(largest_compared_px) + " at most";
    }
    if (view.most_ellipsoids > most_resident_kernels) {
        return number(static_cast<double>(view.most_ellipsoids)) + " kernels in one field, of " +
               number(static_cast<double>(most_resident_kernels)) + " at most";
    }
    const auto forced = [&](const char* name) {
        const auto found = options.effects.find(name);
        return found != options.effects.end() && found->second;
    };
    for (const char* other : {"bare_fill", "preshaded", "resident_sections"}) {
        if (forced(other)) {
            return std::string("effect ") + other + ", which draws in another way";
        }
    }
    if (plan.paper_slicing) {
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
        return !tiny.empty()                      ? tiny
               : plan.gather                      ? "effect gather at once"
               : options.packing == Packing::wide ? "packing wide"
               : forced("four_channels")          ? "effect four_channels"
                                                  : "";
    }
    if (view.largest_aspect > largest_gather_aspect && !options.allow_inexact) {
        return "kernels of 1:" + number(view.largest_aspect) + ", of 1:" + number(largest_gather_aspect) + " at most";
    }
    const auto off = options.effects.find("four_channels");
    return !tiny.empty()                                  ? tiny
           : scene.fields.size() != 1                     ? "several fields"
           : options.packing == Packing::paper            ? "packing paper"
           : off != options.effects.end() && !off->second ? "slices one at a time (four_channels off)"
           : tagging_by_depth(options.tagging)            ? "tags in the depth buffer, which splats leave"
                                                          : "";
}

} // namespace

DrawPlan make_plan(const Scene& scene, const ViewFacts& view, const RendererOptions& options, const Outputs& outputs,
                   Projection projection, Backend backend, const Capabilities* capabilities) {
    DrawPlan plan;
    RenderPlan& summary = plan.summary;
    plan.projection = projection;
    plan.sampling = scene.sampling;
    plan.mode = scene.mode;
    plan.value_unit = unit_of_values(scene, view);
    summary.backend = backend;
    summary.size = view.size;
    summary.slice_spacing = view.slice_spacing;
    summary.first_slice = view.first_slice;
    summary.slices = view.slices;
    Effects effects(options.effects, summary.effects);

    const bool scalar = scene.mode == Mode::xray || scene.mode == Mode::mip;
    const bool lit = !scene.lights.empty() && !scalar;
    bool threshold = false;
    for (const auto& field : scene.fields) {
        threshold = threshold || field->normalization() == Normalization::threshold;
    }

    // Classification and what it needs.
    effects.state("classification", !scalar, scalar ? "the mode shows rho itself" : "the mode shows colours");
    const bool visible_at_zero = !scene.transfer_function.transparent_over(0.0, 0.0) && scene.mode == Mode::composite;
    plan.threshold = threshold;
    plan.coverage = outputs.coverage;
    plan.depth = outputs.depth && !scalar;
    plan.empty_test = effects.decide("empty_test", visible_at_zero,
                                     visible_at_zero ? "opacity at 0 is above 0, and empty points must stay transparent"
                                     : scalar        ? "empty points count as 0"
                                                     : "what is 0 is transparent anyway",
                                     true);
    const bool weight = threshold || outputs.coverage || plan.empty_test;
    plan.weight = effects.decide("weight", weight,
                                 threshold          ? "rho is divided by the weight sum"
                                 : outputs.coverage ? "coverage is the weight sum"
                                 : plan.empty_test  ? "only the weight tells an empty point from one whose sum is 0"
                                                    : "no normalisation by weights, no coverage, and opacity at 0 is 0",
                                 true) ||
                  plan.empty_test;
    const bool unresolved = view.unresolved > 0;
    const bool filtering = scene.filter == Filter::ewa && view.largest_filtering > least_filtering;
    const std::string small = kernels(view.unresolved) + (view.unresolved == 1 ? " is" : " are") +
                              " smaller than a pixel or thinner than a slice distance";
    plan.filter = filtering;
    effects.state("ewa_filter", filtering,
                  filtering                     ? unresolved ? "asked for, and " + small
                                                             : "asked for: it widens kernels by a pixel and a slice distance"
                  : scene.filter == Filter::ewa ? "asked for, but every kernel is so large that it would change nothing"
                  : unresolved
                      ? "not asked for, though " + small + ": filter=\"ewa\" would keep their mass"
                      : "not asked for, and no kernel is smaller than a pixel or thinner than a slice distance");
    bool lattices = false;
    bool spheres = false;
    for (const auto& field : scene.fields) {
        const EllipsoidField* ellipsoids = as_ellipsoids(field.get());
        lattices = lattices || (ellipsoids == nullptr && !filtering);
        spheres = spheres || (ellipsoids != nullptr && ellipsoids->size() > 0 && ellipsoids->isotropic() && !filtering);
    }
    effects.state("scattered_kernels", view.ellipsoids || filtering,
                  view.ellipsoids ? "a field holds ellipsoids: each is sliced by itself"
                  : filtering     ? "the filter turns the samples of lattices into ellipsoids of their own"
                                  : "all fields are lattices");
    effects.state("slab_sampling", scene.sampling == Sampling::slab,
                  scene.sampling == Sampling::slab ? "asked for: slices are means over their slabs"
                                                   : "slices are points in depth");
    effects.state("perspective", projection == Projection::perspective,
                  projection == Projection::perspective ? "the camera is perspective" : "the camera is orthographic");
    plan.general = effects.decide(
        "general_sections", lattices && (view.sheared || projection == Projection::perspective),
        !lattices                               ? "no lattice is drawn, and every ellipsoid has sections of its own"
        : view.sheared                          ? "cross-sections lean: spacing is unequal and seen askew"
        : projection == Projection::perspective ? "cross-sections scale from slab to slab"
                                                : "all sections of a lattice's kernel share one place on the screen",
        true);

    // Light.
    plan.gradient = effects.decide("gradient", lit,
                                   lit      ? "lights need normals"
                                   : scalar ? "the mode is not shaded"
                                            : "there are no lights",
                                   true);
    if (plan.gradient && scalar) {
        throw InvalidInput(Complaint{"the effects cannot be forced", "gradient on in a scalar mode",
                                     "mode composite or isosurface", "drop gradient from effects="});
    }
    const bool specular = lit && scene.material.specular != 0.0;
    plan.specular = effects.decide("specular", specular,
                                   specular ? "the material reflects"
                                            : "the material's specular coefficient is 0 or nothing is lit",
                                   true) &&
                    plan.gradient;
    const bool two_sided = lit && scene.material.two_sided;
    plan.two_sided = effects.decide("two_sided", two_sided,
                                    two_sided ? "asked for by the material" : "normals keep their side", true) &&
                     plan.gradient;
    bool world = false;
    for (const Light& light : scene.lights) {
        world = world || light.space == LightSpace::world;
    }
    effects.state("world_lights", lit && world,
                  lit && world ? "a light stays with the world" : "no light is fixed to the world");
    const bool fine = lit &&
                      std::min(view.smallest_pixel, view.slice_spacing) < fine_gradient_below * view.reference_length &&
                      backend != Backend::reference;
    plan.fine_gradient = backend != Backend::cpu &&
                         effects.decide("fine_gradient", fine,
                                        fine ? "a pixel or the slice spacing is so small that differences of sums "
                                               "would lose the gradient: differences are splatted"
                                             : "differences of neighbouring sums keep enough digits",
                                        true) &&
                         plan.gradient;
    plan.fine_across =
        plan.fine_gradient && (view.smallest_pixel < fine_gradient_below * view.reference_length || !fine);
    plan.fine_along = plan.fine_gradient && (view.slice_spacing < fine_gradient_below * view.reference_length || !fine);

    // Opacity.
    const double exponent = view.slice_spacing / view.reference_length;
    const bool correction = scene.mode == Mode::composite && !scene.preintegration &&
                            (exponent != 1.0 || (projection == Projection::perspective));
    plan.opacity_correction = effects.decide("opacity_correction", correction,
                                             correction ? "slices are not one reference length apart along every ray"
                                                        : "opacity per reference length is opacity per slice here",
                                             true);
    plan.preintegration = scene.preintegration;
    effects.state("preintegration", scene.preintegration, scene.preintegration ? "asked for" : "not asked for");
    const bool saturates = !scalar && saturates_within(scene, view, view.slices);
    const bool stops = saturates && (scene.opacity_stop < 1.0 || scene.mode == Mode::isosurface);
    plan.stop = effects.decide("opacity_stop", stops && scene.mode == Mode::composite,
                               scalar                           ? "the mode has no opacity"
                               : scene.mode == Mode::isosurface ? "an isosurface is opaque at its first crossing"
                               : stops                          ? "opacity can reach A_stop"
                               : saturates                      ? "A_stop is 1"
                                           : "opacity cannot reach A_stop under this transfer function",
                               true) &&
                scene.mode == Mode::composite;

    // How it is drawn.
    if (backend == Backend::reference) {
        plan.precision = Precision::float64;
        if (options.precision != Precision::automatic && options.precision != Precision::float64) {
            throw Unsupported(
                Complaint{"the plan cannot be made",
                          std::string("precision ") + to_string(options.precision) + " with backend reference",
                          "float64 or auto", "choose backend gl for lower precision"});
        }
        summary.precision = plan.precision;
        summary.packing = Packing::wide;
        summary.tagging = Tagging::off;
        summary.device = "float64, one thread";
        effects.state("background", scene.background.has_value() && !scalar,
                      scene.background ? "a background was given" : "no background was given");
        effects.state("coverage", outputs.coverage, outputs.coverage ? "asked for" : "not asked for");
        effects.state("depth", outputs.depth, outputs.depth ? "asked for" : "not asked for");
        return plan;
    }

    if (backend == Backend::cpu) {
        plan_cpu(scene, view, options, outputs, effects, plan);
        return plan;
    }

    divide_apart(scene, outputs, effects, plan);
    if (plan.fine_gradient && !plan.own_sheets.empty()) {
        throw Unsupported(Complaint{
            "the scene cannot be drawn with backend gl",
            "a lit close-up of several fields of which one has normalization threshold, whose pixels or slices "
            "are closer than an eighth of the reference length",
            "such a close-up of one field, or of fields with normalization none or lattice",
            "use a larger slice_spacing or reference_length, or backend reference"});
    }
    // Differences of values and of weights of two sheets at once would take more texture units than every device has.
    const bool crowded = plan.fine_gradient && plan.threshold;
    plan.packing = options.packing == Packing::automatic ? crowded ? Packing::paper : Packing::wide : options.packing;
    if (crowded && plan.packing == Packing::wide && capabilities->max_texture_units <= 20) {
        throw Unsupported(Complaint{
            "the plan cannot be made",
            "packing wide for a close-up of a field with normalization threshold, which needs 21 texture units of " +
                std::to_string(capabilities->max_texture_units),
            "packing auto or paper", "leave packing to the plan"});
    }
    plan.tagging = choose_tagging(options, *capabilities);
    plan.precision = options.precision == Precision::automatic ? Precision::float32 : options.precision;
    if (plan.precision == Precision::float64) {
        throw Unsupported(Complaint{"the plan cannot be made",
                                    "precision float64 with backend gl, whose targets blend 32 bits at most",
                                    "auto, uint8, float16 or float32", "choose backend cpu for float64"});
    }
    plan.culling = effects.decide("culling", true, "kernels that cannot matter are not drawn");
    // Depth tests slow a rasteriser in software more than they save where little becomes opaque: there it must happen
    // within a few slices.
    const bool soon = scene.mode == Mode::isosurface || saturates_within(scene, view, soon_opaque_slices);
    const bool eliminate = stops && !outputs.coverage && (!capabilities->software || soon);
    plan.elimination = effects.decide("elimination", eliminate,
                                      !stops             ? "nothing can become opaque enough to stop"
                                      : outputs.coverage ? "coverage looks behind opaque pixels"
                                      : eliminate        ? "opaque pixels take no more splats"
                                                         : "depth tests cost more than they save on this rasteriser") &&
                       stops && !outputs.coverage;
    const bool average =
        options.effects.count("opacity_buffer_average") != 0 && options.effects.at("opacity_buffer_average");
    plan.opacity_buffer_average =
        effects.decide("opacity_buffer_average", false, "the average of the paper may drop kernels that still show") &&
        stops;
    plan.opacity_buffer = effects.decide("opacity_buffer", average,
                                         "reading opacity back costs more than it saves as a rule; ask for it") &&
                          stops && !outputs.coverage;
    plan.opacity_buffer = plan.opacity_buffer || (plan.opacity_buffer_average && !outputs.coverage);
    if (plan.opacity_buffer_average && !options.allow_inexact) {
        throw Unsupported(Complaint{"the plan cannot be made",
                                    "opacity_buffer_average, which drops kernels that still show", "exact culling",
                                    "use opacity_buffer, or pass allow_inexact=True"});
    }
    const bool sprites = projection == Projection::orthographic &&
                         2.0 * view.largest_splat_px + 1.0 <= static_cast<double>(capabilities->max_point_size);
    const bool round = spheres && plan.sampling == Sampling::point && !plan.fine_gradient;
    plan.points = effects.decide("points", sprites && (lattices || round),
                                 projection == Projection::perspective ? "kernels differ in size: quads fit them"
                                 : !sprites ? "kernels are larger than the largest point sprite: quads"
                                 : lattices ? "point sprites need one vertex a kernel"
                                 : round    ? "spheres that are small enough are point sprites of one vertex each"
                                            : "ellipsoids are drawn as rectangles along the axes of their sections") &&
                  sprites;
    plan.separable = !plan.general && plan.sampling == Sampling::point && !plan.fine_gradient &&
                     view.largest_splat_px < largest_separable_px;
    plan.vertex_arrays = effects.decide("vertex_arrays", true, "a batch is one draw call");
    plan.count_fragments = effects.decide("count_fragments", false, "a figure for benchmarks: not asked for");
    plan.paper_slicing =
        effects.decide("paper_slicing", false, "the 2006 paper's slicing step by step, for comparison: not asked for");
    plan.gather = effects.decide("gather", false,
                                 "pixels that look for their kernels, for comparison with splatting: not asked for");
    const bool compared = plan.paper_slicing || plan.gather;
    if (compared) {
        const std::string unfit = unfit_for_comparison(scene, view, options, plan, capabilities->at_least(4, 0));
        if (!unfit.empty()) {
            throw Unsupported(Complaint{
                std::string("the plan cannot be made with effect ") + (plan.paper_slicing ? "paper_slicing" : "gather"),
                unfit,
                plan.paper_slicing ? "ellipsoids in orthographic view, point-sampled, unfiltered, packing paper"
                                   : "one field of ellipsoids in orthographic view, point-sampled, unfiltered, "
                                     "packing wide",
                "drop it from effects="});
        }
    }
    if (plan.gather && tagging_by_depth(plan.tagging)) {
        plan.tagging = Tagging::tiles;
    }
    if (plan.paper_slicing) {
        double falloff = 8.0;
        for (const auto& field : scene.fields) {
            falloff = as_ellipsoids(field.get()) != nullptr ? std::max(falloff, field->kernel().falloff) : falloff;
        }
        plan.packing = Packing::paper;
        plan.gaussian_cells = static_cast<int>(std::ceil(paper_cells_at_8 * std::sqrt(falloff / 8.0)));
        summary.error_budget.push_back(
            {"the Gaussian as a texture of " + std::to_string(plan.gaussian_cells + 1) + " x " +
                 std::to_string(plan.gaussian_cells + 1),
             0.5 * falloff / (static_cast<double>(plan.gaussian_cells) * plan.gaussian_cells)});
    }
    const bool slender = view.largest_aspect > least_precise_aspect;
    const bool tiny = !plan.filter && view.smallest_px < least_plain_px;
    const bool exact_places = (slender || tiny) && capabilities->at_least(4, 0);
    if (effects.decide("precise_sections", exact_places,
                       !view.ellipsoids    ? "no field holds ellipsoids"
                       : !slender && !tiny ? "no ellipsoid is so slender that float32 would lose its sections"
                       : exact_places && tiny
                           ? "ellipsoids of less than " + number(least_plain_px) + " pixels are placed in float64"
                       : exact_places
                           ? "ellipsoids of more than 1:" + number(least_precise_aspect) + " are placed in float64"
                           : "OpenGL " + capabilities->version + " has no float64",
                       true) &&
        exact_places) {
        plan.precise_aspect = least_precise_aspect;
    }
    if (slender && !exact_places && view.largest_aspect > largest_plain_aspect && !options.allow_inexact) {
        throw Unsupported(
            Complaint{"the scene cannot be drawn within its error bound",
                      "ellipsoids of 1:" + number(view.largest_aspect) + " on OpenGL " + capabilities->version,
                      "OpenGL 4.0 for places in float64, or at most 1:" + number(largest_plain_aspect),
                      "pass min_scale to the field, or use backend reference"});
    }
    if (tiny && !exact_places && view.smallest_px < smallest_plain_px && !options.allow_inexact) {
        throw Unsupported(
            Complaint{"the scene cannot be drawn within its error bound",
                      "ellipsoids of " + number(view.smallest_px) + " pixels on OpenGL " + capabilities->version,
                      "OpenGL 4.0 for places in float64, or at least " + number(smallest_plain_px),
                      "pass min_scale to the field, use filter=\"ewa\", or backend reference"});
    }
    const bool can_reside = !compared && view.ellipsoids && !plan.filter && !tiny && capabilities->at_least(4, 1) &&
                            view.largest_aspect <= largest_resident_aspect &&
                            view.most_ellipsoids <= most_resident_kernels;
    const std::string why_resident =
        plan.filter                     ? "filtered kernels are sliced by the processor"
        : !view.ellipsoids              ? "no field holds ellipsoids"
        : compared                      ? "kernels are drawn in another way, for comparison"
        : !capabilities->at_least(4, 1) ? "OpenGL " + capabilities->version + " has no float64 vertex programs"
        : tiny                          ? "kernels of less than " + number(least_plain_px) +
                     " pixels are sliced anew for each batch, to keep "
                     "their digits"
        : view.largest_aspect > largest_resident_aspect
            ? "kernels of 1:" + number(view.largest_aspect) + " are sliced anew for each batch, to keep their digits"
        : view.most_ellipsoids > most_resident_kernels
            ? kernels(view.most_ellipsoids) + " are sliced batch by batch, in bounded memory"
        : capabilities->software ? "a device in software slices no faster than the processor that it runs on"
                                 : "one pass on the device slices all kernels, and nothing is uploaded or read back";
    plan.resident_sections = effects.decide("resident_sections", can_reside && !capabilities->software, why_resident);
    if (plan.resident_sections && !can_reside) {
        throw Unsupported(Complaint{"the plan cannot be made", "resident_sections forced on: " + why_resident,
                                    "ellipsoids that the device can slice", "leave it to the plan"});
    }
    plan.bare_fill = effects.decide("bare_fill", false, "a figure for benchmarks: not asked for");
    if (plan.bare_fill && !options.allow_inexact) {
        throw Unsupported(Complaint{"the plan cannot be made", "bare_fill, which draws rectangles instead of kernels",
                                    "a picture", "drop bare_fill from effects=, or pass allow_inexact=True"});
    }
    plan.four_channels = effects.decide("four_channels", !plan.paper_slicing,
                                        plan.paper_slicing ? "the paper splats one slab at a time"
                                                           : "four slabs are splatted at a time");
    if (!plan.four_channels) {
        plan.packing = Packing::paper;
    }
    plan.preshaded = effects.decide("preshaded", false, "kernels are summed before they are classified");
    if (plan.preshaded && !options.allow_inexact) {
        throw Unsupported(
            Complaint{"the plan cannot be made", "preshaded splatting, which colours kernels before they are summed",
                      "post-shaded splatting", "drop preshaded from effects=, or pass allow_inexact=True"});
    }
    if (plan.preshaded) {
        bool cartesian = true;
        for (const auto& field : scene.fields) {
            const RegularField* regular = as_regular(field.get());
            cartesian = cartesian && regular != nullptr && regular->lattice() == Lattice::cartesian;
        }
        if (scene.mode != Mode::composite || projection == Projection::perspective ||
            scene.sampling == Sampling::slab || !cartesian || outputs.coverage || outputs.depth || view.sheared ||
            scene.preintegration) {
            throw Unsupported(Complaint{"the plan cannot be made",
                                        "preshaded splatting of anything but Cartesian volumes in mode composite, "
                                        "orthographic, with point sampling and no further outputs",
                                        "such a scene", "drop preshaded from effects="});
        }
        plan.packing = Packing::paper;
        plan.tagging = Tagging::off;
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
    if (view.slices > most_imprecise_slices && !capabilities->at_least(4, 0) && !options.allow_inexact) {
        throw Unsupported(Complaint{"the scene cannot be drawn within its error bound",
                                    std::to_string(view.slices) + " slices on OpenGL " + capabilities->version,
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
                                    "use fewer lights, or backend reference"});
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
                                    deep ? "use a larger unit of length, or backend reference"
                                         : "magnify less, or use backend reference"});
    }
    if (view.largest_splat_px > largest_splat_px && !options.allow_inexact) {
        throw Unsupported(Complaint{"the scene cannot be drawn with backend gl",
                                    "kernels of " + number(view.largest_splat_px) + " pixels",
                                    "at most " + number(largest_splat_px), "magnify less, or use backend reference"});
    }
    const double place_error = std::max(view.size.width, view.size.height) * float32_epsilon;
    if (view.slices > 0 && view.largest_splat_px > 0.0 && place_error > largest_place_error * view.largest_splat_px &&
        !options.allow_inexact) {
        throw Unsupported(Complaint{"the scene cannot be drawn with backend gl",
                                    "kernels of " + number(view.largest_splat_px) +
                                        " pixels, whose places float32 knows to " + number(place_error),
                                    "places known to " + number(largest_place_error) + " of a radius",
                                    "come closer, or use backend reference"});
    }
    if (view.smallest_falloff < smallest_falloff && !options.allow_inexact) {
        throw Unsupported(
            Complaint{"the scene cannot be drawn with backend gl",
                      "a falloff of " + number(view.smallest_falloff) + ", whose differences float32 cannot resolve",
                      "at least " + number(smallest_falloff), "use a larger falloff, or backend reference"});
    }
    check_precision(scene, view, options, capabilities, plan);

    summary.precision = plan.precision;
    summary.packing = plan.packing;
    summary.tagging = plan.tagging;
    summary.device = capabilities->renderer + ", OpenGL " + capabilities->version + ", by " + capabilities->platform;
    const std::uint64_t texel = plan.precision == Precision::float32   ? 16
                                : plan.precision == Precision::float16 ? 8
                                                                       : 4;
    const auto own = static_cast<std::uint64_t>(
        std::count_if(plan.own_sheets.begin(), plan.own_sheets.end(), [](int number) { return number >= 0; }));
    const std::uint64_t sheets =
        (plan.packing == Packing::wide ? 3U : 2U) * (plan.weight ? 2U : 1U) * (plan.fine_gradient ? 4U : 1U) +
        own * (plan.packing == Packing::wide ? 3U : 1U) * 2U;
    summary.memory = static_cast<std::uint64_t>(view.size.width + 2) *
                     static_cast<std::uint64_t>(view.size.height + 2) * (sheets * texel + 16 + 4 + 16);
    return plan;
}

} // namespace sheetsplat

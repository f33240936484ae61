// Bounds of the sums of a scene's kernels, and the errors that follow.
#include <algorithm>
#include <cmath>
#include <limits>
#include <string>

#include "error_model.hpp"
#include "limits_errors.hpp"
#include "occurring.hpp"
#include "parts.hpp"
#include "plan/effect_table.hpp"
#include "plan/pivot.hpp"
#include "scene/mode_rules.hpp"

namespace sheetsplat {

using namespace error_limits;

namespace {

/// Kernels that overlap at a point of a lattice at radius 2: 4/3 pi 2^3.
constexpr double usual_overlap = 33.5;
/// Values are counted in units of at least this.
constexpr double least_unit = 1e-300;
/// -ln(1 - a) of what counts as opaque stays a number.
constexpr double largest_absorbed = 0.999;
/// Volume of the unit ball.
constexpr double ball = 4.18879020478639;
/// What the kernels of a field contribute to sums.
struct Amounts {
    double low = 0.0, high = 0.0; ///< of what a kernel stands for in rho: f where weights are divided out, else m f
    double largest = 0.0;         ///< bound on its part of |rho|
    double heaviest = 0.0;        ///< largest of |m f|
    double most_weight = 0.0;     ///< largest m
    double least_weight = std::numeric_limits<double>::infinity(); ///< smallest m above 0
};

double overlap_of(const ViewFacts& view) { return std::max(usual_overlap, view.overlap.typical); }

Amounts amounts_of(const Field& field, const ViewFacts& view) {
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
    const WeightFacts& weights = view.weights.at(&field);
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

double largest_of(const Scene& scene, const ViewFacts& view, const Group& group) {
    double largest = 0.0;
    for (std::size_t field = group.first; field < group.last; ++field) {
        largest = std::max(largest, amounts_of(*scene.fields[field], view).largest);
    }
    return largest;
}

/// Kernels that overlap at a point. A lattice's supports over its cells; of scattered kernels where they are densest.
double crowd_of(const Scene& scene, const ViewFacts& view) {
    double crowd = 0.0;
    for (const auto& field : scene.fields) {
        if (const RegularField* regular = as_regular(field.get()); regular != nullptr && regular->size() > 0) {
            // C is the kernel's mass over the cell.
            crowd += ball / regular->kernel().unit_mass() * regular->lattice_constant();
        }
    }
    return std::max({1.0, crowd, 2.0 * view.overlap.densest, view.overlap.typical});
}

/// Root mean square of the slopes of opacity, times a factor, and of colours over the part of a range that the transfer
/// function's window covers.
double mean_slope(const TransferFunction& function, const Range& values, double of_opacity) {
    double squares = 0.0;
    double length = 0.0;
    const auto& points = function.points();
    for (std::size_t n = 0; n + 1 < points.size(); ++n) {
        const TransferPoint& p = points[n];
        const TransferPoint& q = points[n + 1];
        const double width = std::min(q.value, values.upper) - std::max(p.value, values.lower);
        if (!(width > 0.0)) {
            continue;
        }
        double change = of_opacity * std::abs(q.opacity - p.opacity);
        for (int c = 0; c < 3; ++c) {
            change = std::max(change, std::abs(q.color[c] - p.color[c]));
        }
        const double slope = change / (q.value - p.value);
        squares += slope * slope * width;
        length += width;
    }
    return length > 0.0 ? std::sqrt(squares / length) : 0.0;
}

/// What the sums of a group come to, but for what does not depend on the group.
SumFacts facts_of(const Scene& scene, const ViewFacts& view, const DrawPlan& plan, const Group& group,
                  const std::vector<IsoValue>& iso_values) {
    const double unit = plan.unit_of(group.first);
    SumFacts facts;
    facts.overlap = overlap_of(view);
    facts.least_scale = std::numeric_limits<double>::infinity();
    double spread = 0.0;
    for (std::size_t number = group.first; number < group.last; ++number) {
        const auto& field = scene.fields[number];
        const Amounts amounts = amounts_of(*field, view);
        facts.largest = std::max(facts.largest, amounts.largest);
        spread = std::max(spread, amounts.high - amounts.low);
        if (shows_surfaces(plan.mode)) {
            for (const IsoValue& iso : iso_values) {
                for (const double end : {0.0, amounts.low, amounts.high}) {
                    const double distance = std::abs(iso.value - end);
                    facts.nearest_end = distance > 0.0 ? std::min(facts.nearest_end, distance) : facts.nearest_end;
                }
            }
        }
        facts.sum = std::max({facts.sum, facts.overlap * amounts.heaviest / unit, facts.overlap * amounts.most_weight});
        if (field->normalization() == Normalization::threshold) {
            facts.least_scale = std::min(facts.least_scale, std::max(field->w0(), amounts.least_weight));
            facts.weight_range =
                std::max(facts.weight_range, amounts.most_weight / std::max(field->w0(), least_divisor));
        }
    }
    facts.resolved = shows_surfaces(plan.mode) && spread > 0.0 ? spread : unit;
    facts.ratio = facts.largest / facts.resolved;
    if (is_composited(plan.mode)) {
        const double per_length = view.frame.slice_spacing * view.frame.largest_slant / view.frame.reference_length;
        facts.steepness = std::max(1.0, group.transfer_function->steepest() * unit * per_length);
        facts.bend = std::max(1.0, unit * mean_slope(*group.transfer_function, occurring_values(scene, view, group),
                                                     std::max(1.0, per_length)));
    }
    return facts;
}

} // namespace

double largest_rho(const Scene& scene, const ViewFacts& view) {
    double largest = 0.0;
    for (const Group& group : groups_drawn(scene)) {
        largest = std::max(largest, largest_of(scene, view, group));
    }
    return largest;
}

double unit_of_values(const Scene& scene, const ViewFacts& view, const Group& group) {
    double largest = largest_of(scene, view, group);
    if (largest == 0.0) {
        largest = 1.0;
    }
    if (is_composited(scene.mode)) {
        const double window = group.transfer_function->v_max() - group.transfer_function->v_min();
        // A window wider than the values would push them towards 0 of the sheets' range; nothing is gained by that.
        largest = window > 0.0 ? window : largest;
    }
    // What is below has no inverse.
    return std::max(largest, least_unit);
}

SumFacts sum_facts(const Scene& scene, const ViewFacts& view, const DrawPlan& plan) {
    const std::vector<Group> groups = groups_drawn(scene);
    SumFacts facts = facts_of(scene, view, plan, groups.front(), iso_values_of(scene, 0));
    for (std::size_t number = 1; number < groups.size(); ++number) {
        const SumFacts other = facts_of(scene, view, plan, groups[number], iso_values_of(scene, number));
        if (other.ratio > facts.ratio) {
            facts.largest = other.largest;
            facts.resolved = other.resolved;
            facts.ratio = other.ratio;
        }
        facts.sum = std::max(facts.sum, other.sum);
        facts.steepness = std::max(facts.steepness, other.steepness);
        facts.nearest_end = std::min(facts.nearest_end, other.nearest_end);
        facts.least_scale = std::min(facts.least_scale, other.least_scale);
        facts.weight_range = std::max(facts.weight_range, other.weight_range);
        facts.bend = std::max(facts.bend, other.bend);
    }
    facts.crowd = crowd_of(scene, view);
    return facts;
}

double ratio_from_pivots(const Scene& scene, const DrawPlan& plan, double resolved) {
    double ratio = 0.0;
    const std::vector<Group> groups = groups_drawn(scene);
    for (const Group& group : groups) {
        double largest = 0.0, spread = 0.0;
        for (std::size_t number = group.first; number < group.last; ++number) {
            const Field& field = *scene.fields[number];
            const std::array<double, 2> range = field.value_range();
            spread = std::max(spread, range[1] - range[0]);
            if (field.normalization() == Normalization::threshold) {
                const double pivot = pivot_of(field);
                largest = std::max({largest, std::abs(range[0] - pivot), std::abs(range[1] - pivot)});
            }
        }
        const double own = shows_surfaces(plan.mode) && spread > 0.0 ? spread : plan.unit_of(group.first);
        ratio = std::max(ratio, largest / (groups.size() == 1 ? resolved : own));
    }
    return ratio;
}

double bound_of(const ViewFacts& view, const SumFacts& sums) {
    // (In perspective the law asks for the pixel in the middle: the largest one is on the safe side.)
    const bool gentle =
        sums.steepness <= gentle_steepness && view.frame.reference_length <= gentle_pixels * view.frame.largest_pixel;
    return gentle ? gentle_bound : float32_bound;
}

double lit_rounding(const Scene& scene, const ViewFacts& view, DrawPlan& plan, const SumFacts& sums, bool from_middle) {
    const double falloff = view.shapes.smallest_falloff, steep = std::sqrt(2.0 * steepest_falloff(scene));
    // (What is smaller than a pixel is seen at few.)
    const double per_px = plan.filter ? 0.0 : steep / std::max(view.screen_px.smallest, smallest_placed_px);
    const LitRounding& of = lights_quotients(plan) ? of_quotients : of_sums;
    double of_sum = of.sum * std::sqrt(sums.crowd) / -std::expm1(-falloff) + of.place * per_px * std::min(1.0, per_px);
    // Where W is less than w0 a Gaussian is hardly more than at its end. Surfaces of quotients may lie there.
    const double apart = std::min(sums.weight_range, widest_range);
    of_sum += (shows_surfaces(plan.mode) ? 1.0 : of_ends) * std::exp(-falloff) * apart;
    // Means over slabs are differences, known to the rounding of 1 however small they are.
    of_sum += scene.sampling == Sampling::slab ? of_slabs * apart : 0.0;
    double rounding = 0.0;
    for (const Group& group : groups_drawn(scene)) {
        double counted = 0.0, whole = 0.0;
        for (std::size_t number = group.first; number < group.last; ++number) {
            const Field& field = *scene.fields[number];
            const Amounts amounts = amounts_of(field, view);
            const std::array<double, 2> range = field.value_range();
            const bool divided = from_middle && field.normalization() == Normalization::threshold;
            counted += divided ? 0.5 * (range[1] - range[0]) : amounts.largest;
            whole += amounts.largest;
        }
        const double unit = plan.unit_of(group.first);
        rounding = std::max(rounding, (of_sum * counted + of.number * whole) / unit);
    }
    double lights = 0.0, brightest = 0.0;
    for (const Light& light : scene.lights) {
        lights += std::max({std::abs(light.color.x), std::abs(light.color.y), std::abs(light.color.z)});
    }
    for (const Group& group : scene.groups()) {
        for (const TransferPoint& point : group.transfer_function->points()) {
            brightest =
                std::max({brightest, std::abs(point.color.x), std::abs(point.color.y), std::abs(point.color.z)});
        }
    }
    const Material& material = scene.material;
    const double turned = std::abs(material.diffuse) * brightest +
                          std::abs(material.specular) * std::sqrt(std::max(1.0, material.shininess));
    // Six values make three differences. A derivative is at most 0.61 sqrt(2k) over the semi-axis times the value.
    const double shortest = std::min(view.frame.smallest_pixel, view.frame.slice_spacing);
    const double axis = view.screen_px.smallest * view.frame.smallest_pixel;
    plan.gradient_doubt = plan.analytic_gradient || plan.fine_gradient
                              ? std::sqrt(3.0) * 1.22 * steep * std::min(1.0, shortest / axis)
                              : std::sqrt(6.0);
    return rounding * lights * turned;
}

double extremes_rounding(Mode mode, const SumFacts& sums) {
    return is_extreme(mode) ? rounded_sum * std::sqrt(sums.crowd) * sums.largest : 0.0;
}

double weights_in_slabs(Sampling sampling, const SumFacts& sums) {
    return sampling == Sampling::slab ? sums.weight_range * std::max(1.0, sums.ratio) : 0.0;
}

bool shows_between_zeros(const Scene& scene, const SumFacts& sums, const DrawPlan& plan) {
    if (!plan.second_order) {
        return false;
    }
    bool negative = false;
    for (const auto& field : scene.fields) {
        negative = negative || (field->size() > 0 && field->value_range()[0] < 0.0);
    }
    // Between ends of 0 the cubic is an eighth of the largest value at most, and has the other sign. Scenes of second
    // order have one transfer function.
    const double overshoot = 0.125 * sums.largest;
    return !scene.transfer_function.transparent_over(-overshoot, negative ? overshoot : 0.0);
}

bool intervals_may_be_empty(const Scene& scene, const SumFacts& sums, const DrawPlan& plan) {
    const bool ends = scene.counted && !scene.counted->ends.empty();
    return is_composited(plan.mode) && plan.preintegration &&
           (plan.cuts() || ends || shows_between_zeros(scene, sums, plan));
}

double sum_noise(Precision precision, bool truncates, double crowd) {
    switch (precision) {
    case Precision::uint8:
        return crowd / 255.0;
    case Precision::float16:
        // Truncation errors add up; rounding errors are a random walk.
        return truncates ? crowd * 0.15 / 1024.0 : std::sqrt(crowd) / 4096.0;
    case Precision::float64:
        return rounded_sum * float64_epsilon * std::sqrt(crowd);
    default:
        return rounded_sum * float32_epsilon * std::sqrt(crowd);
    }
}

void expect_errors(const ViewFacts& view, const SumFacts& sums, double noise, DrawPlan& plan) {
    auto& budget = plan.summary.error_budget;
    // Numbers of 8 bits have fixed steps, all others steps of their own size.
    const double times = plan.precision == Precision::uint8 ? std::max(1.0, sums.ratio) : sums.ratio;
    const std::string in = std::string(" in ") + to_string(plan.precision);
    budget.push_back({"sums" + in, std::min(noise * times * sums.bend, 1.0), name_of(EffectId::sums)});
    if (plan.lit) {
        const double nearest = view.frame.smallest_step();
        const bool splatted = plan.fine_gradient || plan.analytic_gradient;
        const double magnified = splatted ? 1.0 : std::max(1.0, view.frame.reference_length / nearest);
        const bool few_bits = plan.precision == Precision::float16 || plan.precision == Precision::uint8;
        const double turned = !few_bits ? 1.0 : lights_quotients(plan) ? quotient_noise_16 : gradient_noise_16;
        const double rounding = sum_noise(plan.precision, false, sums.crowd);
        budget.push_back(
            {"gradients" + in, std::min(rounding * times * turned * magnified, 1.0), name_of(EffectId::gradient)});
    }
    budget.push_back({"pictures in float32", float32_epsilon, name_of(EffectId::classification)});
}

void expect_light_errors(const Scene& scene, const ViewFacts& view, double opacity, DrawPlan& plan) {
    if (!plan.shadows && !plan.ambient_occlusion) {
        return;
    }
    const double length = std::max(view.frame.slice_spacing, view.frame.largest_pixel);
    const double taken =
        -std::expm1(std::log1p(-std::min(opacity, largest_absorbed)) * length / view.frame.reference_length);
    double brightest = 0.0;
    // Grids follow what changes over several steps.
    bool gentle = !plan.filter && view.screen_px.smallest * view.frame.largest_pixel >= 2.0 * length;
    const bool surface = shows_surfaces(scene.mode);
    std::size_t number = 0;
    for (const Group& group : scene.groups()) {
        const std::vector<IsoValue> iso_values = iso_values_of(scene, number++);
        const TransferFunction& function = *group.transfer_function;
        std::vector<TransferPoint> shown = surface ? std::vector<TransferPoint>{} : function.points();
        for (const IsoValue& iso : surface ? iso_values : std::vector<IsoValue>{}) {
            shown.push_back(function.at(iso.value));
        }
        for (const TransferPoint& point : shown) {
            brightest =
                std::max({brightest, std::abs(point.color.x), std::abs(point.color.y), std::abs(point.color.z)});
        }
        const double steps =
            function.steepest() * plan.unit_of(group.first) * view.frame.slice_spacing / view.frame.reference_length;
        gentle = gentle && !function.has_steps() && steps <= 4.0 && function.transparent_over(0.0, 0.0);
    }
    const double hardness = gentle ? 1.0 : hard;
    auto& budget = plan.summary.error_budget;
    const auto add_share = [&](const char* cause, double error, double whole, const char* effect) {
        budget.push_back({cause, std::min(error * taken * hardness, most_of_whole) * whole, effect});
    };
    if (plan.shadows) {
        double light = 0.0;
        for (const Light& one : scene.lights) {
            light += std::max({std::abs(one.color.x), std::abs(one.color.y), std::abs(one.color.z)});
        }
        add_share("shadows from a volume", shadow_error,
                  light * (std::abs(scene.material.diffuse) * brightest + std::abs(scene.material.specular)),
                  name_of(EffectId::shadows));
    }
    if (plan.ambient_occlusion) {
        const double share = plan.lit || plan.ambient_only ? std::abs(scene.material.ambient) : 1.0;
        const double far = scene.ambient_occlusion->radius > hard * length ? hard : 1.0;
        add_share("occlusion from a volume", occlusion_error * far,
                  share * brightest * scene.ambient_occlusion->strength, name_of(EffectId::ambient_occlusion));
    }
}

} // namespace sheetsplat

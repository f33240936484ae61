#include "shader_variants.hpp"

#include <algorithm>
#include <optional>
#include <utility>

#include "backend_gl/gl_renderer.hpp"
#include "light/surface_lines.hpp"
#include "plan/pivot.hpp"
#include "scene/mode_rules.hpp"

namespace sheetsplat::backend_gl {

bool splats_slopes(const DrawPlan& plan) { return plan.fine_gradient || plan.analytic_gradient; }

namespace {

const std::string on = "1";

/// Names of what is switched on become defines.
template <std::size_t count>
void define(const std::array<std::pair<const char*, bool>, count>& switches, gl::Defines& defines) {
    for (const auto& [name, active] : switches) {
        if (active) {
            defines[name] = on;
        }
    }
}

/// Whether what adds to a target adds changes too: those of weights only where quotients need them.
bool slopes_of(const DrawPlan& plan, const SplatTarget& target) {
    return splats_slopes(plan) && (!target.weights_alone || plan.threshold || target.own >= 0);
}

/// The defines of all splats.
gl::Defines common_defines(const DrawPlan& plan, const SplatTarget& target, int slab_nodes, int slab_pieces) {
    gl::Defines defines;
    if (plan.sampling == Sampling::slab) {
        defines = {
            {"SLAB", on}, {"SLAB_NODES", std::to_string(slab_nodes)}, {"SLAB_PIECES", std::to_string(slab_pieces)}};
    }
    const std::array<std::pair<const char*, bool>, 8> switches{{
        {"PERSPECTIVE", plan.projection == Projection::perspective},
        {"TWO_TARGETS", plan.packing == Packing::wide && !target.narrow},
        {"FINE", slopes_of(plan, target)},
        {"FINE_XY", plan.fine_across},
        {"FINE_Z", plan.fine_along},
        {"ANALYTIC", plan.analytic_gradient},
        {"WEIGHT", target.weight && !splats_slopes(plan)},
        {"WEIGHT_ALONE", target.weights_alone},
    }};
    define(switches, defines);
    return defines;
}

} // namespace

std::vector<Counting> counting_of(const DrawPlan& plan, const Scene& scene) {
    std::vector<Counting> result(scene.fields.size());
    if (!counts_from_pivots(plan)) {
        return result;
    }
    for (const Group& group : groups_drawn(scene)) {
        for (std::size_t field = group.first; field < group.last; ++field) {
            if (!(plan.own_sheets.empty() ? plan.threshold : plan.own_sheets[field] >= 0)) {
                continue;
            }
            const double unit = plan.unit_of(field);
            const std::array<double, 2> range = scene.fields[field]->value_range();
            double pivot = pivot_of(*scene.fields[field]);
            if (group.last - group.first > 1) {
                // As float32 has it in the sheets' unit, so that all who add them mean the same number.
                pivot = unit * static_cast<double>(static_cast<float>(pivot / unit));
            }
            const double half_range = 0.5 * range[1] - 0.5 * range[0];
            result[field] = {pivot, half_range > 0.0 ? half_range : unit};
        }
    }
    return result;
}

std::vector<double> group_pivots(const DrawPlan& plan, const Scene& scene) {
    std::vector<double> sums(groups_drawn(scene).size(), 0.0);
    const std::vector<Counting> counting = counting_of(plan, scene);
    for (std::size_t field = 0; field < counting.size(); ++field) {
        sums[group_drawn_of(scene, field)] += counting[field].pivot;
    }
    return sums;
}

Steps make_steps(const DrawPlan& plan, const Frame& frame) {
    Steps steps;
    const std::int64_t n = frame.slices;
    const bool intervals = uses_intervals(plan.mode, plan.preintegration);
    if (plan.packing == Packing::wide) {
        // The last slice of pass p is 4 p + 2, its last interval starts at 4 p + 1.
        const std::int64_t last = intervals ? n - 2 : n - 3;
        steps.passes = n == 0 ? 0 : std::max<std::int64_t>((last + 3) / 4, 0) + 1;
        return steps;
    }
    steps.slices = 1;
    steps.slabs = 4;
    steps.history = 5;
    steps.stride = 1;
    steps.passes = n == 0 ? 0 : n + (intervals ? 2 : 1);
    return steps;
}

BatchLayout make_layout(const DrawPlan& plan) {
    if (plan.packing == Packing::wide) {
        return {4, 8};
    }
    return plan.paper_slicing ? BatchLayout{1, 1} : BatchLayout{1, 4};
}

double largest_sprite(const DrawPlan& plan, const Capabilities& capabilities) {
    // Guards make viewports larger by a sprite's radius.
    return !plan.points || splats_slopes(plan) || plan.sampling == Sampling::slab
               ? 0.0
               : 0.5 * static_cast<double>(capabilities.max_point_size) - 1.0;
}

gl::Defines splat_defines(const DrawPlan& plan, const FieldView& view, const SplatTarget& target) {
    const bool general = plan.general || view.sheared;
    const bool separable = plan.separable && !general && view.extent_x == view.extent_y;
    gl::Defines defines = common_defines(plan, target, plan.slab_nodes, plan.slab_pieces);
    const std::array<std::pair<const char*, bool>, 4> switches{{
        {"GENERAL", general},
        {"SEPARABLE", separable},
        {"NONNEGATIVE", separable && !target.weight && view.field != nullptr && view.field->value_range()[0] >= 0.0},
        {"POINTS", plan.points},
    }};
    define(switches, defines);
    return defines;
}

gl::Defines ellipsoid_defines(const DrawPlan& plan, SectionGroup group, const SplatTarget& target) {
    const bool thin = group == SectionGroup::thin || group == SectionGroup::precise_thin;
    const bool medium = group == SectionGroup::medium || group == SectionGroup::precise_medium;
    // Differences of means are integrated in pieces short enough for six nodes; a chord is at most 2 sqrt(k) widths
    // long.
    gl::Defines defines = common_defines(plan, target, thin ? 4 : medium ? 6 : 0, thin || medium ? 1 : 4);
    const std::array<std::pair<const char*, bool>, 5> switches{{
        {"ELLIPSOID", true},
        {"RESIDENT", plan.resident_sections},
        {"PRECISE_PLACES", is_precise(group)},
        {"SPRITE", group == SectionGroup::sprite},
        {"COMPACT", group == SectionGroup::compact && !slopes_of(plan, target) && plan.packing == Packing::wide},
    }};
    define(switches, defines);
    return defines;
}

std::vector<std::string> splat_outputs(const DrawPlan& plan, const SplatTarget& target) {
    std::vector<std::string> names;
    const auto add = [&](const std::string& name) {
        names.push_back(name + "_front");
        if (plan.packing == Packing::wide && !target.narrow) {
            names.push_back(name + "_back");
        }
    };
    add("sheet");
    if (slopes_of(plan, target)) {
        add("x");
        add("y");
        add("z");
    }
    if (target.weight && !splats_slopes(plan)) {
        add("weight");
    }
    return names;
}

ShadedParts shaded_parts(const Scene& scene) {
    ShadedParts parts;
    parts.lights = scene.lights.size();
    const std::vector<Group> groups = groups_drawn(scene);
    parts.groups = groups.size();
    parts.least_weights = std::any_of(groups.begin(), groups.end(), [&scene](const Group& group) {
        return group.last - group.first == 1 && scene.fields[group.first]->least_weight() > 0.0;
    });
    parts.ends = scene.counted && !scene.counted->ends.empty();
    parts.labels = !label_sets(groups).empty();
    parts.serving = std::any_of(groups.begin(), groups.end(), [](const Group& group) { return !is_classified(group); });
    if (shows_surfaces(scene.mode)) {
        std::size_t most = 1;
        bool plain = parts.groups == 1;
        for (std::size_t group = 0; group < groups.size(); ++group) {
            const std::vector<IsoValue> values = iso_values_of(scene, group);
            most = std::max(most, values.size());
            plain = plain && values.size() == 1 && values.front().opacity == 1.0;
        }
        parts.surfaces = plain ? 0 : parts.groups * most;
    }
    return parts;
}

LineCounts line_counts(const DrawPlan& plan, const Scene& scene) {
    if (!shows_surfaces(plan.mode) || !(plan.shadows || plan.ambient_occlusion)) {
        return {};
    }
    std::ptrdiff_t shown = 0;
    for (std::size_t group = 0; group <= scene.later_groups.size(); ++group) {
        const std::vector<IsoValue> values = iso_values_of(scene, group);
        shown = std::max(
            shown, std::count_if(values.begin(), values.end(), [](const IsoValue& iso) { return iso.opacity > 0.0; }));
    }
    std::size_t of_end = 0;
    for (const std::optional<Parallelepiped>& end :
         scene.counted ? scene.counted->ends : std::vector<std::optional<Parallelepiped>>{}) {
        of_end = std::max(of_end, Clip{{}, end}.half_spaces().size());
    }
    return {scene.later_groups.size() + 1, static_cast<std::size_t>(shown), scene.clip.half_spaces().size() + of_end};
}

gl::Defines shade_defines(const DrawPlan& plan, const ShadedParts& parts, int phase, const LineCounts& lines) {
    gl::Defines defines;
    const std::size_t lights = parts.lights;
    const bool wide = plan.packing == Packing::wide;
    defines["SLICES"] = wide ? "4" : "1";
    defines["SLABS"] = wide ? "8" : "4";
    if (!wide) {
        defines["PHASE"] = std::to_string(phase);
    }
    const std::array<std::pair<const char*, bool>, 38> switches{{
        {"SEVERAL", parts.several()},
        {"CLASSIFY", is_composited(plan.mode)},
        {"MODE_ISOSURFACE", shows_surfaces(plan.mode)},
        {"MODE_XRAY", traits_of(plan.mode).integrates},
        {"MODE_AVERAGE", traits_of(plan.mode).mean},
        {"WEIGHT", plan.weight},
        {"LEAST_WEIGHT", plan.weight && parts.least_weights},
        {"THRESHOLD", plan.threshold},
        {"PIVOT", plan.threshold && counts_from_pivots(plan)},
        {"EMPTY_TEST", plan.empty_test},
        {"PERSPECTIVE", plan.projection == Projection::perspective},
        {"GRADIENT", plan.gradient},
        {"SLOPES", splats_slopes(plan)},
        {"ANALYTIC", plan.analytic_gradient},
        {"FINE_XY", plan.fine_across},
        {"FINE_Z", plan.fine_along},
        {"SPECULAR", plan.specular},
        {"TWO_SIDED", plan.two_sided},
        {"OPACITY_CORRECTION", plan.opacity_correction},
        {"STOP", plan.stop},
        {"READ_IMAGE", plan.read_image},
        {"PREINTEGRATION", plan.preintegration},
        {"SECOND_ORDER", plan.second_order},
        {"CLIP", plan.cuts()},
        {"OWNED", plan.owned},
        {"ENDS", parts.ends},
        {"LABELS", parts.labels && parts.groups > 1},
        {"SERVING", parts.serving && parts.groups > 1},
        {"OPEN_FRONT", plan.open_front},
        {"GRADIENT_OPACITY", plan.gradient_opacity},
        {"CUT_FACES", plan.cut_faces},
        {"DEPTH_CUE", plan.depth_cue},
        {"SHADOWS", plan.shadows},
        {"OCCLUSION", plan.ambient_occlusion},
        {"DEPTH_OUT", plan.depth},
        {"COVERAGE", plan.coverage},
        {"COMPENSATED", plan.compensated},
        {"DOUBT", plan.lit_rounding > 0.0},
    }};
    define(switches, defines);
    if (is_extreme(plan.mode)) {
        // What makes one number of two.
        defines["MODE_EXTREME(a, b)"] = traits_of(plan.mode).fold == Fold::largest ? "max(a, b)" : "min(a, b)";
    }
    if (parts.groups > 1) {
        defines["GROUPS"] = std::to_string(parts.groups);
    }
    if (parts.surfaces > 0) {
        defines["SURFACES"] = std::to_string(parts.surfaces);
    }
    if (plan.gradient) {
        defines["LIGHTS"] = std::to_string(plan.lit ? lights : 0);
    }
    if (plan.shadows || plan.ambient_occlusion) {
        defines["VOLUMES"] = std::to_string((plan.shadows ? lights : 0) + (plan.ambient_occlusion ? 1 : 0));
    }
    if (lines.surfaces > 0) {
        defines["VOLUMES"] = std::to_string(lines.groups);
        defines["CASTERS"] = std::to_string(lines.surfaces);
        defines["AROUND"] = std::to_string(directions_around);
        if (lines.half_spaces > 0) {
            defines["KEPT"] = std::to_string(lines.half_spaces);
        }
    }
    return defines;
}

std::vector<std::string> shade_outputs(const DrawPlan& plan) {
    std::vector<std::string> names{"image_out"};
    if (plan.depth) {
        names.emplace_back("depth_out");
    }
    if (plan.coverage) {
        names.emplace_back("coverage_out");
    }
    if (plan.compensated) {
        names.emplace_back("error_out");
    }
    if (plan.lit_rounding > 0.0) {
        names.emplace_back("doubt_out");
    }
    return names;
}

std::array<float, 4> channel_offsets(const BatchLayout& layout, std::int64_t first_slab) {
    if (layout.stride == 4) {
        return {0.0F, 1.0F, 2.0F, 3.0F};
    }
    std::array<float, 4> offsets{};
    const auto phase = static_cast<int>(first_slab % 4);
    for (int channel = 0; channel < 4; ++channel) {
        const int offset = (channel - phase + 4) % 4;
        offsets[static_cast<std::size_t>(channel)] = offset < layout.covered ? static_cast<float>(offset) : 1e6F;
    }
    return offsets;
}

} // namespace sheetsplat::backend_gl

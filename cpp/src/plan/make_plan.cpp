// What the plans of all backends share: the effects that follow from the scene.
#include "plan/make_plan.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <utility>

#include "occurring.hpp"
#include "parts.hpp"
#include "plan/charge_effects.hpp"
#include "scene/mode_rules.hpp"
#include "sheetsplat/error.hpp"

namespace sheetsplat {

void divide_apart(const Scene& scene, const Outputs& outputs, Effects& effects, DrawPlan& plan, bool always) {
    // Quotients add up only once each is taken.
    if ((scene.fields.size() > 1 || always) && plan.threshold) {
        int next = 0;
        for (const auto& field : scene.fields) {
            plan.own_sheets.push_back(field->normalization() == Normalization::threshold ? next++ : -1);
        }
        plan.threshold = false;
        plan.weight = outputs.coverage || plan.empty_test || counts_weighted_slices(scene.mode);
    }
    effects.state(EffectId::separate_normalization, scene.fields.size() > 1 && !plan.own_sheets.empty(),
                  "fields are divided by their own weight sums before they are added",
                  "at most one division is needed for the whole scene");
}

bool lights_quotients(const DrawPlan& plan) { return plan.gradient && (plan.threshold || !plan.own_sheets.empty()); }

double steepest_falloff(const Scene& scene) {
    double steepest = 0.0;
    for (const auto& field : scene.fields) {
        steepest = std::max(steepest, field->size() > 0 ? field->kernel().falloff : 0.0);
    }
    return steepest;
}

bool saturates_within(const Scene& scene, const ViewFacts& view, std::int64_t slices, double opacity) {
    if (shows_surfaces(scene.mode) || opacity >= 1.0) {
        return true;
    }
    const double exponent = view.frame.slice_spacing / view.frame.reference_length * view.frame.largest_slant;
    // Intervals are one more than the slices: the first one begins before them. What second order extrapolates is at
    // most a third more than the halves of an interval absorb.
    const std::int64_t steps = view.frame.slices + (scene.preintegration ? 1 : 0);
    const double more = scene.preintegration && scene.second_order ? 4.0 / 3.0 : 1.0;
    const double step = std::min(-more * std::expm1(std::log1p(-opacity) * exponent), 1.0);
    const double reach = -std::expm1(std::log1p(-step) * static_cast<double>(std::min(slices, steps)));
    return reach >= scene.opacity_stop;
}

namespace {

/// What of a scene can be seen at all.
struct SceneShows {
    bool anything = true;
    std::string why_nothing;
    double opacity = 1.0; ///< largest that occurs at a point, of all groups together; of surfaces that of one
};

SceneShows shown_of(const Scene& scene, const ViewFacts& view) {
    SceneShows shows;
    if (is_scalar(scene.mode)) {
        return shows;
    }
    const bool surface = shows_surfaces(scene.mode);
    std::string ranges;
    shows.opacity = 0.0;
    std::size_t group_number = 0;
    for (const Group& group : scene.groups()) {
        const Range values = occurring_values(scene, view, group);
        const std::vector<IsoValue> iso_values = iso_values_of(scene, group_number++);
        if (!is_classified(group)) {
            continue;
        }
        if (surface) {
            for (const IsoValue& iso : iso_values) {
                const bool crossed = values.lower < iso.value && iso.value <= values.upper;
                shows.opacity = std::max(shows.opacity, crossed ? iso.opacity : 0.0);
            }
        } else {
            // Groups absorb together: conventions, section 4.
            const double opacity = most_opaque(*group.transfer_function, values);
            shows.opacity += (1.0 - shows.opacity) * opacity;
        }
        ranges += (ranges.empty() ? "" : "; ") + number(values.lower) + " to " + number(values.upper);
    }
    shows.anything = shows.opacity > 0.0;
    shows.why_nothing = (surface ? "no value crosses an iso value with an opacity: they lie in the range "
                                 : "opacity is 0 over all values that can occur, ") +
                        ranges;
    return shows;
}

bool fields_end(const Scene& scene) {
    return std::any_of(scene.fields.begin(), scene.fields.end(),
                       [](const std::shared_ptr<const Field>& field) { return field->domain().has_value(); });
}

void state_fields(const Scene& scene, Effects& effects) {
    std::array<std::size_t, 3> count{};
    for (const auto& field : scene.fields) {
        ++count[static_cast<std::size_t>(field->normalization())];
    }
    std::string how;
    const auto add = [&](Normalization normalization, const char* text) {
        if (count[static_cast<std::size_t>(normalization)] > 0) {
            how += (how.empty() ? "" : "; ") + std::string(text);
        }
    };
    add(Normalization::lattice, "sums of values are divided by a constant, once for all kernels");
    add(Normalization::threshold, "sums of values are divided by those of weights, at each point");
    add(Normalization::none, "sums of values are the scalar as they are");
    effects.state(EffectId::normalization, count[static_cast<std::size_t>(Normalization::none)] < scene.fields.size(),
                  how);
    const bool apart = !scene.later_groups.empty() && !is_scalar(scene.mode);
    const std::string fields = text_of_count(scene.fields.size(), "field");
    effects.state(
        EffectId::several_fields, apart ? scene.fields.size() > scene.groups().size() : scene.fields.size() > 1,
        apart ? fields + " in " + text_of_count(scene.groups().size(), "group") + ": scalars add up inside a group"
              : "the scalars of " + fields + " add up",
        scene.fields.size() == 1 ? "there is one field" : "each of " + fields + " has its own transfer function");
    const bool end = scene.counted && scene.counted->mirrored;
    effects.state(EffectId::boundary, end,
                  scene.part ? "the part belongs to a volume that ends at its boundary"
                  : end      ? scene.counted->reason
                             : "",
                  fields_end(scene) ? "nothing shows at the volumes' boundary: what lies beyond makes no difference"
                                    : "no volume ends: their fields fall to their bases");
    effects.state(EffectId::own_transfer_functions, apart,
                  text_of_count(scene.later_groups.size() + 1) + " transfer functions",
                  scene.later_groups.empty() ? "one transfer function classifies all fields"
                                             : "the mode shows the scalar itself");
    const std::vector<Group> groups = scene.groups();
    const auto shown = std::count_if(groups.begin(), groups.end(),
                                     [](const Group& group) { return group.use.role == GroupRole::label; });
    const auto labels = std::count_if(groups.begin(), groups.end(), is_label);
    const auto colors = std::count_if(groups.begin(), groups.end(),
                                      [](const Group& group) { return group.use.role == GroupRole::colors; });
    effects.state(EffectId::labels, labels > 0,
                  text_of_count(static_cast<std::size_t>(labels), "label") + ", of which " +
                      text_of_count(static_cast<std::size_t>(shown)) + " have colours, are never mixed",
                  "no field holds labels");
    effects.state(EffectId::other_colors, colors > 0,
                  text_of_count(static_cast<std::size_t>(colors), "field") + " give colours to what others show",
                  "fields have their own colours");
}

void plan_clip(const Scene& scene, const ViewFacts& view, Effects& effects, DrawPlan& plan) {
    const bool given = !scene.clip.empty();
    const bool own = scene.counted ? !scene.counted->clip.empty() : given;
    const Kept kept = kept_by(scene, view);
    plan.clip = effects.decide_given(
        EffectId::clip, given, given && kept != Kept::everything,
        !given                            ? "the scene has no clip"
        : !own && kept == Kept::something ? "the volume ends inside of what its kernels and their mirror images reach"
        : kept == Kept::everything        ? "the clip keeps all that kernels reach"
        : kept == Kept::nothing           ? "the clip cuts off all that kernels reach: the picture is empty"
                                          : "planes or a box cut off part of what kernels reach");
    plan.blank = plan.clip && kept == Kept::nothing;
}

void plan_depth_limit(const Scene& scene, const ViewFacts& view, Effects& effects, DrawPlan& plan) {
    const bool given = scene.depth_limit.has_value();
    const Kept kept = !given ? Kept::everything
                      : scene.depth_limit->nearest() > view.frame.farthest_depth + view.frame.slice_spacing
                          ? Kept::everything
                      : scene.depth_limit->farthest() <= view.frame.nearest_depth ? Kept::nothing
                                                                                  : Kept::something;
    plan.depth_limit = effects.decide_given(
        EffectId::depth_limit, given, kept != Kept::everything,
        !given                     ? "no depths of a surface were given"
        : kept == Kept::everything ? "the surface lies behind all that kernels reach, at depth " +
                                         number(scene.depth_limit->nearest()) + " or more"
        : kept == Kept::nothing ? "the surface lies in front of all that kernels reach: the picture is empty"
                                : "a surface drawn elsewhere hides what lies behind it, from depth " +
                                      number(scene.depth_limit->nearest()) + " on");
    plan.blank = plan.blank || (plan.depth_limit && kept == Kept::nothing);
}

bool black(const Vec3& color) { return color.x == 0.0 && color.y == 0.0 && color.z == 0.0; }

/// Lights, gradients and what only they need.
void plan_light(const Scene& scene, const ViewFacts& view, const SceneShows& shows, Effects& effects, DrawPlan& plan) {
    const bool scalar = is_scalar(scene.mode);
    const Material& material = scene.material;
    const bool lights = !scene.lights.empty() && !scalar && shows.anything;
    const bool shining =
        std::any_of(scene.lights.begin(), scene.lights.end(), [](const Light& light) { return !black(light.color); });
    const bool matt = shining && material.diffuse != 0.0;
    const bool shiny = shining && material.specular != 0.0;
    plan.ambient_only = lights && !matt && !shiny;
    const bool lit = lights && !plan.ambient_only;
    const std::string dark = scalar                 ? "the mode is not shaded"
                             : scene.lights.empty() ? "there are no lights"
                             : !shows.anything      ? shows.why_nothing
                             : !shining             ? "all lights are black"
                             : !matt && !shiny      ? "the material reflects ambient light only"
                                                    : "";
    const bool composite = is_composited(scene.mode);
    const bool faded = scene.gradient_opacity && composite;
    plan.gradient_opacity = effects.decide_given(EffectId::gradient_opacity, faded, faded && shows.anything,
                                                 !scene.gradient_opacity ? "not asked for"
                                                 : !composite            ? "the mode has no opacity to multiply"
                                                 : shows.anything ? "asked for: opacity follows the gradient up to " +
                                                                        number(*scene.gradient_opacity)
                                                                  : shows.why_nothing);
    const bool called = lit || plan.gradient_opacity;
    plan.gradient = effects.decide(EffectId::gradient, called,
                                   lit                     ? "lights need normals"
                                   : plan.gradient_opacity ? "opacity follows the gradient"
                                                           : dark,
                                   true);
    if (plan.gradient && scalar) {
        throw InvalidInput(Complaint{"the effects cannot be forced", "gradient on in a scalar mode",
                                     option_ref("mode", "composite") + " or " + option_ref("mode", "isosurface"),
                                     "leave the effect gradient out of " + option_ref("effects"), "effects"});
    }
    plan.lit = lit && plan.gradient;
    plan.gradient_opacity = plan.gradient_opacity && plan.gradient;
    const bool analytic = scene.gradient == Gradient::analytic;
    plan.analytic_gradient =
        effects.decide_given(EffectId::analytic_gradient, analytic && !scalar, analytic && plan.gradient,
                             !analytic       ? "differences of sheets were asked for"
                             : plan.gradient ? "asked for: sums of the kernels' own derivatives"
                                             : "asked for, but gradients are not needed: " + dark) &&
        plan.gradient;
    effects.state(EffectId::ambient_only, plan.ambient_only,
                  plan.ambient_only ? dark + ": colours are multiplied by the ambient coefficient"
                  : lit             ? "the material reflects the lights"
                                    : dark);
    const bool specular = lit && shiny;
    plan.specular = effects.decide(EffectId::specular, specular,
                                   specular ? "the material reflects"
                                   : lit    ? "the material's specular coefficient is 0, or all lights are black"
                                            : dark,
                                   true) &&
                    plan.gradient;
    // Forced on, it would turn normals that the scene leaves as they are.
    plan.two_sided = effects.decide_given(EffectId::two_sided, material.two_sided && !scalar, lit && material.two_sided,
                                          !lit                 ? dark
                                          : material.two_sided ? "asked for by the material"
                                                               : "the material is one-sided") &&
                     plan.gradient;
    const bool faces = scene.cut_faces && composite;
    const bool cut = plan.clip || (scene.counted && !scene.counted->ends.empty());
    plan.cut_faces =
        effects.decide_given(EffectId::cut_faces, faces, faces && lit && cut,
                             !scene.cut_faces ? "not asked for"
                             : !composite     ? "asked for, but no matter that is cut shows in this mode"
                             : !lit           ? "asked for, but " + dark
                             : !cut           ? "asked for, but nothing is cut off of what can be seen"
                                              : "where a cut opens what is opaque, gradients may have any direction: "
                                                "normals are those of the cut") &&
        plan.lit && cut;
    const auto world = static_cast<std::size_t>(std::count_if(
        scene.lights.begin(), scene.lights.end(), [](const Light& light) { return light.space == LightSpace::world; }));
    const std::size_t eye = scene.lights.size() - world;
    effects.state(EffectId::eye_lights, plan.lit && eye > 0,
                  !lit      ? dark
                  : eye > 0 ? text_of_count(eye, "light") + " of the camera"
                            : "no light moves with the camera");
    effects.state(EffectId::world_lights, plan.lit && world > 0,
                  !lit        ? dark
                  : world > 0 ? text_of_count(world, "light") + " of the world, turned with each view"
                              : "no light is fixed to the world");
    const std::string clear = "opacity is 0 over all values that can occur: nothing dims light";
    const bool shadows = scene.shadows && !scalar && !scene.lights.empty();
    plan.shadows = effects.decide_given(EffectId::shadows, shadows, shadows && lit && shows.opacity > 0.0,
                                        !scene.shadows         ? "not asked for"
                                        : !lit                 ? "asked for, but " + dark
                                        : shows.opacity == 0.0 ? clear
                                                               : "asked for: matter between a point and a light "
                                                                 "dims the light") &&
                   plan.lit;
    const auto& occlusion = scene.ambient_occlusion;
    const bool ambient = scene.lights.empty() || material.ambient != 0.0;
    const bool occluded = occlusion && occlusion->strength > 0.0 && ambient && shows.opacity > 0.0 && shows.anything;
    plan.ambient_occlusion =
        effects.decide_given(EffectId::ambient_occlusion, occlusion && !scalar, occluded && !scalar,
                             !occlusion                   ? "not asked for"
                             : scalar                     ? "asked for, but the mode is not shaded"
                             : !shows.anything            ? shows.why_nothing
                             : occlusion->strength == 0.0 ? "asked for with a strength of 0"
                             : !ambient                   ? "asked for, but the material reflects no ambient light"
                             : shows.opacity == 0.0       ? clear
                                                          : "asked for: matter around a point dims ambient light");
    const double share = fine_gradient_below * view.frame.reference_length;
    const bool close = view.frame.smallest_step() < share;
    // (The differences of labels are not those of their sums.)
    const bool labels = !label_sets(scene.groups()).empty();
    const bool fine = called && close && !plan.analytic_gradient && !labels;
    plan.fine_gradient = effects.decide(EffectId::fine_gradient, fine,
                                        fine ? "a pixel or the slice spacing is so small that differences of sums "
                                               "would lose the gradient: differences are splatted"
                                        : plan.analytic_gradient ? "no differences are taken"
                                                                 : "differences of neighbouring sums keep enough "
                                                                   "digits",
                                        true) &&
                         plan.gradient && !plan.analytic_gradient && !labels;
    plan.fine_across = plan.fine_gradient && (view.frame.smallest_pixel < share || !fine);
    plan.fine_along = plan.fine_gradient && (view.frame.slice_spacing < share || !fine);
}

/// Whether a kernel reaches a point follows from where it is: all fields are lattices without holes, and points count
/// by themselves.
bool places_tell_reach(const Scene& scene) {
    return scene.sampling == Sampling::point &&
           std::all_of(scene.fields.begin(), scene.fields.end(), [](const std::shared_ptr<const Field>& field) {
               const RegularField* lattice = as_regular(field.get());
               return lattice != nullptr && !lattice->has_holes();
           });
}

void plan_depth_cue(const Scene& scene, const ViewFacts& view, const SceneShows& shows, Effects& effects,
                    DrawPlan& plan) {
    const bool scalar = is_scalar(scene.mode);
    const bool given = scene.depth_cue && !scalar;
    const bool strong = given && scene.depth_cue->strength > 0.0;
    const bool reached = given && view.frame.farthest_depth > scene.depth_cue->start;
    plan.depth_cue =
        effects.decide_given(EffectId::depth_cue, given, strong && reached && shows.anything,
                             !scene.depth_cue ? "not asked for"
                             : scalar         ? "the mode shows the scalar itself"
                             : !strong        ? "asked for with a strength of 0"
                             : !reached       ? "it starts at depth " + number(scene.depth_cue->start) +
                                              ", behind the last slice at " + number(view.frame.farthest_depth)
                             : shows.anything ? "asked for: colours fade with depth"
                                              : shows.why_nothing);
}

#define SHEETSPLAT_PLANNER(name, ...) &plan_##name,
constexpr std::array planners{SHEETSPLAT_BACKENDS(SHEETSPLAT_PLANNER)};
#undef SHEETSPLAT_PLANNER

} // namespace

DrawPlan make_plan(const Scene& scene, const ViewFacts& view, const RendererOptions& options, const Outputs& outputs,
                   Projection projection, Backend backend, const Capabilities* capabilities) {
    DrawPlan plan;
    RenderPlan& summary = plan.summary;
    const bool defines = can(backend, Ability::defines);
    plan.projection = projection;
    plan.sampling = scene.sampling;
    plan.mode = scene.mode;
    const std::vector<Group> groups = groups_drawn(scene);
    plan.value_unit = unit_of_values(scene, view, groups.front());
    if (is_scalar(scene.mode)) {
        for (const Group& group : groups) {
            plan.value_unit = std::max(plan.value_unit, unit_of_values(scene, view, group));
        }
    } else if (groups.size() > 1) {
        for (const Group& group : groups) {
            plan.field_units.insert(plan.field_units.end(), group.last - group.first,
                                    unit_of_values(scene, view, group));
        }
    }
    summary.backend = backend;
    summary.size = view.frame.size;
    summary.slice_spacing = view.frame.slice_spacing;
    summary.first_slice = view.frame.first_slice;
    summary.slices = view.frame.slices;
    summary.first_depth = view.frame.nearest_depth;
    summary.cut_by_near = view.frame.cut_by_near;
    Effects effects(options.effects, backend, summary.effects);

    const bool scalar = is_scalar(scene.mode);
    const SceneShows shows = shown_of(scene, view);
    bool threshold = false;
    for (const auto& field : scene.fields) {
        threshold = threshold || field->normalization() == Normalization::threshold;
    }

    // Classification and what it needs.
    effects.state(EffectId::classification, !scalar,
                  scalar ? "the mode shows the scalar itself" : "the mode shows colours");
    effects.state(EffectId::isosurface, shows_surfaces(scene.mode), "the mode shows crossings of iso values",
                  "the mode is not isosurface");
    state_fields(scene, effects);
    const bool visible_at_zero = is_composited(scene.mode) && !(scene.counted && scene.counted->filled) &&
                                 std::any_of(groups.begin(), groups.end(), shows_at_base);
    const bool colored = std::any_of(groups.begin(), groups.end(),
                                     [](const Group& group) { return group.use.role == GroupRole::colors; }) &&
                         !(scene.counted && scene.counted->filled);
    plan.threshold = threshold;
    plan.open_front = shows_surfaces(scene.mode) && view.frame.cut_by_near;
    plan.coverage = outputs.coverage;
    plan.depth = outputs.depth && !scalar;
    plan.owned = scene.part && scene.part->cuts();
    plan.counts = traits_of(scene.mode).mean && (scene.part || (scene.counted && scene.counted->counts));
    const bool thin = is_composited(scene.mode) && std::any_of(scene.fields.begin(), scene.fields.end(),
                                                               [](const std::shared_ptr<const Field>& field) {
                                                                   return field->least_weight() > 0.0;
                                                               });
    plan.empty_test =
        effects.decide(EffectId::empty_test, visible_at_zero || thin || colored,
                       thin              ? "points beside missing samples, which too few kernels reach, are empty"
                       : colored         ? "where the field that gives colours is empty, others show"
                       : visible_at_zero ? "opacity at 0 is above 0, and empty points must stay transparent"
                       : scalar          ? "the mode has no opacity"
                       : scene.counted && scene.counted->filled ? "kernels reach every point inside the volume"
                                                                : "a scalar of 0 is transparent anyway",
                       true);
    const bool filtering = scene.filter == Filter::ewa && view.shapes.largest_filtering > least_filtering;
    const bool counted = counts_weighted_slices(scene.mode);
    const bool filled = scene.counted && scene.counted->filled;
    // (Backend gl passes over pixels that no kernel touches, which count too: it draws all kernels for their weights.)
    const bool places_tell = can(backend, Ability::tells_reach) && !filtering && places_tell_reach(scene) &&
                             (!scalar || adds_all_fields(scene));
    const bool by_place = counted && places_tell;
    const bool weight = threshold || outputs.coverage || plan.empty_test || (counted && !by_place);
    plan.weight =
        effects.decide(EffectId::weight, weight,
                       threshold          ? "rho is divided by the weight sum"
                       : outputs.coverage ? "coverage is the weight sum"
                       : by_place ? filled ? "kernels reach every point inside the volume: all slices there count"
                                           : "the places of samples say which slices count"
                       : counted  ? "only slices where the weight sum is above 0 count"
                       : plan.empty_test ? "only the weight distinguishes empty points from sums of 0"
                                         : "no division by weights, no coverage, and opacity at 0 is 0",
                       true) ||
        plan.empty_test;
    const bool unresolved = view.kernels.unresolved > 0;
    const std::string small = kernels(view.kernels.unresolved) + (view.kernels.unresolved == 1 ? " is" : " are") +
                              " smaller than a pixel or thinner than a slice distance";
    plan.filter = filtering;
    effects.state(
        EffectId::ewa_filter, filtering,
        filtering                     ? unresolved ? "the scene has the filter ewa, and " + small
                                                   : "the scene has the filter ewa: it widens kernels by a "
                                                     "pixel and a slice distance"
        : scene.filter == Filter::ewa ? "the scene has the filter ewa, but every kernel is so large that it "
                                        "would change nothing"
        : unresolved
            ? "the scene has no filter, though " + small + ": the filter ewa would keep their mass"
            : "the scene has no filter, and no kernel is smaller than a pixel or thinner than a slice distance");
    bool lattices = false;
    bool spheres = false;
    for (const auto& field : scene.fields) {
        const EllipsoidField* ellipsoids = as_ellipsoids(field.get());
        lattices = lattices || (ellipsoids == nullptr && !filtering);
        spheres = spheres || (ellipsoids != nullptr && ellipsoids->size() > 0 && ellipsoids->isotropic() && !filtering);
    }
    const bool filtered_in_place = filtering && can(backend, Ability::filters_lattices);
    effects.state(EffectId::scattered_kernels, view.kernels.ellipsoids || (filtering && !filtered_in_place),
                  view.kernels.ellipsoids ? "a field holds ellipsoids: each is sliced by itself"
                  : filtered_in_place     ? "all fields are lattices, whose kernels the filter widens where they are"
                  : filtering             ? "the filter turns the samples of lattices into ellipsoids"
                                          : "all fields are lattices");
    effects.state(EffectId::slab_sampling, scene.sampling == Sampling::slab,
                  "asked for: slices are means over their slabs", "slices are samples at one depth");
    effects.state(EffectId::perspective, projection == Projection::perspective, "the camera is perspective",
                  "the camera is orthographic");
    plan.general = effects.decide(
        EffectId::general_sections, lattices && (view.shapes.sheared || projection == Projection::perspective),
        !lattices             ? "no lattice is drawn, and every ellipsoid has sections of its own"
        : view.shapes.sheared ? "cross-sections lean: unequal sample spacing or oblique axes, seen at an angle"
        : projection == Projection::perspective
            ? "cross-sections scale from slab to slab"
            : "all sections of a lattice's kernel have the same place on the screen",
        true);

    plan_clip(scene, view, effects, plan);
    plan_depth_limit(scene, view, effects, plan);
    plan_light(scene, view, shows, effects, plan);

    // Opacity.
    const double exponent = view.frame.slice_spacing / view.frame.reference_length;
    const bool correction = is_composited(scene.mode) && !scene.preintegration &&
                            (exponent != 1.0 || (projection == Projection::perspective));
    plan.opacity_correction = effects.decide(EffectId::opacity_correction, correction,
                                             correction ? "slices are not one reference length apart along every ray"
                                                        : "opacity per reference length is opacity per slice here",
                                             true);
    plan.preintegration = scene.preintegration;
    effects.state(EffectId::preintegration, scene.preintegration, "asked for", "not asked for");
    plan.second_order =
        effects.decide_given(EffectId::second_order, scene.preintegration && scene.second_order,
                             scene.preintegration && scene.second_order && shows.anything,
                             !scene.second_order     ? "not asked for"
                             : !scene.preintegration ? "intervals are not pre-integrated"
                             : shows.anything        ? "asked for: the curvature of the scalar inside intervals counts"
                                                     : shows.why_nothing);
    plan_depth_cue(scene, view, shows, effects, plan);
    // What lies in front of a part may have taken nearly all light.
    const bool saturates =
        !scalar && shows.anything &&
        ((scene.part && scene.part->in_front) || saturates_within(scene, view, view.frame.slices + 1, shows.opacity));
    bool opaque_surfaces = shows_surfaces(scene.mode);
    for (std::size_t group = 0; group < groups.size() && opaque_surfaces; ++group) {
        const std::vector<IsoValue> values = iso_values_of(scene, group);
        opaque_surfaces =
            std::all_of(values.begin(), values.end(), [](const IsoValue& iso) { return iso.opacity == 1.0; });
    }
    const bool stops = saturates && (scene.opacity_stop < 1.0 || opaque_surfaces);
    plan.stop = effects.decide(EffectId::opacity_stop, stops && !opaque_surfaces,
                               scalar            ? "the mode has no opacity"
                               : opaque_surfaces ? "an isosurface is opaque at its first crossing"
                               : !shows.anything ? shows.why_nothing
                               : stops           ? "opacity can reach opacity_stop"
                               : saturates       ? "opacity_stop is 1"
                                                 : "opacity cannot reach opacity_stop with this transfer function",
                               true) &&
                !opaque_surfaces;

    effects.state(EffectId::background, scene.background.has_value() && !scalar,
                  scene.background ? "a background was given" : "no background was given");
    effects.state(EffectId::coverage, outputs.coverage, "asked for", "not asked for");
    effects.state(EffectId::depth, outputs.depth, "asked for", "not asked for");

    if (!defines) {
        const auto sums = [&] { return sum_facts(scene, view, plan); };
        // (The end of an interval that the near plane removes is empty, though kernels reach it.)
        const bool told = filled && !view.frame.cut_by_near;
        const bool intervals = !plan.empty_test && !told && intervals_may_be_empty(scene, sums(), plan);
        effects.state(EffectId::empty_intervals, intervals,
                      intervals ? "intervals that no kernel reaches must be distinguished from those whose ends are 0"
                      : plan.empty_test ? "the empty test distinguishes them already"
                      : told            ? "kernels reach every point inside the volume"
                                        : "intervals whose ends are 0 are transparent anyway");
        plan.empty_test = plan.empty_test || intervals;
        plan.weight = plan.weight || (intervals && (!places_tell || shows_between_zeros(scene, sums(), plan)));
    }
    planners[index_of(backend)](
        {scene, view, options, outputs, capabilities, {lattices, spheres, stops, shows.opacity}}, effects, plan);
    if (!defines) {
        expect_light_errors(scene, view, shows.opacity, plan);
    }
    charge_effects(summary);
    return plan;
}

} // namespace sheetsplat

#include "view/shading_inputs.hpp"

#include <algorithm>

#include <glm/common.hpp>
#include <glm/geometric.hpp>

#include "plan/make_plan.hpp"
#include "scene/mode_rules.hpp"

namespace sheetsplat {

namespace {

/// The least stop: just above the least normal number of float32.
constexpr double smallest_stop = 1.2e-38;
/// A depth cue over less than this share of the slice distance is a step: no point lies between its ends, and its slope
/// stays within float32.
constexpr double shortest_cue = 1e-6;
constexpr double largest_factor = 1e30;

ShadingInputs::EyeLight in_eye_space(const Light& light, const Camera& camera) {
    // Scaled first: the length of a direction may be beyond float64's squares.
    const Vec3 size = glm::abs(light.direction);
    const Vec3 unit = glm::normalize(light.direction / std::max({size.x, size.y, size.z}));
    return {light.space == LightSpace::world ? glm::normalize(camera.direction_to_eye(unit)) : unit, light.color};
}

ShadingInputs::OfGroup inputs_of(const Scene& scene, const Group& group, const Frame& frame, const DrawPlan& plan,
                                 double pivot, const std::vector<IsoValue>& iso_values) {
    const TransferFunction& function = *group.transfer_function;
    const double unit = plan.unit_of(group.first);
    ShadingInputs::OfGroup inputs;
    if (shows_surfaces(plan.mode)) {
        for (const IsoValue& iso : iso_values) {
            const double value = is_label(group) ? just_above_labels : (iso.value - pivot) / unit;
            inputs.surfaces.push_back({value, function.at(iso.value).color, iso.opacity});
        }
    }
    if (plan.gradient) {
        inputs.weakest_gradient = weakest_difference(scene, group) / unit;
    }
    if (group.last - group.first == 1) {
        inputs.least_weight = scene.fields[group.first]->least_weight();
    }
    if (plan.gradient_opacity) {
        inputs.full_gradient = *scene.gradient_opacity / unit * frame.reference_length;
    }
    return inputs;
}

} // namespace

ShadingInputs make_shading_inputs(const Scene& scene, const Camera& camera, const Frame& frame, const DrawPlan& plan,
                                  const std::vector<double>& pivots) {
    ShadingInputs inputs;
    inputs.exponent = std::min(frame.slice_spacing / frame.reference_length, largest_factor);
    if (plan.stop) {
        inputs.opacity_stop = std::max(scene.opacity_stop, smallest_stop);
    }
    inputs.scalar_step = scalar_unit(plan.mode, plan.value_unit, frame.slice_spacing);

    for (const Group& group : groups_drawn(scene)) {
        const double pivot = pivots.empty() ? 0.0 : pivots[inputs.groups.size()];
        const std::vector<IsoValue> iso_values =
            is_scalar(plan.mode) ? std::vector<IsoValue>{} : iso_values_of(scene, inputs.groups.size());
        inputs.groups.push_back(inputs_of(scene, group, frame, plan, pivot, iso_values));
        if (is_scalar(plan.mode) && !adds_all_fields(scene)) {
            inputs.groups.back().base = scene.counted->bases[inputs.groups.size() - 1] / plan.value_unit;
        }
    }
    inputs.material = scene.material;
    inputs.material.shininess = std::min(inputs.material.shininess, largest_factor);
    if (plan.gradient) {
        for (const Light& light : scene.lights) {
            inputs.lights.push_back(in_eye_space(light, camera));
        }
        inputs.gradient_across = 0.5 * frame.reference_length / frame.pixel;
        inputs.gradient_along = 0.5 * frame.reference_length / frame.slice_spacing;
    }
    if (plan.depth_cue) {
        const DepthCue& cue = *scene.depth_cue;
        inputs.cue_start = cue.start;
        inputs.cue_per_depth = 1.0 / std::max(cue.end - cue.start, shortest_cue * frame.slice_spacing);
        inputs.cue_strength = cue.strength;
        inputs.cue_color = cue.color;
    }
    inputs.face_length = std::clamp(frame.reference_length / frame.slice_spacing, 1.0, largest_factor);
    if (plan.ambient_occlusion) {
        inputs.occlusion_strength = scene.ambient_occlusion->strength;
    }
    return inputs;
}

} // namespace sheetsplat

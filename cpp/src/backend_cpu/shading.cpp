#include "backend_cpu/shading.hpp"

#include <algorithm>
#include <iterator>
#include <utility>

#include <glm/geometric.hpp>

#include "backend_cpu/number.hpp"
#include "light/surface_lines.hpp"
#include "plan/make_plan.hpp"
#include "scene/mode_rules.hpp"
#include "view/shading_inputs.hpp"

namespace sheetsplat::backend_cpu {

namespace {

/// Of a label, where nothing shows at 0: sheets hold that where they were not drawn to.
TransferFunction without_zero(const TransferFunction& function) {
    std::vector<TransferPoint> points = function.points();
    for (TransferPoint& point : points) {
        point.value = std::max(point.value, just_above_labels);
    }
    return TransferFunction(std::move(points));
}

template <class T>
GroupShading<T> group_of(const Group& of, const ShadingInputs::OfGroup& inputs, const DrawPlan& plan) {
    const TransferFunction function = is_label(of) ? without_zero(*of.transfer_function) : *of.transfer_function;
    const double value_unit = plan.unit_of(of.first);
    GroupShading<T> group;
    group.classified = is_classified(of);
    group.counts = of.use.role != GroupRole::colors;
    if (is_composited(plan.mode) || of.use.role == GroupRole::colors) {
        group.transfer = make_transfer_table<T>(function, value_unit);
        if (plan.preintegration) {
            group.ramps = make_ramp_table<T>(function, value_unit);
        }
    }
    for (const ShadingInputs::Surface& surface : inputs.surfaces) {
        if (surface.opacity > 0.0) {
            ShadingSurface<T> made;
            made.value = number<T>(surface.value);
            for (int c = 0; c < 3; ++c) {
                made.color[c] = number<T>(surface.color[c]);
            }
            made.opacity = static_cast<T>(surface.opacity);
            group.surfaces.push_back(made);
        }
    }
    group.surface_table = make_surface_table(group.surfaces);
    group.at_zero = is_composited(plan.mode) && group.transfer.below < T(0) && group.transfer.above > T(0);
    group.weakest_gradient = inputs.weakest_gradient;
    group.least_weight = number<T>(inputs.least_weight);
    group.full_gradient = inputs.full_gradient;
    group.base = number<T>(inputs.base);
    return group;
}

template <class T>
bool all_opaque(const std::vector<ShadingSurface<T>>& surfaces) {
    return std::all_of(surfaces.begin(), surfaces.end(),
                       [](const ShadingSurface<T>& surface) { return surface.opacity == T(1); });
}

template <class T>
void add_lights(const ShadingInputs& inputs, const DrawPlan& plan, Shading<T>& shading) {
    shading.gray = true;
    for (const ShadingInputs::EyeLight& light : inputs.lights) {
        ShadingLight<T> made;
        for (int c = 0; c < 3; ++c) {
            made.direction[c] = static_cast<T>(light.direction[c]);
            made.diffuse[c] = number<T>(light.color[c] * inputs.material.diffuse);
            made.specular[c] = number<T>(light.color[c] * inputs.material.specular);
        }
        shading.gray = shading.gray && light.color.x == light.color.y && light.color.y == light.color.z;
        shading.lights.push_back(made);
    }
    shading.ambient = number<T>(inputs.material.ambient);
    shading.shininess = static_cast<T>(inputs.material.shininess);
    shading.specular = plan.specular;
    shading.two_sided = plan.two_sided;
}

VolumeLookup lookup_of(const LightVolume& volume, const Camera& camera, const Frame& frame) {
    VolumeLookup lookup;
    lookup.volume = &volume;
    const auto along = [&](const Vec3& direction) {
        return Vec3(glm::dot(direction, volume.per_step[0]), glm::dot(direction, volume.per_step[1]),
                    glm::dot(direction, volume.per_step[2]));
    };
    // Pixel (i, j) looks along ((i - axis_x) right + (axis_y - j) up) pixel - back.
    lookup.by_column = frame.pixel * along(camera.right_world());
    lookup.by_row = -frame.pixel * along(camera.up_world());
    const Vec3 corner = (0.5 - frame.axis_x) * lookup.by_column + (0.5 - frame.axis_y) * lookup.by_row;
    lookup.constant = along(camera.eye() - volume.origin);
    lookup.by_depth = -along(camera.back_world());
    (frame.projection == Projection::perspective ? lookup.by_depth : lookup.constant) += corner;
    return lookup;
}

template <class T>
SurfaceLight<T> surface_light_of(const Scene& scene, const Camera& camera, const Frame& frame, const DrawPlan& plan,
                                 const LightVolumes& volumes) {
    const LightVolume& grid = *volumes.groups.front();
    const SurfaceLines lines = make_surface_lines(scene, camera, grid, frame.slice_spacing, plan.value_unit);
    SurfaceLight<T> light;
    light.place = lookup_of(grid, camera, frame);
    for (std::size_t number_of = 0; number_of < volumes.groups.size(); ++number_of) {
        typename SurfaceLight<T>::Group& group = light.groups.emplace_back();
        group.rho = volumes.groups[number_of].get();
        for (const SurfaceLines::Surface& surface : lines.surfaces[number_of]) {
            group.surfaces.push_back({number<T>(surface.value), static_cast<T>(surface.absorption)});
        }
        for (const SurfaceLines::Kept& half : lines.kept[number_of]) {
            group.kept.push_back({{number<T>(half.normal.x), number<T>(half.normal.y), number<T>(half.normal.z)},
                                  number<T>(half.distance)});
        }
    }
    const auto line = [](const Vec3& step) {
        return typename SurfaceLight<T>::Line{{static_cast<T>(step.x), static_cast<T>(step.y), static_cast<T>(step.z)}};
    };
    std::transform(lines.to_lights.begin(), lines.to_lights.end(), std::back_inserter(light.to_lights), line);
    std::transform(lines.around.begin(), lines.around.end(), std::back_inserter(light.around), line);
    light.around_steps = static_cast<T>(lines.around_steps);
    return light;
}

template <class T>
void add_effects(const Scene& scene, const Camera& camera, const Frame& frame, const DrawPlan& plan,
                 const ShadingInputs& inputs, const LightVolumes* volumes, Shading<T>& shading) {
    shading.cuts = plan.cuts() || plan.owned;
    if (scene.counted) {
        for (std::size_t n = 0; n < scene.counted->ends.size(); ++n) {
            const Clip end{{}, scene.counted->ends[n]};
            shading.groups[n].kept = half_spaces_in_eye(end, camera, frame.slice_spacing);
            shading.cuts = shading.cuts || !end.empty();
        }
    }
    if (plan.clip) {
        shading.kept = half_spaces_in_eye(scene.clip, camera, frame.slice_spacing);
    }
    shading.second_order = plan.second_order && plan.preintegration;
    shading.analytic_gradient = plan.analytic_gradient && plan.gradient;
    shading.gradient_opacity = plan.gradient_opacity;
    shading.cut_faces = plan.cut_faces;
    shading.face_length = inputs.face_length;
    shading.depth_cue = plan.depth_cue;
    shading.inputs = inputs;
    const bool by_surfaces = volumes != nullptr && !volumes->groups.empty();
    if (by_surfaces) {
        shading.surface_light = surface_light_of<T>(scene, camera, frame, plan, *volumes);
    }
    shading.shadows = plan.shadows && volumes != nullptr;
    if (shading.shadows && !by_surfaces) {
        for (const auto& volume : volumes->lights) {
            shading.shadow_of.push_back(volume ? lookup_of(*volume, camera, frame) : VolumeLookup{});
        }
        shading.shadow_of.resize(scene.lights.size());
    }
    shading.occlusion = plan.ambient_occlusion && volumes != nullptr && (by_surfaces || volumes->openness != nullptr);
    if (shading.occlusion) {
        shading.openness = by_surfaces ? VolumeLookup{} : lookup_of(*volumes->openness, camera, frame);
        shading.occlusion_strength = static_cast<T>(inputs.occlusion_strength);
    }
    shading.by_effects = shading.second_order || shading.analytic_gradient || shading.gradient_opacity ||
                         shading.depth_cue || shading.shadows || shading.occlusion;
}

} // namespace

template <class T>
Shading<T> make_shading(const Scene& scene, const Camera& camera, const Frame& frame, const DrawPlan& plan,
                        const LightVolumes* volumes) {
    const ShadingInputs inputs = make_shading_inputs(scene, camera, frame, plan);
    Shading<T> shading;
    shading.mode = plan.mode;
    shading.perspective = frame.projection == Projection::perspective;
    shading.preintegration = plan.preintegration;
    shading.empty_test = plan.empty_test;
    shading.open_front = plan.open_front;
    shading.correct = plan.opacity_correction;
    shading.exponent = static_cast<T>(inputs.exponent);
    const std::vector<Group> groups = groups_drawn(scene);
    for (std::size_t n = 0; n < groups.size(); ++n) {
        shading.groups.push_back(group_of<T>(groups[n], inputs.groups[n], plan));
        shading.groups.back().colors = colors_of(groups, n);
    }
    const auto is_shown = [](const GroupShading<T>& group) { return group.classified; };
    const auto shown = std::find_if(shading.groups.begin(), shading.groups.end(), is_shown);
    if (shown != shading.groups.end()) {
        shading.shown = static_cast<std::size_t>(shown - shading.groups.begin());
        shading.several_shown = std::count_if(shown, shading.groups.end(), is_shown) > 1;
    }
    const bool surface = shows_surfaces(plan.mode);
    const bool opaque = std::all_of(shading.groups.begin(), shading.groups.end(),
                                    [](const GroupShading<T>& group) { return all_opaque(group.surfaces); });
    shading.several_surfaces =
        surface && (shading.several_shown || shading.groups[shading.shown].surfaces.size() != 1 || !opaque);
    // Of opaque isosurfaces every pixel that has one is opaque.
    shading.stop = surface && opaque ? T(0.5) : static_cast<T>(inputs.opacity_stop);
    shading.scalar_step = number<T>(inputs.scalar_step);
    shading.coverage_step = number<T>(frame.slice_spacing);
    shading.gradient = plan.gradient;
    shading.lit = plan.lit && plan.gradient;
    if (shading.lit) {
        add_lights(inputs, plan, shading);
    }
    shading.gradient_across = inputs.gradient_across;
    shading.gradient_along = inputs.gradient_along;
    shading.gradient_doubt = static_cast<T>(plan.gradient_doubt);

    shading.first_depth = frame.first_depth;
    shading.nearest_depth = frame.depth_of(frame.first_met);
    shading.slice_spacing = frame.slice_spacing;
    shading.axis_x = frame.axis_x - 0.5;
    shading.axis_y = frame.axis_y - 0.5;
    shading.pixel = frame.pixel;
    add_effects(scene, camera, frame, plan, inputs, volumes, shading);
    return shading;
}

template Shading<float> make_shading<float>(const Scene&, const Camera&, const Frame&, const DrawPlan&,
                                            const LightVolumes*);
template Shading<double> make_shading<double>(const Scene&, const Camera&, const Frame&, const DrawPlan&,
                                              const LightVolumes*);

} // namespace sheetsplat::backend_cpu

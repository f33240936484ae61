#include "shading_uniforms.hpp"

#include <algorithm>
#include <string>
#include <vector>

#include "scene/mode_rules.hpp"

namespace sheetsplat::backend_gl {

namespace {

float f(double value) { return static_cast<float>(value); }

void set_places(const gl::Program& program, const TileScope& scope, std::int64_t first_slab) {
    const Frame& frame = scope.frame;
    program.set("axis", f(scope.axis_x()), f(scope.axis_y()));
    program.set("pixel", f(frame.pixel));
    program.set("first_depth", f(frame.depth_of(first_slab)));
    program.set("slice_spacing", f(frame.slice_spacing));
    program.set("first_slab", static_cast<int>(first_slab));
    program.set("nearest_slab", static_cast<int>(frame.first_met - first_slab));
    program.set("last_slab", static_cast<int>(frame.slices - 1));
}

/// Opacities are per reference length: lib/opacity.glsl raises 1 - a to this power, conventions, section 4.
void set_opacity_correction(const gl::Program& program, const ShadingInputs& inputs) {
    program.set("exponent", f(inputs.exponent));
}

void set_depth_cue(const gl::Program& program, const ShadingInputs& inputs, const Frame& frame,
                   std::int64_t first_slab) {
    program.set("cue", f(inputs.cue_color.x), f(inputs.cue_color.y), f(inputs.cue_color.z), f(inputs.cue_strength));
    program.set("cue_share", f((frame.depth_of(first_slab) - inputs.cue_start) * inputs.cue_per_depth),
                f(frame.slice_spacing * inputs.cue_per_depth));
}

/// A uniform of one group, or the element for a group of an array of that name with an s.
std::string name_in(const ShadingInputs& inputs, const std::string& name, std::size_t group) {
    return inputs.groups.size() > 1 ? name + "s[" + std::to_string(group) + "]" : name;
}

void set_least_weights(const gl::Program& program, const ShadingInputs& inputs) {
    for (std::size_t group = 0; group < inputs.groups.size(); ++group) {
        program.set(name_in(inputs, "least_weight", group), f(inputs.groups[group].least_weight));
    }
}

void set_isosurface(const gl::Program& program, const ShadingInputs& inputs, const ShadedParts& parts) {
    std::size_t number = 0;
    for (const ShadingInputs::OfGroup& group : inputs.groups) {
        std::vector<ShadingInputs::Surface> surfaces = group.surfaces;
        // Nothing crosses the values of those that a group has not.
        surfaces.resize(std::max(surfaces.size(), parts.surfaces / inputs.groups.size()), {1e38, Vec3(0.0), 0.0});
        for (const ShadingInputs::Surface& surface : surfaces) {
            const std::string element = parts.surfaces > 0 ? "s[" + std::to_string(number++) + "]" : "";
            program.set("iso_value" + element, f(surface.value));
            program.set("iso_color" + element, f(surface.color.x), f(surface.color.y), f(surface.color.z),
                        f(surface.opacity));
        }
    }
}

/// What groups are for where they are not all shown by themselves.
void set_uses(const gl::Program& program, const Scene& scene, const ShadedParts& parts) {
    const std::vector<Group> groups = groups_drawn(scene);
    const auto set_range = [&](const char* name, std::size_t group, const GroupRange& range) {
        program.set(std::string(name) + "[" + std::to_string(group) + "]", static_cast<int>(range.first),
                    static_cast<int>(range.last));
    };
    for (std::size_t group = 0; group < groups.size() && parts.serving; ++group) {
        program.set("classified[" + std::to_string(group) + "]", is_classified(groups[group]) ? 1 : 0);
        program.set("counted[" + std::to_string(group) + "]", groups[group].use.role != GroupRole::colors ? 1 : 0);
        set_range("colors", group, colors_of(groups, group));
    }
    // (Other scenes may have set those of the same program.)
    std::vector<GroupRange> sets(groups.size());
    for (const GroupRange& set : label_sets(groups)) {
        std::fill(sets.begin() + static_cast<std::ptrdiff_t>(set.first),
                  sets.begin() + static_cast<std::ptrdiff_t>(set.last), set);
    }
    for (std::size_t group = 0; group < groups.size() && parts.labels; ++group) {
        set_range("label_sets", group, sets[group]);
    }
}

void set_lights(const gl::Program& program, const ShadingInputs& inputs) {
    std::vector<float> directions, colors;
    for (const ShadingInputs::EyeLight& light : inputs.lights) {
        directions.insert(directions.end(), {f(light.direction.x), f(light.direction.y), f(light.direction.z)});
        colors.insert(colors.end(), {f(light.color.x), f(light.color.y), f(light.color.z)});
    }
    program.set_array3("light_direction", directions.data(), static_cast<int>(inputs.lights.size()));
    program.set_array3("light_color", colors.data(), static_cast<int>(inputs.lights.size()));
    const Material& material = inputs.material;
    program.set("material", f(material.ambient), f(material.diffuse), f(material.specular), f(material.shininess));
}

void set_gradients(const gl::Program& program, const ShadingInputs& inputs, const DrawPlan& plan) {
    program.set("gradient_scale", f(inputs.gradient_across), f(inputs.gradient_along));
    program.set("gradient_doubt", f(plan.gradient_doubt));
    for (std::size_t group = 0; group < inputs.groups.size(); ++group) {
        program.set(name_in(inputs, "weakest_gradient", group), f(inputs.groups[group].weakest_gradient));
        if (plan.gradient_opacity) {
            program.set(name_in(inputs, "full_gradient", group), f(inputs.groups[group].full_gradient));
        }
    }
}

} // namespace

void set_shading(const gl::Program& program, const TileScope& scope, const ShadingInputs& inputs,
                 const Classification* classification, std::int64_t pass) {
    const DrawPlan& plan = scope.plan;
    const std::int64_t first_slab = scope.steps.first_slab(pass);
    set_places(program, scope, first_slab);
    set_opacity_correction(program, inputs);
    program.set("w0", f(scope.job.scene->fields.front()->w0()));
    scope.set_counting(program, 0);
    program.set("opacity_stop", f(inputs.opacity_stop));
    if (plan.shadows || plan.ambient_occlusion) {
        scope.resources.light().bind(program, *scope.job.camera, scope.frame, first_slab);
        if (shows_surfaces(plan.mode)) {
            scope.resources.light().set_lines(program, *scope.job.scene, *scope.job.camera, scope.frame.slice_spacing,
                                              plan.value_unit);
        }
        if (plan.ambient_occlusion) {
            program.set("occlusion", f(inputs.occlusion_strength));
        }
    }
    if (plan.cut_faces) {
        program.set("face_length", f(inputs.face_length));
    }
    if (plan.depth_cue) {
        set_depth_cue(program, inputs, scope.frame, first_slab);
    }
    if (classification != nullptr) {
        classification->bind(program);
    }
    if (shaded_parts(*scope.job.scene).least_weights) {
        set_least_weights(program, inputs);
    }
    if (is_scalar(plan.mode) && inputs.groups.size() > 1) {
        for (std::size_t group = 0; group < inputs.groups.size(); ++group) {
            program.set(name_in(inputs, "base", group), f(inputs.groups[group].base));
        }
    }
    if (inputs.groups.size() > 1) {
        set_uses(program, *scope.job.scene, shaded_parts(*scope.job.scene));
    }
    if (shows_surfaces(plan.mode)) {
        set_isosurface(program, inputs, shaded_parts(*scope.job.scene));
    }
    if (plan.gradient) {
        set_lights(program, inputs);
        set_gradients(program, inputs, plan);
    }
}

} // namespace sheetsplat::backend_gl

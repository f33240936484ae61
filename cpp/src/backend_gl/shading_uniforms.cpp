#include "shading_uniforms.hpp"

#include <algorithm>
#include <numeric>
#include <vector>

#include <glm/geometric.hpp>

namespace sheetsplat::backend_gl {

namespace {

/// A_stop that float32 would round to 0 must still let an empty pixel go on.
constexpr double smallest_stop = 1.2e-38;
/// Slice distances that a depth cue takes at least.
constexpr double shortest_cue = 1e-6;

float f(double value) { return static_cast<float>(value); }

void set_places(const gl::Program& program, const TileScope& scope, std::int64_t first_slab) {
    const Frame& frame = scope.frame;
    program.set("axis", f(scope.axis_x()), f(scope.axis_y()));
    program.set("pixel", f(frame.pixel));
    program.set("first_depth", f(frame.depth_of(first_slab)));
    program.set("slice_spacing", f(frame.slice_spacing));
    program.set("first_slab", static_cast<int>(first_slab));
    program.set("last_slab", static_cast<int>(frame.slices - 1));
}

/// Opacities are per reference length: lib/opacity.glsl raises 1 - a to this power, IMAGE FORMATION section 4.
void set_opacity_correction(const gl::Program& program, const Frame& frame) {
    // Beyond float32 an opacity above 0 is 1 anyway; infinity times an opacity of 0 would be no number.
    program.set("exponent", f(std::min(frame.slice_spacing / frame.reference_length, 1e30)));
}

void set_depth_cue(const gl::Program& program, const DepthCue& depth_cue, const Frame& frame, std::int64_t first_slab) {
    // A step in all but name stays one; its slope must not leave float32.
    const double length = std::max(depth_cue.end - depth_cue.start, shortest_cue * frame.slice_spacing);
    program.set("cue", f(depth_cue.color.x), f(depth_cue.color.y), f(depth_cue.color.z), f(depth_cue.strength));
    program.set("cue_share", f((frame.depth_of(first_slab) - depth_cue.start) / length),
                f(frame.slice_spacing / length));
}

void set_isosurface(const gl::Program& program, const DrawPlan& plan, const Scene& scene) {
    const TransferPoint at = scene.transfer_function.at(*scene.iso_value);
    const std::vector<double> pivots = pivots_of(plan, scene);
    const double less = std::accumulate(pivots.begin(), pivots.end(), 0.0);
    program.set("iso_value", f((*scene.iso_value - less) / plan.value_unit));
    program.set("iso_color", f(at.color.x), f(at.color.y), f(at.color.z), f(at.opacity));
}

void set_lights(const gl::Program& program, const Scene& scene, const Camera& camera) {
    std::vector<float> directions, colors;
    for (const Light& light : scene.lights) {
        const Vec3 unit = light.direction / glm::length(light.direction);
        const Vec3 eye = light.space == LightSpace::world ? camera.direction_to_eye(unit) : unit;
        directions.insert(directions.end(), {f(eye.x), f(eye.y), f(eye.z)});
        colors.insert(colors.end(), {f(light.color.x), f(light.color.y), f(light.color.z)});
    }
    program.set_array3("light_direction", directions.data(), static_cast<int>(scene.lights.size()));
    program.set_array3("light_color", colors.data(), static_cast<int>(scene.lights.size()));
    const Material& material = scene.material;
    program.set("material", f(material.ambient), f(material.diffuse), f(material.specular), f(material.shininess));
}

/// Gradients are in amounts of rho that sheets call 1, per reference length.
void set_gradients(const gl::Program& program, const DrawPlan& plan, const Scene& scene, const Frame& frame) {
    const double reference = frame.reference_length;
    const TransferFunction& function = scene.transfer_function;
    program.set("gradient_scale", f(0.5 * reference / frame.pixel), f(0.5 * reference / frame.slice_spacing));
    program.set("weakest_gradient", f(1e-3 * (function.v_max() - function.v_min()) / plan.value_unit));
    if (plan.gradient_opacity) {
        program.set("full_gradient", f(*scene.gradient_opacity * reference / plan.value_unit));
    }
}

} // namespace

void set_shading(const gl::Program& program, const TileScope& scope, const Classification* classification,
                 std::int64_t pass) {
    const Scene& scene = *scope.job.scene;
    const Camera& camera = *scope.job.camera;
    const DrawPlan& plan = scope.plan;
    const std::int64_t first_slab = scope.steps.first_slab(pass);
    set_places(program, scope, first_slab);
    set_opacity_correction(program, scope.frame);
    program.set("w0", f(scene.fields.front()->w0()));
    program.set("opacity_stop", f(std::max(scene.opacity_stop, smallest_stop)));
    if (plan.shadows || plan.ambient_occlusion) {
        scope.resources.light().bind(program, camera, scope.frame, first_slab);
        if (plan.ambient_occlusion) {
            program.set("occlusion", f(scene.ambient_occlusion->strength));
        }
    }
    if (plan.depth_cue) {
        set_depth_cue(program, *scene.depth_cue, scope.frame, first_slab);
    }
    if (classification != nullptr) {
        classification->bind(program);
    }
    if (plan.mode == Mode::isosurface) {
        set_isosurface(program, plan, scene);
    }
    if (plan.gradient) {
        set_lights(program, scene, camera);
        set_gradients(program, plan, scene, scope.frame);
    }
}

} // namespace sheetsplat::backend_gl

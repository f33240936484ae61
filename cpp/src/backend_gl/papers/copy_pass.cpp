#include "papers/copy_pass.hpp"

#include "interop.h"

namespace sheetsplat::backend_gl {

namespace {

/// Copies values with their slopes or weights; null for what there is none of.
void copy_planes(const TileScope& scope, const gl::Texture& plane, const gl::Texture* slopes,
                 const gl::Texture* weight) {
    ShaderVariant variant{"rectangle.vert", "copy.frag", {}, {"sheet_copy"}};
    if (weight != nullptr) {
        variant.defines["WEIGHT"] = "1";
        variant.outputs.emplace_back("weight_copy");
    }
    if (slopes != nullptr) {
        variant.defines["FINE"] = "1";
        variant.outputs.insert(variant.outputs.end(), {"x_copy", "y_copy", "z_copy"});
    }
    const gl::Program& program = scope.resources.program(variant);
    program.use();
    program.bind("sheet_front_texture", plane, UNIT_SHEET_FRONT);
    if (weight != nullptr) {
        program.bind("weight_front_texture", *weight, UNIT_WEIGHT_FRONT);
    }
    if (slopes != nullptr) {
        program.bind("x_front_texture", slopes[0], UNIT_SLOPE_X_FRONT);
        program.bind("y_front_texture", slopes[1], UNIT_SLOPE_Y_FRONT);
        program.bind("z_front_texture", slopes[2], UNIT_SLOPE_Z_FRONT);
    }
    scope.draw_targets(program);
}

} // namespace

void copy_finished_slab(const TileScope& scope, std::int64_t pass) {
    const Targets& targets = scope.targets;
    scope.write_channel(scope.channel_of(pass));
    // Copying what is tagged alone would leave an older slab's values elsewhere, and corrupt gradients.
    targets.clear_sheet(1);
    scope.gl.Disable(GL_BLEND);
    scope.gl.DepthMask(GL_FALSE);
    scope.gl.Disable(GL_DEPTH_TEST);
    const Sheet& from = targets.sheet(0);
    const bool slopes = splats_slopes(scope.plan);
    const bool weight = scope.plan.weight;
    targets.bind_copy(false);
    copy_planes(scope, from.value, slopes ? from.slope : nullptr, weight && !slopes ? &from.weight : nullptr);
    if (slopes && weight) {
        targets.bind_copy(true);
        copy_planes(scope, from.weight, targets.shape().weight_slopes ? from.weight_slope : nullptr, nullptr);
    }
    targets.clear_sheet(0);
    scope.write_all_channels();
}

} // namespace sheetsplat::backend_gl

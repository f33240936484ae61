#include "shading_pass.hpp"

#include <numeric>
#include <vector>

#include "interop.h"
#include "shader_variants.hpp"
#include "shading_uniforms.hpp"
#include "view/kept_slices.hpp"

namespace sheetsplat::backend_gl {

namespace {

gl::Texture make_clip(const TileScope& scope) {
    const KeptSlices kept(*scope.job.scene, *scope.job.camera, scope.frame);
    const int width = scope.tile.target_width();
    const int height = scope.tile.target_height();
    std::vector<SliceRun> runs(static_cast<std::size_t>(width) * static_cast<std::size_t>(height));
    auto run = runs.begin();
    for (int y = 0; y < height; ++y) {
        for (int x = 0; x < width; ++x) {
            *run++ = kept.at(scope.tile.x + x - Tile::border, scope.tile.y + y - Tile::border);
        }
    }
    static_assert(sizeof(SliceRun) == 2 * sizeof(GLint), "runs are uploaded as they are");
    gl::Texture texture(scope.gl, GL_RG32I, width, height);
    texture.upload(GL_RG_INTEGER, GL_INT, runs.data());
    return texture;
}

ShadingInputs make_inputs(const TileScope& scope) {
    const Scene& scene = *scope.job.scene;
    const std::vector<double> pivots = pivots_of(scope.plan, scene);
    return make_shading_inputs(scene, *scope.job.camera, scope.frame, scope.plan,
                               std::accumulate(pivots.begin(), pivots.end(), 0.0));
}

} // namespace

ShadingPass::ShadingPass(const TileScope& scope, const Classification* classification)
    : scope_(scope), classification_(classification), inputs_(make_inputs(scope)) {
    if (scope.plan.clip) {
        kept_ = make_clip(scope);
    }
}

void ShadingPass::bind_sheets(const gl::Program& program, std::int64_t pass) const {
    const Targets& targets = scope_.targets;
    const DrawPlan& plan = scope_.plan;
    const bool wide = targets.shape().wide;
    const Sheet& front = targets.sheet(wide ? scope_.sheet_of(pass + 2) : 1);
    const Sheet& back = wide ? targets.sheet(scope_.sheet_of(pass)) : front;
    const auto bind_one = [&](const char* name, const gl::Texture& texture, int unit) {
        texture.bind(unit);
        program.set(name, unit);
    };
    const auto bind = [&](const char* front_name, const char* back_name, const gl::Texture& front_texture,
                          const gl::Texture& back_texture, int front_unit, int back_unit) {
        bind_one(front_name, front_texture, front_unit);
        if (wide) {
            bind_one(back_name, back_texture, back_unit);
        }
    };
    bind("sheet_front_texture", "sheet_back_texture", front.value, back.value, UNIT_SHEET_FRONT, UNIT_SHEET_BACK);
    if (plan.weight) {
        bind("weight_front_texture", "weight_back_texture", front.weight, back.weight, UNIT_WEIGHT_FRONT,
             UNIT_WEIGHT_BACK);
    }
    if (splats_slopes(plan)) {
        bind("x_front_texture", "x_back_texture", front.slope[0], back.slope[0], UNIT_SLOPE_X_FRONT, UNIT_SLOPE_X_BACK);
        bind("y_front_texture", "y_back_texture", front.slope[1], back.slope[1], UNIT_SLOPE_Y_FRONT, UNIT_SLOPE_Y_BACK);
        bind("z_front_texture", "z_back_texture", front.slope[2], back.slope[2], UNIT_SLOPE_Z_FRONT, UNIT_SLOPE_Z_BACK);
    }
    if (plan.fine_gradient && plan.threshold) {
        bind("weight_x_front_texture", "weight_x_back_texture", front.weight_slope[0], back.weight_slope[0],
             UNIT_WEIGHT_X_FRONT, UNIT_WEIGHT_X_BACK);
        bind("weight_y_front_texture", "weight_y_back_texture", front.weight_slope[1], back.weight_slope[1],
             UNIT_WEIGHT_Y_FRONT, UNIT_WEIGHT_Y_BACK);
        bind("weight_z_front_texture", "weight_z_back_texture", front.weight_slope[2], back.weight_slope[2],
             UNIT_WEIGHT_Z_FRONT, UNIT_WEIGHT_Z_BACK);
    }
}

void ShadingPass::shade(const TouchedPixels& touched, std::int64_t pass) const {
    const gl::Api& gl = scope_.gl;
    const DrawPlan& plan = scope_.plan;
    const Targets& targets = scope_.targets;
    scope_.write_all_channels();
    const gl::Program& program = scope_.resources.program(
        {"rectangle.vert", "shade.frag", shade_defines(plan, scope_.job.scene->lights.size(), scope_.channel_of(pass)),
         shade_outputs(plan)});
    program.use();
    bind_sheets(program, pass);
    if (plan.clip) {
        kept_.bind(UNIT_CLIP);
        program.set("clip_texture", UNIT_CLIP);
    }
    set_shading(program, scope_, inputs_, classification_, pass);
    if (plan.read_image) {
        // Each texel is read by the one fragment that writes it: the barrier orders passes, copies stand in where there
        // is none.
        targets.bind_so_far(program);
        if (!targets.shape().copies) {
            if (gl.TextureBarrier != nullptr) {
                gl.TextureBarrier();
            } else {
                gl.TextureBarrierNV();
            }
        }
        gl.Disable(GL_BLEND);
    } else {
        gl.Enable(GL_BLEND);
        gl.BlendFunc(GL_ONE_MINUS_DST_ALPHA, GL_ONE);
    }
    targets.bind_image();
    touched.draw(program);
}

} // namespace sheetsplat::backend_gl

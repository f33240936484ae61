#include "shading_pass.hpp"

#include <algorithm>
#include <optional>
#include <vector>

#include "interop.h"
#include "scene/mode_rules.hpp"
#include "shader_variants.hpp"
#include "shading_uniforms.hpp"
#include "view/cut_faces.hpp"
#include "view/kept_slices.hpp"

namespace sheetsplat::backend_gl {

namespace {

/// visit(column, row) of each pixel of the tile's targets, row by row.
template <class Visit>
void for_each_pixel(const Tile& tile, const Visit& visit) {
    for (int y = 0; y < tile.target_height(); ++y) {
        for (int x = 0; x < tile.target_width(); ++x) {
            visit(tile.x + x - Tile::border, tile.y + y - Tile::border);
        }
    }
}

static_assert(sizeof(SliceRun) == 2 * sizeof(GLint), "runs are uploaded as they are");

gl::Texture make_kept(const TileScope& scope) {
    const KeptSlices kept(*scope.job.scene, scope.plan, *scope.job.camera, scope.frame);
    std::optional<OwnedSlices> owned;
    if (scope.plan.owned) {
        owned.emplace(*scope.job.scene->part, *scope.job.camera, scope.frame);
    }
    std::vector<SliceRun> runs;
    for_each_pixel(scope.tile, [&](int column, int row) {
        runs.push_back(kept.at(column, row));
        runs.push_back(owned ? owned->at(column, row) : SliceRun{});
    });
    gl::Texture texture(scope.gl, GL_RGBA32I, scope.tile.target_width(), scope.tile.target_height());
    texture.upload(GL_RGBA_INTEGER, GL_INT, runs.data());
    return texture;
}

/// Where the fields of each group end.
gl::Texture make_ends(const TileScope& scope) {
    std::vector<SliceRun> runs;
    const std::vector<std::optional<Parallelepiped>>& ends = scope.job.scene->counted->ends;
    for (const std::optional<Parallelepiped>& end : ends) {
        const KeptSlices inside(Clip{{}, end}, scope.plan, *scope.job.camera, scope.frame);
        for_each_pixel(scope.tile, [&](int column, int row) { runs.push_back(inside.at(column, row)); });
    }
    gl::Texture texture(scope.gl, GL_RG32I, scope.tile.target_width(), scope.tile.target_height(),
                        static_cast<int>(ends.size()));
    texture.upload(GL_RG_INTEGER, GL_INT, runs.data());
    return texture;
}

/// Faces of cuts, as lib/faces.glsl has them.
gl::Texture make_faces(const TileScope& scope) {
    const Scene& scene = *scope.job.scene;
    const CutFaces faces(scene, scope.plan, *scope.job.camera, scope.frame);
    const KeptSlices kept(scene, scope.plan, *scope.job.camera, scope.frame);
    const std::size_t groups = groups_drawn(scene).size();
    std::vector<float> texels;
    for (std::size_t group = 0; group < groups; ++group) {
        const bool ends = scene.counted && !scene.counted->ends.empty();
        const KeptSlices inside(Clip{{}, ends ? scene.counted->ends[group] : std::nullopt}, scope.plan,
                                *scope.job.camera, scope.frame);
        for_each_pixel(scope.tile, [&](int column, int row) {
            const CutFace face = faces.at(group, column, row);
            const int first = std::max(kept.at(column, row).first, inside.at(column, row).first);
            // (Any number of slices that no length reaches stands for infinity.)
            const double before = std::min(static_cast<double>(first) - face.slice, 1e30);
            for (const double number : {face.normal.x, face.normal.y, face.normal.z, before}) {
                texels.push_back(static_cast<float>(number));
            }
        });
    }
    gl::Texture texture(scope.gl, GL_RGBA32F, scope.tile.target_width(), scope.tile.target_height(),
                        static_cast<int>(groups));
    texture.upload(GL_RGBA, GL_FLOAT, texels.data());
    return texture;
}

ShadingInputs make_inputs(const TileScope& scope) {
    const Scene& scene = *scope.job.scene;
    return make_shading_inputs(scene, *scope.job.camera, scope.frame, scope.plan, group_pivots(scope.plan, scene));
}

} // namespace

ShadingPass::ShadingPass(const TileScope& scope, const Classification* classification)
    : scope_(scope), classification_(classification), inputs_(make_inputs(scope)) {
    if (scope.plan.cuts() || scope.plan.owned) {
        kept_ = make_kept(scope);
    }
    if (shaded_parts(*scope.job.scene).ends) {
        ends_ = make_ends(scope);
    }
    if (scope.plan.cut_faces) {
        faces_ = make_faces(scope);
    }
}

void ShadingPass::bind_inputs(const gl::Program& program, std::int64_t pass) const {
    const DrawPlan& plan = scope_.plan;
    if (plan.cuts() || plan.owned) {
        program.bind("clip_texture", kept_, UNIT_CLIP);
    }
    if (shaded_parts(*scope_.job.scene).ends) {
        program.bind("end_texture", ends_, UNIT_ENDS);
    }
    if (plan.cut_faces) {
        program.bind("face_texture", faces_, UNIT_FACES);
    }
    set_shading(program, scope_, inputs_, classification_, pass);
}

void ShadingPass::shade(const TouchedPixels& touched, std::int64_t pass) const {
    const gl::Api& gl = scope_.gl;
    const DrawPlan& plan = scope_.plan;
    const Targets& targets = scope_.targets;
    scope_.write_all_channels();
    const ShadedParts parts = shaded_parts(*scope_.job.scene);
    const gl::Program& program = scope_.resources.program(
        {"rectangle.vert", "shade.frag",
         shade_defines(plan, parts, scope_.channel_of(pass), line_counts(plan, *scope_.job.scene)),
         shade_outputs(plan)});
    program.use();
    if (targets.shape().wide) {
        targets.sheet(scope_.sheet_of(pass + 2)).bind(program, "front");
        targets.sheet(scope_.sheet_of(pass)).bind(program, "back");
    } else {
        targets.sheet(1).bind(program, "front");
    }
    bind_inputs(program, pass);
    if (plan.read_image) {
        // Each texel is read by the one fragment that writes it: the barrier orders passes, copies stand in where there
        // is none.
        targets.bind_so_far(program);
        if (!targets.shape().copies) {
            gl.TextureBarrier();
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

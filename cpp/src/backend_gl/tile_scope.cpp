#include "tile_scope.hpp"

#include <algorithm>

#include "interop.h"
#include "scene/mode_rules.hpp"

namespace sheetsplat::backend_gl {

namespace {

/// The picture of a tile, with its border, that holds nothing but the opacity in front of a part.
std::vector<float> in_front(const std::vector<float>& opacities, Size size, const Tile& tile) {
    std::vector<float> rgba(4 * static_cast<std::size_t>(tile.target_width()) *
                            static_cast<std::size_t>(tile.target_height()));
    for (int y = 0; y < tile.height; ++y) {
        for (int x = 0; x < tile.width; ++x) {
            const std::size_t to =
                static_cast<std::size_t>(y + Tile::border) * static_cast<std::size_t>(tile.target_width()) +
                static_cast<std::size_t>(x + Tile::border);
            rgba[4 * to + 3] = opacities[static_cast<std::size_t>(tile.y + y) * static_cast<std::size_t>(size.width) +
                                         static_cast<std::size_t>(tile.x + x)];
        }
    }
    return rgba;
}

TargetShape shape_of(const DrawPlan& plan, const Scene& scene, const Capabilities& capabilities, const Tile& tile) {
    TargetShape shape;
    shape.width = tile.target_width();
    shape.height = tile.target_height();
    shape.sheet_format = plan.precision == Precision::float16 ? GL_RGBA16F
                         : plan.precision == Precision::uint8 ? GL_RGBA8
                                                              : GL_RGBA32F;
    shape.wide = plan.packing == Packing::wide;
    shape.sheets = !plan.compute;
    shape.weight = plan.weight;
    shape.slopes = splats_slopes(plan);
    shape.weight_slopes = plan.threshold;
    shape.shared_depth =
        plan.elimination || plan.tagging == Tagging::depth_bounds || plan.tagging == Tagging::depth_equal;
    shape.depth = plan.depth;
    shape.coverage = plan.coverage;
    shape.compensated = plan.compensated;
    shape.doubts = plan.lit_rounding > 0.0;
    shape.own = 1 + (plan.own_sheets.empty() ? -1 : *std::max_element(plan.own_sheets.begin(), plan.own_sheets.end()));
    shape.groups = static_cast<int>(groups_drawn(scene).size());
    shape.copies = plan.read_image && !capabilities.texture_barrier && !plan.compute;
    return shape;
}

} // namespace

TileScope::TileScope(const Job& job_, const gl::Api& gl_, const Capabilities& capabilities_, Resources& resources_,
                     SliceLoopHooks& hooks_, const Tile& tile_)
    : job(job_), plan(*job_.plan), frame(*job_.frame), gl(gl_), capabilities(capabilities_), resources(resources_),
      hooks(hooks_), tile(tile_), steps(make_steps(*job_.plan, *job_.frame)),
      targets(resources_.targets(shape_of(*job_.plan, *job_.scene, capabilities_, tile_))),
      counting(counting_of(*job_.plan, *job_.scene)) {}

void TileScope::set_target_size(const gl::Program& program) const {
    program.set("target_size", static_cast<float>(tile.target_width()), static_cast<float>(tile.target_height()));
}

void TileScope::draw_rectangles(const std::vector<Rectangle>& rectangles) const {
    if (rectangles.empty()) {
        return;
    }
    resources.rectangles.upload_next(rectangles.data(), rectangles.size() * sizeof(Rectangle));
    resources.rectangle_array.bind();
    resources.rectangles.attribute(ATTRIBUTE_RECTANGLE, 4, GL_FLOAT, sizeof(Rectangle), 0, 1);
    gl.DrawArraysInstanced(GL_TRIANGLE_STRIP, 0, 4, static_cast<GLsizei>(rectangles.size()));
}

void TileScope::draw_targets(const gl::Program& program) const {
    set_target_size(program);
    program.set("tag", untagged_depth);
    draw_rectangles({{0.0F, 0.0F, static_cast<float>(tile.target_width()), static_cast<float>(tile.target_height())}});
}

void TileScope::write_channel(int channel) const {
    gl.ColorMask(channel == 0 ? GL_TRUE : GL_FALSE, channel == 1 ? GL_TRUE : GL_FALSE,
                 channel == 2 ? GL_TRUE : GL_FALSE, channel == 3 ? GL_TRUE : GL_FALSE);
}

void TileScope::write_all_channels() const { gl.ColorMask(GL_TRUE, GL_TRUE, GL_TRUE, GL_TRUE); }

TileScope::Division TileScope::division_of(std::size_t field) const {
    const double unit = plan.unit_of(field);
    const Counting& of_field = counting[field];
    const Field& kernels = *job.scene->fields[field];
    const Group group = groups_drawn(*job.scene)[group_drawn_of(*job.scene, field)];
    // (Of a field that is a group, shading tests its weight: coverage counts all weights.)
    const bool alone = group.last - group.first == 1;
    return {static_cast<float>(kernels.w0()), static_cast<float>(of_field.pivot / unit),
            of_field.half_range > 0.0 ? static_cast<float>(of_field.half_range / unit) : 1.0F,
            alone ? 0.0F : static_cast<float>(kernels.least_weight())};
}

void TileScope::set_counting(const gl::Program& program, std::size_t field) const {
    const Division division = division_of(field);
    program.set("pivot", division.pivot);
    program.set("half_range", division.half_range);
}

void start_picture(const TileScope& scope) {
    scope.targets.clear_all();
    const Scene& scene = *scope.job.scene;
    if (scene.part && scene.part->in_front && !is_scalar(scene.mode)) {
        scope.targets.start_behind(in_front(*scene.part->in_front, scope.frame.size, scope.tile));
    }
}

} // namespace sheetsplat::backend_gl

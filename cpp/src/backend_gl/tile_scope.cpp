#include "tile_scope.hpp"

#include <algorithm>

#include "interop.h"
#include "scene/mode_rules.hpp"

namespace sheetsplat::backend_gl {

namespace {

TargetShape shape_of(const DrawPlan& plan, const Scene& scene, const Capabilities& capabilities, const Tile& tile) {
    TargetShape shape;
    shape.width = tile.target_width();
    shape.height = tile.target_height();
    shape.sheet_format = plan.precision == Precision::float16 ? GL_RGBA16F
                         : plan.precision == Precision::uint8 ? GL_RGBA8
                                                              : GL_RGBA32F;
    shape.wide = plan.packing == Packing::wide;
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
    shape.copies = plan.read_image && !capabilities.texture_barrier;
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

void TileScope::set_counting(const gl::Program& program, std::size_t field) const {
    const double unit = plan.unit_of(field);
    const Counting& of_field = counting[field];
    program.set("pivot", static_cast<float>(of_field.pivot / unit));
    program.set("half_range", of_field.half_range > 0.0 ? static_cast<float>(of_field.half_range / unit) : 1.0F);
}

} // namespace sheetsplat::backend_gl

#include "touched_pixels.hpp"

#include <algorithm>

#include "interop.h"
#include "scene/mode_rules.hpp"

namespace sheetsplat::backend_gl {

namespace {

/// Tags are multiples of tag_step below 1, so that a depth buffer of 24 bits or more tells neighbours apart by far.
constexpr int most_tags = 1 << 18;
constexpr float tag_step = 1.0F / (1 << 20);

} // namespace

TouchedPixels::TouchedPixels(const TileScope& scope)
    : scope_(scope), marks_(scope.tile, scope.steps.history + 1),
      tags_limit_(scope.job.tags_per_clear > 0 ? std::min(scope.job.tags_per_clear, most_tags) : most_tags) {}

float TouchedPixels::tag_of(int batch) {
    // In normalised device coordinates: the window's depth is half of this plus one half, both exact.
    return 1.0F - 2.0F * static_cast<float>(batch + 1) * tag_step;
}

void TouchedPixels::begin_splats() const {
    const gl::Api& gl = scope_.gl;
    gl.Enable(GL_BLEND);
    gl.BlendFunc(GL_ONE, GL_ONE);
    scope_.write_all_channels();
    if (!tags_by_depth() && !scope_.plan.elimination) {
        gl.Disable(GL_DEPTH_TEST);
        return;
    }
    gl.Enable(GL_DEPTH_TEST);
    // Not LESS: the second splat of a batch has the depth that the first one left.
    gl.DepthFunc(GL_LEQUAL);
    gl.DepthMask(tags_by_depth() ? GL_TRUE : GL_FALSE);
}

void TouchedPixels::draw(const gl::Program& program) const {
    const gl::Api& gl = scope_.gl;
    scope_.set_target_size(program);
    program.set("tag", untagged_depth);
    gl.DepthMask(GL_FALSE);
    const int oldest = std::max(tag_ - scope_.steps.history, 0);
    switch (scope_.plan.tagging) {
    case Tagging::depth_bounds: {
        // Half a step of distance on both sides; opaque pixels (0) lie below, untouched ones (1) above.
        const double low = 0.5 * static_cast<double>(tag_of(tag_)) + 0.5 - 0.5 * static_cast<double>(tag_step);
        const double high =
            untagged_ > 0 ? 1.0 : 0.5 * static_cast<double>(tag_of(oldest)) + 0.5 + 0.5 * static_cast<double>(tag_step);
        gl.Disable(GL_DEPTH_TEST);
        gl.Enable(GL_DEPTH_BOUNDS_TEST_EXT);
        gl.DepthBoundsEXT(low, high);
        scope_.draw_rectangles(marks_.whole());
        gl.Disable(GL_DEPTH_BOUNDS_TEST_EXT);
        return;
    }
    case Tagging::depth_equal:
        gl.Enable(GL_DEPTH_TEST);
        gl.DepthFunc(GL_EQUAL);
        for (int tag = oldest; tag <= tag_; ++tag) {
            program.set("tag", tag_of(tag));
            scope_.draw_rectangles(marks_.whole());
        }
        if (untagged_ > 0) {
            program.set("tag", 1.0F);
            scope_.draw_rectangles(marks_.whole());
        }
        return;
    case Tagging::tiles:
    case Tagging::off:
    case Tagging::automatic:
        if (scope_.plan.elimination) {
            gl.Enable(GL_DEPTH_TEST);
            gl.DepthFunc(GL_LEQUAL);
        } else {
            gl.Disable(GL_DEPTH_TEST);
        }
        scope_.draw_rectangles(scope_.plan.tagging == Tagging::tiles ? marks_.touched() : marks_.whole());
        return;
    }
}

void TouchedPixels::eliminate() const {
    const gl::Api& gl = scope_.gl;
    scope_.targets.bind_depth_only();
    const gl::Program& program = scope_.resources.program({"rectangle.vert", "eliminate.frag", {}, {}});
    program.use();
    program.bind("image_texture", scope_.targets.image(), UNIT_IMAGE);
    const bool ends_opaque = shows_surfaces(scope_.plan.mode) && !scope_.plan.stop;
    program.set("opacity_stop", ends_opaque ? 1.0F : static_cast<float>(scope_.job.scene->opacity_stop));
    program.set("last_pixel", scope_.tile.width, scope_.tile.height);
    scope_.set_target_size(program);
    program.set("tag", -1.0F);
    gl.Disable(GL_BLEND);
    gl.Enable(GL_DEPTH_TEST);
    gl.DepthFunc(GL_ALWAYS);
    gl.DepthMask(GL_TRUE);
    scope_.draw_rectangles(scope_.plan.tagging == Tagging::tiles ? marks_.touched() : marks_.whole());
    gl.DepthMask(GL_FALSE);
}

void TouchedPixels::end_batch() {
    if (tags_by_depth() && ++tag_ >= tags_limit_) {
        restart_tags();
    } else if (untagged_ > 0) {
        --untagged_;
    }
}

void TouchedPixels::restart_tags() {
    scope_.targets.clear_tags();
    tag_ = 0;
    // What the last batches touched is forgotten with their tags: until they are through, every pixel counts as
    // touched.
    untagged_ = scope_.steps.history + 1;
    if (scope_.plan.elimination) {
        eliminate();
    }
}

} // namespace sheetsplat::backend_gl

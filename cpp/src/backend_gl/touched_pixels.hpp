// Which pixels the newest batches touched, so that no other pixels are shaded, and which are opaque, so that nothing
// more is splatted there: [NM05] sections 4.3 and 4.4.
#pragma once

#include "tile_scope.hpp"

namespace sheetsplat::backend_gl {

/// By the plan's tagging: depth tags that splats leave in the depth buffer ([NM05]: depth bounds, or equal depth), or
/// marks on squares of pixels. Opaque pixels have depth 0, which lies before every tag.
class TouchedPixels {
  public:
    explicit TouchedPixels(const TileScope& scope);

    /// Sets the depth test and the blending that splats of the newest batch are drawn with.
    void begin_splats() const;
    /// Depth of the newest batch's splats, in normalised device coordinates.
    [[nodiscard]] float splat_depth() const { return tags_by_depth() ? tag_of(tag_) : untagged_depth; }
    /// A splat of the newest batch touches this box.
    void touch(const PixelBox& box) {
        if (scope_.plan.tagging == Tagging::tiles) {
            marks_.touch(box);
        }
    }
    void next_batch() { marks_.next_batch(); }

    /// Draws with the program wherever the newest batches touched the tile. The target is bound.
    void draw(const gl::Program& program) const;
    /// Gives pixels that reached A_stop depth 0.
    void eliminate() const;
    /// The newest batch is shaded: the next one has another tag. Tags that run out start anew.
    void end_batch();

  private:
    [[nodiscard]] bool tags_by_depth() const {
        return scope_.plan.tagging == Tagging::depth_bounds || scope_.plan.tagging == Tagging::depth_equal;
    }
    [[nodiscard]] static float tag_of(int batch);
    void restart_tags();

    const TileScope& scope_;
    TileMarks marks_;
    int tags_limit_;
    int tag_ = 0;      ///< of the newest batch, counted since the tags were cleared
    int untagged_ = 0; ///< passes for which tags are missing, since they were cleared
};

} // namespace sheetsplat::backend_gl

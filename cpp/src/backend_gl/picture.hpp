// One picture: tiles are drawn one after another and read back.
#pragma once

#include <vector>

#include "backend_gl/gl_renderer.hpp"
#include "backend_gl/slice_loop_hooks.hpp"
#include "classification.hpp"
#include "gl/context.hpp"
#include "resources.hpp"
#include "scene/mode_rules.hpp"

namespace sheetsplat::backend_gl {

/// The context is current while it lives.
class Picture {
  public:
    Picture(const Job& job, gl::Context& context, Resources& resources, SliceLoopHooks& hooks, Image& image);
    /// Fills the image and adds to its stats. Throws OutOfMemory, Cancelled, Error.
    void draw();

  private:
    /// Transfer functions are read: of what is composited, and of groups that give others their colours.
    [[nodiscard]] bool classifies() const;
    void upload();
    /// Draws a tile and returns the surfaces that hold it.
    const Targets& draw_tile(const Tile& tile, std::size_t number, std::size_t tiles);
    void read(const Targets& targets, const Tile& tile);
    /// Modes that count slices. Average: sums of rho over the numbers of slices.
    void read_counted(const Targets& targets, const Tile& tile, double scale);
    void read_channels(const Targets& targets, const Tile& tile, int attachment, std::size_t channels, double scale,
                       std::vector<float>& to);
    [[nodiscard]] bool is_scalar() const { return sheetsplat::is_scalar(plan_.mode); }

    const Job& job_;
    const DrawPlan& plan_;
    gl::Context& context_;
    Resources& resources_;
    SliceLoopHooks& hooks_;
    Image& image_;
    Classification classification_; ///< in mode composite
    std::vector<float> buffer_;
    std::size_t drawn_ = 0, dropped_ = 0, shaded_ = 0;
    double vertex_seconds_ = 0.0;
};

} // namespace sheetsplat::backend_gl

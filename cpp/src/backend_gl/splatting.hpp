// What lattices and scattered ellipsoids share when a batch of them is splatted.
#pragma once

#include <algorithm>
#include <functional>
#include <vector>

#include "papers/active_cells.hpp"
#include "papers/opacity_buffer.hpp"
#include "scene/mode_rules.hpp"
#include "tile_scope.hpp"
#include "touched_pixels.hpp"

namespace sheetsplat::backend_gl {

class Splatting {
  public:
    Splatting(const TileScope& scope, TouchedPixels& touched, const OpacityCulling& opacity);

    /// True where a kernel with this box is to be drawn; the box is touched then.
    bool counts(const PixelBox& box);
    [[nodiscard]] bool hides(const PixelBox& box) const { return opacity_.hides(box); }
    /// Marks what the active cells of a part can touch; calls visit(cell, box) for those that can be seen.
    void for_each_active(std::size_t part, const std::function<void(std::size_t, const PixelBox&)>& visit);

    /// Binds the sheets that a field's splats go to.
    void bind_target(const SplatTarget& target, std::int64_t pass) const;
    /// Calls draw(target) for each pass that a field's splats take.
    template <class Draw>
    void for_each_target(std::size_t field, bool narrow, Draw&& draw) const {
        const DrawPlan& plan = scope.plan;
        const int own = plan.own_sheets.empty() ? -1 : plan.own_sheets[field];
        const std::size_t group = group_drawn_of(*scope.job.scene, field);
        draw(SplatTarget{own, plan.weight || own >= 0, narrow, false, group, field});
        if (splats_slopes(plan) && (plan.weight || own >= 0)) {
            draw(SplatTarget{own, true, narrow, true, group, field});
        }
    }
    /// The program for a target, in use, with the uniforms that all splats have.
    const gl::Program& use(const char* vertex, const char* fragment, gl::Defines defines, const SplatTarget& target,
                           const Kernel& kernel, std::int64_t first_slab) const;
    /// Calls draw with a viewport that is larger by `guard` pixels on every side: a point whose centre lies outside the
    /// viewport is not drawn, though its square may reach in.
    template <class Draw>
    void draw_points(const gl::Program& program, int guard, Draw&& draw) const {
        const int width = scope.tile.target_width();
        const int height = scope.tile.target_height();
        scope.gl.Viewport(-guard, -guard, width + 2 * guard, height + 2 * guard);
        scope.gl.Enable(GL_SCISSOR_TEST);
        scope.gl.Scissor(0, 0, width, height);
        scope.gl.Enable(GL_PROGRAM_POINT_SIZE);
        program.set("guard", static_cast<float>(guard), static_cast<float>(guard));
        draw();
        scope.gl.Disable(GL_SCISSOR_TEST);
        scope.gl.Viewport(0, 0, width, height);
    }
    /// Calls draw(first, now) until `count` kernels are drawn, each time for as many as the hooks allow.
    template <class Draw>
    void in_calls(std::size_t count, Draw&& draw) const {
        for (std::size_t first = 0; first < count;) {
            const std::size_t now = std::min(scope.hooks.kernels_a_call(), count - first);
            draw(first, now);
            first += now;
        }
    }
    [[nodiscard]] SlabPass slab_pass(std::int64_t pass) const;

    const TileScope& scope;
    std::size_t drawn = 0;       ///< kernels, counted at every batch that they stand in
    std::size_t dropped = 0;     ///< kernels that the opacity buffer dropped
    double vertex_seconds = 0.0; ///< spent on vertices by the processor

  private:
    void set_offsets(const gl::Program& program, std::int64_t first_slab) const;

    TouchedPixels& touched_;
    const OpacityCulling& opacity_;
    std::vector<ActiveCells> active_;
};

/// By how much sprites and rectangles are larger, in pixels: rasterisers round positions and sizes to 2^-bits.
double sprite_margin(const Capabilities& capabilities);

} // namespace sheetsplat::backend_gl

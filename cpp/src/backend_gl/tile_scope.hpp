// What the stages of the slice loop share while they draw one tile.
#pragma once

#include <cstdint>
#include <vector>

#include "backend_gl/gl_renderer.hpp"
#include "backend_gl/slice_loop_hooks.hpp"
#include "base/capabilities.hpp"
#include "resources.hpp"
#include "shader_variants.hpp"
#include "tile_marks.hpp"

namespace sheetsplat::backend_gl {

struct TileScope {
    /// Makes or takes over the surfaces that the plan needs.
    TileScope(const Job& job, const gl::Api& gl, const Capabilities& capabilities, Resources& resources,
              SliceLoopHooks& hooks, const Tile& tile);

    const Job& job;
    const DrawPlan& plan;
    const Frame& frame;
    const gl::Api& gl;
    const Capabilities& capabilities;
    Resources& resources;
    SliceLoopHooks& hooks;
    const Tile tile;
    const Steps steps;
    const Targets& targets;
    /// Of each field.
    const std::vector<Counting> counting;
    /// Sets what gives rho of a field's D and W in the sheets' unit.
    void set_counting(const gl::Program& program, std::size_t field) const;

    /// What gives rho of a field's D and W: Division of lib/division.glsl.
    struct Division {
        float w0, pivot, half_range, least_weight;
    };
    [[nodiscard]] Division division_of(std::size_t field) const;

    /// Where the optical axis meets the targets, pixels.
    [[nodiscard]] double axis_x() const { return frame.axis_x - tile.x + Tile::border; }
    [[nodiscard]] double axis_y() const { return frame.axis_y - tile.y + Tile::border; }
    /// Packing wide: the sheet of the ring that holds the first slabs of a batch. Packing paper: the splat buffer.
    [[nodiscard]] int sheet_of(std::int64_t pass) const {
        return targets.shape().wide ? static_cast<int>(pass % 3) : 0;
    }
    /// Packing paper: the channel of the newest finished slab.
    [[nodiscard]] int channel_of(std::int64_t pass) const { return static_cast<int>(pass % 4); }
    [[nodiscard]] std::int64_t first_slab_of_batch(std::int64_t pass) const { return pass * steps.stride; }

    void set_target_size(const gl::Program& program) const;
    /// Draws with the program that is in use.
    void draw_rectangles(const std::vector<Rectangle>& rectangles) const;
    /// Draws to all of the targets, the border included, which pixels at the edge find their neighbours in.
    void draw_targets(const gl::Program& program) const;
    /// Lets one channel be written, or all.
    void write_channel(int channel) const;
    void write_all_channels() const;
};

/// Clears sheets and picture, or puts the opacity in front of a part in the picture's place.
void start_picture(const TileScope& scope);

/// Depth of what is drawn where nothing is tagged: behind opaque pixels (0), before a clear buffer (1). In normalised
/// device coordinates.
constexpr float untagged_depth = 0.0F;

} // namespace sheetsplat::backend_gl

// Where an experiment changes how the slice loop draws. The product installs no hooks; cpp/lab does, to compare other
// ways of drawing with the loop's own.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <limits>
#include <memory>

#include "backend_gl/gl_renderer.hpp"
#include "gl/context.hpp"
#include "gl/program.hpp"

namespace sheetsplat::backend_gl {

class OpacityBuffer;
class Resources;
class Splatting;
class Targets;
struct ShaderVariant;

/// Called by the slice loop in the order of the functions below; by default the loop draws as it does without hooks.
/// From begin_picture to end_picture or abandon_picture the context is current.
class SliceLoopHooks {
  public:
    virtual ~SliceLoopHooks() = default;

    /// Changes the plan before kernels are batched. Throws Unsupported.
    virtual void adjust(DrawPlan& /*plan*/, const Scene& /*scene*/) {}
    /// Changes how many slabs a batch covers; layout: the plan's own.
    virtual BatchLayout layout(const BatchLayout& layout) { return layout; }

    virtual void begin_picture(const Job& /*job*/, const gl::Api& /*gl*/, Resources& /*resources*/) {}
    /// The GLSL files that programs are made of.
    virtual const gl::SourceFiles& sources();
    /// Draws a whole tile in place of the slice loop. Returns the surfaces that hold the picture, or null where the
    /// loop is to draw; adds the splats that were drawn to `drawn`.
    virtual const Targets* draw_tile(const Job& /*job*/, const Tile& /*tile*/,
                                     const std::function<void(double)>& /*progress*/, std::size_t& /*drawn*/) {
        return nullptr;
    }
    /// Null: kernels are dropped by the loop's own opacity buffer.
    virtual std::unique_ptr<OpacityBuffer> opacity_buffer(int width, int height, double opacity_stop);
    /// Before the first splat of a batch, and after its last one.
    virtual void before_splats() {}
    virtual void after_splats() {}
    /// Draws a batch of one scattered field in place of the loop; false: the loop is to draw.
    virtual bool splat_ellipsoids(Splatting& /*splatting*/, std::size_t /*part*/, std::int64_t /*pass*/) {
        return false;
    }
    /// Changes the program that splats are drawn with.
    virtual void adjust_splats(ShaderVariant& /*variant*/) {}
    /// The most kernels that are drawn by one call.
    [[nodiscard]] virtual std::size_t kernels_a_call() const { return std::numeric_limits<std::size_t>::max(); }
    /// False: batches are splatted and nothing is shaded.
    [[nodiscard]] virtual bool shades() const { return true; }

    /// True: the compute path counts what its threads do, for the stats sections, samples_read and barriers.
    [[nodiscard]] virtual bool counts_work() const { return false; }

    /// After the last tile; may add stats.
    virtual void end_picture(Image& /*image*/) {}
    /// After an exception; gives back what belongs to the context.
    virtual void abandon_picture() noexcept {}
};

/// Those of this thread.
SliceLoopHooks& slice_loop_hooks();

/// Installs hooks for the pictures that this thread draws while the object lives.
class InstalledHooks {
  public:
    explicit InstalledHooks(SliceLoopHooks& hooks);
    ~InstalledHooks();
    InstalledHooks(const InstalledHooks&) = delete;
    InstalledHooks& operator=(const InstalledHooks&) = delete;

  private:
    SliceLoopHooks* before_;
};

} // namespace sheetsplat::backend_gl

// The slice loop on OpenGL: splat a batch, shade what is finished, composite front to back ([NM05] figure 5).
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <vector>

#include "base/capabilities.hpp"
#include "plan/make_plan.hpp"
#include "sheetsplat/device.hpp"
#include "sheetsplat/image.hpp"
#include "sheetsplat/light_volume.hpp"
#include "sheetsplat/renderer.hpp"
#include "view/cell_walk.hpp"
#include "view/slab_batches.hpp"

namespace sheetsplat::backend_gl {

/// What is settled of a picture before its kernels are batched.
struct Setup {
    DrawPlan plan;
    BatchLayout layout{};
    double largest_sprite = 0.0; ///< radius in pixels up to which spheres are drawn as point sprites; 0: none
};
Setup set_up(const DrawPlan& plan, const Scene& scene, const Capabilities& capabilities);

/// A lattice in the scene.
struct RegularPart {
    std::size_t field = 0; ///< in the scene
    const FieldView* view = nullptr;
    const SlabBatches* batches = nullptr; ///< null where the plan computes tiles
    const VisibleRuns* runs = nullptr;
    std::uint64_t version = 0; ///< another one for other runs
};

/// Scattered ellipsoids in the scene.
struct EllipsoidPart {
    std::size_t field = 0;
    std::shared_ptr<const EllipsoidField> kernels;
    const EllipsoidView* view = nullptr;
    const CellTraversal* traversal = nullptr; ///< null where the plan computes tiles
    const SpatialGrid* grid = nullptr;
    const std::vector<std::uint8_t>* visible = nullptr; ///< a flag a kernel
    std::uint64_t version = 0;                          ///< another one for other flags
};

/// One view, ready to be drawn. Nothing is owned.
struct Job {
    const Scene* scene = nullptr;
    const Camera* camera = nullptr;
    const Frame* frame = nullptr;
    const DrawPlan* plan = nullptr;
    std::vector<RegularPart> regular;
    std::vector<EllipsoidPart> ellipsoids;
    const LightVolumes* volumes = nullptr; ///< where the plan has shadows or ambient occlusion
    BatchLayout layout{};
    int tile_size = 0;      ///< largest edge of an image tile, pixels; 0: what the device can do
    int tags_per_clear = 0; ///< 0: what the depth buffer resolves
    const Progress* progress = nullptr;
    /// Where not null: filled with the doubt of each pixel (lib/doubt.glsl), as far as the plan has lit_rounding.
    std::vector<float>* doubts = nullptr;
};

/// Owns one OpenGL context and what was made in it.
class GlRenderer {
  public:
    /// Throws DeviceUnavailable.
    explicit GlRenderer(std::optional<int> egl_device = std::nullopt);
    ~GlRenderer();
    GlRenderer(const GlRenderer&) = delete;
    GlRenderer& operator=(const GlRenderer&) = delete;

    [[nodiscard]] const Capabilities& capabilities() const;
    /// What plans may know of the device's speed.
    void set_rates(const DeviceRates& rates);
    /// Fills the picture and adds to its stats. Throws OutOfMemory, Cancelled, Error.
    void render(const Job& job, Image& image);

  private:
    struct State;
    std::unique_ptr<State> state_;
};

/// One report a way to a context.
std::vector<DeviceReport> survey();

} // namespace sheetsplat::backend_gl

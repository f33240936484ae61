// The renderer: scene, camera and size -> picture.
#pragma once

#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>

#include "sheetsplat/camera.hpp"
#include "sheetsplat/image.hpp"
#include "sheetsplat/render_plan.hpp"
#include "sheetsplat/scene.hpp"

namespace sheetsplat {

struct RendererOptions {
    Backend backend = Backend::automatic;
    std::optional<int> device{}; ///< EGL device number; else SHEETSPLAT_EGL_DEVICE, else the first that works
    Precision precision = Precision::automatic;
    Tagging tagging = Tagging::automatic;
    Packing packing = Packing::automatic;
    std::map<std::string, bool> effects{}; ///< forces single effects on or off
    bool allow_inexact = false;            ///< lets settings through that cannot keep the error bound
    int tile_size = 0;                     ///< largest edge of an image tile in pixels; 0: what the device can do
    int tags_per_clear = 0; ///< depth tags before the depth buffer is cleared; 0: what its resolution allows
};

/// Called between slices with the share that is done, 0 to 1. Returning false stops the rendering (Cancelled).
using Progress = std::function<bool(double)>;

struct Outputs {
    bool coverage = false; ///< sum of W_n ds s
    bool depth = false;    ///< depth at which opacity first reaches one half
};

/// Keeps a device and the caches between frames. One thread at a time; several renderers may live side by side.
class Renderer {
  public:
    explicit Renderer(const RendererOptions& options = {});
    ~Renderer();
    Renderer(Renderer&&) noexcept;
    Renderer& operator=(Renderer&&) noexcept;

    /// What would run. Throws what render would throw before it draws.
    [[nodiscard]] RenderPlan plan(const Scene& scene, const Camera& camera, Size size, const Outputs& outputs = {});
    /// The picture. Throws InvalidInput, Unsupported, OutOfMemory, DeviceUnavailable, Cancelled.
    [[nodiscard]] Image render(const Scene& scene, const Camera& camera, Size size, const Outputs& outputs = {},
                               const Progress& progress = {});

  private:
    struct State;
    std::unique_ptr<State> state_;
};

} // namespace sheetsplat

// The renderer: scene, camera and size -> picture.
#pragma once

#include <cstddef>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "sheetsplat/camera.hpp"
#include "sheetsplat/image.hpp"
#include "sheetsplat/light_volume.hpp"
#include "sheetsplat/render_plan.hpp"
#include "sheetsplat/scene.hpp"

namespace sheetsplat {

struct LightLines;
struct LightSpot;

struct RendererOptions {
    Backend backend = Backend::automatic;
    std::optional<int> device{}; ///< EGL device number; else SHEETSPLAT_EGL_DEVICE, else the first that works
    Precision precision = Precision::automatic;
    Tagging tagging = Tagging::automatic;
    Packing packing = Packing::automatic;
    Path path = Path::automatic;
    std::map<std::string, bool> effects{}; ///< forces single effects on or off
    bool allow_inexact = false;            ///< lets settings through that cannot keep the error bound
    int tile_size = 0;                     ///< largest edge of an image tile in pixels; 0: what the device can do
    int tags_per_clear = 0; ///< depth tags before the depth buffer is cleared; 0: what its resolution allows
    int threads = 0;        ///< of backend cpu, at most most_threads; 0: as many as the process may run on at once
    /// Root mean square distance from the converged picture (ErrorEstimate::rmse) that pictures may have, at least
    /// least_max_error: the renderer takes the cheapest settings that keep it, in place of those of the scene that are
    /// at their defaults (slice_spacing, sampling, preintegration, opacity_stop). What differs from the default stays.
    std::optional<double> max_error{};
    /// Seconds that a picture may take once the renderer knows the scene: it takes the settings of the smallest error.
    /// Where max_error is given too, a time that does not suffice for it is kept all the same.
    std::optional<double> max_seconds{};
};

/// What float32 pictures resolve.
constexpr double least_max_error = 6e-8;
/// Threads of backend cpu, at most.
constexpr int most_threads = 1024;

struct Outputs {
    bool coverage = false; ///< sum of W_n ds s
    bool depth = false;    ///< depth at which opacity first reaches one half
};

/// Called with each stage of a picture. Returning false ends it there.
using OnStage = std::function<bool(const Image& picture, bool last)>;

/// Keeps a device and the caches between frames. One thread at a time; there may be several renderers.
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

    /// How far a picture of this renderer (or its last stage) is from the converged one, from further pictures of the
    /// same view: at half the slice distance, and where these are causes without a stop and in float64. Takes some four
    /// times as long as the picture. Throws InvalidInput where the picture is a coarse stage, or none of this scene;
    /// else as render.
    [[nodiscard]] ErrorEstimate estimate_error(const Image& image, const Scene& scene, const Camera& camera,
                                               const Progress& progress = {});

    /// The same in stages, as Stages makes them. False where on_stage ended it before the last one.
    bool render_progressive(const Scene& scene, const Camera& camera, Size size, const Outputs& outputs,
                            const OnStage& on_stage, const Progress& progress = {});

    /// Of a whole that is drawn in parts, how its light volumes are made: of a scene of any of its parts, with
    /// Part::supports. Without grids where the picture has neither shadows nor ambient occlusion. Throws as plan.
    [[nodiscard]] LightPlan plan_light(const Scene& part, const Camera& camera, Size size);
    /// What a part holds of the plan's grids. What the pieces of all parts have in common adds up. Throws as render.
    [[nodiscard]] std::vector<LightPiece> light_pieces(const Scene& part, const Camera& camera, Size size,
                                                       const LightPlan& light, const Progress& progress = {});
    /// Light volumes of grids with the pieces of all parts: of each grid its volume (laid_out). Throws OutOfMemory,
    /// Cancelled.
    [[nodiscard]] LightVolumes light_volumes(const LightPlan& light, std::vector<LightVolume> grids,
                                             const Progress& progress = {}) const;
    /// How far light in the picture of a whole is from its definition, in two rounds over all parts, which have
    /// Part::light (light_probe.hpp). What a part shows at some of probe_pixels; then, along lines from spots that
    /// were chosen of those of all parts, what it leaves of light; number: the part of spots (LightSpot::part) that it
    /// shows. Throws as render.
    [[nodiscard]] std::vector<LightSpot> light_spots(const Scene& part, const Camera& camera, Size size,
                                                     const std::vector<std::size_t>& numbers,
                                                     const Progress& progress = {});
    [[nodiscard]] LightLines light_lines(const Scene& part, const Camera& camera, Size size,
                                         const std::vector<LightSpot>& spots, std::size_t number,
                                         const Progress& progress = {});

  private:
    friend class Stages;
    struct State;
    std::unique_ptr<State> state_;
};

/// One picture in stages: coarse ones of fewer pixels and larger slice distances, brought to full size by bilinear
/// interpolation, each at least twice as fine as the one before; the last one is what Renderer::render makes. Of the
/// stats, estimated_rmse is the distance from the last picture (section 8) that follows from how much the last two
/// stages differ, for the last one what its plan expects; stage counts from 1 to stages. The renderer must outlive
/// this, and may draw other pictures in between.
class Stages {
  public:
    /// first_seconds: how long the first stage may take, an aim; where all of the picture is expected to take no
    /// longer, it is the only stage. Throws what Renderer::plan throws; InvalidInput where it is not above 0.
    Stages(Renderer& renderer, const Scene& scene, const Camera& camera, Size size, const Outputs& outputs = {},
           double first_seconds = 0.05);
    ~Stages();
    Stages(Stages&&) noexcept;
    Stages& operator=(Stages&&) noexcept;

    /// True after the last stage.
    [[nodiscard]] bool done() const;
    /// The next stage. Throws what Renderer::render throws; InvalidInput once all are done.
    [[nodiscard]] Image next(const Progress& progress = {});

  private:
    struct State;
    std::unique_ptr<State> state_;
};

} // namespace sheetsplat

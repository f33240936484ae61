// What a renderer keeps between pictures, and the way from a request to a picture: prepare, index, view, draw.
#pragma once

#include <array>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "cost_model.hpp"
#include "draw.hpp"
#include "field_index.hpp"
#include "light_volumes.hpp"
#include "plan/make_plan.hpp"
#include "settings_choice.hpp"
#include "sheetsplat/error.hpp"
#include "sheetsplat/renderer.hpp"
#include "view_facts.hpp"

namespace sheetsplat {

struct Renderer::State {
    explicit State(const RendererOptions& options);
    ~State();
    State(const State&) = delete;
    State& operator=(const State&) = delete;

    /// Frame and plan. Throws what Renderer::plan throws.
    Prepared prepare(const Request& request);
    /// The picture of a request. drawn_like: what decides which kernels are drawn, in place of the request's own frame:
    /// coarse stages draw what the picture that they lead to draws, without another look at all kernels.
    Image render(const Request& request, const Frame* drawn_like = nullptr);

    /// The same with other options.
    Image render_with(const RendererOptions& options, const Request& request, const Frame* drawn_like = nullptr);
    /// With the settings of max_error and max_seconds, where the options have them.
    RenderPlan plan_chosen(const Request& request);
    Image render_chosen(const Request& request);
    /// Null where the options ask for neither. Lives until the next call.
    const Chosen* choose(const Request& request);
    ErrorEstimate estimate_error(const Image& image, const Scene& shown, const Camera& camera,
                                 const Progress& progress);

    /// How many times longer a picture, or a coarse stage of one, took on a backend than expected_seconds said, as last
    /// seen.
    [[nodiscard]] double pace(Backend backend, bool coarse) const {
        return paces_[static_cast<std::size_t>(backend)][coarse ? 1 : 0];
    }
    /// Of backend cpu.
    [[nodiscard]] int threads() const;

  private:
    class Pilots;
    /// What `make` returns while the options are others.
    template <class Make>
    auto with_options(const RendererOptions& options, Make&& make) {
        struct Restored {
            State& state;
            RendererOptions before;
            ~Restored() { state.options_ = std::move(before); }
        };
        const Restored restored{*this, options_};
        options_ = options;
        return make();
    }
    /// The options with a precision that was chosen.
    [[nodiscard]] RendererOptions options_for(const Settings& settings) const;
    /// Backend cpu in float64, with whatever the scene is.
    [[nodiscard]] RendererOptions exact_options() const;
    void note_pace(Backend backend, bool coarse, double pace);
    /// Of pictures, or where none was drawn yet of coarse stages.
    [[nodiscard]] double best_pace(Backend backend) const;

    /// The context, made at the first call; null where there is none and `needed` is false.
    backend_gl::GlRenderer* gl(bool needed);
    /// Backends in the order in which they are tried for a scene.
    std::vector<Backend> candidates();
    /// Why `auto` tries the backend that it tries first.
    [[nodiscard]] std::string why_first() const;
    DrawPlan plan_on(Backend backend, const Request& request, const ViewFacts& view);
    /// The plan of the first backend that supports the scene. Throws Unsupported with the reasons of all.
    DrawPlan choose_plan(const Request& request, const ViewFacts& view);
    Indexed find_drawn(const Request& request, const Prepared& prepared, const Frame& frame);
    void draw(const Request& request, const Prepared& prepared, const Frame& drawn_like, Image& image);
    backend_cpu::CpuRenderer& processor();

    RendererOptions options_;
    std::unique_ptr<backend_gl::GlRenderer> sheets_;
    std::optional<Complaint> why_no_gl_;
    std::unique_ptr<backend_cpu::CpuRenderer> processor_;
    FieldFacts facts_;
    FieldIndex index_;
    LightVolumeCache light_;
    /// Of pictures and coarse stages, in the order of Backend; until one was timed, a guess.
    std::array<std::array<double, 2>, 4> paces_{{{1.0, 1.0}, {4.0, 4.0}, {1.0, 1.0}, {200.0, 200.0}}};
    std::array<std::array<bool, 2>, 4> timed_{};
    std::array<std::array<std::array<double, 3>, 2>, 4> recent_paces_{}; ///< the last three, where any was timed
    std::unique_ptr<Chosen> chosen_;
    Backend chosen_backend_ = Backend::cpu;
};

} // namespace sheetsplat

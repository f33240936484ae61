// What a renderer keeps between pictures, and the way from a request to a picture: prepare, index, view, draw.
#pragma once

#include <array>
#include <memory>
#include <string>
#include <vector>

#include "backends.hpp"
#include "field_index.hpp"
#include "plan/make_plan.hpp"
#include "sheetsplat/renderer.hpp"
#include "view_facts.hpp"
#include "work.hpp"

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

    /// How many times longer a picture, or a coarse stage of one, took on a backend than expected_seconds said, as last
    /// seen.
    [[nodiscard]] double pace(Backend backend, bool coarse) const {
        return paces_[static_cast<std::size_t>(backend)][coarse ? 1 : 0];
    }
    /// Of backend cpu.
    [[nodiscard]] int threads() const;

  private:
    /// The context, made at the first call; null where there is none and `needed` is false.
    sheet::SheetRenderer* gl(bool needed);
    /// Backends in the order in which they are tried for a scene.
    std::vector<Backend> candidates();
    /// Why `auto` tries the backend that it tries first.
    [[nodiscard]] std::string why_first() const;
    DrawPlan plan_on(Backend backend, const Request& request, const ViewFacts& view);
    /// The plan of the first backend that supports the scene. Throws Unsupported with the reasons of all.
    DrawPlan choose_plan(const Request& request, const ViewFacts& view);
    Indexed find_drawn(const Request& request, const Prepared& prepared, const Frame& frame);
    void draw(const Request& request, const Prepared& prepared, const Frame& drawn_like, Image& image);

    RendererOptions options_;
    std::unique_ptr<sheet::SheetRenderer> sheets_;
    std::string why_no_gl_;
    std::unique_ptr<simd::CpuRenderer> processor_;
    FieldFacts facts_;
    FieldIndex index_;
    /// Of pictures and coarse stages, in the order of Backend; until one was timed, a guess.
    std::array<std::array<double, 2>, 4> paces_{{{1.0, 1.0}, {4.0, 4.0}, {1.0, 1.0}, {200.0, 200.0}}};
};

} // namespace sheetsplat

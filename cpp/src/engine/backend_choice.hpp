// Which backend draws a scene, and the devices behind the backends.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "draw.hpp"
#include "facts/view_facts.hpp"
#include "plan/make_plan.hpp"
#include "sheetsplat/error.hpp"

namespace sheetsplat {

/// The backends of one renderer; their devices are opened when they are first needed.
class BackendChoice {
  public:
    /// device: RendererOptions::device.
    explicit BackendChoice(std::optional<int> device);
    ~BackendChoice();
    BackendChoice(const BackendChoice&) = delete;
    BackendChoice& operator=(const BackendChoice&) = delete;

    /// Backends in the order in which they are tried. Throws InvalidInput where SHEETSPLAT_BACKEND names none.
    std::vector<Backend> candidates(Backend asked);
    /// The plan of the first candidate that supports the scene; its device says why it was chosen. Where none does,
    /// that of the reference, unless the options ask for ways of drawing that it has not. Throws Unsupported: of a
    /// backend that was named, with its reason and a backend that draws the scene; else with the reasons of all
    /// candidates.
    DrawPlan choose_plan(const Request& request, const ViewFacts& facts);

    /// Throws DeviceUnavailable.
    backend_gl::GlRenderer& gl();
    backend_cpu::CpuRenderer& cpu();

  private:
    /// Whether OpenGL is there.
    bool open_gl();
    /// Why `auto` tries the backend that it tries first.
    [[nodiscard]] std::string why_first() const;
    /// None where the backend refuses the scene, or is not there.
    std::optional<DrawPlan> try_plan(Backend backend, const Request& request, const ViewFacts& facts);
    /// What a backend refused, with the advice to use another one that draws the scene, where there is one.
    Complaint with_other_backend(Complaint complaint, Backend refused, const Request& request, const ViewFacts& facts);
    DrawPlan plan_on(Backend backend, const Request& request, const ViewFacts& facts);

    std::optional<int> device_;
    std::unique_ptr<backend_gl::GlRenderer> gl_;
    std::optional<Complaint> why_no_gl_; ///< none where it was not tried yet, or is there
    std::unique_ptr<backend_cpu::CpuRenderer> cpu_;
};

/// Threads that backend cpu draws with. asked: RendererOptions::threads.
int thread_count(int asked);
/// What backend cpu draws with, in words: its instruction set and threads.
std::string describe_cpu(int threads);

} // namespace sheetsplat

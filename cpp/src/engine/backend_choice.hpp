// Which backend draws a scene, and the devices behind the backends.
#pragma once

#include <array>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "facts/view_facts.hpp"
#include "painters.hpp"
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

    /// Backends in the order in which they are tried. scattered: the scene has scattered kernels. Throws InvalidInput
    /// where SHEETSPLAT_BACKEND names none.
    std::vector<Backend> candidates(const RendererOptions& options, bool scattered);
    /// The plan of the first candidate that supports the scene; its device says why it was chosen. Where none does,
    /// that of the reference, unless the options ask for ways of drawing that it has not. Throws Unsupported: of a
    /// backend that was named, with its reason and a backend that draws the scene; else with the reasons of all
    /// candidates.
    DrawPlan choose_plan(const Request& request, const ViewFacts& facts);

    /// The device of a backend, open. Throws DeviceUnavailable.
    Painter& painter(Backend backend);
    backend_cpu::CpuRenderer& processor() { return processor_; }

  private:
    struct Place {
        std::unique_ptr<Painter> painter;
        bool open = false;
        std::optional<Complaint> why_not; ///< none where it was not tried yet, or is there
    };
    [[nodiscard]] Place& place(Backend backend) { return places_[index_of(backend)]; }
    /// Whether a backend's device is there.
    bool opens(Backend backend);
    /// Why `auto` tries the backend that it tries first.
    [[nodiscard]] std::string why_first(bool scattered);
    /// None where the backend refuses the scene, or is not there.
    std::optional<DrawPlan> try_plan(Backend backend, const Request& request, const ViewFacts& facts);
    /// What a backend refused, with the advice to use another one that draws the scene, where there is one.
    Complaint with_other_backend(Complaint complaint, Backend refused, const Request& request, const ViewFacts& facts);
    DrawPlan plan_on(Backend backend, const Request& request, const ViewFacts& facts);

    std::optional<int> device_;
    backend_cpu::CpuRenderer processor_;
    std::array<Place, backend_table.size()> places_;
};

} // namespace sheetsplat

#include "backend_choice.hpp"

#include <algorithm>
#include <cstdlib>
#include <utility>

#include "backend_cpu/cpu_renderer.hpp"
#include "backend_gl/gl_renderer.hpp"
#include "base/checks.hpp"
#include "base/instruction_set.hpp"
#include "base/threads.hpp"
#include "sheetsplat/device.hpp"
#include "sheetsplat/error.hpp"

namespace sheetsplat {

namespace {

/// The option, or the environment's choice where it is automatic.
Backend requested_backend(Backend option) {
    if (option != Backend::automatic) {
        return option;
    }
    const char* name = std::getenv("SHEETSPLAT_BACKEND");
    if (name == nullptr || *name == '\0') {
        return option;
    }
    for (const Backend backend : {Backend::automatic, Backend::gl, Backend::cpu, Backend::reference}) {
        if (std::string(name) == to_string(backend)) {
            return backend;
        }
    }
    throw InvalidInput(Complaint{"the backend cannot be chosen", std::string("SHEETSPLAT_BACKEND=") + name,
                                 "auto, gl, cpu or reference", "correct the environment variable, or unset it"});
}

/// What failed and why, without advice.
Words reason_of(const Complaint& complaint) { return Complaint{complaint.what, complaint.found}.words(); }

/// The reference has one way of drawing: it cannot stand in for others that were asked for.
bool asks_for_a_way(const RendererOptions& options) {
    return options.tagging != Tagging::automatic || options.packing == Packing::paper ||
           std::any_of(options.effects.begin(), options.effects.end(),
                       [](const auto& effect) { return effect.second; });
}

} // namespace

int thread_count(int asked) { return asked > 0 ? asked : usable_threads(); }

std::string describe_cpu(int threads) {
    return instruction_set() + ", " + text_of_count(static_cast<std::uint64_t>(threads), "thread");
}

BackendChoice::BackendChoice(std::optional<int> device) : device_(device) {}
BackendChoice::~BackendChoice() = default;

backend_gl::GlRenderer& BackendChoice::gl() {
    if (!gl_) {
        gl_ = std::make_unique<backend_gl::GlRenderer>(device_);
    }
    return *gl_;
}

bool BackendChoice::open_gl() {
    if (!gl_ && !why_no_gl_) {
        try {
            gl();
        } catch (const DeviceUnavailable& error) {
            why_no_gl_ = error.complaint();
        }
    }
    return gl_ != nullptr;
}

backend_cpu::CpuRenderer& BackendChoice::cpu() {
    if (!cpu_) {
        cpu_ = std::make_unique<backend_cpu::CpuRenderer>();
    }
    return *cpu_;
}

std::vector<Backend> BackendChoice::candidates(Backend asked) {
    const Backend backend = requested_backend(asked);
    if (backend != Backend::automatic) {
        return {backend};
    }
    if (!open_gl()) {
        return {Backend::cpu};
    }
    // The processor draws faster by itself than through OpenGL in software; a caller who names a device wants that one.
    const bool hardware = !gl_->capabilities().software || device_.has_value();
    return hardware ? std::vector<Backend>{Backend::gl, Backend::cpu} : std::vector<Backend>{Backend::cpu, Backend::gl};
}

std::string BackendChoice::why_first() const {
    if (!gl_) {
        return "no OpenGL here: " + reason_of(*why_no_gl_).text();
    }
    if (device_.has_value()) {
        return "a device was named";
    }
    return gl_->capabilities().software ? "OpenGL here is software (" + gl_->capabilities().renderer + ")"
                                        : "OpenGL here is hardware";
}

DrawPlan BackendChoice::plan_on(Backend backend, const Request& request, const ViewFacts& facts) {
    const Capabilities* capabilities = backend == Backend::gl ? &gl().capabilities() : nullptr;
    DrawPlan plan = make_plan(request.scene, facts, request.options, request.outputs, request.camera.projection(),
                              backend, capabilities);
    if (backend == Backend::cpu) {
        plan.summary.device = describe_cpu(thread_count(request.options.threads));
    }
    return plan;
}

std::optional<DrawPlan> BackendChoice::try_plan(Backend backend, const Request& request, const ViewFacts& facts) {
    if (backend == Backend::reference && asks_for_a_way(request.options)) {
        return std::nullopt;
    }
    try {
        return backend == Backend::gl && !open_gl() ? std::nullopt : std::optional(plan_on(backend, request, facts));
    } catch (const Unsupported&) {
        return std::nullopt;
    }
}

Complaint BackendChoice::with_other_backend(Complaint complaint, Backend refused, const Request& request,
                                            const ViewFacts& facts) {
    for (const Backend other : {Backend::cpu, Backend::gl, Backend::reference}) {
        if (other != refused && try_plan(other, request, facts)) {
            complaint.advice += (complaint.advice.empty() ? "use " : ", or use ") +
                                option_ref("backend", to_string(other)) + ", which draws it";
            break;
        }
    }
    return complaint;
}

DrawPlan BackendChoice::choose_plan(const Request& request, const ViewFacts& facts) {
    const std::vector<Backend> backends = candidates(request.options.backend);
    if (requested_backend(request.options.backend) != Backend::automatic) {
        try {
            return plan_on(backends.front(), request, facts);
        } catch (const Unsupported& error) {
            // What a device cannot draw within the bound the processor draws, unless its ways were asked for.
            const bool hands_over = backends.front() == Backend::gl && !asks_for_a_way(request.options) &&
                                    request.options.precision == Precision::automatic;
            std::optional<DrawPlan> plan = hands_over ? try_plan(Backend::cpu, request, facts) : std::nullopt;
            if (plan) {
                plan->summary.device += "; for backend gl: " + reason_of(error.complaint()).text();
                return *std::move(plan);
            }
            throw Unsupported(with_other_backend(error.complaint(), backends.front(), request, facts));
        }
    }
    Words reasons, refusals; // short ones for the plan, whole ones for an error
    for (const Backend backend : backends) {
        try {
            DrawPlan plan = plan_on(backend, request, facts);
            plan.summary.device += "; auto: " + (reasons.empty() ? why_first() : reasons.text());
            return plan;
        } catch (const Unsupported& error) {
            const std::string name = (reasons.empty() ? "backend " : "; backend ") + std::string(to_string(backend));
            reasons += name + ": " + reason_of(error.complaint());
            refusals += name + ": " + error.complaint().words();
        }
    }
    // Slow, but right: what others would lose to rounding or have no room for.
    if (std::optional<DrawPlan> plan = try_plan(Backend::reference, request, facts)) {
        plan->summary.device += "; auto: " + reasons.text();
        return *std::move(plan);
    }
    throw Unsupported(Complaint{"no backend can draw this scene within its error bound",
                                refusals + (why_no_gl_ ? "; no OpenGL: " + why_no_gl_->words() : Words())});
}

std::vector<DeviceReport> devices() {
    DeviceReport reference;
    reference.backend = "reference";
    reference.available = true;
    reference.description = "float64 on one thread: defines the picture";
    DeviceReport processor;
    processor.backend = "cpu";
    processor.available = true;
    processor.description = describe_cpu(thread_count(0));
    processor.extensions = instruction_sets();
    std::vector<DeviceReport> reports = backend_gl::survey();
    reports.insert(reports.begin(), {reference, processor});
    return reports;
}

} // namespace sheetsplat

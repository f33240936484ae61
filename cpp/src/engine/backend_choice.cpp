#include "backend_choice.hpp"

#include <algorithm>
#include <cstdlib>
#include <utility>

#include "base/checks.hpp"
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
    std::string wanted = to_string(Backend::automatic);
    if (name == wanted) {
        return Backend::automatic;
    }
    for (const BackendTraits& traits : backend_table) {
        if (std::string(name) == traits.name) {
            return traits.backend;
        }
        wanted += (&traits == &backend_table.back() ? " or " : ", ") + std::string(traits.name);
    }
    throw InvalidInput(Complaint{"the backend cannot be chosen", std::string("SHEETSPLAT_BACKEND=") + name, wanted,
                                 "correct the environment variable, or unset it"});
}

/// What failed and why, without advice.
Words reason_of(const Complaint& complaint) { return Complaint{complaint.what, complaint.found}.words(); }

bool has_scattered(const Scene& scene) {
    return std::any_of(scene.fields.begin(), scene.fields.end(),
                       [](const auto& field) { return as_ellipsoids(field.get()) != nullptr; });
}

/// Whether a device that was measured is slower than the processor, however it draws.
bool beaten_by_processor(const DeviceRates& rates, bool scattered) {
    const auto& seconds = rates.of(scattered);
    return rates.known &&
           seconds[DeviceRates::processor] < std::min(seconds[DeviceRates::raster], seconds[DeviceRates::compute]);
}

/// The reference has one way of drawing: it cannot stand in for others that were asked for.
bool asks_for_a_way(const RendererOptions& options) {
    return options.tagging != Tagging::automatic || options.packing == Packing::paper ||
           options.path != Path::automatic ||
           std::any_of(options.effects.begin(), options.effects.end(),
                       [](const auto& effect) { return effect.second; });
}

} // namespace

BackendChoice::BackendChoice(std::optional<int> device) : device_(device) {}
BackendChoice::~BackendChoice() = default;

Painter& BackendChoice::painter(Backend backend) {
    Place& at = place(backend);
    if (!at.open) {
        at.painter = make_painter(backend, {device_, processor_});
        at.painter->open();
        at.open = true;
    }
    return *at.painter;
}

bool BackendChoice::opens(Backend backend) {
    Place& at = place(backend);
    if (!at.open && !at.why_not) {
        try {
            painter(backend);
        } catch (const DeviceUnavailable& error) {
            at.why_not = error.complaint();
        }
    }
    return at.open;
}

std::vector<Backend> BackendChoice::candidates(const RendererOptions& options, bool scattered) {
    const Backend backend = requested_backend(options.backend);
    if (backend != Backend::automatic) {
        return {backend};
    }
    // The processor draws faster by itself than through a device's software; a caller who names a device wants that
    // one.
    std::vector<Backend> fast, exact, slow;
    for (const BackendTraits& traits : backend_table) {
        if (can(traits.backend, Ability::exact)) {
            exact.push_back(traits.backend);
        } else if (!can(traits.backend, Ability::defines) && opens(traits.backend)) {
            const Capabilities* device = painter(traits.backend).capabilities();
            bool hardware = device == nullptr || !device->software || device_.has_value();
            if (hardware && !device_ && options.path == Path::automatic) {
                painter(traits.backend).measure();
                hardware = device == nullptr || !beaten_by_processor(device->rates, scattered);
            }
            (hardware ? fast : slow).push_back(traits.backend);
        }
    }
    fast.insert(fast.end(), exact.begin(), exact.end());
    fast.insert(fast.end(), slow.begin(), slow.end());
    return fast;
}

std::string BackendChoice::why_first(bool scattered) {
    std::string all;
    for (const BackendTraits& traits : backend_table) {
        if (can(traits.backend, Ability::exact) || can(traits.backend, Ability::defines)) {
            continue;
        }
        const std::string interface = traits.interface;
        std::string why = device_ ? "a device was named" : interface + " here is hardware";
        if (!opens(traits.backend)) {
            why = "no " + interface + " here: " + reason_of(*place(traits.backend).why_not).text();
        } else if (const Capabilities* device = painter(traits.backend).capabilities();
                   !device_ && device != nullptr && device->software) {
            why = interface + " here is software (" + device->renderer + ")";
        } else if (device != nullptr && !device_ && beaten_by_processor(device->rates, scattered)) {
            why = "the processor was faster than " + interface + " (" + device->renderer + ") when both were measured";
        }
        all += (all.empty() ? "" : ", ") + why;
    }
    return all;
}

DrawPlan BackendChoice::plan_on(Backend backend, const Request& request, const ViewFacts& facts) {
    Painter& device = painter(backend);
    if (request.options.path == Path::automatic && can(backend, Ability::ways)) {
        device.measure();
    }
    DrawPlan plan = make_plan(request.scene, facts, request.options, request.outputs, request.camera.projection(),
                              backend, device.capabilities());
    const std::string description = device.description(request.options.threads);
    if (!description.empty()) {
        plan.summary.device = description;
    }
    return plan;
}

std::optional<DrawPlan> BackendChoice::try_plan(Backend backend, const Request& request, const ViewFacts& facts) {
    if (can(backend, Ability::defines) && asks_for_a_way(request.options)) {
        return std::nullopt;
    }
    try {
        return !opens(backend) ? std::nullopt : std::optional(plan_on(backend, request, facts));
    } catch (const Unsupported&) {
        return std::nullopt;
    }
}

Complaint BackendChoice::with_other_backend(Complaint complaint, Backend refused, const Request& request,
                                            const ViewFacts& facts) {
    std::vector<Backend> others{backend_that(Ability::exact)};
    for (const BackendTraits& traits : backend_table) {
        if (traits.backend != others.front()) {
            others.push_back(traits.backend);
        }
    }
    for (const Backend other : others) {
        if (other != refused && try_plan(other, request, facts)) {
            complaint.advice += (complaint.advice.empty() ? "use " : ", or use ") +
                                option_ref("backend", to_string(other)) + ", which draws it";
            break;
        }
    }
    return complaint;
}

DrawPlan BackendChoice::choose_plan(const Request& request, const ViewFacts& facts) {
    const std::vector<Backend> backends = candidates(request.options, has_scattered(request.scene));
    if (requested_backend(request.options.backend) != Backend::automatic) {
        try {
            return plan_on(backends.front(), request, facts);
        } catch (const Unsupported& error) {
            // What a device cannot draw within the bound the exact backend draws, unless its ways were asked for.
            const bool hands_over = !can(backends.front(), Ability::exact) &&
                                    !can(backends.front(), Ability::defines) && !asks_for_a_way(request.options) &&
                                    request.options.precision == Precision::automatic;
            std::optional<DrawPlan> plan =
                hands_over ? try_plan(backend_that(Ability::exact), request, facts) : std::nullopt;
            if (plan) {
                plan->summary.device += std::string("; for backend ") + to_string(backends.front()) + ": " +
                                        reason_of(error.complaint()).text();
                return *std::move(plan);
            }
            throw Unsupported(with_other_backend(error.complaint(), backends.front(), request, facts));
        }
    }
    Words reasons, refusals; // short ones for the plan, whole ones for an error
    for (const Backend backend : backends) {
        try {
            DrawPlan plan = plan_on(backend, request, facts);
            plan.summary.device +=
                "; auto: " + (reasons.empty() ? why_first(has_scattered(request.scene)) : reasons.text());
            return plan;
        } catch (const Unsupported& error) {
            const std::string name = (reasons.empty() ? "backend " : "; backend ") + std::string(to_string(backend));
            reasons += name + ": " + reason_of(error.complaint());
            refusals += name + ": " + error.complaint().words();
        }
    }
    // Slow, but right: what others would lose to rounding or have no room for.
    if (std::optional<DrawPlan> plan = try_plan(backend_that(Ability::defines), request, facts)) {
        plan->summary.device += "; auto: " + reasons.text();
        return *std::move(plan);
    }
    for (const BackendTraits& traits : backend_table) {
        if (const std::optional<Complaint>& why = place(traits.backend).why_not) {
            refusals += std::string("; no ") + traits.interface + ": " + why->words();
        }
    }
    throw Unsupported(Complaint{"no backend can draw this scene within its error bound", refusals});
}

} // namespace sheetsplat

#include "effects.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <sstream>

#include "sheetsplat/error.hpp"

namespace sheetsplat {

namespace {

/// An effect that can be forced, and the backends that have it.
struct Forcible {
    const char* name;
    bool gl, cpu;
};
constexpr std::array<Forcible, 23> forcible = {{{"clip", true, true},
                                                {"analytic_gradient", true, true},
                                                {"gradient_opacity", true, true},
                                                {"depth_cue", true, true},
                                                {"second_order", true, true},
                                                {"shadows", true, true},
                                                {"ambient_occlusion", true, true},
                                                {"weight", true, true},
                                                {"gradient", true, true},
                                                {"specular", true, true},
                                                {"two_sided", true, true},
                                                {"opacity_correction", true, true},
                                                {"opacity_stop", true, true},
                                                {"general_sections", true, true},
                                                {"empty_test", true, true},
                                                {"culling", true, true},
                                                {"elimination", true, false},
                                                {"opacity_buffer", true, false},
                                                {"fine_gradient", true, false},
                                                {"compensation", true, false},
                                                {"resident_sections", true, false},
                                                {"precise_sections", true, false},
                                                {"paper_slicing", true, false}}};

/// An effect that follows from something else, and from what.
struct Stated {
    const char* name;
    const char* decided_by;
};
constexpr std::array<Stated, 23> stated = {{{"classification", "the scene's mode"},
                                            {"isosurface", "the scene's mode"},
                                            {"normalization", "the fields' normalization"},
                                            {"several_fields", "the scene's fields"},
                                            {"separate_normalization", "the fields' normalization"},
                                            {"scattered_kernels", "the scene's fields"},
                                            {"ewa_filter", "the scene's filter"},
                                            {"slab_sampling", "the scene's sampling"},
                                            {"preintegration", "the scene's preintegration"},
                                            {"empty_intervals", "the scene's clip and preintegration"},
                                            {"perspective", "the camera"},
                                            {"ambient_only", "the scene's lights and material"},
                                            {"eye_lights", "the scene's lights"},
                                            {"world_lights", "the scene's lights"},
                                            {"background", "the scene's background"},
                                            {"points", "the camera and the kernels' sizes"},
                                            {"coverage", "outputs="},
                                            {"depth", "outputs="},
                                            {"tagging", "the renderer's tagging"},
                                            {"sums", "the renderer's precision"},
                                            {"float64", "the renderer's precision"},
                                            {"float16", "the renderer's precision"},
                                            {"packing", "the renderer's packing"}}};

std::string names_of(Backend backend) {
    std::string names;
    for (const Forcible& one : forcible) {
        if ((backend == Backend::gl && one.gl) || (backend == Backend::cpu && one.cpu)) {
            names += names.empty() ? one.name : std::string(", ") + one.name;
        }
    }
    return names.empty() ? std::string("none: backend ") + to_string(backend) + " draws what the scene says"
                         : std::string("one of those of backend ") + to_string(backend) + ": " + names;
}

} // namespace

std::string number(double value) {
    std::ostringstream text;
    text.precision(4);
    text << value;
    return text.str();
}

std::string kernels(std::size_t count) { return std::to_string(count) + (count == 1 ? " kernel" : " kernels"); }

Effects::Effects(const std::map<std::string, bool>& forced, Backend backend, std::vector<Effect>& list) : list_(list) {
    for (const auto& [name, on] : forced) {
        const auto same = [&, wanted = name](const auto& one) { return wanted == one.name; };
        if (const auto* found = std::find_if(stated.begin(), stated.end(), same); found != stated.end()) {
            throw InvalidInput(Complaint{
                "the effects cannot be forced", "the effect \"" + name + "\", which follows from " + found->decided_by,
                names_of(backend),
                std::string("change ") + found->decided_by + ", and leave the effect out of " + option_ref("effects"),
                "effects"});
        }
        if (std::none_of(forcible.begin(), forcible.end(), same)) {
            throw InvalidInput(Complaint{"the effects cannot be forced", "the name \"" + name + "\"", names_of(backend),
                                         "correct the name in " + option_ref("effects"), "effects"});
        }
    }
    if (backend != Backend::reference) {
        forced_ = forced;
    }
}

bool Effects::decide(const char* name, bool on, const std::string& reason, bool needed) {
    const auto found = forced_.find(name);
    if (found == forced_.end()) {
        list_.push_back({name, on, reason, false});
        return on;
    }
    if (needed && on && !found->second) {
        dropped_.push_back(name);
    }
    list_.push_back({name, found->second,
                     std::string(found->second ? "forced on" : "forced off") + "; the scene says " +
                         (on ? "on" : "off") + ": " + reason,
                     true});
    return found->second;
}

bool Effects::decide_given(const char* name, bool given, bool on, const std::string& reason) {
    if (given) {
        return decide(name, on, reason, true);
    }
    const auto found = forced_.find(name);
    const bool forced = found != forced_.end();
    list_.push_back(
        {name, false, forced && found->second ? "forced on, with nothing to do: " + reason : reason, forced});
    return false;
}

void charge_effects(RenderPlan& plan) {
    for (Effect& effect : plan.effects) {
        double squares = 0.0;
        for (const ErrorShare& share : plan.error_budget) {
            squares += share.effect == effect.name ? share.rmse * share.rmse : 0.0;
        }
        effect.error = std::sqrt(squares);
    }
}

void Effects::refuse_dropped() const {
    if (dropped_.empty()) {
        return;
    }
    std::string names;
    for (const std::string& name : dropped_) {
        names += names.empty() ? name : ", " + name;
    }
    throw Unsupported(Complaint{"the plan cannot be made", "effects forced off that the scene calls for: " + names,
                                "a picture within its error bound",
                                "leave them to the plan, or pass " + option_ref("allow_inexact", "true"), "effects"});
}

} // namespace sheetsplat

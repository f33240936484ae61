#include "effects.hpp"

#include <algorithm>
#include <cmath>

#include "plan/charge_effects.hpp"
#include "sheetsplat/error.hpp"

namespace sheetsplat {

namespace {

std::string forcible_names(Backend backend) {
    std::string names;
    for (const EffectEntry& entry : effect_table) {
        if (control_of(entry, backend) == Control::forcible) {
            names += names.empty() ? entry.name : std::string(", ") + entry.name;
        }
    }
    return names.empty() ? std::string("none: backend ") + to_string(backend) + " draws what the scene says"
                         : std::string("one of those of backend ") + to_string(backend) + ": " + names;
}

} // namespace

Effects::Effects(const std::map<std::string, bool>& forced, Backend backend, std::vector<Effect>& list)
    : backend_(backend), list_(list) {
    for (const auto& [name, on] : forced) {
        const auto* const entry =
            std::find_if(effect_table.begin(), effect_table.end(),
                         [&, wanted = name](const EffectEntry& one) { return wanted == one.name; });
        if (entry == effect_table.end()) {
            throw InvalidInput(Complaint{"the effects cannot be forced", "the name \"" + name + "\"",
                                         forcible_names(backend), "correct the name in " + option_ref("effects"),
                                         "effects"});
        }
        if (entry->decided_by != nullptr) {
            throw InvalidInput(Complaint{
                "the effects cannot be forced", "the effect \"" + name + "\", which follows from " + entry->decided_by,
                forcible_names(backend),
                std::string("change ") + entry->decided_by + ", and leave the effect out of " + option_ref("effects"),
                "effects"});
        }
        if (can(backend, Ability::defines)) {
            continue;
        }
        if (control_of(*entry, backend) == Control::forcible) {
            forced_.emplace(entry->id, on);
        } else if (on) {
            throw Unsupported(
                Complaint{"the plan cannot be made", "effect " + name + " forced on with backend " + to_string(backend),
                          forcible_names(backend), "leave the effect out of " + option_ref("effects"), "effects"});
        }
    }
}

void Effects::state(EffectId effect, bool on, const std::string& reason) {
    if (known(effect)) {
        list_.push_back({name_of(effect), on, reason, false});
    }
}

bool Effects::decide(EffectId effect, bool on, const std::string& reason, bool needed) {
    if (!known(effect)) {
        return false;
    }
    const auto found = forced_.find(effect);
    if (found == forced_.end()) {
        state(effect, on, reason);
        return on;
    }
    if (needed && on && !found->second) {
        dropped_ += (dropped_.empty() ? "" : ", ") + std::string(name_of(effect));
    }
    list_.push_back({name_of(effect), found->second,
                     std::string(found->second ? "forced on" : "forced off") + "; the scene says " +
                         (on ? "on" : "off") + ": " + reason,
                     true});
    return found->second;
}

bool Effects::decide_given(EffectId effect, bool given, bool on, const std::string& reason) {
    if (given && on && !known(effect)) {
        throw Unsupported(Complaint{"the picture cannot be drawn",
                                    std::string(name_of(effect)) + " with backend " + to_string(backend_),
                                    "an effect that this backend has", "leave out " + option_ref(name_of(effect))});
    }
    if (given || !known(effect)) {
        return decide(effect, on, reason, true);
    }
    const bool forced = forced_.count(effect) != 0;
    list_.push_back({name_of(effect), false,
                     forced_on(effect) ? "forced on, but there is nothing to do: " + reason : reason, forced});
    return false;
}

bool Effects::known(EffectId effect) const { return control_of(entry_of(effect), backend_) != Control::absent; }

bool Effects::forced_on(EffectId effect) const {
    const auto found = forced_.find(effect);
    return found != forced_.end() && found->second;
}

bool Effects::forced_off(EffectId effect) const {
    const auto found = forced_.find(effect);
    return found != forced_.end() && !found->second;
}

void Effects::restate(EffectId effect, bool on, const std::string& reason) {
    const auto listed =
        std::find_if(list_.begin(), list_.end(), [&](const Effect& one) { return one.name == name_of(effect); });
    if (listed != list_.end()) {
        listed->on = on;
        listed->reason = reason;
    }
}

void Effects::refuse_dropped() const {
    if (!dropped_.empty()) {
        throw Unsupported(
            Complaint{"the plan cannot be made", "effects forced off that the scene calls for: " + dropped_,
                      "a picture within its error bound",
                      "leave them to the plan, or pass " + option_ref("allow_inexact", "true"), "effects"});
    }
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

std::vector<EffectInfo> known_effects() {
    std::vector<EffectInfo> all;
    for (const EffectEntry& entry : effect_table) {
        EffectInfo info{entry.name, entry.meaning, entry.decided_by != nullptr ? entry.decided_by : "", {}, {}};
        for (const BackendTraits& traits : backend_table) {
            if (control_of(entry, traits.backend) != Control::absent) {
                info.listed_by.push_back(traits.backend);
            }
            if (control_of(entry, traits.backend) == Control::forcible) {
                info.forcible_on.push_back(traits.backend);
            }
        }
        all.push_back(std::move(info));
    }
    return all;
}

} // namespace sheetsplat

// Effects of one plan: which are on, why, and what the caller forced.
#pragma once

#include <map>
#include <string>
#include <vector>

#include "plan/effect_table.hpp"
#include "sheetsplat/render_plan.hpp"

namespace sheetsplat {

class Effects {
  public:
    /// forced: RendererOptions::effects. Backend reference ignores it: it draws what the scene says. Throws
    /// InvalidInput for names that are not in the table, and for effects that follow from something else; Unsupported
    /// where an effect is forced on that this backend does not have.
    Effects(const std::map<std::string, bool>& forced, Backend backend, std::vector<Effect>& list);

    /// Whether the backend has an effect; what it has not is off, and its plans do not list it.
    [[nodiscard]] bool known(EffectId effect) const;
    /// Adds an effect that can be forced, and returns whether it is on. `needed`: turning it off would make a wrong
    /// picture.
    bool decide(EffectId effect, bool on, const std::string& reason, bool needed = false);
    /// The same where the scene must bring numbers of its own, as a clip its planes: without them (`given` is false)
    /// there is nothing to turn on. Throws Unsupported where it would be on and the backend has no such effect.
    bool decide_given(EffectId effect, bool given, bool on, const std::string& reason);
    /// Adds an effect that follows from something else.
    void state(EffectId effect, bool on, const std::string& reason);
    void state(EffectId effect, bool on, const std::string& why_on, const std::string& why_off) {
        state(effect, on, on ? why_on : why_off);
    }
    /// Says anew what a decision that came later made of an effect that is listed already.
    void restate(EffectId effect, bool on, const std::string& reason);
    [[nodiscard]] bool forced_on(EffectId effect) const;
    [[nodiscard]] bool forced_off(EffectId effect) const;
    /// Throws Unsupported where effects were forced off that the scene needs.
    void refuse_dropped() const;

  private:
    Backend backend_;
    std::map<EffectId, bool> forced_;
    std::vector<Effect>& list_;
    std::string dropped_; ///< names
};

} // namespace sheetsplat

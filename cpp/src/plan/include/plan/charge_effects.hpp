// What each effect of a plan adds to the picture's error.
#pragma once

#include "sheetsplat/render_plan.hpp"

namespace sheetsplat {

/// Puts on each effect its shares of the error budget. Every share names an effect of the list.
void charge_effects(RenderPlan& plan);

} // namespace sheetsplat

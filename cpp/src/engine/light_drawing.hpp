// Drawing onto the grids that light is made from: what a picture's kernels put there, by the processor for all
// backends.
#pragma once

#include "draw.hpp"
#include "light/lit_view.hpp"

namespace sheetsplat {

/// Refers to its arguments. request: of the scene that is drawn.
FillLight fill_light(const Request& request, const Prepared& prepared, const Indexed& indexed,
                     backend_cpu::CpuRenderer& processor);

} // namespace sheetsplat

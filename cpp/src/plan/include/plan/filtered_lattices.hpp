// What the EWA filter makes of lattices.
#pragma once

#include "sheetsplat/renderer.hpp"

namespace sheetsplat {

/// Whether filtered kernels of a lattice are drawn as those of a lattice, and not as scattered ones.
[[nodiscard]] inline bool filtered_lattices_stay(Backend backend) { return backend == Backend::cpu; }

} // namespace sheetsplat

// What a lattice may be made with.
#pragma once

#include "sheetsplat/field.hpp"

namespace sheetsplat {

/// Sums over the kernels that overlap must stay finite in float64.
constexpr double largest_sample = 1e300;

/// Throws InvalidInput for options that no samples can have.
void check_options(const RegularFieldOptions& options);

} // namespace sheetsplat

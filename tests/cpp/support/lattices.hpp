// Lattices of tests.
#pragma once

#include "sheetsplat/field.hpp"

namespace sheetsplat::test {

/// Options of a lattice that falls to 0 beyond its outermost samples ([NM05]): what closed forms of its kernels, and
/// what is below the renderer, which makes mirrored samples of the other boundary, are tested with.
inline RegularFieldOptions zero_boundary() {
    RegularFieldOptions options;
    options.boundary = Boundary::zero;
    return options;
}

} // namespace sheetsplat::test

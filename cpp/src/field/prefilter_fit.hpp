// The equations of the prefilter, and an approximate inverse that is quick to apply.
#pragma once

#include "prefilter_passes.hpp"
#include "sheetsplat/field.hpp"

namespace sheetsplat::prefiltering {

/// Values of an even function at the samples around one, [|k|][|j|][|i|]. Offsets are in indices, on BCC lattices in
/// half the edge a, where they are all even or all odd, and 0 elsewhere.
struct Taps {
    bool bcc = false;
    std::size_t length = 0; ///< along half an axis, the middle included
    std::vector<double> values;
    [[nodiscard]] double at(std::size_t k, std::size_t j, std::size_t i) const {
        return values[(k * length + j) * length + i];
    }
};

/// g at the samples around one.
Taps kernel_taps(Lattice lattice, double radius, double falloff);

/// Smallest and largest value of the taps' spectrum.
std::array<double, 2> spectrum_range(const Taps& taps);

template <class T>
Stencil<T> stencil_of(const Taps& taps);

/// An approximate inverse, and what it leaves to do.
struct Fit {
    Preconditioner preconditioner;
    /// Between these are the eigenvalues of the preconditioned equations.
    double low = 1.0, high = 1.0;
};

/// taps: of a spectrum above 0. mirrored: as in Equations.
Fit fit(const Taps& taps, const Shape& shape, bool mirrored);

} // namespace sheetsplat::prefiltering

// Which samples those beyond the ends of a lattice are images of (boundary `edge`; conventions, section 2).
#pragma once

#include <cstddef>

namespace sheetsplat {

/// Beyond the outermost layer the domain goes on for half a layer distance.
constexpr double domain_in_layers = 0.5;

/// Index of the sample that mirrored sample i is an image of, along an axis of n samples with a mirror in the first and
/// in the last one; a single one is repeated.
inline std::size_t mirrored_index(std::ptrdiff_t i, std::size_t n) {
    const auto last = static_cast<std::ptrdiff_t>(n) - 1;
    std::ptrdiff_t at = i < 0 ? -i : i;
    if (at > 2 * last) {
        // (Seldom: a volume narrower than what reaches beyond it.)
        at = last == 0 ? 0 : at % (2 * last);
    }
    return static_cast<std::size_t>(at <= last ? at : 2 * last - at);
}

/// The same along the first two axes of a BCC lattice, whose mirrors are the first even and the last odd layer: indices
/// there count in half edges, 2 i + (k mod 2), so that the image is in a layer of the same kind, odd or even.
inline std::size_t mirrored_index_bcc(std::ptrdiff_t i, std::size_t n, std::size_t odd) {
    return mirrored_index(2 * i + static_cast<std::ptrdiff_t>(odd), 2 * n) / 2;
}

} // namespace sheetsplat

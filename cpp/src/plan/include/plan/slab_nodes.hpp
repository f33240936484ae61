// How means over slabs are integrated.
#pragma once

#include <algorithm>
#include <cmath>

namespace sheetsplat {

/// sqrt(k) |w| ds / h up to which 4 and 6 Gauss-Legendre nodes integrate a slab to 1e-7. Test:
/// SlabNodes.KeepSevenDigits.
constexpr double four_node_slab = 0.6;
constexpr double six_node_slab = 1.5;

/// Quadrature nodes of a slab so wide; 0: differences of erf.
constexpr int slab_nodes(double widest) { return widest < four_node_slab ? 4 : widest < six_node_slab ? 6 : 0; }

/// Pieces that differences of slab means are integrated in, 6 nodes each; a chord is at most 2 sqrt(k) long.
inline int slab_pieces(double widest) {
    return static_cast<int>(std::clamp(std::ceil(widest / six_node_slab), 1.0, 4.0));
}

} // namespace sheetsplat

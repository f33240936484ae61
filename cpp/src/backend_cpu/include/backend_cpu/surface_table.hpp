// The surfaces of mode isosurface in the order of their values, so that those between two values of rho are found
// without a look at all of them.
#pragma once

#include <cstddef>
#include <vector>

namespace sheetsplat::backend_cpu {

/// A surface of mode isosurface.
template <class T>
struct ShadingSurface {
    T value = T(0); ///< in the sheets' unit
    T color[3] = {};
    T opacity = T(1); ///< above 0
};

/// Surfaces by rank: in the order of their values.
template <class T>
struct SurfaceTable {
    std::vector<T> values, red, green, blue;
    /// Of surfaces of one value, which are crossed at one place, the first one listed is nearest: on a way upwards and
    /// downwards.
    std::vector<T> rising_opacities, falling_opacities;
    /// Of each cell, how many values lie in the cells before it; one more than cells. The cell of a value, put between
    /// first and last, is (value - first) * per_unit, rounded down and not above last_cell.
    std::vector<T> before;
    T first = T(0), last = T(0), per_unit = T(0), last_cell = T(0);
    int halvings = 0; ///< after so many, a search in the cell with most values ends

    [[nodiscard]] std::size_t size() const { return values.size(); }
};

template <class T>
SurfaceTable<T> make_surface_table(std::vector<ShadingSurface<T>> surfaces);

extern template SurfaceTable<float> make_surface_table<float>(std::vector<ShadingSurface<float>>);
extern template SurfaceTable<double> make_surface_table<double>(std::vector<ShadingSurface<double>>);

} // namespace sheetsplat::backend_cpu

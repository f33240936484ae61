#include "backend_cpu/surface_table.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "backend_cpu/measured.hpp"

namespace sheetsplat::backend_cpu {

template <class T>
SurfaceTable<T> make_surface_table(std::vector<ShadingSurface<T>> surfaces) {
    SurfaceTable<T> table;
    if (surfaces.empty()) {
        return table;
    }
    std::stable_sort(surfaces.begin(), surfaces.end(),
                     [](const ShadingSurface<T>& a, const ShadingSurface<T>& b) { return a.value < b.value; });
    for (const ShadingSurface<T>& surface : surfaces) {
        table.values.push_back(surface.value);
        table.rising_opacities.push_back(surface.opacity);
        table.red.push_back(surface.color[0]);
        table.green.push_back(surface.color[1]);
        table.blue.push_back(surface.color[2]);
    }
    table.falling_opacities = table.rising_opacities;
    for (std::size_t first = 0, past = 0; first < table.size(); first = past) {
        while (past < table.size() && table.values[past] == table.values[first]) {
            ++past;
        }
        std::reverse(table.falling_opacities.begin() + static_cast<std::ptrdiff_t>(first),
                     table.falling_opacities.begin() + static_cast<std::ptrdiff_t>(past));
    }
    const std::size_t cells = std::min(most_cells, cells_per_stretch * table.size());
    table.first = table.values.front();
    table.last = table.values.back();
    table.last_cell = static_cast<T>(cells - 1);
    // (Where a difference or its inverse may leave the format, all values share one cell.)
    constexpr T most = std::numeric_limits<T>::max() / T(4), least = T(1e-30);
    if (table.first > -most && table.last < most && table.last - table.first > least) {
        table.per_unit = static_cast<T>(cells) / (table.last - table.first);
    }
    table.before.assign(cells + 1, T(0));
    for (const T value : table.values) {
        // Arithmetic as in values_up_to (groups-inl.hpp).
        const T cell = table.per_unit > T(0)
                           ? std::min(std::floor((value - table.first) * table.per_unit), table.last_cell)
                           : T(0);
        ++table.before[static_cast<std::size_t>(cell) + 1];
    }
    const T crowd = *std::max_element(table.before.begin(), table.before.end());
    while (std::ldexp(T(1), table.halvings) <= crowd) {
        ++table.halvings;
    }
    for (std::size_t cell = 0; cell < cells; ++cell) {
        table.before[cell + 1] += table.before[cell];
    }
    return table;
}

template SurfaceTable<float> make_surface_table<float>(std::vector<ShadingSurface<float>>);
template SurfaceTable<double> make_surface_table<double>(std::vector<ShadingSurface<double>>);

} // namespace sheetsplat::backend_cpu

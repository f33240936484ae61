#include "backend_cpu/sections.hpp"

#include <algorithm>
#include <numeric>

namespace sheetsplat::backend_cpu {

template <class T>
void TileKernels<T>::sort() {
    const std::size_t count = unsorted.size();
    sections.resize(count);
    if (count == 0) {
        return;
    }
    const bool own_extras = unsorted_extras.size() == count, own_shapes = unsorted_shapes.size() == count;
    if (own_extras) {
        extras.resize(count);
    }
    if (own_shapes) {
        shapes.resize(count);
    }
    const auto [least, most] = std::minmax_element(
        unsorted.begin(), unsorted.end(), [](const Section<T>& a, const Section<T>& b) { return a.first < b.first; });
    const std::int32_t first = least->first;
    const std::size_t starts = static_cast<std::size_t>(most->first - first) + 1;
    const auto put = [&](std::size_t to, std::size_t from) {
        sections[to] = unsorted[from];
        if (own_extras) {
            extras[to] = unsorted_extras[from];
        }
        if (own_shapes) {
            shapes[to] = unsorted_shapes[from];
        }
    };
    if (starts > 4 * count + 1024) {
        // Few kernels over very many slices: a count a slice would cost more than comparing.
        places.resize(count);
        std::iota(places.begin(), places.end(), 0U);
        std::stable_sort(places.begin(), places.end(),
                         [&](std::uint32_t a, std::uint32_t b) { return unsorted[a].first < unsorted[b].first; });
        for (std::size_t to = 0; to < count; ++to) {
            put(to, places[to]);
        }
        return;
    }
    places.assign(starts + 1, 0);
    for (const Section<T>& section : unsorted) {
        ++places[static_cast<std::size_t>(section.first - first) + 1];
    }
    for (std::size_t start = 0; start < starts; ++start) {
        places[start + 1] += places[start];
    }
    for (std::size_t from = 0; from < count; ++from) {
        put(places[static_cast<std::size_t>(unsorted[from].first - first)]++, from);
    }
}

template struct TileKernels<float>;
template struct TileKernels<double>;

} // namespace sheetsplat::backend_cpu

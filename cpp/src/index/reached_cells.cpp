#include "index/reached_cells.hpp"

#include <algorithm>
#include <array>
#include <cmath>

namespace sheetsplat {

namespace {

std::array<std::size_t, 3> cells_along(const RegularField& field, std::size_t edge) {
    std::array<std::size_t, 3> cells = field.shape();
    std::transform(cells.begin(), cells.end(), cells.begin(),
                   [edge](std::size_t samples) { return (samples + edge - 1) / edge; });
    return cells;
}

/// Adds to each row of cells those up to `far` rows away along one axis: rows(j, k, away) is what lies so far away.
template <class Row>
void add_rows(const BitRows& from, std::size_t count_j, std::size_t count_k, std::ptrdiff_t far, BitRows& to,
              const Row& row) {
    for (std::size_t k = 0; k < count_k; ++k) {
        for (std::size_t j = 0; j < count_j; ++j) {
            for (std::ptrdiff_t away = -far; away <= far; ++away) {
                if (const BitWord* other = row(from, j, k, away)) {
                    BitWord* own = to.row(j, k);
                    for (std::size_t word = 0; word < from.words(); ++word) {
                        own[word] |= other[word];
                    }
                }
            }
        }
    }
}

} // namespace

ReachedCells::ReachedCells(const RegularField& field, const VisibleRuns& runs, double reach)
    : cells_(cells_along(field, edge)) {
    const std::size_t nj = field.shape()[1];
    const auto far = (static_cast<std::size_t>(std::ceil(reach)) + edge - 1) / edge;
    BitRows marked(cells_along(field, edge)), across(cells_along(field, edge));
    for (std::size_t row = 0; row < runs.rows(); ++row) {
        BitWord* bits = marked.row(row % nj / edge, row / nj / edge);
        for (const Run* run = runs.begin(row); run != runs.end(row); ++run) {
            const std::size_t first = run->begin / edge, last = (run->end - 1) / edge;
            set_bits(bits, first > far ? first - far : 0, std::min(last + far + 1, marked.ni()));
        }
    }
    const auto signed_far = static_cast<std::ptrdiff_t>(far);
    const auto at = [](std::size_t from, std::ptrdiff_t away, std::size_t count) {
        const auto there = static_cast<std::ptrdiff_t>(from) + away;
        return there >= 0 && there < static_cast<std::ptrdiff_t>(count) ? there : -1;
    };
    add_rows(marked, marked.nj(), marked.nk(), signed_far, across,
             [&](const BitRows& from, std::size_t j, std::size_t k, std::ptrdiff_t away) -> const BitWord* {
                 const std::ptrdiff_t there = at(j, away, from.nj());
                 return there < 0 ? nullptr : from.row(static_cast<std::size_t>(there), k);
             });
    add_rows(across, marked.nj(), marked.nk(), signed_far, cells_,
             [&](const BitRows& from, std::size_t j, std::size_t k, std::ptrdiff_t away) -> const BitWord* {
                 const std::ptrdiff_t there = at(k, away, from.nk());
                 return there < 0 ? nullptr : from.row(j, static_cast<std::size_t>(there));
             });
}

} // namespace sheetsplat

#include "view/light_blocks.hpp"

#include <algorithm>
#include <limits>

namespace sheetsplat {

namespace {

constexpr std::size_t edge = 4; ///< of a block, in cells

/// The blocks that an element belongs to: its own, and the one before where it lies on the face between them.
struct Blocks {
    std::size_t first, last;
};
Blocks blocks_of(std::size_t element, std::size_t count) {
    const std::size_t own = std::min(element / edge, count - 1);
    return {element % edge == 0 && element > 0 && own == element / edge ? own - 1 : own, own};
}

} // namespace

LightBlocks::LightBlocks(const LightVolume& volume) {
    std::array<std::size_t, 3> elements{};
    for (std::size_t axis = 0; axis < 3; ++axis) {
        elements[axis] = static_cast<std::size_t>(volume.counts[axis]);
        counts_[axis] = std::max<std::size_t>((elements[axis] - 1 + edge - 1) / edge, 1);
    }
    constexpr float far = std::numeric_limits<float>::infinity();
    ranges_.assign(counts_[0] * counts_[1] * counts_[2], Range{far, -far});
    std::vector<Range> row(counts_[0]);
    const float* values = volume.values.data();
    for (std::size_t w = 0; w < elements[2]; ++w) {
        const Blocks deep = blocks_of(w, counts_[2]);
        for (std::size_t v = 0; v < elements[1]; ++v, values += elements[0]) {
            const Blocks high = blocks_of(v, counts_[1]);
            for (std::size_t block = 0; block < counts_[0]; ++block) {
                const auto [least, greatest] =
                    std::minmax_element(values + block * edge, values + std::min(block * edge + edge + 1, elements[0]));
                row[block] = {*least, *greatest};
            }
            for (std::size_t z = deep.first; z <= deep.last; ++z) {
                for (std::size_t y = high.first; y <= high.last; ++y) {
                    Range* to = ranges_.data() + (z * counts_[1] + y) * counts_[0];
                    for (std::size_t block = 0; block < counts_[0]; ++block) {
                        to[block] = {std::min(to[block].least, row[block].least),
                                     std::max(to[block].greatest, row[block].greatest)};
                    }
                }
            }
        }
    }
}

} // namespace sheetsplat

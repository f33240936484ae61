#include "light/blocks.hpp"

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

/// Joins each of `count` lines of words, `apart` words from one to the next, with the one before and the two behind it:
/// what elements are becomes what cells have around them.
void join_around(std::uint64_t* words, std::size_t length, std::size_t apart, std::size_t count) {
    std::vector<std::uint64_t> before(length, 0), own(length);
    for (std::size_t line = 0; line < count; ++line) {
        std::uint64_t* here = words + line * apart;
        std::copy(here, here + length, own.begin());
        const std::size_t behind = std::min(line + 2, count - 1);
        for (std::size_t next = line + 1; next <= behind; ++next) {
            const std::uint64_t* from = words + next * apart;
            for (std::size_t n = 0; n < length; ++n) {
                here[n] |= from[n];
            }
        }
        for (std::size_t n = 0; n < length; ++n) {
            here[n] |= before[n];
        }
        std::swap(before, own);
    }
}

} // namespace

ClearCells::ClearCells(const LightVolume& volume) {
    const auto columns = static_cast<std::size_t>(volume.counts[0]);
    rows_ = static_cast<std::size_t>(volume.counts[1]);
    words_ = (columns + 63) / 64;
    for (int axis = 0; axis < 3; ++axis) {
        last_[axis] = std::max(volume.counts[static_cast<std::size_t>(axis)] - 2, 0);
    }
    const auto layers = static_cast<std::size_t>(volume.counts[2]);
    const std::size_t layer = words_ * rows_;
    matter_.assign(layer * layers, 0);
    const float* values = volume.values.data();
    for (std::uint64_t* row = matter_.data(); row != matter_.data() + matter_.size(); row += words_) {
        for (std::size_t word = 0; word < words_; ++word) {
            const std::size_t count = std::min<std::size_t>(columns - 64 * word, 64);
            std::uint64_t bits = 0;
            for (std::size_t n = 0; n < count; ++n) {
                bits |= static_cast<std::uint64_t>(values[n] != 0.0F ? 1 : 0) << n;
            }
            row[word] = bits;
            values += count;
        }
        std::uint64_t before = 0;
        for (std::size_t word = 0; word < words_; ++word) {
            const std::uint64_t own = row[word], behind = word + 1 < words_ ? row[word + 1] : 0;
            row[word] = own | own << 1 | before >> 63 | own >> 1 | own >> 2 | behind << 63 | behind << 62;
            before = own;
        }
    }
    for (std::size_t z = 0; z < layers; ++z) {
        join_around(matter_.data() + z * layer, words_, words_, rows_);
    }
    join_around(matter_.data(), layer, layer, layers);
}

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

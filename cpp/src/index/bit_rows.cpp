#include "index/bit_rows.hpp"

#include <algorithm>

#include "base/memory.hpp"

namespace sheetsplat {

namespace {

std::size_t checked_words(const std::array<std::size_t, 3>& shape, std::size_t words_per_row) {
    const std::string what = "the index of drawn samples (one bit for each sample)";
    const std::uint64_t rows = checked_product(shape[0], shape[1], what);
    const std::uint64_t bytes = checked_product(checked_product(rows, words_per_row, what), sizeof(BitWord), what);
    require_memory(bytes, what, "use a smaller or coarser volume, or free memory");
    return static_cast<std::size_t>(bytes / sizeof(BitWord));
}

} // namespace

BitRows::BitRows(const std::array<std::size_t, 3>& shape)
    : shape_(shape), words_(words_for(shape[2])), bits_(checked_words(shape, words_), 0) {}

void set_bits(BitWord* row, std::size_t begin, std::size_t end) {
    if (begin >= end) {
        return;
    }
    const std::size_t first = begin / word_bits;
    const std::size_t last = (end - 1) / word_bits;
    const BitWord from = ~BitWord{0} << (begin % word_bits);
    const BitWord upto = ~BitWord{0} >> (word_bits - 1 - (end - 1) % word_bits);
    if (first == last) {
        row[first] |= from & upto;
        return;
    }
    row[first] |= from;
    std::fill(row + first + 1, row + last, ~BitWord{0});
    row[last] |= upto;
}

} // namespace sheetsplat

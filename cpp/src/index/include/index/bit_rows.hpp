// One bit for each sample (or block of samples) of a volume, row by row, so that 64 of them are decided at a time.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace sheetsplat {

using BitWord = std::uint64_t;
inline constexpr std::size_t word_bits = 64;

/// Words that a row of n bits takes.
[[nodiscard]] inline std::size_t words_for(std::size_t n) { return n / word_bits + (n % word_bits != 0 ? 1 : 0); }

/// nk * nj rows of ni bits, all 0 at first; row (j, k) starts at a whole word. What the bits beyond ni hold means
/// nothing.
class BitRows {
  public:
    /// shape: {nk, nj, ni}. Throws OutOfMemory before anything is allocated.
    explicit BitRows(const std::array<std::size_t, 3>& shape);

    [[nodiscard]] std::size_t ni() const { return shape_[2]; }
    [[nodiscard]] std::size_t nj() const { return shape_[1]; }
    [[nodiscard]] std::size_t nk() const { return shape_[0]; }
    [[nodiscard]] std::size_t words() const { return words_; } ///< in a row
    [[nodiscard]] BitWord* row(std::size_t j, std::size_t k) { return bits_.data() + (k * shape_[1] + j) * words_; }
    [[nodiscard]] const BitWord* row(std::size_t j, std::size_t k) const {
        return bits_.data() + (k * shape_[1] + j) * words_;
    }

  private:
    std::array<std::size_t, 3> shape_;
    std::size_t words_;
    std::vector<BitWord> bits_;
};

/// Position of the lowest bit that is set; word != 0.
[[nodiscard]] inline unsigned lowest_bit(BitWord word) { return static_cast<unsigned>(__builtin_ctzll(word)); }

/// Calls visit(begin, end) for each run of set bits of a row, in order; runs do not touch.
template <typename Visit>
void for_each_run(const BitWord* row, std::size_t words, Visit&& visit) {
    bool open = false;
    std::size_t begin = 0;
    for (std::size_t w = 0; w < words; ++w) {
        const std::size_t base = w * word_bits;
        // Every bit that differs from the one before it starts or ends a run.
        BitWord changes = row[w] ^ ((row[w] << 1) | static_cast<BitWord>(open));
        while (changes != 0) {
            const std::size_t at = base + lowest_bit(changes);
            changes &= changes - 1;
            if (open) {
                visit(begin, at);
            } else {
                begin = at;
            }
            open = !open;
        }
    }
    if (open) {
        visit(begin, words * word_bits);
    }
}

/// Sets the bits begin <= i < end of a row.
void set_bits(BitWord* row, std::size_t begin, std::size_t end);

/// Eight flags, each 0 or 1, as eight bits, the first one lowest.
[[nodiscard]] inline BitWord pack_flags(const std::uint8_t* flags) {
    BitWord bytes = 0;
    for (unsigned b = 0; b < 8; ++b) {
        bytes |= static_cast<BitWord>(flags[b]) << (8 * b);
    }
    // The product moves byte b's lowest bit to bit 56 + b; no two of its terms meet below, so nothing carries.
    return (bytes * 0x0102040810204080ULL) >> 56;
}

/// One bit for each of n values: test(value).
template <typename T, typename Test>
void pack_row(const T* values, std::size_t n, BitWord* row, const Test& test) {
    std::uint8_t flags[word_bits];
    std::size_t i = 0;
    for (; i + word_bits <= n; i += word_bits) {
        for (std::size_t b = 0; b < word_bits; ++b) {
            flags[b] = static_cast<std::uint8_t>(test(values[i + b]));
        }
        BitWord word = 0;
        for (std::size_t group = 0; group < 8; ++group) {
            word |= pack_flags(flags + 8 * group) << (8 * group);
        }
        row[i / word_bits] = word;
    }
    if (i < n) {
        BitWord word = 0;
        for (std::size_t b = 0; i + b < n; ++b) {
            word |= static_cast<BitWord>(test(values[i + b])) << b;
        }
        row[i / word_bits] = word;
    }
}

} // namespace sheetsplat

// Early termination: pixels of a tile that are finished are neither splatted nor shaded.

#if defined(SHEETSPLAT_CPU_LIVE_INL) == defined(HWY_TARGET_TOGGLE)
#ifdef SHEETSPLAT_CPU_LIVE_INL
#undef SHEETSPLAT_CPU_LIVE_INL
#else
#define SHEETSPLAT_CPU_LIVE_INL
#endif

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <vector>

#include "backend_cpu/tile.hpp"
#include "backend_cpu/tile_task.hpp"
#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace sheetsplat::backend_cpu::HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

/// What of a tile's sheets can still be seen.
struct Live {
    static constexpr int blocks = 8;
    static constexpr int block_edge = 8;

    Rect rect;
    /// A bit for each pixel of a row of the sheets that is still read; null: all of them may be.
    const std::uint64_t* rows = nullptr;
    std::uint64_t alive = ~std::uint64_t{0}; ///< blocks of 8 by 8 pixels that hold such a pixel: bit 8 row + column

    explicit Live(const TileShape& shape) : rect{0, 0, shape.width + 2, shape.height + 2} {}

    /// bits: a row of pixels each, kept by the caller.
    void set(const std::vector<std::uint64_t>& bits) {
        rows = bits.data();
        alive = 0;
        for (std::size_t y = 0; y < bits.size(); ++y) {
            std::uint64_t row = bits[y];
            // A byte that holds any bit becomes 1.
            row |= row >> 4;
            row |= row >> 2;
            row |= row >> 1;
            row &= 0x0101010101010101ULL;
            alive |= ((row * 0x0102040810204080ULL) >> 56) << (8 * std::min<std::size_t>(y / block_edge, 7));
        }
    }

    /// Whether some pixel of a box in the sheets is still read. Blocks are looked at first: most boxes are decided by
    /// them.
    [[nodiscard]] HWY_INLINE bool sees(int x0, int y0, int x1, int y1) const {
        if (rows == nullptr) {
            return true;
        }
        const int left = x0 / block_edge, right = (x1 - 1) / block_edge;
        const int top = std::min(y0 / block_edge, 7), bottom = std::min((y1 - 1) / block_edge, 7);
        const std::uint64_t block_columns =
            ((std::uint64_t{2} << right) - (std::uint64_t{1} << left)) * 0x0101010101010101ULL;
        const std::uint64_t block_rows = (~std::uint64_t{0} << (8 * top)) & (~std::uint64_t{0} >> (8 * (7 - bottom)));
        if ((alive & block_columns & block_rows) == 0) {
            return false;
        }
        std::uint64_t any = 0;
        for (int y = y0; y < y1; ++y) {
            any |= rows[y];
        }
        return (any & ((std::uint64_t{2} << (x1 - 1)) - (std::uint64_t{1} << x0))) != 0;
    }
};

/// Counts the pixels that end between slices `before` and n, since nothing behind slice n is in front of the depth
/// limit.
template <class T>
void end_at_limit(T stop_at, const TileShape& shape, TilePicture<T>& picture, std::int64_t before, std::int64_t n) {
    const hn::CappedTag<T, TileShape::padding> d;
    const int lanes = static_cast<int>(hn::Lanes(d));
    const auto past = hn::Set(d, static_cast<T>(before)), here = hn::Set(d, static_cast<T>(n));
    const auto stop = hn::Set(d, stop_at);
    for (int y = 0; y < shape.height; ++y) {
        if (picture.row_alive[y] == 0) {
            continue;
        }
        const std::ptrdiff_t row = static_cast<std::ptrdiff_t>(y) * shape.stride;
        int ended = 0;
        for (int x = 0; x < shape.width; x += lanes) {
            const auto last = hn::LoadU(d, picture.last_kept + row + x);
            auto ends = hn::And(hn::Gt(last, past), hn::Le(last, here));
            if (hn::AllFalse(d, ends)) {
                continue;
            }
            if (picture.alpha != nullptr) {
                ends = hn::And(ends, hn::Lt(hn::LoadU(d, picture.alpha + row + x), stop));
            }
            if (shape.width - x < lanes) {
                ends = hn::And(ends, hn::FirstN(d, static_cast<std::size_t>(shape.width - x)));
            }
            ended += static_cast<int>(hn::CountTrue(d, ends));
        }
        picture.row_alive[y] -= ended;
        picture.alive -= ended;
    }
}

/// Updates what of the sheets unfinished pixels still read, for themselves or for gradients. n: the slice that is done.
template <class T>
void shrink(Live& live, T stop_at, const TileShape& shape, TileScratch<T>& scratch, std::int64_t n,
            bool look_at_pixels) {
    const int* rows = scratch.planes.row_alive;
    int first = 0, past = shape.height;
    while (first < past && rows[first] == 0) {
        ++first;
    }
    while (past > first && rows[past - 1] == 0) {
        --past;
    }
    live.rect.y0 = first;
    live.rect.y1 = past + 2;
    if (shape.width + 2 > Live::blocks * Live::block_edge || !look_at_pixels) {
        return;
    }
    // One bit a pixel that is alive, with its neighbours; then one a block.
    const hn::CappedTag<T, 16> d;
    const int lanes = static_cast<int>(hn::Lanes(d));
    const auto stop = hn::Set(d, stop_at), here = hn::Set(d, static_cast<T>(n));
    const T* last_kept = scratch.planes.last_kept;
    std::vector<std::uint64_t>& bits = scratch.alive_rows;
    bits.assign(static_cast<std::size_t>(shape.height) + 2, 0);
    const std::uint64_t inside = (std::uint64_t{1} << shape.width) - 1;
    for (int y = first; y < past; ++y) {
        if (rows[y] == 0) {
            continue;
        }
        std::uint64_t row = 0;
        for (int x = 0; x < shape.width; x += lanes) {
            const std::ptrdiff_t at = static_cast<std::ptrdiff_t>(y) * shape.stride + x;
            auto alive = scratch.planes.alpha != nullptr ? hn::Lt(hn::LoadU(d, scratch.planes.alpha + at), stop)
                                                         : hn::FirstN(d, static_cast<std::size_t>(lanes));
            if (last_kept != nullptr) {
                alive = hn::And(alive, hn::Gt(hn::LoadU(d, last_kept + at), here));
            }
            std::uint8_t packed[8] = {};
            hn::StoreMaskBits(d, alive, packed);
            std::uint64_t word = 0;
            std::memcpy(&word, packed, sizeof word);
            row |= word << x;
        }
        row &= inside;
        // Pixel x of the picture is column x + 1 of the sheets.
        const std::uint64_t spread = row | row << 1 | row << 2;
        for (int around = 0; around < 3; ++around) {
            bits[static_cast<std::size_t>(y + around)] |= spread;
        }
    }
    live.set(bits);
}

} // namespace sheetsplat::backend_cpu::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif // SHEETSPLAT_CPU_LIVE_INL

// Sets of labels that share all samples of a lattice, of which one label has no colour and most of the samples: what
// the others leave of the sum of all kernels is its own, which is not splatted. Source: conventions, section 4
// (labels).

#if defined(SHEETSPLAT_CPU_LABEL_RESTS_INL) == defined(HWY_TARGET_TOGGLE)
#ifdef SHEETSPLAT_CPU_LABEL_RESTS_INL
#undef SHEETSPLAT_CPU_LABEL_RESTS_INL
#else
#define SHEETSPLAT_CPU_LABEL_RESTS_INL
#endif

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <limits>
#include <vector>

#include "backend_cpu/tile_task.hpp"
#include "hwy/highway.h"
#include "live-inl.hpp"
#include "resolve-inl.hpp"
#include "sheet_ring-inl.hpp"
#include "whole_sums-inl.hpp"

HWY_BEFORE_NAMESPACE();
namespace sheetsplat::backend_cpu::HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

/// Compares the labels of one set on the slices of a tile, in blocks of eight pixels of a row: where labels have
/// weights, and around those places as far as gradients and intervals read.
template <class T>
class LabelRests {
  public:
    /// set: with LabelSet::whole.
    LabelRests(const LoopSetup<T>& setup, std::size_t set, SheetRing<T>& ring, const TileShape& shape)
        : setup_(setup), number_(set), set_(setup.label_sets[set]), ring_(ring), shape_(shape),
          blocks_((shape.width + 2 + block - 1) / block), rows_(shape.height + 2), around_(setup.intervals ? 2 : 1) {
        for (Slice& slice : slices_) {
            slice.wanted.assign(static_cast<std::size_t>(rows_), 0);
            slice.done = slice.wanted;
        }
    }

    /// Of slice n, to which all kernels have been added, and of those before it, what labels are above the largest
    /// other one, in place of their weights. Where a label has no weight it is below 0.
    void compare(std::int64_t n, const Live& live) {
        if (n >= setup_.slices) {
            return;
        }
        Slice& here = slices_[index_of(n)];
        here.begin(n);
        find_weights(here);
        Rect rect;
        for (std::int64_t near = std::max<std::int64_t>(n - around_, 0); near <= n; ++near) {
            const Slice& slice = slices_[index_of(near)];
            if (slice.number == near) {
                rect.add(slice.blocks);
            }
        }
        write(here, rect, live, n - around_);
        for (std::int64_t before = n - 1; before >= std::max<std::int64_t>(n - around_, 0); --before) {
            Slice& slice = slices_[index_of(before)];
            if (slice.number != before) {
                slice.begin(before);
            }
            write(slice, here.blocks, live, n);
        }
    }
    /// To be called where the ring has released all slices.
    void forget() {
        for (Slice& slice : slices_) {
            slice.number = -1;
        }
    }

  private:
    static constexpr int block = 8;
    using D = hn::CappedTag<T, block>;
    using V = hn::Vec<D>;
    static constexpr int lanes = static_cast<int>(hn::MaxLanes(D()));
    static_assert(largest_tile + 2 <= 32 * block, "a bit for each block of a row");

    struct Slice {
        std::int64_t number = -1;          ///< -1: none
        Rect blocks;                       ///< in blocks and rows: of `wanted`
        std::vector<std::uint32_t> wanted; ///< a bit for each block of a row with weights, or next to one
        std::vector<std::uint32_t> done;   ///< those that have been written

        void begin(std::int64_t n) {
            number = n;
            blocks = Rect();
            std::fill(wanted.begin(), wanted.end(), 0);
            std::fill(done.begin(), done.end(), 0);
        }
    };

    [[nodiscard]] static std::size_t index_of(std::int64_t n) { return static_cast<std::size_t>(n) % kept; }

    /// Looks for blocks where labels have weights.
    void find_weights(Slice& slice) {
        Rect touched;
        find_sheets(slice.number, touched);
        if (touched.empty()) {
            return;
        }
        const D d;
        const int first = touched.x0 / block, past = std::min((touched.x1 + block - 1) / block, blocks_);
        for (int y = touched.y0; y < touched.y1; ++y) {
            std::uint32_t bits = 0;
            for (int at = first; at < past; ++at) {
                const std::uint64_t pixels = weighted(y * shape_.stride + at * block);
                bits |= pixels != 0 ? 1U << at : 0U;
                bits |= (pixels & 1U) != 0 && at > 0 ? 1U << (at - 1) : 0U;
                bits |= (pixels >> (block - 1) & 1U) != 0 && at + 1 < blocks_ ? 1U << (at + 1) : 0U;
            }
            if (bits == 0) {
                continue;
            }
            const int top = std::max(y - 1, 0), bottom = std::min(y + 2, rows_);
            for (int row = top; row < bottom; ++row) {
                slice.wanted[static_cast<std::size_t>(row)] |= bits;
            }
            slice.blocks.add({std::max(first - 1, 0), top, std::min(past + 1, blocks_), bottom});
        }
    }
    /// A bit for each pixel of a block where a label has a weight.
    [[nodiscard]] HWY_INLINE std::uint64_t weighted(std::ptrdiff_t at) const {
        const D d;
        std::uint64_t pixels = 0;
        for (int x = 0; x < block; x += lanes) {
            V largest = hn::Zero(d);
            for (const T* sheet : sheets_) {
                largest = hn::Max(largest, hn::LoadU(d, sheet + at + x));
            }
            std::uint8_t packed[8] = {};
            hn::StoreMaskBits(d, hn::Gt(largest, hn::Zero(d)), packed);
            std::uint64_t word = 0;
            std::memcpy(&word, packed, sizeof word);
            pixels |= word << x;
        }
        return pixels;
    }

    /// The sheets of a slice that kernels have been added to, and where.
    void find_sheets(std::int64_t n, Rect& touched) {
        sheets_.clear();
        for (std::size_t group = set_.groups.first; group < set_.groups.last; ++group) {
            const Rect own = ring_.touched(n, group);
            if (!own.empty()) {
                sheets_.push_back(ring_.plane(n, setup_.groups[group].rho_channel));
                touched.add(own);
            }
        }
    }

    /// Writes what has not been written of the blocks that slices `other` ... slice.number (or the other way round) ask
    /// for.
    void write(Slice& slice, const Rect& blocks, const Live& live, std::int64_t other) {
        const std::int64_t n = slice.number, low = std::max<std::int64_t>(std::min(n, other), 0);
        const std::int64_t high = std::max(n, other);
        Rect touched, written;
        bool begun = false;
        for (int y = std::max(blocks.y0, live.rect.y0); y < std::min(blocks.y1, live.rect.y1); ++y) {
            const auto row = static_cast<std::size_t>(y);
            std::uint32_t bits = 0;
            for (std::int64_t near = low; near <= high; ++near) {
                const Slice& asking = slices_[index_of(near)];
                bits |= asking.number == near ? asking.wanted[row] : 0U;
            }
            bits &= ~slice.done[row] & alive(live, y);
            if (bits == 0) {
                continue;
            }
            slice.done[row] |= bits;
            if (!begun) {
                find_sheets(n, touched);
                begun = true;
            }
            written.add({blocks.x0 * block, y, blocks.x1 * block, y + 1});
            write_row(n, y, bits);
        }
        if (!begun) {
            return;
        }
        ring_.open(n);
        for (std::size_t group = set_.groups.first; group < set_.groups.last; ++group) {
            if (!ring_.touched(n, group).empty()) {
                ring_.write(n, written, group);
            }
        }
        ring_.write_set(n, written, number_);
    }
    /// The blocks of a row where anything can still be seen.
    [[nodiscard]] std::uint32_t alive(const Live& live, int y) const {
        std::uint32_t bits = ~0U;
        for (int at = 0; at < blocks_ && live.rows != nullptr; ++at) {
            bits &= (live.rows[y] >> (at * block) & 0xFFU) != 0 ? ~0U : ~(1U << at);
        }
        return bits;
    }

    HWY_NOINLINE void write_row(std::int64_t n, int y, std::uint32_t bits) {
        const D d;
        const WholeSums<D> sums(*set_.whole, shape_, n);
        const V zero = hn::Zero(d);
        const V rounding = hn::Set(d, T(8) * std::numeric_limits<T>::epsilon());
        T* const of_absent = ring_.plane(n, set_.absent_channel);
        for (int number = 0; number < blocks_; ++number) {
            if ((bits >> number & 1U) == 0) {
                continue;
            }
            const bool near = sums.are_near(number * block, y, block);
            for (int x = number * block; x < (number + 1) * block; x += lanes) {
                const std::ptrdiff_t at = static_cast<std::ptrdiff_t>(y) * shape_.stride + x;
                LargestLabels<D> found(d);
                V all = zero;
                for (const T* sheet : sheets_) {
                    const V own = hn::LoadU(d, sheet + at);
                    found.template look_at<false>(d, own, T(0));
                    all = hn::Add(all, own);
                }
                if (near) {
                    // (What rounding leaves of a difference of sums that are the same is none.)
                    const V whole = sums.at(x, y), rest = hn::Sub(whole, all);
                    const auto is_one = hn::Gt(rest, hn::Mul(rounding, whole));
                    found.template look_at<false>(d, hn::IfThenElseZero(is_one, rest), T(0));
                }
                put_above(d, found, sheets_, at, of_absent);
            }
        }
    }

    static constexpr std::size_t kept = 4; ///< slices

    const LoopSetup<T>& setup_;
    const std::size_t number_;
    const LabelSet& set_;
    SheetRing<T>& ring_;
    const TileShape& shape_;
    const int blocks_, rows_;   ///< of sheets
    const std::int64_t around_; ///< slices to both sides that are read around one that shows
    Slice slices_[kept];
    std::vector<T*> sheets_;
};

} // namespace sheetsplat::backend_cpu::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif // SHEETSPLAT_CPU_LABEL_RESTS_INL

// The values of a lattice's kernels on their way into a tile, and those of lattices that are walked with it.

#if defined(SHEETSPLAT_CPU_FEED_VALUES_INL) == defined(HWY_TARGET_TOGGLE)
#ifdef SHEETSPLAT_CPU_FEED_VALUES_INL
#undef SHEETSPLAT_CPU_FEED_VALUES_INL
#else
#define SHEETSPLAT_CPU_FEED_VALUES_INL
#endif

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "backend_cpu/measured.hpp"
#include "backend_cpu/tile_feed.hpp"
#include "backend_cpu/tile_task.hpp"
#include "feed-inl.hpp"
#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace sheetsplat::backend_cpu::HWY_NAMESPACE {

/// Of a row's runs, the first one that ends behind a sample.
inline const Run* run_behind(const Run* run, const Run* past, std::uint32_t begin) {
    if (past - run > 8) {
        return std::partition_point(run, past, [&](const Run& r) { return r.end <= begin; });
    }
    while (run != past && run->end <= begin) {
        ++run;
    }
    return run;
}

/// A lattice whose values are fed, and its own drawn samples.
template <class T>
struct LatticeSource {
    SampleReader<T> reader;
    const VisibleRuns& runs;

    /// Values of samples begin ... begin + count - 1 of a row, the first of which is number `sample`; 0 of those
    /// that are not drawn.
    void read(std::size_t row, std::uint32_t begin, std::uint32_t count, std::size_t sample, T* out) const {
        const std::uint32_t end = begin + count;
        const Run* past = runs.end(row);
        const Run* run = run_behind(runs.begin(row), past, begin);
        if (run != past && run->begin < end) {
            reader.read_piece(sample, count, out);
        }
        std::uint32_t at = begin;
        for (; run != past && run->begin < end; ++run) {
            std::fill(out + (at - begin), out + (std::max(run->begin, at) - begin), T(0));
            at = std::min(run->end, end);
        }
        std::fill(out + (at - begin), out + count, T(0));
    }
};

/// The values of pieces. (One for each type of samples: a call for each piece would take 1 % of a frame.)
template <class T, class Samples>
struct OneLattice {
    const SampleReader<T>& reader;
    Samples samples;
    HWY_INLINE void read(const RowBatches::Stretch& stretch, const RowBatches::Piece& piece, T* value) {
        reader.convert(samples + stretch.first_sample + piece.from, piece.count, value);
    }
    HWY_INLINE void put(std::size_t /*section*/, std::uint32_t /*in_piece*/) const {}
};
/// The same, with those of the lattices beside.
template <class T>
struct SeveralLattices {
    const std::vector<LatticeSource<T>>& sources;
    TileKernels<T>& kernels;
    T of_fields[1 + most_beside][fed_together];
    static constexpr std::size_t ahead = 4; ///< pieces
    void read(const RowBatches::Stretch& stretch, const RowBatches::Piece& piece, T* /*value*/) {
        // (Too much lies between two pieces for the processor to ask for the next one's samples in time.)
        const auto& pieces = kernels.rows.pieces;
        const RowBatches::Piece& later =
            pieces[std::min<std::size_t>(static_cast<std::size_t>(&piece - pieces.data()) + ahead, pieces.size() - 1)];
        const std::size_t first = kernels.rows.stretches[later.stretch].first_sample + later.from;
        for (const LatticeSource<T>& source : sources) {
            source.reader.prefetch(first);
        }
        for (std::size_t number = 0; number < sources.size(); ++number) {
            sources[number].read(stretch.row, stretch.begin + piece.from, piece.count,
                                 stretch.first_sample + piece.from, of_fields[number]);
        }
    }
    HWY_INLINE void put(std::size_t section, std::uint32_t in_piece) const {
        T* values = kernels.values.data() + section * kernels.fields;
        for (std::size_t number = 0; number < kernels.fields; ++number) {
            values[number] = of_fields[number][in_piece];
        }
    }
};

} // namespace sheetsplat::backend_cpu::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif // SHEETSPLAT_CPU_FEED_VALUES_INL

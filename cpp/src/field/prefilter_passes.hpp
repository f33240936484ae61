// The two passes of a step of the prefilter over a tile of the volume, compiled once for each instruction set.
#pragma once

#include <array>
#include <cstddef>
#include <memory>
#include <new>
#include <vector>

#include "base/instruction_set.hpp"

namespace sheetsplat::prefiltering {

/// {nk, nj, ni}
using Shape = std::array<std::size_t, 3>;

/// Weighted sums over the samples around one, as rows along i. Rows of one kind have the same taps; a tap is that of
/// two samples, to the left and to the right, whose distance is a number of indices, on BCC lattices of half edges a/2.
template <class T>
struct Stencil {
    struct Row {
        int k = 0;              ///< layers away
        std::array<int, 2> j{}; ///< index of the row, from that of the sample, in even and odd layers
        std::size_t kind = 0;
    };
    bool bcc = false;
    std::vector<Row> rows; ///< by kind
    std::size_t kinds = 0;
    std::size_t columns = 0; ///< distances along i that occur: 0 to columns - 1
    std::vector<T> taps;     ///< [kind][column]
    int reach = 0;           ///< the largest |k|
};

/// Samples so close to an end have filters of their own; all others have the same.
constexpr std::size_t filter_border = 32;
/// Numbers behind the taps, so that whole vectors can be read.
constexpr std::size_t filter_slack = 64;

/// Filters along one axis after the other. A sample's output is the sum of its neighbours up to `band` away. Where
/// samples are mirrored, the weights of the images are added to those of what they are images of, which are no farther.
struct AxisFilters {
    int band = 0;
    /// [axis k, j, i][offset + band][index]; 0 where a neighbour lies outside.
    std::array<std::vector<float>, 3> taps;
    [[nodiscard]] const float* at(std::size_t axis, int offset, std::size_t length) const {
        return taps[axis].data() + static_cast<std::size_t>(offset + band) * length;
    }
};

/// An approximation of the inverse of the sums; one of the two has taps.
struct Preconditioner {
    AxisFilters axes;
    Stencil<float> stencil;
    [[nodiscard]] bool separable() const { return stencil.rows.empty(); }
};

/// Rows j0 to j1 - 1 of the layers k0 to k1 - 1.
struct Tile {
    std::size_t k0 = 0, k1 = 0, j0 = 0, j1 = 0;
};

/// Memory for `count` numbers from the start of a line of the cache on; not initialised.
template <class T>
class Room {
  public:
    T* of(std::size_t count) {
        if (count > count_) {
            memory_.reset();
            memory_.reset(static_cast<T*>(::operator new(count * sizeof(T), line)));
            count_ = count;
        }
        return memory_.get();
    }

  private:
    static constexpr std::align_val_t line{64};
    struct Release {
        void operator()(T* memory) const { ::operator delete(memory, line); }
    };
    std::unique_ptr<T, Release> memory_;
    std::size_t count_ = 0;
};

/// What a thread needs; kept from tile to tile.
struct Scratch {
    Room<double> wide; ///< rows of sums
    Room<float> coarse;
    Room<float> narrow;            ///< rows of remainders
    std::vector<const void*> rows; ///< those that a sum is over
    std::vector<std::size_t> ends; ///< behind the last row of a kind
    std::vector<std::size_t> kinds;
    std::vector<float> weights;
};

/// What is the same for all tiles.
struct Equations {
    Shape shape{};
    /// Sums run also over the samples that are mirrored in the outermost ones, rows, layers and ends of rows alike.
    bool mirrored = false;
    Stencil<double> kernel;
    Stencil<float> coarse_kernel;
    Preconditioner preconditioner;
    const void* samples = nullptr;
    std::size_t kind = 0; ///< of the samples: the index in SampleArray
    double base = 0.0;    ///< what the sums are to add up to is counted from it
    double unit = 1.0;    ///< a power of two: remainders are kept in this unit
};

enum class Accuracy {
    coarse, ///< sums in float32 where the coefficients are
    fine,   ///< sums in float64
};

/// C: float or double, the type of coefficients. `remainder`: as large as the volume.
template <class C>
struct Passes {
    /// remainder = samples - base - sums of coefficients, and, if the preconditioner is separable, filtered along i and
    /// j. Returns the largest |remainder| in the tile before filters. coefficients: null for 0.
    double (*subtract)(Accuracy accuracy, const Equations& equations, const C* coefficients, const Tile& tile,
                       Scratch& scratch, float* remainder);
    /// coefficients += share * what is left to do of the preconditioner (remainder). Returns the largest |coefficient|.
    double (*add)(const Equations& equations, const float* remainder, double share, const Tile& tile, Scratch& scratch,
                  C* coefficients);
};

/// `set`: one of usable_instruction_sets().
template <class C>
const Passes<C>& passes(InstructionSet set);
extern template const Passes<float>& passes<float>(InstructionSet set);
extern template const Passes<double>& passes<double>(InstructionSet set);

} // namespace sheetsplat::prefiltering

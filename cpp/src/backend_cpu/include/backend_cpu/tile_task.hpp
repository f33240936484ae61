// Everything that the loop over one tile needs, and the room that a thread keeps for it.
#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <memory>
#include <new>
#include <optional>
#include <vector>

#include "backend_cpu/cpu_renderer.hpp"
#include "backend_cpu/lattice_extremes.hpp"
#include "backend_cpu/lattice_reach.hpp"
#include "backend_cpu/measured.hpp"
#include "backend_cpu/sections.hpp"
#include "backend_cpu/shading.hpp"
#include "backend_cpu/tile.hpp"
#include "backend_cpu/tile_feed.hpp"
#include "base/instruction_set.hpp"
#include "index/reached_cells.hpp"

namespace sheetsplat::backend_cpu {

/// How the kernels of one field are splatted.
template <class T>
struct PartProfile {
    T falloff_log2 = 0; ///< k log2(e)
    T edge = 0;         ///< exp(-k)
    T root_falloff = 0; ///< sqrt(k)
    /// The integral of exp(-k t^2) over 0 < t < s, divided by s: a polynomial of 2 s^2 - 1, constant term first, for s
    /// up to 1; where it has terms enough.
    T integral[slab_terms<T>] = {};
    bool integrates = false;
    int value_channel = 0;
    int weight_channel = -1; ///< -1: weights are not summed
    int other_channel = -1;  ///< values of the field beside (EllipsoidPart::beside); -1: there is none
    /// The first of three: derivatives over columns, rows and slices. -1: not summed.
    int slope_channel = -1, weight_slope_channel = -1;
    double pivot = 0.0; ///< what values are counted from
    double other_pivot = 0.0;
    std::size_t group = 0, other_group = 0; ///< to whose sheets it adds
    /// Where values of lattices go that are summed with these kernels (RegularPart::beside).
    struct Beside {
        int value_channel = 0;
        std::size_t group = 0;
    };
    std::vector<Beside> beside;
    bool at_points = false; ///< nothing is splatted: GroupShading::summed_at_points
};

/// A field that is divided by its own weights before fields are added.
template <class T>
struct OwnSheets {
    int value_channel = 0, weight_channel = 0;
    int slope_channel = -1, weight_slope_channel = -1;
    T w0 = 1;
    T least_weight = 0; ///< less does not count: the field is empty there
    T pivot = 0;        ///< what the sums of values are counted from, in the sheets' unit
};

/// The sheets of a group of fields that is classified by itself.
template <class T>
struct GroupSheets {
    int rho_channel = 0;     ///< values of the fields that share sheets; in the end rho of the group
    int weight_channel = -1; ///< of the fields that share sheets; in the end W of the group where it is kept; -1: none
    bool threshold = false;  ///< the fields that share sheets are divided by max(w0, W)
    T w0 = 1;
    T pivot = 0; ///< as of OwnSheets; 0 unless threshold
    std::vector<OwnSheets<T>> own;
    /// Where places alone say which points kernels reach, drawn or not: of all lattices of the group.
    std::vector<LatticeReach> reach;
    /// Derivatives are summed beside values; these channels hold those of rho in the end.
    int slope_channel = -1, weight_slope_channel = -1;
    std::vector<int> channels; ///< all of them

    /// The next `count` of all channels; returns the first one.
    int take(int& all, int count) {
        const int first = all;
        for (; all < first + count; ++all) {
            channels.push_back(all);
        }
        return first;
    }
};

/// A lattice whose samples are all there, but for some beyond its edges and corners: the sum of their kernels follows
/// from the place alone.
struct WholeLattice {
    static constexpr int most_samples = 8; ///< of an axis, that a kernel may reach a point from
    std::vector<LatticeReach> parts;
    const RegularField* field = nullptr;
    double layers = 0.0; ///< RestPart::layers
    /// Cells that drawn samples of the label without a sheet reach, or do from `more_reach` farther away. Null: not
    /// known.
    std::shared_ptr<const ReachedCells> reached;
    static constexpr double more_reach = 4.0; ///< samples along each axis
    double falloff_log2 = 0.0;                ///< k log2(e), over the square of a part's radius
    double edge = 0.0;                        ///< exp(-k)
    double scale = 1.0;                       ///< of the sum, in the sheets' unit
};

/// Groups that hold the weights of labels, which are compared with each other.
struct LabelSet {
    GroupRange groups;
    int absent_channel = 0; ///< what labels without a weight on a slice are there; where no slopes are summed
    /// All samples of the set: what the sums of the groups leave of them is that of a label that has no sheet.
    std::optional<WholeLattice> whole = std::nullopt;
};

/// Where numbers of all slices are written in place of a picture: an element a pixel, in rows.
struct SliceRecord {
    enum class Of {
        absorption, ///< what light loses, as -ln of what is left: sums over slices
        rho,        ///< in the sheets' unit
    };
    Of of = Of::absorption;
    float* values = nullptr;
    std::size_t row = 0, plane = 0; ///< elements from row to row and from plane to plane
    std::int64_t planes = 0;
    std::int64_t every = 1; ///< slices of a plane; of rho 1
    std::size_t group = 0;  ///< whose rho
};

/// The same for all tiles of a picture.
template <class T>
struct LoopSetup {
    const Shading<T>* shading = nullptr;
    std::vector<PartProfile<T>> parts;
    std::vector<GroupSheets<T>> groups;
    std::vector<LabelSet> label_sets; ///< of these groups
    int channels = 0;
    bool slopes = false;                 ///< derivatives are summed beside values
    const SliceRecord* record = nullptr; ///< null: a picture is drawn
    bool keep_weight = false;            ///< W is read after the division (empty points, coverage, slices that count)
    bool slab = false;
    bool perspective = false;
    bool intervals = false; ///< pre-integration, isosurface
    bool stops = false;     ///< a tile whose pixels are all finished is left
    /// The picture is a sum over slices, none of which is looked at by itself.
    bool sums_slices = false;
    bool counts_by_place = false; ///< modes that count slices: points count where the only group's lattices reach
    std::int64_t slices = 0;
    double first_depth = 0.0;
    double slice_spacing = 1.0;
};

/// Memory that starts at a whole line of the cache.
template <class T>
struct LineAllocator {
    using value_type = T;
    static constexpr std::align_val_t line{64};
    LineAllocator() = default;
    template <class U>
    LineAllocator(const LineAllocator<U>& /*other*/) {}
    T* allocate(std::size_t count) { return static_cast<T*>(::operator new(count * sizeof(T), line)); }
    void deallocate(T* memory, std::size_t /*count*/) { ::operator delete(memory, line); }
    friend bool operator==(const LineAllocator&, const LineAllocator&) { return true; }
    friend bool operator!=(const LineAllocator&, const LineAllocator&) { return false; }
};
template <class T>
using LineVector = std::vector<T, LineAllocator<T>>;

/// The parts of a lattice's rows that reach into a tile.
struct LatticeRows {
    const FieldView* view = nullptr;
    const VisibleRuns* runs = nullptr;
    const Frame* frame = nullptr;
    Sampling sampling = Sampling::point;
    const RowPart* begin = nullptr;
    const RowPart* end = nullptr;
    const VisibleRuns* own = nullptr;                   ///< RegularPart::own
    const std::vector<LatticeBeside>* beside = nullptr; ///< RegularPart::beside
};

/// What a thread needs for a tile; kept from tile to tile.
template <class T>
struct TileScratch {
    std::vector<TileKernels<T>> kernels; ///< one a part, lattices first
    std::vector<LatticeRows> lattices;   ///< fed by the loop, some slices at a time
    LineVector<T> ring;                  ///< [slot][channel][element]
    LineVector<T> zeros, ones, reached;  ///< sheets
    LineVector<T> sums;                  ///< a plane (RowSums)
    LineVector<T> first_kept, last_kept; ///< planes (KeptOfPixels)
    LineVector<T> picture;               ///< planes
    std::vector<int> row_alive;
    std::vector<std::uint64_t> alive_rows; ///< a bit for each pixel of a row of the sheets that is still read
    TilePicture<T> planes;
    // Counts of one frame.
    std::uint64_t sections_drawn = 0; ///< kernel times slice
    std::uint64_t kernels_drawn = 0;

    [[nodiscard]] std::size_t bytes() const {
        std::size_t sum = (ring.capacity() + zeros.capacity() + ones.capacity() + reached.capacity() + sums.capacity() +
                           first_kept.capacity() + last_kept.capacity() + picture.capacity()) *
                          sizeof(T);
        for (const auto& part : kernels) {
            sum += part.bytes();
        }
        return sum;
    }
};

/// What is compiled for each instruction set.
template <class T>
struct TileFunctions {
    /// All kernels of a lattice for a tile at once, by first slices, for tests. Throws std::bad_alloc.
    void (*feed_rows)(const LatticeRows& rows, const TileShape& tile, TileKernels<T>& kernels);
    RectsFunction rects;
    /// Scattered kernels for a tile, by first slices.
    void (*feed_kernels)(const EllipsoidView& view, const std::uint32_t* begin, const std::uint32_t* end,
                         const TileShape& tile, TileKernels<T>& kernels);
    /// Splats, shades and composites one tile whose scattered kernels are in scratch.kernels, whose lattices are in
    /// scratch.lattices, and whose picture is cleared. Throws std::bad_alloc.
    /// between is called between slices; returning false (or throwing) ends the tile.
    void (*run)(const LoopSetup<T>& setup, const TileShape& shape, TileScratch<T>& scratch,
                const std::function<bool()>& between);
    /// Modes mip and minimum of a lattice: writes a tile's largest rho, at least 0, or its smallest one to a plane of
    /// its picture, and returns how many points were looked up. between: as for run.
    std::uint64_t (*find_extremes)(const ExtremesView& view, const TileShape& shape, const TilePicture<T>& picture,
                                   const std::function<bool()>& between);
    /// One slab of it by itself, for tests: slice n, or the interval from slice n to n + 1.
    void (*shade)(const Shading<T>& shading, const TileShape& shape, const SlabWindow<T>& window,
                  TilePicture<T>& picture);
};

/// Those of a set that is compiled; each is defined in a source of its own.
template <class T, InstructionSet Set>
const TileFunctions<T>* tile_functions_of();

/// Null where the set is not compiled.
template <class T>
const TileFunctions<T>* tile_functions(InstructionSet set);
extern template const TileFunctions<float>* tile_functions<float>(InstructionSet set);
extern template const TileFunctions<double>* tile_functions<double>(InstructionSet set);

} // namespace sheetsplat::backend_cpu

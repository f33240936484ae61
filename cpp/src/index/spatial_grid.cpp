// The cells are those of an octree: each level's are halves of the next coarser one's, and a kernel may live in any
// node of it. They are found from the kernels in Z order of their centres. The order is refined only where many kernels
// are still together, so that clusters of clusters cost no more than evenly spread kernels do.
#include "index/spatial_grid.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <utility>

#include <glm/common.hpp>
#include <glm/geometric.hpp>

#include "base/checks.hpp"
#include "base/memory.hpp"
#include "base/poll.hpp"
#include "sheetsplat/error.hpp"

namespace sheetsplat {

namespace {

using Corner = std::array<std::uint64_t, 3>;

/// Halvings of the root: a double holds every place of the finest cells exactly.
constexpr int max_depth = 52;
/// A key of this many halvings along three axes fits 32 bits.
constexpr int max_key_levels = 10;
constexpr std::uint32_t no_kernel = 0xFFFFFFFFU;
/// Below this, sorting by comparison is faster than by digits.
constexpr std::size_t few = 512;
constexpr unsigned most_digit_bits = 11;

constexpr const char* grid_name = "the spatial grid of a field's kernels";
constexpr const char* grid_next = "use fewer kernels at a time";

/// The largest of a kernel's half-extents along the world's axes.
double reach_of(const EllipsoidField& field, std::size_t kernel) {
    const Vec3 extent = field.extent(kernel);
    return std::max({extent.x, extent.y, extent.z});
}

/// The exponent p of the smallest power of two 2^p >= x > 0.
int exponent_up(double x) {
    int exponent = 0;
    return std::frexp(x, &exponent) == 0.5 ? exponent - 1 : exponent;
}

/// A power of two that is more than the extent of all supports.
double root_edge(const EllipsoidField& field) {
    // Sizes near the least numbers there are would leave no room for finer cells, but have the same picture in coarse
    // ones.
    constexpr int least_exponent = -900;
    const Vec3 extent = field.supports_world().extent();
    const double largest = std::max({extent.x, extent.y, extent.z, 2.0 * field.scale_range()[1]});
    int exponent = 0;
    std::frexp(largest, &exponent);
    return std::ldexp(1.0, std::max(exponent, least_exponent));
}

/// Finest cells to a root, along each axis.
constexpr double finest_places = static_cast<double>(std::uint64_t{1} << max_depth);

/// The place among the finest cells, clamped to the root's.
std::uint64_t place(double in_finest_cells) {
    return static_cast<std::uint64_t>(std::clamp(in_finest_cells, 0.0, finest_places - 1.0));
}

/// per_world: finest cells to a world unit.
Corner finest_corner(const Vec3& from_lower, double per_world) {
    return {place(from_lower.x * per_world), place(from_lower.y * per_world), place(from_lower.z * per_world)};
}

Corner coarser(const Corner& corner, int halvings) {
    return {corner[0] >> halvings, corner[1] >> halvings, corner[2] >> halvings};
}

Box box_of(const Vec3& lower, double root, const Corner& corner, int depth) {
    const double edge = std::ldexp(root, -depth);
    Box box;
    for (int axis = 0; axis < 3; ++axis) {
        const auto at = static_cast<double>(corner[static_cast<std::size_t>(axis)]);
        box.lower[axis] = lower[axis] + at * edge;
        box.upper[axis] = lower[axis] + (at + 1.0) * edge;
    }
    return box;
}

/// Z order; z decides before y, and y before x.
bool z_less(const Corner& a, const Corner& b) {
    std::uint64_t most = 0;
    bool less = false;
    for (std::size_t axis = 3; axis-- > 0;) {
        const std::uint64_t difference = a[axis] ^ b[axis];
        // True where the highest bit of `difference` lies above that of `most`.
        if (most < difference && most < (most ^ difference)) {
            most = difference;
            less = a[axis] < b[axis];
        }
    }
    return less;
}

/// Puts two bits 0 above each of the lowest 10 bits.
std::uint32_t spread_bits(std::uint32_t bits) {
    bits = (bits | (bits << 16)) & 0x030000FFU;
    bits = (bits | (bits << 8)) & 0x0300F00FU;
    bits = (bits | (bits << 4)) & 0x030C30C3U;
    bits = (bits | (bits << 2)) & 0x09249249U;
    return bits;
}

/// Number of leading bits 0 of 64; 64 for 0.
int leading_zeros(std::uint64_t bits) {
#if defined(__GNUC__)
    return bits == 0 ? 64 : __builtin_clzll(bits);
#else
    int count = 0;
    while (count < 64 && (bits >> 63) == 0) {
        bits <<= 1;
        ++count;
    }
    return count;
#endif
}

/// Settles each kernel in the deepest cell that is large enough for it and that `least_in_cell` kernels share.
class Builder {
  public:
    struct Settled {
        std::uint32_t kernels;
        std::uint8_t depth;
    };

    Builder(const EllipsoidField& field, const Vec3& lower, double root)
        : field_(field), lower_(lower), per_world_(finest_places / root) {
        const std::size_t n = field.size();
        keyed_.resize(n);
        scratch_.resize(n);
        next_.resize(n);
        deepest_.resize(n);
        const int root_exponent = exponent_up(root);
        for (std::size_t i = 0; i < n; ++i) {
            poll_at(i);
            keyed_[i] = i;
            const double reach = 2.0 * reach_of(field, i);
            const int depth = reach > 0.0 ? root_exponent - exponent_up(reach) : max_depth;
            deepest_[i] = static_cast<std::uint8_t>(std::clamp(depth, 0, max_depth));
        }
        pool_.fill({no_kernel, no_kernel, 0});
        order.reserve(n);
        cells.reserve(n / SpatialGrid::least_in_cell + 1);
        refine(0, n, 0);
        close(0);
        if (pool_[0].kernels > 0) {
            settle(0);
        }
    }

    std::vector<std::uint32_t> order; ///< cell by cell, cells as they were settled: in Z order within each depth
    std::vector<Settled> cells;

  private:
    /// Kernels that wait for a cell: a chain through next_.
    struct Pool {
        std::uint32_t first, last, kernels;
    };

    [[nodiscard]] std::uint32_t kernel_at(std::size_t at) const { return static_cast<std::uint32_t>(keyed_[at]); }
    [[nodiscard]] std::uint32_t key_at(std::size_t at) const { return static_cast<std::uint32_t>(keyed_[at] >> 32); }
    [[nodiscard]] Corner finest(std::uint32_t kernel) const {
        return finest_corner(field_.center(kernel) - lower_, per_world_);
    }

    /// Kernels begin <= at < end of keyed_ share the cell at `depth`.
    void refine(std::size_t begin, std::size_t end, int depth) {
        const std::size_t n = end - begin;
        int levels = 1;
        for (std::size_t cells_at = 8; cells_at < n && levels < max_key_levels; cells_at *= 8) {
            ++levels;
        }
        levels = std::min(levels, max_depth - depth);
        sort(begin, end, depth, levels);
        const int bottom = depth + levels;
        for (std::size_t run = begin; run < end;) {
            poll_at(++steps_);
            std::size_t run_end = run + 1;
            while (run_end < end && key_at(run_end) == key_at(run)) {
                ++run_end;
            }
            // Read before refining, which replaces keys.
            const std::uint32_t key = key_at(run);
            const std::uint32_t next_key = run_end < end ? key_at(run_end) : key;
            const int deeper = bottom < max_depth ? shared_depth(run, run_end, bottom) : bottom;
            if (deeper < max_depth && run_end - run >= SpatialGrid::least_in_cell) {
                refine(run, run_end, deeper);
            } else {
                for (std::size_t at = run; at < run_end; ++at) {
                    add(kernel_at(at), std::min<int>(deepest_[kernel_at(at)], deeper));
                }
            }
            if (run_end < end) {
                close(depth + levels - 1 - (63 - leading_zeros(key ^ next_key)) / 3);
            }
            run = run_end;
        }
    }

    /// The depth to which a run of kernels that are together at `depth` stays together; max_depth where none of them
    /// has a use for finer cells or too few are left to fill one.
    [[nodiscard]] int shared_depth(std::size_t begin, std::size_t end, int depth) const {
        if (end - begin < SpatialGrid::least_in_cell) {
            return depth;
        }
        int finest_use = 0;
        std::uint64_t differences = 0;
        const Corner first = finest(kernel_at(begin));
        for (std::size_t at = begin; at < end; ++at) {
            const std::uint32_t kernel = kernel_at(at);
            finest_use = std::max<int>(finest_use, deepest_[kernel]);
            const Corner corner = finest(kernel);
            differences |= (corner[0] ^ first[0]) | (corner[1] ^ first[1]) | (corner[2] ^ first[2]);
        }
        const int shared = max_depth - (64 - leading_zeros(differences));
        return shared >= finest_use ? max_depth : shared;
    }

    void sort(std::size_t begin, std::size_t end, int depth, int levels) {
        if (levels <= 0) {
            return;
        }
        const int shift = max_depth - depth - levels;
        const auto mask = (std::uint64_t{1} << levels) - 1;
        std::uint64_t* keyed = keyed_.data() + begin;
        const std::size_t n = end - begin;
        for (std::size_t at = 0; at < n; ++at) {
            poll_at(at);
            const auto kernel = static_cast<std::uint32_t>(keyed[at]);
            const Corner corner = finest(kernel);
            std::uint32_t key = 0;
            for (std::size_t axis = 0; axis < 3; ++axis) {
                key |= spread_bits(static_cast<std::uint32_t>((corner[axis] >> shift) & mask)) << axis;
            }
            keyed[at] = (static_cast<std::uint64_t>(key) << 32) | kernel;
        }
        if (n < few) {
            std::sort(keyed, keyed + n);
        } else {
            sort_by_digits(begin, n, static_cast<unsigned>(3 * levels));
        }
    }

    void sort_by_digits(std::size_t begin, std::size_t n, unsigned bits) {
        const unsigned passes = (bits + most_digit_bits - 1) / most_digit_bits;
        const unsigned digit_bits = (bits + passes - 1) / passes;
        const std::size_t mask = (std::size_t{1} << digit_bits) - 1;
        std::uint64_t* from = keyed_.data() + begin;
        std::uint64_t* to = scratch_.data() + begin;
        std::vector<std::uint32_t> starts(mask + 1);
        for (unsigned pass = 0; pass < passes; ++pass) {
            const unsigned shift = 32 + pass * digit_bits;
            poll();
            std::fill(starts.begin(), starts.end(), 0U);
            for (std::size_t at = 0; at < n; ++at) {
                ++starts[(from[at] >> shift) & mask];
            }
            if (starts[(from[0] >> shift) & mask] == n) {
                continue;
            }
            std::uint32_t sum = 0;
            for (std::uint32_t& start : starts) {
                sum += std::exchange(start, sum);
            }
            for (std::size_t at = 0; at < n; ++at) {
                to[starts[(from[at] >> shift) & mask]++] = from[at];
            }
            std::swap(from, to);
        }
        if (from != keyed_.data() + begin) {
            std::copy(from, from + n, to);
        }
    }

    void add(std::uint32_t kernel, int depth) { append({kernel, kernel, 1}, depth); }

    void append(const Pool& more, int depth) {
        Pool& pool = pool_[static_cast<std::size_t>(depth)];
        if (pool.kernels == 0) {
            pool = more;
            open_ |= std::uint64_t{1} << depth;
            return;
        }
        next_[pool.last] = more.first;
        pool.last = more.last;
        pool.kernels += more.kernels;
    }

    /// Leaves all cells deeper than `depth` on the way to the kernel that was added last.
    void close(int depth) {
        for (int deepest = 63 - leading_zeros(open_); deepest > depth; deepest = 63 - leading_zeros(open_)) {
            const Pool pool = pool_[static_cast<std::size_t>(deepest)];
            if (pool.kernels >= SpatialGrid::least_in_cell) {
                settle(deepest);
                continue;
            }
            open_ ^= std::uint64_t{1} << deepest;
            pool_[static_cast<std::size_t>(deepest)] = {no_kernel, no_kernel, 0};
            append(pool, std::max(depth, 63 - leading_zeros(open_)));
        }
    }

    void settle(int depth) {
        Pool& pool = pool_[static_cast<std::size_t>(depth)];
        cells.push_back({pool.kernels, static_cast<std::uint8_t>(depth)});
        std::uint32_t kernel = pool.first;
        for (std::uint32_t n = 0; n < pool.kernels; ++n) {
            order.push_back(kernel);
            kernel = next_[kernel];
        }
        pool = {no_kernel, no_kernel, 0};
        open_ ^= std::uint64_t{1} << depth;
    }

    const EllipsoidField& field_;
    Vec3 lower_;
    double per_world_;
    std::size_t steps_ = 0;
    std::vector<std::uint64_t> keyed_;   ///< key in the upper half, kernel in the lower
    std::vector<std::uint64_t> scratch_; ///< of the sort
    std::vector<std::uint32_t> next_;
    std::vector<std::uint8_t> deepest_; ///< depth at which a kernel's box still spans two cells at most
    std::array<Pool, max_depth + 1> pool_{};
    std::uint64_t open_ = 0; ///< a bit for each depth whose pool holds a kernel
};

/// The cells along one axis that a kernel's box meets, in cells of its level: one or two.
struct Span {
    std::uint64_t lower, upper;
};

std::array<Span, 3> cells_of(const EllipsoidField& field, const Vec3& lower, double per_world, std::size_t kernel,
                             int depth) {
    const Vec3 centre = (field.center(kernel) - lower) * per_world;
    const Vec3 extent = field.extent(kernel) * per_world;
    const int halvings = max_depth - depth;
    std::array<Span, 3> spans{};
    for (int axis = 0; axis < 3; ++axis) {
        const std::uint64_t home = place(centre[axis]) >> halvings;
        Span& span = spans[static_cast<std::size_t>(axis)];
        span = {place(centre[axis] - extent[axis]) >> halvings, place(centre[axis] + extent[axis]) >> halvings};
        // Rounding may let a box that is as wide as a cell touch a third one.
        span.upper = std::min(span.upper, home + 1);
        span.lower = std::max(span.lower, span.upper > home ? home : home - std::min<std::uint64_t>(home, 1));
    }
    return spans;
}

/// Calls visit(corner) for each cell of the spans.
template <typename Visit>
void for_each_corner(const std::array<Span, 3>& spans, Visit&& visit) {
    for (std::uint64_t z = spans[2].lower; z <= spans[2].upper; ++z) {
        for (std::uint64_t y = spans[1].lower; y <= spans[1].upper; ++y) {
            for (std::uint64_t x = spans[0].lower; x <= spans[0].upper; ++x) {
                visit(Corner{x, y, z});
            }
        }
    }
}

/// Number of the cell at `corner` among cells begin <= c < end, which are in Z order; `otherwise` where it is not
/// there.
std::uint32_t find_corner(const std::vector<Corner>& corners, std::uint32_t begin, std::uint32_t end,
                          const Corner& corner, std::uint32_t otherwise) {
    const auto first = corners.begin() + static_cast<std::ptrdiff_t>(begin);
    const auto last = corners.begin() + static_cast<std::ptrdiff_t>(end);
    const auto found = std::lower_bound(first, last, corner, z_less);
    return found != last && *found == corner ? static_cast<std::uint32_t>(found - corners.begin()) : otherwise;
}

} // namespace

SpatialGrid SpatialGrid::of(const EllipsoidField& field) {
    const std::size_t n = field.size();
    if (n > std::numeric_limits<std::uint32_t>::max()) {
        throw Unsupported(Complaint{"SpatialGrid: the field cannot be indexed", text_of_count(n) + " kernels",
                                    "at most 4294967295 kernels in one field", "split it into several fields"});
    }
    SpatialGrid grid;
    if (n == 0) {
        return grid;
    }
    constexpr std::uint64_t most_bytes_a_kernel = 32;
    require_memory(checked_product(n, most_bytes_a_kernel, grid_name), grid_name, grid_next);
    grid.lower_ = field.supports_world().lower;
    grid.root_ = root_edge(field);

    std::vector<std::uint32_t> settled_order;
    std::vector<Builder::Settled> settled;
    {
        Builder builder(field, grid.lower_, grid.root_);
        settled_order = std::move(builder.order);
        settled = std::move(builder.cells);
    }
    int deepest = 0;
    for (const Builder::Settled& cell : settled) {
        deepest = std::max<int>(deepest, cell.depth);
    }
    const auto level_of = [deepest](const Builder::Settled& cell) {
        return static_cast<std::size_t>(deepest - cell.depth);
    };
    std::vector<std::uint32_t> kernels_before(static_cast<std::size_t>(deepest) + 2, 0);
    grid.level_begin_.assign(static_cast<std::size_t>(deepest) + 2, 0);
    for (const Builder::Settled& cell : settled) {
        ++grid.level_begin_[level_of(cell) + 1];
        kernels_before[level_of(cell) + 1] += cell.kernels;
    }
    for (std::size_t level = 0; level <= static_cast<std::size_t>(deepest); ++level) {
        grid.level_begin_[level + 1] += grid.level_begin_[level];
        kernels_before[level + 1] += kernels_before[level];
    }
    grid.order_.resize(n);
    grid.home_.resize(n);
    grid.offset_.resize(settled.size() + 1, static_cast<std::uint32_t>(n));
    grid.corner_.resize(settled.size());
    grid.supports_.resize(settled.size());
    grid.values_.resize(settled.size());
    std::vector<std::uint32_t> next_cell(grid.level_begin_.begin(), grid.level_begin_.end() - 1);
    const std::uint32_t* kernel = settled_order.data();
    const double per_world = finest_places / grid.root_;
    std::size_t steps = 0;
    for (const Builder::Settled& cell : settled) {
        poll_at(++steps);
        const std::size_t level = level_of(cell);
        const std::uint32_t number = next_cell[level]++;
        grid.corner_[number] =
            coarser(finest_corner(field.center(*kernel) - grid.lower_, per_world), max_depth - cell.depth);
        grid.offset_[number] = kernels_before[level];
        Box box{field.center(*kernel), field.center(*kernel)};
        std::array<double, 2> values{field.value(*kernel), field.value(*kernel)};
        for (std::uint32_t i = 0; i < cell.kernels; ++i, ++kernel) {
            const Vec3& centre = field.center(*kernel);
            const Vec3 extent = field.extent(*kernel);
            const double value = field.value(*kernel);
            box = Box{glm::min(box.lower, centre - extent), glm::max(box.upper, centre + extent)};
            values = {std::min(values[0], value), std::max(values[1], value)};
            grid.order_[kernels_before[level]++] = *kernel;
            grid.home_[*kernel] = number;
        }
        grid.supports_[number] = box;
        grid.values_[number] = values;
    }
    return grid;
}

std::size_t SpatialGrid::bytes() const {
    return (order_.capacity() + home_.capacity() + offset_.capacity() + level_begin_.capacity()) *
               sizeof(std::uint32_t) +
           corner_.capacity() * sizeof(Corner) + supports_.capacity() * sizeof(Box) +
           values_.capacity() * sizeof(std::array<double, 2>);
}

double SpatialGrid::cell_size(int level) const { return std::ldexp(root_, -depth_of_level(level)); }

int SpatialGrid::level_of_cell(std::size_t cell) const {
    const auto after = std::upper_bound(level_begin_.begin(), level_begin_.end(), static_cast<std::uint32_t>(cell));
    return static_cast<int>(after - level_begin_.begin()) - 1;
}

Box SpatialGrid::cell_bounds(std::size_t cell) const {
    return box_of(lower_, root_, corner_[cell], depth_of_level(level_of_cell(cell)));
}

ReachLists ReachLists::of(const EllipsoidField& field, const SpatialGrid& grid) {
    const std::string what = "the lists of kernels that reach into each cell";
    ReachLists lists;
    lists.lower_ = grid.lower_;
    lists.root_ = grid.root_;
    lists.levels_ = grid.levels();
    require_memory(checked_product(grid.cells(), sizeof(Corner), what), what, grid_next);
    lists.corner_ = grid.corner_;
    lists.extra_begin_.assign(static_cast<std::size_t>(grid.levels()) + 1, static_cast<std::uint32_t>(grid.cells()));
    const double per_world = finest_places / grid.root_;
    // Calls visit(kernel, corner, neighbour) for each cell that a kernel of a home reaches; neighbour < 27 tells the
    // cell's place beside the home.
    const auto for_each_listing = [&](std::size_t home, int level, auto&& visit) {
        const Corner& middle = grid.corner_[home];
        for (const std::uint32_t* kernel = grid.home_begin(home); kernel != grid.home_end(home); ++kernel) {
            const auto spans = cells_of(field, grid.lower_, per_world, *kernel, grid.depth_of_level(level));
            for_each_corner(spans, [&](const Corner& corner) {
                const std::uint64_t neighbour =
                    ((corner[2] + 1 - middle[2]) * 3 + corner[1] + 1 - middle[1]) * 3 + corner[0] + 1 - middle[0];
                visit(*kernel, corner, neighbour);
            });
        }
    };

    // Cells that are nobody's home, level by level.
    std::uint64_t listed = 0;
    for (int level = 0; level < grid.levels(); ++level) {
        const std::uint32_t first = grid.level_begin(level);
        const std::uint32_t last = grid.level_begin(level + 1);
        std::vector<Corner> extra;
        const auto sort_out = [&extra] {
            std::sort(extra.begin(), extra.end(), z_less);
            extra.erase(std::unique(extra.begin(), extra.end()), extra.end());
        };
        std::size_t sort_at = 1 << 16;
        for (std::uint32_t home = first; home < last; ++home) {
            std::uint32_t met = 0;
            for_each_listing(home, level, [&](std::uint32_t, const Corner& corner, std::uint64_t neighbour) {
                ++listed;
                if (((met >> neighbour) & 1U) == 0) {
                    met |= 1U << neighbour;
                    if (find_corner(grid.corner_, first, last, corner, SpatialGrid::none) == SpatialGrid::none) {
                        extra.push_back(corner);
                    }
                }
            });
            // Many homes meet the same cells, which are sorted out before they fill the memory.
            if (extra.size() > sort_at) {
                sort_out();
                sort_at = std::max(sort_at, 2 * extra.size());
                require_memory(checked_product(2 * sort_at, sizeof(Corner), what), what, grid_next);
            }
        }
        sort_out();
        const std::uint64_t cells = lists.corner_.size() + extra.size();
        if (cells >= SpatialGrid::none || listed > std::numeric_limits<std::uint32_t>::max()) {
            throw Unsupported(Complaint{"ReachLists: the lists cannot be numbered",
                                        text_of_count(cells) + " cells with " + text_of_count(listed) + " entries",
                                        "at most 4294967294 cells and 4294967295 entries",
                                        "split the field into several"});
        }
        require_memory(checked_product(cells, sizeof(Corner), what), what, grid_next);
        lists.corner_.insert(lists.corner_.end(), extra.begin(), extra.end());
        lists.extra_begin_[static_cast<std::size_t>(level) + 1] = static_cast<std::uint32_t>(cells);
    }
    const std::size_t cells = lists.corner_.size();
    require_memory(listed * sizeof(std::uint32_t) + cells * (sizeof(std::uint32_t) + 1), what, grid_next);
    lists.level_.resize(cells);
    for (int level = 0; level < grid.levels(); ++level) {
        const auto fill = [&](std::uint32_t begin, std::uint32_t end) {
            std::fill(lists.level_.begin() + static_cast<std::ptrdiff_t>(begin),
                      lists.level_.begin() + static_cast<std::ptrdiff_t>(end), static_cast<std::int8_t>(level));
        };
        fill(grid.level_begin(level), grid.level_begin(level + 1));
        fill(lists.extra_begin_[static_cast<std::size_t>(level)],
             lists.extra_begin_[static_cast<std::size_t>(level) + 1]);
    }
    lists.offsets_.assign(cells + 1, 0);
    const auto visit_listings = [&](auto&& visit) {
        for (std::size_t home = 0; home < grid.cells(); ++home) {
            const int level = lists.level_[home];
            std::array<std::uint32_t, 27> found;
            found.fill(SpatialGrid::none);
            for_each_listing(home, level, [&](std::uint32_t kernel, const Corner& corner, std::uint64_t neighbour) {
                std::uint32_t& cell = found[neighbour];
                if (cell == SpatialGrid::none) {
                    cell = lists.find(grid, corner, level);
                }
                visit(cell, kernel);
            });
        }
    };
    visit_listings([&](std::uint32_t cell, std::uint32_t) { ++lists.offsets_[cell]; });
    std::uint32_t sum = 0;
    for (std::uint32_t& offset : lists.offsets_) {
        sum += std::exchange(offset, sum);
    }
    lists.entries_.resize(sum);
    // Each offset moves to its list's end, which is where the next list begins.
    visit_listings([&](std::uint32_t cell, std::uint32_t kernel) { lists.entries_[lists.offsets_[cell]++] = kernel; });
    std::move_backward(lists.offsets_.begin(), lists.offsets_.end() - 1, lists.offsets_.end());
    lists.offsets_.front() = 0;
    return lists;
}

std::size_t ReachLists::bytes() const {
    return (offsets_.capacity() + entries_.capacity() + extra_begin_.capacity()) * sizeof(std::uint32_t) +
           level_.capacity() + corner_.capacity() * sizeof(Corner);
}

Box ReachLists::cell_bounds(std::size_t cell) const {
    return box_of(lower_, root_, corner_[cell], levels_ - 1 - level_[cell]);
}

std::uint32_t ReachLists::find(const SpatialGrid& grid, const Corner& corner, int level) const {
    const auto at = static_cast<std::size_t>(level);
    const std::uint32_t otherwise =
        extra_begin_[at] == extra_begin_[at + 1]
            ? SpatialGrid::none
            : find_corner(corner_, extra_begin_[at], extra_begin_[at + 1], corner, SpatialGrid::none);
    return otherwise != SpatialGrid::none
               ? otherwise
               : find_corner(corner_, grid.level_begin(level), grid.level_begin(level + 1), corner, SpatialGrid::none);
}

std::uint32_t ReachLists::start_cell(const EllipsoidField& field, const SpatialGrid& grid, std::size_t kernel,
                                     const Vec3& point_world) const {
    const int level = grid.level(kernel);
    const int depth = grid.depth_of_level(level);
    const double per_world = finest_places / root_;
    const std::array<Span, 3> spans = cells_of(field, lower_, per_world, kernel, depth);
    Corner corner = coarser(finest_corner(point_world - lower_, per_world), max_depth - depth);
    for (std::size_t axis = 0; axis < 3; ++axis) {
        corner[axis] = std::clamp(corner[axis], spans[axis].lower, spans[axis].upper);
    }
    return find(grid, corner, level);
}

Vec3 first_point(const EllipsoidField& field, std::size_t kernel, const Vec3& towards_viewer) {
    const Mat3 shape = field.shape(kernel);
    const Vec3 turned = glm::normalize(towards_viewer) * shape;
    // Divided before it is squared, so that no semi-axis is too short or too long for it.
    const double largest = std::max({std::abs(turned.x), std::abs(turned.y), std::abs(turned.z)});
    return field.center(kernel) + shape * glm::normalize(turned / largest);
}

} // namespace sheetsplat

// The cells are those of an octree: each level's are halves of the next coarser one's, and a kernel may live in any
// node of it. They are found from the kernels in Z order of their centres. The order is refined only where many kernels
// are still together, so that clusters of clusters cost no more than evenly spread kernels do.
#include "cell_builder.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "base/poll.hpp"

namespace sheetsplat::cells {

namespace {

/// A key of this many halvings along three axes fits 32 bits.
constexpr int max_key_levels = 10;
constexpr std::uint32_t no_kernel = 0xFFFFFFFFU;
/// Below this, sorting by comparison is faster than by digits.
constexpr std::size_t few = 512;
constexpr unsigned most_digit_bits = 11;

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

/// Puts two bits 0 above each of the lowest 10 bits.
std::uint32_t spread_bits(std::uint32_t bits) {
    bits = (bits | (bits << 16)) & 0x030000FFU;
    bits = (bits | (bits << 8)) & 0x0300F00FU;
    bits = (bits | (bits << 4)) & 0x030C30C3U;
    bits = (bits | (bits << 2)) & 0x09249249U;
    return bits;
}

/// Number of leading bits 0 of 64; 64 for 0.
int leading_zeros(std::uint64_t bits) { return bits == 0 ? 64 : __builtin_clzll(bits); }

} // namespace

CellBuilder::CellBuilder(const EllipsoidField& field, const Vec3& lower, double root)
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

void CellBuilder::refine(std::size_t begin, std::size_t end, int depth) {
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

int CellBuilder::shared_depth(std::size_t begin, std::size_t end, int depth) const {
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

void CellBuilder::sort(std::size_t begin, std::size_t end, int depth, int levels) {
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

void CellBuilder::sort_by_digits(std::size_t begin, std::size_t n, unsigned bits) {
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

void CellBuilder::append(const Pool& more, int depth) {
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

void CellBuilder::close(int depth) {
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

void CellBuilder::settle(int depth) {
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

} // namespace sheetsplat::cells

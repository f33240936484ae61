#include "index/neighbourhood.hpp"

#include <algorithm>
#include <cmath>

#include <glm/geometric.hpp>
#include <glm/matrix.hpp>

#include "field/lattice_frame.hpp"

namespace sheetsplat {

namespace {

// Above this half-width the number of rows that each row reaches (its square times pi) would cost more than the
// samples that coarser blocks add.
constexpr double widest_in_blocks = 10.0;

std::size_t block_size(double half_width, std::size_t n) {
    const double wide = std::min(half_width, static_cast<double>(n));
    return std::max<std::size_t>(1, static_cast<std::size_t>(wide / widest_in_blocks));
}

/// half_width without its decimals, at most `most`.
std::ptrdiff_t clamped(double half_width, std::size_t most) {
    return static_cast<std::ptrdiff_t>(std::min(half_width, static_cast<double>(most)));
}

/// Sets the neighbours of the bits that are set: the next higher bit where `up`, the next lower one where `down`.
void widen(std::vector<BitWord>& row, bool up, bool down) {
    BitWord before = 0;
    for (std::size_t w = 0; w < row.size(); ++w) {
        const BitWord word = row[w];
        const BitWord after = w + 1 < row.size() ? row[w + 1] : 0;
        const BitWord higher = (word << 1) | (before >> (word_bits - 1));
        const BitWord lower = (word >> 1) | (after << (word_bits - 1));
        row[w] = word | (up ? higher : 0) | (down ? lower : 0);
        before = word;
    }
}

} // namespace

Neighbourhood::Neighbourhood(const RegularField& field, double reach_world, bool in_cells) : lattice_(field.lattice()) {
    const RegularFieldOptions& options = field.options();
    Vec3 half_width; // in samples along i, j, k
    if (lattice_ == Lattice::bcc) {
        radii_ = std::sqrt(2.0) * options.radius;
        reach_ = Vec3(reach_world / options.spacing.x);
        const double radius = radii_ + reach_.x;
        half_width = Vec3(radius, radius, 2.0 * radius);
    } else {
        radii_ = (in_cells ? 1.0 : 2.0) * options.radius;
        box_ = in_cells ? 1.0 : 0.0;
        // In index coordinates the ball is an ellipsoid {x: x^T Q^-1 x < reach^2}; the diagonal matrix of the sums of
        // |Q| along its rows is at least Q, and Q itself where axes are those of the world.
        const Mat3 to_index = to_indices(field.steps());
        const Mat3 squares = to_index * glm::transpose(to_index);
        for (int axis = 0; axis < 3; ++axis) {
            reach_[axis] = reach_world * std::sqrt(std::abs(squares[0][axis]) + std::abs(squares[1][axis]) +
                                                   std::abs(squares[2][axis]));
        }
        half_width = radii_ + box_ + reach_;
    }
    const std::array<std::size_t, 3>& shape = field.shape();
    for (std::size_t axis = 0; axis < 3; ++axis) {
        block_[axis] = block_size(half_width[static_cast<glm::length_t>(2 - axis)], shape[axis]);
        blocks_[axis] = (shape[axis] - 1) / block_[axis] + 1;
    }
    parity_ = lattice_ == Lattice::bcc && block_ == std::array<std::size_t, 3>{1, 1, 1};
    if (parity_) {
        offsets_[0] = {offsets_of(Shift::none, false), offsets_of(Shift::target_half_up, true)};
        offsets_[1] = {offsets_of(Shift::none, false), offsets_of(Shift::target_half_down, true)};
    } else {
        offsets_[0] = {offsets_of(Shift::none, false)};
    }
}

bool Neighbourhood::holds(const Vec3& offset) const {
    // A convex set holds a point if for every direction u the point lies below the set's support function, which for a
    // sum of sets is the sum of theirs. Looking only at some directions can keep a point too many, but never drops one.
    const auto beyond = [&](const Vec3& u) {
        return glm::dot(offset, u) >= radii_ * glm::length(u) + box_ * (u.x + u.y + u.z) + glm::length(reach_ * u);
    };
    // (Offsets have no negative coordinates.) From the box on.
    const Vec3 outside = glm::max(offset - Vec3(box_), Vec3(0.0));
    const double length = glm::length(outside);
    if (length < radii_) {
        return true;
    }
    if (beyond(outside / length)) {
        return false;
    }
    if (reach_.x == reach_.y && reach_.y == reach_.z) {
        return true;
    }
    const Vec3 axes = radii_ + box_ + reach_;
    return !beyond(glm::normalize(offset / (axes * axes))) && offset.x < axes.x && offset.y < axes.y &&
           offset.z < axes.z;
}

Neighbourhood::RowOffsets Neighbourhood::offsets_of(Shift shift, bool odd_layers) const {
    RowOffsets found;
    found.shift = shift;
    const bool bcc = lattice_ == Lattice::bcc;
    const double half = shift == Shift::none ? 0.0 : shift == Shift::target_half_up ? 0.5 : -0.5;
    // The nearest that samples of two blocks can be along an axis, in samples. Blocks of a BCC volume hold layers of
    // both kinds.
    const auto nearest = [&](std::size_t axis, std::ptrdiff_t blocks) {
        const double apart = static_cast<double>(blocks) * static_cast<double>(block_[axis]);
        const double inside = static_cast<double>(block_[axis] - 1) + (bcc && !parity_ && axis != 0 ? 0.5 : 0.0);
        return std::max(0.0, std::abs(apart) - inside);
    };
    const Vec3 axes = radii_ + box_ + reach_;
    const auto most = [&](std::size_t axis, double samples) {
        return clamped(samples / static_cast<double>(block_[axis]) + 2.0, blocks_[axis] - 1);
    };
    const std::ptrdiff_t most_k = most(0, bcc ? 2.0 * axes.z : axes.z);
    const std::ptrdiff_t most_j = most(1, axes.y);
    const std::ptrdiff_t most_i = most(2, axes.x);
    for (std::ptrdiff_t dk = -most_k; dk <= most_k; ++dk) {
        if (parity_ && (dk % 2 != 0) != odd_layers) {
            continue;
        }
        const double z = nearest(0, dk) * (bcc ? 0.5 : 1.0);
        for (std::ptrdiff_t dj = -most_j; dj <= most_j; ++dj) {
            const double y = std::abs(half) > 0.0 ? std::abs(static_cast<double>(dj) + half) : nearest(1, dj);
            for (std::ptrdiff_t di = most_i; di >= 0; --di) {
                if (holds(Vec3(nearest(2, di) + std::abs(half), y, z))) {
                    found.rows.push_back({dk, dj, static_cast<std::size_t>(di)});
                    break;
                }
            }
        }
    }
    std::stable_sort(found.rows.begin(), found.rows.end(),
                     [](const RowOffset& a, const RowOffset& b) { return a.half < b.half; });
    return found;
}

void Neighbourhood::spread_row(const BitRows& seeds, std::size_t j, std::size_t k, const RowOffsets& offsets,
                               std::vector<BitWord>& scratch, BitRows& spread) const {
    const std::size_t words = seeds.words();
    std::copy_n(seeds.row(j, k), words, scratch.begin());
    if (offsets.shift != Shift::none) {
        widen(scratch, offsets.shift == Shift::target_half_down, offsets.shift == Shift::target_half_up);
    }
    std::size_t half = 0;
    for (const RowOffset& offset : offsets.rows) {
        for (; half < offset.half; ++half) {
            widen(scratch, true, true);
        }
        // A negative index wraps round to one beyond the end.
        const std::size_t target_j = j + static_cast<std::size_t>(offset.dj);
        const std::size_t target_k = k + static_cast<std::size_t>(offset.dk);
        if (target_j >= seeds.nj() || target_k >= seeds.nk()) {
            continue;
        }
        BitWord* target = spread.row(target_j, target_k);
        const BitWord* from = scratch.data();
        for (std::size_t w = 0; w < words; ++w) {
            target[w] |= from[w];
        }
    }
}

BitRows Neighbourhood::spread(const BitRows& seeds) const {
    BitRows result({seeds.nk(), seeds.nj(), seeds.ni()});
    std::vector<BitWord> scratch(seeds.words());
    for (std::size_t k = 0; k < seeds.nk(); ++k) {
        const std::vector<RowOffsets>& offsets = offsets_[parity_ ? k % 2 : 0];
        for (std::size_t j = 0; j < seeds.nj(); ++j) {
            const BitWord* row = seeds.row(j, k);
            if (std::all_of(row, row + seeds.words(), [](BitWord word) { return word == 0; })) {
                continue;
            }
            for (const RowOffsets& group : offsets) {
                spread_row(seeds, j, k, group, scratch, result);
            }
        }
    }
    return result;
}

} // namespace sheetsplat

// Which samples of a lattice are near enough to share a visible point, and spreading bits over them.
#pragma once

#include <array>
#include <cstddef>
#include <vector>

#include "index/bit_rows.hpp"
#include "sheetsplat/field.hpp"

namespace sheetsplat {

/// The set of offsets s - h between two samples for which there are points x and y, at most reach_world apart, with x
/// inside the support of h and y inside that of s: the sum of a ball of two radii in index space and a ball of
/// reach_world in world space. in_cells: x lies in a cell that has s as a corner, of a Cartesian lattice; a box takes
/// the place of one radius. Exact for BCC and for equal spacing; for unequal spacing a little more. Where it is many
/// samples wide, whole blocks of samples are decided together, which again can only add samples.
class Neighbourhood {
  public:
    /// reach_world >= 0, infinite allowed.
    Neighbourhood(const RegularField& field, double reach_world, bool in_cells = false);

    /// Samples in a block: {in k, in j, in i}; {1, 1, 1} unless the neighbourhood is wide.
    [[nodiscard]] const std::array<std::size_t, 3>& block() const { return block_; }
    /// Number of blocks: {in k, in j, in i}.
    [[nodiscard]] const std::array<std::size_t, 3>& blocks() const { return blocks_; }
    /// A bit for each block: set where a set bit of `seeds` lies in the neighbourhood. seeds: shape blocks().
    [[nodiscard]] BitRows spread(const BitRows& seeds) const;

  private:
    /// How the rows of the source and of the target are shifted against each other along i (bcc).
    enum class Shift { none, target_half_up, target_half_down };
    /// A bit at i reaches the bits of row (j + dj, k + dk) from i - half to i + half; shifted by a half, to one sample
    /// more on the side where the target's samples are nearer.
    struct RowOffset {
        std::ptrdiff_t dk, dj;
        std::size_t half;
    };
    struct RowOffsets {
        Shift shift = Shift::none;
        std::vector<RowOffset> rows; ///< by ascending half
    };

    [[nodiscard]] bool holds(const Vec3& offset) const;
    [[nodiscard]] RowOffsets offsets_of(Shift shift, bool odd_layers) const;
    void spread_row(const BitRows& seeds, std::size_t j, std::size_t k, const RowOffsets& offsets,
                    std::vector<BitWord>& scratch, BitRows& spread) const;

    Lattice lattice_;
    double radii_;     ///< of the ball, index units (bcc: of a)
    double box_ = 0.0; ///< half an edge of the box, same units
    Vec3 reach_;       ///< reach_world along each axis, same units
    std::array<std::size_t, 3> block_{1, 1, 1};
    std::array<std::size_t, 3> blocks_{};
    bool parity_ = false;                            ///< bcc, layer by layer: odd layers are shifted by half a cell
    std::array<std::vector<RowOffsets>, 2> offsets_; ///< for even and odd k of the source; the same unless parity_
};

} // namespace sheetsplat

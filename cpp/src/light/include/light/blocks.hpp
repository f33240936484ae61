// What numbers occur in blocks of a light volume, and where it is 0 all around: lines through it need not look at each
// element.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "sheetsplat/light_volume.hpp"
#include "sheetsplat/types.hpp"

namespace sheetsplat {

/// Blocks of 4 x 4 x 4 cells, the elements on their faces included: a number looked up at a place in a block lies in
/// the block's range.
class LightBlocks {
  public:
    struct Range {
        float least, greatest;
    };

    explicit LightBlocks(const LightVolume& volume);

    /// The block of a place, in elements of the volume. Outside: that of the nearest face.
    [[nodiscard]] std::size_t at(const Vec3& place) const {
        std::size_t block = 0;
        for (std::size_t axis = 3; axis-- > 0;) {
            const double last = static_cast<double>(counts_[axis] - 1);
            const double inside = 0.25 * place[static_cast<int>(axis)];
            const double clamped = inside > 0.0 ? (inside < last ? inside : last) : 0.0;
            block = block * counts_[axis] + static_cast<std::size_t>(clamped);
        }
        return block;
    }
    [[nodiscard]] const std::vector<Range>& ranges() const { return ranges_; }

  private:
    std::array<std::size_t, 3> counts_{1, 1, 1};
    std::vector<Range> ranges_;
};

/// Cells of a volume around which all is 0: the elements of their corners, and the next ones beyond.
class ClearCells {
  public:
    explicit ClearCells(const LightVolume& volume);

    /// Of the cell of a place, in elements of the volume. Outside: that of the nearest face.
    [[nodiscard]] bool at(const Vec3& place) const {
        std::size_t cell[3];
        for (int axis = 0; axis < 3; ++axis) {
            const double inside = place[axis], last = last_[axis];
            cell[axis] = static_cast<std::size_t>(inside > 0.0 ? (inside < last ? inside : last) : 0.0);
        }
        return ((matter_[(cell[2] * rows_ + cell[1]) * words_ + cell[0] / 64] >> (cell[0] % 64)) & 1U) == 0;
    }

  private:
    Vec3 last_{0.0};                    ///< number of the last cell along each axis
    std::size_t words_ = 1, rows_ = 1;  ///< of a row; of a layer
    std::vector<std::uint64_t> matter_; ///< a bit a cell
};

} // namespace sheetsplat

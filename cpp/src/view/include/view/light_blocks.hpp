// What numbers occur in blocks of a light volume, so that lines through it need not look at each element.
#pragma once

#include <array>
#include <cstddef>
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

} // namespace sheetsplat

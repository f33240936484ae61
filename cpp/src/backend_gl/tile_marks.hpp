// Which squares of a tile the splats of the last batches touched: what is not touched need not be shaded.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "view/slab_batches.hpp"

namespace sheetsplat::backend_gl {

/// A rectangle of pixels as the rectangle shader reads it.
using Rectangle = std::array<float, 4>;

class TileMarks {
  public:
    /// batches: how many of the newest batches count.
    TileMarks(const Tile& tile, int batches);

    /// Starts a new batch; the oldest is forgotten.
    void next_batch();
    /// Marks the squares that a box meets.
    void touch(const PixelBox& box);
    /// The inside of the tile where any of the last batches touched it, in as few rectangles as rows of squares allow.
    [[nodiscard]] std::vector<Rectangle> touched() const;
    /// The whole inside.
    [[nodiscard]] std::vector<Rectangle> whole() const;

  private:
    Tile tile_;
    int columns_, rows_;
    std::vector<std::vector<std::uint8_t>> marks_;
    std::size_t newest_ = 0;
};

} // namespace sheetsplat::backend_gl

#include "tile_marks.hpp"

#include <algorithm>

#include "interop.h"

namespace sheetsplat::backend_gl {

TileMarks::TileMarks(const Tile& tile, int batches)
    : tile_(tile), columns_((tile.target_width() + TILE_EDGE - 1) / TILE_EDGE),
      rows_((tile.target_height() + TILE_EDGE - 1) / TILE_EDGE),
      marks_(static_cast<std::size_t>(batches),
             std::vector<std::uint8_t>(static_cast<std::size_t>(columns_) * static_cast<std::size_t>(rows_), 0)) {}

void TileMarks::next_batch() {
    newest_ = (newest_ + 1) % marks_.size();
    std::fill(marks_[newest_].begin(), marks_[newest_].end(), std::uint8_t{0});
}

void TileMarks::touch(const PixelBox& box) {
    auto& marks = marks_[newest_];
    const int last_column = (box.x1 - 1) / TILE_EDGE;
    const int last_row = (box.y1 - 1) / TILE_EDGE;
    for (int row = box.y0 / TILE_EDGE; row <= last_row; ++row) {
        for (int column = box.x0 / TILE_EDGE; column <= last_column; ++column) {
            marks[static_cast<std::size_t>(row) * static_cast<std::size_t>(columns_) +
                  static_cast<std::size_t>(column)] = 1;
        }
    }
}

std::vector<Rectangle> TileMarks::touched() const {
    std::vector<Rectangle> rectangles;
    const auto right = static_cast<float>(Tile::border + tile_.width);
    const auto bottom = static_cast<float>(Tile::border + tile_.height);
    const auto first = static_cast<float>(Tile::border);
    for (int row = 0; row < rows_; ++row) {
        int start = -1;
        for (int column = 0; column <= columns_; ++column) {
            bool marked = false;
            for (const auto& marks : marks_) {
                marked = marked || (column < columns_ &&
                                    marks[static_cast<std::size_t>(row) * static_cast<std::size_t>(columns_) +
                                          static_cast<std::size_t>(column)] != 0);
            }
            if (marked && start < 0) {
                start = column;
            } else if (!marked && start >= 0) {
                const Rectangle box{std::max(first, static_cast<float>(start * TILE_EDGE)),
                                    std::max(first, static_cast<float>(row * TILE_EDGE)),
                                    std::min(right, static_cast<float>(column * TILE_EDGE)),
                                    std::min(bottom, static_cast<float>((row + 1) * TILE_EDGE))};
                if (box[0] < box[2] && box[1] < box[3]) {
                    rectangles.push_back(box);
                }
                start = -1;
            }
        }
    }
    return rectangles;
}

std::vector<Rectangle> TileMarks::whole() const {
    const auto first = static_cast<float>(Tile::border);
    return {{first, first, static_cast<float>(Tile::border + tile_.width),
             static_cast<float>(Tile::border + tile_.height)}};
}

} // namespace sheetsplat::backend_gl

// Drawn samples in depth order: which kernels are drawn for which slab ([NM05] sections 4.2 and 4.5).
#pragma once

#include <algorithm>
#include <cstdint>
#include <variant>
#include <vector>

#include "index/visible_runs.hpp"
#include "view/counting.hpp"
#include "view/field_view.hpp"

namespace sheetsplat {

/// How slabs are grouped. A batch starts every `stride` slabs; what is drawn for it covers `covered` slabs from its
/// first one on. wide: 4 and 8 (two RGBA targets); paper: 1 and 4 (one RGBA target whose order rotates); one channel: 1
/// and 1.
struct BatchLayout {
    int stride = 4;
    int covered = 8;
};

/// Linear sample indices (k * nj + j) * ni + i, batch by batch. A kernel stands in the batch of its first slab, and
/// again every covered / stride batches while it reaches further: so no slab is drawn twice.
class SlabBatches {
  public:
    /// Counting sort in two passes over the runs; at most 4 bytes an entry are kept. wider: slices before a kernel's
    /// first and after its last one for which it is drawn too (differences over depth reach one further). Throws
    /// OutOfMemory.
    static SlabBatches of(const FieldView& view, const VisibleRuns& runs, const Frame& frame, Sampling sampling,
                          BatchLayout layout, int wider = 0);

    [[nodiscard]] std::size_t batches() const { return offset_.empty() ? 0 : offset_.size() - 1; }
    [[nodiscard]] const std::uint32_t* begin(std::size_t batch) const { return entries_.data() + offset_[batch]; }
    [[nodiscard]] const std::uint32_t* end(std::size_t batch) const { return entries_.data() + offset_[batch + 1]; }
    [[nodiscard]] std::size_t count(std::size_t batch) const { return offset_[batch + 1] - offset_[batch]; }
    [[nodiscard]] std::size_t entries() const { return entries_.size(); }
    /// Kernels that stand in some batch, each counted once.
    [[nodiscard]] std::size_t kernels() const { return kernels_; }
    [[nodiscard]] std::size_t bytes() const;

  private:
    std::vector<std::size_t> offset_;
    std::vector<std::uint32_t> entries_;
    std::size_t kernels_ = 0;
};

/// What the GPU gets for one kernel: 16 bytes.
struct SplatVertex {
    float x, y;  ///< pixels in the tile's targets: of the centre (orthographic), of the centre's ray at the reference
                 ///< depth (perspective)
    float s;     ///< height of the batch's first slice in the kernel's unit sphere: (t_k - t_first) / h
    float value; ///< sample times FieldView::value_scale, or as Counting says
};

/// A rectangle of the picture with the border of one pixel that gradients need.
struct Tile {
    int x = 0, y = 0;          ///< first pixel in the picture
    int width = 0, height = 0; ///< without the border
    static constexpr int border = 1;
    [[nodiscard]] int target_width() const { return width + 2 * border; }
    [[nodiscard]] int target_height() const { return height + 2 * border; }
};

/// Pixels that a kernel of a batch can touch, in the tile's targets; empty where it touches none.
struct PixelBox {
    int x0 = 0, y0 = 0, x1 = 0, y1 = 0; ///< x0 <= x < x1
    [[nodiscard]] bool empty() const { return x0 >= x1 || y0 >= y1; }
};

/// The pixels of a tile's targets whose centres may lie between these edges.
[[nodiscard]] PixelBox pixels_between(double left, double right, double top, double bottom, const Tile& tile);

/// Makes the vertices of a batch for a tile. One template instance per sample type.
class VertexMaker {
  public:
    /// wider_px: pixels by which every box is larger than the kernel (differences between neighbours reach one
    /// further).
    VertexMaker(const FieldView& view, const Frame& frame, const Tile& tile, BatchLayout layout, int wider_px = 0,
                const Counting& counting = {});

    /// Writes a vertex for each of the samples that reach into the tile, calls touch(box, sample) with the pixels it
    /// can touch and its index, and drops it where touch returns false. Returns how many were written to `out` (room
    /// for `count`), and their boxes to `boxes` unless null.
    template <class Touch>
    std::size_t make(const std::uint32_t* samples, std::size_t count, std::int64_t first_slab, SplatVertex* out,
                     PixelBox* boxes, Touch&& touch) const;

    /// Largest half-size of any vertex's box in pixels: the radius of a point sprite. Orthographic: the same for all.
    [[nodiscard]] double half_size() const { return std::max(half_x_, half_y_); }
    /// Where the optical axis meets the tile's targets, pixels.
    [[nodiscard]] double origin_x() const { return origin_x_; }
    [[nodiscard]] double origin_y() const { return origin_y_; }
    [[nodiscard]] double half_x() const { return half_x_; }
    [[nodiscard]] double half_y() const { return half_y_; }

  private:
    struct Placed {
        SplatVertex vertex;
        PixelBox box;
    };
    [[nodiscard]] Placed place(const Vec3& eye, double value, double first_depth, double last_depth) const;

    const FieldView* view_;
    const Frame* frame_;
    Tile tile_;
    BatchLayout layout_;
    double wider_; ///< pixels
    Counting counting_;
    double half_x_, half_y_;     ///< orthographic: pixels
    double origin_x_, origin_y_; ///< of the optical axis in the tile's targets, pixels
};

template <class Touch>
std::size_t VertexMaker::make(const std::uint32_t* samples, std::size_t count, std::int64_t first_slab,
                              SplatVertex* out, PixelBox* boxes, Touch&& touch) const {
    const auto& shape = view_->field->shape();
    const auto ni = static_cast<std::uint32_t>(shape[2]);
    const auto nj = static_cast<std::uint32_t>(shape[1]);
    const double base = view_->field->counted_from();
    const double first_depth = frame_->depth_of(first_slab);
    const double last_depth =
        frame_->depth_of(std::min<std::int64_t>(first_slab + layout_.covered, frame_->slices) - 1);
    return std::visit(
        [&](const auto& data) {
            std::size_t written = 0;
            for (std::size_t entry = 0; entry < count; ++entry) {
                const std::uint32_t sample = samples[entry];
                const std::uint32_t row = sample / ni, i = sample - row * ni, j = row % nj, k = row / nj;
                const double value = static_cast<double>(data[view_->field->row(j, k) + i]) - base;
                const Placed placed = place(view_->eye_position(i, j, k), value, first_depth, last_depth);
                if (!placed.box.empty() && touch(placed.box, sample)) {
                    out[written] = placed.vertex;
                    if (boxes != nullptr) {
                        boxes[written] = placed.box;
                    }
                    ++written;
                }
            }
            return written;
        },
        view_->field->samples());
}

} // namespace sheetsplat

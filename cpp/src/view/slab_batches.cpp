#include "view/slab_batches.hpp"

#include <algorithm>
#include <cmath>

#include "base/memory.hpp"

namespace sheetsplat {

namespace {

/// Of the depth that a kernel reaches in a batch; glsl/splat.vert has it too.
constexpr double nearest_reference = 0.6;

/// First and last slice that a kernel at a depth meets; first > last where it meets none.
class SliceSpan {
  public:
    SliceSpan(const FieldView& view, const Frame& frame, Sampling sampling, int wider)
        : per_depth_(1.0 / frame.slice_spacing), last_slice_(frame.slices - 1) {
        // A slab reaches half a spacing to both sides of its slice.
        const double reach = view.half_depth * per_depth_ + (sampling == Sampling::slab ? 0.5 : 0.0) + wider;
        lower_ = -frame.first_depth * per_depth_ - reach;
        upper_ = -frame.first_depth * per_depth_ + reach;
    }

    [[nodiscard]] std::int64_t first(double depth) const {
        const double at = depth * per_depth_ + lower_;
        if (at <= 0.0) {
            return 0;
        }
        const auto whole = static_cast<std::int64_t>(at);
        return whole + (static_cast<double>(whole) < at ? 1 : 0);
    }

    [[nodiscard]] std::int64_t last(double depth) const {
        const double at = depth * per_depth_ + upper_;
        return at < 0.0 ? -1 : std::min(static_cast<std::int64_t>(at), last_slice_);
    }

  private:
    double per_depth_, lower_ = 0.0, upper_ = 0.0;
    std::int64_t last_slice_;
};

/// Rows that lie outside the picture as a whole are skipped; single samples are sorted out when vertices are made.
bool row_outside(const FieldView& view, const Frame& frame, const Vec3& a, const Vec3& b) {
    if (frame.projection == Projection::orthographic) {
        // The border's far edges.
        const double left = frame.eye_x(-1.5), right = frame.eye_x(frame.size.width + 0.5);
        const double top = frame.eye_y(-1.5), bottom = frame.eye_y(frame.size.height + 0.5);
        return std::min(a.x, b.x) > right + view.extent_x || std::max(a.x, b.x) < left - view.extent_x ||
               std::min(a.y, b.y) > top + view.extent_y || std::max(a.y, b.y) < bottom - view.extent_y;
    }
    return false;
}

/// Calls visit(sample index, first slice, last slice) for every drawn sample that meets a slice.
template <class Visit>
void for_each_span(const FieldView& view, const VisibleRuns& runs, const Frame& frame, Sampling sampling, int wider,
                   Visit&& visit) {
    const auto& shape = view.field->shape();
    const SliceSpan span(view, frame, sampling, wider);
    const double depth_step = -view.step_i.z;
    for (std::size_t row = 0; row < runs.rows(); ++row) {
        const Run* end = runs.end(row);
        for (const Run* run = runs.begin(row); run != end; ++run) {
            const std::size_t j = row % shape[1];
            const std::size_t k = row / shape[1];
            const Vec3 start = view.eye_position(run->begin, j, k);
            if (row_outside(view, frame, start, view.eye_position(run->end - 1, j, k))) {
                continue;
            }
            const auto base = static_cast<std::uint32_t>(row * shape[2]);
            const double depth = -start.z;
            for (std::uint32_t i = run->begin; i < run->end; ++i) {
                const double at = depth + static_cast<double>(i - run->begin) * depth_step;
                const std::int64_t first = span.first(at);
                const std::int64_t last = span.last(at);
                if (first <= last) {
                    visit(base + i, first, last);
                }
            }
        }
    }
}

} // namespace

SlabBatches SlabBatches::of(const FieldView& view, const VisibleRuns& runs, const Frame& frame, Sampling sampling,
                            BatchLayout layout, int wider) {
    SlabBatches result;
    if (frame.slices == 0) {
        return result;
    }
    const auto batches = static_cast<std::size_t>((frame.slices + layout.stride - 1) / layout.stride);
    require_memory(static_cast<std::uint64_t>(batches + 1) * sizeof(std::size_t), "the batches of a view",
                   "use a larger " + option_ref("slice_spacing"));
    result.offset_.assign(batches + 1, 0);
    const std::int64_t again = layout.covered / layout.stride;
    // The divisions by stride and covered are shifts in the usual layouts: spelled out for the compiler, which cannot
    // know.
    const auto batch_of = [&](std::int64_t slice) { return layout.stride == 4 ? slice >> 2 : slice / layout.stride; };

    std::size_t kernels = 0;
    for_each_span(view, runs, frame, sampling, wider, [&](std::uint32_t, std::int64_t first, std::int64_t last) {
        ++kernels;
        for (std::int64_t batch = batch_of(first); batch * layout.stride <= last; batch += again) {
            ++result.offset_[static_cast<std::size_t>(batch) + 1];
        }
    });
    for (std::size_t batch = 0; batch < batches; ++batch) {
        result.offset_[batch + 1] += result.offset_[batch];
    }
    require_memory(result.offset_.back() * sizeof(std::uint32_t), "the kernels of a view, sorted by depth",
                   "use a larger " + option_ref("slice_spacing") + ", or a transfer function that shows less");
    result.entries_.resize(result.offset_.back());
    std::vector<std::size_t> next(result.offset_.begin(), result.offset_.end() - 1);
    for_each_span(view, runs, frame, sampling, wider, [&](std::uint32_t sample, std::int64_t first, std::int64_t last) {
        for (std::int64_t batch = batch_of(first); batch * layout.stride <= last; batch += again) {
            result.entries_[next[static_cast<std::size_t>(batch)]++] = sample;
        }
    });
    result.kernels_ = kernels;
    return result;
}

std::size_t SlabBatches::bytes() const {
    return offset_.capacity() * sizeof(std::size_t) + entries_.capacity() * sizeof(std::uint32_t);
}

PixelBox pixels_between(double left, double right, double top, double bottom, const Tile& tile) {
    const auto pixel = [](double at, int limit) { return at <= 0.0 ? 0 : at >= limit ? limit : static_cast<int>(at); };
    PixelBox box;
    box.x0 = pixel(left - 0.5, tile.target_width());
    box.y0 = pixel(top - 0.5, tile.target_height());
    box.x1 = right < 0.0 ? 0 : pixel(right + 1.5, tile.target_width());
    box.y1 = bottom < 0.0 ? 0 : pixel(bottom + 1.5, tile.target_height());
    return box;
}

VertexMaker::VertexMaker(const FieldView& view, const Frame& frame, const Tile& tile, BatchLayout layout, int wider_px,
                         const Counting& counting)
    : view_(&view), frame_(&frame), tile_(tile), layout_(layout), wider_(wider_px), counting_(counting) {
    half_x_ = view.extent_x / frame.pixel + wider_;
    half_y_ = view.extent_y / frame.pixel + wider_;
    origin_x_ = frame.axis_x - tile.x + Tile::border;
    origin_y_ = frame.axis_y - tile.y + Tile::border;
}

VertexMaker::Placed VertexMaker::place(const Vec3& eye, double value, double first_depth, double last_depth) const {
    const FieldView& view = *view_;
    const double depth = -eye.z;
    double x = 0.0, y = 0.0, left = 0.0, right = 0.0, top = 0.0, bottom = 0.0;
    if (frame_->projection == Projection::orthographic) {
        x = eye.x / frame_->pixel + origin_x_;
        y = origin_y_ - eye.y / frame_->pixel;
        left = x - half_x_;
        right = x + half_x_;
        top = y - half_y_;
        bottom = y + half_y_;
    } else {
        // The centre's ray is taken where the kernel is sliced, so that a kernel beside or behind the eye has one too;
        // but not so close to the eye that its place on the screen would run off with its digits.
        const double last_slice = first_depth + (layout_.covered - 1) * frame_->slice_spacing;
        const double reference = std::max(std::clamp(depth, first_depth, last_slice),
                                          nearest_reference * std::min(depth + view.half_depth, last_slice));
        x = eye.x / (reference * frame_->pixel) + origin_x_;
        y = origin_y_ - eye.y / (reference * frame_->pixel);
        const double nearest = std::max(depth - view.half_depth, first_depth - view.slab_half);
        const double farthest = std::max(std::min(depth + view.half_depth, last_depth + view.slab_half), nearest);
        if (nearest <= 1e-9 * frame_->slice_spacing) {
            // A whole slab counts where its middle lies behind the near plane: it can reach through the eye, where
            // every ray starts.
            left = top = 0.0;
            right = tile_.target_width();
            bottom = tile_.target_height();
        } else {
            // (c +- e) / t is monotonic in t, so that the extremes lie at the nearest or farthest depth that is drawn.
            const auto lowest = [&](double edge) { return std::min(edge / nearest, edge / farthest) / frame_->pixel; };
            const auto highest = [&](double edge) { return std::max(edge / nearest, edge / farthest) / frame_->pixel; };
            left = origin_x_ + lowest(eye.x - view.extent_x) - wider_;
            right = origin_x_ + highest(eye.x + view.extent_x) + wider_;
            top = origin_y_ - highest(eye.y + view.extent_y) - wider_;
            bottom = origin_y_ - lowest(eye.y - view.extent_y) + wider_;
        }
    }
    Placed placed;
    placed.vertex.x = static_cast<float>(x);
    placed.vertex.y = static_cast<float>(y);
    placed.vertex.s = static_cast<float>((depth - first_depth) / view.half_depth);
    placed.vertex.value = counting_.amount(value, static_cast<float>(view.weight_scale), value * view.value_scale);
    placed.box = pixels_between(left, right, top, bottom, tile_);
    return placed;
}

} // namespace sheetsplat

#include "backend_cpu/tile_feed.hpp"
#include "backend_cpu/measured.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <utility>

#include <glm/geometric.hpp>

#include "base/memory.hpp"
#include "plan/limits_common.hpp"

namespace sheetsplat::backend_cpu {

namespace {

/// Calls visit(chunk, emit) for every chunk twice, first to count, then to write, chunks side by side: emit(tile,
/// item). Items stand in the order of their chunks, whatever the threads do.
template <class Item, class Visit>
Buckets<Item> bucket(std::size_t tiles, std::size_t chunks, ThreadPool& pool, const std::function<void()>& poll,
                     const char* what, const Visit& visit) {
    Buckets<Item> buckets;
    require_memory(checked_product(checked_product(tiles, chunks, what), sizeof(std::size_t), what), what,
                   "make the picture smaller");
    std::vector<std::size_t> places(tiles * chunks, 0);
    pool.run(
        chunks,
        [&](std::size_t chunk, int) {
            std::size_t* own = places.data() + chunk * tiles;
            visit(chunk, [&](std::size_t tile, const Item&) { ++own[tile]; });
        },
        poll);
    buckets.offset.resize(tiles + 1);
    std::size_t sum = 0;
    for (std::size_t tile = 0; tile < tiles; ++tile) {
        buckets.offset[tile] = sum;
        for (std::size_t chunk = 0; chunk < chunks; ++chunk) {
            const std::size_t count = places[chunk * tiles + tile];
            places[chunk * tiles + tile] = sum;
            sum += count;
        }
    }
    buckets.offset[tiles] = sum;
    require_memory(checked_product(sum, sizeof(Item), what), what,
                   "use a transfer function that shows less, or a smaller picture");
    buckets.items.resize(sum);
    pool.run(
        chunks,
        [&](std::size_t chunk, int) {
            std::size_t* own = places.data() + chunk * tiles;
            Item* items = buckets.items.data();
            visit(chunk, [&](std::size_t tile, const Item& item) { items[own[tile]++] = item; });
        },
        poll);
    return buckets;
}

/// Few enough that counts stay small, enough that threads share them evenly.
std::size_t chunks_for(std::size_t items, std::size_t tiles) {
    const std::size_t most = std::clamp<std::size_t>((std::size_t{1} << 22) / std::max<std::size_t>(tiles, 1), 1, 64);
    return std::clamp<std::size_t>(items / 1024, 1, most);
}

struct Samples {
    std::uint32_t begin, end;
};

/// A coordinate of samples, at + i step.
class Line {
  public:
    /// step: in any unit of length; what is too small for its inverse is 0.
    explicit Line(double step)
        : step_(step), per_step_(std::abs(step) >= std::numeric_limits<double>::min() ? 1.0 / step : 0.0) {}
    /// Samples i of begin ... end - 1 with low <= at + i step <= high.
    [[nodiscard]] Samples between(double at, double low, double high, std::uint32_t begin, std::uint32_t end) const {
        if (per_step_ == 0.0) {
            return at >= low && at <= high ? Samples{begin, end} : Samples{0, 0};
        }
        const double a = (low - at) * per_step_, b = (high - at) * per_step_;
        // Rounding must not lose a sample: one more on each side costs next to nothing. (Of numbers that are not
        // negative the integer part is the floor, which takes a function call here.)
        const auto clamped = [&](double sample) {
            return std::clamp(sample, static_cast<double>(begin), static_cast<double>(end));
        };
        const double from = clamped(std::min(a, b) - 1e-3), to = clamped(std::max(a, b) + (1.0 + 1e-3));
        auto first = static_cast<std::uint32_t>(from);
        first += static_cast<double>(first) < from ? 1U : 0U;
        const auto last = static_cast<std::uint32_t>(to);
        return first < last ? Samples{first, last} : Samples{0, 0};
    }
    [[nodiscard]] double step() const { return step_; }

  private:
    double step_, per_step_;
};

/// The smallest and largest x / t for x between low and high, and t between near and far, both > 0.
struct Interval {
    double low, high;
};
Interval over_depth(double low, double high, double near, double far) {
    return {std::min(low / near, low / far), std::max(high / near, high / far)};
}

} // namespace

TileLayout::Axis::Axis(int pixels_in, int largest) : pixels(pixels_in), tiles((pixels_in + largest - 1) / largest) {
    const auto held = static_cast<std::size_t>(pixels) + 2;
    first_of.assign(held, 0);
    last_of.assign(held, 0);
    for (int tile = 0; tile < tiles; ++tile) {
        // Pixels begin(tile) - 1 ... begin(tile + 1), each one further in the tables.
        for (int at = begin(tile); at <= begin(tile + 1) + 1; ++at) {
            last_of[static_cast<std::size_t>(at)] = tile;
        }
    }
    for (int tile = tiles - 1; tile >= 0; --tile) {
        for (int at = begin(tile); at <= begin(tile + 1) + 1; ++at) {
            first_of[static_cast<std::size_t>(at)] = tile;
        }
    }
}

TileLayout::TileLayout(Size size, int largest, std::vector<std::uint8_t> drawn)
    : across_(size.width, largest), down_(size.height, largest), drawn_(std::move(drawn)) {}

TileLayout TileLayout::only(std::vector<std::uint8_t> drawn) const {
    TileLayout layout = *this;
    layout.drawn_ = std::move(drawn);
    return layout;
}

TileShape TileLayout::shape(std::size_t tile) const {
    const int column = static_cast<int>(tile % static_cast<std::size_t>(columns()));
    const int row = static_cast<int>(tile / static_cast<std::size_t>(columns()));
    TileShape shape;
    shape.x = left(column);
    shape.y = top(row);
    shape.width = left(column + 1) - shape.x;
    shape.height = top(row + 1) - shape.y;
    const int wanted = shape.width + 2 + TileShape::padding;
    shape.stride = (wanted + TileShape::padding - 1) / TileShape::padding * TileShape::padding;
    return shape;
}

Buckets<RowPart> bucket_rows(const FieldView& view, const VisibleRuns& runs, const Frame& frame,
                             const TileLayout& layout, ThreadPool& pool, const std::function<void()>& poll) {
    const auto& shape = view.field->shape();
    const std::size_t rows = runs.rows();
    const std::size_t chunks = chunks_for(rows, layout.tiles());
    const bool perspective = frame.projection == Projection::perspective;
    const double axis_x = frame.axis_x, axis_y = frame.axis_y;
    const double half_x = view.extent_x / frame.pixel, half_y = view.extent_y / frame.pixel;
    const double first_depth = frame.depth_of(0) - view.slab_half;
    const double last_depth = frame.depth_of(frame.slices - 1) + view.slab_half;
    const auto tile_at = [&](int row, int column) {
        return static_cast<std::size_t>(row) * static_cast<std::size_t>(layout.columns()) +
               static_cast<std::size_t>(column);
    };
    const double per_pixel = 1.0 / frame.pixel;
    const Line line_x(view.step_i.x * per_pixel), line_y(-view.step_i.y * per_pixel);
    // Then short parts of rows are looked at, since all of one goes to every tile.
    const bool slabs_reach_the_eye = perspective && first_depth <= 1e-9 * frame.slice_spacing;

    const auto orthographic_row = [&](std::uint32_t row, std::uint32_t begin, std::uint32_t end, const auto& emit) {
        const Vec3 eye = view.eye_position(0, row % shape[1], row / shape[1]);
        const double x = eye.x * per_pixel + axis_x, y = axis_y - eye.y * per_pixel;
        const double dx = line_x.step(), dy = line_y.step();
        const double y_begin = y + begin * dy, y_end = y + (end - 1) * dy;
        const TileLayout::Range down =
            layout.down().between(std::min(y_begin, y_end) - half_y, std::max(y_begin, y_end) + half_y);
        for (int tile_row = down.first; tile_row <= down.last; ++tile_row) {
            const Samples in_row = line_y.between(y, layout.top(tile_row) - 0.5 - half_y,
                                                  layout.top(tile_row + 1) + 0.5 + half_y, begin, end);
            if (in_row.begin >= in_row.end) {
                continue;
            }
            const double x_begin = x + in_row.begin * dx, x_end = x + (in_row.end - 1) * dx;
            const TileLayout::Range across =
                layout.across().between(std::min(x_begin, x_end) - half_x, std::max(x_begin, x_end) + half_x);
            for (int tile_column = across.first; tile_column <= across.last; ++tile_column) {
                if (!layout.draws(tile_at(tile_row, tile_column))) {
                    continue;
                }
                const Samples here =
                    line_x.between(x, layout.left(tile_column) - 0.5 - half_x,
                                   layout.left(tile_column + 1) + 0.5 + half_x, in_row.begin, in_row.end);
                if (here.begin < here.end) {
                    emit(tile_at(tile_row, tile_column), RowPart{row, here.begin, here.end});
                }
            }
        }
    };
    // Of a row seen in perspective, with w the coordinate along one axis of the picture and t the depth: a support
    // meets the rays between w = low t and w = high t only if its centre is not farther from them than it reaches,
    // which along the row are bounds on linear functions. (The extent across a ray of slope f is at most extent + |f|
    // half_depth.)
    const auto between_rays = [&](double w, double step_w, double t, double step_t, double extent, double low,
                                  double high, const Samples& in) {
        constexpr double infinity = std::numeric_limits<double>::infinity();
        const Samples above =
            Line(step_w - low * step_t)
                .between(w - low * t, -(extent + std::abs(low) * view.half_depth), infinity, in.begin, in.end);
        return Line(step_w - high * step_t)
            .between(w - high * t, -infinity, extent + std::abs(high) * view.half_depth, above.begin, above.end);
    };
    const auto perspective_row = [&](std::uint32_t row, std::uint32_t begin, std::uint32_t end, const auto& emit) {
        const Vec3 first = view.eye_position(0, row % shape[1], row / shape[1]);
        const Samples deep =
            Line(-view.step_i.z)
                .between(-first.z, first_depth - view.half_depth, last_depth + view.half_depth, begin, end);
        if (deep.begin >= deep.end) {
            return;
        }
        const Vec3 a = first + static_cast<double>(deep.begin) * view.step_i;
        const Vec3 b = first + static_cast<double>(deep.end - 1) * view.step_i;
        const double near = std::max(std::min(-a.z, -b.z) - view.half_depth, first_depth);
        const double far = std::max(near, std::min(std::max(-a.z, -b.z) + view.half_depth, last_depth));
        // A whole slab counts where its middle lies behind the near plane: it can reach through the eye, where every
        // ray starts.
        const bool through_eye = near <= 1e-9 * frame.slice_spacing;
        TileLayout::Range across{0, layout.columns() - 1}, down{0, layout.rows() - 1};
        if (!through_eye) {
            const Interval x =
                over_depth(std::min(a.x, b.x) - view.extent_x, std::max(a.x, b.x) + view.extent_x, near, far);
            const Interval y =
                over_depth(std::min(-a.y, -b.y) - view.extent_y, std::max(-a.y, -b.y) + view.extent_y, near, far);
            across = layout.across().between(x.low / frame.pixel + axis_x - 1e-3, x.high / frame.pixel + axis_x + 1e-3);
            down = layout.down().between(y.low / frame.pixel + axis_y - 1e-3, y.high / frame.pixel + axis_y + 1e-3);
        }
        for (int tile_row = down.first; tile_row <= down.last; ++tile_row) {
            const Samples in_row = through_eye
                                       ? deep
                                       : between_rays(-first.y, -view.step_i.y, -first.z, -view.step_i.z, view.extent_y,
                                                      (layout.top(tile_row) - 0.5 - axis_y) * frame.pixel,
                                                      (layout.top(tile_row + 1) + 0.5 - axis_y) * frame.pixel, deep);
            for (int tile_column = across.first; in_row.begin < in_row.end && tile_column <= across.last;
                 ++tile_column) {
                if (!layout.draws(tile_at(tile_row, tile_column))) {
                    continue;
                }
                const Samples here =
                    through_eye ? deep
                                : between_rays(first.x, view.step_i.x, -first.z, -view.step_i.z, view.extent_x,
                                               (layout.left(tile_column) - 0.5 - axis_x) * frame.pixel,
                                               (layout.left(tile_column + 1) + 0.5 - axis_x) * frame.pixel, in_row);
                if (here.begin < here.end) {
                    emit(tile_at(tile_row, tile_column), RowPart{row, here.begin, here.end});
                }
            }
        }
    };
    return bucket<RowPart>(layout.tiles(), chunks, pool, poll, "the rows of a lattice, sorted by tiles",
                           [&](std::size_t chunk, const auto& emit) {
                               const std::size_t first = rows * chunk / chunks, past = rows * (chunk + 1) / chunks;
                               for (std::size_t row = first; row < past; ++row) {
                                   if (runs.begin(row) == runs.end(row)) {
                                       continue;
                                   }
                                   const auto number = static_cast<std::uint32_t>(row);
                                   const std::uint32_t begin = runs.begin(row)->begin, end = (runs.end(row) - 1)->end;
                                   if (!perspective) {
                                       orthographic_row(number, begin, end, emit);
                                       continue;
                                   }
                                   if (slabs_reach_the_eye) {
                                       for (std::uint32_t part = begin; part < end; part += part_length) {
                                           perspective_row(number, part, std::min(part + part_length, end), emit);
                                       }
                                   } else {
                                       perspective_row(number, begin, end, emit);
                                   }
                               }
                           });
}

Buckets<std::uint32_t> bucket_kernels(const EllipsoidView& view, const std::vector<std::uint8_t>& visible,
                                      const TileLayout& layout, RectsFunction rects, ThreadPool& pool,
                                      const std::function<void()>& poll) {
    const std::size_t kernels = visible.size();
    const std::size_t chunks = chunks_for(kernels, layout.tiles());
    const auto columns = static_cast<std::size_t>(layout.columns());
    const char* what = "the kernels of a view, sorted by tiles";
    require_memory(checked_product(kernels, sizeof(TileRect), what), what, "draw fewer kernels");
    const std::unique_ptr<TileRect[]> found(new TileRect[kernels]);
    const auto begin = [&](std::size_t chunk) { return kernels * chunk / chunks; };
    pool.run(
        chunks,
        [&](std::size_t chunk, int) { rects(view, visible, layout, begin(chunk), begin(chunk + 1), found.get()); },
        poll);
    return bucket<std::uint32_t>(layout.tiles(), chunks, pool, poll, what, [&](std::size_t chunk, const auto& emit) {
        for (std::size_t i = begin(chunk); i < begin(chunk + 1); ++i) {
            const TileRect& rect = found[i];
            for (std::int32_t row = rect.rows.first; row <= rect.rows.last; ++row) {
                for (std::int32_t column = rect.columns.first; column <= rect.columns.last; ++column) {
                    const std::size_t tile = static_cast<std::size_t>(row) * columns + static_cast<std::size_t>(column);
                    if (layout.draws(tile)) {
                        emit(tile, static_cast<std::uint32_t>(i));
                    }
                }
            }
        }
    });
}

double picture_error(const TileLayout& layout, const std::vector<double>& errors) {
    double squares = 0.0, pixels = 0.0;
    for (std::size_t tile = 0; tile < errors.size(); ++tile) {
        if (layout.draws(tile)) {
            const double own = layout.shape(tile).pixels();
            squares += own * errors[tile] * errors[tile];
            pixels += own;
        }
    }
    return pixels > 0.0 ? std::sqrt(squares / pixels) : 0.0;
}

std::vector<std::uint8_t> doubtful_tiles(const TileLayout& layout, const std::vector<double>& errors, double bound) {
    std::vector<std::uint8_t> doubtful(errors.size(), 0);
    std::vector<std::size_t> order;
    double pixels = 0.0;
    for (std::size_t tile = 0; tile < errors.size(); ++tile) {
        if (layout.draws(tile)) {
            order.push_back(tile);
            pixels += layout.shape(tile).pixels();
        }
    }
    // (What is no number is beyond every bound: it comes last.)
    const auto key = [&](std::size_t tile) {
        return std::isnan(errors[tile]) ? std::numeric_limits<double>::infinity() : errors[tile];
    };
    std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) { return key(a) < key(b); });
    double squares = 0.0;
    for (const std::size_t tile : order) {
        squares += layout.shape(tile).pixels() / pixels * errors[tile] * errors[tile];
        doubtful[tile] = squares <= bound * bound && errors[tile] <= most_of_a_tile * bound ? 0 : 1;
    }
    return doubtful;
}

double error_of_extremes(const DrawPlan& plan, const std::vector<float>& shown, double epsilon) {
    double largest = 1.0;
    for (const float number : shown) {
        largest = std::isfinite(number) ? std::max(largest, std::abs(static_cast<double>(number))) : largest;
    }
    return plan.extremes_rounding * epsilon / largest;
}

} // namespace sheetsplat::backend_cpu

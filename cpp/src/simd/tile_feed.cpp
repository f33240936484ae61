#include "simd/tile_feed.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include <glm/geometric.hpp>

#include "base/memory.hpp"

namespace sheetsplat::simd {

namespace {

/// A weight of 0 still reaches: what it leaves in the sheets tells a point that is 0 from one that is empty.
constexpr double least_weight = 1e-30;
/// Samples of a row that are sorted together in perspective.
constexpr std::uint32_t part_length = 32;

/// Calls visit(chunk, emit) for every chunk twice, first to count, then to write, chunks side by side: emit(tile, item).
/// Items stand in the order of their chunks, whatever the threads do.
template <class Item, class Visit>
Buckets<Item> bucket(std::size_t tiles, std::size_t chunks, ThreadPool& pool, const char* what, const Visit& visit) {
    Buckets<Item> buckets;
    require_memory(checked_product(checked_product(tiles, chunks, what), sizeof(std::size_t), what), what,
                   "make the picture smaller");
    std::vector<std::size_t> places(tiles * chunks, 0);
    pool.run(chunks, [&](std::size_t chunk, int) {
        std::size_t* own = places.data() + chunk * tiles;
        visit(chunk, [&](std::size_t tile, const Item&) { ++own[tile]; });
    });
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
    pool.run(chunks, [&](std::size_t chunk, int) {
        std::size_t* own = places.data() + chunk * tiles;
        Item* items = buckets.items.data();
        visit(chunk, [&](std::size_t tile, const Item& item) { items[own[tile]++] = item; });
    });
    return buckets;
}

/// Few enough that counts stay small, enough that threads share them evenly.
std::size_t chunks_for(std::size_t items, std::size_t tiles) {
    const std::size_t most = std::clamp<std::size_t>((std::size_t{1} << 22) / std::max<std::size_t>(tiles, 1), 1, 64);
    return std::clamp<std::size_t>(items / 1024, 1, most);
}

/// Places on the screen of a lattice's kernels in an orthographic view, pixels of the picture.
struct ScreenLine {
    double x, y;           ///< of sample 0 of a row
    double step_x, step_y; ///< from sample to sample
};

/// Samples i of 0 ... count - 1 with low <= at + i step <= high.
struct Samples {
    std::uint32_t begin, end;
};
Samples samples_between(double at, double step, double low, double high, std::uint32_t begin, std::uint32_t end) {
    if (step == 0.0) {
        return at >= low && at <= high ? Samples{begin, end} : Samples{0, 0};
    }
    double from = (low - at) / step, to = (high - at) / step;
    if (from > to) {
        std::swap(from, to);
    }
    // A sample more on each side costs nothing; one that is missing would be seen.
    from = std::clamp(std::ceil(from - 1e-3), static_cast<double>(begin), static_cast<double>(end));
    to = std::clamp(std::floor(to + 1e-3) + 1.0, static_cast<double>(begin), static_cast<double>(end));
    const auto first = static_cast<std::uint32_t>(from), last = static_cast<std::uint32_t>(to);
    return first < last ? Samples{first, last} : Samples{0, 0};
}

/// The smallest and largest x / t for x between low and high, and t between near and far, both > 0.
struct Interval {
    double low, high;
};
Interval over_depth(double low, double high, double near, double far) {
    return {std::min(low / near, low / far), std::max(high / near, high / far)};
}

/// Turns the plane coordinates of a unit sphere so that pixels of a row change the first one alone.
struct RowBasis {
    double X, Y1, Y2;
    glm::dvec2 q1, q2;
    /// along_x, along_y: change of the plane coordinates from pixel to pixel (perspective: per unit of depth).
    RowBasis(const glm::dvec2& along_x, const glm::dvec2& along_y) {
        X = glm::length(along_x);
        q1 = along_x / X;
        q2 = glm::dvec2(-q1.y, q1.x);
        Y1 = glm::dot(q1, along_y);
        Y2 = glm::dot(q2, along_y);
    }
};

/// Where the tile's first sheet pixel looks: eye x and y, per unit of depth in perspective.
glm::dvec2 origin_of(const TileShape& tile, const Frame& frame) {
    return {(tile.x - 0.5 - 0.5 * frame.size.width) * frame.pixel,
            (0.5 * frame.size.height - tile.y + 0.5) * frame.pixel};
}

/// Pixels of the tile's sheets whose centres lie between two places.
struct PixelRange {
    std::int16_t first, end;
};
PixelRange pixels_between(double low, double high, int limit) {
    const double from = std::clamp(std::ceil(low), 0.0, static_cast<double>(limit));
    const double to = std::clamp(std::floor(high) + 1.0, 0.0, static_cast<double>(limit));
    return {static_cast<std::int16_t>(from), static_cast<std::int16_t>(to)};
}

struct SheetBox {
    double left, right, top, bottom; ///< in pixels of the tile's sheets; centres of pixels have whole numbers
};

/// Sets the pixels that a section can touch, and whether this tile counts the kernel; false where it touches none.
template <class T>
bool place(const SheetBox& box, const TileShape& tile, Section<T>& section, std::size_t& counted) {
    const PixelRange columns = pixels_between(box.left, box.right, tile.width + 2);
    const PixelRange rows = pixels_between(box.top, box.bottom, tile.height + 2);
    if (columns.first >= columns.end || rows.first >= rows.end) {
        return false;
    }
    section.x0 = columns.first;
    section.x1 = columns.end;
    section.y0 = rows.first;
    section.y1 = rows.end;
    // Neighbours share two columns and rows: a kernel counts where its first pixel is not a border that another has.
    const bool in_x = box.left > 0.0 || tile.x == 0, in_y = box.top > 0.0 || tile.y == 0;
    counted += in_x && in_y ? 1U : 0U;
    return true;
}

} // namespace

TileLayout::TileLayout(Size size, int largest) : size_(size) {
    columns_ = (size.width + largest - 1) / largest;
    rows_ = (size.height + largest - 1) / largest;
}

TileShape TileLayout::shape(std::size_t tile) const {
    const int column = static_cast<int>(tile % static_cast<std::size_t>(columns_));
    const int row = static_cast<int>(tile / static_cast<std::size_t>(columns_));
    TileShape shape;
    shape.x = left(column);
    shape.y = top(row);
    shape.width = left(column + 1) - shape.x;
    shape.height = top(row + 1) - shape.y;
    const int wanted = shape.width + 2 + TileShape::padding;
    shape.stride = (wanted + TileShape::padding - 1) / TileShape::padding * TileShape::padding;
    return shape;
}

namespace {

TileLayout::Range tiles_between(double low, double high, int pixels, int tiles) {
    // Pixel p's centre is at p + 1/2; a tile's sheets hold one pixel more on both sides, those of the outermost tiles
    // pixels -1 and `pixels`.
    const double first_pixel = std::ceil(low - 0.5), last_pixel = std::floor(high - 0.5);
    if (!(first_pixel <= last_pixel) || last_pixel < -1.0 || first_pixel > static_cast<double>(pixels)) {
        return {0, -1};
    }
    const auto first = static_cast<std::int64_t>(std::clamp(first_pixel, -1.0, static_cast<double>(pixels)));
    const auto last = static_cast<std::int64_t>(std::clamp(last_pixel, -1.0, static_cast<double>(pixels)));
    const auto left = [&](std::int64_t tile) { return static_cast<std::int64_t>(pixels) * tile / tiles; };
    // Tile t holds pixels left(t) - 1 ... left(t + 1).
    auto from = static_cast<int>(std::clamp<std::int64_t>((first - 1) * tiles / pixels - 1, 0, tiles - 1));
    while (from + 1 < tiles && left(from + 1) < first) {
        ++from;
    }
    auto to = static_cast<int>(std::clamp<std::int64_t>((last + 1) * tiles / pixels + 1, 0, tiles - 1));
    while (to > 0 && left(to) - 1 > last) {
        --to;
    }
    return {from, to};
}

} // namespace

TileLayout::Range TileLayout::columns_between(double low, double high) const {
    return tiles_between(low, high, size_.width, columns_);
}
TileLayout::Range TileLayout::rows_between(double low, double high) const {
    return tiles_between(low, high, size_.height, rows_);
}

Buckets<RowPart> bucket_rows(const FieldView& view, const VisibleRuns& runs, const Frame& frame,
                             const TileLayout& layout, ThreadPool& pool) {
    const auto& shape = view.field->shape();
    const std::size_t rows = runs.rows();
    const std::size_t chunks = chunks_for(rows, layout.tiles());
    const bool perspective = frame.projection == Projection::perspective;
    const double axis_x = 0.5 * frame.size.width, axis_y = 0.5 * frame.size.height;
    const double half_x = view.extent_x / frame.pixel, half_y = view.extent_y / frame.pixel;
    const double first_depth = frame.depth_of(0) - view.slab_half;
    const double last_depth = frame.depth_of(frame.slices - 1) + view.slab_half;
    const auto columns = static_cast<std::size_t>(layout.columns());

    const auto orthographic_row = [&](std::uint32_t row, std::uint32_t begin, std::uint32_t end, const auto& emit) {
        const Vec3 eye = view.eye_position(0, row % shape[1], row / shape[1]);
        const double x = eye.x / frame.pixel + axis_x, y = axis_y - eye.y / frame.pixel;
        const double dx = view.step_i.x / frame.pixel, dy = -view.step_i.y / frame.pixel;
        const double y_begin = y + begin * dy, y_end = y + (end - 1) * dy;
        const TileLayout::Range down =
            layout.rows_between(std::min(y_begin, y_end) - half_y, std::max(y_begin, y_end) + half_y);
        for (int tile_row = down.first; tile_row <= down.last; ++tile_row) {
            const Samples in_row = samples_between(y, dy, layout.top(tile_row) - 0.5 - half_y,
                                                   layout.top(tile_row + 1) + 0.5 + half_y, begin, end);
            if (in_row.begin >= in_row.end) {
                continue;
            }
            const double x_begin = x + in_row.begin * dx, x_end = x + (in_row.end - 1) * dx;
            const TileLayout::Range across =
                layout.columns_between(std::min(x_begin, x_end) - half_x, std::max(x_begin, x_end) + half_x);
            for (int tile_column = across.first; tile_column <= across.last; ++tile_column) {
                const Samples here =
                    samples_between(x, dx, layout.left(tile_column) - 0.5 - half_x,
                                    layout.left(tile_column + 1) + 0.5 + half_x, in_row.begin, in_row.end);
                if (here.begin < here.end) {
                    emit(static_cast<std::size_t>(tile_row) * columns + static_cast<std::size_t>(tile_column),
                         RowPart{row, here.begin, here.end});
                }
            }
        }
    };
    const auto perspective_part = [&](std::uint32_t row, std::uint32_t begin, std::uint32_t end, const auto& emit) {
        const Vec3 a = view.eye_position(begin, row % shape[1], row / shape[1]);
        const Vec3 b = view.eye_position(end - 1, row % shape[1], row / shape[1]);
        const double near = std::max(std::min(-a.z, -b.z) - view.half_depth, first_depth);
        const double far = std::min(std::max(-a.z, -b.z) + view.half_depth, last_depth);
        if (near > far) {
            return;
        }
        TileLayout::Range across{0, layout.columns() - 1}, down{0, layout.rows() - 1};
        // A whole slab counts where its middle lies behind the near plane: it can reach through the eye, where every
        // ray starts.
        if (near > 1e-9 * frame.slice_spacing) {
            const Interval x =
                over_depth(std::min(a.x, b.x) - view.extent_x, std::max(a.x, b.x) + view.extent_x, near, far);
            const Interval y =
                over_depth(std::min(-a.y, -b.y) - view.extent_y, std::max(-a.y, -b.y) + view.extent_y, near, far);
            across = layout.columns_between(x.low / frame.pixel + axis_x - 1e-3, x.high / frame.pixel + axis_x + 1e-3);
            down = layout.rows_between(y.low / frame.pixel + axis_y - 1e-3, y.high / frame.pixel + axis_y + 1e-3);
        }
        for (int tile_row = down.first; tile_row <= down.last; ++tile_row) {
            for (int tile_column = across.first; tile_column <= across.last; ++tile_column) {
                emit(static_cast<std::size_t>(tile_row) * columns + static_cast<std::size_t>(tile_column),
                     RowPart{row, begin, end});
            }
        }
    };
    return bucket<RowPart>(
        layout.tiles(), chunks, pool, "the rows of a lattice, sorted by tiles", [&](std::size_t chunk, const auto& emit) {
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
                for (std::uint32_t part = begin; part < end; part += part_length) {
                    perspective_part(number, part, std::min(part + part_length, end), emit);
                }
            }
        });
}

Buckets<std::uint32_t> bucket_kernels(const EllipsoidView& view, const std::vector<std::uint8_t>& visible,
                                      const TileLayout& layout, ThreadPool& pool) {
    const Frame& frame = view.frame();
    const std::size_t kernels = visible.size();
    const std::size_t chunks = chunks_for(kernels, layout.tiles());
    const auto columns = static_cast<std::size_t>(layout.columns());
    const double axis_x = 0.5 * frame.size.width, axis_y = 0.5 * frame.size.height;
    const double nearest = frame.slices > 0 ? view.front_of(0) : 0.0;
    const double farthest = frame.slices > 0 ? view.back_of(frame.slices - 1) : 0.0;
    return bucket<std::uint32_t>(
        layout.tiles(), chunks, pool, "the kernels of a view, sorted by tiles",
        [&](std::size_t chunk, const auto& emit) {
            const std::size_t first = kernels * chunk / chunks, past = kernels * (chunk + 1) / chunks;
            for (std::size_t i = first; i < past; ++i) {
                if (visible[i] == 0) {
                    continue;
                }
                const EllipsoidView::ScreenBounds bounds = view.support_bounds(i, nearest, farthest);
                TileLayout::Range across{0, layout.columns() - 1}, down{0, layout.rows() - 1};
                if (!bounds.unbounded) {
                    across = layout.columns_between(bounds.left + axis_x, bounds.right + axis_x);
                    down = layout.rows_between(bounds.top + axis_y, bounds.bottom + axis_y);
                }
                for (int row = down.first; row <= down.last; ++row) {
                    for (int column = across.first; column <= across.last; ++column) {
                        emit(static_cast<std::size_t>(row) * columns + static_cast<std::size_t>(column),
                             static_cast<std::uint32_t>(i));
                    }
                }
            }
        });
}

template <class T>
void feed_rows(const FieldView& view, const VisibleRuns& runs, const Frame& frame, Sampling sampling,
               const RowPart* begin, const RowPart* end, const TileShape& tile, TileKernels<T>& kernels) {
    kernels.clear();
    const bool perspective = frame.projection == Projection::perspective;
    const RowBasis basis(view.to_unit * glm::dvec2(frame.pixel, 0.0), view.to_unit * glm::dvec2(0.0, -frame.pixel));
    const glm::dvec2 origin = origin_of(tile, frame);
    const double spacing = frame.slice_spacing;
    const double per_depth = 1.0 / spacing;
    const double per_half_depth = 1.0 / view.half_depth;
    // Per slice: the point moves along the ray, and the sphere's centre leans away.
    const glm::dvec2 ray = perspective ? view.to_unit * origin : glm::dvec2(0.0);
    const glm::dvec2 drift = spacing * (ray + per_half_depth * view.shear);
    const Vec3 step_slice(glm::dot(basis.q1, drift), glm::dot(basis.q2, drift), -spacing * per_half_depth);
    RowShape<T> shape;
    shape.X = static_cast<T>(basis.X);
    shape.Y1 = static_cast<T>(basis.Y1);
    shape.Y2 = static_cast<T>(basis.Y2);
    shape.d1 = static_cast<T>(step_slice.x);
    shape.d2 = static_cast<T>(step_slice.y);
    shape.ds = static_cast<T>(step_slice.z);
    kernels.shapes.assign(1, shape);

    const auto unit_at = [&](const Vec3& eye) {
        // On slice 0.
        const double s = (-eye.z - frame.first_depth) * per_half_depth;
        const glm::dvec2 from =
            (perspective ? frame.first_depth * origin : origin) - glm::dvec2(eye.x, eye.y);
        const glm::dvec2 plane = view.to_unit * from - s * view.shear;
        return Vec3(glm::dot(basis.q1, plane), glm::dot(basis.q2, plane), s);
    };
    const double reach = view.half_depth * per_depth + (sampling == Sampling::slab ? 0.5 : 0.0);
    const double last_slice = static_cast<double>(frame.slices - 1);
    const auto& dims = view.field->shape();
    const double half_x = view.extent_x / frame.pixel, half_y = view.extent_y / frame.pixel;
    const Vec3 step_unit = unit_at(view.first_eye + view.step_i) - unit_at(view.first_eye);
    const T weight = static_cast<T>(view.weight_scale);
    const double value_scale = view.value_scale;

    std::visit(
        [&](const auto& data) {
            for (const RowPart* part = begin; part != end; ++part) {
                const std::size_t row = part->row;
                const Run* run = runs.begin(row);
                const Run* past = runs.end(row);
                run = std::partition_point(run, past, [&](const Run& r) { return r.end <= part->begin; });
                for (; run != past && run->begin < part->end; ++run) {
                    const std::uint32_t from = std::max(run->begin, part->begin), to = std::min(run->end, part->end);
                    const Vec3 eye = view.eye_position(from, row % dims[1], row / dims[1]);
                    const Vec3 unit = unit_at(eye);
                    const double at_depth = (-eye.z - frame.first_depth) * per_depth;
                    const double step_depth = -view.step_i.z * per_depth;
                    const double x = (eye.x - origin.x) / frame.pixel, y = (origin.y - eye.y) / frame.pixel;
                    const double dx = view.step_i.x / frame.pixel, dy = -view.step_i.y / frame.pixel;
                    const auto* values = data.data() + row * dims[2];
                    for (std::uint32_t i = from; i < to; ++i) {
                        const auto along = static_cast<double>(i - from);
                        const double depth = at_depth + along * step_depth;
                        const double first = std::max(std::ceil(depth - reach), 0.0);
                        const double last = std::min(std::floor(depth + reach), last_slice);
                        if (!(first <= last)) {
                            continue;
                        }
                        Section<T> section;
                        if (!perspective) {
                            const double px = x + along * dx, py = y + along * dy;
                            if (!place({px - half_x, px + half_x, py - half_y, py + half_y}, tile, section,
                                       kernels.counted)) {
                                continue;
                            }
                        } else {
                            const Vec3 here = eye + along * view.step_i;
                            const double near =
                                std::max(-here.z - view.half_depth, frame.first_depth + first * spacing - view.slab_half);
                            const double far = std::max(near, std::min(-here.z + view.half_depth,
                                                                       frame.first_depth + last * spacing + view.slab_half));
                            SheetBox box{0.0, tile.width + 1.0, 0.0, tile.height + 1.0};
                            if (near > 1e-9 * spacing) {
                                const Interval across =
                                    over_depth(here.x - view.extent_x, here.x + view.extent_x, near, far);
                                const Interval down =
                                    over_depth(-here.y - view.extent_y, -here.y + view.extent_y, near, far);
                                box = {(across.low - origin.x) / frame.pixel, (across.high - origin.x) / frame.pixel,
                                       (down.low + origin.y) / frame.pixel, (down.high + origin.y) / frame.pixel};
                            }
                            if (!place(box, tile, section, kernels.counted)) {
                                continue;
                            }
                        }
                        section.first = static_cast<std::int32_t>(first);
                        section.last = static_cast<std::int32_t>(last);
                        section.a1 = static_cast<T>(unit.x + along * step_unit.x + first * step_slice.x);
                        section.a2 = static_cast<T>(unit.y + along * step_unit.y + first * step_slice.y);
                        section.s = static_cast<T>((depth - first) * spacing * per_half_depth);
                        section.value = static_cast<T>(static_cast<double>(values[i]) * value_scale);
                        section.weight = weight;
                        kernels.unsorted.push_back(section);
                    }
                }
            }
        },
        view.field->samples());
    kernels.sort();
}

template <class T>
void feed_kernels(const EllipsoidView& view, Sampling sampling, const std::uint32_t* begin, const std::uint32_t* end,
                  const TileShape& tile, TileKernels<T>& kernels) {
    kernels.clear();
    const Frame& frame = view.frame();
    const bool perspective = frame.projection == Projection::perspective;
    const glm::dvec2 origin = origin_of(tile, frame);
    const double spacing = frame.slice_spacing;
    const double axis_x = 0.5 * frame.size.width - tile.x + 0.5, axis_y = 0.5 * frame.size.height - tile.y + 0.5;
    const EllipsoidField& field = view.field();
    kernels.unsorted.reserve(static_cast<std::size_t>(end - begin));
    kernels.unsorted_shapes.reserve(static_cast<std::size_t>(end - begin));
    for (const std::uint32_t* index = begin; index != end; ++index) {
        const EyeKernel kernel = view.kernel(*index);
        const EllipsoidView::Span span = view.span({-kernel.center.z, kernel.half_depth});
        if (span.first > span.last) {
            continue;
        }
        Section<T> section;
        const EllipsoidView::ScreenBounds bounds =
            view.bounds(kernel, view.front_of(span.first), view.back_of(span.last));
        const SheetBox box = bounds.unbounded
                                 ? SheetBox{0.0, tile.width + 1.0, 0.0, tile.height + 1.0}
                                 : SheetBox{bounds.left + axis_x, bounds.right + axis_x, bounds.top + axis_y,
                                            bounds.bottom + axis_y};
        if (!place(box, tile, section, kernels.counted)) {
            continue;
        }
        // A^-1, since the images of u and v are orthogonal.
        const glm::dvec2 u = kernel.axis_u / glm::dot(kernel.axis_u, kernel.axis_u);
        const glm::dvec2 v = kernel.axis_v / glm::dot(kernel.axis_v, kernel.axis_v);
        const auto to_plane = [&](const glm::dvec2& p) { return glm::dvec2(glm::dot(u, p), glm::dot(v, p)); };
        const RowBasis basis(frame.pixel * glm::dvec2(u.x, v.x), -frame.pixel * glm::dvec2(u.y, v.y));
        const double depth = frame.depth_of(span.first);
        const double s = (-kernel.center.z - depth) / kernel.half_depth;
        const double step_s = spacing / kernel.half_depth;
        const glm::dvec2 shear = to_plane(kernel.lean);
        const glm::dvec2 from =
            (perspective ? depth * origin : origin) - glm::dvec2(kernel.center.x, kernel.center.y);
        const glm::dvec2 plane = to_plane(from - s * kernel.lean);
        glm::dvec2 drift = step_s * shear;
        if (perspective) {
            drift += spacing * to_plane(origin);
        }
        RowShape<T> shape;
        shape.X = static_cast<T>(basis.X);
        shape.Y1 = static_cast<T>(basis.Y1);
        shape.Y2 = static_cast<T>(basis.Y2);
        shape.d1 = static_cast<T>(glm::dot(basis.q1, drift));
        shape.d2 = static_cast<T>(glm::dot(basis.q2, drift));
        shape.ds = static_cast<T>(-step_s);
        section.a1 = static_cast<T>(glm::dot(basis.q1, plane));
        section.a2 = static_cast<T>(glm::dot(basis.q2, plane));
        section.s = static_cast<T>(s);
        section.first = static_cast<std::int32_t>(span.first);
        section.last = static_cast<std::int32_t>(span.last);
        const double weight = field.weight(*index) * kernel.amplitude;
        section.value = static_cast<T>(field.value(*index) * weight * view.value_scale());
        section.weight = static_cast<T>(std::max(weight * view.weight_scale(), least_weight));
        kernels.unsorted.push_back(section);
        kernels.unsorted_shapes.push_back(shape);
    }
    static_cast<void>(sampling);
    kernels.sort();
}

template void feed_rows<float>(const FieldView&, const VisibleRuns&, const Frame&, Sampling, const RowPart*,
                               const RowPart*, const TileShape&, TileKernels<float>&);
template void feed_rows<double>(const FieldView&, const VisibleRuns&, const Frame&, Sampling, const RowPart*,
                                const RowPart*, const TileShape&, TileKernels<double>&);
template void feed_kernels<float>(const EllipsoidView&, Sampling, const std::uint32_t*, const std::uint32_t*,
                                  const TileShape&, TileKernels<float>&);
template void feed_kernels<double>(const EllipsoidView&, Sampling, const std::uint32_t*, const std::uint32_t*,
                                   const TileShape&, TileKernels<double>&);

} // namespace sheetsplat::simd

// How the kernels of a tile look from there: what lattices and scattered kernels share. Compiled for each instruction
// set: rounding takes a function call without them.

#if defined(SHEETSPLAT_CPU_FEED_INL) == defined(HWY_TARGET_TOGGLE)
#ifdef SHEETSPLAT_CPU_FEED_INL
#undef SHEETSPLAT_CPU_FEED_INL
#else
#define SHEETSPLAT_CPU_FEED_INL
#endif

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <type_traits>
#include <variant>
#include <vector>

#include <glm/geometric.hpp>

#include "backend_cpu/tile_feed.hpp"
#include "backend_cpu/tile_task.hpp"
#include "hwy/cache_control.h"
#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace sheetsplat::backend_cpu::HWY_NAMESPACE {

/// Turns the plane coordinates of a unit sphere so that pixels of a row change the first one alone.
struct RowBasis {
    double X, Y1, Y2;
    glm::dvec2 q1, q2;
    /// along_x, along_y: change of the plane coordinates from pixel to pixel (perspective: per unit of depth).
    HWY_INLINE RowBasis(const glm::dvec2& along_x, const glm::dvec2& along_y) {
        X = std::sqrt(along_x.x * along_x.x + along_x.y * along_x.y);
        q1 = along_x / X;
        q2 = glm::dvec2(-q1.y, q1.x);
        Y1 = q1.x * along_y.x + q1.y * along_y.y;
        Y2 = q2.x * along_y.x + q2.y * along_y.y;
    }
};

/// drift: change of a kernel's plane coordinates from slice to slice along a ray; step_s: of its height, times -1.
template <class T>
HWY_INLINE RowShape<T> row_shape(const RowBasis& basis, const glm::dvec2& drift, double step_s) {
    RowShape<T> shape;
    shape.X = static_cast<T>(basis.X);
    shape.Y1 = static_cast<T>(basis.Y1);
    shape.Y2 = static_cast<T>(basis.Y2);
    shape.d1 = static_cast<T>(glm::dot(basis.q1, drift));
    shape.d2 = static_cast<T>(glm::dot(basis.q2, drift));
    shape.ds = static_cast<T>(-step_s);
    return shape;
}

/// Where a kernel with plane coordinates `plane` at the tile's first pixel is, s above slice section.first.
template <class T>
HWY_INLINE void set_place(const RowBasis& basis, const glm::dvec2& plane, double s, Section<T>& section) {
    section.a1 = static_cast<T>(glm::dot(basis.q1, plane));
    section.a2 = static_cast<T>(glm::dot(basis.q2, plane));
    section.s = static_cast<T>(s);
}

/// Samples of a lattice as its kernels' values: (sample - origin) scale, rounded once. One function a type of samples;
/// what calls read() knows of none.
template <class T>
class SampleReader {
  public:
    SampleReader(const RegularField& field, double origin, double scale)
        : samples_(field.samples()), size_(std::visit([](const auto& data) { return data.size(); }, samples_)),
          data_(std::visit([](const auto& data) { return static_cast<const void*>(data.data()); }, samples_)),
          bytes_(std::visit([](const auto& data) { return sizeof(data[0]); }, samples_)), origin_(origin),
          scale_(scale),
          read_(std::visit([](const auto& data) { return &read_as<std::decay_t<decltype(data)>>; }, samples_)) {}

    /// Of `count` samples from number `first` on; of fed_together fastest.
    void read(std::size_t first, std::uint32_t count, T* out) const { read_(*this, first, count, out); }
    /// Asks for samples from number `first` on, which are read soon.
    HWY_INLINE void prefetch(std::size_t first) const {
        hwy::Prefetch(static_cast<const char*>(data_) + std::min(first, size_ - 1) * bytes_);
    }
    /// Of one to fed_together; out: room for so many.
    void read_piece(std::size_t first, std::uint32_t count, T* out) const {
        read_(*this, first, first + fed_together <= size_ ? fed_together : count, out);
    }
    template <class Value>
    HWY_INLINE void convert(const Value* HWY_RESTRICT from, std::uint32_t count, T* HWY_RESTRICT out) const {
        const double origin = origin_, scale = scale_;
        for (std::uint32_t i = 0; i < count; ++i) {
            out[i] = static_cast<T>((static_cast<double>(from[i]) - origin) * scale);
        }
    }

  private:
    template <class Data>
    static void read_as(const SampleReader& reader, std::size_t first, std::uint32_t count, T* out) {
        const Data& samples = *std::get_if<Data>(&reader.samples_);
        if (count == fed_together) {
            // (Of a number that is known the compiler makes vectors without a rest.)
            reader.convert(samples.data() + first, fed_together, out);
            return;
        }
        reader.convert(samples.data() + first, count, out);
    }

    const SampleArray& samples_;
    std::size_t size_;
    const void* data_;
    std::size_t bytes_; ///< of one
    double origin_, scale_;
    void (*read_)(const SampleReader& reader, std::size_t first, std::uint32_t count, T* out);
};

/// Where the tile's first sheet pixel looks: eye x and y, per unit of depth in perspective.
inline glm::dvec2 origin_of(const TileShape& tile, const Frame& frame) {
    return {frame.eye_x(tile.x - 1), frame.eye_y(tile.y - 1)};
}

/// In pixels of the tile's sheets; centres of pixels have whole numbers.
struct SheetBox {
    double left, right, top, bottom;
};

/// Sets the pixels that a section can touch; false where it touches none.
template <class T>
HWY_INLINE bool place(const SheetBox& box, const TileShape& tile, SectionExtra<T>& extra) {
    const auto pixel = [](double at, int limit) {
        return static_cast<std::int16_t>(std::min(std::max(at, 0.0), static_cast<double>(limit)));
    };
    extra.x0 = pixel(std::ceil(box.left), tile.width + 2);
    extra.x1 = pixel(std::floor(box.right) + 1.0, tile.width + 2);
    extra.y0 = pixel(std::ceil(box.top), tile.height + 2);
    extra.y1 = pixel(std::floor(box.bottom) + 1.0, tile.height + 2);
    return extra.x0 < extra.x1 && extra.y0 < extra.y1;
}

/// Places in the sheets that this tile counts as its own: without its border, but with all that is beyond the picture.
struct OwnPlaces {
    double left, right, top, bottom;
    OwnPlaces(const TileShape& tile, const Frame& frame) {
        constexpr double infinity = std::numeric_limits<double>::infinity();
        left = tile.x == 0 ? -infinity : 0.5;
        top = tile.y == 0 ? -infinity : 0.5;
        right = tile.x + tile.width == frame.size.width ? infinity : tile.width + 0.5;
        bottom = tile.y + tile.height == frame.size.height ? infinity : tile.height + 0.5;
    }
    [[nodiscard]] bool hold(double x, double y) const { return x >= left && x < right && y >= top && y < bottom; }
};

/// In any unit of length; what is too small for its inverse is 0.
constexpr double least_step = std::numeric_limits<double>::min();

/// Samples low <= i < high of a row.
struct SampleCut {
    double low, high;
    /// Those where from <= at + i step < to.
    void keep(double at, double step, double from, double to) {
        if (std::abs(step) < least_step) {
            high = at >= from && at < to ? high : low;
            return;
        }
        if (step < 0.0) {
            at = -at;
            step = -step;
            std::swap(from, to);
            from = -from;
            to = -to;
        }
        const double per_step = 1.0 / step;
        low = std::max(low, std::ceil((from - at) * per_step));
        high = std::min(high, std::ceil((to - at) * per_step));
    }
};

} // namespace sheetsplat::backend_cpu::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif // SHEETSPLAT_CPU_FEED_INL

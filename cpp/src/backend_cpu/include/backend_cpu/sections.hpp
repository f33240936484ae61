// Kernels as one tile meets them. In the unit sphere of a kernel, turned so that its first coordinate alone changes
// along a row of pixels, a point of slice n has the coordinates
//     q1 = x X + y Y1 + a1,   q2 = y Y2 + a2,   q3 = s,       r^2 = q1^2 + q2^2 + q3^2,
// with (x, y) the pixel in the tile's sheets. a1, a2 and s change by d1, d2 and ds from slice to slice; in perspective
// X, Y1 and Y2 are those of depth 1 times the slice's depth. So each row is a one-dimensional Gaussian of a width that
// is the same for all rows, whose coordinates cancel nowhere, however slender the ellipsoid is: the QR factorisation of
// [NM06]'s equations 8 to 19 in place of their quadratic form.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <vector>

#include <glm/vec2.hpp>

#include "backend_cpu/measured.hpp"
#include "backend_cpu/tile.hpp"

namespace sheetsplat {
class EllipsoidView;
}

namespace sheetsplat::backend_cpu {

/// How q depends on pixel and slice. Orthographic: per pixel; perspective: per pixel and unit of depth.
template <class T>
struct RowShape {
    T X = 0, Y1 = 0, Y2 = 0;
    T d1 = 0, d2 = 0, ds = 0;
};

/// One kernel: where it is on the first slice that it meets here, and what it adds.
template <class T>
struct Section {
    T a1 = 0, a2 = 0, s = 0; ///< at slice `first`
    T value = 0;             ///< with gain and scales
    std::int32_t first = 0;
};

/// What is not the same for all kernels of some fields, or in some drawings.
template <class T>
struct SectionExtra {
    T weight = 0;                                ///< with gain and scales
    T other = 0;                                 ///< value of the field beside (TileKernels::beside)
    std::int32_t last = -1;                      ///< slice
    std::int16_t x0 = 0, y0 = 0, x1 = 0, y1 = 0; ///< pixels of the tile's sheets that it can touch: x0 <= x < x1
};

/// Room for feeding the rows of a lattice in batches of slices (feed_rows-inl.hpp).
struct RowBatches {
    std::vector<std::array<double, 3>> eyes; ///< of each part of a row, the eye position of its first sample
    std::vector<double> firsts;        ///< of each part of a row, the least and greatest first slice of its samples
    std::vector<std::uint32_t> offset; ///< batches + 2
    std::vector<std::uint32_t> parts;  ///< numbers, batch by batch
    struct Stretch {
        std::size_t row, first_sample;
        std::uint32_t begin; ///< the first sample's number in its row
        double depth, step;  ///< in slices from slice 0
        double unit[3];      ///< of the first sample
    };
    std::vector<Stretch> stretches; ///< of one batch
    /// Samples of a stretch that are looked at together.
    struct Piece {
        std::uint32_t stretch, from, count;
    };
    std::vector<Piece> pieces;
    std::vector<std::int32_t> slots; ///< first slices of the samples of all pieces, counted from the batch's own

    [[nodiscard]] std::size_t bytes() const {
        return eyes.capacity() * sizeof(eyes[0]) + firsts.capacity() * sizeof(double) +
               (offset.capacity() + parts.capacity()) * sizeof(std::uint32_t) + stretches.capacity() * sizeof(Stretch) +
               pieces.capacity() * sizeof(Piece) + slots.capacity() * sizeof(std::int32_t);
    }
};

/// The kernels of one field in one tile, by their first slices; of lattices those of some slices at a time.
template <class T>
struct TileKernels {
    std::vector<Section<T>> sections;
    std::vector<SectionExtra<T>> extras; ///< empty, or as many as there are sections
    std::vector<RowShape<T>> shapes;     ///< one for all, or as many as there are sections
    std::size_t fields = 1;              ///< lattices that these kernels are drawn for
    std::vector<T> values;               ///< of several, [section][lattice]; 0 where a sample is not drawn
    T weight = 0;                        ///< of all where there are no extras
    double pivot = 0.0;                  ///< what the field's values are counted from
    /// Of a field of the same scattered kernels but for their values, which are summed beside these. Null: there is
    /// none.
    const EllipsoidView* beside = nullptr;
    double beside_pivot = 0.0;
    /// Half the extents of a support on the screen, in pixels: of all where there is one shape. In perspective times
    /// the depth of its centre, and not less than that for centres at least twice as far away as it is deep. 0: not
    /// known.
    T reach_x = 0, reach_y = 0;
    std::int32_t last_slice = -1;                       ///< of the view
    std::vector<std::uint32_t> waiting[covered_slices]; ///< numbers of those to be drawn again, by slice
    // Room for those that are drawn on one slice, for what one batch of slices leaves to the next, and for the sort.
    std::vector<std::uint32_t> drawn_now;
    std::vector<Section<T>> carried, unsorted;
    std::vector<T> carried_values;
    std::vector<SectionExtra<T>> unsorted_extras;
    std::vector<RowShape<T>> unsorted_shapes;
    std::vector<std::uint32_t> places;
    RowBatches rows;
    /// Called now and then while kernels are added; what it throws ends that. May be empty.
    std::function<void()> poll;
    std::size_t counted = 0; ///< kernels whose centres are in this tile (or beyond the picture, next to it)

    void clear() {
        sections.clear();
        extras.clear();
        shapes.clear();
        values.clear();
        fields = 1;
        unsorted.clear();
        unsorted_extras.clear();
        unsorted_shapes.clear();
        reach_x = reach_y = 0;
        counted = 0;
    }
    /// Moves what is unsorted to its place in the order of first slices; equal ones keep their order.
    void sort();
    [[nodiscard]] std::size_t bytes() const {
        return (sections.capacity() + carried.capacity() + unsorted.capacity()) * sizeof(Section<T>) +
               (extras.capacity() + unsorted_extras.capacity()) * sizeof(SectionExtra<T>) +
               (shapes.capacity() + unsorted_shapes.capacity()) * sizeof(RowShape<T>) +
               (values.capacity() + carried_values.capacity()) * sizeof(T) +
               (places.capacity() + drawn_now.capacity()) * sizeof(std::uint32_t) + rows.bytes();
    }
};

} // namespace sheetsplat::backend_cpu

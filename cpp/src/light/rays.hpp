// How rays of light run through a grid of absorption, and which parts of the grid are looked at (light/march).
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "sheetsplat/light_volume.hpp"
#include "sheetsplat/types.hpp"

namespace sheetsplat::light_march {

/// Rows of rays of a task, and how many of them the next task follows too.
constexpr int band_rows = 32, shared_rows = 3;

/// A place between two elements or rays.
struct Between {
    int whole = 0;
    float part = 0.0F;
};
Between between(double place);

/// Rays through a grid, plane by plane away from the light. Ray r of an axis across meets plane p at the element's
/// place r - offset(p).
class Rays {
  public:
    /// An axis across the rays.
    struct Axis {
        std::size_t stride = 1; ///< elements of the grid from one to the next
        int elements = 1, rays = 1;
        double first = 0.0, per_plane = 0.0;
        /// At least 1, which rounding alone would miss: element 0 looks at the ray before its own.
        [[nodiscard]] double offset(int plane) const { return std::max(1.0, first - plane * per_plane); }
    };

    Rays(const LightVolume& grid, const Vec3& towards_light, double slice_spacing);

    /// The grid's axis along which they run.
    [[nodiscard]] std::size_t along() const { return along_; }
    [[nodiscard]] int planes() const { return planes_; }
    /// From plane to plane, slice distances.
    [[nodiscard]] float slices() const { return static_cast<float>(slices_); }
    [[nodiscard]] const Axis& columns() const { return columns_; }
    [[nodiscard]] const Axis& rows() const { return rows_; }
    /// A plane as the grid counts it.
    [[nodiscard]] int plane_of_grid(int plane) const { return backwards_ ? planes_ - 1 - plane : plane; }
    /// The first element of a plane's row.
    [[nodiscard]] std::size_t start(int plane, int row) const {
        return static_cast<std::size_t>(plane_of_grid(plane)) * plane_stride_ +
               static_cast<std::size_t>(row) * rows_.stride;
    }
    [[nodiscard]] std::size_t bands() const {
        return static_cast<std::size_t>((rows_.rays - shared_rows + band_rows - shared_rows - 1) /
                                        (band_rows - shared_rows));
    }

  private:
    std::size_t along_ = 2, plane_stride_ = 1;
    int planes_ = 1;
    bool backwards_ = false;
    double slices_ = 1.0;
    Axis columns_, rows_;
};

/// Which stretches of a grid's rows are looked at: those with an absorbing element within `margin` elements along each
/// axis, or all. Planes, rows and columns as rays along an axis of the grid have them; a bit a stretch.
class Stretches {
  public:
    /// So far light is known around what absorbs it: interpolation reads one element around, sharpening another one.
    static constexpr int margin = 2;

    Stretches(const LightVolume& grid, std::size_t along, bool all);

    /// plane: as the grid counts. Rows outside of the grid have none.
    [[nodiscard]] std::uint64_t at(int plane, int row) const {
        return row >= 0 && row < rows_ ? bits_[static_cast<std::size_t>(plane) * static_cast<std::size_t>(rows_) +
                                               static_cast<std::size_t>(row)]
                                       : 0;
    }
    /// Elements of a stretch; the last one may have fewer.
    [[nodiscard]] int length() const { return length_; }

  private:
    int rows_ = 1, length_ = 16;
    std::vector<std::uint64_t> bits_;
};

/// Calls visit(first stretch, the one behind the last) for the runs of bits.
template <class Visit>
void for_each_run(std::uint64_t bits, const Visit& visit) {
    for (int first = 0; bits != 0;) {
        while ((bits & 1U) == 0) {
            bits >>= 1U;
            ++first;
        }
        int past = first;
        while ((bits & 1U) != 0) {
            bits >>= 1U;
            ++past;
        }
        visit(first, past);
        first = past;
    }
}

} // namespace sheetsplat::light_march

// The sums D and W of the fields on one slice, and rho. Source: IMAGE FORMATION sections 2 and 3.
#pragma once

#include <cstdint>
#include <vector>

#include "reference/kernels.hpp"
#include "reference/screen.hpp"
#include "reference/slices.hpp"
#include "sheetsplat/scene.hpp"

namespace sheetsplat::reference {

/// rho of one slice at the pixels -1 ... width, -1 ... height.
class Sheet {
  public:
    Sheet(const Screen& screen, bool weights);

    void clear();
    [[nodiscard]] std::size_t index(int column, int row) const {
        return static_cast<std::size_t>(row + 1) * stride_ + static_cast<std::size_t>(column + 1);
    }

    std::vector<double> rho;            ///< 0 where empty
    std::vector<unsigned char> reached; ///< 1 where any kernel reaches; the others are empty
    std::vector<double> weight;         ///< W of all fields together; without elements where nobody asked

  private:
    std::size_t stride_;
};

/// D and W of one field on one slice.
struct SheetSums {
    std::vector<double> d, w;
};

/// Kernels of value 0 add nothing to D. They matter where W is asked for, where it normalises, or where being reached
/// by a kernel of value 0 differs from being empty: where rho = 0 has an opacity. Elsewhere they are left out, and this
/// is the renderer's only shortcut.
enum class ZeroKernels { drawn, left_out };

/// The kernels of one field, sorted by the first slice that each meets.
class FieldSums {
  public:
    /// Throws OutOfMemory.
    FieldSums(const RegularField& field, const Camera& camera, const Screen& screen, const Slices& slices,
              Sampling sampling, double radius_factor, ZeroKernels zero_kernels);

    /// Adds this field's rho on slice n (which exists) to the sheet. `sums` is scratch of the sheet's size.
    void add_to(Sheet& sheet, std::int64_t n, SheetSums& sums) const;
    /// Kernels whose support meets a slice and the picture with its border.
    [[nodiscard]] std::size_t drawn() const { return kernels_.size(); }

  private:
    struct SliceRange {
        std::int64_t first = 0, last = -1;
    };
    [[nodiscard]] SliceRange slices_met(double depth) const;
    [[nodiscard]] bool is_drawn(const Vec3& centre_eye, double value) const;
    void splat_point(const Vec3& centre_eye, double value, std::int64_t n, SheetSums& sums, Sheet& sheet) const;
    void splat_slab(const Vec3& centre_eye, double value, std::int64_t n, SheetSums& sums, Sheet& sheet) const;
    [[nodiscard]] double normalise(double d, double w) const;

    const RegularField& field_;
    const Screen& screen_;
    Slices slices_;
    Sampling sampling_;
    ZeroKernels zero_kernels_;
    KernelShape shape_;
    double lattice_constant_;
    std::int64_t longest_ = 1;           ///< most slices that one kernel meets
    std::vector<std::uint64_t> offsets_; ///< where the kernels of each first slice begin; one more at the end
    std::vector<std::uint64_t> kernels_; ///< ids, memory order within one first slice
};

} // namespace sheetsplat::reference

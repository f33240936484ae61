// The sums D and W of the fields on one slice, and rho. Source: conventions, sections 2 and 3.
#pragma once

#include <cstdint>
#include <vector>

#include "reference/clip.hpp"
#include "reference/kernels.hpp"
#include "reference/screen.hpp"
#include "reference/slices.hpp"
#include "sheetsplat/scene.hpp"

namespace sheetsplat::reference {

/// rho of one slice at the pixels -1 ... width, -1 ... height.
class Sheet {
  public:
    /// What it is asked for beside rho.
    struct Wanted {
        bool weights = false;
        bool counts = false;
        bool gradients = false;
    };
    Sheet(const Screen& screen, const Wanted& wanted);

    void clear();
    [[nodiscard]] std::size_t index(int column, int row) const {
        return static_cast<std::size_t>(row + 1) * stride_ + static_cast<std::size_t>(column + 1);
    }

    /// Counted from the base of its group. In scalar modes as it is, base included, of the fields that have not ended.
    std::vector<double> rho;
    std::vector<unsigned char> reached; ///< 1 where the group is not empty
    std::vector<double> weight;         ///< W of all fields that have not ended; empty unless requested
    std::vector<unsigned char> counts;  ///< 1 where a field that is not empty has W > 0; empty unless requested
    std::vector<Vec3> gradient;         ///< analytic, eye space, per reference length; empty unless requested

  private:
    std::size_t stride_;
};

/// D and W of one field on one slice; their gradients where the sheet has gradients, eye space, per reference length.
struct SheetSums {
    explicit SheetSums(const Sheet& like);
    void clear();
    std::vector<double> d, w;
    std::vector<unsigned char> reached; ///< 1 where any kernel reaches
    std::vector<Vec3> slope_d, slope_w;
    /// Where W divides: the one f - b of all kernels of a weight above 0 at the pixel; NaN without one, infinite where
    /// they differ.
    std::vector<double> plateau;
};

/// Of sheets that hold the weights of labels, what each is above the largest other one (conventions, section 4).
void compare_labels(const std::vector<Sheet*>& sheets);

/// rho - b, and its gradient, of a field from its sums: one normalisation.
class Normaliser {
  public:
    Normaliser(const Field& field, double radius_factor);
    /// Whether D is divided by W, and not by w0 or C.
    [[nodiscard]] bool divides_by(double w) const { return normalization_ == Normalization::threshold && w > w0_; }
    [[nodiscard]] double rho(double d, double w) const;
    /// Points with a smaller W are empty.
    [[nodiscard]] double least_weight() const { return least_weight_; }
    [[nodiscard]] Vec3 gradient(double d, double w, const Vec3& slope_d, const Vec3& slope_w) const;

  private:
    Normalization normalization_;
    double w0_, least_weight_;
    double lattice_constant_; ///< C
};

/// Kernels whose value is the base (or of weight 0) add nothing to D. They matter where W is asked for, where it
/// normalises, or where being reached by such a kernel differs from being empty: where rho = b has an opacity, or is
/// added up. Elsewhere they are left out, and this is the renderer's only shortcut.
enum class ZeroKernels { drawn, left_out };

/// The kernels of one field, slice after slice: sorted once by the first slice that each meets, and held while the
/// slices are within reach.
class FieldSums {
  public:
    /// `end`: where the field ends. What is referred to must live as long as this. Throws OutOfMemory, and InvalidInput
    /// where the sums could be larger than float64 holds.
    FieldSums(const Field& field, const Clip& end, const Scene& scene, const Camera& camera, const Screen& screen,
              const Slices& slices, double radius_factor, ZeroKernels zero_kernels);

    /// Adds this field's rho on the next slice to the sheet: first that of slices.first, then of the one behind it, to
    /// slices.last(). `sums` is scratch of the sheet's size.
    void add_next(Sheet& sheet, SheetSums& sums);
    /// Kernels whose support meets a slice and the picture with its border.
    [[nodiscard]] std::size_t drawn() const { return kernels_.size(); }

  private:
    struct SliceRange {
        std::int64_t first = 0, last = -1;
    };
    struct Held {
        EyeKernel kernel;
        std::int64_t last; ///< slice
    };
    /// The part of slice n that the kernel may reach, from front to back: one depth for point sampling.
    [[nodiscard]] Interval depths(const EyeKernel& kernel, std::int64_t first, std::int64_t last) const;
    [[nodiscard]] SliceRange slices_met(const EyeKernel& kernel) const;
    [[nodiscard]] bool is_drawn(const EyeKernel& kernel, const SliceRange& met) const;
    void sort_kernels();
    void splat(const EyeKernel& kernel, std::int64_t n, SheetSums& sums, Sheet& sheet) const;
    /// Adds what the sums of slice n come to at a pixel.
    void add(std::int64_t n, int column, int row, const SheetSums& sums, Sheet& sheet) const;

    const Screen& screen_;
    Slices slices_;
    Sampling sampling_;
    double reference_distance_; ///< world units
    ZeroKernels zero_kernels_;
    bool scalar_;
    double base_;
    Clipping end_;
    EyeKernels eye_kernels_;
    Profile profile_;
    Normaliser normaliser_;
    std::vector<std::uint64_t> offsets_; ///< where the kernels of each first slice begin; one more at the end
    std::vector<std::uint64_t> kernels_; ///< numbers, in the field's order within one first slice
    std::int64_t next_;                  ///< slice
    std::vector<Held> held_;             ///< those that have begun and not ended
};

} // namespace sheetsplat::reference

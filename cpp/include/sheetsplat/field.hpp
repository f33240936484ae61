// Fields: sets of kernels whose weighted sums are the scalar that is shown.
// Source: IMAGE FORMATION section 2; [NM05] section 3 for regular lattices, Theussl et al. 2001 for BCC.
#pragma once

#include <array>
#include <cmath>
#include <memory>
#include <variant>
#include <vector>

#include "sheetsplat/types.hpp"

namespace sheetsplat {

/// How the sums D = sum m f g and W = sum m g become the scalar rho.
enum class Normalization {
    none,      ///< rho = D
    lattice,   ///< rho = D / C with C the kernel's mass per sample's volume (closed form)
    threshold, ///< rho = D / max(w0, W)  ([NM06] eq. 20)
};

enum class Lattice {
    cartesian,
    bcc, ///< body-centred cubic: two interleaved cubic lattices of edge a
};

enum class NanPolicy {
    error, ///< a NaN sample is InvalidInput
    skip,  ///< a NaN sample is no kernel
};

/// The kernel's profile g(r) = max(0, (exp(-k r^2) - exp(-k)) / (1 - exp(-k))), r in units of the support's radius.
struct Kernel {
    double falloff = 8.0; ///< k > 0

    [[nodiscard]] double edge() const { return std::exp(-falloff); }
    /// 1 / (1 - exp(-k)) without loss of digits for small k.
    [[nodiscard]] double gain() const { return -1.0 / std::expm1(-falloff); }
    /// Integral of g over the unit ball (closed form with erf).
    [[nodiscard]] double unit_mass() const;
};

/// What a scene needs to know of any field.
class Field {
  public:
    virtual ~Field() = default;
    Field(const Field&) = delete;
    Field& operator=(const Field&) = delete;

    [[nodiscard]] const Kernel& kernel() const { return kernel_; }
    [[nodiscard]] Normalization normalization() const { return normalization_; }
    [[nodiscard]] double w0() const { return w0_; }
    /// Number of kernels, invisible ones included.
    [[nodiscard]] virtual std::size_t size() const = 0;
    /// World-aligned box of all kernel centres; empty for a field without kernels.
    [[nodiscard]] virtual Box centres_world() const = 0;
    /// World-aligned box of all supports.
    [[nodiscard]] virtual Box supports_world() const = 0;
    /// Smallest and largest value (not weight); 0, 0 for a field without kernels.
    [[nodiscard]] virtual std::array<double, 2> value_range() const = 0;
    /// The default distance of slices, in world units (IMAGE FORMATION section 3).
    [[nodiscard]] virtual double default_slice_spacing() const = 0;
    /// Bytes that the field keeps.
    [[nodiscard]] virtual std::size_t memory() const = 0;

  protected:
    Field() = default;
    Kernel kernel_;
    Normalization normalization_ = Normalization::lattice;
    double w0_ = 1.0;
};

/// Samples in the type that they came in, [k][j][i], i fastest. One of the vectors is the data.
using SampleArray = std::variant<std::vector<std::uint8_t>, std::vector<std::int16_t>, std::vector<std::uint16_t>,
                                 std::vector<float>, std::vector<double>>;

struct RegularFieldOptions {
    Vec3 spacing{1.0, 1.0, 1.0}; ///< world units between samples; lattice bcc: spacing.x is a
    Vec3 origin{0.0, 0.0, 0.0};  ///< world position of sample (0, 0, 0)
    Lattice lattice = Lattice::cartesian;
    double radius = 2.0; ///< of the support, in sample distances (bcc: of a / sqrt 2)
    double falloff = 5.0;
    Normalization normalization = Normalization::lattice;
    double w0 = 1.0;
    NanPolicy nan = NanPolicy::error;
};

/// A Cartesian or BCC volume. Immutable.
class RegularField final : public Field {
  public:
    /// samples: nk * nj * ni values, i fastest; shape: {nk, nj, ni} as the array [k, j, i] says.
    /// Throws InvalidInput for empty or mismatched arrays, NaN (unless skipped), infinities, spacing, radius or falloff
    /// <= 0.
    RegularField(SampleArray samples, std::array<std::size_t, 3> shape, const RegularFieldOptions& options = {});

    [[nodiscard]] std::size_t size() const override { return kernels_; }
    [[nodiscard]] Box centres_world() const override { return centres_world_; }
    [[nodiscard]] Box supports_world() const override;
    [[nodiscard]] std::array<double, 2> value_range() const override { return value_range_; }
    [[nodiscard]] double default_slice_spacing() const override;
    [[nodiscard]] std::size_t memory() const override;

    /// {nk, nj, ni}
    [[nodiscard]] const std::array<std::size_t, 3>& shape() const { return shape_; }
    [[nodiscard]] const RegularFieldOptions& options() const { return options_; }
    [[nodiscard]] Lattice lattice() const { return options_.lattice; }
    [[nodiscard]] const SampleArray& samples() const { return samples_; }
    /// True where a NaN was skipped somewhere, so that the lattice has holes.
    [[nodiscard]] bool has_holes() const { return has_holes_; }

    /// World position of sample (i, j, k).
    [[nodiscard]] Vec3 position(std::size_t i, std::size_t j, std::size_t k) const;
    /// Value of sample (i, j, k) as float64; NaN where skipped.
    [[nodiscard]] double value(std::size_t i, std::size_t j, std::size_t k) const;
    /// The semi-axes of every kernel's support along the world axes.
    [[nodiscard]] Vec3 semi_axes_world() const;
    /// C of normalisation lattice: the kernel's mass over the volume that one sample stands for.
    [[nodiscard]] double lattice_constant() const;

  private:
    SampleArray samples_;
    std::array<std::size_t, 3> shape_{};
    RegularFieldOptions options_;
    Box centres_world_;
    std::array<double, 2> value_range_{0.0, 0.0};
    std::size_t kernels_ = 0;
    bool has_holes_ = false;
};

} // namespace sheetsplat

// Fields: sets of kernels whose weighted sums are the scalar that is shown.
// Source: conventions, section 2; [NM05] section 3 for regular lattices, Theussl et al. 2001 for BCC; [NM06] for
// scattered ellipsoids.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <optional>
#include <variant>
#include <vector>

#include <glm/gtc/quaternion.hpp>

#include "sheetsplat/types.hpp"

namespace sheetsplat {

/// How the sums D = sum m (f - b) g and W = sum m g become the scalar rho; b is the field's base.
enum class Normalization {
    none,      ///< rho = b + D
    lattice,   ///< rho = b + D / C with C the kernel's mass per sample's volume (closed form)
    threshold, ///< rho = b + D / max(w0, W)  ([NM06] eq. 20)
};

/// What a lattice is beyond its outermost samples.
enum class Boundary {
    edge, ///< the samples are mirrored, and the field ends half a sample distance beyond the outermost ones
    zero, ///< there are no samples, and the field falls to its base within a kernel's radius ([NM05])
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
    /// Standard deviations of the Gaussian from the centre to the end of the support.
    [[nodiscard]] double deviations() const { return std::sqrt(2.0 * falloff); }
    /// Integral of g over the unit ball (closed form with erf).
    [[nodiscard]] double unit_mass() const;
};

enum class FieldKind {
    regular,   ///< RegularField
    ellipsoid, ///< EllipsoidField
};

/// What a scene needs to know of any field.
class Field {
  public:
    virtual ~Field() = default;
    Field(const Field&) = delete;
    Field& operator=(const Field&) = delete;

    [[nodiscard]] virtual FieldKind kind() const = 0;

    [[nodiscard]] const Kernel& kernel() const { return kernel_; }
    [[nodiscard]] Normalization normalization() const { return normalization_; }
    [[nodiscard]] double w0() const { return w0_; }
    /// b, what values are counted from: rho where no kernel reaches.
    [[nodiscard]] double base() const { return base_; }
    /// Points with a smaller W are empty, although kernels reach them; 0: none is.
    [[nodiscard]] double least_weight() const { return least_weight_; }
    /// Number of kernels, invisible ones included.
    [[nodiscard]] virtual std::size_t size() const = 0;
    /// World-aligned box of all kernel centres, mirrored ones left out; empty for a field without kernels.
    [[nodiscard]] virtual Box centres_world() const = 0;
    /// World-aligned box of all supports.
    [[nodiscard]] virtual Box supports_world() const = 0;
    /// Smallest and largest f - b (not weight); 0, 0 for a field without kernels.
    [[nodiscard]] virtual std::array<double, 2> value_range() const = 0;
    /// The default distance of slices, in world units (conventions, section 3). A field without kernels has none: 0.
    [[nodiscard]] virtual double default_slice_spacing() const = 0;
    /// Smallest and largest (x - from) . direction over all points of all supports, or bounds of them; direction has
    /// unit length. The first is larger than the second where there are no kernels.
    [[nodiscard]] virtual std::array<double, 2> reach_along(const Vec3& from, const Vec3& direction) const = 0;
    /// Bytes that the field keeps.
    [[nodiscard]] virtual std::size_t memory() const = 0;
    /// Where the field ends, or nowhere; infinite along axes along which it does not.
    [[nodiscard]] virtual const std::optional<Parallelepiped>& domain() const = 0;

  protected:
    Field() = default;
    Kernel kernel_;
    Normalization normalization_ = Normalization::lattice;
    double w0_ = 1.0;
    double base_ = 0.0;
    double least_weight_ = 0.0;
};

/// Samples in the type that they came in, [k][j][i], i fastest. One of the vectors is the data.
using SampleArray = std::variant<std::vector<std::uint8_t>, std::vector<std::int16_t>, std::vector<std::uint16_t>,
                                 std::vector<float>, std::vector<double>>;

struct RegularFieldOptions {
    Vec3 spacing{1.0, 1.0, 1.0}; ///< world units between samples; lattice bcc: spacing.x is a
    /// The steps of i, j and k in the world, as columns, of a Cartesian lattice whose axes are not the world's;
    /// `spacing` is then their lengths.
    std::optional<Mat3> axes{};
    Vec3 origin{0.0, 0.0, 0.0}; ///< world position of sample (0, 0, 0)
    Lattice lattice = Lattice::cartesian;
    double radius = 2.0; ///< of the support, in sample distances (bcc: of a / sqrt 2)
    double falloff = 5.0;
    Normalization normalization = Normalization::lattice;
    double w0 = 1.0;
    NanPolicy nan = NanPolicy::error;
    /// The kernels get coefficients in place of the samples, counted from b, so that b and their sum pass through every
    /// sample; the normalisation becomes `none`. With the boundary `edge` the kernels of mirrored samples are in the
    /// sum, with the coefficients of what they are images of.
    bool prefilter = false;
    Boundary boundary = Boundary::edge;
    /// b. Unless given: boundary zero and normalisation none have 0; else the first sample that is not missing, if at
    /// least one in a hundred has its value, else the middle between the least and the largest.
    std::optional<double> base{};
    /// Where the samples are a part of a larger volume: the range of all its kernels, that of value_range().
    std::optional<std::array<double, 2>> value_range{};
    /// Where the samples are a part of a larger volume: Field::least_weight().
    double least_weight = 0.0;
    /// Where the samples stand for those of another volume with the boundary `edge`: where that ends.
    std::optional<Parallelepiped> domain{};
};

/// Where a kernel's support ends: M = R S of conventions, section 2.
struct KernelAxes {
    Mat3 directions{1.0}; ///< R, a rotation
    Vec3 lengths{1.0};    ///< the semi-axes S

    [[nodiscard]] bool is_sphere() const { return lengths.x == lengths.y && lengths.y == lengths.z; }
    [[nodiscard]] double least() const { return std::min({lengths.x, lengths.y, lengths.z}); }
    [[nodiscard]] double longest() const { return std::max({lengths.x, lengths.y, lengths.z}); }
    [[nodiscard]] double volume() const { return lengths.x * lengths.y * lengths.z; } ///< times 4 pi / 3
    /// M^T direction: its length is how far the support reaches along a direction of unit length.
    [[nodiscard]] Vec3 row(const Vec3& direction) const { return (direction * directions) * lengths; }
};

/// What the prefilter reached.
struct PrefilterFigures {
    double residual = 0.0;  ///< largest distance of the sums from a sample, over the largest |f - b|
    double condition = 1.0; ///< largest amplification of errors from samples to coefficients
    int steps = 0;
};

struct PrefilteredSamples {
    SampleArray coefficients; ///< float, or double where the samples are or where float has too few digits
    PrefilterFigures figures;
};

/// The condition number of the equations of the prefilter. Throws InvalidInput for kernels that cannot be prefiltered:
/// too wide, or a spectrum that is not above 0 or spans more than 2000.
double prefilter_condition(Lattice lattice, double radius, double falloff);

/// Samples begin <= i < end of a row.
struct SampleRange {
    std::uint32_t begin = 0, end = 0;
};

/// A Cartesian or BCC volume. Immutable. Rows of samples are found by row(), because mirrored rows are those that they
/// are images of; rows of a field with the boundary `edge` are kept with the mirrored samples of both their ends.
class RegularField final : public Field {
  public:
    /// samples: nk * nj * ni values, i fastest; shape: {nk, nj, ni} as the array [k, j, i] says.
    /// Throws InvalidInput for empty or mismatched arrays, NaN (unless skipped), infinities, spacing, radius or falloff
    /// <= 0; with prefilter for normalisation threshold, any NaN, and kernels whose sums lose the samples, OutOfMemory
    /// where the coefficients do not fit, Error where the sums stay farther than 1e-6 of the largest |f - b| from one,
    /// Cancelled where `progress` returns false while the prefilter runs.
    RegularField(SampleArray samples, std::array<std::size_t, 3> shape, const RegularFieldOptions& options = {},
                 const Progress& progress = {});
    /// With coefficients that another field of these samples, kernels, lattice and boundary found, counted from the
    /// same base: options must give it where their normalisation is `none`, which has 0 else.
    RegularField(SampleArray samples, PrefilteredSamples found, std::array<std::size_t, 3> shape,
                 const RegularFieldOptions& options);

    [[nodiscard]] FieldKind kind() const override { return FieldKind::regular; }
    [[nodiscard]] std::size_t size() const override { return kernels_; }
    [[nodiscard]] Box centres_world() const override { return centres_world_; }
    [[nodiscard]] Box supports_world() const override;
    [[nodiscard]] std::array<double, 2> value_range() const override { return value_range_; }
    [[nodiscard]] double default_slice_spacing() const override;
    [[nodiscard]] std::array<double, 2> reach_along(const Vec3& from, const Vec3& direction) const override;
    [[nodiscard]] std::size_t memory() const override;

    /// {nk, nj, ni}
    [[nodiscard]] const std::array<std::size_t, 3>& shape() const { return shape_; }
    [[nodiscard]] const RegularFieldOptions& options() const { return options_; }
    [[nodiscard]] Lattice lattice() const { return options_.lattice; }
    /// The factors of the kernels, row after row (see row()): the samples, with `prefilter` their coefficients.
    [[nodiscard]] const SampleArray& samples() const { return *samples_; }
    /// Where row (j, k) begins: its sample i is number row(j, k) + i of samples().
    [[nodiscard]] std::size_t row(std::size_t j, std::size_t k) const {
        return layers_[k] + rows_[rows_.size() > 1 ? k % 2 : 0][j];
    }
    /// What is subtracted from a number of samples() for f - b: base(), and 0 with `prefilter`, whose coefficients are
    /// counted from it.
    [[nodiscard]] double counted_from() const { return prefilter_ ? 0.0 : base_; }
    /// The samples as they were given, row after row as samples() without `prefilter`, else without gaps.
    [[nodiscard]] const SampleArray& given_samples() const { return prefilter_ ? *given_ : *samples_; }
    /// Smallest and largest of these.
    [[nodiscard]] const std::array<double, 2>& given_range() const { return given_range_; }
    [[nodiscard]] const std::optional<PrefilterFigures>& prefilter() const { return prefilter_; }
    /// True where a NaN was skipped somewhere, so that the lattice has holes.
    [[nodiscard]] bool has_holes() const { return has_holes_; }
    /// The samples of row (j, k) that may be kernels: outside are none.
    [[nodiscard]] SampleRange kernels_of_row(std::size_t j, std::size_t k) const {
        if (extents_.empty()) {
            return {0, static_cast<std::uint32_t>(shape_[2])};
        }
        const std::size_t row = k * shape_[1] + j;
        return extents_[extent_of_row_.empty() ? row : extent_of_row_[row]];
    }

    /// Which sample, (k * nj + j) * ni + i, a number of samples() is or mirrors; -1 for -1.
    [[nodiscard]] std::int64_t sample_of(std::int64_t number) const;

    /// World position of sample (i, j, k).
    [[nodiscard]] Vec3 position(std::size_t i, std::size_t j, std::size_t k) const;
    /// f - b of sample (i, j, k) as float64; NaN where skipped.
    [[nodiscard]] double value(std::size_t i, std::size_t j, std::size_t k) const;
    /// From sample to sample, row to row and layer to layer in the world, as columns. (Odd layers of BCC lattices lie
    /// half a step of samples and of rows farther.)
    [[nodiscard]] const Mat3& steps() const { return steps_; }
    /// The volume of a cell of these steps.
    [[nodiscard]] double step_volume() const;
    /// Of every kernel's support.
    [[nodiscard]] const KernelAxes& kernel_axes() const { return kernel_axes_; }
    /// C of normalisation lattice: the kernel's mass over the volume that one sample stands for.
    [[nodiscard]] double lattice_constant() const;

    /// Where the field ends: half a sample distance beyond the outermost samples (BCC: a / 4 beyond the box of all
    /// centres), or nowhere. A BCC lattice of one layer counts as boundary zero.
    [[nodiscard]] const std::optional<Parallelepiped>& domain() const override { return domain_; }
    /// Mirrored samples before the first one along k, j and i; as many lie beyond the last one. 0 for boundary zero.
    [[nodiscard]] const std::array<std::size_t, 3>& mirrored() const { return mirrored_; }
    /// The lattice of the same kernels and the mirrored ones whose supports reach into the domain, whose sample
    /// (0, 0, 0) is the farthest mirrored one: a field of boundary zero with this one's base, its sums being the law's
    /// everywhere. Shares the samples. Null for boundary zero.
    [[nodiscard]] std::shared_ptr<const RegularField> with_mirrored() const;
    /// What the lattice counts as in a group with fields that end elsewhere: a field of boundary zero with the base 0.
    /// Shares the samples, except with `prefilter`, which runs again.
    [[nodiscard]] std::shared_ptr<const RegularField> without_end() const;
    /// Smallest and largest f - b of the samples that are at most so many from the outermost ones along any axis.
    [[nodiscard]] std::array<double, 2> range_near_ends(std::size_t samples) const;

  private:
    /// found: null where the prefilter is still to be run, if `options` say so.
    RegularField(SampleArray samples, std::array<std::size_t, 3> shape, const RegularFieldOptions& options,
                 const Progress& progress, PrefilteredSamples* found);
    /// with_mirrored() of a field.
    struct Mirrored {};
    RegularField(const RegularField& inner, Mirrored);
    /// without_end() of one without a prefilter.
    struct Endless {};
    RegularField(const RegularField& inner, Endless);
    /// Makes coefficients the factors of the kernels.
    void take(PrefilteredSamples&& found);
    /// Steps and kernels' axes of the options.
    void find_axes();
    /// Where the field ends, and how many mirrored samples reach into it.
    void find_domain();
    /// Smallest and largest (x - from) . direction over all centres.
    [[nodiscard]] std::array<double, 2> centres_along(const Vec3& from, const Vec3& direction) const;
    /// Keeps samples row after row with mirrored ones at both ends.
    [[nodiscard]] std::shared_ptr<const SampleArray> with_ends(SampleArray&& samples) const;
    void find_rows();
    void find_outermost_rows();
    /// Keeps extents of rows as numbers of different ones, where these are few.
    void number_extents();

    std::shared_ptr<const SampleArray> samples_, given_;
    std::array<std::size_t, 3> shape_{};
    RegularFieldOptions options_;
    Box centres_world_;
    std::optional<Parallelepiped> domain_;
    Mat3 steps_{1.0};
    KernelAxes kernel_axes_;
    std::array<std::size_t, 3> mirrored_{0, 0, 0};
    std::vector<std::size_t> layers_;            ///< where layers begin
    std::vector<std::vector<std::size_t>> rows_; ///< where rows begin in a layer; BCC: of even and of odd layers
    /// Kernels of each row, or of what extent_of_row_ numbers; empty: all samples.
    std::vector<SampleRange> extents_;
    std::vector<std::uint8_t> extent_of_row_; ///< of few different extents: which one each row has
    /// Rows that hold all corners of the convex hull of kernels' centres: what any direction's farthest ones lie in.
    /// Empty: not looked for.
    std::vector<std::uint32_t> outermost_rows_;
    std::array<double, 2> value_range_{0.0, 0.0}, given_range_{0.0, 0.0};
    std::optional<PrefilterFigures> prefilter_;
    std::size_t kernels_ = 0;
    bool has_holes_ = false;
};

/// Scattered kernels, one entry (or three or four) a kernel. What a constructor leaves empty is the same for all.
struct EllipsoidArrays {
    std::vector<Vec3> centers;         ///< world
    std::vector<double> radii;         ///< isotropic kernels: N semi-axes; else empty
    std::vector<Vec3> scales;          ///< N semi-axes of the support along the kernel's own axes; empty for radii
    std::vector<glm::dquat> rotations; ///< N unit quaternions, own axes -> world axes; empty: none is turned
    std::vector<double> values;        ///< f
    std::vector<double> weights;       ///< m >= 0; empty: 1
    bool unit_rotations = false;       ///< the rotations are those of another field, and are kept to the bit
};

struct EllipsoidFieldOptions {
    Normalization normalization = Normalization::threshold;
    double w0 = 1.0;
    double falloff = 8.0;
    std::optional<double> min_scale{};   ///< world units; shorter semi-axes are raised to it
    std::optional<double> cell_volume{}; ///< V of normalisation lattice: the volume that one kernel stands for
    double base = 0.0;                   ///< b
    double least_weight = 0.0;           ///< Field::least_weight()
    /// Where the kernels are a part of a larger field: that of its value_range().
    std::optional<std::array<double, 2>> value_range{};
    /// A box whose opposite faces are one and the same: what leaves it by one comes in by the other. An axis whose
    /// lower and upper end are equal, or one of which is infinite, does not wrap.
    std::optional<Box> periodic{};
    /// Where the kernels stand for a field that ends: where that does. Not with `periodic`, which has its own ends.
    std::optional<Parallelepiped> domain{};
    /// Where the kernels stand for another field: its default_slice_spacing().
    std::optional<double> slice_spacing{};
};

/// Ellipsoidal Gaussians of any place, size and direction ([NM06]). Immutable; may have no kernels at all.
///
/// In a periodic box centres are moved into it, and kernels whose supports cross a face get images, which are kernels
/// like all others and follow those that were given; the field ends at the faces.
class EllipsoidField final : public Field {
  public:
    /// Throws InvalidInput, with the index of the first wrong entry, for arrays of unequal length, numbers that are not
    /// finite, semi-axes <= 0 (see min_scale), quaternions farther than 1e-3 from unit length (closer ones are
    /// normalised), negative weights, weights that are all 0; for falloff, w0, min_scale or cell_volume that are not
    /// finite and positive; for normalisation lattice without cell_volume or with kernels of different volume (relative
    /// difference above 1e-6); for a periodic box whose lower end is above its upper one, and kernels of more than
    /// 1000 images. OutOfMemory where the images do not fit.
    explicit EllipsoidField(EllipsoidArrays arrays, const EllipsoidFieldOptions& options = {});

    [[nodiscard]] FieldKind kind() const override { return FieldKind::ellipsoid; }
    [[nodiscard]] std::size_t size() const override { return arrays_.centers.size(); }
    [[nodiscard]] Box centres_world() const override { return centres_world_; }
    [[nodiscard]] Box supports_world() const override { return supports_world_; }
    [[nodiscard]] std::array<double, 2> value_range() const override { return value_range_; }
    /// Half the median smallest semi-axis, at least 1/2048 of the diagonal of the centres' box.
    [[nodiscard]] double default_slice_spacing() const override { return slice_spacing_; }
    [[nodiscard]] std::array<double, 2> reach_along(const Vec3& from, const Vec3& direction) const override;
    [[nodiscard]] std::size_t memory() const override;
    [[nodiscard]] const std::optional<Parallelepiped>& domain() const override { return domain_; }

    /// Number of the kernels that were given, which come before their images.
    [[nodiscard]] std::size_t given() const { return size() - owners_.size(); }
    /// Which of them a kernel is, or is an image of; -1 for -1.
    [[nodiscard]] std::int64_t given_kernel(std::int64_t number) const;
    /// The kernels that were given as a field that does not end: what it counts as in a group with fields that end
    /// elsewhere.
    [[nodiscard]] std::shared_ptr<const EllipsoidField> without_end() const;

    [[nodiscard]] const EllipsoidArrays& arrays() const { return arrays_; }
    [[nodiscard]] const EllipsoidFieldOptions& options() const { return options_; }
    [[nodiscard]] bool isotropic() const { return arrays_.scales.empty(); }

    [[nodiscard]] const Vec3& center(std::size_t i) const { return arrays_.centers[i]; }
    /// f - b of a kernel.
    [[nodiscard]] double value(std::size_t i) const { return arrays_.values[i] - base_; }
    [[nodiscard]] double weight(std::size_t i) const { return arrays_.weights.empty() ? 1.0 : arrays_.weights[i]; }
    /// The three semi-axes.
    [[nodiscard]] Vec3 semi_axes(std::size_t i) const {
        return arrays_.scales.empty() ? Vec3(arrays_.radii[i]) : arrays_.scales[i];
    }
    /// M = R S: its columns are the semi-axes as vectors in the world.
    [[nodiscard]] Mat3 shape(std::size_t i) const;
    /// The same for one kernel.
    [[nodiscard]] std::array<double, 2> reach_along(std::size_t i, const Vec3& from, const Vec3& direction) const;
    /// Half the extents of the support along the world's axes: lengths of M's rows.
    [[nodiscard]] Vec3 extent(std::size_t i) const;
    /// Smallest and largest weight; 1, 1 for a field without kernels.
    [[nodiscard]] const std::array<double, 2>& weight_range() const { return weight_range_; }
    /// Smallest and largest semi-axis of all; 0, 0 for a field without kernels.
    [[nodiscard]] const std::array<double, 2>& scale_range() const { return scale_range_; }
    /// C of normalisation lattice: a kernel's mass over cell_volume.
    [[nodiscard]] double lattice_constant() const { return lattice_constant_; }

  private:
    /// Moves centres into the periodic box.
    void wrap_centers();
    /// Adds the images of kernels whose supports cross a face.
    void add_images();

    EllipsoidArrays arrays_;
    EllipsoidFieldOptions options_;
    std::vector<std::size_t> owners_; ///< of the images
    std::optional<Parallelepiped> domain_;
    Box centres_world_, supports_world_;
    std::array<double, 2> value_range_{0.0, 0.0};
    std::array<double, 2> weight_range_{1.0, 1.0};
    std::array<double, 2> scale_range_{0.0, 0.0};
    double slice_spacing_ = 0.0;
    double lattice_constant_ = 1.0;
};

/// The field as what it is; null where it is something else.
inline const RegularField* as_regular(const Field* field) {
    return field != nullptr && field->kind() == FieldKind::regular ? static_cast<const RegularField*>(field) : nullptr;
}
inline const EllipsoidField* as_ellipsoids(const Field* field) {
    return field != nullptr && field->kind() == FieldKind::ellipsoid ? static_cast<const EllipsoidField*>(field)
                                                                     : nullptr;
}

} // namespace sheetsplat

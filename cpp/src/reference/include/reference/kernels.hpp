// The kernels of a field, in the world and as a camera sees them.
// Source: conventions, sections 1, 2 and 10; [NM06] section 3.2 for the factored form M = R S.
#pragma once

#include <array>
#include <cmath>
#include <cstdint>
#include <optional>

#include "reference/screen.hpp"
#include "sheetsplat/camera.hpp"
#include "sheetsplat/field.hpp"
#include "sheetsplat/scene.hpp"

namespace sheetsplat::reference {

/// Profile g(r) of a kernel, and its mean over a part of a line.
class Profile {
  public:
    explicit Profile(double falloff);
    [[nodiscard]] double falloff() const { return falloff_; }

    /// g for r^2 < 1; the caller has made sure that the point is inside.
    [[nodiscard]] double at(double r_squared) const {
        // For small k the two exponentials are nearly equal; their difference in closed form is not.
        return (falloff_ < 1.0 ? edge_ * std::expm1(falloff_ * (1.0 - r_squared))
                               : std::exp(-falloff_ * r_squared) - edge_) *
               gain_;
    }

    /// What q is multiplied by in the derivative of g by q: -2 k exp(-k r^2) / (1 - exp(-k)), at r^2 < 1.
    [[nodiscard]] double slope(double r_squared) const {
        return -2.0 * falloff_ * gain_ * std::exp(-falloff_ * r_squared);
    }

    /// Integrals of exp(-k r^2) / (1 - exp(-k)) and of that times u over the part of a line that `integral` knows.
    struct Moments {
        double zeroth = 0.0, first = 0.0;
    };
    [[nodiscard]] Moments moments(double b_squared, double from, double to) const;

    /// Integral of g over the part of a line that begins and ends at `from` and `to` (units of the support's radius
    /// along the line, 0 next to the centre), at the squared distance b_squared < 1 from the centre; both ends are
    /// inside the ball. Closed form of conventions, section 3, Gauss-Legendre where its differences would cancel.
    [[nodiscard]] double integral(double b_squared, double from, double to) const;

  private:
    /// Integral of exp(-k (b^2 + u^2)).
    [[nodiscard]] double gaussian(double b_squared, double from, double to) const;

    double falloff_, root_falloff_, edge_, gain_;
};

/// The part of a line that is inside a kernel's support, and g's integral over it.
struct Chord {
    bool reached = false; ///< false where the support does not meet the line between the two depths
    double mean = 0.0;    ///< of g over all depths from front to back, zero outside of the support
    Vec3 slope{0.0};      ///< the same of the gradient of g, eye space; where it was asked for
};

/// The two ends of something; nothing where lower > upper.
struct Interval {
    double lower = 1.0, upper = -1.0;
    [[nodiscard]] bool empty() const { return !(lower <= upper); }
};

/// The ellipsoid { B q : |q| < 1 } in eye space, about its centre. Depths here are less the centre's.
class KernelShape {
  public:
    /// B = E S. axes_eye: E, whose columns are the kernel's own axes in eye space, unit vectors; semi_axes: S.
    KernelShape(const Mat3& axes_eye, const Vec3& semi_axes);
    /// The shape after the EWA filter of section 10: B B^T + diag(across^2, across^2, along^2), by a
    /// Householder QR of [B^T; diag(across, across, along)], whose triangle is the transpose of the new B.
    static KernelShape filtered(const Mat3& axes_eye, const Vec3& semi_axes, double across, double along);

    /// Half the support's extent in depth: |B^T e_z|.
    [[nodiscard]] double half_depth() const { return half_depth_; }
    /// What the filter makes of the amplitude: det B before over det B after; 1 without a filter.
    [[nodiscard]] double amplitude() const { return amplitude_; }
    /// q = B^-1 d for an eye-space difference d from the centre.
    [[nodiscard]] Vec3 to_unit(const Vec3& from_centre_eye) const { return to_unit_ * from_centre_eye; }

    /// B^-T v: the gradient in eye space of what has the gradient v by q.
    [[nodiscard]] Vec3 slope_to_eye(const Vec3& by_unit) const { return by_unit * to_unit_; }

    /// Bounds of x (y) over the part of the support between two depths: those of the cross-section where both are the
    /// same. Never too small.
    [[nodiscard]] Interval bounds_x(double front, double back) const {
        return bounds(drift_x_, spread_x_, front, back);
    }
    [[nodiscard]] Interval bounds_y(double front, double back) const {
        return bounds(drift_y_, spread_y_, front, back);
    }
    /// Bounds of x over the part of the support between two depths that is in the plane y = y_0 + slope_y depth (a row
    /// of pixels). Never too small; all of bounds_x where rounding leaves nothing better.
    [[nodiscard]] Interval bounds_in_row(double y_0, double slope_y, double front, double back) const;

    /// Mean of g, and of its gradient where wanted, between two depths along the line that moves by (slope_x, slope_y,
    /// -1) per unit of depth and is at `beside` at the centre's depth.
    [[nodiscard]] Chord mean(const Profile& profile, const Vec3& beside, double slope_x, double slope_y, double front,
                             double back, bool with_slope = false) const;

  private:
    KernelShape() = default;
    /// Takes the rows of B.
    void measure(const Vec3& x, const Vec3& y, const Vec3& z);
    [[nodiscard]] Interval bounds(double drift, double spread, double front, double back) const;

    Mat3 to_unit_{1.0};
    double half_depth_ = 1.0;
    double amplitude_ = 1.0;
    /// The cross-section at the share s of the half-depth towards the eye is an ellipse about s drift, sqrt(1 - s^2)
    /// spread wide to either side.
    double drift_x_ = 0.0, drift_y_ = 0.0, spread_x_ = 1.0, spread_y_ = 1.0;
};

/// One kernel in the world.
struct WorldKernel {
    Vec3 centre{0.0};
    Mat3 axes{1.0}; ///< R: columns are the own axes
    Vec3 semi_axes{1.0};
    double value = 0.0;
    double weight = 1.0;
};

/// The kernels of any field by number: those of a lattice's samples and of the mirrored ones around them, i fastest and
/// k slowest; those of ellipsoids in their order.
class WorldKernels {
  public:
    explicit WorldKernels(const Field& field);

    /// Numbers are 0 ... numbers() - 1; a skipped sample has a number, but no kernel, and so have its images and
    /// mirrored samples whose supports do not reach into the domain.
    [[nodiscard]] std::uint64_t numbers() const { return numbers_; }
    [[nodiscard]] std::optional<WorldKernel> at(std::uint64_t number) const;
    /// C of normalisation lattice.
    [[nodiscard]] double lattice_constant() const;

  private:
    /// Of a lattice along i, j or k. Places along it are counted in layers from the first one: of BCC, layers are half
    /// an edge apart, and each index has an even and an odd one.
    struct Axis {
        std::int64_t first = 0, count = 1;      ///< indices, of mirrored samples too
        std::int64_t last_layer = 0;            ///< of those that were given
        std::array<double, 2> domain{0.0, 0.0}; ///< from where to where the field is, in layers
        [[nodiscard]] double outside(double layer) const;
    };
    /// The layers along an axis whose samples may reach into the domain, if there is one.
    [[nodiscard]] Axis axis_of(int axis) const;
    [[nodiscard]] std::optional<WorldKernel> sample(std::uint64_t number) const;

    const RegularField* regular_;
    const EllipsoidField* ellipsoids_;
    std::uint64_t numbers_ = 0;
    bool bcc_ = false;
    std::array<Axis, 3> axes_;   ///< i, j, k
    double reach_squared_ = 0.0; ///< of a support, in layers
};

/// One kernel as a camera sees it, after the filter.
struct EyeKernel {
    Vec3 centre; ///< eye space
    KernelShape shape;
    double value;  ///< m f times the filter's amplitude
    double weight; ///< m times the filter's amplitude
    double scalar; ///< f

    [[nodiscard]] double depth() const { return -centre.z; }
};

/// The kernels of a field as a camera sees them.
class EyeKernels {
  public:
    /// radius_factor multiplies all semi-axes, before the filter. What is referred to must live as long as this.
    EyeKernels(const Field& field, const Scene& scene, const Camera& camera, const Screen& screen,
               double radius_factor);

    /// visit(number, kernel) for every kernel, numbers rising.
    template <class Visit>
    void for_each(Visit&& visit) const {
        for (std::uint64_t number = 0; number < world_.numbers(); ++number) {
            if (const std::optional<WorldKernel> kernel = world_.at(number)) {
                visit(number, seen(*kernel));
            }
        }
    }
    /// A number that for_each visits.
    [[nodiscard]] EyeKernel at(std::uint64_t number) const { return seen(*world_.at(number)); }

  private:
    [[nodiscard]] EyeKernel seen(const WorldKernel& kernel) const;
    [[nodiscard]] KernelShape shape_of(const WorldKernel& kernel, double depth) const;

    WorldKernels world_;
    const Screen& screen_;
    Vec3 eye_, right_, up_, backward_;
    bool filter_;
    double filter_radius_; ///< of the filter's support, in pixels and in slice distances
    double nearest_;       ///< least depth at which the filter measures a pixel
    double spacing_;
    double radius_factor_;
    std::optional<KernelShape> common_shape_; ///< where all kernels have it
};

} // namespace sheetsplat::reference

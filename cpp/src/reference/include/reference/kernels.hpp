// The kernels of a regular field as a camera sees them. Source: IMAGE FORMATION sections 1 and 2.
#pragma once

#include <array>
#include <cmath>
#include <cstdint>

#include "sheetsplat/camera.hpp"
#include "sheetsplat/field.hpp"

namespace sheetsplat::reference {

/// Profile g(r) of a kernel, and its mean over a part of a line.
class Profile {
  public:
    explicit Profile(double falloff);

    /// g for r^2 < 1; the caller has made sure that the point is inside.
    [[nodiscard]] double at(double r_squared) const {
        // For small k the two exponentials are nearly equal; their difference in closed form is not.
        return (falloff_ < 1.0 ? edge_ * std::expm1(falloff_ * (1.0 - r_squared))
                               : std::exp(-falloff_ * r_squared) - edge_) *
               gain_;
    }

    /// Integral of g over the part of a line that begins and ends at `from` and `to` (units of the support's radius
    /// along the line, 0 next to the centre), at the squared distance b_squared < 1 from the centre; both ends are
    /// inside the ball. Closed form of IMAGE FORMATION section 3, Gauss-Legendre where its differences would cancel.
    [[nodiscard]] double integral(double b_squared, double from, double to) const;

  private:
    double falloff_, root_falloff_, edge_, gain_;
};

/// The part of a line that is inside a kernel's support, and g's integral over it.
struct Chord {
    bool reached = false; ///< false where the support does not meet the line between the two depths
    double mean = 0.0;    ///< of g over all depths from front to back, zero outside of the support
};

/// What all kernels of a field have in common for one camera.
class KernelShape {
  public:
    KernelShape(const RegularField& field, const Camera& camera, double radius_factor);

    /// Eye-space position of a kernel.
    [[nodiscard]] Vec3 centre_eye(const Vec3& position_world) const;
    /// Half the extents of the support along the eye's axes.
    [[nodiscard]] const Vec3& reach() const { return reach_; }
    /// q = M^-1 d for an eye-space difference d from the centre.
    [[nodiscard]] Vec3 to_unit(const Vec3& from_centre_eye) const { return to_unit_ * from_centre_eye; }
    [[nodiscard]] const Profile& profile() const { return profile_; }

    /// Mean of g between two depths along the line through the eye-space point `centre` + `beside` (of the same depth
    /// as the centre) that moves by (slope_x, slope_y, -1) per unit of depth. front and back are depths less the
    /// centre's.
    [[nodiscard]] Chord mean(const Vec3& beside, double slope_x, double slope_y, double front, double back) const;

  private:
    Vec3 eye_;
    Vec3 right_, up_, backward_;
    Mat3 to_unit_; ///< eye-space differences to the kernel's unit-sphere space
    Vec3 reach_{0.0};
    Profile profile_;
};

/// visit(id, position_world, value) for every kernel in memory order; id = (k * nj + j) * ni + i. NaN is no kernel.
template <class Visit>
void for_each_kernel(const RegularField& field, Visit&& visit) {
    const auto [nk, nj, ni] = field.shape();
    std::uint64_t id = 0;
    for (std::size_t k = 0; k < nk; ++k) {
        for (std::size_t j = 0; j < nj; ++j) {
            for (std::size_t i = 0; i < ni; ++i, ++id) {
                const double value = field.value(i, j, k);
                if (!std::isnan(value)) {
                    visit(id, field.position(i, j, k), value);
                }
            }
        }
    }
}

} // namespace sheetsplat::reference

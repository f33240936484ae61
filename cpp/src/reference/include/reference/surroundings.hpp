// Shadows and ambient occlusion of a point. Source: conventions, section 10 (shadows); project page of
// conventions, section 10 (shadows, ambient occlusion).
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "reference/clip.hpp"
#include "reference/points.hpp"
#include "reference/screen.hpp"
#include "sheetsplat/camera.hpp"
#include "sheetsplat/scene.hpp"

namespace sheetsplat::reference {

/// The opacities of a scene with shadows or ambient occlusion, along lines that begin anywhere in eye space.
class Surroundings {
  public:
    /// What is referred to must live as long as this. Throws OutOfMemory.
    Surroundings(const Scene& scene, const Camera& camera, const Screen& screen, const Clipping& clipping,
                 double radius_factor);

    /// Share of a light in this direction (unit vector) that reaches the point. `rho_shift` is added to rho, as a nudge
    /// of section 9.
    [[nodiscard]] double light(const Vec3& point_eye, const Vec3& to_light, double rho_shift) const;
    /// Share of ambient light that is left at the point.
    [[nodiscard]] double ambient(const Vec3& point_eye, double rho_shift) const;

  private:
    /// Product of 1 - alpha over the points that are 1 ... steps slice distances away.
    [[nodiscard]] double left_along(const Vec3& point_eye, const Vec3& direction, double steps, double rho_shift) const;
    /// Slice distances from the point to where the line has left all supports; below 1 where none is ahead.
    [[nodiscard]] double steps_to_end(const Vec3& point_eye, const Vec3& direction) const;

    const Scene& scene_;
    const Clipping& clipping_;
    std::vector<PointSums> fields_;
    Box supports_eye_;
    double spacing_;
    double lengths_;                ///< reference lengths in a slice distance
    double occlusion_steps_ = 0;    ///< M
    std::array<Vec3, 14> around_{}; ///< the directions of ambient occlusion, eye space
};

} // namespace sheetsplat::reference

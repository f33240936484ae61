// Cameras: orthographic and perspective. Eye space is x right, y up, looking along -z; depth t = -z_eye.
// Source: conventions, section 1.
#pragma once

#include <optional>

#include "sheetsplat/types.hpp"

namespace sheetsplat {

enum class Projection { orthographic, perspective };

/// Immutable. All of it float64, so that centres around 1e9 keep their detail once they are camera-relative.
class Camera {
  public:
    /// height: world units from the bottom edge of the image to the top.
    /// Throws InvalidInput where eye = target, up is along the view, a number is not finite or height <= 0.
    static Camera orthographic(const Vec3& eye, const Vec3& target, const Vec3& up, double height);
    /// fov_y: vertical angle in degrees, 0 < fov_y < 180, of a picture whose middle the optical axis meets. near: depth
    /// in front of which nothing is shown; 1e-3 |eye - target| unless given. shift: from the optical axis to the middle
    /// of the picture, right and up, in heights of the picture.
    static Camera perspective(const Vec3& eye, const Vec3& target, const Vec3& up, double fov_y,
                              std::optional<double> near = std::nullopt, const Vec2& shift = Vec2(0.0));
    /// A camera that looks along `direction` at a box and shows all of it in a square picture, `margin` times larger.
    static Camera fit(const Box& box_world, const Vec3& direction, const Vec3& up,
                      Projection projection = Projection::orthographic, double margin = 1.05, double fov_y = 30.0);

    [[nodiscard]] Projection projection() const { return projection_; }
    [[nodiscard]] const Vec3& eye() const { return eye_; }
    [[nodiscard]] const Vec3& target() const { return target_; }
    [[nodiscard]] const Vec3& up() const { return up_; }
    [[nodiscard]] double height() const { return height_; }    ///< orthographic: H in world units
    [[nodiscard]] double fov_y() const { return fov_y_; }      ///< perspective: degrees
    [[nodiscard]] double near() const { return near_; }        ///< perspective: depth
    [[nodiscard]] const Vec2& shift() const { return shift_; } ///< perspective: right and up, heights of the picture

    /// Unit vectors of eye space in world coordinates: x right, y up, z towards the viewer (minus the view direction).
    [[nodiscard]] const Vec3& right_world() const { return right_; }
    [[nodiscard]] const Vec3& up_world() const { return true_up_; }
    [[nodiscard]] const Vec3& back_world() const { return back_; }

    /// Eye-space position of a world point.
    [[nodiscard]] Vec3 to_eye(const Vec3& point_world) const;
    /// Eye-space components of a world direction.
    [[nodiscard]] Vec3 direction_to_eye(const Vec3& direction_world) const;
    /// Half the image's height per unit of depth (perspective: tan(fov/2)), or in world units (orthographic: H/2).
    [[nodiscard]] double half_height() const;

  private:
    Camera() = default;
    Projection projection_ = Projection::orthographic;
    Vec3 eye_{0.0}, target_{0.0}, up_{0.0};
    Vec3 right_{1.0, 0.0, 0.0}, true_up_{0.0, 1.0, 0.0}, back_{0.0, 0.0, 1.0};
    double height_ = 1.0;
    double fov_y_ = 30.0;
    double near_ = 0.0;
    Vec2 shift_{0.0};
};

} // namespace sheetsplat

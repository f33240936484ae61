// Shadows and ambient occlusion of a point. Source: conventions, section 10 (shadows, ambient occlusion).
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "reference/clip.hpp"
#include "reference/counted.hpp"
#include "reference/points.hpp"
#include "reference/screen.hpp"
#include "scene/mode_rules.hpp"
#include "sheetsplat/camera.hpp"
#include "sheetsplat/scene.hpp"

namespace sheetsplat::reference {

/// What dims light in a scene with shadows or ambient occlusion, along lines that begin anywhere in eye space: the
/// opacities of points, in mode isosurface the surfaces.
class Surroundings {
  public:
    /// What is referred to must live as long as this. Throws OutOfMemory.
    Surroundings(const CountedScene& counted, const Camera& camera, const Screen& screen, const Clipping& clipping,
                 double radius_factor);

    /// Share of a light in this direction (unit vector) that reaches the point. `nudge`: that of rho, section 9.
    [[nodiscard]] double light(const Vec3& point_eye, const Vec3& to_light, double nudge) const;
    /// Share of ambient light that is left at the point.
    [[nodiscard]] double ambient(const Vec3& point_eye, double nudge) const;

  private:
    struct GroupValue {
        double rho = 0.0; ///< counted from the group's base, nudged
        bool empty = true;
        bool ended = false; ///< the point is outside of the group's domain
    };
    struct Place {
        std::vector<GroupValue> groups;
        bool kept = false; ///< by clipping
    };
    [[nodiscard]] Place look_at(const Vec3& point_eye, double nudge) const;
    /// 1 - alpha of a point.
    [[nodiscard]] double left_at(const Place& place) const;
    /// Product of 1 - o over the surfaces between two points.
    [[nodiscard]] double left_between(const Place& front, const Place& back) const;
    /// Product over what is between 1 and `steps` slice distances away.
    [[nodiscard]] double left_along(const Vec3& point_eye, const Vec3& direction, double steps, double nudge) const;
    /// Slice distances from the point to where the line has left all supports; below 1 where none is ahead.
    [[nodiscard]] double steps_to_end(const Vec3& point_eye, const Vec3& direction) const;

    const CountedScene& counted_;
    const Scene& scene_;
    const Clipping& clipping_;
    std::vector<PointSums> fields_; ///< those of the scene
    std::vector<Group> groups_;
    std::vector<GroupRange> label_sets_;
    std::vector<Clipping> ends_; ///< of the groups
    Box supports_eye_;
    double spacing_;
    double lengths_;                ///< reference lengths in a slice distance
    double occlusion_steps_ = 0;    ///< M
    std::array<Vec3, 14> around_{}; ///< the directions of ambient occlusion, eye space
};

} // namespace sheetsplat::reference

// Which points of the world clipping keeps, and which belong to a part. Source: conventions, sections 10 (clipping) and
// 11 (parts).
#pragma once

#include <limits>
#include <optional>
#include <vector>

#include "sheetsplat/camera.hpp"
#include "sheetsplat/scene.hpp"

namespace sheetsplat::reference {

/// Where a ray enters what is kept: of several faces the last.
struct CutFace {
    double depth = -std::numeric_limits<double>::infinity();
    Vec3 normal{0.0}; ///< unit length, eye space, outward
};

/// Clipping planes and a box in eye space: a scene's, or those where a field ends.
class Clipping {
  public:
    Clipping(const Scene& scene, const Camera& camera) : Clipping(scene.clip, camera, scene.slice_distance()) {}
    Clipping(const Clip& clip, const Camera& camera, double slice_distance);

    /// True where all of them keep the point. A point closer to a plane than a millionth of a slice distance is on it,
    /// and kept.
    [[nodiscard]] bool keeps(const Vec3& point_eye) const;
    /// The face through which a ray, at depth t at start + t along, enters after `before`, or that one. Of faces that
    /// it enters within a thousandth of a slice distance the first counts.
    [[nodiscard]] CutFace entered(const Vec3& start, const Vec3& along, CutFace before = {}) const;

  private:
    struct HalfSpace {
        Vec3 normal;  // unit length, eye space
        double least; // of the dot product with a point
        std::optional<Vec3> center;
    };
    std::vector<HalfSpace> half_spaces_;
    double spacing_;
};

/// The cell of a scene that is a part of a larger one. Cells that share a face have no point in common and leave none
/// out, because both compare the same coordinate with the same number.
class Cell {
  public:
    /// Without a part every point is inside.
    Cell(const Scene& scene, const Camera& camera);

    [[nodiscard]] bool holds(const Vec3& point_eye) const;

  private:
    Mat3 to_box_{1.0};   ///< from eye axes
    Vec3 lower_, upper_; ///< from the eye
};

} // namespace sheetsplat::reference

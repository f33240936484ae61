// Which points of the world clipping keeps. Source: conventions, section 10 (clipping).
#pragma once

#include <vector>

#include "sheetsplat/camera.hpp"
#include "sheetsplat/scene.hpp"

namespace sheetsplat::reference {

/// A scene's clipping planes and box in eye space.
class Clipping {
  public:
    Clipping(const Scene& scene, const Camera& camera);

    /// True where all of them keep the point. A point closer to a plane than a millionth of a slice distance is on it,
    /// and kept.
    [[nodiscard]] bool keeps(const Vec3& point_eye) const;

  private:
    struct HalfSpace {
        Vec3 normal;  // unit length, eye space
        double least; // of the dot product with a point
    };
    std::vector<HalfSpace> half_spaces_;
};

} // namespace sheetsplat::reference

// The half spaces of a clip in eye space.
#pragma once

#include <optional>
#include <vector>

#include "sheetsplat/camera.hpp"
#include "sheetsplat/scene.hpp"

namespace sheetsplat {

/// A half space that is kept, in eye space: dot(normal, x) + distance >= 0. World units.
struct KeptHalfSpace {
    Vec3 normal{0.0};             ///< unit length
    double distance = 0.0;        ///< with what a point on the plane is allowed
    std::optional<Vec3> center{}; ///< as Clip::Plane has it
};

/// slice_spacing: points a millionth of it outside of a plane lie on it, and are kept (conventions, section 10).
std::vector<KeptHalfSpace> half_spaces_in_eye(const Clip& clip, const Camera& camera, double slice_spacing);

} // namespace sheetsplat

// What a scene's clip leaves of each pixel's slices. Source: conventions, section 10.
#pragma once

#include <cstdint>
#include <vector>

#include "facts/frame.hpp"
#include "sheetsplat/camera.hpp"
#include "sheetsplat/scene.hpp"

namespace sheetsplat {

/// The slices that a pixel keeps, as Frame counts them: those from first to last. None where first > last. Slices that
/// do not exist, before the first one and after the last, are among them where their points would be kept.
struct SliceRun {
    std::int32_t first = 0, last = -1;
    [[nodiscard]] bool holds(std::int64_t slice) const { return slice >= first && slice <= last; }
};

/// Half spaces are convex, so that what they leave of a ray is one run of slices: found in float64, with any number of
/// planes, it can be looked up in any number format.
class KeptSlices {
  public:
    KeptSlices(const Scene& scene, const Camera& camera, const Frame& frame);

    /// Of a pixel of the picture, or beyond its edges.
    [[nodiscard]] SliceRun at(int column, int row) const;

  private:
    /// Height over a plane at slice m: start + m step, each of them constant + x across + y up at the pixel's place.
    struct Height {
        double constant, across, up;
        [[nodiscard]] double at(double x, double y) const { return constant + x * across + y * up; }
    };
    struct Plane {
        Height start, step; ///< world units
    };
    std::vector<Plane> planes_;
    double half_columns_, half_rows_; ///< of the picture, pixels
    double pixel_;                    ///< width of a pixel, as Frame has it
    double lowest_;                   ///< height of what still counts as kept
};

} // namespace sheetsplat

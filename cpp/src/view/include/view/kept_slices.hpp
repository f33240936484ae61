// What a clip and a depth limit leave of each pixel's slices. Source: conventions, section 10.
#pragma once

#include <cstdint>
#include <vector>

#include "facts/frame.hpp"
#include "plan/make_plan.hpp"
#include "sheetsplat/camera.hpp"
#include "sheetsplat/scene.hpp"

namespace sheetsplat {

/// The slices that a pixel keeps, as Frame counts them: those from first to last. None where first > last. Slices that
/// do not exist, before the first one and after the last, are among them where their points would be kept.
struct SliceRun {
    std::int32_t first = 0, last = -1;
    [[nodiscard]] bool holds(std::int64_t slice) const { return slice >= first && slice <= last; }
};

/// The last slice of each pixel in front of a depth limit.
class SlicesInFront {
  public:
    /// limit: null where nothing is cut off. Refers to it.
    SlicesInFront(const DepthLimit* limit, const Frame& frame);

    /// Of a pixel of the picture; beyond its edges the one behind all slices. -2 where no slice is in front, nor what
    /// lies before the first one.
    [[nodiscard]] std::int32_t last(int column, int row) const;

  private:
    const DepthLimit* limit_;
    double first_depth_, spacing_;
    std::int64_t slices_;
};

/// The slices of each pixel that belong to the part of a whole that is drawn, with the intervals behind them; the one
/// before slice 0 belongs where slice 0 does. A face that two cells share divides every ray at the same slice in both,
/// because both find it from the same numbers.
class OwnedSlices {
  public:
    OwnedSlices(const Part& part, const Camera& camera, const Frame& frame);

    /// Of a pixel of the picture, or beyond its edges.
    [[nodiscard]] SliceRun at(int column, int row) const;

  private:
    /// Place along an axis of the world at slice m: start + m step, each constant + x across + y up.
    struct Axis {
        double start[3], step[3];
        double lower, upper; ///< of the cell, from the eye
    };
    std::vector<Axis> axes_; ///< those along which the cell ends
    double axis_x_, axis_y_;
    double pixel_;
    double slices_;
};

/// Half spaces are convex, so that what they leave of a ray is one run of slices: found in float64, with any number of
/// planes, it can be looked up in any number format.
class KeptSlices {
  public:
    /// The plan says whether clip and depth limit are on. Refers to the scene.
    KeptSlices(const Scene& scene, const DrawPlan& plan, const Camera& camera, const Frame& frame);
    /// What a clip alone leaves, such as the end of a field.
    KeptSlices(const Clip& clip, const DrawPlan& plan, const Camera& camera, const Frame& frame);

    /// Of a pixel of the picture, or beyond its edges.
    [[nodiscard]] SliceRun at(int column, int row) const;

  private:
    KeptSlices(const Clip* clip, const DepthLimit* limit, const DrawPlan& plan, const Camera& camera,
               const Frame& frame);

    /// Height over a plane at slice m: start + m step, each of them constant + x across + y up at the pixel's place.
    struct Height {
        double constant, across, up;
        [[nodiscard]] double at(double x, double y) const { return constant + x * across + y * up; }
    };
    struct Plane {
        Height start, step; ///< world units
    };
    std::vector<Plane> planes_;
    double axis_x_, axis_y_; ///< as Frame has them
    double pixel_;           ///< width of a pixel, as Frame has it
    double least_, most_;    ///< slices: those there are, of intervals any
    SlicesInFront in_front_;
};

} // namespace sheetsplat

// Where pixels' rays enter what a clip and the ends of fields keep, and the normals of the cuts there. Source:
// conventions, section 10.
#pragma once

#include <cstddef>
#include <limits>
#include <vector>

#include "facts/frame.hpp"
#include "plan/make_plan.hpp"
#include "sheetsplat/camera.hpp"
#include "sheetsplat/scene.hpp"
#include "view/half_spaces.hpp"

namespace sheetsplat {

/// The most that matter absorbs, -ln(2^-24), for what its faces count.
constexpr double thickest_face = 16.635532333438686;
/// Lengths of matter whose opacity says how much of a face is opaque, and behind which it fades.
constexpr double face_lengths = 4.0;

/// The face of a cut through which a ray comes.
struct CutFace {
    double slice = -std::numeric_limits<double>::infinity(); ///< where, as Frame counts them; infinite: there is none
    Vec3 normal{0.0};                                        ///< unit length, eye space, outward

    /// What it counts for matter `at_slice` slice distances behind slice 0 that absorbs so much of a slice's light,
    /// behind an opacity `in_front`; length: ShadingInputs::face_length.
    [[nodiscard]] double share(double at_slice, double absorbed, double in_front, double length) const;
};

/// Found in float64: what a pixel needs of them fits into any number format.
class CutFaces {
  public:
    CutFaces(const Scene& scene, const DrawPlan& plan, const Camera& camera, const Frame& frame);

    /// Of a pixel of the picture, or beyond its edges; group: of groups_drawn.
    [[nodiscard]] CutFace at(std::size_t group, int column, int row) const;

  private:
    /// A group each: the scene's clip, and where its fields end.
    std::vector<std::vector<KeptHalfSpace>> faces_;
    bool perspective_;
    double axis_x_, axis_y_, pixel_, first_depth_, spacing_; ///< as Frame has them
};

} // namespace sheetsplat

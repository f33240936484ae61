#include "view/cut_faces.hpp"

#include <algorithm>
#include <cmath>

#include <glm/geometric.hpp>

#include "scene/mode_rules.hpp"

namespace sheetsplat {

namespace {

/// Of faces that a ray enters within so many slice distances the first one counts.
constexpr double at_one_place = 1e-3;

} // namespace

double CutFace::share(double at_slice, double absorbed, double in_front, double length) const {
    const double thickness = std::min(absorbed * length, thickest_face);
    const double behind = (at_slice - slice) / length;
    const double through = std::min(-std::log1p(-in_front), thickest_face) / thickness;
    return -std::expm1(-face_lengths * thickness) * std::clamp(2.0 - behind / face_lengths, 0.0, 1.0) *
           std::clamp(2.0 - (behind - through), 0.0, 1.0);
}

CutFaces::CutFaces(const Scene& scene, const DrawPlan& plan, const Camera& camera, const Frame& frame)
    : perspective_(frame.projection == Projection::perspective), axis_x_(frame.axis_x), axis_y_(frame.axis_y),
      pixel_(frame.pixel), first_depth_(frame.first_depth), spacing_(frame.slice_spacing) {
    const std::vector<KeptHalfSpace> all =
        plan.clip ? half_spaces_in_eye(scene.clip, camera, spacing_) : std::vector<KeptHalfSpace>{};
    faces_.resize(groups_drawn(scene).size(), all);
    for (std::size_t group = 0; scene.counted && group < scene.counted->ends.size(); ++group) {
        for (const KeptHalfSpace& end : half_spaces_in_eye({{}, scene.counted->ends[group]}, camera, spacing_)) {
            faces_[group].push_back(end);
        }
    }
}

CutFace CutFaces::at(std::size_t group, int column, int row) const {
    const double x = (column + 0.5 - axis_x_) * pixel_, y = (axis_y_ - row - 0.5) * pixel_;
    const Vec3 start = perspective_ ? Vec3(0.0) : Vec3(x, y, 0.0),
               along = Vec3(x, y, 0.0) - start - Vec3(0.0, 0.0, 1.0);
    CutFace last;
    for (const KeptHalfSpace& half : faces_[group]) {
        const double rises = glm::dot(half.normal, along);
        if (!(rises > 0.0)) {
            continue;
        }
        const double depth = -(glm::dot(half.normal, start) + half.distance) / rises;
        const double slice = (depth - first_depth_) / spacing_;
        if (slice > last.slice + at_one_place) {
            last = {slice, half.center ? glm::normalize(start + depth * along - *half.center) : -half.normal};
        }
    }
    return last;
}

} // namespace sheetsplat

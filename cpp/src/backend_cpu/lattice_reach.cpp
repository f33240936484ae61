#include "backend_cpu/lattice_reach.hpp"

#include <cmath>

#include <glm/common.hpp>
#include <glm/geometric.hpp>
#include <glm/vector_relational.hpp>

#include "field/lattice_frame.hpp"

namespace sheetsplat::backend_cpu {

LatticeReach::LatticeReach(const Vec3& first_eye, const glm::dmat3& steps, const Vec3& last, double radius,
                           const Frame& frame)
    : frame_(&frame), to_index_(to_indices(steps)), first_eye_(first_eye), last_(last), radius_(radius) {}

void LatticeReach::add(const FieldView& view, const Frame& frame, std::vector<LatticeReach>& to) {
    const RegularField& field = *view.field;
    const auto [nk, nj, ni] = field.shape();
    const auto last = [](std::size_t i, std::size_t j, std::size_t k) {
        return Vec3(static_cast<double>(i), static_cast<double>(j), static_cast<double>(k)) - 1.0;
    };
    const double radius = field.options().radius;
    if (field.lattice() == Lattice::cartesian) {
        to.push_back({view.first_eye, {view.step_i, view.step_j, view.step_k}, last(ni, nj, nk), radius, frame});
        return;
    }
    // Even and odd layers, both cubic of edge a; distances count in a / sqrt 2.
    const glm::dmat3 steps{view.step_i, view.step_j, 2.0 * view.step_k};
    const double in_edges = radius * std::sqrt(0.5);
    to.push_back({view.first_eye, steps, last(ni, nj, (nk + 1) / 2), in_edges, frame});
    if (nk > 1) {
        to.push_back({view.eye_position(0, 0, 1), steps, last(ni, nj, nk / 2), in_edges, frame});
    }
}

LatticeReach::Places LatticeReach::places(const TileShape& tile, std::int64_t n) const {
    const double depth = frame_->depth_of(n);
    const double pixel = frame_->pixel * (frame_->projection == Projection::perspective ? depth : 1.0);
    const Vec3 corner((tile.x + 0.5 - frame_->axis_x) * pixel, (frame_->axis_y - tile.y - 0.5) * pixel, -depth);
    return {to_index_ * (corner - first_eye_), to_index_[0] * pixel, to_index_[1] * -pixel};
}

bool LatticeReach::has_gaps() const {
    // The point farthest from all samples is the middle of a cube.
    return !(radius_ > std::sqrt(0.75));
}

LatticeReach::Pixels LatticeReach::pixels(const TileShape& tile, const Places& places) const {
    // Index coordinates are linear over the tile.
    const Vec3 along = static_cast<double>(tile.width - 1) * places.by_column;
    const Vec3 down = static_cast<double>(tile.height - 1) * places.by_row;
    const Vec3 least = places.first + glm::min(along, 0.0) + glm::min(down, 0.0);
    const Vec3 most = places.first + glm::max(along, 0.0) + glm::max(down, 0.0);
    if (glm::any(glm::lessThan(most, Vec3(-radius_))) || glm::any(glm::greaterThan(least, last_ + radius_))) {
        return Pixels::none;
    }
    return !has_gaps() && glm::all(glm::greaterThanEqual(least, Vec3(0.0))) && glm::all(glm::lessThanEqual(most, last_))
               ? Pixels::all
               : Pixels::some;
}

} // namespace sheetsplat::backend_cpu

// Ghost points around an EllipsoidField ([NM06] section 4.1).
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <functional>
#include <string>
#include <unordered_map>
#include <utility>
#include <vector>

#include <glm/common.hpp>
#include <glm/geometric.hpp>

#include "point_tree.hpp"
#include "sheetsplat/error.hpp"
#include "sheetsplat/field_points.hpp"

namespace sheetsplat {

namespace {

/// r^2 of a point that lies at `offset` from the centre of kernel i: |M^-1 offset|^2.
double squared_radius(const EllipsoidField& field, std::size_t i, Vec3 offset) {
    if (!field.arrays().rotations.empty()) {
        offset = glm::conjugate(field.arrays().rotations[i]) * offset;
    }
    offset /= field.semi_axes(i);
    return glm::dot(offset, offset);
}

/// Squared radius from which a place counts as outside a support. Places on the edge, where the kernel is 0, are
/// outside whatever the rounding.
constexpr double ghost_inside = 1.0 - 1e-9;

/// The shape of kernel i moved to a place, against boxes.
class Shape {
  public:
    Shape(const EllipsoidField& field, std::size_t i, Vec3 place) : place_(place) {
        const auto& rotations = field.arrays().rotations;
        to_unit_ = rotations.empty() ? Mat3(1.0) : glm::transpose(glm::mat3_cast(rotations[i]));
        for (int column = 0; column < 3; ++column) {
            to_unit_[column] /= field.semi_axes(i);
            sizes_[column] = glm::abs(to_unit_[column]);
        }
    }
    /// 1 where all of a box lies inside the shape, -1 where none of it does, 0 where neither is sure.
    [[nodiscard]] int place(const Box& box) const {
        // Far beyond what the places of points are rounded by in squared_radius.
        constexpr double margin = 1e-12;
        const double middle = glm::length(to_unit_ * (0.5 * (box.lower + box.upper) - place_));
        const double reach = glm::length(sizes_ * (0.5 * box.extent()));
        const double nearest = std::max(middle - reach, 0.0), farthest = middle + reach;
        if (nearest * nearest > ghost_inside + margin) {
            return -1;
        }
        return farthest * farthest < ghost_inside - margin ? 1 : 0;
    }

  private:
    Vec3 place_;
    Mat3 to_unit_, sizes_;
};

using Cell = std::array<double, 4>;

struct CellHash {
    std::size_t operator()(const Cell& cell) const {
        std::size_t mixed = 0;
        for (const double part : cell) {
            // Adding 0 makes -0 equal to 0, as the comparison has it.
            mixed = (mixed ^ std::hash<double>()(part + 0.0)) * 0x9E3779B97F4A7C15ULL;
            mixed ^= mixed >> 29;
        }
        return mixed;
    }
};

/// The six directions along the axes and the eight along the diagonals between them.
std::vector<Vec3> ghost_directions() {
    const double diagonal = 1.0 / std::sqrt(3.0);
    std::vector<Vec3> directions;
    for (const double sign : {1.0, -1.0}) {
        for (int axis = 0; axis < 3; ++axis) {
            Vec3 along(0.0);
            along[axis] = sign;
            directions.push_back(along);
        }
        for (int n = 0; n < 4; ++n) {
            directions.push_back(diagonal * Vec3(sign, n % 2 == 0 ? 1.0 : -1.0, n < 2 ? 1.0 : -1.0));
        }
    }
    return directions;
}

/// Places around each kernel with a weight from which the kernel's shape reaches no centre. OutOfMemory for more than
/// `most` of them.
GhostPoints ghost_candidates(const EllipsoidField& field, double distance, std::size_t most) {
    const std::vector<Vec3> directions = ghost_directions();
    std::vector<Vec3> centers;
    std::vector<std::size_t> kernels;
    for (std::size_t i = 0; i < field.size(); ++i) {
        if (field.weight(i) > 0.0) {
            centers.push_back(field.center(i));
            kernels.push_back(i);
        }
    }
    GhostPoints found;
    const PointTree tree(std::move(centers));
    // In the tree's order, for locality in the cache.
    for (const std::size_t n : tree.order()) {
        const std::size_t i = kernels[n];
        const Mat3 shape = field.shape(i);
        const Vec3 extent = field.extent(i);
        for (const Vec3& direction : directions) {
            const Vec3 place = field.center(i) + shape * (distance * direction);
            const Shape moved(field, i, place);
            const bool alone = tree.each_in(
                {place - extent, place + extent},
                [&](std::size_t, const Vec3& center) {
                    return squared_radius(field, i, center - place) >= ghost_inside;
                },
                [&](const Box& box) { return moved.place(box) < 0; });
            if (alone) {
                if (found.owners.size() == most) {
                    throw OutOfMemory(Complaint{"EllipsoidField: there is not enough memory for the ghost points",
                                                "more than " + std::to_string(most) + " candidates",
                                                "memory for all of them", "use fewer kernels at a time"});
                }
                found.owners.push_back(i);
                found.centers.push_back(place);
            }
        }
    }
    return found;
}

/// The indices of the candidates that no support reaches, in the order of their kernels, which does not depend on the
/// tree.
std::vector<std::size_t> outside_supports(const EllipsoidField& field, const GhostPoints& found) {
    PointTree tree(found.centers);
    for (std::size_t i = 0; i < field.size(); ++i) {
        if (field.weight(i) > 0.0) {
            const Vec3& center = field.center(i);
            const Shape shape(field, i, center);
            tree.remove([&](const Vec3& at) { return squared_radius(field, i, at - center) < ghost_inside; },
                        [&](const Box& box) { return shape.place(box); });
        }
    }
    std::vector<std::size_t> places = tree.remaining();
    std::sort(places.begin(), places.end(), [&](std::size_t a, std::size_t b) {
        return std::make_pair(found.owners[a], a) < std::make_pair(found.owners[b], b);
    });
    return places;
}

} // namespace

GhostPoints ghost_points(const EllipsoidField& field, double distance, std::size_t most) {
    constexpr double closest = 0.5;
    const GhostPoints found = ghost_candidates(field, distance, most);
    const std::vector<std::size_t> places = outside_supports(field, found);
    // Boxes that hold what was kept: the power of two that is their edge, and which one along x, y, z. The edge is from
    // half of the smallest semi-axis to the whole, so that what is too close is in a neighbour at most.
    std::unordered_map<Cell, std::vector<std::size_t>, CellHash> cells;
    const Vec3 origin = field.centres_world().lower;
    GhostPoints ghosts;
    for (const std::size_t n : places) {
        const Vec3 axes = field.semi_axes(found.owners[n]);
        const double smallest = std::min({axes.x, axes.y, axes.z});
        const int power = std::ilogb(smallest);
        const Vec3 place = found.centers[n];
        const Vec3 cell = glm::floor((place - origin) * std::exp2(-power));
        bool free = true;
        for (int neighbour = 0; neighbour < 27 && free; ++neighbour) {
            const auto near = cells.find({static_cast<double>(power), cell.x + neighbour % 3 - 1,
                                          cell.y + neighbour / 3 % 3 - 1, cell.z + neighbour / 9 - 1});
            free =
                near == cells.end() || std::none_of(near->second.begin(), near->second.end(), [&](std::size_t other) {
                    return glm::length(ghosts.centers[other] - place) < closest * smallest;
                });
        }
        if (free) {
            cells[{static_cast<double>(power), cell.x, cell.y, cell.z}].push_back(ghosts.centers.size());
            ghosts.owners.push_back(found.owners[n]);
            ghosts.centers.push_back(place);
        }
    }
    return ghosts;
}

} // namespace sheetsplat

// The sums of an EllipsoidField at single points, and ghost points around it.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <functional>
#include <numeric>
#include <string>
#include <unordered_map>
#include <utility>
#include <vector>

#include <glm/common.hpp>
#include <glm/geometric.hpp>

#include "sheetsplat/error.hpp"
#include "sheetsplat/field.hpp"

namespace sheetsplat::bindings {

/// Points, found by boxes in time that depends little on how they lie: a tree split at medians (Bentley 1975).
class PointTree {
  public:
    explicit PointTree(std::vector<Vec3> points) : points_(std::move(points)), order_(points_.size()) {
        std::iota(order_.begin(), order_.end(), std::size_t{0});
        if (!points_.empty()) {
            nodes_.reserve(2 * (points_.size() / leaf_ + 1));
            build(0, points_.size());
            std::vector<Vec3> sorted(points_.size());
            std::transform(order_.begin(), order_.end(), sorted.begin(), [&](std::size_t n) { return points_[n]; });
            points_ = std::move(sorted);
        }
    }

    /// Indices of the points, neighbours close together.
    [[nodiscard]] const std::vector<std::size_t>& order() const { return order_; }

    /// Calls visit(index, point) for the points in a box, and others near it, those in its middle first, until it
    /// returns false; returns whether it never did.
    template <class Visit>
    bool each_in(const Box& box, Visit&& visit) const {
        return nodes_.empty() || each_in(0, box, visit);
    }

  private:
    static constexpr std::size_t leaf_ = 8;

    struct Node {
        Box box;
        std::size_t first = 0, last = 0;
        std::size_t second_child = 0; ///< the first one follows its parent; 0: a leaf
        int axis = 0;                 ///< across which the children lie
    };

    std::size_t build(std::size_t first, std::size_t last) {
        const std::size_t self = nodes_.size();
        Box box{points_[order_[first]], points_[order_[first]]};
        for (std::size_t n = first + 1; n < last; ++n) {
            box = {glm::min(box.lower, points_[order_[n]]), glm::max(box.upper, points_[order_[n]])};
        }
        nodes_.push_back({box, first, last, 0, 0});
        if (last - first > leaf_) {
            const Vec3 extent = box.extent();
            const int axis = extent.x >= extent.y && extent.x >= extent.z ? 0 : extent.y >= extent.z ? 1 : 2;
            const std::size_t middle = first + (last - first) / 2;
            const auto at = [&](std::size_t n) { return order_.begin() + static_cast<std::ptrdiff_t>(n); };
            std::nth_element(at(first), at(middle), at(last),
                             [&](std::size_t a, std::size_t b) { return points_[a][axis] < points_[b][axis]; });
            nodes_[self].axis = axis;
            build(first, middle);
            nodes_[self].second_child = build(middle, last);
        }
        return self;
    }

    template <class Visit>
    bool each_in(std::size_t index, const Box& box, Visit& visit) const {
        const Node& node = nodes_[index];
        for (int axis = 0; axis < 3; ++axis) {
            if (node.box.lower[axis] > box.upper[axis] || node.box.upper[axis] < box.lower[axis]) {
                return true;
            }
        }
        if (node.second_child != 0) {
            const int axis = node.axis;
            const bool turn = box.lower[axis] + box.upper[axis] > 2.0 * nodes_[node.second_child].box.lower[axis];
            return each_in(turn ? node.second_child : index + 1, box, visit) &&
                   each_in(turn ? index + 1 : node.second_child, box, visit);
        }
        for (std::size_t n = node.first; n < node.last; ++n) {
            if (!visit(order_[n], points_[n])) {
                return false;
            }
        }
        return true;
    }

    std::vector<Vec3> points_;
    std::vector<std::size_t> order_;
    std::vector<Node> nodes_;
};

/// r^2 of a point that lies at `offset` from the centre of kernel i: |M^-1 offset|^2.
inline double squared_radius(const EllipsoidField& field, std::size_t i, Vec3 offset) {
    if (!field.arrays().rotations.empty()) {
        offset = glm::conjugate(field.arrays().rotations[i]) * offset;
    }
    offset /= field.semi_axes(i);
    return glm::dot(offset, offset);
}

/// D and W (IMAGE FORMATION section 2) at each point.
inline std::vector<std::array<double, 2>> sums_at(const EllipsoidField& field, std::vector<Vec3> points) {
    std::vector<std::array<double, 2>> sums(points.size(), {0.0, 0.0});
    const PointTree tree(std::move(points));
    const Kernel kernel = field.kernel();
    const double edge = kernel.edge(), gain = kernel.gain();
    for (std::size_t i = 0; i < field.size(); ++i) {
        const Vec3& center = field.center(i);
        const Vec3 extent = field.extent(i);
        tree.each_in({center - extent, center + extent}, [&](std::size_t n, const Vec3& point) {
            const double r2 = squared_radius(field, i, point - center);
            if (r2 < 1.0) {
                const double weight = field.weight(i) * (std::exp(-kernel.falloff * r2) - edge) * gain;
                sums[n][0] += weight * field.value(i);
                sums[n][1] += weight;
            }
            return true;
        });
    }
    return sums;
}

/// Places for kernels of value 0 around a field ([NM06] section 4.1), and the kernel whose shape each takes.
struct GhostPoints {
    std::vector<std::size_t> owners;
    std::vector<Vec3> centers;
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

/// Around each kernel with a weight, `distance` >= 1 of its own semi-axes from its centre, along its axes and the
/// diagonals between them: those places that no support reaches and from which the kernel's shape reaches no centre.
/// Of those closer together than half the smallest semi-axis, and of kernels of about one size, the first is kept.
/// OutOfMemory where more than `most`
/// places would have to be looked at.
inline GhostPoints ghost_points(const EllipsoidField& field, double distance, std::size_t most) {
    // Places on the edge itself, where the kernel is 0, are outside whatever the rounding says.
    constexpr double inside = 1.0 - 1e-9;
    constexpr double closest = 0.5;
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
    GhostPoints found;
    {
        std::vector<Vec3> centers;
        std::vector<std::size_t> kernels;
        for (std::size_t i = 0; i < field.size(); ++i) {
            if (field.weight(i) > 0.0) {
                centers.push_back(field.center(i));
                kernels.push_back(i);
            }
        }
        const PointTree tree(std::move(centers));
        // In the tree's order, so that one kernel finds in the cache what the one before it looked at.
        for (const std::size_t n : tree.order()) {
            const std::size_t i = kernels[n];
            const Mat3 shape = field.shape(i);
            const Vec3 extent = field.extent(i);
            for (const Vec3& direction : directions) {
                const Vec3 place = field.center(i) + shape * (distance * direction);
                const bool alone = tree.each_in({place - extent, place + extent}, [&](std::size_t, const Vec3& center) {
                    return squared_radius(field, i, center - place) >= inside;
                });
                if (alone) {
                    if (found.owners.size() == most) {
                        throw OutOfMemory(Complaint{"EllipsoidField: there is no memory for the ghost points",
                                                    "more than " + std::to_string(most) + " places to look at",
                                                    "memory for all of them", "use fewer kernels at a time"});
                    }
                    found.owners.push_back(i);
                    found.centers.push_back(place);
                }
            }
        }
    }
    std::vector<char> kept(found.owners.size(), 1);
    {
        const PointTree tree(found.centers);
        for (std::size_t i = 0; i < field.size(); ++i) {
            if (!(field.weight(i) > 0.0)) {
                continue;
            }
            const Vec3& center = field.center(i);
            const Vec3 extent = field.extent(i);
            tree.each_in({center - extent, center + extent}, [&](std::size_t n, const Vec3& place) {
                if (kept[n] != 0 && squared_radius(field, i, place - center) < inside) {
                    kept[n] = 0;
                }
                return true;
            });
        }
    }
    // In the kernels' order, so that the outcome does not depend on the tree.
    std::vector<std::size_t> places;
    for (std::size_t n = 0; n < kept.size(); ++n) {
        if (kept[n] != 0) {
            places.push_back(n);
        }
    }
    std::sort(places.begin(), places.end(), [&](std::size_t a, std::size_t b) {
        return std::make_pair(found.owners[a], a) < std::make_pair(found.owners[b], b);
    });
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

} // namespace sheetsplat::bindings

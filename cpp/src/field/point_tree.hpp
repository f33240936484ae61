// A tree of points.
#pragma once

#include <algorithm>
#include <cstddef>
#include <numeric>
#include <utility>
#include <vector>

#include <glm/common.hpp>

#include "sheetsplat/field.hpp"

namespace sheetsplat {

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

    /// Parts of the tree that hold each point once, at least `count` of them if there are so many leaves.
    [[nodiscard]] std::vector<std::size_t> parts(std::size_t count) const {
        std::vector<std::size_t> found;
        if (!nodes_.empty()) {
            found.push_back(0);
        }
        for (bool split = true; split && found.size() < count;) {
            split = false;
            std::vector<std::size_t> children;
            for (const std::size_t part : found) {
                const bool inner = nodes_[part].second_child != 0;
                split = split || inner;
                children.push_back(inner ? part + 1 : part);
                if (inner) {
                    children.push_back(nodes_[part].second_child);
                }
            }
            found = std::move(children);
        }
        return found;
    }

    /// Calls visit(index, point) for the points in a box, and others near it, those in its middle first, until it
    /// returns false; returns whether it never did.
    template <class Visit>
    bool each_in(const Box& box, Visit&& visit) const {
        return nodes_.empty() || each_in_part(0, box, visit);
    }
    /// The same for the points of a part.
    template <class Visit>
    bool each_in_part(std::size_t part, const Box& box, Visit&& visit) const {
        return each_below(part, box, visit);
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
    bool each_below(std::size_t index, const Box& box, Visit& visit) const {
        const Node& node = nodes_[index];
        for (int axis = 0; axis < 3; ++axis) {
            if (node.box.lower[axis] > box.upper[axis] || node.box.upper[axis] < box.lower[axis]) {
                return true;
            }
        }
        if (node.second_child != 0) {
            const int axis = node.axis;
            const bool turn = box.lower[axis] + box.upper[axis] > 2.0 * nodes_[node.second_child].box.lower[axis];
            return each_below(turn ? node.second_child : index + 1, box, visit) &&
                   each_below(turn ? index + 1 : node.second_child, box, visit);
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

} // namespace sheetsplat

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
    /// returns false; returns whether it never did. Points in a box for which passes(box) is true are left out.
    template <class Visit, class Passes>
    bool each_in(const Box& box, Visit&& visit, Passes&& passes) const {
        return nodes_.empty() || each_below(0, box, visit, passes);
    }
    /// Calls visit for all points of a part in a box, and others near it, in the same way.
    template <class Visit>
    bool each_in_part(std::size_t part, const Box& box, Visit&& visit) const {
        return each_below(part, box, visit, [](const Box&) { return false; });
    }

    /// Removes the points for which inside(point) is true. place(box): 1 where that holds for all points of a box, -1
    /// where it holds for none, 0 where it is not known. What was removed costs no time.
    template <class Inside, class Place>
    void remove(Inside&& inside, Place&& place) {
        removed_.resize(points_.size(), 0);
        if (!nodes_.empty()) {
            remove_below(0, inside, place);
        }
    }

    /// Indices of the points that were not removed.
    [[nodiscard]] std::vector<std::size_t> remaining() {
        removed_.resize(points_.size(), 0);
        std::vector<std::size_t> found;
        if (!nodes_.empty()) {
            add_remaining(0, found);
        }
        return found;
    }

  private:
    static constexpr std::size_t leaf_ = 8;

    struct Node {
        Box box;
        std::size_t first = 0, last = 0;
        std::size_t left = 0;         ///< how many of its points were not removed
        std::size_t second_child = 0; ///< the first one follows its parent; 0: a leaf
        int axis = 0;                 ///< across which the children lie
    };

    std::size_t build(std::size_t first, std::size_t last) {
        const std::size_t self = nodes_.size();
        Box box{points_[order_[first]], points_[order_[first]]};
        for (std::size_t n = first + 1; n < last; ++n) {
            box = {glm::min(box.lower, points_[order_[n]]), glm::max(box.upper, points_[order_[n]])};
        }
        nodes_.push_back({box, first, last, last - first, 0, 0});
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

    template <class Inside, class Place>
    void remove_below(std::size_t index, const Inside& inside, const Place& place) {
        Node& node = nodes_[index];
        if (node.left == 0) {
            return;
        }
        if (const int known = place(node.box); known != 0) {
            node.left = known > 0 ? 0 : node.left;
            return;
        }
        if (node.second_child != 0) {
            remove_below(index + 1, inside, place);
            remove_below(node.second_child, inside, place);
            node.left = nodes_[index + 1].left + nodes_[node.second_child].left;
            return;
        }
        for (std::size_t n = node.first; n < node.last; ++n) {
            if (removed_[n] == 0 && inside(points_[n])) {
                removed_[n] = 1;
                --node.left;
            }
        }
    }

    void add_remaining(std::size_t index, std::vector<std::size_t>& found) const {
        const Node& node = nodes_[index];
        if (node.left == 0) {
            return;
        }
        if (node.second_child != 0) {
            add_remaining(index + 1, found);
            add_remaining(node.second_child, found);
            return;
        }
        for (std::size_t n = node.first; n < node.last; ++n) {
            if (removed_[n] == 0) {
                found.push_back(order_[n]);
            }
        }
    }

    template <class Visit, class Passes>
    bool each_below(std::size_t index, const Box& box, Visit& visit, const Passes& passes) const {
        const Node& node = nodes_[index];
        for (int axis = 0; axis < 3; ++axis) {
            if (node.box.lower[axis] > box.upper[axis] || node.box.upper[axis] < box.lower[axis]) {
                return true;
            }
        }
        if (passes(node.box)) {
            return true;
        }
        if (node.second_child != 0) {
            const int axis = node.axis;
            const bool turn = box.lower[axis] + box.upper[axis] > 2.0 * nodes_[node.second_child].box.lower[axis];
            return each_below(turn ? node.second_child : index + 1, box, visit, passes) &&
                   each_below(turn ? index + 1 : node.second_child, box, visit, passes);
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
    std::vector<char> removed_; ///< of each point in order; empty before one is
};

} // namespace sheetsplat

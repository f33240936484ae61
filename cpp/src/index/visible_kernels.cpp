// Which scattered kernels are drawn.
//
// Any selection of the kernels that reach a place gives it a rho between two bounds. With normalisation threshold, and
// weights >= 0, these are the least and the greatest of 0 and the kernels' values, so that the place can be visible
// only where a single one of those values v makes something visible between 0 and v. Without it, they are the sums of
// the negative and of the positive amplitudes, since no kernel is more than 1 anywhere. So each kernel has a share in
// what is below and above 0 (with threshold: 1 or 0, and one is enough), and a kernel is dropped where the shares of
// all that come near its support make nothing visible. What is near is found in a tree of boxes over the grid's order.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <limits>
#include <string>
#include <vector>

#include <glm/common.hpp>

#include "base/checks.hpp"
#include "base/memory.hpp"
#include "base/poll.hpp"
#include "index/spatial_grid.hpp"
#include "sheetsplat/error.hpp"

namespace sheetsplat {

namespace {

constexpr double infinity = std::numeric_limits<double>::infinity();
/// Rounding of sums and quotients must not carry rho past a bound.
constexpr double rounding = 1e-12;
/// Children of a node.
constexpr std::size_t fan = 8;
/// Leaves that are kept in memory; beyond, a leaf is several kernels.
constexpr std::size_t most_leaves = std::size_t{1} << 20;
/// Mark of a kernel that is drawn where something near it is visible.
constexpr std::uint8_t undecided = 2;
/// Boxes that are looked at for one kernel; beyond, what is left counts as near.
constexpr std::size_t most_looks = 1024;

std::uint64_t bits_of(double x) {
    std::uint64_t bits = 0;
    std::memcpy(&bits, &x, sizeof bits);
    return bits;
}

double double_of(std::uint64_t bits) {
    double x = 0.0;
    std::memcpy(&x, &bits, sizeof x);
    return x;
}

/// The least x > 0 for which visible(x), which stays true from there on; infinite where there is none.
template <typename Visible>
double least_visible(const Visible& visible) {
    // Positive doubles are ordered as their bits are.
    std::uint64_t hidden = 0;
    std::uint64_t seen = bits_of(std::numeric_limits<double>::max());
    if (!visible(double_of(seen))) {
        return infinity;
    }
    while (seen - hidden > 1) {
        const std::uint64_t middle = hidden + (seen - hidden) / 2;
        (visible(double_of(middle)) ? seen : hidden) = middle;
    }
    return double_of(seen);
}

/// What kernels have in what is above and below 0, both positive.
struct Shares {
    double above = 0.0, below = 0.0;

    [[nodiscard]] bool any() const { return above > 0.0 || below > 0.0; }
    [[nodiscard]] bool reach(const VisibleFrom& limits) const {
        return above * (1.0 + rounding) >= limits.above || below * (1.0 + rounding) >= limits.below;
    }
    Shares& operator+=(const Shares& other) {
        above += other.above;
        below += other.below;
        return *this;
    }
};

struct Node {
    Box box{Vec3(infinity), Vec3(-infinity)}; ///< around the supports of kernels that have a share
    Shares shares;

    void add(const Box& more, const Shares& theirs) {
        box = Box{glm::min(box.lower, more.lower), glm::max(box.upper, more.upper)};
        shares += theirs;
    }
};

bool meet(const Box& a, const Box& b) {
    return a.lower.x <= b.upper.x && b.lower.x <= a.upper.x && a.lower.y <= b.upper.y && b.lower.y <= a.upper.y &&
           a.lower.z <= b.upper.z && b.lower.z <= a.upper.z;
}

bool holds(const Box& outer, const Box& inner) {
    return glm::min(outer.lower, inner.lower) == outer.lower && glm::max(outer.upper, inner.upper) == outer.upper;
}

/// A tree of boxes without pointers: level 0 is the leaves, `leaf` kernels each in the grid's order; each node has the
/// next `fan` nodes below it.
class BoxTree {
  public:
    template <typename NodeOf>
    BoxTree(std::size_t kernels, std::size_t leaf, const NodeOf& node_of) {
        std::size_t count = (kernels + leaf - 1) / leaf;
        std::size_t total = count;
        starts_.push_back(0);
        while (count > 1) {
            starts_.push_back(total);
            count = (count + fan - 1) / fan;
            total += count;
        }
        starts_.push_back(total);
        nodes_.resize(total);
        for (std::size_t at = 0; at < kernels; ++at) {
            poll_at(at);
            const Node node = node_of(at);
            if (node.shares.any()) {
                nodes_[at / leaf].add(node.box, node.shares);
            }
        }
        for (std::size_t level = 0; level + 2 < starts_.size(); ++level) {
            for (std::size_t at = starts_[level]; at < starts_[level + 1]; ++at) {
                nodes_[starts_[level + 1] + (at - starts_[level]) / fan].add(nodes_[at].box, nodes_[at].shares);
            }
        }
    }

    /// True where the shares of the kernels whose boxes meet `region` may reach the limits.
    [[nodiscard]] bool reaches(const Box& region, const VisibleFrom& limits) const {
        struct Place {
            std::size_t level, node;
        };
        // Each step takes one node off and puts its children on.
        Place open[fan * (max_levels + 1)];
        std::size_t opened = 0;
        Shares near;
        const auto look_at = [&](std::size_t level, std::size_t node) {
            const Node& here = nodes_[node];
            if (!here.shares.any() || !meet(here.box, region)) {
                return;
            }
            if (level == 0 || holds(region, here.box)) {
                near += here.shares;
            } else {
                open[opened++] = {level, node};
            }
        };
        std::size_t looks = 1;
        look_at(starts_.size() - 2, nodes_.size() - 1);
        while (opened > 0 && !near.reach(limits)) {
            const Place place = open[--opened];
            if (looks > most_looks) {
                near += nodes_[place.node].shares;
                continue;
            }
            const std::size_t first = starts_[place.level - 1] + (place.node - starts_[place.level]) * fan;
            const std::size_t last = std::min(first + fan, starts_[place.level]);
            looks += last - first;
            for (std::size_t child = first; child < last; ++child) {
                look_at(place.level - 1, child);
            }
        }
        return near.reach(limits);
    }

  private:
    static constexpr std::size_t max_levels = 22; ///< fan to this power is 2^66

    std::vector<std::size_t> starts_; ///< of each level; one more at the end
    std::vector<Node> nodes_;
};

/// reach_world farther to every side, and not less for rounding.
Box widened(const Box& box, double reach_world) {
    if (reach_world == 0.0) {
        return box;
    }
    constexpr double roundings = 4.0 * std::numeric_limits<double>::epsilon();
    const Vec3 more = reach_world * (1.0 + roundings) + roundings * glm::max(glm::abs(box.lower), glm::abs(box.upper));
    return {box.lower - more, box.upper + more};
}

} // namespace

VisibleFrom visible_from(const VisibilityQuery& visibility) {
    if (visibility.isosurface) {
        VisibleFrom from{infinity, infinity};
        for (const double iso : visibility.iso_values) {
            // A crossing has one end below the iso value and one not; 0, beyond the field, is an end too.
            double& side = iso > 0.0 ? from.above : from.below;
            side = std::min(side, std::max(std::abs(iso), std::numeric_limits<double>::denorm_min()));
        }
        return from;
    }
    const TransferFunction& transfer_function = *visibility.transfer_function;
    // Of a step at 0 only the side counts on which the values are.
    constexpr double least = std::numeric_limits<double>::denorm_min();
    const VisibleFrom from{least_visible([&](double x) { return !transfer_function.transparent_over(least, x); }),
                           least_visible([&](double x) { return !transfer_function.transparent_over(-x, -least); })};
    if (visibility.cubic) {
        constexpr double overshoot = 20.0 / 16.0;
        // Outer slices count against the sign of their values.
        const double either = std::min(from.above, from.below) / overshoot;
        return {either, either};
    }
    return from;
}

void check_reach(const VisibilityQuery& query) {
    if (!(query.reach_world >= 0.0)) {
        throw InvalidInput(Complaint{"the drawn kernels cannot be found", "reach_world = " + text_of(query.reach_world),
                                     "a length of 0 or more world units", "check the camera and the slice spacing"});
    }
}

std::vector<std::uint8_t> visible_kernels(const EllipsoidField& field, const SpatialGrid& grid,
                                          const VisibilityQuery& visibility) {
    check_reach(visibility);
    const std::size_t n = field.size();
    const std::string what = "the list of drawn kernels";
    const std::string next = "use fewer kernels at a time";
    require_memory(n, what, next);
    std::vector<std::uint8_t> visible(n, 1);
    if (!visibility.cull) {
        return visible;
    }
    const bool classified = visibility.isosurface || visibility.transfer_function != nullptr;
    const bool at_zero =
        classified && !visibility.isosurface && !visibility.transfer_function->transparent_over(0.0, 0.0);
    const bool threshold = field.normalization() == Normalization::threshold;
    const bool weights_matter = visibility.weights_matter || threshold;
    // A place that only such kernels reach is not empty: where that decides, they are drawn as others are, beside what
    // is visible.
    const bool reach_matters = at_zero || visibility.reach_matters;
    const auto adds_nothing = [&](std::size_t kernel) {
        return !reach_matters && (field.weight(kernel) == 0.0 || (field.value(kernel) == 0.0 && !weights_matter));
    };
    if (!classified || !visibility.alone || at_zero) {
        for (std::size_t kernel = 0; kernel < n; ++kernel) {
            visible[kernel] = adds_nothing(kernel) ? 0 : 1;
        }
        return visible;
    }

    const VisibleFrom alone_visible = visible_from(visibility);
    VisibleFrom limits{1.0, 1.0};
    if (!threshold) {
        const double unit = field.normalization() == Normalization::lattice ? field.lattice_constant() : 1.0;
        limits = {alone_visible.above * unit, alone_visible.below * unit};
    }
    const auto shares_of = [&](std::size_t kernel) {
        const double weight = field.weight(kernel);
        const double value = field.value(kernel);
        if (threshold) {
            const Shares alone{std::max(value, 0.0), std::max(-value, 0.0)};
            const bool seen = weight > 0.0 && alone.reach(alone_visible);
            return Shares{seen ? 1.0 : 0.0, 0.0};
        }
        return Shares{std::max(weight * value, 0.0), std::max(-weight * value, 0.0)};
    };
    // What a kernel decides by itself comes first: where all do, their surroundings need no look.
    const auto is_open = [&](std::size_t kernel) { return visible[kernel] == undecided; };
    bool any_open = false;
    for (std::size_t kernel = 0; kernel < n; ++kernel) {
        poll_at(kernel);
        visible[kernel] = adds_nothing(kernel) ? 0 : shares_of(kernel).reach(limits) ? 1 : undecided;
        any_open = any_open || is_open(kernel);
    }
    if (!any_open) {
        return visible;
    }
    const auto box_of = [&](std::size_t kernel) {
        const Vec3 extent = field.extent(kernel);
        return Box{field.center(kernel) - extent, field.center(kernel) + extent};
    };

    std::size_t leaf = 1;
    while (n / leaf > most_leaves) {
        leaf *= 2;
    }
    require_memory(2 * (n / leaf + fan) * sizeof(Node), what, next);
    const std::vector<std::uint32_t>& order = grid.order();
    const BoxTree tree(n, leaf, [&](std::size_t at) {
        const Shares shares = shares_of(order[at]);
        return shares.any() ? Node{box_of(order[at]), shares} : Node{};
    });

    // Neighbours in the order are tested together first: far from everything visible they are dropped together.
    constexpr std::size_t together = 16;
    for (std::size_t begin = 0; begin < n; begin += together) {
        poll_at(begin);
        std::array<std::size_t, together> open{};
        std::array<Box, together> boxes;
        std::size_t count = 0;
        Node all;
        for (std::size_t at = begin; at < std::min(n, begin + together); ++at) {
            if (is_open(order[at])) {
                open[count] = order[at];
                boxes[count] = box_of(order[at]);
                all.add(boxes[count++], {});
            }
        }
        const bool any = count > 0 && tree.reaches(widened(all.box, visibility.reach_world), limits);
        for (std::size_t at = 0; at < count; ++at) {
            const bool kept = any && tree.reaches(widened(boxes[at], visibility.reach_world), limits);
            visible[open[at]] = kept ? 1 : 0;
        }
    }
    return visible;
}

} // namespace sheetsplat

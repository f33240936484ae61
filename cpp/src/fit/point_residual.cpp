// Residuals of samples at points: what each kernel is there is kept, sorted by kernels.
#include <algorithm>
#include <cmath>
#include <string>
#include <utility>

#include "base/memory.hpp"
#include "base/poll.hpp"
#include "residual.hpp"

namespace sheetsplat::fit {

namespace {

struct Entry {
    std::uint32_t point;
    float kernel;
};

class PointResidual final : public Residual {
  public:
    PointResidual(SamplePoints given, const std::vector<Nodes>& levels, double falloff, double radius)
        : levels_(levels), residual_(std::move(given.samples)) {
        for (const Nodes& nodes : levels_) {
            columns_.push_back(columns_of(given.places, nodes, falloff, radius));
        }
    }

    [[nodiscard]] Correlation correlation(std::size_t level, const std::array<int, 3>& node) const override {
        Correlation sum;
        for_each(level, node, [&](const Entry& entry) {
            const auto g = static_cast<double>(entry.kernel);
            sum.product += g * residual_[entry.point];
            sum.squared_norm += g * g;
        });
        return sum;
    }

    void subtract(std::size_t level, const std::array<int, 3>& node, double change) override {
        for_each(level, node,
                 [&](const Entry& entry) { residual_[entry.point] -= change * static_cast<double>(entry.kernel); });
    }

    [[nodiscard]] std::array<double, 2> misfit() const override {
        double squares = 0.0, largest = 0.0;
        for (const double one : residual_) {
            squares += one * one;
            largest = std::max(largest, std::fabs(one));
        }
        return {squares, largest};
    }

    [[nodiscard]] std::vector<double> numbers() const override { return residual_; }

  private:
    struct Columns {
        std::vector<std::size_t> begins;
        std::vector<Entry> entries;
    };

    /// use(number of the node, kernel there) for the nodes of a level whose kernels reach a point.
    template <class Use>
    static void nodes_at(const Vec3& place, const Nodes& nodes, double falloff, double radius, const Use& use) {
        const std::array<double, 3> at{place.x / nodes.spacing, place.y / nodes.spacing, place.z / nodes.spacing};
        std::array<int, 3> from{}, to{};
        for (std::size_t axis = 0; axis < 3; ++axis) {
            from[axis] = std::max(0, static_cast<int>(std::ceil(at[axis] - radius)) - nodes.first[axis]);
            to[axis] =
                std::min(nodes.counts[axis] - 1, static_cast<int>(std::floor(at[axis] + radius)) - nodes.first[axis]);
        }
        const double lowered = std::exp(-falloff), scale = -1.0 / std::expm1(-falloff);
        for (int z = from[2]; z <= to[2]; ++z) {
            for (int y = from[1]; y <= to[1]; ++y) {
                for (int x = from[0]; x <= to[0]; ++x) {
                    const double dx = (nodes.first[0] + x - at[0]) / radius, dy = (nodes.first[1] + y - at[1]) / radius,
                                 dz = (nodes.first[2] + z - at[2]) / radius;
                    const double squared = dx * dx + dy * dy + dz * dz;
                    if (squared < 1.0) {
                        const auto row = static_cast<std::size_t>(z) * static_cast<std::size_t>(nodes.counts[1]) +
                                         static_cast<std::size_t>(y);
                        use(row * static_cast<std::size_t>(nodes.counts[0]) + static_cast<std::size_t>(x),
                            static_cast<float>((std::exp(-falloff * squared) - lowered) * scale));
                    }
                }
            }
        }
    }

    static Columns columns_of(const std::vector<Vec3>& places, const Nodes& nodes, double falloff, double radius) {
        const std::string what = "the kernels at the samples";
        Columns made;
        made.begins.assign(nodes.size() + 1, 0);
        for (std::size_t i = 0; i < places.size(); ++i) {
            poll_at(i);
            nodes_at(places[i], nodes, falloff, radius, [&](std::size_t node, float) { ++made.begins[node + 1]; });
        }
        for (std::size_t node = 0; node < nodes.size(); ++node) {
            made.begins[node + 1] += made.begins[node];
        }
        require_memory(checked_product(made.begins.back(), sizeof(Entry), what), what,
                       "encode a part of the data, or fewer samples");
        made.entries.resize(made.begins.back());
        std::vector<std::size_t> next(made.begins.begin(), made.begins.end() - 1);
        for (std::size_t i = 0; i < places.size(); ++i) {
            poll_at(i);
            nodes_at(places[i], nodes, falloff, radius, [&](std::size_t node, float kernel) {
                made.entries[next[node]++] = {static_cast<std::uint32_t>(i), kernel};
            });
        }
        return made;
    }

    template <class Use>
    void for_each(std::size_t level, const std::array<int, 3>& node, const Use& use) const {
        const Nodes& nodes = levels_[level];
        const auto row = static_cast<std::size_t>(node[2]) * static_cast<std::size_t>(nodes.counts[1]) +
                         static_cast<std::size_t>(node[1]);
        const std::size_t number = row * static_cast<std::size_t>(nodes.counts[0]) + static_cast<std::size_t>(node[0]);
        const Columns& columns = columns_[level];
        for (std::size_t i = columns.begins[number]; i < columns.begins[number + 1]; ++i) {
            use(columns.entries[i]);
        }
    }

    std::vector<Nodes> levels_;
    std::vector<double> residual_;
    std::vector<Columns> columns_;
};

} // namespace

std::unique_ptr<Residual> residual_of(SamplePoints points, const std::vector<Nodes>& levels, double falloff,
                                      double radius) {
    return std::make_unique<PointResidual>(std::move(points), levels, falloff, radius);
}

} // namespace sheetsplat::fit

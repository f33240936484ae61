#include "point_values.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <utility>

#include "reference/points.hpp"
#include "reference/screen.hpp"
#include "reference/sums.hpp"

namespace sheetsplat {

namespace {

/// Samples along one axis that may reach a point.
constexpr std::size_t most_along = 32;

class LatticeValues final : public PointValues {
  public:
    explicit LatticeValues(std::shared_ptr<const Field> field)
        : field_(std::move(field)), samples_(*as_regular(field_.get())), normaliser_(*field_, 1.0),
          semi_axes_(samples_.semi_axes_world()), origin_(samples_.options().origin), step_(step_of(samples_)),
          bcc_(samples_.lattice() == Lattice::bcc) {}

    /// Whether its kernels are small enough.
    static bool serves(const RegularField& field) {
        const Vec3 along = 2.0 * field.semi_axes_world() / step_of(field) + 4.0;
        return std::max({along.x, along.y, along.z}) <= static_cast<double>(most_along);
    }

    [[nodiscard]] Value at(const Vec3& world) const override {
        const Vec3 from = world - origin_;
        const auto [nk, nj, ni] = samples_.shape();
        const Along layers = along(from.z, 2, nk);
        // Of even layers, and of the shifted odd ones of BCC.
        std::array<Along, 2> columns, rows;
        columns[0] = along(from.x, 0, ni);
        rows[0] = along(from.y, 1, nj);
        if (bcc_) {
            columns[1] = along(from.x - 0.5 * step_.x, 0, ni);
            rows[1] = along(from.y - 0.5 * step_.y, 1, nj);
        }
        const Kernel& kernel = samples_.kernel();
        const double edge = kernel.edge();
        double d = 0.0, w = 0.0;
        bool empty = true;
        for (std::size_t z = 0; z < layers.count; ++z) {
            const std::size_t k = layers.first + z, shifted = bcc_ ? k % 2 : 0;
            for (std::size_t y = 0; y < rows[shifted].count; ++y) {
                const double squared = layers.squared[z] + rows[shifted].squared[y];
                const double gaussian = layers.gaussian[z] * rows[shifted].gaussian[y];
                const Along& row = columns[shifted];
                for (std::size_t x = 0; squared < 1.0 && x < row.count; ++x) {
                    if (squared + row.squared[x] < 1.0) {
                        const double value = samples_.value(row.first + x, rows[shifted].first + y, k);
                        if (!std::isnan(value)) {
                            const double g = gaussian * row.gaussian[x] - edge;
                            d += value * g;
                            w += g;
                            empty = false;
                        }
                    }
                }
            }
        }
        return {normaliser_.rho(d * kernel.gain(), w * kernel.gain()), empty};
    }

  private:
    /// Samples along an axis: their squared distances in semi-axes, and what these make of the Gaussian.
    struct Along {
        std::size_t first = 0, count = 0;
        std::array<double, most_along> squared, gaussian;
    };

    /// Between samples of a row, rows of a layer, and layers.
    static Vec3 step_of(const RegularField& field) {
        const Vec3& spacing = field.options().spacing;
        return field.lattice() == Lattice::bcc ? Vec3(spacing.x, spacing.x, 0.5 * spacing.x) : spacing;
    }

    [[nodiscard]] Along along(double from, int axis, std::size_t samples) const {
        const double middle = from / step_[axis], reach = semi_axes_[axis] / step_[axis];
        const double most = static_cast<double>(samples);
        Along found;
        found.first = static_cast<std::size_t>(std::clamp(std::ceil(middle - reach), 0.0, most));
        const auto past = static_cast<std::size_t>(std::clamp(std::floor(middle + reach) + 1.0, 0.0, most));
        found.count = std::min(past > found.first ? past - found.first : 0, most_along);
        for (std::size_t n = 0; n < found.count; ++n) {
            const double offset = (from - static_cast<double>(found.first + n) * step_[axis]) / semi_axes_[axis];
            found.squared[n] = offset * offset;
            found.gaussian[n] = std::exp(-samples_.kernel().falloff * found.squared[n]);
        }
        return found;
    }

    std::shared_ptr<const Field> field_;
    const RegularField& samples_;
    reference::Normaliser normaliser_;
    Vec3 semi_axes_, origin_, step_;
    bool bcc_;
};

/// The reference's grid of kernels, as a camera sees them.
class ScatteredValues final : public PointValues {
  public:
    ScatteredValues(std::shared_ptr<const Field> field, const Scene& scene, const Camera& camera, Size size)
        : field_(std::move(field)), camera_(camera), screen_(camera, size),
          sums_(*field_, scene, camera_, screen_, 1.0) {}

    [[nodiscard]] Value at(const Vec3& world) const override {
        const reference::PointSums::Value value = sums_.at(camera_.to_eye(world));
        return {value.rho, value.empty};
    }

  private:
    std::shared_ptr<const Field> field_;
    Camera camera_;
    reference::Screen screen_;
    reference::PointSums sums_;
};

} // namespace

std::shared_ptr<const PointValues> point_values(const std::shared_ptr<const Field>& field, const Scene& scene) {
    const RegularField* lattice = as_regular(field.get());
    if (lattice != nullptr && LatticeValues::serves(*lattice)) {
        return std::make_shared<const LatticeValues>(field);
    }
    Scene unfiltered = scene;
    unfiltered.filter = Filter::none;
    // Any view will do: eye space is the world, moved to the middle of what is there.
    const Vec3 middle = field->supports_world().centre();
    const Camera camera = Camera::orthographic(middle, middle - Vec3(0.0, 0.0, 1.0), Vec3(0.0, 1.0, 0.0), 1.0);
    return std::make_shared<const ScatteredValues>(field, unfiltered, camera, Size{1, 1});
}

std::shared_ptr<const PointValues> filtered_values(const std::shared_ptr<const Field>& field, const Scene& scene,
                                                   const Camera& camera, Size size) {
    return std::make_shared<const ScatteredValues>(field, scene, camera, size);
}

} // namespace sheetsplat

#include "point_values.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <utility>
#include <variant>

#include <glm/common.hpp>

#include "field/lattice_frame.hpp"
#include "reference/kernels.hpp"
#include "reference/points.hpp"
#include "reference/screen.hpp"
#include "reference/sums.hpp"

namespace sheetsplat {

namespace {

/// Samples along one axis that may reach a point.
constexpr std::size_t most_along = 32;
/// Gaussians of neighbours follow from each other below this: else the first one may be nothing to float64.
constexpr double steep_falloff = 200.0;

/// What ranges of samples are wider than they are, in steps: their kernels decide.
constexpr double beside = 1e-9;

class LatticeValues final : public PointValues {
  public:
    explicit LatticeValues(std::shared_ptr<const Field> field)
        : PointValues(field->least_weight()), field_(std::move(field)), samples_(*as_regular(field_.get())),
          normaliser_(*field_, 1.0), frame_(samples_), bcc_(samples_.lattice() == Lattice::bcc) {
        for (int axis = 0; axis < 3; ++axis) {
            const double apart = step_[axis] / semi_axes_[axis];
            ratios_[axis] = std::exp(-2.0 * samples_.kernel().falloff * apart * apart);
        }
    }

    /// Whether its kernels are small enough.
    static bool serves(const RegularField& field) {
        const LatticeFrame frame(field);
        const Vec3 along = 2.0 * frame.semi_axes / frame.step + 4.0;
        return std::max({along.x, along.y, along.z}) <= static_cast<double>(most_along);
    }

  private:
    [[nodiscard]] reference::Sums sums_at(const Vec3& world) const override {
        const Vec3 from = frame_.place(world);
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
        return std::visit([&](const auto& values) { return sum(values, layers, columns, rows); }, samples_.samples());
    }
    /// Of the kernels that the box around each layer's part of the line meets.
    [[nodiscard]] reference::Sums mean_sums(const Vec3& from, const Vec3& to) const override {
        const auto [nk, nj, ni] = samples_.shape();
        const Vec3 start = frame_.place(from), way = frame_.oblique ? frame_.to_lattice * (to - from) : to - from;
        const Vec3 start_unit = start / semi_axes_, way_unit = way / semi_axes_;
        reference::Sums mean;
        const Range layers = reached(std::min(start.z, start.z + way.z), std::max(start.z, start.z + way.z), 2, nk);
        for (std::size_t k = layers.first; k < layers.last; ++k) {
            // The part of the line, 0 to 1, that is in reach of the layer.
            const double height = static_cast<double>(k) * step_.z - start.z;
            double first = 0.0, last = 1.0;
            if (way.z != 0.0) {
                const double one = (height - semi_axes_.z) / way.z, other = (height + semi_axes_.z) / way.z;
                first = std::max(first, std::min(one, other));
                last = std::min(last, std::max(one, other));
            }
            const Vec3 end = start + first * way, other_end = start + last * way;
            const Vec3 lower = glm::min(end, other_end), upper = glm::max(end, other_end);
            const Vec3 shift = bcc_ && k % 2 == 1 ? 0.5 * step_ : Vec3(0.0);
            const Range rows = reached(lower.y - shift.y, upper.y - shift.y, 1, nj),
                        columns = reached(lower.x - shift.x, upper.x - shift.x, 0, ni);
            for (std::size_t j = rows.first; j < rows.last; ++j) {
                for (std::size_t i = columns.first; i < columns.last; ++i) {
                    const double value = samples_.value(i, j, k);
                    const Vec3 centre(static_cast<double>(i) * step_.x + shift.x,
                                      static_cast<double>(j) * step_.y + shift.y, static_cast<double>(k) * step_.z);
                    const reference::Chord chord =
                        reference::mean_of(profile_, start_unit - centre / semi_axes_, way_unit);
                    if (chord.reached && !std::isnan(value)) {
                        mean.d += value * chord.mean;
                        mean.w += chord.mean;
                        mean.empty = false;
                    }
                }
            }
        }
        return mean;
    }
    [[nodiscard]] double rho(const reference::Sums& sums) const override { return normaliser_.rho(sums.d, sums.w); }

    /// Samples along an axis: their squared distances in semi-axes, and what these make of the Gaussian.
    struct Along {
        std::size_t first = 0, count = 0;
        std::array<double, most_along> squared, gaussian;
    };

    /// The first sample along an axis and the one behind the last whose kernels meet a range of places.
    struct Range {
        std::size_t first = 0, last = 0;
    };
    [[nodiscard]] Range reached(double lower, double upper, int axis, std::size_t samples) const {
        const double most = static_cast<double>(samples), reach = semi_axes_[axis];
        const auto sample = [&](double place) { return std::clamp(place, 0.0, most); };
        return {static_cast<std::size_t>(sample(std::ceil((lower - reach) / step_[axis] - beside))),
                static_cast<std::size_t>(sample(std::floor((upper + reach) / step_[axis] + beside) + 1.0))};
    }

    template <class Values>
    [[nodiscard]] reference::Sums sum(const Values& values, const Along& layers, const std::array<Along, 2>& columns,
                                      const std::array<Along, 2>& rows) const {
        const double edge = edge_;
        const bool holes = samples_.has_holes();
        double d = 0.0, w = 0.0;
        bool empty = true;
        for (std::size_t z = 0; z < layers.count; ++z) {
            const std::size_t k = layers.first + z, shifted = bcc_ ? k % 2 : 0;
            const Along& row = columns[shifted];
            for (std::size_t y = 0; y < rows[shifted].count; ++y) {
                const double left = 1.0 - (layers.squared[z] + rows[shifted].squared[y]);
                if (!(left > 0.0)) {
                    continue;
                }
                const double gaussian = layers.gaussian[z] * rows[shifted].gaussian[y];
                const auto* samples = values.data() + samples_.row(rows[shifted].first + y, k) + row.first;
                for (std::size_t x = 0; x < row.count; ++x) {
                    const double value = static_cast<double>(samples[x]) - counted_from_;
                    const bool reached = row.squared[x] < left && !(holes && std::isnan(value));
                    // (Chosen without a branch, which would be guessed wrong at every other end of a row.)
                    const double g = reached ? gaussian * row.gaussian[x] - edge : 0.0;
                    d += (reached ? value : 0.0) * g;
                    w += g;
                    empty = empty && !reached;
                }
            }
        }
        return {d * gain_, w * gain_, empty};
    }

    [[nodiscard]] Along along(double from, int axis, std::size_t samples) const {
        const double step = step_[axis], per_axis = per_axis_[axis], reach = semi_axes_[axis] / step;
        const double middle = from / step, most = static_cast<double>(samples);
        Along found;
        found.first = static_cast<std::size_t>(std::clamp(std::ceil(middle - reach), 0.0, most));
        const auto past = static_cast<std::size_t>(std::clamp(std::floor(middle + reach) + 1.0, 0.0, most));
        found.count = std::min(past > found.first ? past - found.first : 0, most_along);
        // Each Gaussian from the one before: the ratios of neighbours have one ratio.
        const double falloff = samples_.kernel().falloff, apart = -step * per_axis;
        const double start = (from - static_cast<double>(found.first) * step) * per_axis;
        double gaussian = 0.0, ratio = 0.0;
        if (found.count > 0) {
            gaussian = std::exp(-falloff * start * start);
            ratio = std::exp(-falloff * apart * (2.0 * start + apart));
        }
        for (std::size_t n = 0; n < found.count; ++n) {
            const double offset = (from - static_cast<double>(found.first + n) * step) * per_axis;
            found.squared[n] = offset * offset;
            found.gaussian[n] = falloff < steep_falloff ? gaussian : std::exp(-falloff * found.squared[n]);
            gaussian *= ratio;
            ratio *= ratios_[axis];
        }
        return found;
    }

    std::shared_ptr<const Field> field_;
    const RegularField& samples_;
    reference::Normaliser normaliser_;
    reference::Profile profile_{samples_.kernel().falloff};
    LatticeFrame frame_;
    Vec3 semi_axes_{frame_.semi_axes}, per_axis_{1.0 / semi_axes_}, step_{frame_.step};
    Vec3 ratios_{1.0}; ///< of the ratios of neighbouring Gaussians along an axis
    double counted_from_ = samples_.counted_from();
    double edge_ = samples_.kernel().edge(), gain_ = samples_.kernel().gain();
    bool bcc_;
};

/// The reference's grid of kernels, as a camera sees them.
class ScatteredValues final : public PointValues {
  public:
    ScatteredValues(std::shared_ptr<const Field> field, const Scene& scene, const Camera& camera, Size size)
        : PointValues(field->least_weight()), field_(std::move(field)), camera_(camera), screen_(camera, size),
          sums_(*field_, scene, camera_, screen_, 1.0) {}

  private:
    [[nodiscard]] reference::Sums sums_at(const Vec3& world) const override {
        return sums_.sums_at(camera_.to_eye(world));
    }
    [[nodiscard]] reference::Sums mean_sums(const Vec3& from, const Vec3& to) const override {
        return sums_.mean_sums(camera_.to_eye(from), camera_.to_eye(to));
    }
    [[nodiscard]] double rho(const reference::Sums& sums) const override { return sums_.rho(sums); }

    std::shared_ptr<const Field> field_;
    Camera camera_;
    reference::Screen screen_;
    reference::PointSums sums_;
};

} // namespace

PointValues::Value PointValues::at(const Vec3& world) const {
    const reference::Sums sums = sums_at(world);
    return {rho(sums), sums.empty || sums.w < least_weight_};
}

PointValues::Value PointValues::mean(const Vec3& from, const Vec3& to) const {
    const reference::Sums sums = mean_sums(from, to);
    return {rho(sums), sums.empty || sums.w < least_weight_};
}

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

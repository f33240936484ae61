// What is left out cannot be seen: with the drawn kernels alone, every visible point has the rho and the gradient
// stencils that it has with all kernels, and no other point becomes visible. And the controls: an index that is a
// little too small is found out.
#include <gtest/gtest.h>

#include <functional>

#include "index/brute_force.hpp"
#include "support/lattices.hpp"

namespace sheetsplat::test {
namespace {

enum class Look {
    point,         ///< opacity at a point
    slab,          ///< opacity of the mean over a segment
    crossing,      ///< an iso value between two points
    interval,      ///< opacity anywhere between the values of two points (pre-integration)
    slab_interval, ///< the same between two means
};

struct Trial {
    std::shared_ptr<const RegularField> shared;
    const RegularField& field;
    TransferFunction transfer_function;
    Look look;
    double stencil, step, iso_value;

    [[nodiscard]] VisibilityQuery query() const {
        VisibilityQuery query;
        query.transfer_function = &transfer_function;
        query.weights_matter =
            transfer_function.at(0.0).opacity > 0.0 || field.normalization() == Normalization::threshold;
        query.reach_world = stencil + (look == Look::slab_interval ? 2.0 * step : step);
        query.isosurface = look == Look::crossing;
        query.iso_values = {iso_value};
        return query;
    }
};

Trial random_trial(Random& random, Lattice lattice, Look look) {
    const std::shared_ptr<const RegularField> shared = random_field(random, lattice);
    const RegularField& field = *shared;
    TransferFunction transfer_function = random_transfer_function(random, field);
    const double spacing = field.default_slice_spacing();
    const double stencil = random.chance(0.3) ? 0.0 : random.uniform(0.2, 3.0) * spacing;
    const double step = look == Look::point ? 0.0 : random.uniform(0.3, 2.5) * spacing;
    const auto [low, high] = field.value_range();
    const double iso_value = random.chance(0.1) ? 0.0 : random.uniform(0.9 * low, 0.9 * high);
    return {shared, field, std::move(transfer_function), look, stencil, step, iso_value};
}

struct Outcome {
    std::size_t visible = 0, wrong = 0, dropped = 0;

    void operator+=(const Outcome& other) {
        visible += other.visible;
        wrong += other.wrong;
        dropped += other.dropped;
    }
};

/// True where the mean opacity over the values from low to high is above 0: a limit at one end alone weighs nothing.
bool opaque_between(const TransferFunction& transfer_function, double low, double high) {
    const double inside_low = std::nextafter(low, high);
    const double inside_high = std::nextafter(high, low);
    if (inside_low > inside_high || low == high) {
        return transfer_function.at(low).opacity > 0.0;
    }
    return !transfer_function.transparent_over(inside_low, inside_high);
}

/// Looks at a trial's field with all kernels and with the drawn ones.
class Viewer {
  public:
    Viewer(const Trial& trial, const Mask& drawn, Random& random)
        : trial_(trial), drawn_(drawn), random_(random), brute_force_(trial.field) {
        for (std::size_t n = 0; n < brute_force_.size(); ++n) {
            if (drawn[n] == 0 && std::abs(brute_force_.value(n)) > 0.0) {
                dropped_.push_back(brute_force_.centre(n));
            }
        }
    }

    /// Compares the two at random places and at those visible ones, of many, that lie nearest to a dropped kernel.
    Outcome compare() {
        constexpr std::size_t places = 300;
        constexpr std::size_t at_random = 40;
        constexpr std::size_t nearest = 20;
        Outcome outcome;
        outcome.dropped = dropped_.size();
        std::vector<std::pair<double, Place>> visible;
        for (std::size_t n = 0; n < places; ++n) {
            const Place place = random_place();
            const bool seen = is_visible(place, nullptr);
            if (n < at_random) {
                outcome.visible += seen ? 1 : 0;
                outcome.wrong += seen == is_visible(place, &drawn_) ? 0 : 1;
            }
            if (seen) {
                visible.emplace_back(std::min(to_dropped(place.ends[0]), to_dropped(place.ends[1])), place);
            }
        }
        const std::size_t chosen = std::min(nearest, visible.size());
        std::partial_sort(visible.begin(), visible.begin() + static_cast<std::ptrdiff_t>(chosen), visible.end(),
                          [](const auto& a, const auto& b) { return a.first < b.first; });
        for (std::size_t n = 0; n < chosen; ++n) {
            outcome.visible += 1;
            outcome.wrong += is_visible(visible[n].second, &drawn_) && looks_same(visible[n].second) ? 0 : 1;
        }
        return outcome;
    }

  private:
    struct Place {
        std::array<Vec3, 2> ends; ///< the same point twice unless the look needs two
        Vec3 segment;             ///< what a mean runs over, from each end
    };

    [[nodiscard]] double to_dropped(const Vec3& x) const {
        double least = 1e300;
        for (const Vec3& centre : dropped_) {
            least = std::min(least, glm::distance(x, centre));
        }
        return least;
    }
    /// A step of at most 1: half of the time as far as can be towards the nearest dropped kernel.
    Vec3 step_from(const Vec3& x) {
        if (dropped_.empty() || random_.chance(0.5)) {
            return random_.in_ball();
        }
        const Vec3 nearest = *std::min_element(dropped_.begin(), dropped_.end(), [&](const Vec3& a, const Vec3& b) {
            return glm::distance(x, a) < glm::distance(x, b);
        });
        return (nearest - x) / std::max(1e-9, glm::distance(x, nearest));
    }
    Place random_place() {
        const bool at_dropped = !dropped_.empty() && random_.chance(0.6);
        const Vec3 near = at_dropped ? dropped_[random_.whole(0, dropped_.size() - 1)]
                                     : brute_force_.centre(random_.whole(0, brute_force_.size() - 1));
        const double spread = at_dropped ? random_.one_of({1.0, 1.5, 2.0}) : 1.0;
        const Vec3 x = near + spread * trial_.field.kernel_axes().lengths * random_.in_cube();
        const Vec3 step = trial_.step * step_from(x);
        switch (trial_.look) {
        case Look::point:
            return {{x, x}, Vec3(0.0)};
        case Look::slab:
            return {{x, x}, step};
        case Look::slab_interval:
            return {{x, x + step}, step};
        case Look::crossing:
        case Look::interval:
            break;
        }
        return {{x, x + step}, Vec3(0.0)};
    }
    [[nodiscard]] bool is_visible(const Place& place, const Mask* mask) const {
        const Sums first = brute_force_.over(place.ends[0], place.segment, mask);
        const Sums last = brute_force_.over(place.ends[1], place.segment, mask);
        const double a = brute_force_.rho(first);
        const double b = brute_force_.rho(last);
        switch (trial_.look) {
        case Look::point:
        case Look::slab:
            break;
        case Look::crossing:
            return (a < trial_.iso_value) != (b < trial_.iso_value);
        case Look::interval:
        case Look::slab_interval:
            return !(first.empty && last.empty) &&
                   opaque_between(trial_.transfer_function, std::min(a, b), std::max(a, b));
        }
        return !first.empty && trial_.transfer_function.at(a).opacity > 0.0;
    }
    [[nodiscard]] bool same_sums(const Vec3& x, const Vec3& segment) const {
        const Sums all = brute_force_.over(x, segment, nullptr);
        const Sums some = brute_force_.over(x, segment, &drawn_);
        const bool weighted = trial_.field.normalization() == Normalization::threshold;
        return all.values == some.values && (!weighted || all.weights == some.weights);
    }
    [[nodiscard]] bool looks_same(const Place& place) {
        constexpr int stencils = 4;
        bool same = true;
        for (const Vec3& end : place.ends) {
            same = same && same_sums(end, place.segment);
            for (int n = 0; same && n < stencils; ++n) {
                same = same_sums(end + trial_.stencil * step_from(end), place.segment);
            }
        }
        return same;
    }

    const Trial& trial_;
    const Mask& drawn_;
    Random& random_;
    BruteForce brute_force_;
    std::vector<Vec3> dropped_; ///< centres of dropped kernels whose value is not 0
};

/// The same trials for every way to choose the drawn samples. Ends with the first trial that goes wrong.
Outcome over_trials(Lattice lattice, Look look, int trials, const std::function<Mask(const Trial&)>& choose) {
    Outcome sum;
    for (int n = 0; n < trials && sum.wrong == 0; ++n) {
        Random random(
            static_cast<unsigned>(1000 * static_cast<int>(look) + 10 * n + (lattice == Lattice::bcc ? 1 : 0)));
        const Trial trial = random_trial(random, lattice, look);
        const Mask drawn = choose(trial);
        sum += Viewer(trial, drawn, random).compare();
    }
    return sum;
}

Mask chosen(const Trial& trial) { return mask_of(VisibleRuns::of(trial.field, trial.query()), trial.field); }

RegularField with_options(const RegularField& field, const std::function<void(RegularFieldOptions&)>& change) {
    RegularFieldOptions options = field.options();
    change(options);
    return RegularField(field.samples(), field.shape(), options);
}

constexpr int enough = 150;
constexpr int until_found = 2000;

class Safety : public testing::TestWithParam<std::tuple<Lattice, Look>> {};

TEST_P(Safety, DroppedKernelsCannotBeSeen) {
    const auto [lattice, look] = GetParam();
    const Outcome outcome = over_trials(lattice, look, enough, chosen);
    EXPECT_EQ(outcome.wrong, 0U);
    // Points were visible and kernels were dropped, else this would show nothing.
    EXPECT_GT(outcome.visible, 1000U);
    EXPECT_GT(outcome.dropped, 5000U);
}

TEST_P(Safety, ControlSmallerSupportIsFound) {
    const auto [lattice, look] = GetParam();
    const Outcome outcome = over_trials(lattice, look, until_found, [](const Trial& trial) {
        const RegularField narrower = with_options(trial.field, [](RegularFieldOptions& o) { o.radius *= 0.75; });
        return mask_of(VisibleRuns::of(narrower, trial.query()), trial.field);
    });
    EXPECT_GT(outcome.wrong, 0U);
}

TEST_P(Safety, ControlMissingStencilIsFound) {
    const auto [lattice, look] = GetParam();
    const Outcome outcome = over_trials(lattice, look, until_found, [](const Trial& trial) {
        VisibilityQuery query = trial.query();
        query.reach_world -= trial.stencil;
        return mask_of(VisibleRuns::of(trial.field, query), trial.field);
    });
    EXPECT_GT(outcome.wrong, 0U);
}

class SafetyInDepth : public Safety {};

TEST_P(SafetyInDepth, ControlMissingDepthIsFound) {
    const auto [lattice, look] = GetParam();
    const Outcome outcome = over_trials(lattice, look, until_found, [](const Trial& trial) {
        VisibilityQuery query = trial.query();
        query.reach_world = trial.stencil + (trial.look == Look::slab_interval ? trial.step : 0.0);
        return mask_of(VisibleRuns::of(trial.field, query), trial.field);
    });
    EXPECT_GT(outcome.wrong, 0U);
}

TEST_P(Safety, ControlHigherSeedsAreFound) {
    const auto [lattice, look] = GetParam();
    const Outcome outcome = over_trials(lattice, look, until_found, [](const Trial& trial) {
        std::vector<TransferPoint> points = trial.transfer_function.points();
        for (TransferPoint& point : points) {
            point.value *= 1.25;
        }
        const TransferFunction later(points);
        VisibilityQuery query = trial.query();
        query.transfer_function = &later;
        query.iso_values.front() *= 1.25;
        return mask_of(VisibleRuns::of(trial.field, query), trial.field);
    });
    EXPECT_GT(outcome.wrong, 0U);
}

TEST_P(Safety, ControlDroppedZerosAreFound) {
    const auto [lattice, look] = GetParam();
    const Outcome outcome = over_trials(lattice, look, until_found, [](const Trial& trial) {
        Mask drawn = chosen(trial);
        const BruteForce brute_force(trial.field);
        for (std::size_t n = 0; n < drawn.size(); ++n) {
            drawn[n] = brute_force.value(n) == 0.0 ? std::uint8_t{0} : drawn[n];
        }
        return drawn;
    });
    EXPECT_GT(outcome.wrong, 0U);
}

std::string name_of(const testing::TestParamInfo<Safety::ParamType>& info) {
    static const std::array<const char*, 5> looks{"Point", "Slab", "Crossing", "Interval", "SlabInterval"};
    return std::string(std::get<0>(info.param) == Lattice::bcc ? "Bcc" : "Cartesian") +
           looks[static_cast<std::size_t>(std::get<1>(info.param))];
}

INSTANTIATE_TEST_SUITE_P(All, Safety,
                         testing::Combine(testing::Values(Lattice::cartesian, Lattice::bcc),
                                          testing::Values(Look::point, Look::slab, Look::crossing, Look::interval,
                                                          Look::slab_interval)),
                         name_of);

INSTANTIATE_TEST_SUITE_P(All, SafetyInDepth,
                         testing::Combine(testing::Values(Lattice::cartesian, Lattice::bcc),
                                          testing::Values(Look::slab, Look::crossing, Look::interval,
                                                          Look::slab_interval)),
                         name_of);

// The inside of a body lies above an opaque band. Dropping it where the values that all kernels together give are
// transparent leaves sums of a part of them, which pass through the band: a second shell inside the first.
TEST(PartialSums, InsideOfABandStaysDrawn) {
    const std::array<std::size_t, 3> shape{15, 15, 15};
    std::vector<std::uint8_t> values;
    for (int k = -7; k <= 7; ++k) {
        for (int j = -7; j <= 7; ++j) {
            for (int i = -7; i <= 7; ++i) {
                values.push_back(static_cast<std::uint8_t>(
                    std::max(0, 240 - 30 * std::max({std::abs(i), std::abs(j), std::abs(k)}))));
            }
        }
    }
    RegularFieldOptions options = test::zero_boundary();
    options.radius = 1.0;
    options.falloff = 2.0;
    options.normalization = Normalization::threshold;
    options.w0 = 0.2;
    const auto field = std::make_shared<const RegularField>(values, shape, options);
    const Trial trial{
        field,       *field, TransferFunction({{25, Vec3(1), 0}, {30, Vec3(1), 1}, {60, Vec3(1), 1}, {65, Vec3(1), 0}}),
        Look::point, 0.0,    0.0,
        0.0};
    Mask by_full_sums(values.size(), 1);
    const BruteForce brute_force(trial.field);
    for (std::size_t s = 0; s < values.size(); ++s) {
        double low = 255.0;
        double high = 0.0;
        for (std::size_t h = 0; h < values.size(); ++h) {
            if (glm::distance(brute_force.centre(s), brute_force.centre(h)) < 2.0) {
                low = std::min(low, brute_force.value(h));
                high = std::max(high, brute_force.value(h));
            }
        }
        const Vec3 from_centre = glm::abs(brute_force.centre(s) - Vec3(7.0));
        const bool at_border = std::max({from_centre.x, from_centre.y, from_centre.z}) > 5.0;
        by_full_sums[s] = trial.transfer_function.transparent_over(at_border ? 0.0 : low, high) ? 0 : 1;
    }
    const Mask drawn = chosen(trial);
    EXPECT_LT(count(by_full_sums), count(drawn));
    Outcome with_index;
    Outcome control;
    for (unsigned seed = 0; seed < 30; ++seed) {
        Random random(seed);
        with_index += Viewer(trial, drawn, random).compare();
        control += Viewer(trial, by_full_sums, random).compare();
    }
    EXPECT_EQ(with_index.wrong, 0U);
    EXPECT_GT(with_index.visible, 50U);
    EXPECT_GT(control.wrong, 0U);
}

} // namespace
} // namespace sheetsplat::test

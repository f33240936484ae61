// Which scattered kernels are drawn: against the rule, by brute force; what is left out cannot be seen; and the
// controls: a choice that is a little too small is found out.
#include <gtest/gtest.h>

#include <functional>
#include <limits>

#include "index/ellipsoid_fields.hpp"
#include "sheetsplat/error.hpp"
#include "support.hpp"

namespace sheetsplat::test {
namespace {

TransferFunction band(double from, double to) {
    return TransferFunction({{from, Vec3(1), 0.0}, {from, Vec3(1), 1.0}, {to, Vec3(1), 1.0}, {to, Vec3(1), 0.0}});
}

VisibilityQuery asking(const TransferFunction& transfer_function, double reach = 0.0) {
    VisibilityQuery visibility;
    visibility.transfer_function = &transfer_function;
    visibility.reach_world = reach;
    return visibility;
}

Mask visible(const EllipsoidField& field, const VisibilityQuery& visibility) {
    return visible_kernels(field, SpatialGrid::of(field), visibility);
}

/// The rule of conventions, section 2 over boxes: all pairs of kernels are looked at.
Mask by_the_rule(const EllipsoidField& field, const TransferFunction& transfer_function, double reach) {
    Mask mask(field.size(), 0);
    for (std::size_t i = 0; i < field.size(); ++i) {
        double least = 0.0;
        double greatest = 0.0;
        const Box box = box_of(field, i, reach);
        for (std::size_t h = 0; h < field.size(); ++h) {
            if (meet(box, box_of(field, h))) {
                if (field.normalization() == Normalization::threshold) {
                    if (field.weight(h) > 0.0) {
                        least = std::min(least, field.value(h));
                        greatest = std::max(greatest, field.value(h));
                    }
                } else {
                    const double amplitude = field.weight(h) * field.value(h) / field.lattice_constant();
                    least += std::min(0.0, amplitude);
                    greatest += std::max(0.0, amplitude);
                }
            }
        }
        const bool adds =
            field.weight(i) > 0.0 && (field.value(i) != 0.0 || field.normalization() == Normalization::threshold);
        mask[i] = adds && !transfer_function.transparent_over(least, greatest) ? 1 : 0;
    }
    return mask;
}

EllipsoidFieldOptions random_options(Random& random) {
    EllipsoidFieldOptions options;
    options.normalization = random.one_of({Normalization::none, Normalization::lattice, Normalization::threshold});
    options.w0 = random.one_of({0.3, 1.0, 2.0});
    options.falloff = random.one_of({2.0, 5.0, 8.0});
    return options;
}

/// Kernels of both signs and all weights, so thin that not all is visible.
EllipsoidField random_ellipsoids(Random& random) {
    const Scatter scatter = random.one_of(
        {Scatter::even, Scatter::turned, Scatter::sizes, Scatter::clusters, Scatter::far_off, Scatter::flat});
    EllipsoidArrays arrays = scattered(random, scatter, random.whole(2, 250));
    EllipsoidFieldOptions options = random_options(random);
    const double thinner = random.uniform(0.3, 0.9);
    for (double& radius : arrays.radii) {
        radius = options.normalization == Normalization::lattice ? thinner * 0.2 : thinner * radius;
    }
    for (Vec3& scale : arrays.scales) {
        scale *= thinner;
    }
    if (options.normalization == Normalization::lattice) {
        if (!arrays.scales.empty()) {
            options.normalization = Normalization::none;
        } else {
            options.cell_volume = 0.01;
        }
    }
    for (std::size_t i = 0; i < arrays.values.size(); ++i) {
        if (random.chance(0.1)) {
            arrays.values[i] = 0.0;
        } else if (random.chance(0.1)) {
            arrays.values[i] *= 5.0;
        }
    }
    if (random.chance(0.5)) {
        for (std::size_t i = 0; i < arrays.values.size(); ++i) {
            arrays.weights.push_back(i > 0 && random.chance(0.1) ? 0.0 : random.uniform(0.2, 2.0));
        }
    }
    return EllipsoidField(arrays, options);
}

TransferFunction random_transfer_function(Random& random) {
    for (;;) {
        std::vector<double> values(random.whole(1, 6));
        for (double& value : values) {
            value = random.uniform(-6.0, 6.0);
        }
        std::sort(values.begin(), values.end());
        std::vector<TransferPoint> points;
        for (const double value : values) {
            points.push_back({value, Vec3(1.0), random.chance(0.6) ? 0.0 : random.uniform(0.0, 1.0)});
            if (random.chance(0.2)) {
                points.push_back({value, Vec3(1.0), random.chance(0.5) ? 0.0 : random.uniform(0.0, 1.0)});
            }
        }
        TransferFunction result(points);
        if (result.max_opacity() > 0.0 && result.transparent_over(0.0, 0.0)) {
            return result;
        }
    }
}

TEST(VisibleKernels, AreThoseOfTheRule) {
    std::size_t drawn = 0;
    std::size_t dropped = 0;
    for (unsigned seed = 0; seed < 300; ++seed) {
        Random random(seed);
        const EllipsoidField field = random_ellipsoids(random);
        const TransferFunction transfer_function = random_transfer_function(random);
        const double reach = random.one_of({0.0, 0.01, 0.3});
        const Mask mask = visible(field, asking(transfer_function, reach));
        ASSERT_EQ(mask, by_the_rule(field, transfer_function, reach)) << "seed " << seed;
        drawn += count(mask);
        dropped += mask.size() - count(mask);
    }
    EXPECT_GT(drawn, 3000U);
    EXPECT_GT(dropped, 3000U);
}

/// cut: an interval of which the second end is cut off, so that it shows only where the first is not empty.
enum class Look { point, crossing, interval, cut };

struct Trial {
    const EllipsoidField& field;
    const TransferFunction& transfer_function;
    Look look;
    double stencil, step, iso_value;

    [[nodiscard]] VisibilityQuery query() const {
        VisibilityQuery query = asking(transfer_function, stencil + (look == Look::point ? 0.0 : step));
        query.isosurface = look == Look::crossing;
        query.iso_values = {iso_value};
        query.reach_matters = look == Look::cut;
        return query;
    }
};

struct Outcome {
    std::size_t visible = 0, dropped = 0, wrong = 0;
};

/// Looks at places in dropped kernels, where a fault would show.
Outcome compare(const Trial& trial, const Mask& drawn, Random& random) {
    const EllipsoidField& field = trial.field;
    Outcome outcome;
    outcome.dropped = drawn.size() - count(drawn);
    const auto seen = [&](const Sums& first, const Sums& second) {
        const double a = rho_of(field, first);
        const double b = rho_of(field, second);
        switch (trial.look) {
        case Look::crossing:
            return (a < trial.iso_value) != (b < trial.iso_value);
        case Look::interval:
            return !(first.empty && second.empty) &&
                   !trial.transfer_function.transparent_over(std::min(a, b), std::max(a, b));
        case Look::cut:
            return !first.empty && !trial.transfer_function.transparent_over(std::min(a, b), std::max(a, b));
        case Look::point:
            break;
        }
        return !first.empty && trial.transfer_function.at(a).opacity > 0.0;
    };
    const auto same = [&](const Vec3& x) {
        const Sums all = sums_at(field, x, nullptr);
        const Sums some = sums_at(field, x, &drawn);
        return all.values == some.values && (trial.look != Look::cut || all.empty == some.empty) &&
               (field.normalization() != Normalization::threshold || all.weights == some.weights);
    };
    for (int n = 0; n < 60; ++n) {
        std::size_t kernel = random.whole(0, field.size() - 1);
        for (int look = 0; look < 8 && drawn[kernel] != 0; ++look) {
            kernel = random.whole(0, field.size() - 1);
        }
        const Vec3 inside = field.center(kernel) + field.shape(kernel) * random.in_ball();
        const Vec3 x = inside + trial.stencil * random.in_ball();
        const Vec3 y = trial.look == Look::point ? x : x + trial.step * glm::normalize(random.in_ball());
        const bool with_all = seen(sums_at(field, x, nullptr), sums_at(field, y, nullptr));
        const bool with_some = seen(sums_at(field, x, &drawn), sums_at(field, y, &drawn));
        if (!with_all && !with_some) {
            continue;
        }
        ++outcome.visible;
        bool right = with_all && with_some && same(x) && same(y);
        if (glm::length(inside - x) <= trial.stencil) {
            right = right && same(inside);
        }
        for (int end = 0; right && end < 4; ++end) {
            right = same((end % 2 == 0 ? x : y) + trial.stencil * random.in_ball());
        }
        outcome.wrong += right ? 0 : 1;
    }
    return outcome;
}

Outcome over_trials(Look look, int trials, const std::function<Mask(const Trial&)>& choose) {
    Outcome sum;
    for (int n = 0; n < trials && sum.wrong == 0; ++n) {
        Random random(static_cast<unsigned>(10 * n + static_cast<int>(look)));
        const EllipsoidField field = random_ellipsoids(random);
        const TransferFunction transfer_function = random_transfer_function(random);
        const double scale = field.semi_axes(field.size() / 2).x;
        const Trial trial{field,
                          transfer_function,
                          look,
                          scale * random.one_of({0.0, 0.3, 1.0}),
                          scale * random.uniform(0.1, 1.0),
                          random.one_of({0.5, -0.5, 1.2, 2.5, -2.5, 0.0})};
        const Outcome outcome = compare(trial, choose(trial), random);
        sum.visible += outcome.visible;
        sum.dropped += outcome.dropped;
        sum.wrong += outcome.wrong;
    }
    return sum;
}

Mask chosen(const Trial& trial) { return visible(trial.field, trial.query()); }

constexpr int enough = 250;
constexpr int until_found = 2000;

class EllipsoidSafety : public testing::TestWithParam<Look> {};

TEST_P(EllipsoidSafety, DroppedKernelsCannotBeSeen) {
    const Outcome outcome = over_trials(GetParam(), enough, chosen);
    EXPECT_EQ(outcome.wrong, 0U);
    EXPECT_GT(outcome.visible, 500U);
    EXPECT_GT(outcome.dropped, 3000U);
}

TEST_P(EllipsoidSafety, ControlMissingReachIsFound) {
    const Outcome outcome = over_trials(GetParam(), until_found, [](const Trial& trial) {
        VisibilityQuery query = trial.query();
        query.reach_world = 0.0;
        return visible(trial.field, query);
    });
    EXPECT_GT(outcome.wrong, 0U);
}

TEST_P(EllipsoidSafety, ControlNarrowerSupportsAreFound) {
    const Outcome outcome = over_trials(GetParam(), until_found, [](const Trial& trial) {
        EllipsoidArrays arrays = trial.field.arrays();
        for (double& radius : arrays.radii) {
            radius *= 0.7;
        }
        for (Vec3& scale : arrays.scales) {
            scale *= 0.7;
        }
        EllipsoidFieldOptions options = trial.field.options();
        options.cell_volume = options.cell_volume.value_or(1.0) * 0.343;
        return visible(EllipsoidField(arrays, options), trial.query());
    });
    EXPECT_GT(outcome.wrong, 0U);
}

TEST_P(EllipsoidSafety, ControlLaterLimitsAreFound) {
    const Outcome outcome = over_trials(GetParam(), until_found, [](const Trial& trial) {
        std::vector<TransferPoint> points = trial.transfer_function.points();
        for (TransferPoint& point : points) {
            point.value *= 1.5;
        }
        const TransferFunction later(points);
        VisibilityQuery query = trial.query();
        query.transfer_function = &later;
        query.iso_values.front() *= 1.5;
        return visible(trial.field, query);
    });
    EXPECT_GT(outcome.wrong, 0U);
}

// Kernels that add nothing to sums make places not empty.
TEST(VisibleKernels, ControlKernelsThatAddNothingAreFound) {
    const Outcome outcome = over_trials(Look::cut, until_found, [](const Trial& trial) {
        VisibilityQuery query = trial.query();
        query.reach_matters = false;
        return visible(trial.field, query);
    });
    EXPECT_GT(outcome.wrong, 0U);
}

// A kernel's own value tells nothing about what is seen inside its support.
TEST_P(EllipsoidSafety, ControlOwnValuesAloneAreFound) {
    const Outcome outcome = over_trials(GetParam(), until_found, [](const Trial& trial) {
        Mask mask = chosen(trial);
        for (std::size_t i = 0; i < mask.size(); ++i) {
            const double value = trial.field.value(i);
            const bool seen = trial.look == Look::crossing
                                  ? std::min(0.0, value) < trial.iso_value && std::max(0.0, value) >= trial.iso_value
                                  : !trial.transfer_function.transparent_over(value, value);
            mask[i] = seen ? mask[i] : 0;
        }
        return mask;
    });
    EXPECT_GT(outcome.wrong, 0U);
}

std::string name_of_look(const testing::TestParamInfo<Look>& tried) {
    static const std::array<const char*, 4> names{"Point", "Crossing", "Interval", "Cut"};
    return names[static_cast<std::size_t>(tried.param)];
}

INSTANTIATE_TEST_SUITE_P(All, EllipsoidSafety, testing::Values(Look::point, Look::crossing, Look::interval, Look::cut),
                         name_of_look);

/// Two kernels that overlap and one far from both.
EllipsoidField three(std::vector<double> values, Normalization normalization, std::vector<double> weights = {}) {
    EllipsoidArrays arrays;
    arrays.centers = {Vec3(0.0), Vec3(1.0, 0.0, 0.0), Vec3(10.0, 0.0, 0.0)};
    arrays.radii = {0.75, 0.75, 0.75};
    arrays.values = std::move(values);
    arrays.weights = std::move(weights);
    EllipsoidFieldOptions options;
    options.normalization = normalization;
    return EllipsoidField(arrays, options);
}

TEST(VisibleKernels, NeighboursDecide) {
    const TransferFunction high = band(5.0, 6.0);
    // The first is drawn for the sake of the second, whose sums run through the band.
    EXPECT_EQ(visible(three({1.0, 7.0, 1.0}, Normalization::threshold), asking(high)), (Mask{1, 1, 0}));
    EXPECT_EQ(visible(three({3.0, 3.0, 3.0}, Normalization::threshold), asking(high)), (Mask{0, 0, 0}));
    EXPECT_EQ(visible(three({3.0, 3.0, 3.0}, Normalization::none), asking(high)), (Mask{1, 1, 0}));
    EXPECT_EQ(visible(three({3.0, -3.0, 3.0}, Normalization::none), asking(high)), (Mask{0, 0, 0}));
    // Reach: 10 - 1 - 2 * 0.75 lie between the second and the third.
    EXPECT_EQ(visible(three({1.0, 7.0, 1.0}, Normalization::threshold), asking(high, 7.5)), (Mask{1, 1, 1}));
    EXPECT_EQ(visible(three({1.0, 7.0, 1.0}, Normalization::threshold), asking(high, 7.49)), (Mask{1, 1, 0}));
}

TEST(VisibleKernels, NegativeValues) {
    const TransferFunction low = band(-6.0, -5.0);
    EXPECT_EQ(visible(three({1.0, -7.0, -1.0}, Normalization::threshold), asking(low)), (Mask{1, 1, 0}));
    EXPECT_EQ(visible(three({1.0, 7.0, 1.0}, Normalization::threshold), asking(low)), (Mask{0, 0, 0}));
}

TEST(VisibleKernels, ValuesOfZero) {
    const TransferFunction high = band(5.0, 6.0);
    EXPECT_EQ(visible(three({0.0, 6.0, 0.0}, Normalization::threshold), asking(high)), (Mask{1, 1, 0}));
    EXPECT_EQ(visible(three({0.0, 6.0, 0.0}, Normalization::none), asking(high)), (Mask{0, 1, 0}));
    VisibilityQuery with_weights = asking(high);
    with_weights.weights_matter = true;
    EXPECT_EQ(visible(three({0.0, 6.0, 0.0}, Normalization::none), with_weights), (Mask{1, 1, 0}));
    // A kernel of weight 0 gives nothing, and does not make its neighbour visible.
    EXPECT_EQ(visible(three({1.0, 6.0, 6.0}, Normalization::threshold, {1.0, 0.0, 1.0}), asking(high)),
              (Mask{0, 0, 1}));
    // Where being reached decides, both are drawn beside what is visible.
    VisibilityQuery with_reach = asking(high);
    with_reach.reach_matters = true;
    EXPECT_EQ(visible(three({0.0, 6.0, 0.0}, Normalization::none), with_reach), (Mask{1, 1, 0}));
    EXPECT_EQ(visible(three({1.0, 6.0, 6.0}, Normalization::threshold, {0.0, 1.0, 0.0}), with_reach), (Mask{1, 1, 0}));
    with_reach.alone = false;
    EXPECT_EQ(visible(three({0.0, 6.0, 6.0}, Normalization::none, {1.0, 1.0, 0.0}), with_reach), (Mask{1, 1, 1}));
    // Opacity at 0: an empty point is transparent, one whose kernels give 0 is not.
    const TransferFunction at_zero = band(-1.0, 1.0);
    EXPECT_EQ(visible(three({0.0, 6.0, 6.0}, Normalization::none, {1.0, 0.0, 1.0}), asking(at_zero)), (Mask{1, 1, 1}));
}

TEST(VisibleKernels, WithoutClassificationOrWithOtherFields) {
    const EllipsoidField field = three({0.0, 6.0, 1.0}, Normalization::none, {1.0, 0.0, 1.0});
    EXPECT_EQ(visible(field, VisibilityQuery{}), (Mask{0, 0, 1}));
    const TransferFunction high = band(5.0, 6.0);
    VisibilityQuery among_others = asking(high);
    among_others.alone = false;
    EXPECT_EQ(visible(field, among_others), (Mask{0, 0, 1}));
    EXPECT_EQ(visible(three({0.0, 6.0, 1.0}, Normalization::threshold), among_others), (Mask{1, 1, 1}));
    VisibilityQuery everything = asking(high);
    everything.cull = false;
    EXPECT_EQ(visible(field, everything), (Mask{1, 1, 1}));
}

TEST(VisibleKernels, Isosurfaces) {
    VisibilityQuery visibility;
    visibility.isosurface = true;
    const auto with = [&](double iso, std::vector<double> values) {
        visibility.iso_values = {iso};
        return visible(three(std::move(values), Normalization::threshold), visibility);
    };
    EXPECT_EQ(with(2.0, {1.0, 2.0, 1.0}), (Mask{1, 1, 0}));
    EXPECT_EQ(with(2.1, {1.0, 2.0, 1.0}), (Mask{0, 0, 0}));
    EXPECT_EQ(with(-2.0, {1.0, -3.0, 1.0}), (Mask{1, 1, 0}));
    // Where nothing is below it, 0 is not crossed.
    EXPECT_EQ(with(0.0, {1.0, 2.0, 1.0}), (Mask{0, 0, 0}));
    EXPECT_EQ(with(0.0, {1.0, 2.0, -1.0}), (Mask{0, 0, 1}));
    // Of several values the nearest to 0 on either side decides.
    visibility.iso_values = {3.0, 1.5, -2.0, -5.0};
    EXPECT_EQ(visible(three({0.1, 1.6, -1.9}, Normalization::threshold), visibility), (Mask{1, 1, 0}));
    EXPECT_EQ(visible(three({0.1, 1.4, -2.1}, Normalization::threshold), visibility), (Mask{0, 0, 1}));
    visibility.iso_values.clear();
    EXPECT_EQ(visible(three({9.0, 9.0, -9.0}, Normalization::threshold), visibility), (Mask{0, 0, 0}));
}

TEST(VisibleKernels, OfNothingAndBadReach) {
    const EllipsoidField nothing{EllipsoidArrays{}};
    const TransferFunction high = band(5.0, 6.0);
    EXPECT_TRUE(visible(nothing, asking(high)).empty());
    const EllipsoidField field = three({1.0, 1.0, 1.0}, Normalization::none);
    for (const double reach : {-1.0, std::numeric_limits<double>::quiet_NaN()}) {
        expect_parts(message_of<InvalidInput>([&] { (void)visible(field, asking(high, reach)); }),
                     {"reach_world", "0 or more"});
    }
    // From everywhere to everywhere.
    EXPECT_EQ(visible(three({6.0, 1.0, 1.0}, Normalization::threshold),
                      asking(high, std::numeric_limits<double>::infinity())),
              (Mask{1, 1, 1}));
}

// More kernels than leaves of the tree: still nothing is dropped that the rule keeps, and most of what it drops is.
TEST(VisibleKernels, OfAMillion) {
    constexpr std::size_t n = 1200000;
    Random random(4);
    EllipsoidArrays arrays;
    for (std::size_t i = 0; i < n; ++i) {
        arrays.centers.push_back(random.in_cube());
        arrays.radii.push_back(0.01);
        arrays.values.push_back(arrays.centers.back().x < -0.99 ? 6.0 : 1.0);
    }
    const EllipsoidField field(std::move(arrays));
    const TransferFunction high = band(5.0, 6.0);
    const Mask mask = visible(field, asking(high, 0.005));
    std::vector<std::size_t> seeds;
    std::size_t far_drawn = 0;
    for (std::size_t i = 0; i < n; ++i) {
        if (field.value(i) == 6.0) {
            seeds.push_back(i);
            ASSERT_EQ(mask[i], 1);
        }
        far_drawn += field.center(i).x > -0.93 && mask[i] != 0 ? 1 : 0;
    }
    EXPECT_EQ(far_drawn, 0U);
    std::size_t near = 0;
    for (std::size_t i = 0; i < n && near < 1000; ++i) {
        if (field.center(i).x > -0.99 && field.center(i).x < -0.96 && i % 7 == 0) {
            const bool wanted = std::any_of(seeds.begin(), seeds.end(), [&](std::size_t seed) {
                return meet(box_of(field, seed), box_of(field, i, 0.005));
            });
            ASSERT_TRUE(mask[i] != 0 || !wanted);
            near += wanted ? 1 : 0;
        }
    }
    EXPECT_GT(near, 500U);
    EXPECT_LT(count(mask), n / 10);
}

} // namespace
} // namespace sheetsplat::test

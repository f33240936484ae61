#include "facts/field_survey.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <type_traits>
#include <variant>
#include <vector>

#include "base/poll.hpp"
#include "index/visible_runs.hpp"

namespace sheetsplat {

namespace {

/// Share of the largest sample below which a block's sums are too small for their rounding to show.
constexpr double least_that_counts = 0.05;

/// height(semi-axes): what is left of a kernel's height.
template <class Height>
WeightFacts survey(const EllipsoidField& field, Height&& height) {
    WeightFacts facts;
    facts.low = std::numeric_limits<double>::infinity();
    facts.high = -facts.low;
    for (std::size_t i = 0; i < field.size(); ++i) {
        const double weight = field.weight(i) * height(field.semi_axes(i));
        const double product = weight * field.value(i);
        facts.low = std::min(facts.low, product);
        facts.high = std::max(facts.high, product);
        facts.most = std::max(facts.most, weight);
        if (weight > 0.0) {
            facts.least = std::min(facts.least, weight);
        }
        // m f g / max(w0, W), where W is at least m g.
        facts.alone = std::max(facts.alone, std::abs(product) / std::max(field.w0(), weight));
    }
    return facts;
}

} // namespace

WeightFacts survey_weights(const EllipsoidField& field) {
    return survey(field, [](const Vec3&) { return 1.0; });
}

WeightFacts survey_filtered_weights(const EllipsoidField& field, const FilterWidth& width) {
    return survey(field, [&](const Vec3& axes) {
        return std::min(1.0, axes.x / width.across * (axes.y / width.across) * (axes.z / width.along));
    });
}

double least_change(const RegularField& field) {
    const auto [least, greatest] = field.value_range();
    const double counts = least_that_counts * std::max(std::abs(least), std::abs(greatest));
    const auto [nk, nj, ni] = field.shape();
    const double base = field.counted_from();
    return std::visit(
        [&, nj = nj, ni = ni, nk = nk](const auto& samples) {
            using Value = typename std::decay_t<decltype(samples)>::value_type;
            double found = std::numeric_limits<double>::infinity();
            std::vector<Value> low(ni), high(ni);
            // The last pair of an odd number shares a sample with the one before.
            for (std::size_t k = 0; k < nk; k += 2) {
                for (std::size_t j = 0; j < nj && found > 0.0; j += 2) {
                    poll();
                    std::fill(low.begin(), low.end(), std::numeric_limits<Value>::max());
                    std::fill(high.begin(), high.end(), std::numeric_limits<Value>::lowest());
                    for (const std::size_t layer : {k, std::min(k + 1, nk - 1)}) {
                        for (const std::size_t row : {j, std::min(j + 1, nj - 1)}) {
                            const Value* from = samples.data() + field.row(row, layer);
                            // (A NaN is not beyond anything.)
                            for (std::size_t i = 0; i < ni; ++i) {
                                low[i] = from[i] < low[i] ? from[i] : low[i];
                                high[i] = from[i] > high[i] ? from[i] : high[i];
                            }
                        }
                    }
                    for (std::size_t i = 0; i < ni; i += 2) {
                        const std::size_t next = std::min(i + 1, ni - 1);
                        const auto lowest = static_cast<double>(std::min(low[i], low[next])) - base;
                        const auto highest = static_cast<double>(std::max(high[i], high[next])) - base;
                        if (lowest <= highest && std::max(-lowest, highest) >= counts) {
                            found = std::min(found, highest - lowest);
                        }
                    }
                }
            }
            return std::isfinite(found) ? found : 0.0;
        },
        field.samples());
}

double FieldSurveys::least_change_of(const std::shared_ptr<const Field>& lattice) {
    FieldSurvey& survey = kept(lattice);
    if (!survey.least_change) {
        survey.least_change = least_change(*as_regular(lattice.get()));
    }
    return *survey.least_change;
}

FieldSurvey& FieldSurveys::kept(const std::shared_ptr<const Field>& field) {
    for (const auto& survey : surveys_) {
        if (survey->field.lock() == field) {
            return *survey;
        }
    }
    auto made = std::make_unique<FieldSurvey>();
    made->field = field;
    if (const EllipsoidField* ellipsoids = as_ellipsoids(field.get())) {
        made->kernels = survey_kernels(*ellipsoids);
        if (!ellipsoids->arrays().weights.empty()) {
            made->weights = survey_weights(*ellipsoids);
        }
    }
    if (const RegularField* regular = as_regular(field.get()); regular != nullptr && regular->size() > 0) {
        made->lattice_peak = lattice_ripple(*regular).upper;
    }
    surveys_.push_back(std::move(made));
    return *surveys_.back();
}

} // namespace sheetsplat

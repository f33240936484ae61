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

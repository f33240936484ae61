// Facts of views that no camera has seen.
#pragma once

#include "facts/view_facts.hpp"

namespace sheetsplat::test {

/// The facts, with those of the scene's fields that are the same in every view, where they are not given.
inline ViewFacts surveyed(const Scene& scene, ViewFacts view) {
    FieldSurveys surveys;
    for (const auto& field : scene.fields) {
        const FieldSurvey& survey = surveys.of(field);
        if (survey.weights) {
            view.weights.emplace(field.get(), *survey.weights);
        }
        if (survey.lattice_peak) {
            view.lattice_peaks.emplace(field.get(), *survey.lattice_peak);
        }
    }
    return view;
}

} // namespace sheetsplat::test

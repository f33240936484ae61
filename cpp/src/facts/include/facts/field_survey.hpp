// What fields are like in every view: surveyed once a field, since it takes a look at every kernel.
#pragma once

#include <algorithm>
#include <limits>
#include <memory>
#include <optional>
#include <vector>

#include "facts/ellipsoid_survey.hpp"
#include "facts/frame.hpp"
#include "sheetsplat/field.hpp"
#include "sheetsplat/scene.hpp"

namespace sheetsplat {

/// What the weights m and values f of a scattered field amount to.
struct WeightFacts {
    double low = 0.0, high = 0.0;                           ///< of m f
    double most = 0.0;                                      ///< largest m
    double least = std::numeric_limits<double>::infinity(); ///< smallest m above 0
    double alone = 0.0;                                     ///< largest |m f| / max(w0, m): one kernel's rho
};
WeightFacts survey_weights(const EllipsoidField& field);
/// The same under a filter that widens kernels by no less than `width` at the same mass: a weight is multiplied by what
/// is left of its kernel's height, at most.
WeightFacts survey_filtered_weights(const EllipsoidField& field, const FilterWidth& width);

struct FieldSurvey {
    std::weak_ptr<const Field> field;
    KernelFacts kernels;                ///< scattered fields
    std::optional<WeightFacts> weights; ///< weighted ones
    std::optional<double> lattice_peak; ///< lattices: largest W / C anywhere
};

/// Drops entries of other fields, but not those of fields that still exist which are `spared`.
template <class Entry, class Spared>
void keep_fields(std::vector<std::unique_ptr<Entry>>& entries, const std::vector<std::shared_ptr<const Field>>& fields,
                 Spared&& spared) {
    const auto unused = [&](const std::unique_ptr<Entry>& entry) {
        const std::shared_ptr<const Field> field = entry->field.lock();
        return field == nullptr ||
               (std::find(fields.begin(), fields.end(), field) == fields.end() && !spared(*entry, *field));
    };
    entries.erase(std::remove_if(entries.begin(), entries.end(), unused), entries.end());
}

/// Keeps the surveys of a scene's fields between pictures.
class FieldSurveys {
  public:
    const FieldSurvey& of(const std::shared_ptr<const Field>& field) { return kept(field); }
    /// Drops what belongs to other fields. Parts of a whole come one after the other, again for each picture: what
    /// belongs to `parts` stays while they exist.
    void forget_others(const std::vector<std::shared_ptr<const Field>>& fields, bool parts) {
        keep_fields(surveys_, fields, [parts](const FieldSurvey&, const Field&) { return parts; });
    }

  private:
    FieldSurvey& kept(const std::shared_ptr<const Field>& field);

    std::vector<std::unique_ptr<FieldSurvey>> surveys_;
};

} // namespace sheetsplat

// What a plan needs to know of a view, without a look at every kernel for every picture.
#pragma once

#include <memory>
#include <optional>
#include <vector>

#include "plan/make_plan.hpp"
#include "sheetsplat/camera.hpp"
#include "sheetsplat/scene.hpp"
#include "view/ellipsoid_survey.hpp"
#include "view/frame.hpp"

namespace sheetsplat {

/// Largest s = 1 / cos(theta) over a picture (IMAGE FORMATION section 4).
double largest_slant(const Frame& frame);

/// What fields are like in every view, surveyed once a field.
class FieldFacts {
  public:
    struct Entry {
        std::shared_ptr<const Field> field;
        KernelFacts kernels;                ///< scattered fields
        std::optional<WeightFacts> weights; ///< weighted ones
        std::optional<double> peak;         ///< lattices: largest W / C
    };
    const Entry& of(const std::shared_ptr<const Field>& field);
    void forget_others(const Scene& scene);

  private:
    std::vector<std::unique_ptr<Entry>> entries_;
};

ViewFacts facts_of(const Scene& scene, const Camera& camera, const Frame& frame, FieldFacts& fields);

} // namespace sheetsplat

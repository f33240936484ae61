// What can occur in a picture at all: values, opacities, and which points a clip keeps. Bounds from ranges, without a
// look at single kernels.
#pragma once

#include "plan/make_plan.hpp"

namespace sheetsplat {

/// Bounds of a number; infinite where nothing is known.
struct Range {
    double lower = 0.0, upper = 0.0;
};

/// Values of a group's rho that slices and intervals between them can have, 0 beyond the supports included.
Range occurring_values(const Scene& scene, const ViewFacts& view, const Group& group);

/// Largest opacity of a transfer function over a range.
double most_opaque(const TransferFunction& function, const Range& values);

/// What a clip leaves of all that can be seen.
enum class Kept { everything, something, nothing };
Kept kept_by(const Scene& scene, const ViewFacts& view);

} // namespace sheetsplat

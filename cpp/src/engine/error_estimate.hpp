// Which causes of a picture's error are of the model, and so in all pictures of a view. The estimate itself is that of
// sheetsplat/image.hpp.
#pragma once

#include <vector>

#include "sheetsplat/render_plan.hpp"

namespace sheetsplat {

/// True for causes that pictures of a backend share, whatever their numbers: shares of light looked up in volumes.
bool is_of_model(const ErrorShare& share);

/// Of a plan's causes the root of the sum of squares of those that are.
double model_error(const std::vector<ErrorShare>& budget);

} // namespace sheetsplat

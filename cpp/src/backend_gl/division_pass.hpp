// Fields that are divided by their own sums of weights before fields are added.
#pragma once

#include "tile_scope.hpp"

namespace sheetsplat::backend_gl {

/// Divides the newest slabs that no later batch adds to, of each field with sheets of its own, and adds them to the
/// sheets of its group. Nothing where no field has any.
void divide_own_sheets(const TileScope& scope, std::int64_t pass);

} // namespace sheetsplat::backend_gl

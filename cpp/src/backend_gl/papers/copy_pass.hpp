// Four slabs in the channels of one splat buffer, whose roles rotate: [NM05] sections 4.1 and 4.5.
#pragma once

#include "tile_scope.hpp"

namespace sheetsplat::backend_gl {

/// Packing paper: copies the finished slab of a pass to the copy buffer, from which it is shaded, and clears its
/// channel for the slab four further on.
void copy_finished_slab(const TileScope& scope, std::int64_t pass);

} // namespace sheetsplat::backend_gl

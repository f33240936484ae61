// The loop over a tile in one number type for one instruction set; cpp/instruction_sets.cmake makes a source of each.
#include "backend_cpu/tile_task.hpp"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "tile_set_body.hpp"
#include "hwy/foreach_target.h"
// (foreach_target includes it for the sets that are not Highway's own of this source.)
#include "tile_set_body.hpp"

// The loop over a tile in float32, once for each instruction set.
#include "backend_cpu/tile_task.hpp"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "tile_float.cpp"
#include "hwy/foreach_target.h"
// (foreach_target includes this file once for each set, ahead of the others.)
#include "tile_functions-inl.hpp"

#if HWY_ONCE
template const sheetsplat::backend_cpu::TileFunctions<float>*
sheetsplat::backend_cpu::tile_functions<float>(InstructionSet set);
#endif

// The loop over a tile in float64, once for each instruction set.
#include "backend_cpu/tile_task.hpp"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "tile_double.cpp"
#include "hwy/foreach_target.h"
// (foreach_target includes this file once for each set, ahead of the others.)
#include "tile_functions-inl.hpp"

#if HWY_ONCE
template const sheetsplat::backend_cpu::TileFunctions<double>*
sheetsplat::backend_cpu::tile_functions<double>(InstructionSet set);
#endif

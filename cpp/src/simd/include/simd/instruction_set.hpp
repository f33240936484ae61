// The instruction set that tiles are drawn with.
#pragma once

#include "simd/tile_task.hpp"

namespace sheetsplat::simd {

/// The best one that was compiled and that this processor runs, or the one that was chosen.
InstructionSet chosen_instruction_set();

} // namespace sheetsplat::simd

// The instruction set that tiles are drawn with.
#pragma once

#include <vector>

#include "backend_cpu/tile_task.hpp"

namespace sheetsplat::backend_cpu {

/// The best one that was compiled and that this processor runs, or the one that was chosen.
InstructionSet chosen_instruction_set();
/// All that were compiled and that this processor runs, the best one first.
std::vector<InstructionSet> usable_instruction_sets();

} // namespace sheetsplat::backend_cpu

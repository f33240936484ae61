// The instruction set that vector code runs with, of those that it was compiled for.
#pragma once

#include <string>
#include <vector>

namespace sheetsplat {

enum class InstructionSet { baseline, sse4, avx2, avx512, neon };
const char* to_string(InstructionSet set);

/// The best one that was compiled and that this processor runs, or the one that was chosen.
InstructionSet chosen_instruction_set();
/// All that were compiled and that this processor runs, the best one first.
std::vector<InstructionSet> usable_instruction_sets();

/// The chosen one in words: "AVX-512, 16 lanes".
std::string instruction_set();
/// The names of all usable ones, which choose_instruction_set takes.
std::vector<std::string> instruction_sets();
/// For tests: the set that is used from now on; an empty name: the best one. Throws InvalidInput for a name that
/// instruction_sets() does not hold.
void choose_instruction_set(const std::string& name);

} // namespace sheetsplat

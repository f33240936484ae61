// Which instruction set this processor runs. Highway's own run-time choice lives in its library, which is not
// distributed for static linking everywhere; its headers need none of it.
#include "base/instruction_set.hpp"

#include <algorithm>
#include <atomic>
#include <iterator>

#include "sheetsplat/error.hpp"

namespace sheetsplat {

namespace {

bool runs_here(InstructionSet set) {
    switch (set) {
    case InstructionSet::baseline:
        return true;
#if defined(__x86_64__) || defined(__i386__)
    // What Highway's targets of these names are compiled with (hwy/set_macros-inl.h).
    case InstructionSet::sse4:
        return __builtin_cpu_supports("sse4.2") != 0;
    case InstructionSet::avx2:
        return __builtin_cpu_supports("avx2") != 0 && __builtin_cpu_supports("fma") != 0 &&
               __builtin_cpu_supports("bmi") != 0 && __builtin_cpu_supports("bmi2") != 0;
    case InstructionSet::avx512:
        return runs_here(InstructionSet::avx2) && __builtin_cpu_supports("avx512f") != 0 &&
               __builtin_cpu_supports("avx512vl") != 0 && __builtin_cpu_supports("avx512dq") != 0 &&
               __builtin_cpu_supports("avx512bw") != 0 && __builtin_cpu_supports("avx512cd") != 0;
#else
    case InstructionSet::neon:
        return true; // compiled for it as a whole
#endif
    default:
        return false;
    }
}

/// Those that are compiled, the best one first.
constexpr InstructionSet compiled[] = {
#ifdef SHEETSPLAT_HAS_AVX512
    InstructionSet::avx512,
#endif
#ifdef SHEETSPLAT_HAS_AVX2
    InstructionSet::avx2,
#endif
#ifdef SHEETSPLAT_HAS_SSE4
    InstructionSet::sse4,
#endif
#ifdef SHEETSPLAT_HAS_NEON
    InstructionSet::neon,
#endif
#ifdef SHEETSPLAT_HAS_BASELINE
    InstructionSet::baseline,
#endif
};

std::atomic<int> forced{-1};

} // namespace

const char* to_string(InstructionSet set) {
    switch (set) {
    case InstructionSet::sse4:
        return "SSE4";
    case InstructionSet::avx2:
        return "AVX2";
    case InstructionSet::avx512:
        return "AVX-512";
    case InstructionSet::neon:
        return "NEON";
    default:
        return "baseline";
    }
}

std::vector<InstructionSet> usable_instruction_sets() {
    std::vector<InstructionSet> found;
    std::copy_if(std::begin(compiled), std::end(compiled), std::back_inserter(found), runs_here);
    if (found.empty()) {
        throw Unsupported(Complaint{"this processor cannot be used",
                                    std::string("none of the instruction sets of this build, the least of which is ") +
                                        to_string(*std::rbegin(compiled)),
                                    "a processor that has one", "build the package here"});
    }
    return found;
}

InstructionSet chosen_instruction_set() {
    static const InstructionSet found = usable_instruction_sets().front();
    const int set = forced.load(std::memory_order_relaxed);
    return set < 0 ? found : static_cast<InstructionSet>(set);
}

std::string instruction_set() {
    const InstructionSet set = chosen_instruction_set();
    const int lanes = set == InstructionSet::avx512     ? 16
                      : set == InstructionSet::avx2     ? 8
                      : set == InstructionSet::baseline ? 1
                                                        : 4;
    return std::string(to_string(set)) + ", " + std::to_string(lanes) + " lanes";
}

std::vector<std::string> instruction_sets() {
    std::vector<std::string> names;
    for (const InstructionSet set : usable_instruction_sets()) {
        names.emplace_back(to_string(set));
    }
    return names;
}

void choose_instruction_set(const std::string& name) {
    if (name.empty()) {
        forced.store(-1);
        return;
    }
    std::string known;
    for (const InstructionSet set : usable_instruction_sets()) {
        if (name == to_string(set)) {
            forced.store(static_cast<int>(set));
            return;
        }
        known += (known.empty() ? "" : ", ") + std::string(to_string(set));
    }
    throw InvalidInput(
        Complaint{"the instruction set cannot be chosen", "\"" + name + "\"", "one of " + known, "correct the name"});
}

} // namespace sheetsplat

// The loops over a tile of each number type and instruction set that is compiled.
#include "backend_cpu/tile_task.hpp"

namespace sheetsplat::backend_cpu {

template <class T>
const TileFunctions<T>* tile_functions(InstructionSet set) {
    switch (set) {
#ifdef SHEETSPLAT_HAS_BASELINE
    case InstructionSet::baseline:
        return tile_functions_of<T, InstructionSet::baseline>();
#endif
#ifdef SHEETSPLAT_HAS_SSE4
    case InstructionSet::sse4:
        return tile_functions_of<T, InstructionSet::sse4>();
#endif
#ifdef SHEETSPLAT_HAS_AVX2
    case InstructionSet::avx2:
        return tile_functions_of<T, InstructionSet::avx2>();
#endif
#ifdef SHEETSPLAT_HAS_AVX512
    case InstructionSet::avx512:
        return tile_functions_of<T, InstructionSet::avx512>();
#endif
#ifdef SHEETSPLAT_HAS_NEON
    case InstructionSet::neon:
        return tile_functions_of<T, InstructionSet::neon>();
#endif
    default:
        return nullptr;
    }
}

template const TileFunctions<float>* tile_functions<float>(InstructionSet set);
template const TileFunctions<double>* tile_functions<double>(InstructionSet set);

} // namespace sheetsplat::backend_cpu

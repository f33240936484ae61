// What tile_set.hpp includes once for each set, of which one counts.
#if HWY_TARGET == SHEETSPLAT_TILE_TARGET
#include "tile_functions-inl.hpp"

namespace sheetsplat::backend_cpu {

template <>
const TileFunctions<SHEETSPLAT_TILE_TYPE>*
tile_functions_of<SHEETSPLAT_TILE_TYPE, InstructionSet::SHEETSPLAT_TILE_SET>() {
    return HWY_NAMESPACE::functions<SHEETSPLAT_TILE_TYPE>();
}

} // namespace sheetsplat::backend_cpu
#endif

// What the loop over the tiles of one picture needs, from its plan.
#pragma once

#include "backend_cpu/cpu_renderer.hpp"
#include "backend_cpu/tile_task.hpp"

namespace sheetsplat::backend_cpu {

/// shading must outlive it.
template <class T>
LoopSetup<T> make_setup(const Job& job, const Shading<T>& shading);

extern template LoopSetup<float> make_setup<float>(const Job&, const Shading<float>&);
extern template LoopSetup<double> make_setup<double>(const Job&, const Shading<double>&);

} // namespace sheetsplat::backend_cpu

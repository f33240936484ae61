// What the loop over the tiles of one picture needs, from its plan.
#pragma once

#include "backend_cpu/cpu_renderer.hpp"
#include "backend_cpu/tile_task.hpp"

namespace sheetsplat::backend_cpu {

/// shading must outlive it.
template <class T>
LoopSetup<T> make_setup(const Job& job, const Shading<T>& shading);
/// Of fields whose colours others take, and which are plain sums of a lattice's kernels: they are summed where
/// something shows, which is in few points, in place of being splatted. setup.record: as it is in the end.
template <class T>
void sum_colors_at_points(const Job& job, LoopSetup<T>& setup, Shading<T>& shading);

extern template LoopSetup<float> make_setup<float>(const Job&, const Shading<float>&);
extern template LoopSetup<double> make_setup<double>(const Job&, const Shading<double>&);
extern template void sum_colors_at_points<float>(const Job&, LoopSetup<float>&, Shading<float>&);
extern template void sum_colors_at_points<double>(const Job&, LoopSetup<double>&, Shading<double>&);

} // namespace sheetsplat::backend_cpu

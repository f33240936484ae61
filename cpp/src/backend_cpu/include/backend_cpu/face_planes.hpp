// The faces of cuts that the pixels of a tile show, as planes in the number format of its sheets.
#pragma once

#include <cstddef>

#include "backend_cpu/tile.hpp"

namespace sheetsplat::backend_cpu {

struct Job;

/// Planes of TileShape::picture_elements() for each group.
constexpr std::size_t face_planes = 5;

/// Fills planes from `next` on and makes them the picture's.
template <class T>
void set_faces(const Job& job, const TileShape& shape, T* next, TilePicture<T>& picture);

extern template void set_faces<float>(const Job&, const TileShape&, float*, TilePicture<float>&);
extern template void set_faces<double>(const Job&, const TileShape&, double*, TilePicture<double>&);

} // namespace sheetsplat::backend_cpu

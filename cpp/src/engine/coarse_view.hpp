// The same view through larger pixels: a grid that is centred on the picture's and reaches a little beyond it.
#pragma once

#include "sheetsplat/camera.hpp"
#include "sheetsplat/scene.hpp"
#include "sheetsplat/types.hpp"

namespace sheetsplat {

/// Pixels of a view that are `larger` times as wide as those of the full picture; 1: the same grid.
Size coarse_size(Size full, int larger);
/// The camera that sees coarse_size(full_size, larger) pixels.
Camera coarse_camera(const Camera& full, Size full_size, int larger);
/// The scene that it sees: of a depth limit, the depths at the pixels nearest to the middles of the larger ones.
Scene coarse_scene(const Scene& full, Size full_size, int larger);

} // namespace sheetsplat

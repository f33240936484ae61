// Volumes of fewer samples, for stages with large pixels: where a pixel is wider than the distance of samples, a kernel
// that stands for a block of them shows the same at a fraction of the time.
#pragma once

#include <array>
#include <cstddef>
#include <functional>
#include <memory>
#include <vector>

#include "sheetsplat/scene.hpp"

namespace sheetsplat {

/// How many samples along i, j and k (powers of 2) a kernel of a level stands for; 1, 1, 1: the field itself.
using LevelBlock = std::array<std::size_t, 3>;

/// What stands for the fields of a scene where pixels are so wide.
struct Level {
    std::vector<LevelBlock> blocks{}; ///< of each field
    double fewer = 1.0;               ///< kernels of the fields, for each one of the level
    double slice_spacing = 0.0;       ///< the default of the level's fields, world units
};
/// The blocks that a pixel `pixel_world` wide spans. Scattered fields, BCC lattices and `whole` scenes stay themselves.
Level level_of(const Scene& scene, double pixel_world, bool whole = false);

/// Fields of blocks. Keeps them between pictures.
class FieldLevels {
  public:
    /// The fields of a level. Where memory does not suffice the fields themselves. Throws what `poll` throws.
    std::vector<std::shared_ptr<const Field>> of(const std::vector<std::shared_ptr<const Field>>& fields,
                                                 const Level& level, const std::function<void()>& poll);
    [[nodiscard]] bool made(const std::shared_ptr<const Field>& field) const;
    /// The scene's fields, and those that were made of them. Drops all others.
    std::vector<std::shared_ptr<const Field>> keep(const Scene& scene);

  private:
    struct Entry {
        std::shared_ptr<const Field> source;
        LevelBlock block;
        std::shared_ptr<const Field> field;
    };
    std::vector<Entry> entries_;
};

} // namespace sheetsplat

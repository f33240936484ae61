// How far shadows and ambient occlusion of a picture are from their definition: the exact products along lines, in
// float64 from the kernels, at points that pixels of the picture show. Source: conventions, section 10.
#pragma once

#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "light/blocks.hpp"
#include "light/lit_view.hpp"
#include "sheetsplat/image.hpp"
#include "sheetsplat/light_probe.hpp"
#include "sheetsplat/light_volume.hpp"

namespace sheetsplat {

class LightAtPoints;
class PointValues;

/// Looks at a few hundred pixels that show something, spread evenly over the picture, of a surface at a few thousand.
/// The same picture has the same errors, on any number of threads.
class LightErrorProbe {
  public:
    /// Whether that takes less time than a picture: of very many scattered kernels a grid would have to be made.
    [[nodiscard]] static bool is_cheap(const LitView& lit);
    /// Throws OutOfMemory, Cancelled.
    /// absorption: what the volumes were made from, where it is still there.
    LightErrors errors(const LitView& lit, const LightVolumes& volumes,
                       const std::shared_ptr<const LightVolume>& absorption);
    /// What a part of a whole says (Renderer::light_spots, Renderer::light_lines). Throws OutOfMemory, Cancelled.
    std::vector<LightSpot> spots(const LitView& lit, const std::vector<std::size_t>& numbers);
    LightLines lines(const LitView& lit, const std::vector<LightSpot>& spots, std::size_t part);

  private:
    [[nodiscard]] LightAtPoints light_at(const LitView& lit, const LightVolumes& volumes,
                                         const std::shared_ptr<const LightVolume>& absorption);
    struct Known {
        std::shared_ptr<const Field> field;
        std::shared_ptr<const PointValues> values;
    };
    std::vector<Known> known_; ///< of the fields of the last scene, unfiltered
    /// Of volumes that still exist.
    std::vector<std::pair<std::weak_ptr<const LightVolume>, std::unique_ptr<const LightBlocks>>> blocks_;
    std::pair<std::weak_ptr<const LightVolume>, std::unique_ptr<const ClearCells>> clear_;
};

/// Puts measured errors in the place of the plan's estimates.
void state_light_errors(const LightErrors& errors, RenderPlan& plan);

} // namespace sheetsplat

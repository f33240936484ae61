// How a scene is drawn whose fields have bases and ends (conventions, section 2): as sums of kernels alone. Lattices
// that show something at their boundary get their mirrored samples, a clip ends them, and values are counted from the
// bases.
#pragma once

#include <array>
#include <cstddef>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "facts/frame.hpp"
#include "sheetsplat/camera.hpp"
#include "sheetsplat/image.hpp"
#include "sheetsplat/renderer.hpp"
#include "sheetsplat/scene.hpp"

namespace sheetsplat {

/// The forms of lattices in which they are drawn, kept between pictures.
class CountedFields {
  public:
    /// The scene with Scene::counted. The scene itself, but for that, where no field has a base or an end.
    [[nodiscard]] Scene counted(const Scene& scene, const Camera& camera, Size size, const Outputs& outputs);
    /// The field of the scene that a drawn one stands for.
    [[nodiscard]] std::shared_ptr<const Field> source_of(const std::shared_ptr<const Field>& drawn) const;
    /// Drops what belongs to other fields; returns these and their forms.
    [[nodiscard]] std::vector<std::shared_ptr<const Field>>
    keep(const std::vector<std::shared_ptr<const Field>>& fields);

  private:
    struct Entry {
        std::weak_ptr<const Field> field;
        std::shared_ptr<const RegularField> mirrored;
        std::shared_ptr<const Field> endless;
        std::map<std::size_t, std::array<double, 2>> ranges; ///< of so many samples from the ends
        std::map<double, double> weights;                    ///< largest_weight, by what a filter gains
    };
    Entry& entry_of(const std::shared_ptr<const Field>& field);
    [[nodiscard]] std::string why_shown(const Scene& scene, const Camera& camera, Size size, const Outputs& outputs);

    std::vector<std::unique_ptr<Entry>> entries_;
};

/// Adds the bases to a picture's scalars, and makes an x-ray of an average. drawn: what CountedFields made of the scene
/// that the picture was asked of.
void add_bases(const Scene& drawn, const Scene& asked, const Camera& camera, Image& image);

} // namespace sheetsplat

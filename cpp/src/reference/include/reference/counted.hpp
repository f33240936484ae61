// A scene whose scalars are counted from the bases of its fields, and where these end. Source: conventions, section 2.
#pragma once

#include <vector>

#include "sheetsplat/scene.hpp"

namespace sheetsplat::reference {

/// What is drawn of a scene. Sums of kernels are counted from the bases, so that their digits are those of f - b; so
/// are its transfer functions, and values() are its iso values as a group sees them.
class CountedScene {
  public:
    explicit CountedScene(const Scene& scene);

    /// Lattices of groups whose fields end in different places are fields of boundary zero and base 0 here.
    [[nodiscard]] const Scene& scene() const { return scene_; }
    /// Where a field ends, as a region that is cut out; empty() where it goes on for ever.
    [[nodiscard]] const Clip& end_of_field(std::size_t field) const { return ends_[field]; }
    /// Where all fields of one of groups_drawn(scene()) end; in scalar modes fields end one by one, and groups nowhere.
    [[nodiscard]] const Clip& end_of_group(std::size_t group) const { return group_ends_[group]; }
    /// The iso values counted from the base of one of groups_drawn(scene()), which is the sum of its fields'.
    [[nodiscard]] const std::vector<IsoValue>& iso_values(std::size_t group) const { return iso_values_[group]; }
    /// g0 of one of scene().groups(), times the reference length.
    [[nodiscard]] double weakest_difference(const Group& group) const;

  private:
    Scene scene_;
    std::vector<Clip> ends_, group_ends_;
    std::vector<std::vector<IsoValue>> iso_values_;
};

} // namespace sheetsplat::reference

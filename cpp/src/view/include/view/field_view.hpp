// How the samples of a lattice look in one view.
#pragma once

#include <cstdint>
#include <optional>

#include "facts/frame.hpp"
#include "facts/lattice_section.hpp"
#include "sheetsplat/camera.hpp"
#include "sheetsplat/scene.hpp"

namespace sheetsplat {

/// All that there is to slice a lattice: the section that its kernels share, and where they are.
struct FieldView : LatticeSection {
    const RegularField* field = nullptr;
    Vec3 first_eye{0.0};                        ///< eye position of sample (0, 0, 0)
    Vec3 step_i{0.0}, step_j{0.0}, step_k{0.0}; ///< eye-space steps of the indices
    Vec3 odd_layer{0.0};                        ///< added for odd k (BCC)
    double slab_half = 0.0;                     ///< sampling slab: half a slice spacing, world units; point: 0
    double value_scale = 1.0;  ///< what a sample's value is multiplied by: gain / (C if lattice) / value unit
    double weight_scale = 1.0; ///< what a weight of 1 is multiplied by: gain

    /// The EWA filter in perspective widens each kernel by the depth of its centre: B without it. The section and what
    /// values are multiplied by are then those of the deepest kernels, and of none that is filtered.
    std::optional<ShapeRows> unfiltered;

    [[nodiscard]] Vec3 eye_position(std::size_t i, std::size_t j, std::size_t k) const;
};

/// value_unit: the amount of rho that the sheets call 1.
FieldView make_field_view(const RegularField& field, const Camera& camera, const Frame& frame, Sampling sampling,
                          double value_unit, Filter filter = Filter::none);

} // namespace sheetsplat

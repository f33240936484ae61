// The numbers of one view: pixels, slices, and how kernels of each field look from here.
// Source: IMAGE FORMATION sections 1 to 3; kernel cross-sections in factored form ([NM06] section 3.3, without any
// inverse of a covariance).
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <vector>

#include <glm/mat2x2.hpp>
#include <glm/vec2.hpp>

#include "sheetsplat/camera.hpp"
#include "sheetsplat/scene.hpp"

namespace sheetsplat {

/// Pixels and slices of a view. Slices are counted from 0 here: slice m lies at depth first_depth + m * slice_spacing.
struct Frame {
    Projection projection = Projection::orthographic;
    Size size{};
    double pixel = 1.0;         ///< width of a pixel: world units (orthographic), per unit of depth (perspective)
    double slice_spacing = 1.0; ///< world units
    double reference_length = 1.0;
    double near = 0.0;            ///< perspective: slices at depth <= near do not exist
    double first_depth = 0.0;     ///< depth of slice 0
    std::int64_t first_slice = 0; ///< n of slice 0 in t_n = t_c + (n + 1/2) ds
    std::int64_t slices = 0;
    bool cut_by_near = false; ///< slices are missing in front because of `near`

    [[nodiscard]] double depth_of(std::int64_t slice) const {
        return first_depth + static_cast<double>(slice) * slice_spacing;
    }
    /// Width of a pixel in world units where it is smallest and largest over all slices.
    [[nodiscard]] double smallest_pixel() const;
    [[nodiscard]] double largest_pixel() const;
};

/// How far a field reaches along a direction of unit length: Field::reach_along, or a faster way to the same numbers.
using Reach = std::function<std::array<double, 2>(const Field& field, const Vec3& from, const Vec3& direction)>;

/// Throws InvalidInput for sizes below 1 and for more than 10^7 slices.
Frame make_frame(const Scene& scene, const Camera& camera, Size size, const Reach& reach = {});

/// How the kernels of one regular field look in a view. All kernels share one shape, so this is all there is to slice
/// them: with B = V M (columns: semi-axes in eye space), half_depth h = |B^T e_z|, n = B^T e_z / h and u, v completing
/// n to a basis, a point at depth t of a kernel centred at depth t_k has height s = (t_k - t) / h along n, and the
/// plane's point (x, y) relative to the centre is A (a, b) + s (B n)_xy with A = [B u, B v]_xy.
struct FieldView {
    const RegularField* field = nullptr;
    Vec3 first_eye{0.0};                        ///< eye position of sample (0, 0, 0)
    Vec3 step_i{0.0}, step_j{0.0}, step_k{0.0}; ///< eye-space steps of the indices
    Vec3 odd_layer{0.0};                        ///< added for odd k (BCC)
    double half_depth = 1.0;                    ///< h, world units
    glm::dmat2 to_unit{1.0};                    ///< A^-1: eye xy -> unit-sphere plane coordinates
    glm::dvec2 shear{0.0};                      ///< A^-1 (B n)_xy: shift of the cross-section per unit of s
    bool sheared = false;                       ///< the shear matters (unequal spacing, seen askew)
    double slab_half = 0.0;                     ///< sampling slab: half a slice spacing, world units; point: 0
    double extent_x = 1.0;                      ///< half the support's extent along eye x and y, world units
    double extent_y = 1.0;
    double value_scale = 1.0;      ///< what a sample's value is multiplied by: gain / (C if lattice) / value unit
    double weight_scale = 1.0;     ///< what a weight of 1 is multiplied by: gain
    std::int64_t longest_span = 1; ///< most slices that one kernel can meet

    [[nodiscard]] Vec3 eye_position(std::size_t i, std::size_t j, std::size_t k) const;
};

/// value_unit: the amount of rho that the sheets call 1.
FieldView make_field_view(const RegularField& field, const Camera& camera, const Frame& frame, Sampling sampling,
                          double value_unit);

} // namespace sheetsplat

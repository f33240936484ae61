// The numbers of one view: its pixels and its slices. Source: conventions, sections 1 to 3.
#pragma once

#include <array>
#include <cstdint>
#include <functional>

#include "sheetsplat/camera.hpp"
#include "sheetsplat/scene.hpp"

namespace sheetsplat {

/// Pixels and slices of a view. Slices are counted from 0 here: slice m lies at depth first_depth + m * slice_spacing.
struct Frame {
    Projection projection = Projection::orthographic;
    Size size{};
    double pixel = 1.0;         ///< width of a pixel: world units (orthographic), per unit of depth (perspective)
    double axis_x = 0.0;        ///< where the optical axis meets the picture: pixels from its left edge
    double axis_y = 0.0;        ///< ... and from its upper one
    double slice_spacing = 1.0; ///< world units
    double reference_length = 1.0;
    double near = 0.0;            ///< perspective: slices at depth <= near do not exist
    double first_depth = 0.0;     ///< depth of slice 0
    std::int64_t first_slice = 0; ///< n of slice 0 in t_n = t_c + (n + 1/2) ds
    std::int64_t slices = 0;
    std::int64_t first_met = 0; ///< the first slice whose slab meets a support
    bool cut_by_near = false;   ///< slices whose slabs meet a support are missing in front because of `near`

    [[nodiscard]] double depth_of(std::int64_t slice) const {
        return first_depth + static_cast<double>(slice) * slice_spacing;
    }
    /// Width of a pixel in world units where it is smallest and largest over all slices.
    [[nodiscard]] double smallest_pixel() const;
    [[nodiscard]] double largest_pixel() const;
    /// Eye x and y of what the pixel of a column and a row looks at: world units (orthographic), per unit of depth
    /// (perspective).
    [[nodiscard]] double eye_x(double column) const { return (column + 0.5 - axis_x) * pixel; }
    [[nodiscard]] double eye_y(double row) const { return (axis_y - row - 0.5) * pixel; }
    /// How far the ray that moves sideways most does so per unit of depth; 0 in orthographic.
    [[nodiscard]] double largest_slope() const;
    /// Largest s = 1 / cos(theta) over the picture (conventions, section 4).
    [[nodiscard]] double largest_slant() const;
};

/// World-aligned box of the supports of all fields; empty where there are no kernels.
Box supports_world(const Scene& scene);

/// By how much the EWA filter widens kernels, squares added (section 10): a Gaussian of half a pixel's and half a slice
/// distance's standard deviation, up to where its support ends. World units.
struct FilterWidth {
    double across;
    double along; ///< the view
};
/// depth: of the kernel's centre.
FilterWidth filter_width(const Frame& frame, const Kernel& kernel, double depth);

/// How far a field reaches along a direction of unit length: Field::reach_along, or a faster way to the same numbers.
using Reach = std::function<std::array<double, 2>(const Field& field, const Vec3& from, const Vec3& direction)>;

/// Throws InvalidInput for sizes below 1 and for more than 10^7 slices.
Frame make_frame(const Scene& scene, const Camera& camera, Size size, const Reach& reach = {});

} // namespace sheetsplat

// Gradients of rho between sheets, and Phong's light. Source: conventions, section 5.
#pragma once

#include <cstddef>
#include <vector>

#include "reference/counted.hpp"
#include "reference/screen.hpp"
#include "reference/surroundings.hpp"
#include "sheetsplat/camera.hpp"
#include "sheetsplat/scene.hpp"

namespace sheetsplat::reference {

/// Eye-space gradient of rho per `length` at a pixel at `depth`. rho(slice, column, row): near them, slices -1, 0
/// and 1.
template <class Rho>
Vec3 gradient_eye(const Screen& screen, const Rho& rho, double depth, double spacing, double length, int column,
                  int row) {
    // Rows count downwards, y upwards.
    const double over_columns = rho(0, column + 1, row) - rho(0, column - 1, row);
    const double over_rows = rho(0, column, row - 1) - rho(0, column, row + 1);
    const double over_depth = (rho(1, column, row) - rho(-1, column, row)) / (2.0 * spacing / length);
    // Where a sheet is blank its plane may be at or behind the eye, where pixels have no width.
    const double two_pixels = 2.0 * screen.pixel_width(depth) / length;
    const double dx = over_columns != 0.0 ? over_columns / two_pixels : 0.0;
    const double dy = over_rows != 0.0 ? over_rows / two_pixels : 0.0;
    return {dx, dy, screen.slope_x(column) * dx + screen.slope_y(row) * dy - over_depth};
}

/// A point that is shaded, and what may shadow it.
struct Lighting {
    Vec3 to_viewer{0.0, 0.0, 1.0};              ///< V
    Vec3 point{0.0};                            ///< eye space
    const Surroundings* surroundings = nullptr; ///< null without shadows and ambient occlusion
    double nudge = 0.0;                         ///< of the surroundings' rho, as section 9 has it
    std::size_t group = 0;                      ///< whose colour is shaded
    Vec3 face{0.0};                             ///< outward normal of a cut, unit length
    double on_face = 0.0;                       ///< what it counts beside that of the gradient
};

/// Lights and material of a scene as one camera sees them. Gradients are per reference length, so that they stay in
/// double's range in any unit of length.
class Shader {
  public:
    Shader(const CountedScene& counted, const Camera& camera);
    /// weakest_differences: g_0 of each group, times the reference length.
    Shader(const Scene& scene, const Camera& camera, std::vector<double> weakest_differences);

    /// True where the scene has lights; without them a colour is shown as it is.
    [[nodiscard]] bool lit() const { return !lights_.empty(); }
    /// N from the gradient of a group's rho.
    [[nodiscard]] Vec3 normal(const Vec3& gradient, std::size_t group = 0) const;
    /// Towards a light: L, unit length, eye space.
    [[nodiscard]] const Vec3& direction(std::size_t light) const { return lights_[light].direction; }
    /// What a light adds to a colour where nothing is in its way.
    [[nodiscard]] Vec3 added_by(std::size_t light, const Vec3& color, const Vec3& outward, const Vec3& to_viewer) const;
    /// The lit colour.
    [[nodiscard]] Vec3 shade(const Vec3& color, const Vec3& gradient, const Lighting& lighting) const;

  private:
    struct DirectedLight {
        Vec3 direction; // L, unit length, eye space
        Vec3 color;
    };
    std::vector<DirectedLight> lights_;
    Material material_;
    std::vector<double> weakest_gradients_; // g_0 of each group, times the reference length
    bool shadows_, occlusion_;
};

} // namespace sheetsplat::reference

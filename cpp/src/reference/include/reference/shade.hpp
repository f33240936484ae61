// Gradients of rho between sheets, and Phong's light. Source: conventions, section 5.
#pragma once

#include <cstddef>
#include <vector>

#include "reference/counted.hpp"
#include "reference/screen.hpp"
#include "reference/sums.hpp"
#include "reference/surroundings.hpp"
#include "sheetsplat/camera.hpp"
#include "sheetsplat/scene.hpp"

namespace sheetsplat::reference {

/// Eye-space gradient of rho per `length` at a pixel of the sheet `here` at `depth`, between its neighbours `before`
/// and `after`.
Vec3 gradient_eye(const Screen& screen, const Sheet& before, const Sheet& here, const Sheet& after, double depth,
                  double spacing, double length, int column, int row);

/// A point that is shaded, and what may shadow it.
struct Lighting {
    Vec3 to_viewer{0.0, 0.0, 1.0};              ///< V
    Vec3 point{0.0};                            ///< eye space
    const Surroundings* surroundings = nullptr; ///< null without shadows and ambient occlusion
    double nudge = 0.0;                         ///< of the surroundings' rho, as section 9 has it
    std::size_t group = 0;                      ///< whose colour is shaded
};

/// Lights and material of a scene as one camera sees them. Gradients are per reference length, so that they stay in
/// double's range in any unit of length.
class Shader {
  public:
    Shader(const CountedScene& counted, const Camera& camera);

    /// True where the scene has lights; without them a colour is shown as it is.
    [[nodiscard]] bool lit() const { return !lights_.empty(); }
    /// N from the gradient of a group's rho.
    [[nodiscard]] Vec3 normal(const Vec3& gradient, std::size_t group = 0) const;
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

// Settings that a renderer chose for max_error or max_seconds, and what they were chosen for.
#pragma once

#include <string>
#include <vector>

#include "settings_search.hpp"
#include "sheetsplat/camera.hpp"
#include "sheetsplat/image.hpp"
#include "sheetsplat/renderer.hpp"
#include "sheetsplat/scene.hpp"

namespace sheetsplat {

constexpr double cosine_of_10_degrees = 0.98480775301220806;

/// Kept for following pictures of the same scene from nearly the same place.
struct Chosen {
    Scene scene; ///< as the caller has it
    Camera camera;
    Size size{};
    double pace = 1.0; ///< that times were expected with
    Choice choice{};
    double of_light = 0.0; ///< what the choice's error has from light in volumes
    bool refined = false;  ///< refined after a check through other pixels
    Backend backend = Backend::cpu;

    /// True where a view has the same scene and size, and differs by less than an eighth of its height, its width and
    /// an angle. The depths of a depth limit, which change with the camera, may be others.
    [[nodiscard]] bool serves(const Scene& other, const Camera& from, Size other_size,
                              double least_cosine = cosine_of_10_degrees) const;
    /// A scene that is served, and the caller's options, with what was chosen.
    [[nodiscard]] Scene scene_to_draw(const Scene& asked) const;
    [[nodiscard]] RendererOptions options(const RendererOptions& options) const;
    /// The choice for a picture whose errors of light the budget has, as measured in the picture.
    [[nodiscard]] Choice choice_for(const std::vector<ErrorShare>& budget, const RendererOptions& options) const;
    /// The row of the plan.
    [[nodiscard]] Effect plan_row(const Choice& chosen, const RendererOptions& options) const;
    /// Adds that row, and the reason to each effect that was chosen. Errors of the plan's effects are distances from
    /// the float64 reference at the same slices; the row has none, its sentence names the distance that was chosen for.
    void describe(RenderPlan& plan, const RendererOptions& options) const;
};

/// Throws InvalidInput for numbers that no picture can keep.
void check_goals(const RendererOptions& options);

} // namespace sheetsplat

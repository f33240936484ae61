// The view that light is made for, and what draws kernels onto grids for it: the layer itself draws nothing.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <limits>

#include "facts/frame.hpp"
#include "plan/make_plan.hpp"
#include "sheetsplat/camera.hpp"
#include "sheetsplat/light_volume.hpp"
#include "sheetsplat/renderer.hpp"
#include "sheetsplat/scene.hpp"

namespace sheetsplat {

/// Refers to a picture's parts, which must stay while it is used.
struct LitView {
    const Scene& scene; ///< as it is drawn
    const Camera& camera;
    Size size{};
    const Frame& frame;
    const DrawPlan& plan;
    const Progress& progress;
    int threads = 1;
};

/// A box of a grid's elements and the slices in it.
struct LightCut {
    std::array<int, 2> first{0, 0};
    Size size{};
    std::int64_t first_slice = 0, slices = 0; ///< of whole planes
    /// Points along z, lower <= z < upper, that count.
    double lower = -std::numeric_limits<double>::infinity(), upper = std::numeric_limits<double>::infinity();

    [[nodiscard]] bool empty() const { return size.width < 1 || size.height < 1 || slices < 1; }
    [[nodiscard]] std::size_t planes(const LightGrid& grid) const {
        return static_cast<std::size_t>((slices + grid.every - 1) / grid.every);
    }
    [[nodiscard]] std::size_t elements(const LightGrid& grid) const {
        return planes(grid) * static_cast<std::size_t>(size.width) * static_cast<std::size_t>(size.height);
    }
};

/// Draws what is in a cut of a grid into its elements, which are 0: absorption, -ln(1 - alpha) of a slice distance of
/// the picture; or rho of a group of fields over DrawPlan::value_unit.
using FillLight = std::function<void(const LightGrid& grid, const LightCut& cut, const Group* group, float* values)>;

} // namespace sheetsplat

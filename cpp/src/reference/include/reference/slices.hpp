// Which slices there are. Source: conventions, section 3.
#pragma once

#include <cstdint>

#include "reference/screen.hpp"
#include "sheetsplat/camera.hpp"
#include "sheetsplat/scene.hpp"

namespace sheetsplat::reference {

/// Planes of constant depth t_n = anchor + (n + 1/2) spacing, n = first ... first + count - 1.
struct Slices {
    double anchor = 0.0;  ///< t_c, depth of the centre of the box of all kernel centres
    double spacing = 1.0; ///< world units
    std::int64_t first = 0;
    std::int64_t count = 0;
    bool cut_by_near = false; ///< the near plane removes the slices before the first one

    [[nodiscard]] std::int64_t last() const { return first + count - 1; }
    [[nodiscard]] bool exists(std::int64_t n) const { return n >= first && n <= last(); }
    [[nodiscard]] double depth(std::int64_t n) const { return anchor + (static_cast<double>(n) + 0.5) * spacing; }
    [[nodiscard]] double front(std::int64_t n) const { return anchor + static_cast<double>(n) * spacing; }
    [[nodiscard]] double back(std::int64_t n) const { return anchor + (static_cast<double>(n) + 1.0) * spacing; }
};

/// A picture of more slices than this is refused.
constexpr std::int64_t most_slices = 10'000'000;

/// radius_factor multiplies the semi-axes of every support. The EWA filter, where the scene has it, needs to know the
/// pixels. Throws InvalidInput for more than most_slices.
Slices find_slices(const Scene& scene, const Camera& camera, const Screen& screen, double radius_factor);

} // namespace sheetsplat::reference

// What the splat pass costs at least on a device.
#pragma once

#include <cstddef>

namespace sheetsplat::lab {

/// Seconds by the clock and of all processors of this process.
struct Seconds {
    double wall = 0.0;
    double cpu = 0.0;
};

/// The time that OpenGL takes to blend `kernels` point sprites of `diameter_px` pixels, spread over width x height,
/// into `targets` (1 to 4) float32 targets, and nothing else; the median of `repeats` draws. Throws DeviceUnavailable,
/// InvalidInput.
Seconds fill_test(std::size_t kernels, double diameter_px, int width, int height, int targets = 1, int repeats = 5);

} // namespace sheetsplat::lab

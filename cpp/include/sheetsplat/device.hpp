// The machines that pictures can be made on.
#pragma once

#include <cstddef>
#include <string>
#include <vector>

namespace sheetsplat {

/// One backend or one way to an OpenGL context, tried here.
struct DeviceReport {
    std::string backend;  ///< "reference", "cpu" or "gl"
    std::string platform; ///< "" or "egl" | "surfaceless" | "osmesa"
    bool available = false;
    std::string description;              ///< renderer and version where available, else why not and what to do
    std::vector<std::string> extensions;  ///< of those that are used
    std::vector<std::string> workarounds; ///< names of those in force
};

/// Every backend and context that could be made here, and why the others could not. Never throws DeviceUnavailable.
std::vector<DeviceReport> devices();

/// Seconds by the clock and of all processors of this process.
struct Seconds {
    double wall = 0.0;
    double cpu = 0.0;
};

/// What a picture is measured against: the time that backend gl takes to blend `kernels` point sprites of `diameter_px`
/// pixels, spread over width x height, into `targets` (1 to 4) float32 targets, and nothing else; the median of
/// `repeats` draws. Throws DeviceUnavailable, InvalidInput.
Seconds fill_test(std::size_t kernels, double diameter_px, int width, int height, int targets = 1, int repeats = 5);

} // namespace sheetsplat

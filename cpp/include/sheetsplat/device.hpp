// The devices of the backends on this machine.
#pragma once

#include <string>
#include <vector>

namespace sheetsplat {

/// One backend, or one attempt to make an OpenGL context.
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

} // namespace sheetsplat

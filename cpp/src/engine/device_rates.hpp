// What a device of OpenGL is worth beside the processor: measured once a driver, and kept in the user's cache.
#pragma once

#include <optional>

#include "base/capabilities.hpp"

namespace sheetsplat {

/// Draws a small volume and a few thousand spheres by raster passes, by compute programs and on the processor. A path
/// that fails, or whose pictures differ from the processor's by more than section 9 of the conventions allows, counts
/// as infinitely slow. Kept in the process, and in device-rates.txt in the folder sheetsplat of XDG_CACHE_HOME, or of
/// ~/.cache; a file that cannot be read or written, is no file or is larger than 1 MiB is passed over.
DeviceRates measured_rates(const Capabilities& capabilities, std::optional<int> device);

} // namespace sheetsplat

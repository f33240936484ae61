// What a device can do. A plain struct: filled by gl, read by plan and backend_gl, so that neither of those two needs a
// context.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

namespace sheetsplat {

/// Seconds of small pictures on a device of OpenGL and on the processor beside it (engine/device_rates.hpp).
struct DeviceRates {
    enum Way : std::uint8_t { raster, compute, processor };
    static constexpr std::size_t ways = 3;

    bool known = false;
    std::array<double, ways> lattice{}, scattered{}; ///< infinite: it failed
    [[nodiscard]] const std::array<double, ways>& of(bool has_scattered) const {
        return has_scattered ? scattered : lattice;
    }
};

struct Capabilities {
    std::string platform; ///< egl | surfaceless | osmesa
    std::string vendor;   ///< GL_VENDOR
    std::string renderer; ///< GL_RENDERER
    std::string version;  ///< GL_VERSION
    int version_major = 3;
    int version_minor = 3;
    bool software = false;        ///< llvmpipe, softpipe, swrast
    bool depth_bounds = false;    ///< GL_EXT_depth_bounds_test
    bool texture_barrier = false; ///< a texel may be read by the fragment that writes it
    bool debug_output = false;    ///< KHR_debug
    bool float32_blend = true;    ///< RGBA32F can be a blended colour target
    bool float16_blend_rounds =
        true; ///< sums in RGBA16F are rounded to nearest; false: cut off, so that long sums come out dark
    bool points_reach_in =
        false; ///< a point whose centre lies outside the viewport is drawn where its square reaches in
    float max_point_size = 1.0F; ///< pixels, as measured
    int max_texture_size = 1024;
    int max_viewport = 1024;
    int subpixel_bits = 4;               ///< of positions in the rasteriser
    int max_texture_units = 16;          ///< of the fragment stage
    int max_volume_size = 256;           ///< of a 3D texture, along each axis
    int most_turns = 0;                  ///< that all loops of a compute program take together; 0: no limit
    int compute_memory = 0;              ///< bytes that a work group shares; 0: no compute programs
    int max_buffer_texels = 65536;       ///< of a buffer texture
    DeviceRates rates{};                 ///< where they were asked for
    std::vector<std::string> extensions; ///< of those that are used
    std::vector<std::string>
        workarounds; ///< names of the work-arounds in force (gl/capabilities.cpp tells what each is for)

    [[nodiscard]] bool at_least(int major, int minor) const {
        return version_major > major || (version_major == major && version_minor >= minor);
    }
};

} // namespace sheetsplat

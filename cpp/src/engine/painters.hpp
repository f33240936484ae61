// What the engine asks of the devices of backends, and the register of those that there are.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "base/capabilities.hpp"
#include "draw.hpp"
#include "sheetsplat/device.hpp"

namespace sheetsplat {

/// The device of one backend, of one renderer.
class Painter {
  public:
    Painter() = default;
    virtual ~Painter() = default;
    Painter(const Painter&) = delete;
    Painter& operator=(const Painter&) = delete;

    /// Opens the device, where it is not open yet. Throws DeviceUnavailable.
    virtual void open() {}
    /// Of the open device; null where plans need none.
    [[nodiscard]] virtual const Capabilities* capabilities() const { return nullptr; }
    /// Measures what the open device is worth beside others, for plans that choose by it.
    virtual void measure() {}
    /// The device in words, where the plan does not name it. threads: RendererOptions::threads.
    [[nodiscard]] virtual std::string description(int /*threads*/) const { return {}; }
    /// Fills the picture, and its stats: kernels_drawn, bytes_view and bytes_device (not of a backend that defines
    /// pictures, which needs no `indexed`), seconds_draw. doubts: of each pixel as backend_gl::Job has them; none: of
    /// no pixel.
    virtual void draw(const Request& request, const Prepared& prepared, const Indexed& indexed, Image& image,
                      std::vector<float>& doubts) = 0;
};

/// What painters are made with.
struct Devices {
    std::optional<int> number;           ///< RendererOptions::device
    backend_cpu::CpuRenderer& processor; ///< that light volumes are made with, too
};

// The functions of each backend, in painter_X.cpp: make_X_painter; survey_X, what there is of it on this machine.
#define SHEETSPLAT_DECLARE_PAINTER(name, ...)                                                                          \
    std::unique_ptr<Painter> make_##name##_painter(const Devices& devices);                                            \
    std::vector<DeviceReport> survey_##name();
SHEETSPLAT_BACKENDS(SHEETSPLAT_DECLARE_PAINTER)
#undef SHEETSPLAT_DECLARE_PAINTER

std::unique_ptr<Painter> make_painter(Backend backend, const Devices& devices);

/// Threads that the processor draws with. asked: RendererOptions::threads.
int thread_count(int asked);
/// What backend cpu draws with, in words: its instruction set and threads.
std::string describe_cpu(int threads);

} // namespace sheetsplat

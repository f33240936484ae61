// One function for each platform that makes contexts, and what they share.
#pragma once

#include <array>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "gl/context.hpp"

namespace sheetsplat::gl {

/// A context of one platform, while it is set up.
class NativeContext : public Context {
  public:
    /// The address of a GL function; asked for with the context current.
    virtual GLADapiproc address(const char* name) = 0;
    /// Loads the functions, fills the capabilities and starts to keep debug messages. Throws Error, where it is no
    /// OpenGL 3.3.
    void set_up(const std::string& platform, bool debug);

  protected:
    NativeContext() = default;
    /// At the end of the set-up, with the context current: leaves in it what tells it from other contexts.
    virtual void mark() {}
    /// For destructors: releases the context if it is current on this thread.
    void leave_current() noexcept;
};

/// The result of one attempt to make a context.
struct Made {
    std::unique_ptr<NativeContext> context; ///< null where the attempt failed
    std::string story;                      ///< what was tried, step by step, for messages

    /// Sets a new context up and keeps it. Where that fails, the context stays null and the story says why.
    void finish(std::unique_ptr<NativeContext> fresh, const std::string& platform, bool debug);
};

/// Versions of OpenGL that are asked for, the best one first.
constexpr std::array<std::array<int, 2>, 4> wanted_versions = {{{4, 5}, {4, 3}, {4, 1}, {3, 3}}};

/// One entry of the EGL device list.
struct EglDevice {
    std::string name;      ///< extensions or file that tell which it is
    bool software = false; ///< EGL_MESA_device_software
};

/// The EGL devices in the driver's order; empty, with the reason in `story`, where there is no list.
std::vector<EglDevice> egl_devices(std::string& story);
/// A context on the device with that index.
Made make_on_egl_device(std::size_t index, bool debug);
Made make_egl_surfaceless(bool debug);
Made make_osmesa(bool debug);

/// Reads the context's capabilities, measures those that the driver does not report, applies SHEETSPLAT_GL_DISABLE and
/// lists the work-arounds. The context must be current and in its initial state, and stays so. Throws InvalidInput for
/// unknown names in SHEETSPLAT_GL_DISABLE.
Capabilities read_capabilities(const Api& gl, const std::string& platform);

/// Takes all pending errors: their names, and whether GL_OUT_OF_MEMORY was among them.
struct GlErrors {
    std::string names;
    bool out_of_memory = false;
};
GlErrors take_errors(const Api& gl);

} // namespace sheetsplat::gl

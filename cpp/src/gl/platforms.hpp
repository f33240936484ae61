// The ways to a context, one function each, and what they share.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "gl/context.hpp"

namespace sheetsplat::gl {

/// A context of some platform, between the driver's call that made it and its use.
class NativeContext : public Context {
  public:
    /// The address of a GL function; asked for with the context current.
    virtual GLADapiproc address(const char* name) = 0;
    /// Loads the functions, fills the capabilities and starts to keep debug messages. Throws Error, where it is no
    /// OpenGL 3.3.
    void set_up(const std::string& platform, bool debug);

  protected:
    NativeContext() = default;
    /// For destructors: a context that is destroyed while it is current on this thread stops being so.
    void leave_current() noexcept;
};

/// What came of one try; the story tells its steps whether it succeeded or not.
struct Made {
    std::unique_ptr<NativeContext> context;
    std::string story;
};

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

/// Reads what the context can do, measures what the driver does not tell, applies SHEETSPLAT_GL_DISABLE and names the
/// work-arounds. The context must be current and in its first state, which is kept. Throws InvalidInput for names in
/// SHEETSPLAT_GL_DISABLE that are none.
Capabilities read_capabilities(const Api& gl, const std::string& platform);

/// Takes all pending errors: their names, and whether GL_OUT_OF_MEMORY was among them.
struct GlErrors {
    std::string names;
    bool out_of_memory = false;
};
GlErrors take_errors(const Api& gl);

} // namespace sheetsplat::gl

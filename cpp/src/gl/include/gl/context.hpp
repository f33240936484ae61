// OpenGL contexts without a display: on an EGL device, on surfaceless EGL, or by OSMesa. Their libraries are opened at
// run time (dlopen).
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <glad/gl.h>

#include "base/capabilities.hpp"
#include "sheetsplat/error.hpp"

namespace sheetsplat::gl {

/// The functions of one context: gl.Clear(...), gl.DrawArrays(...).
using Api = GladGLContext;

struct ContextOptions {
    std::string platform = "auto"; ///< auto | egl | surfaceless | osmesa; auto: SHEETSPLAT_GL if set
    std::optional<int>
        egl_device{};   ///< index into the EGL devices; else SHEETSPLAT_EGL_DEVICE if set; else the first that works
    bool debug = false; ///< a debug context whose errors are kept: take_debug_errors(). SHEETSPLAT_GL_DEBUG=1 sets it
};

/// One attempt to make a context.
struct Attempt {
    std::string platform;
    bool succeeded = false;
    std::string story;         ///< what happened, step by step, and what could be done about it
    Capabilities capabilities; ///< where it succeeded
};

/// A context does not exist any more: other code in the process ended the EGL display that it was made on, as VTK does
/// when it looks for devices and when it closes a window. Nothing was drawn; another context can be made.
class ContextLost : public Error {
  public:
    using Error::Error;
};

/// An OpenGL core context of version 3.3 or later. One thread at a time.
class Context {
  public:
    /// Tries each platform in order. Throws DeviceUnavailable, which lists every attempt and what to do; InvalidInput
    /// for unknown names. On return the context is not current.
    static std::unique_ptr<Context> create(const ContextOptions& options = {});
    /// Tries every platform, and of egl every device, and reports; never throws.
    static std::vector<Attempt> survey();

    virtual ~Context() = default;
    Context(const Context&) = delete;
    Context& operator=(const Context&) = delete;

    [[nodiscard]] const Api& api() const { return api_; }
    [[nodiscard]] const Capabilities& capabilities() const { return capabilities_; }
    /// Debug messages of type error (or high severity) since the last call; empty without `debug`.
    [[nodiscard]] std::vector<std::string> take_debug_errors();
    /// After ContextLost: the objects went with their context, and their destructors leave OpenGL alone from now on.
    void forget_objects() noexcept;

  protected:
    Context() = default;
    friend class Current;
    virtual void make_current() = 0; ///< throws ContextLost, and Error where the driver refuses
    virtual void release() noexcept = 0;

    Api api_{};
    Capabilities capabilities_;
    std::vector<std::string> debug_errors_;
};

/// While it lives, the context is current on this thread; what was current before is current again afterwards (contexts
/// of this layer, and EGL contexts of others). The context must outlive it.
class Current {
  public:
    /// Throws ContextLost, and Error where the driver refuses.
    explicit Current(Context& context);
    ~Current();
    Current(const Current&) = delete;
    Current& operator=(const Current&) = delete;

  private:
    Context& context_;
    void* previous_ = nullptr;
};

/// Throws OutOfMemory where a limit on the address space of this process leaves less than `bytes` for `what` and what a
/// driver takes by itself while it draws: drivers that draw on the processor end the process where they find less.
void require_room(std::uint64_t bytes, const std::string& what);

/// Throws Error (OutOfMemory for GL_OUT_OF_MEMORY) with the names of the pending GL errors and `where`, if there are
/// any.
void check_errors(const Api& gl, const char* where);

/// What a work-around of Capabilities::workarounds is for, in a sentence; "" for a name that is none.
std::string workaround_purpose(const std::string& name);

} // namespace sheetsplat::gl

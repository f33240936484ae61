#include "gl/context.hpp"

#include <algorithm>
#include <array>
#include <atomic>
#include <charconv>
#include <numeric>
#include <utility>

#include <sys/types.h>
#include <unistd.h>

#include "base/checks.hpp"
#include "base/memory.hpp"
#include "library.hpp"
#include "platforms.hpp"
#include "sheetsplat/error.hpp"

namespace sheetsplat::gl {
namespace {

thread_local Context* current_here = nullptr;

constexpr std::size_t most_debug_errors = 100;

GLADapiproc address_of(void* context, const char* name) { return static_cast<NativeContext*>(context)->address(name); }

void GLAD_API_PTR on_debug_message(GLenum, GLenum type, GLuint, GLenum severity, GLsizei length, const GLchar* message,
                                   const void* user) {
    const bool matters = type == GL_DEBUG_TYPE_ERROR || severity == GL_DEBUG_SEVERITY_HIGH;
    if (!matters || type == GL_DEBUG_TYPE_PERFORMANCE || message == nullptr) {
        return;
    }
    auto& errors = *static_cast<std::vector<std::string>*>(const_cast<void*>(user));
    // Bounded, so that an error in a loop cannot fill the memory.
    if (errors.size() < most_debug_errors) {
        errors.emplace_back(length > 0 ? std::string(message, static_cast<std::size_t>(length)) : std::string(message));
    }
}

constexpr const char* platform_names = "auto, egl, surfaceless or osmesa";

std::string chosen_platform(const ContextOptions& options) {
    std::string platform = options.platform;
    std::string place = "ContextOptions::platform";
    if (platform == "auto") {
        const std::string variable = environment("SHEETSPLAT_GL");
        if (!variable.empty()) {
            platform = variable;
            place = "SHEETSPLAT_GL";
        }
    }
    if (platform != "auto" && platform != "egl" && platform != "surfaceless" && platform != "osmesa") {
        throw InvalidInput(Complaint{"no OpenGL platform has this name", place + " = \"" + platform + "\"",
                                     platform_names, "choose one of these"});
    }
    return platform;
}

std::optional<int> chosen_device(const ContextOptions& options, const std::string& platform) {
    const bool by_device = platform == "auto" || platform == "egl";
    if (options.egl_device.has_value() && !by_device) {
        throw InvalidInput(Complaint{"an EGL device cannot be chosen on this platform",
                                     "device " + std::to_string(*options.egl_device) + ", platform " + platform,
                                     "platform auto or egl together with a device",
                                     "leave out " + option_ref("device") + ", or unset SHEETSPLAT_GL", "device"});
    }
    const std::string variable = environment("SHEETSPLAT_EGL_DEVICE");
    if (options.egl_device.has_value() || variable.empty() || !by_device) {
        return options.egl_device;
    }
    int number = 0;
    const char* end = variable.data() + variable.size();
    const auto [rest, error] = std::from_chars(variable.data(), end, number);
    if (error != std::errc() || rest != end || number < 0) {
        throw InvalidInput(Complaint{"SHEETSPLAT_EGL_DEVICE is not the number of a device", "\"" + variable + "\"",
                                     "a whole number of at least 0",
                                     "unset it, or set it to the number of an EGL device"});
    }
    return number;
}

bool wants_debug(const ContextOptions& options) { return options.debug || environment("SHEETSPLAT_GL_DEBUG") == "1"; }

// Indices of the devices, those of hardware first, each kind in the driver's order.
std::vector<std::size_t> preferred_order(const std::vector<EglDevice>& devices) {
    std::vector<std::size_t> order(devices.size());
    std::iota(order.begin(), order.end(), std::size_t{0});
    std::stable_partition(order.begin(), order.end(), [&](std::size_t i) { return !devices[i].software; });
    return order;
}

[[noreturn]] void refuse_device(int wanted, const std::vector<EglDevice>& devices) {
    std::string listed;
    for (std::size_t i = 0; i < devices.size(); ++i) {
        listed += (i == 0 ? "" : ", ") + std::to_string(i) + " (" + devices[i].name + ")";
    }
    throw InvalidInput(Complaint{"there is no EGL device with this number", std::to_string(wanted), "one of " + listed,
                                 "choose one of these, or leave out " + option_ref("device"), "device"});
}

// Calls take(platform, Made) for each device until it returns true.
template <class Take>
bool try_egl(std::optional<int> device, bool debug, Take take) {
    std::string story;
    const std::vector<EglDevice> devices = egl_devices(story);
    if (devices.empty()) {
        return take("egl", Made{nullptr, story});
    }
    if (device.has_value()) {
        if (*device < 0 || static_cast<std::size_t>(*device) >= devices.size()) {
            refuse_device(*device, devices);
        }
        return take("egl", make_on_egl_device(static_cast<std::size_t>(*device), debug));
    }
    const std::vector<std::size_t> order = preferred_order(devices);
    return std::any_of(order.begin(), order.end(),
                       [&](std::size_t i) { return take("egl", make_on_egl_device(i, debug)); });
}

/// Address space that a driver in software takes while it makes a context, and while it compiles shaders and draws,
/// beside textures: Mesa 22.3 took 590 and 190 MiB.
constexpr std::uint64_t room_for_a_context = 1ULL << 30;
constexpr std::uint64_t room_for_drawing = 256ULL << 20;

template <class Take>
bool try_platform(const std::string& platform, std::optional<int> device, bool debug, Take take) {
    const std::uint64_t room = available_address_space();
    if (room < room_for_a_context) {
        return take(platform, Made{nullptr, "a limit on the address space leaves " + text_of_bytes(room) +
                                                ", and drivers end a process where they find less than about " +
                                                text_of_bytes(room_for_a_context)});
    }
    if (platform == "egl") {
        return try_egl(device, debug, take);
    }
    if (platform == "surfaceless") {
        return take(platform, make_egl_surfaceless(debug));
    }
    return take(platform, make_osmesa(debug));
}

constexpr std::array<const char*, 3> all_platforms = {"egl", "surfaceless", "osmesa"};

// A forked child has none of the driver's threads, so a call there could wait forever for one of its locks.
std::atomic<pid_t> home_process{0};

constexpr const char* forked_story =
    "OpenGL was used before this process was forked, and drivers do not survive a fork";

bool in_forked_child() {
    const pid_t home = home_process.load();
    return home != 0 && home != getpid();
}

void refuse_forked_child() {
    if (in_forked_child()) {
        throw DeviceUnavailable(Complaint{"no OpenGL context can be used here", forked_story,
                                          "the process that used OpenGL first",
                                          "start processes by spawn instead of fork "
                                          "(multiprocessing.get_context(\"spawn\")), or use " +
                                              option_ref("backend", "cpu")});
    }
}

void note_home_process() {
    pid_t nobody = 0;
    home_process.compare_exchange_strong(nobody, getpid());
}

} // namespace

std::unique_ptr<Context> Context::create(const ContextOptions& options) {
    refuse_forked_child();
    note_home_process();
    const std::string platform = chosen_platform(options);
    const std::optional<int> device = chosen_device(options, platform);
    const bool debug = wants_debug(options);

    std::unique_ptr<Context> context;
    std::string stories;
    const auto take = [&](const std::string& name, Made made) {
        stories += "\n  " + name + ": " + made.story;
        context = std::move(made.context);
        return context != nullptr;
    };
    for (const char* each : all_platforms) {
        // A device number names an EGL device, so no other platform is tried.
        const bool tried =
            platform == each || (platform == "auto" && (!device.has_value() || std::string("egl") == each));
        if (tried && try_platform(each, device, debug, take)) {
            return context;
        }
    }
    throw DeviceUnavailable(
        Complaint{"no OpenGL context could be made", "these attempts failed:" + stories,
                  "OpenGL 3.3 core by an EGL device, EGL surfaceless or OSMesa",
                  "install a driver (on Debian or Ubuntu: apt-get install libegl1 libegl-mesa0 libgl1-mesa-dri), or "
                  "use " +
                      option_ref("backend", "cpu")});
}

std::vector<Attempt> Context::survey() {
    std::vector<Attempt> attempts;
    const auto take = [&](const std::string& name, Made made) {
        const bool succeeded = made.context != nullptr;
        attempts.push_back({name, succeeded, made.story, succeeded ? made.context->capabilities() : Capabilities{}});
        return false;
    };
    const bool forked = in_forked_child();
    if (!forked) {
        note_home_process();
    }
    for (const char* each : all_platforms) {
        try {
            if (forked) {
                attempts.push_back({each, false, forked_story, {}});
            } else {
                try_platform(each, std::nullopt, false, take);
            }
        } catch (const std::exception& error) {
            attempts.push_back({each, false, error.what(), {}});
        }
    }
    return attempts;
}

void require_room(std::uint64_t bytes, const std::string& what) {
    const std::uint64_t room = available_address_space();
    const std::uint64_t wanted = bytes + room_for_drawing;
    if (room < wanted) {
        throw OutOfMemory(
            Complaint{"no memory for " + what, text_of_bytes(room) + " that the limit on the address space leaves",
                      text_of_bytes(wanted) + " with what the driver takes itself",
                      "raise the limit, make the picture smaller, or use " + option_ref("backend", "cpu")});
    }
}

std::vector<std::string> Context::take_debug_errors() { return std::exchange(debug_errors_, {}); }

void Context::forget_objects() noexcept {
    const auto nothing = [](GLsizei, const GLuint*) {};
    api_.DeleteBuffers = api_.DeleteFramebuffers = api_.DeleteQueries = api_.DeleteTextures = api_.DeleteVertexArrays =
        nothing;
    api_.DeleteProgram = api_.DeleteShader = [](GLuint) {};
    api_.DeleteSync = [](GLsync) {};
}

void NativeContext::set_up(const std::string& platform, bool debug) {
    const Current current(*this);
    const int version = gladLoadGLContextUserPtr(&api_, address_of, this);
    if (version < GLAD_MAKE_VERSION(3, 3)) {
        throw Error(Complaint{"the driver's OpenGL is too old",
                              version == 0 ? "no OpenGL functions"
                                           : "OpenGL " + std::to_string(GLAD_VERSION_MAJOR(version)) + "." +
                                                 std::to_string(GLAD_VERSION_MINOR(version)),
                              "OpenGL 3.3 core", ""});
    }
    // GL_NV_texture_barrier is the same function.
    if (api_.TextureBarrier == nullptr) {
        api_.TextureBarrier = api_.TextureBarrierNV;
    }
    capabilities_ = read_capabilities(api_, platform);
    if (debug && capabilities_.debug_output) {
        api_.DebugMessageCallback(on_debug_message, &debug_errors_);
        // Synchronous: a message is kept before the wrong call returns, on the thread that made it.
        api_.Enable(GL_DEBUG_OUTPUT_SYNCHRONOUS);
        api_.Enable(GL_DEBUG_OUTPUT);
    }
    mark();
    check_errors(api_, "setting up an OpenGL context");
}

void Made::finish(std::unique_ptr<NativeContext> fresh, const std::string& platform, bool debug) {
    try {
        fresh->set_up(platform, debug);
    } catch (const InvalidInput&) {
        throw;
    } catch (const Error& error) {
        tell(story, error.what());
        return;
    }
    context = std::move(fresh);
}

void NativeContext::leave_current() noexcept {
    if (current_here == this) {
        release();
        current_here = nullptr;
    }
}

Current::Current(Context& context) : context_(context), previous_(current_here) {
    refuse_forked_child();
    if (current_here == &context) {
        return;
    }
    // The other context is released first, not just replaced: OSMesa and Mesa's EGL share the thread's current context
    // without notifying each other, and EGL ignores a request for the context that it believes to be current.
    Context* previous = current_here;
    if (previous != nullptr) {
        previous->release();
        current_here = nullptr;
    }
    try {
        context.make_current();
    } catch (...) {
        if (previous != nullptr) {
            previous->make_current();
            current_here = previous;
        }
        throw;
    }
    current_here = &context;
}

Current::~Current() {
    auto* previous = static_cast<Context*>(previous_);
    if (previous == &context_ || current_here != &context_) {
        return;
    }
    context_.release();
    current_here = nullptr;
    if (previous != nullptr) {
        try {
            previous->make_current();
            current_here = previous;
        } catch (const std::exception&) { // a destructor must not throw; the next Current reports it
        }
    }
}

GlErrors take_errors(const Api& gl) {
    GlErrors errors;
    // Bounded, because a lost context never stops reporting errors.
    for (int i = 0; i < 16; ++i) {
        const GLenum error = gl.GetError();
        if (error == GL_NO_ERROR) {
            break;
        }
        const char* name = error == GL_INVALID_ENUM                    ? "GL_INVALID_ENUM"
                           : error == GL_INVALID_VALUE                 ? "GL_INVALID_VALUE"
                           : error == GL_INVALID_OPERATION             ? "GL_INVALID_OPERATION"
                           : error == GL_INVALID_FRAMEBUFFER_OPERATION ? "GL_INVALID_FRAMEBUFFER_OPERATION"
                           : error == GL_OUT_OF_MEMORY                 ? "GL_OUT_OF_MEMORY"
                           : error == GL_CONTEXT_LOST                  ? "GL_CONTEXT_LOST"
                                                                       : "an unknown GL error";
        errors.out_of_memory = errors.out_of_memory || error == GL_OUT_OF_MEMORY;
        errors.names += (errors.names.empty() ? "" : ", ") + std::string(name);
    }
    return errors;
}

void check_errors(const Api& gl, const char* where) {
    const GlErrors errors = take_errors(gl);
    if (errors.names.empty()) {
        return;
    }
    if (errors.out_of_memory) {
        throw OutOfMemory(Complaint{std::string("OpenGL ran out of memory: ") + where, errors.names, "",
                                    "render smaller tiles, or free memory of the device"});
    }
    throw Error(Complaint{std::string("OpenGL reported errors: ") + where, errors.names, "no error",
                          "set SHEETSPLAT_GL_DEBUG=1 to have the driver say more"});
}

} // namespace sheetsplat::gl

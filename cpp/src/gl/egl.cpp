// EGL without its headers: the few types, numbers and functions of the EGL 1.5 specification and of the extensions
// EGL_EXT_device_enumeration, EGL_EXT_platform_device, EGL_MESA_platform_surfaceless, EGL_KHR_no_config_context,
// EGL_KHR_surfaceless_context and EGL_KHR_debug that a context without a window needs.
#include "library.hpp"
#include "platforms.hpp"

#include <algorithm>
#include <array>
#include <cstdint>
#include <random>
#include <sstream>
#include <utility>

#include "sheetsplat/error.hpp"

namespace sheetsplat::gl {
namespace {

using EglInt = std::int32_t;
using EglEnum = unsigned int;
using EglBoolean = unsigned int;
using Display = void*;
using Surface = void*;
using Config = void*;
using NativeEglContext = void*;
using Device = void*;

constexpr EglInt none = 0x3038;
constexpr EglInt success = 0x3000;
constexpr EglInt not_initialized = 0x3001;
constexpr EglInt bad_context = 0x3006;
constexpr EglInt bad_display = 0x3008;
constexpr EglInt bad_surface = 0x300D;
constexpr EglInt context_lost = 0x300E;
constexpr EglInt extensions_string = 0x3055;
constexpr EglInt vendor_string = 0x3053;
constexpr EglInt version_string = 0x3054;
constexpr EglInt width_attribute = 0x3057;
constexpr EglInt height_attribute = 0x3056;
constexpr EglInt surface_type = 0x3033;
constexpr EglInt pbuffer_bit = 0x0001;
constexpr EglInt renderable_type = 0x3040;
constexpr EglInt opengl_bit = 0x0008;
constexpr EglInt context_major_version = 0x3098;
constexpr EglInt context_minor_version = 0x30FB;
constexpr EglInt context_profile_mask = 0x30FD;
constexpr EglInt core_profile_bit = 0x0001;
constexpr EglInt context_opengl_debug = 0x31B0; // EGL 1.5
constexpr EglInt context_flags_khr = 0x30FC;    // EGL_KHR_create_context
constexpr EglInt debug_bit_khr = 0x0001;
constexpr EglInt draw_surface = 0x3059;
constexpr EglInt read_surface = 0x305A;
constexpr EglEnum opengl_api = 0x30A2;
constexpr EglEnum platform_device = 0x313F;
constexpr EglEnum platform_surfaceless = 0x31DD;
constexpr EglInt drm_device_file = 0x3233;
constexpr EglInt renderer_string = 0x335F; // EGL_EXT_device_query_name

struct Egl {
    void* (*get_proc_address)(const char*) = nullptr;
    const char* (*query_string)(Display, EglInt) = nullptr;
    EglBoolean (*initialize)(Display, EglInt*, EglInt*) = nullptr;
    EglInt (*get_error)() = nullptr;
    EglBoolean (*bind_api)(EglEnum) = nullptr;
    EglEnum (*query_api)() = nullptr;
    EglBoolean (*choose_config)(Display, const EglInt*, Config*, EglInt, EglInt*) = nullptr;
    NativeEglContext (*create_context)(Display, Config, NativeEglContext, const EglInt*) = nullptr;
    EglBoolean (*destroy_context)(Display, NativeEglContext) = nullptr;
    Surface (*create_pbuffer_surface)(Display, Config, const EglInt*) = nullptr;
    EglBoolean (*destroy_surface)(Display, Surface) = nullptr;
    EglBoolean (*make_current)(Display, Surface, Surface, NativeEglContext) = nullptr;
    NativeEglContext (*get_current_context)() = nullptr;
    Display (*get_current_display)() = nullptr;
    Surface (*get_current_surface)(EglInt) = nullptr;
    // Extensions; null where they are missing.
    EglBoolean (*query_devices)(EglInt, Device*, EglInt*) = nullptr;
    const char* (*query_device_string)(Device, EglInt) = nullptr;
    Display (*get_platform_display)(EglEnum, void*, const EglInt*) = nullptr;

    bool usable = false;
    std::string story;             // how loading succeeded or failed
    std::string client_extensions; // of the library, before any display
};

template <class Function>
void find_extension(const Egl& egl, const char* name, Function& function) {
    function = reinterpret_cast<Function>(egl.get_proc_address(name));
}

bool has_word(const std::string& words, const std::string& word) {
    std::istringstream stream(words);
    for (std::string each; stream >> each;) {
        if (each == word) {
            return true;
        }
    }
    return false;
}

std::string text_or_empty(const char* text) { return text != nullptr ? text : ""; }

const char* error_name(EglInt error) {
    static constexpr std::array<const char*, 15> names = {
        "EGL_SUCCESS",       "EGL_NOT_INITIALIZED", "EGL_BAD_ACCESS",        "EGL_BAD_ALLOC",
        "EGL_BAD_ATTRIBUTE", "EGL_BAD_CONFIG",      "EGL_BAD_CONTEXT",       "EGL_BAD_CURRENT_SURFACE",
        "EGL_BAD_DISPLAY",   "EGL_BAD_MATCH",       "EGL_BAD_NATIVE_PIXMAP", "EGL_BAD_NATIVE_WINDOW",
        "EGL_BAD_PARAMETER", "EGL_BAD_SURFACE",     "EGL_CONTEXT_LOST",
    };
    const EglInt index = error - success;
    return index >= 0 && index < static_cast<EglInt>(names.size()) ? names.at(static_cast<std::size_t>(index))
                                                                   : "an unknown EGL error";
}

Egl load_egl() {
    Egl egl;
    static constexpr std::array<const char*, 3> names = {"libEGL.so.1", "libEGL.so", nullptr};
    const Library library = open_library(names.data());
    egl.story = library.story;
    if (library.handle == nullptr) {
        return egl;
    }
    const bool whole =
        library.find("eglGetProcAddress", egl.get_proc_address) && library.find("eglQueryString", egl.query_string) &&
        library.find("eglInitialize", egl.initialize) && library.find("eglGetError", egl.get_error) &&
        library.find("eglBindAPI", egl.bind_api) && library.find("eglQueryAPI", egl.query_api) &&
        library.find("eglChooseConfig", egl.choose_config) && library.find("eglCreateContext", egl.create_context) &&
        library.find("eglDestroyContext", egl.destroy_context) &&
        library.find("eglCreatePbufferSurface", egl.create_pbuffer_surface) &&
        library.find("eglDestroySurface", egl.destroy_surface) && library.find("eglMakeCurrent", egl.make_current) &&
        library.find("eglGetCurrentContext", egl.get_current_context) &&
        library.find("eglGetCurrentDisplay", egl.get_current_display) &&
        library.find("eglGetCurrentSurface", egl.get_current_surface);
    if (!whole) {
        tell(egl.story, "but it lacks functions of EGL 1.4");
        return egl;
    }
    egl.client_extensions = text_or_empty(egl.query_string(nullptr, extensions_string));
    find_extension(egl, "eglQueryDevicesEXT", egl.query_devices);
    find_extension(egl, "eglQueryDeviceStringEXT", egl.query_device_string);
    find_extension(egl, "eglGetPlatformDisplayEXT", egl.get_platform_display);
    egl.usable = true;
    return egl;
}

// Never destroyed: contexts in static objects of a program may be destroyed after this file's static objects.
const Egl& egl_library() {
    static const Egl& egl = *new Egl(load_egl());
    return egl;
}

// eglGetPlatformDisplay returns the same EGLDisplay to all code in the process that asks for a device, and
// eglInitialize does not count references: one eglTerminate destroys the contexts of all. So this library never calls
// it, and initialises a display before each context, because other code may have ended it; on a display that is ready
// eglInitialize does nothing.
bool initialise(const Egl& egl, Display display, std::string& story) {
    EglInt major = 0, minor = 0;
    if (egl.initialize(display, &major, &minor) == 0) {
        tell(story, std::string("eglInitialize failed with ") + error_name(egl.get_error()) +
                        " (is there a driver for this device, and may this user open /dev/dri/renderD* or "
                        "/dev/nvidia*?)");
        return false;
    }
    tell(story, "EGL " + text_or_empty(egl.query_string(display, version_string)) + ", " +
                    text_or_empty(egl.query_string(display, vendor_string)));
    return true;
}

// What eglMakeCurrent says of a context whose display was ended; EGL_CONTEXT_LOST: the device was reset.
bool says_lost(EglInt error) {
    return error == not_initialized || error == bad_context || error == bad_display || error == bad_surface ||
           error == context_lost;
}

class EglContext final : public NativeContext {
  public:
    EglContext(const Egl& egl, Display display, NativeEglContext context)
        : egl_(egl), display_(display), context_(context) {}

    ~EglContext() override {
        leave_current();
        if (is_lost()) {
            return;
        }
        if (surface_ != nullptr) {
            egl_.destroy_surface(display_, surface_);
        }
        egl_.destroy_context(display_, context_);
    }
    EglContext(const EglContext&) = delete;
    EglContext& operator=(const EglContext&) = delete;

    /// For drivers that cannot make a context current without a surface. False where there is none.
    bool make_surface(Config config) {
        static constexpr std::array<EglInt, 5> one_pixel = {width_attribute, 1, height_attribute, 1, none};
        surface_ = egl_.create_pbuffer_surface(display_, config, one_pixel.data());
        return surface_ != nullptr;
    }

    GLADapiproc address(const char* name) override {
        return reinterpret_cast<GLADapiproc>(egl_.get_proc_address(name));
    }

  protected:
    void make_current() override {
        // Current has released this library's contexts, so what is current belongs to other code in the process;
        // release() makes it current again.
        Foreign foreign;
        foreign.api = egl_.query_api();
        foreign.context = egl_.get_current_context();
        if (foreign.context != nullptr) {
            foreign.display = egl_.get_current_display();
            foreign.draw = egl_.get_current_surface(draw_surface);
            foreign.read = egl_.get_current_surface(read_surface);
        }
        // The bound API belongs to the thread, not to the context.
        if (egl_.bind_api(opengl_api) == 0 || egl_.make_current(display_, surface_, surface_, context_) == 0) {
            const EglInt error = egl_.get_error();
            egl_.bind_api(foreign.api);
            refuse(error_name(error), says_lost(error));
        }
        foreign_ = foreign;
        if (!is_marked()) {
            release();
            refuse("another context in its place", true);
        }
    }

    void mark() override {
        std::random_device device;
        for (GLfloat& part : mark_) {
            part = static_cast<GLfloat>(device() >> 8U);
        }
        api_.GenSamplers(1, &marked_);
        api_.SamplerParameterfv(marked_, GL_TEXTURE_BORDER_COLOR, mark_.data());
    }

    void release() noexcept override {
        egl_.bind_api(opengl_api);
        egl_.make_current(display_, nullptr, nullptr, nullptr);
        egl_.bind_api(foreign_.api);
        if (foreign_.context != nullptr) {
            egl_.make_current(foreign_.display, foreign_.draw, foreign_.read, foreign_.context);
        }
        foreign_ = Foreign{};
    }

  private:
    [[noreturn]] static void refuse(const char* found, bool lost) {
        Complaint complaint{"an EGL context could not be made current", found, "eglMakeCurrent to succeed",
                            "use a context on one thread at a time"};
        if (lost) {
            complaint.advice = "make another one: code in this process has ended the EGL display (eglTerminate)";
            throw ContextLost(std::move(complaint));
        }
        throw Error(std::move(complaint));
    }

    // A handle is an address, which a context of other code may have after the display was ended. A sampler's colour
    // tells them apart without waiting for the device.
    [[nodiscard]] bool is_marked() const {
        if (marked_ == 0) {
            return true;
        }
        std::array<GLfloat, 4> found{};
        if (api_.IsSampler(marked_) != GL_FALSE) {
            api_.GetSamplerParameterfv(marked_, GL_TEXTURE_BORDER_COLOR, found.data());
        }
        return found == mark_;
    }

    [[nodiscard]] bool is_lost() noexcept {
        try {
            make_current();
        } catch (const ContextLost&) {
            return true;
        } catch (const std::exception&) {
            return false;
        }
        release();
        return false;
    }

    struct Foreign {
        EglEnum api = opengl_api;
        Display display = nullptr;
        Surface draw = nullptr;
        Surface read = nullptr;
        NativeEglContext context = nullptr;
    };

    const Egl& egl_;
    Display display_;
    NativeEglContext context_;
    Surface surface_ = nullptr;
    Foreign foreign_;
    GLuint marked_ = 0; // a sampler; 0: not set up
    std::array<GLfloat, 4> mark_{};
};

// Binds desktop OpenGL to this thread, and at the end what was bound before.
struct BoundApi {
    const Egl& egl;
    EglEnum before;
    bool bound;

    explicit BoundApi(const Egl& library)
        : egl(library), before(library.query_api()), bound(library.bind_api(opengl_api) != 0) {}
    BoundApi(const BoundApi&) = delete;
    BoundApi& operator=(const BoundApi&) = delete;
    ~BoundApi() { egl.bind_api(before); }
};

Made make_on_display(const Egl& egl, Display display, const std::string& platform, bool debug) {
    Made made;
    if (!initialise(egl, display, made.story)) {
        return made;
    }
    const std::string extensions = text_or_empty(egl.query_string(display, extensions_string));
    const BoundApi api(egl);
    if (!api.bound) {
        tell(made.story, "this EGL has no desktop OpenGL (eglBindAPI(EGL_OPENGL_API) failed)");
        return made;
    }
    const bool without_surface = has_word(extensions, "EGL_KHR_surfaceless_context");
    const bool without_config = without_surface && (has_word(extensions, "EGL_KHR_no_config_context") ||
                                                    has_word(extensions, "EGL_MESA_configless_context"));
    Config config = nullptr;
    if (!without_config) {
        const std::array<EglInt, 5> wanted = {surface_type, without_surface ? 0 : pbuffer_bit, renderable_type,
                                              opengl_bit, none};
        EglInt count = 0;
        if (egl.choose_config(display, wanted.data(), &config, 1, &count) == 0 || count < 1) {
            tell(made.story, "there is no configuration for desktop OpenGL");
            return made;
        }
    }

    NativeEglContext native = nullptr;
    const bool flags_by_extension = has_word(extensions, "EGL_KHR_create_context");
    for (const auto& version : wanted_versions) {
        std::vector<EglInt> attributes = {context_major_version, version[0],      context_minor_version, version[1],
                                          context_profile_mask,  core_profile_bit};
        if (debug) {
            attributes.push_back(flags_by_extension ? context_flags_khr : context_opengl_debug);
            attributes.push_back(flags_by_extension ? debug_bit_khr : 1);
        }
        attributes.push_back(none);
        native = egl.create_context(display, config, nullptr, attributes.data());
        if (native != nullptr) {
            break;
        }
        tell(made.story, "OpenGL " + std::to_string(version[0]) + "." + std::to_string(version[1]) +
                             " core: " + error_name(egl.get_error()));
    }
    if (native == nullptr) {
        return made;
    }
    auto context = std::make_unique<EglContext>(egl, display, native);
    if (!without_surface && !context->make_surface(config)) {
        tell(made.story, std::string("eglCreatePbufferSurface failed with ") + error_name(egl.get_error()));
        return made;
    }
    made.finish(std::move(context), platform, debug);
    return made;
}

// A context on a display of one of EGL's platforms; device: null for those without devices.
Made make_on_platform(const Egl& egl, EglEnum platform, Device device, const std::string& name, bool debug) {
    Display display = egl.get_platform_display(platform, device, nullptr);
    if (display == nullptr) {
        return {nullptr, std::string("eglGetPlatformDisplayEXT failed with ") + error_name(egl.get_error())};
    }
    return make_on_display(egl, display, name, debug);
}

std::vector<Device> list_devices(const Egl& egl, std::string& story) {
    if (!egl.usable) {
        tell(story, egl.story + " (install libEGL: on Debian or Ubuntu apt-get install libegl1)");
        return {};
    }
    tell(story, egl.story);
    if (egl.query_devices == nullptr || egl.get_platform_display == nullptr ||
        !has_word(egl.client_extensions, "EGL_EXT_platform_device")) {
        tell(story, "it lacks EGL_EXT_device_enumeration or EGL_EXT_platform_device");
        return {};
    }
    EglInt count = 0;
    if (egl.query_devices(0, nullptr, &count) == 0) {
        tell(story, std::string("eglQueryDevicesEXT failed with ") + error_name(egl.get_error()));
        return {};
    }
    std::vector<Device> devices(static_cast<std::size_t>(std::max(count, 0)));
    if (egl.query_devices(count, devices.data(), &count) == 0) {
        count = 0;
    }
    devices.resize(static_cast<std::size_t>(std::max(count, 0)));
    if (devices.empty()) {
        tell(story,
             "it lists no devices (a driver for it may be missing: on Debian or Ubuntu apt-get install libegl-mesa0 "
             "libgl1-mesa-dri)");
    }
    return devices;
}

EglDevice describe(const Egl& egl, Device device) {
    EglDevice described;
    if (egl.query_device_string == nullptr) {
        return described;
    }
    const std::string extensions = text_or_empty(egl.query_device_string(device, extensions_string));
    described.software = has_word(extensions, "EGL_MESA_device_software");
    described.name = described.software ? "software" : "hardware";
    const auto add = [&](const char* extension, EglInt string) {
        const std::string part =
            has_word(extensions, extension) ? text_or_empty(egl.query_device_string(device, string)) : "";
        described.name += part.empty() ? "" : ", " + part;
    };
    add("EGL_EXT_device_query_name", renderer_string);
    add("EGL_EXT_device_drm", drm_device_file);
    return described;
}

} // namespace

std::vector<EglDevice> egl_devices(std::string& story) {
    const Egl& egl = egl_library();
    std::vector<EglDevice> described;
    for (Device device : list_devices(egl, story)) {
        described.push_back(describe(egl, device));
    }
    return described;
}

Made make_on_egl_device(std::size_t index, bool debug) {
    const Egl& egl = egl_library();
    Made made;
    const std::vector<Device> devices = list_devices(egl, made.story);
    if (index >= devices.size()) {
        tell(made.story, "there is no EGL device " + std::to_string(index));
        return made;
    }
    const std::string device = "EGL device " + std::to_string(index) + " (" + describe(egl, devices[index]).name + ")";
    made = make_on_platform(egl, platform_device, devices[index], "egl", debug);
    made.story = device + (made.story.empty() ? "" : "; ") + made.story;
    return made;
}

Made make_egl_surfaceless(bool debug) {
    const Egl& egl = egl_library();
    Made made;
    tell(made.story, egl.story);
    if (!egl.usable) {
        tell(made.story, "(install libEGL: on Debian or Ubuntu apt-get install libegl1)");
        return made;
    }
    if (egl.get_platform_display == nullptr || !has_word(egl.client_extensions, "EGL_MESA_platform_surfaceless")) {
        tell(made.story, "it lacks EGL_MESA_platform_surfaceless");
        return made;
    }
    Made on_display = make_on_platform(egl, platform_surfaceless, nullptr, "surfaceless", debug);
    tell(made.story, on_display.story);
    made.context = std::move(on_display.context);
    return made;
}

} // namespace sheetsplat::gl

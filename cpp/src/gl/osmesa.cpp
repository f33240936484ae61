// Mesa's off-screen library without its header: the types, numbers and functions of OSMesa 11.2 and later.
#include "library.hpp"
#include "platforms.hpp"

#include <array>
#include <filesystem>
#include <map>
#include <mutex>
#include <system_error>
#include <utility>

#include <dlfcn.h>

#include "sheetsplat/error.hpp"

namespace sheetsplat::gl {
namespace {

using NativeOsmesaContext = void*;

constexpr int format_attribute = 0x22;
constexpr int rgba_format = 0x1908;
constexpr int depth_bits = 0x30;
constexpr int stencil_bits = 0x31;
constexpr int accum_bits = 0x32;
constexpr int profile_attribute = 0x33;
constexpr int core_profile = 0x34;
constexpr int major_attribute = 0x36;
constexpr int minor_attribute = 0x37;

struct Osmesa {
    NativeOsmesaContext (*create_context)(const int*, NativeOsmesaContext) = nullptr;
    void (*destroy_context)(NativeOsmesaContext) = nullptr;
    unsigned char (*make_current)(NativeOsmesaContext, void*, GLenum, GLsizei, GLsizei) = nullptr;
    GLADapiproc (*get_proc_address)(const char*) = nullptr;
    bool usable = false;
    std::string story;
};

// OSMesa keeps lists that all contexts share (of screens, and up to Mesa 20 of buffers) and locks only some of them.
std::mutex& osmesa_mutex() {
    static std::mutex& mutex = *new std::mutex;
    return mutex;
}

// The libOSMesa of the Python wheel lavavu-osmesa, which lies in a folder beside that of this package; "" where
// there is none.
std::string library_of_wheel() {
    Dl_info here{};
    if (dladdr(reinterpret_cast<const void*>(&library_of_wheel), &here) == 0 || here.dli_fname == nullptr) {
        return "";
    }
    namespace fs = std::filesystem;
    std::error_code ignored;
    const fs::path packages = fs::absolute(here.dli_fname, ignored).parent_path().parent_path();
    for (fs::directory_iterator one(packages / "lavavu_osmesa.libs", ignored), end; one != end;
         one.increment(ignored)) {
        if (one->path().filename().string().rfind("libOSMesa", 0) == 0) {
            return one->path().string();
        }
    }
    return "";
}

Osmesa load(const std::string& path) {
    Osmesa osmesa;
    const std::string wheel = library_of_wheel();
    const std::array<const char*, 2> given = {path.c_str(), nullptr};
    const std::array<const char*, 5> usual = {"libOSMesa.so.8", "libOSMesa.so.6", "libOSMesa.so",
                                              wheel.empty() ? nullptr : wheel.c_str(), nullptr};
    const Library library = open_library(path.empty() ? usual.data() : given.data());
    osmesa.story = path.empty() ? library.story : "SHEETSPLAT_OSMESA: " + library.story;
    if (library.handle == nullptr) {
        tell(osmesa.story, path.empty()
                               ? "install it (pip install \"sheetsplat[osmesa]\"; on Debian 12 or Ubuntu 24.04 also "
                                 "apt-get install libosmesa6), or set SHEETSPLAT_OSMESA to the path of a libOSMesa"
                               : "set SHEETSPLAT_OSMESA to the path of a libOSMesa, or unset it");
        return osmesa;
    }
    osmesa.usable = library.find("OSMesaCreateContextAttribs", osmesa.create_context) &&
                    library.find("OSMesaDestroyContext", osmesa.destroy_context) &&
                    library.find("OSMesaMakeCurrent", osmesa.make_current) &&
                    library.find("OSMesaGetProcAddress", osmesa.get_proc_address);
    if (!osmesa.usable) {
        tell(osmesa.story, "but it lacks OSMesaCreateContextAttribs (wanted OSMesa 11.2 or later)");
    }
    return osmesa;
}

// Entries are never destroyed or changed, so contexts of any lifetime can refer to them. A failure is not kept: the
// library may be installed, or the variable corrected, while the process runs.
const Osmesa& osmesa_library(std::string& story) {
    static std::map<std::string, const Osmesa*>& loaded = *new std::map<std::string, const Osmesa*>;
    static const Osmesa& unusable = *new Osmesa;
    const std::lock_guard<std::mutex> lock(osmesa_mutex());
    const std::string path = environment("SHEETSPLAT_OSMESA");
    const auto known = loaded.find(path);
    if (known != loaded.end()) {
        tell(story, known->second->story);
        return *known->second;
    }
    const Osmesa fresh = load(path);
    tell(story, fresh.story);
    if (!fresh.usable) {
        return unusable;
    }
    return *loaded.emplace(path, new Osmesa(fresh)).first->second;
}

class OsmesaContext final : public NativeContext {
  public:
    OsmesaContext(const Osmesa& osmesa, NativeOsmesaContext context) : osmesa_(osmesa), context_(context) {}

    ~OsmesaContext() override {
        leave_current();
        const std::lock_guard<std::mutex> lock(osmesa_mutex());
        osmesa_.destroy_context(context_);
    }
    OsmesaContext(const OsmesaContext&) = delete;
    OsmesaContext& operator=(const OsmesaContext&) = delete;

    GLADapiproc address(const char* name) override { return osmesa_.get_proc_address(name); }

  protected:
    void make_current() override {
        const std::lock_guard<std::mutex> lock(osmesa_mutex());
        if (osmesa_.make_current(context_, pixel_.data(), GL_UNSIGNED_BYTE, 1, 1) == 0) {
            throw Error(Complaint{"an OSMesa context could not be made current", "OSMesaMakeCurrent failed", "",
                                  "use a context on one thread at a time"});
        }
    }

    void release() noexcept override {
        const std::lock_guard<std::mutex> lock(osmesa_mutex());
        osmesa_.make_current(nullptr, nullptr, GL_UNSIGNED_BYTE, 0, 0);
    }

  private:
    const Osmesa& osmesa_;
    NativeOsmesaContext context_;
    std::array<unsigned char, 4> pixel_{}; // OSMesa writes its own framebuffer here when it flushes
};

} // namespace

Made make_osmesa(bool debug) {
    Made made;
    const Osmesa& osmesa = osmesa_library(made.story);
    if (!osmesa.usable) {
        return made;
    }
    NativeOsmesaContext native = nullptr;
    for (const auto& version : wanted_versions) {
        const std::array<int, 15> attributes = {
            format_attribute,  rgba_format,  depth_bits,      0,          stencil_bits,    0,          accum_bits, 0,
            profile_attribute, core_profile, major_attribute, version[0], minor_attribute, version[1], 0};
        const std::lock_guard<std::mutex> lock(osmesa_mutex());
        native = osmesa.create_context(attributes.data(), nullptr);
        if (native != nullptr) {
            break;
        }
        tell(made.story, "OpenGL " + std::to_string(version[0]) + "." + std::to_string(version[1]) + " core refused");
    }
    if (native == nullptr) {
        return made;
    }
    made.finish(std::make_unique<OsmesaContext>(osmesa, native), "osmesa", debug);
    return made;
}

} // namespace sheetsplat::gl

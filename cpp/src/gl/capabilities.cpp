#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <map>
#include <mutex>
#include <set>
#include <sstream>

#include "gl/objects.hpp"
#include "gl/program.hpp"
#include "library.hpp"
#include "platforms.hpp"
#include "sheetsplat/error.hpp"

namespace sheetsplat::gl {
namespace {

/// A behaviour of some drivers for which passes have a work-around.
struct Workaround {
    const char* name;
    bool (*applies)(const Capabilities&);
    const char* purpose;
};

constexpr std::array<Workaround, 5> workarounds = {{
    {"loops_end_early", [](const Capabilities& c) { return c.most_turns > 0; },
     "loops of a compute program end after so many turns in all, without a word: the compute path draws fewer slices a "
     "call, and refuses scenes of too many kernels"},
    {"fp16_store_truncates", [](const Capabilities& c) { return !c.float16_blend_rounds; },
     "sums in 16-bit floats are cut off instead of rounded, so that long sums come out dark: sheets are 32-bit"},
    {"no_float32_blend", [](const Capabilities& c) { return !c.float32_blend; },
     "32-bit floats cannot be summed by blending: the plan refuses float32 sheets, and another backend draws"},
    {"points_need_guard", [](const Capabilities& c) { return !c.points_reach_in; },
     "a point is dropped when its centre leaves the viewport: the viewport is drawn larger than the target by a "
     "point's radius"},
    {"glsl_330_only", [](const Capabilities& c) { return !c.at_least(4, 0); },
     "the driver stops at OpenGL 3.3: shaders keep to GLSL 3.30 and storage is made by glTexImage2D"},
}};

/// What only a test drawing tells about a driver. The defaults hold where the test drawing fails.
struct Probes {
    bool float32_blend = false;
    bool float16_blend_rounds = false;
    bool points_reach_in = false;
    float max_point_size = 1.0F;
    int most_turns = 0;
};

const SourceFiles& probe_files() {
    static const SourceFiles files = {
        {"probe.vert", "uniform vec2 place;\n"
                       "uniform float size;\n"
                       "void main() {\n"
                       "    gl_Position = vec4(place, 0.0, 1.0);\n"
                       "    gl_PointSize = size;\n"
                       "}\n"},
        {"probe.frag", "uniform float value;\n"
                       "out vec4 color;\n"
                       "void main() { color = vec4(value); }\n"},
        {"turns.comp", "layout(local_size_x = 1) in;\n"
                       "layout(std430, binding = 0) buffer Result { uint result; };\n"
                       "uniform int turns;\n"
                       "void main() {\n"
                       "    uint number = 1u;\n"
                       "    for (int turn = 0; turn < turns; ++turn) {\n"
                       "        number = number * 1664525u + 1013904223u;\n"
                       "    }\n"
                       "    result = number;\n"
                       "}\n"},
    };
    return files;
}

constexpr int probe_size = 8; // pixels, both ways

class Prober {
  public:
    explicit Prober(const Api& gl)
        : gl_(gl), points_(gl),
          program_(gl, probe_files(), "probe.vert", "probe.frag", {}, "#version 330 core", {"color"}) {
        points_.bind();
        program_.use();
        gl.Enable(GL_PROGRAM_POINT_SIZE);
    }

    /// c + v of one pixel, blended in that format.
    float blended(GLenum format, float first, float second) {
        const Texture target(gl_, format, probe_size, probe_size);
        const Framebuffer framebuffer(gl_, {&target});
        framebuffer.bind();
        clear(first);
        gl_.Enable(GL_BLEND);
        gl_.BlendFunc(GL_ONE, GL_ONE);
        gl_.Viewport(0, 0, probe_size, probe_size);
        point(1.0F / probe_size, 1.0F, second);
        gl_.Disable(GL_BLEND);
        gl_.BlendFunc(GL_ONE, GL_ZERO);
        const float result = row()[probe_size / 2];
        check_errors(gl_, "probing how the device blends");
        return result;
    }

    /// True where a point whose centre lies one pixel to the left of the viewport is drawn inside it.
    bool points_reach_in() {
        const Texture target(gl_, GL_RGBA32F, probe_size, probe_size);
        const Framebuffer framebuffer(gl_, {&target});
        framebuffer.bind();
        clear(0.0F);
        gl_.Viewport(0, 0, probe_size, probe_size);
        point(-1.0F - 2.0F / probe_size, 6.0F, 1.0F);
        const bool drawn = row()[0] == 1.0F && row()[1] == 1.0F && row()[2] == 0.0F;
        check_errors(gl_, "probing how the device clips points");
        return drawn;
    }

    /// The largest size, of `claimed` and its halves, at which points are drawn whole: tested with a point whose right
    /// edge lies in the target's middle.
    float max_point_size(float claimed, int max_viewport) {
        const Texture target(gl_, GL_RGBA32F, probe_size, probe_size);
        const Framebuffer framebuffer(gl_, {&target});
        framebuffer.bind();
        float size = std::floor(std::min(claimed, static_cast<float>(max_viewport - probe_size)));
        while (size > 1.0F) {
            clear(0.0F);
            const int reach = static_cast<int>(size);
            gl_.Viewport(-reach, 0, reach + probe_size, probe_size);
            const float centre = 0.5F * probe_size + 0.25F - 0.5F * size; // of the point, window coordinates
            point(2.0F * (centre + size) / (size + probe_size) - 1.0F, size, 1.0F);
            const std::array<float, probe_size> seen = row();
            if (seen[0] == 1.0F && seen[probe_size / 2 - 1] == 1.0F && seen[probe_size / 2] == 0.0F) {
                break;
            }
            size = std::floor(size / 2.0F);
        }
        check_errors(gl_, "probing the size of points");
        return std::max(size, 1.0F);
    }

  private:
    void clear(float value) {
        gl_.ClearColor(value, value, value, value);
        gl_.Clear(GL_COLOR_BUFFER_BIT);
    }
    void point(float x_ndc, float size, float value) {
        program_.set("place", x_ndc, 1.0F / probe_size); // the middle of the row that is read
        program_.set("size", size);
        program_.set("value", value);
        gl_.DrawArrays(GL_POINTS, 0, 1);
    }
    /// The red channel of the row above the middle.
    std::array<float, probe_size> row() {
        std::array<float, probe_size> values{};
        gl_.ReadPixels(0, probe_size / 2, probe_size, 1, GL_RED, GL_FLOAT, values.data());
        return values;
    }

    const Api& gl_;
    VertexArray points_;
    Program program_;
};

/// Turns after which a driver ends loops: 0 where it took many more; else what drivers are known to end at.
int most_turns(const Api& gl) {
    constexpr int many = 200000, known = 65535;
    const Program program = Program::computing(gl, probe_files(), "turns.comp", {}, "#version 430 core");
    Buffer result(gl, GL_SHADER_STORAGE_BUFFER);
    std::uint32_t expected = 1, found = 0;
    result.upload(&found, sizeof found);
    result.bind_storage(0);
    program.use();
    program.set("turns", many);
    gl.DispatchCompute(1, 1, 1);
    gl.MemoryBarrier(GL_BUFFER_UPDATE_BARRIER_BIT);
    result.read(&found, sizeof found);
    for (int turn = 0; turn < many; ++turn) {
        expected = expected * 1664525U + 1013904223U;
    }
    return found == expected ? 0 : known;
}

template <class Value, class Measure>
void measure(const Api& gl, Value& value, Measure of) {
    try {
        value = of();
    } catch (const Error&) {
        take_errors(gl);
    }
}

Probes probe(const Api& gl, float claimed_point_size, int max_viewport, bool computes) {
    Probes probes;
    GLint viewport[4] = {};
    gl.GetIntegerv(GL_VIEWPORT, viewport);
    const auto reset = [&] {
        gl.BindFramebuffer(GL_FRAMEBUFFER, 0);
        gl.BindVertexArray(0);
        gl.UseProgram(0);
        gl.ActiveTexture(GL_TEXTURE0);
        gl.Disable(GL_PROGRAM_POINT_SIZE);
        gl.ClearColor(0.0F, 0.0F, 0.0F, 0.0F);
        gl.Viewport(viewport[0], viewport[1], viewport[2], viewport[3]);
    };
    try {
        Prober prober(gl);
        // A sum that float32 holds exactly, with a part that no shorter format keeps.
        constexpr float small = 1.0F / (1U << 20U);
        measure(gl, probes.float32_blend, [&] { return prober.blended(GL_RGBA32F, 1.0F, small) == 1.0F + small; });
        // Three quarters of float16's step at 1: to nearest, the sum is 1 and a step; cut off, it is 1.
        constexpr float step = 1.0F / 1024.0F;
        measure(gl, probes.float16_blend_rounds,
                [&] { return prober.blended(GL_RGBA16F, 1.0F, 0.75F * step) == 1.0F + step; });
        measure(gl, probes.points_reach_in, [&] { return prober.points_reach_in(); });
        measure(gl, probes.max_point_size, [&] { return prober.max_point_size(claimed_point_size, max_viewport); });
        if (computes) {
            measure(gl, probes.most_turns, [&] { return most_turns(gl); });
        }
        reset();
    } catch (...) {
        reset();
        take_errors(gl);
        throw;
    }
    return probes;
}

std::string text_of(const Api& gl, GLenum name) {
    const GLubyte* text = gl.GetString(name);
    return text != nullptr ? reinterpret_cast<const char*>(text) : "";
}

bool is_software(const std::string& renderer) {
    static constexpr std::array<const char*, 6> names = {"llvmpipe", "softpipe", "swrast",
                                                         "SWR",      "Software", "SwiftShader"};
    return std::any_of(names.begin(), names.end(),
                       [&](const char* name) { return renderer.find(name) != std::string::npos; });
}

// SHEETSPLAT_GL_DISABLE: capabilities that tests of the fallbacks switch off.
struct Switch {
    const char* name;
    void (*off)(Capabilities&);
};

constexpr std::array<Switch, 6> switches = {{
    {"software", [](Capabilities& c) { c.software = false; }}, // a device in software counts as hardware
    {"compute", [](Capabilities& c) { c.compute_memory = 0; }},
    {"debug_output", [](Capabilities& c) { c.debug_output = false; }},
    {"depth_bounds", [](Capabilities& c) { c.depth_bounds = false; }},
    {"float32_blend", [](Capabilities& c) { c.float32_blend = false; }},
    {"texture_barrier", [](Capabilities& c) { c.texture_barrier = false; }},
}};

void apply_switches(Capabilities& capabilities) {
    std::istringstream names(environment("SHEETSPLAT_GL_DISABLE"));
    for (std::string name; std::getline(names, name, ',');) {
        if (name.empty()) {
            continue;
        }
        const auto* found =
            std::find_if(switches.begin(), switches.end(), [&](const Switch& each) { return name == each.name; });
        if (found == switches.end()) {
            std::string known;
            for (const Switch& each : switches) {
                known += (known.empty() ? "" : ",") + std::string(each.name);
            }
            throw InvalidInput(Complaint{"SHEETSPLAT_GL_DISABLE names something that cannot be disabled",
                                         "\"" + name + "\"", "names out of " + known + ", with commas between them",
                                         "correct or unset it"});
        }
        found->off(capabilities);
    }
}

// All contexts of one driver behave alike, so each driver is measured once in a process.
Probes probed_once(const Api& gl, const std::string& driver, float claimed_point_size, int max_viewport,
                   bool computes) {
    static std::mutex& mutex = *new std::mutex;
    static std::map<std::string, Probes>& known = *new std::map<std::string, Probes>;
    {
        const std::lock_guard<std::mutex> lock(mutex);
        const auto found = known.find(driver);
        if (found != known.end()) {
            return found->second;
        }
    }
    // Without the lock, because drawing may take long; two threads that measure at once get the same results.
    const Probes probes = probe(gl, claimed_point_size, max_viewport, computes);
    const std::lock_guard<std::mutex> lock(mutex);
    known.emplace(driver, probes);
    return probes;
}

} // namespace

std::string workaround_purpose(const std::string& name) {
    const auto* found =
        std::find_if(workarounds.begin(), workarounds.end(), [&](const Workaround& each) { return name == each.name; });
    return found == workarounds.end() ? "" : found->purpose;
}

Capabilities read_capabilities(const Api& gl, const std::string& platform) {
    Capabilities c;
    c.platform = platform;
    c.vendor = text_of(gl, GL_VENDOR);
    c.renderer = text_of(gl, GL_RENDERER);
    c.version = text_of(gl, GL_VERSION);
    gl.GetIntegerv(GL_MAJOR_VERSION, &c.version_major);
    gl.GetIntegerv(GL_MINOR_VERSION, &c.version_minor);
    c.software = is_software(c.renderer);
    c.depth_bounds = gl.EXT_depth_bounds_test != 0 && gl.DepthBoundsEXT != nullptr;
    c.texture_barrier =
        gl.TextureBarrier != nullptr && (c.at_least(4, 5) || gl.ARB_texture_barrier != 0 || gl.NV_texture_barrier != 0);
    c.debug_output = gl.DebugMessageCallback != nullptr && (c.at_least(4, 3) || gl.KHR_debug != 0);
    gl.GetIntegerv(GL_MAX_TEXTURE_SIZE, &c.max_texture_size);
    GLint viewport[2] = {};
    gl.GetIntegerv(GL_MAX_VIEWPORT_DIMS, viewport);
    c.max_viewport = std::min(viewport[0], viewport[1]);
    gl.GetIntegerv(GL_SUBPIXEL_BITS, &c.subpixel_bits);
    gl.GetIntegerv(GL_MAX_TEXTURE_IMAGE_UNITS, &c.max_texture_units);
    gl.GetIntegerv(GL_MAX_TEXTURE_BUFFER_SIZE, &c.max_buffer_texels);
    gl.GetIntegerv(GL_MAX_3D_TEXTURE_SIZE, &c.max_volume_size);
    if (c.at_least(4, 3) && gl.DispatchCompute != nullptr) {
        GLint buffers = 0, images = 0;
        gl.GetIntegerv(GL_MAX_COMPUTE_SHADER_STORAGE_BLOCKS, &buffers);
        gl.GetIntegerv(GL_MAX_COMPUTE_IMAGE_UNIFORMS, &images);
        if (buffers >= 4 && images >= 5) {
            gl.GetIntegerv(GL_MAX_COMPUTE_SHARED_MEMORY_SIZE, &c.compute_memory);
        }
    }
    GLfloat point_sizes[2] = {1.0F, 1.0F};
    gl.GetFloatv(GL_POINT_SIZE_RANGE, point_sizes);

    const std::array<std::pair<const char*, int>, 4> used = {{
        {"GL_ARB_texture_barrier", gl.ARB_texture_barrier},
        {"GL_EXT_depth_bounds_test", gl.EXT_depth_bounds_test},
        {"GL_KHR_debug", gl.KHR_debug},
        {"GL_NV_texture_barrier", gl.NV_texture_barrier},
    }};
    for (const auto& [name, present] : used) {
        if (present != 0) {
            c.extensions.emplace_back(name);
        }
    }

    const std::string driver = platform + "\n" + c.vendor + "\n" + c.renderer + "\n" + c.version;
    const Probes probes = probed_once(gl, driver, point_sizes[1], c.max_viewport, c.compute_memory > 0);
    c.float32_blend = probes.float32_blend;
    c.float16_blend_rounds = probes.float16_blend_rounds;
    c.points_reach_in = probes.points_reach_in;
    c.max_point_size = probes.max_point_size;
    c.most_turns = probes.most_turns;

    apply_switches(c);
    for (const Workaround& each : workarounds) {
        if (each.applies(c)) {
            c.workarounds.emplace_back(each.name);
        }
    }
    return c;
}

} // namespace sheetsplat::gl

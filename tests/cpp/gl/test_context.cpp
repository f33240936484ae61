// Contexts: each platform that is here, what is current, choice by options and environment, and messages where nothing
// works.
#include "gl_tests.hpp"

#include <algorithm>
#include <cstdio>

#include <dlfcn.h>

namespace sheetsplat::gl::testing {
namespace {

class EachPlatform : public ::testing::TestWithParam<const char*> {};
INSTANTIATE_TEST_SUITE_P(Platforms, EachPlatform, ::testing::Values("egl", "surfaceless", "osmesa"),
                         [](const auto& name) { return std::string(name.param); });

TEST_P(EachPlatform, clears_and_reads_back) {
    const Tried tried = try_context(on(GetParam()));
    if (!tried.context) {
        GTEST_SKIP() << tried.reason;
    }
    EXPECT_EQ(tried.context->capabilities().platform, GetParam());
    const Current current(*tried.context);
    const Api& gl = tried.context->api();
    EXPECT_TRUE(testing::clears_and_reads_back(gl, {0.25F, 0.5F, 0.75F, 1.0F}));

    // Control: the comparison sees one wrong pixel.
    const Texture texture(gl, GL_RGBA32F, 2, 1);
    const Framebuffer framebuffer(gl, {&texture});
    framebuffer.bind();
    gl.ClearColor(1.0F, 0.0F, 0.0F, 0.0F);
    gl.Clear(GL_COLOR_BUFFER_BIT);
    gl.Enable(GL_SCISSOR_TEST);
    gl.Scissor(1, 0, 1, 1);
    gl.ClearColor(0.0F, 1.0F, 0.0F, 0.0F);
    gl.Clear(GL_COLOR_BUFFER_BIT);
    std::array<float, 8> values{};
    gl.ReadPixels(0, 0, 2, 1, GL_RGBA, GL_FLOAT, values.data());
    const std::array<float, 8> expected = {1.0F, 0.0F, 0.0F, 0.0F, 0.0F, 1.0F, 0.0F, 0.0F};
    EXPECT_EQ(values, expected);
}

TEST_P(EachPlatform, capabilities_are_what_opengl_3_3_promises) {
    const Tried tried = try_context(on(GetParam()));
    if (!tried.context) {
        GTEST_SKIP() << tried.reason;
    }
    const Capabilities& c = tried.context->capabilities();
    EXPECT_TRUE(c.at_least(3, 3));
    EXPECT_FALSE(c.renderer.empty());
    EXPECT_FALSE(c.vendor.empty());
    EXPECT_FALSE(c.version.empty());
    EXPECT_GE(c.max_texture_size, 1024);
    EXPECT_GE(c.max_viewport, c.max_texture_size);
    EXPECT_GE(c.max_point_size, 1.0F);
    EXPECT_TRUE(c.float32_blend);
    const auto has = [](const std::vector<std::string>& names, const char* name) {
        return std::find(names.begin(), names.end(), name) != names.end();
    };
    EXPECT_EQ(has(c.extensions, "GL_EXT_depth_bounds_test"), c.depth_bounds);
    for (const std::string& name : c.workarounds) {
        EXPECT_FALSE(workaround_purpose(name).empty()) << name;
    }
    EXPECT_EQ(has(c.workarounds, "fp16_store_truncates"), !c.float16_blend_rounds);
    EXPECT_EQ(has(c.workarounds, "points_need_guard"), !c.points_reach_in);
    EXPECT_EQ(has(c.workarounds, "glsl_330_only"), !c.at_least(4, 0));
    EXPECT_EQ(workaround_purpose("no such work-around"), "");
    if (c.renderer.find("llvmpipe") != std::string::npos) {
        EXPECT_TRUE(c.software);
        EXPECT_FALSE(c.depth_bounds);
        EXPECT_FALSE(c.float16_blend_rounds);
    }
    if (c.renderer.find("softpipe") != std::string::npos) {
        EXPECT_TRUE(c.software);
        EXPECT_TRUE(c.depth_bounds);
        EXPECT_FALSE(c.at_least(4, 0));
    }
}

TEST_P(EachPlatform, starts_in_the_first_state_with_and_without_probes) {
    // Only the first context of a driver is probed; it must look like the later ones.
    for (int i = 0; i < 2; ++i) {
        const Tried tried = try_context(on(GetParam()));
        if (!tried.context) {
            GTEST_SKIP() << tried.reason;
        }
        const Current current(*tried.context);
        const Api& gl = tried.context->api();
        const auto value = [&](GLenum name) {
            GLint number = -1;
            gl.GetIntegerv(name, &number);
            return number;
        };
        EXPECT_EQ(value(GL_CURRENT_PROGRAM), 0);
        EXPECT_EQ(value(GL_DRAW_FRAMEBUFFER_BINDING), 0);
        EXPECT_EQ(value(GL_VERTEX_ARRAY_BINDING), 0);
        EXPECT_EQ(value(GL_ACTIVE_TEXTURE), static_cast<GLint>(GL_TEXTURE0));
        EXPECT_EQ(value(GL_BLEND_SRC_RGB), static_cast<GLint>(GL_ONE));
        EXPECT_EQ(value(GL_BLEND_DST_RGB), static_cast<GLint>(GL_ZERO));
        EXPECT_EQ(gl.IsEnabled(GL_BLEND), GL_FALSE);
        EXPECT_EQ(gl.IsEnabled(GL_PROGRAM_POINT_SIZE), GL_FALSE);
        GLint viewport[4] = {-1, -1, -1, -1};
        gl.GetIntegerv(GL_VIEWPORT, viewport);
        EXPECT_EQ(viewport[0], 0);
        EXPECT_LE(viewport[2], 1);
        EXPECT_EQ(gl.GetError(), static_cast<GLenum>(GL_NO_ERROR));
    }
}

// A context of every platform that is here, all alive.
std::vector<std::unique_ptr<Context>> one_of_each() {
    std::vector<std::unique_ptr<Context>> contexts;
    for (const char* platform : {"egl", "surfaceless", "osmesa"}) {
        Tried tried = try_context(on(platform));
        if (tried.context) {
            contexts.push_back(std::move(tried.context));
        }
    }
    return contexts;
}

TEST(Current, gives_back_what_was_current_on_any_platform) {
    const auto contexts = one_of_each();
    if (contexts.empty()) {
        GTEST_SKIP() << "no OpenGL here";
    }
    for (const auto& outer : contexts) {
        for (const auto& inner : contexts) {
            const Current of_outer(*outer);
            const Texture kept(outer->api(), GL_RGBA32F, 1, 1);
            const Framebuffer framebuffer(outer->api(), {&kept});
            framebuffer.bind();
            outer->api().ClearColor(0.5F, 0.25F, 2.0F, 1.0F);
            outer->api().Clear(GL_COLOR_BUFFER_BIT);
            {
                const Current of_inner(*inner);
                EXPECT_TRUE(clears_and_reads_back(inner->api(), {1.0F, 2.0F, 3.0F, 4.0F}));
                {
                    const Current again(*outer);
                    EXPECT_TRUE(clears_and_reads_back(outer->api(), {4.0F, 3.0F, 2.0F, 1.0F}));
                }
                EXPECT_TRUE(clears_and_reads_back(inner->api(), {1.0F, 2.0F, 3.0F, 5.0F}));
            }
            framebuffer.bind();
            std::array<float, 4> pixel{};
            outer->api().ReadPixels(0, 0, 1, 1, GL_RGBA, GL_FLOAT, pixel.data());
            EXPECT_EQ(pixel, (std::array<float, 4>{0.5F, 0.25F, 2.0F, 1.0F}))
                << outer->capabilities().platform << " around " << inner->capabilities().platform;
        }
    }
}

TEST(Current, making_and_destroying_contexts_leaves_it_alone) {
    const auto contexts = one_of_each();
    if (contexts.empty()) {
        GTEST_SKIP() << "no OpenGL here";
    }
    for (const auto& context : contexts) {
        const Current current(*context);
        for (const char* platform : {"egl", "surfaceless", "osmesa"}) {
            (void)try_context(on(platform));
        }
        EXPECT_TRUE(clears_and_reads_back(context->api(), {1.0F, 0.0F, 0.5F, 0.25F}))
            << context->capabilities().platform;
    }
}

TEST(Current, nothing_is_current_after_creation_or_afterwards) {
    Tried tried = try_context();
    if (!tried.context) {
        GTEST_SKIP() << tried.reason;
    }
    // Another thread can take a context only if this one has let go of it.
    for (int i = 0; i < 2; ++i) {
        const Current current(*tried.context);
        EXPECT_TRUE(clears_and_reads_back(tried.context->api(), {1.0F, 1.0F, 1.0F, 1.0F}));
    }
}

// EGL as other code of this process uses it.
struct ForeignEgl {
    void* library = dlopen("libEGL.so.1", RTLD_NOW | RTLD_LOCAL);

    template <class Signature>
    [[nodiscard]] Signature* function(const char* name) const {
        return reinterpret_cast<Signature*>(dlsym(library, name));
    }
    unsigned (*initialize)(void*, int*, int*) = function<unsigned(void*, int*, int*)>("eglInitialize");
    unsigned (*terminate)(void*) = function<unsigned(void*)>("eglTerminate");
    unsigned (*bind_api)(unsigned) = function<unsigned(unsigned)>("eglBindAPI");
    unsigned (*query_api)() = function<unsigned()>("eglQueryAPI");
    void* (*create)(void*, void*, void*,
                    const int*) = function<void*(void*, void*, void*, const int*)>("eglCreateContext");
    unsigned (*destroy)(void*, void*) = function<unsigned(void*, void*)>("eglDestroyContext");
    unsigned (*make_current)(void*, void*, void*,
                             void*) = function<unsigned(void*, void*, void*, void*)>("eglMakeCurrent");
    void* (*current_context)() = function<void*()>("eglGetCurrentContext");
    void* (*current_display)() = function<void*()>("eglGetCurrentDisplay");

    [[nodiscard]] void* surfaceless_display() const {
        constexpr unsigned surfaceless = 0x31DD;
        const auto get_proc_address = function<void*(const char*)>("eglGetProcAddress");
        const auto get_platform_display =
            reinterpret_cast<void* (*)(unsigned, void*, const int*)>(get_proc_address("eglGetPlatformDisplayEXT"));
        return get_platform_display(surfaceless, nullptr, nullptr);
    }
    [[nodiscard]] void* make(void* display, int major) const {
        const std::array<int, 3> attributes = {0x3098, major, 0x3038};
        return create(display, nullptr, nullptr, attributes.data());
    }
};
constexpr unsigned opengl = 0x30A2;
constexpr unsigned opengl_es = 0x30A0;

TEST(Current, gives_back_the_egl_contexts_of_others) {
    const Tried ours = try_context(on("surfaceless"));
    if (!ours.context) {
        GTEST_SKIP() << ours.reason;
    }
    const ForeignEgl egl;
    ASSERT_NE(egl.library, nullptr);
    void* display = egl.surfaceless_display();
    ASSERT_NE(egl.initialize(display, nullptr, nullptr), 0U);

    const unsigned api_before = egl.query_api();
    for (const unsigned api : {opengl, opengl_es}) {
        ASSERT_NE(egl.bind_api(api), 0U);
        void* foreign = egl.make(display, api == opengl ? 3 : 2);
        ASSERT_NE(foreign, nullptr);
        ASSERT_NE(egl.make_current(display, nullptr, nullptr, foreign), 0U);
        {
            const Current current(*ours.context);
            EXPECT_NE(egl.current_context(), foreign);
            EXPECT_TRUE(clears_and_reads_back(ours.context->api(), {1.0F, 2.0F, 3.0F, 4.0F}));
            const Tried inner = try_context(on("egl"));
            ASSERT_NE(inner.context, nullptr);
            const Current nested(*inner.context);
            EXPECT_TRUE(clears_and_reads_back(inner.context->api(), {4.0F, 2.0F, 3.0F, 4.0F}));
        }
        EXPECT_EQ(egl.current_context(), foreign);
        EXPECT_EQ(egl.query_api(), api);
        egl.make_current(display, nullptr, nullptr, nullptr);
        egl.destroy(display, foreign);
    }
    egl.bind_api(api_before);
}

// Other code ends the display, as VTK does.
class EndedDisplay : public ::testing::TestWithParam<const char*> {};
INSTANTIATE_TEST_SUITE_P(Platforms, EndedDisplay, ::testing::Values("egl", "surfaceless"),
                         [](const auto& one) { return std::string(one.param); });

TEST_P(EndedDisplay, is_told_and_leaves_others_alone) {
    Tried ours = try_context(on(GetParam()));
    if (!ours.context) {
        GTEST_SKIP() << ours.reason;
    }
    const ForeignEgl egl;
    ASSERT_NE(egl.library, nullptr);
    void* display = nullptr;
    void* handle = nullptr;
    std::optional<Buffer> buffer;
    {
        const Current current(*ours.context);
        display = egl.current_display();
        handle = egl.current_context();
        buffer.emplace(ours.context->api(), GL_ARRAY_BUFFER);
    }
    ASSERT_NE(egl.terminate(display), 0U);
    EXPECT_THROW(const Current current(*ours.context), ContextLost);

    // A context of other code often has the same address then: it must be neither drawn on nor destroyed.
    ASSERT_NE(egl.initialize(display, nullptr, nullptr), 0U);
    const unsigned api_before = egl.query_api();
    ASSERT_NE(egl.bind_api(opengl), 0U);
    std::vector<void*> foreign;
    do {
        foreign.push_back(egl.make(display, 3));
        ASSERT_NE(foreign.back(), nullptr);
    } while (foreign.back() != handle && foreign.size() < 20);
    EXPECT_THROW(const Current current(*ours.context), ContextLost);
    EXPECT_EQ(egl.current_context(), nullptr);
    ours.context->forget_objects();
    buffer.reset();
    ours.context.reset();
    for (void* each : foreign) {
        EXPECT_NE(egl.make_current(display, nullptr, nullptr, each), 0U);
        egl.make_current(display, nullptr, nullptr, nullptr);
        EXPECT_NE(egl.destroy(display, each), 0U);
    }
    egl.bind_api(api_before);

    ASSERT_NE(egl.terminate(display), 0U);
    const Tried again = try_context(on(GetParam()));
    ASSERT_NE(again.context, nullptr) << again.reason;
    const Current current(*again.context);
    EXPECT_TRUE(clears_and_reads_back(again.context->api(), {1.0F, 2.0F, 3.0F, 4.0F}));
    RecordProperty("same_address", foreign.back() == handle ? "yes" : "no");
}

TEST(ContextChoice, names_that_are_none) {
    const std::string by_option = message_of<InvalidInput>([] { (void)Context::create(on("glx")); });
    EXPECT_TRUE(contains(by_option, "\"glx\""));
    EXPECT_TRUE(contains(by_option, "auto, egl, surfaceless or osmesa"));

    const Variable variable("SHEETSPLAT_GL", "vulkan");
    const std::string by_variable = message_of<InvalidInput>([] { (void)Context::create(); });
    EXPECT_TRUE(contains(by_variable, "SHEETSPLAT_GL = \"vulkan\""));
    EXPECT_TRUE(contains(by_variable, "auto, egl, surfaceless or osmesa"));
}

TEST(ContextChoice, the_environment_chooses_where_options_leave_it_open) {
    const Variable variable("SHEETSPLAT_GL", "surfaceless");
    const Tried by_variable = try_context();
    const Tried by_option = try_context(on("osmesa"));
    if (!by_variable.context || !by_option.context) {
        GTEST_SKIP() << by_variable.reason << by_option.reason;
    }
    EXPECT_EQ(by_variable.context->capabilities().platform, "surfaceless");
    EXPECT_EQ(by_option.context->capabilities().platform, "osmesa");
}

TEST(ContextChoice, device_numbers) {
    if (!try_context(on("egl")).context) {
        GTEST_SKIP() << try_context(on("egl")).reason;
    }
    ContextOptions options;
    options.egl_device = 9999;
    const std::string by_option = message_of<InvalidInput>([&] { (void)Context::create(options); });
    EXPECT_TRUE(contains(by_option, "9999"));
    EXPECT_TRUE(contains(by_option, "one of 0 ("));
    options.egl_device = -1;
    EXPECT_TRUE(contains(message_of<InvalidInput>([&] { (void)Context::create(options); }), "-1"));

    options.egl_device = 0;
    options.platform = "osmesa";
    EXPECT_TRUE(contains(message_of<InvalidInput>([&] { (void)Context::create(options); }), "platform osmesa"));

    for (const char* wrong : {"first", "1x", "-2", "99999999999999999999"}) {
        const Variable variable("SHEETSPLAT_EGL_DEVICE", wrong);
        EXPECT_TRUE(contains(message_of<InvalidInput>([] { (void)Context::create(); }), wrong));
        EXPECT_TRUE(contains(message_of<InvalidInput>([] { (void)Context::create(); }), "SHEETSPLAT_EGL_DEVICE"));
    }
    const Variable variable("SHEETSPLAT_EGL_DEVICE", "777");
    EXPECT_TRUE(contains(message_of<InvalidInput>([] { (void)Context::create(); }), "777"));
    // The option comes before the variable.
    options = ContextOptions{};
    options.egl_device = 0;
    const Tried tried = try_context(options);
    EXPECT_TRUE(tried.context == nullptr || tried.context->capabilities().platform == "egl");
}

TEST(ContextChoice, what_cannot_be_had_is_told_with_the_next_step) {
    const Variable platform("SHEETSPLAT_GL", "osmesa");
    const Variable library("SHEETSPLAT_OSMESA", "/nowhere/libOSMesa.so");
    const std::string text = message_of<DeviceUnavailable>([] { (void)Context::create(); });
    EXPECT_TRUE(contains(text, "osmesa: "));
    EXPECT_TRUE(contains(text, "/nowhere/libOSMesa.so"));
    EXPECT_TRUE(contains(text, "set SHEETSPLAT_OSMESA"));
    EXPECT_TRUE(contains(text, "OpenGL 3.3"));
    EXPECT_FALSE(contains(text, "surfaceless: "));
}

TEST(ContextChoice, a_library_that_is_no_osmesa) {
    const Variable platform("SHEETSPLAT_GL", "osmesa");
    const Variable library("SHEETSPLAT_OSMESA", "libm.so.6");
    EXPECT_TRUE(contains(message_of<DeviceUnavailable>([] { (void)Context::create(); }), "OSMesaCreateContextAttribs"));
}

void print_why_there_is_no_context() {
    // Read by the vendor-neutral EGL when it is first used, hence in a process of its own.
    setenv("__EGL_VENDOR_LIBRARY_FILENAMES", "/nowhere/vendor.json", 1);
    setenv("SHEETSPLAT_OSMESA", "/nowhere/libOSMesa.so", 1);
    unsetenv("SHEETSPLAT_GL");
    unsetenv("SHEETSPLAT_EGL_DEVICE");
    try {
        (void)Context::create();
        std::fputs("a context was made\n", stderr);
    } catch (const DeviceUnavailable& error) {
        std::string line = error.what();
        std::replace(line.begin(), line.end(), '\n', ' ');
        std::fprintf(stderr, "%s\n", line.c_str());
    }
    std::exit(0);
}

TEST(ContextChoiceDeathTest, every_try_is_listed_where_nothing_works) {
    ::testing::GTEST_FLAG(death_test_style) = "threadsafe";
    EXPECT_EXIT(print_why_there_is_no_context(), ::testing::ExitedWithCode(0),
                "no OpenGL context could be made.*egl: .*surfaceless: .*osmesa: .*/nowhere/libOSMesa.so.*OpenGL 3.3");
}

TEST(Survey, reports_every_platform_and_never_throws) {
    const Variable nonsense("SHEETSPLAT_GL", "nonsense");
    const Variable device("SHEETSPLAT_EGL_DEVICE", "nonsense");
    const Variable library("SHEETSPLAT_OSMESA", "/nowhere/libOSMesa.so");
    const std::vector<Attempt> attempts = Context::survey();
    for (const char* platform : {"egl", "surfaceless", "osmesa"}) {
        const auto found =
            std::find_if(attempts.begin(), attempts.end(), [&](const Attempt& a) { return a.platform == platform; });
        ASSERT_NE(found, attempts.end()) << platform;
        EXPECT_FALSE(found->story.empty()) << platform;
        EXPECT_EQ(found->succeeded, !found->capabilities.renderer.empty()) << found->story;
    }
    EXPECT_FALSE(attempts.back().succeeded);
    EXPECT_TRUE(contains(attempts.back().story, "/nowhere/libOSMesa.so"));
}

TEST(Survey, does_not_throw_for_a_wrong_disable_list) {
    const Variable list("SHEETSPLAT_GL_DISABLE", "nonsense");
    for (const Attempt& attempt : Context::survey()) {
        EXPECT_FALSE(attempt.succeeded);
    }
}

TEST(Disable, takes_capabilities_away) {
    const Tried all = try_context();
    if (!all.context) {
        GTEST_SKIP() << all.reason;
    }
    const Variable list("SHEETSPLAT_GL_DISABLE", "texture_barrier,depth_bounds,float32_blend,debug_output");
    const std::unique_ptr<Context> some = Context::create();
    const Capabilities& c = some->capabilities();
    EXPECT_TRUE(all.context->capabilities().texture_barrier || all.context->capabilities().depth_bounds);
    EXPECT_FALSE(c.texture_barrier || c.depth_bounds || c.float32_blend || c.debug_output);
    EXPECT_NE(std::find(c.workarounds.begin(), c.workarounds.end(), "no_float32_blend"), c.workarounds.end());
}

TEST(Disable, names_that_are_none) {
    if (!try_context().context) {
        GTEST_SKIP() << "no OpenGL here";
    }
    const Variable list("SHEETSPLAT_GL_DISABLE", "depth_bounds,colours");
    const std::string text = message_of<InvalidInput>([] { (void)Context::create(); });
    EXPECT_TRUE(contains(text, "\"colours\""));
    EXPECT_TRUE(contains(text, "depth_bounds"));
}

TEST_P(EachPlatform, debug_contexts_keep_errors) {
    ContextOptions options = on(GetParam());
    options.debug = true;
    const Tried tried = try_context(options);
    if (!tried.context) {
        GTEST_SKIP() << tried.reason;
    }
    Context& context = *tried.context;
    if (!context.capabilities().debug_output) {
        GTEST_SKIP() << "no KHR_debug";
    }
    const Current current(context);
    EXPECT_TRUE(clears_and_reads_back(context.api(), {1.0F, 0.0F, 0.0F, 0.0F}));
    EXPECT_TRUE(context.take_debug_errors().empty());
    context.api().Enable(0xFFFF);
    const std::vector<std::string> errors = context.take_debug_errors();
    ASSERT_EQ(errors.size(), 1U);
    EXPECT_TRUE(contains(errors[0], "glEnable"));
    EXPECT_TRUE(context.take_debug_errors().empty());
    EXPECT_EQ(context.api().GetError(), static_cast<GLenum>(GL_INVALID_ENUM));
    for (int i = 0; i < 1000; ++i) {
        context.api().Enable(0xFFFF);
    }
    EXPECT_LE(context.take_debug_errors().size(), 100U);
}

TEST(Debug, by_the_environment_and_not_otherwise) {
    const Variable off("SHEETSPLAT_GL_DEBUG", nullptr);
    const Tried plain = try_context();
    if (!plain.context || !plain.context->capabilities().debug_output) {
        GTEST_SKIP() << plain.reason;
    }
    {
        const Current current(*plain.context);
        plain.context->api().Enable(0xFFFF);
        EXPECT_TRUE(plain.context->take_debug_errors().empty());
    }
    const Variable set("SHEETSPLAT_GL_DEBUG", "1");
    const std::unique_ptr<Context> debugging = Context::create();
    const Current current(*debugging);
    debugging->api().Enable(0xFFFF);
    EXPECT_EQ(debugging->take_debug_errors().size(), 1U);
}

class Errors : public WithContext {};

TEST_F(Errors, are_named) {
    EXPECT_NO_THROW(check_errors(gl(), "nothing wrong"));
    gl().Enable(0xFFFF);
    const std::string text = message_of<Error>([&] { check_errors(gl(), "a wrong call on purpose"); });
    EXPECT_TRUE(contains(text, "GL_INVALID_ENUM"));
    EXPECT_TRUE(contains(text, "a wrong call on purpose"));
    EXPECT_NO_THROW(check_errors(gl(), "taken"));
}

class Probed : public WithContext {
  protected:
    // start + `count` times `value`, blended one after the other, by triangles (the layer itself measures by points).
    // Each sum is read, and so stored: softpipe keeps tiles in 32 bits between draws.
    float summed(GLenum format, float start, float value, int count) const {
        const Texture target(gl(), format, 2, 2);
        const Framebuffer framebuffer(gl(), {&target});
        const VertexArray vertices(gl());
        const Program program(gl(), plain_files(), "all.vert", "value.frag", {}, glsl_330, {"color"});
        framebuffer.bind();
        vertices.bind();
        program.use();
        program.set("value", value, value, value, value);
        gl().Viewport(0, 0, 2, 2);
        gl().ClearColor(start, start, start, start);
        gl().Clear(GL_COLOR_BUFFER_BIT);
        gl().Enable(GL_BLEND);
        gl().BlendFunc(GL_ONE, GL_ONE);
        for (int i = 0; i < count; ++i) {
            gl().DrawArrays(GL_TRIANGLES, 0, 3);
            (void)pixels(2, 2);
        }
        gl().Disable(GL_BLEND);
        return pixels(2, 2)[0];
    }
};

TEST_F(Probed, float32_sums) {
    if (!capabilities().float32_blend) {
        GTEST_SKIP() << "no blending of 32-bit floats";
    }
    constexpr float part = 1.0F + 1.0F / 65536.0F;
    EXPECT_EQ(summed(GL_RGBA32F, 0.0F, part, 64), 64.0F * part);
    EXPECT_NE(summed(GL_RGBA32F, 0.0F, part, 63), 64.0F * part);
}

TEST_F(Probed, float16_sums_are_dark_exactly_where_it_says_so) {
    // Between 0.5 and 1 a float16's step is 1/2048. Of 2.75 steps at a time, rounding keeps 3 and cutting off keeps 2.
    constexpr int count = 100;
    constexpr float step = 1.0F / 2048.0F;
    const float steps = (summed(GL_RGBA16F, 0.5F, 2.75F * step, count) - 0.5F) / step;
    EXPECT_EQ(steps, capabilities().float16_blend_rounds ? 3.0F * count : 2.0F * count);
}

TEST_F(Probed, points) {
    const SourceFiles files = {{"point.vert",
                                "uniform vec2 place;\nuniform float size;\n"
                                "void main() { gl_Position = vec4(place, 0.0, 1.0); gl_PointSize = size; }\n"},
                               {"white.frag", "out vec4 color;\nvoid main() { color = vec4(1.0); }\n"}};
    constexpr int edge = 32;
    const Texture target(gl(), GL_RGBA8, edge, edge);
    const Framebuffer framebuffer(gl(), {&target});
    const VertexArray vertices(gl());
    const Program program(gl(), files, "point.vert", "white.frag", {}, glsl_330, {"color"});
    framebuffer.bind();
    vertices.bind();
    program.use();
    gl().Enable(GL_PROGRAM_POINT_SIZE);
    gl().ClearColor(0.0F, 0.0F, 0.0F, 0.0F);
    const auto drawn = [&](float x, float y, float size) {
        gl().Clear(GL_COLOR_BUFFER_BIT);
        program.set("place", x, y);
        program.set("size", size);
        gl().DrawArrays(GL_POINTS, 0, 1);
        double sum = 0.0;
        for (const float value : pixels(edge, edge)) {
            sum += static_cast<double>(value) / 4.0;
        }
        return static_cast<int>(sum + 0.5);
    };
    // Its centre one pixel above the upper edge: 7 of its 16 rows lie inside.
    gl().Viewport(0, 0, edge, edge);
    EXPECT_EQ(drawn(0.0F, 1.0F + 2.0F / edge, 16.0F), capabilities().points_reach_in ? 7 * 16 : 0);
    // With a viewport that is wider by the radius on every side it is drawn in any case.
    gl().Viewport(-8, -8, edge + 16, edge + 16);
    EXPECT_EQ(drawn(0.0F, 34.0F / (edge + 16), 16.0F), 7 * 16);
    // The largest point covers the whole target from far away, and the one beyond it would not be larger.
    const float largest = capabilities().max_point_size;
    const int reach = static_cast<int>(largest);
    ASSERT_GT(reach, edge);
    gl().Viewport(-reach, 0, reach + edge, edge);
    EXPECT_EQ(
        drawn(2.0F * (16.25F - largest / 2.0F + static_cast<float>(reach)) / static_cast<float>(reach + edge) - 1.0F,
              0.0F, largest),
        16 * edge);
}

} // namespace
} // namespace sheetsplat::gl::testing

// What the tests of the device layer share.
#pragma once

#include <array>
#include <cstdlib>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "gl/context.hpp"
#include "gl/objects.hpp"
#include "gl/program.hpp"
#include "sheetsplat/error.hpp"

namespace sheetsplat::gl::testing {

/// Sets an environment variable (nullptr: unsets it) until it goes out of scope.
class Variable {
  public:
    Variable(const char* name, const char* value) : name_(name) {
        const char* before = std::getenv(name);
        if (before != nullptr) {
            before_ = before;
        }
        set(value);
    }
    ~Variable() { set(before_ ? before_->c_str() : nullptr); }
    Variable(const Variable&) = delete;
    Variable& operator=(const Variable&) = delete;

  private:
    void set(const char* value) const {
        if (value != nullptr) {
            setenv(name_, value, 1);
        } else {
            unsetenv(name_);
        }
    }
    const char* name_;
    std::optional<std::string> before_;
};

/// A context, or none with the reason.
struct Tried {
    std::unique_ptr<Context> context;
    std::string reason;
};

inline Tried try_context(const ContextOptions& options = {}) {
    Tried tried;
    try {
        tried.context = Context::create(options);
    } catch (const DeviceUnavailable& error) {
        tried.reason = error.what();
    }
    return tried;
}

inline ContextOptions on(const std::string& platform) {
    ContextOptions options;
    options.platform = platform;
    return options;
}

/// What `action` throws as `E`; "" with a failure where it throws nothing or something else.
template <class E, class Action>
std::string message_of(Action action) {
    try {
        action();
    } catch (const E& error) {
        return error.what();
    } catch (const std::exception& error) {
        ADD_FAILURE() << "threw something else: " << error.what();
        return {};
    }
    ADD_FAILURE() << "threw nothing";
    return {};
}

inline ::testing::AssertionResult contains(const std::string& text, const std::string& part) {
    if (text.find(part) != std::string::npos) {
        return ::testing::AssertionSuccess();
    }
    return ::testing::AssertionFailure() << "no \"" << part << "\" in:\n" << text;
}

/// A fixture with a context that is current.
class WithContext : public ::testing::Test {
  protected:
    void SetUp() override {
        tried_ = try_context();
        if (!tried_.context) {
            GTEST_SKIP() << tried_.reason;
        }
        current_.emplace(*tried_.context);
    }
    [[nodiscard]] const Api& gl() const { return tried_.context->api(); }
    [[nodiscard]] const Capabilities& capabilities() const { return tried_.context->capabilities(); }
    [[nodiscard]] Context& context() const { return *tried_.context; }

    /// RGBA of every pixel of the bound framebuffer's attachment, rows upwards.
    [[nodiscard]] std::vector<float> pixels(int width, int height, int attachment = 0) const {
        std::vector<float> values(static_cast<std::size_t>(width) * static_cast<std::size_t>(height) * 4);
        gl().PixelStorei(GL_PACK_ALIGNMENT, 1);
        gl().ReadBuffer(static_cast<GLenum>(GL_COLOR_ATTACHMENT0 + attachment));
        gl().ReadPixels(0, 0, width, height, GL_RGBA, GL_FLOAT, values.data());
        return values;
    }

  private:
    Tried tried_;
    std::optional<Current> current_;
};

/// A triangle over the whole viewport at depth `depth` (0 to 1), and a fragment shader that writes `value`.
inline const SourceFiles& plain_files() {
    static const SourceFiles files = {
        {"all.vert", "uniform float depth;\n"
                     "void main() {\n"
                     "    vec2 corner = vec2(gl_VertexID == 1 ? 3.0 : -1.0, gl_VertexID == 2 ? 3.0 : -1.0);\n"
                     "    gl_Position = vec4(corner, 2.0 * depth - 1.0, 1.0);\n"
                     "}\n"},
        {"value.frag", "uniform vec4 value;\nout vec4 color;\nvoid main() { color = value; }\n"},
    };
    return files;
}

constexpr const char* glsl_330 = "#version 330 core";

/// Clears a texture of a few pixels in the current context and says whether every pixel reads back as cleared.
inline bool clears_and_reads_back(const Api& gl, const std::array<float, 4>& color) {
    const Texture texture(gl, GL_RGBA32F, 5, 3);
    const Framebuffer framebuffer(gl, {&texture});
    framebuffer.bind();
    gl.Viewport(0, 0, 5, 3);
    gl.ClearColor(color[0], color[1], color[2], color[3]);
    gl.Clear(GL_COLOR_BUFFER_BIT);
    std::array<float, 60> values{};
    gl.ReadPixels(0, 0, 5, 3, GL_RGBA, GL_FLOAT, values.data());
    bool same = true;
    for (std::size_t i = 0; i < values.size(); ++i) {
        same = same && values[i] == color[i % 4];
    }
    check_errors(gl, "clearing and reading back");
    return same;
}

} // namespace sheetsplat::gl::testing

// Vertex stages whose outputs stay on the device, and buffers that shaders fetch from.
#include "gl_tests.hpp"

#include <cmath>
#include <cstring>

namespace sheetsplat::gl::testing {
namespace {

constexpr const char* glsl_410 = "#version 410 core";

class Feedback : public WithContext {
  protected:
    /// Runs a capturing program over points and returns what it wrote, `floats` a point.
    [[nodiscard]] std::vector<float> captured(const Program& program, int points, std::size_t floats,
                                              Buffer& output) const {
        const std::size_t bytes = static_cast<std::size_t>(points) * floats * sizeof(float);
        static_cast<void>(output.map(bytes));
        output.unmap();
        const VertexArray vertices(gl());
        const Texture pixel(gl(), GL_RGBA8, 1, 1);
        const Framebuffer nowhere(gl(), {&pixel});
        nowhere.bind();
        vertices.bind();
        program.use();
        gl().BindBufferBase(GL_TRANSFORM_FEEDBACK_BUFFER, 0, output.name());
        gl().Enable(GL_RASTERIZER_DISCARD);
        gl().BeginTransformFeedback(GL_POINTS);
        gl().DrawArrays(GL_POINTS, 0, points);
        gl().EndTransformFeedback();
        gl().Disable(GL_RASTERIZER_DISCARD);
        gl().BindBufferBase(GL_TRANSFORM_FEEDBACK_BUFFER, 0, 0);
        std::vector<float> values(bytes / sizeof(float));
        output.bind();
        gl().GetBufferSubData(GL_ARRAY_BUFFER, 0, static_cast<GLsizeiptr>(bytes), values.data());
        check_errors(gl(), "capturing");
        return values;
    }
};

const SourceFiles& counting_files() {
    static const SourceFiles files = {
        {"count.vert", "#include \"lib/scale.glsl\"\n"
                       "out vec4 first;\nout vec2 second;\nout float third;\n"
                       "void main() {\n"
                       "    float n = float(gl_VertexID) * scale();\n"
                       "    first = vec4(n, n + 0.25, n + 0.5, n + 0.75);\n"
                       "    second = vec2(-n, 100.0 + n);\n"
                       "    third = 7.0;\n"
                       "}\n"},
        {"lib/scale.glsl", "uniform float factor;\nfloat scale() { return factor * SCALE; }\n"},
        {"fetch.frag", "uniform samplerBuffer numbers;\nuniform int at;\nout vec4 color;\n"
                       "void main() { color = texelFetch(numbers, at + int(gl_FragCoord.x)); }\n"}};
    return files;
}

TEST_F(Feedback, outputs_are_captured_one_after_another_in_the_order_that_is_asked_for) {
    Buffer output(gl(), GL_ARRAY_BUFFER);
    for (const bool swapped : {false, true}) {
        const std::vector<std::string> names =
            swapped ? std::vector<std::string>{"second", "first"} : std::vector<std::string>{"first", "second"};
        const Program program =
            Program::capturing(gl(), counting_files(), "count.vert", {{"SCALE", "2.0"}}, glsl_330, names);
        EXPECT_TRUE(program);
        program.use();
        program.set("factor", 1.5F);
        const std::vector<float> values = captured(program, 5, 6, output);
        ASSERT_EQ(values.size(), 30U);
        for (std::size_t point = 0; point < 5; ++point) {
            const float n = 3.0F * static_cast<float>(point);
            const float* first = values.data() + 6 * point + (swapped ? 2 : 0);
            const float* second = values.data() + 6 * point + (swapped ? 0 : 4);
            for (int part = 0; part < 4; ++part) {
                EXPECT_EQ(first[part], n + 0.25F * static_cast<float>(part));
            }
            EXPECT_EQ(second[0], -n);
            EXPECT_EQ(second[1], 100.0F + n);
        }
    }
}

TEST_F(Feedback, errors_name_the_file_and_what_cannot_be_captured) {
    const std::string text = message_of<Error>([&] {
        static_cast<void>(Program::capturing(gl(), counting_files(), "count.vert", {{"SCALE", "1.0"}}, glsl_330,
                                             {"first", "fourth"}));
    });
    EXPECT_TRUE(contains(text, "count.vert"));
    SourceFiles wrong = counting_files();
    wrong["lib/scale.glsl"] = "uniform float factor;\nfloat scale() { return nobody; }\n";
    const std::string compiled = message_of<Error>([&] {
        static_cast<void>(Program::capturing(gl(), wrong, "count.vert", {{"SCALE", "1.0"}}, glsl_330, {"first"}));
    });
    EXPECT_TRUE(contains(compiled, "lib/scale.glsl"));
    EXPECT_TRUE(contains(compiled, "nobody"));
    EXPECT_NO_THROW(check_errors(gl(), "refusing"));
}

TEST_F(Feedback, float64_uniforms_keep_their_digits) {
    if (!capabilities().at_least(4, 1)) {
        GTEST_SKIP() << "OpenGL " << capabilities().version << " has no float64 vertex programs";
    }
    const SourceFiles files = {{"exact.vert", "uniform double one;\nuniform dvec3 three;\n"
                                              "out vec4 rest;\n"
                                              "void main() {\n"
                                              "    rest = vec4(float(one - 1.0), vec3(three - dvec3(1.0, 2.0, 3.0)));\n"
                                              "}\n"}};
    const Program program = Program::capturing(gl(), files, "exact.vert", {}, glsl_410, {"rest"});
    program.use();
    program.set("one", 1.0 + std::ldexp(1.0, -40));
    program.set("three", 1.0 + std::ldexp(1.0, -41), 2.0 + std::ldexp(1.0, -42), 3.0 + std::ldexp(1.0, -43));
    Buffer output(gl(), GL_ARRAY_BUFFER);
    const std::vector<float> values = captured(program, 1, 4, output);
    for (int part = 0; part < 4; ++part) {
        EXPECT_EQ(values[static_cast<std::size_t>(part)], std::ldexp(1.0F, -40 - part));
    }
}

TEST_F(Feedback, a_buffer_texture_shows_the_buffers_bytes) {
    Buffer buffer(gl(), GL_ARRAY_BUFFER);
    std::vector<float> numbers(4 * 10);
    for (std::size_t n = 0; n < numbers.size(); ++n) {
        numbers[n] = 1000.0F + 0.5F * static_cast<float>(n);
    }
    buffer.upload(numbers.data(), numbers.size() * sizeof(float));
    const BufferTexture texture(gl(), GL_RGBA32F, buffer);
    SourceFiles files = counting_files();
    files.insert(plain_files().begin(), plain_files().end());
    const Program program(gl(), files, "all.vert", "fetch.frag", {}, glsl_330, {"color"});
    const Texture target(gl(), GL_RGBA32F, 3, 1);
    const Framebuffer framebuffer(gl(), {&target});
    const VertexArray vertices(gl());
    const auto fetched = [&](int at) {
        framebuffer.bind();
        vertices.bind();
        program.use();
        program.set("numbers", 5);
        program.set("at", at);
        texture.bind(5);
        gl().Viewport(0, 0, 3, 1);
        gl().DrawArrays(GL_TRIANGLES, 0, 3);
        return pixels(3, 1);
    };
    EXPECT_EQ(fetched(0), std::vector<float>(numbers.begin(), numbers.begin() + 12));
    EXPECT_EQ(fetched(7), std::vector<float>(numbers.begin() + 28, numbers.end()));
    if (capabilities().renderer.find("softpipe") != std::string::npos) {
        // It goes on showing texels that it has read once; nothing that is drawn there changes a buffer behind a
        // texture.
        return;
    }
    // What is written to the buffer later is what shaders see then.
    for (float& number : numbers) {
        number = -number;
    }
    buffer.bind();
    gl().BufferSubData(GL_ARRAY_BUFFER, 0, static_cast<GLsizeiptr>(numbers.size() * sizeof(float)), numbers.data());
    EXPECT_EQ(fetched(2), std::vector<float>(numbers.begin() + 8, numbers.begin() + 20));
    EXPECT_NO_THROW(check_errors(gl(), "fetching"));
}

TEST_F(Feedback, what_is_captured_can_be_fetched) {
    Buffer output(gl(), GL_ARRAY_BUFFER);
    const Program counting =
        Program::capturing(gl(), counting_files(), "count.vert", {{"SCALE", "1.0"}}, glsl_330, {"first"});
    counting.use();
    counting.set("factor", 1.0F);
    const std::vector<float> values = captured(counting, 6, 4, output);
    const BufferTexture texture(gl(), GL_RGBA32F, output);
    SourceFiles files = counting_files();
    files.insert(plain_files().begin(), plain_files().end());
    const Program program(gl(), files, "all.vert", "fetch.frag", {}, glsl_330, {"color"});
    const Texture target(gl(), GL_RGBA32F, 6, 1);
    const Framebuffer framebuffer(gl(), {&target});
    const VertexArray vertices(gl());
    framebuffer.bind();
    vertices.bind();
    program.use();
    program.set("numbers", 0);
    program.set("at", 0);
    texture.bind(0);
    gl().Viewport(0, 0, 6, 1);
    gl().DrawArrays(GL_TRIANGLES, 0, 3);
    EXPECT_EQ(pixels(6, 1), values);
    EXPECT_EQ(values[20], 5.0F);
}

} // namespace
} // namespace sheetsplat::gl::testing

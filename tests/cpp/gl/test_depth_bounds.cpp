// EXT_depth_bounds_test where the device has it. Mesa's softpipe does: gl.on_softpipe runs these tests with that
// driver.
#include "gl_tests.hpp"

namespace sheetsplat::gl::testing {
namespace {

class DepthBounds : public WithContext {};

TEST_F(DepthBounds, test_the_depth_that_is_stored_and_cull_for_real) {
    if (!capabilities().depth_bounds) {
        GTEST_SKIP() << capabilities().renderer << " has no GL_EXT_depth_bounds_test";
    }
    const Texture color(gl(), GL_RGBA32F, 4, 1);
    const Texture depth(gl(), GL_DEPTH_COMPONENT32F, 4, 1);
    const Framebuffer framebuffer(gl(), {&color}, &depth);
    const VertexArray vertices(gl());
    const Program program(gl(), plain_files(), "all.vert", "value.frag", {}, glsl_330, {"color"});
    framebuffer.bind();
    vertices.bind();
    program.use();
    gl().Viewport(0, 0, 4, 1);
    gl().ClearColor(0.0F, 0.0F, 0.0F, 0.0F);
    gl().Clear(GL_COLOR_BUFFER_BIT);
    gl().Enable(GL_SCISSOR_TEST);
    const std::array<double, 4> stored = {0.125, 0.25, 0.5, 0.75};
    for (std::size_t x = 0; x < stored.size(); ++x) {
        gl().Scissor(static_cast<GLint>(x), 0, 1, 1);
        gl().ClearDepth(stored[x]);
        gl().Clear(GL_DEPTH_BUFFER_BIT);
    }
    gl().Disable(GL_SCISSOR_TEST);

    const auto drawn = [&] {
        gl().Clear(GL_COLOR_BUFFER_BIT);
        GLuint query = 0;
        gl().GenQueries(1, &query);
        gl().BeginQuery(GL_SAMPLES_PASSED, query);
        gl().DrawArrays(GL_TRIANGLES, 0, 3);
        gl().EndQuery(GL_SAMPLES_PASSED);
        GLuint passed = 0;
        gl().GetQueryObjectuiv(query, GL_QUERY_RESULT, &passed);
        gl().DeleteQueries(1, &query);
        std::string seen;
        const std::vector<float> all = pixels(4, 1);
        for (std::size_t x = 0; x < stored.size(); ++x) {
            seen += all[4 * x] == 1.0F ? '1' : '0';
        }
        return seen + " " + std::to_string(passed);
    };
    program.set("value", 1.0F, 1.0F, 1.0F, 1.0F);
    program.set("depth", 0.9F); // far from every bound: it is not the fragment's depth that counts
    gl().DepthBoundsEXT(0.25, 0.5);
    gl().Disable(GL_DEPTH_BOUNDS_TEST_EXT);
    EXPECT_EQ(drawn(), "1111 4");
    gl().Enable(GL_DEPTH_BOUNDS_TEST_EXT);
    EXPECT_EQ(drawn(), "0110 2");
    gl().DepthBoundsEXT(0.0, 0.1875);
    EXPECT_EQ(drawn(), "1000 1");
    gl().DepthBoundsEXT(0.76, 1.0);
    EXPECT_EQ(drawn(), "0000 0");
    EXPECT_NO_THROW(check_errors(gl(), "depth bounds"));
}

TEST_F(DepthBounds, are_where_they_are_said_to_be) {
    if (capabilities().renderer.find("softpipe") == std::string::npos) {
        GTEST_SKIP() << "the driver is not softpipe but " << capabilities().renderer;
    }
    EXPECT_TRUE(capabilities().depth_bounds);
    EXPECT_EQ(capabilities().version_major, 3);
    EXPECT_EQ(capabilities().version_minor, 3);
    const auto* language = reinterpret_cast<const char*>(gl().GetString(GL_SHADING_LANGUAGE_VERSION));
    EXPECT_EQ(std::string(language).substr(0, 4), "3.30");
}

} // namespace
} // namespace sheetsplat::gl::testing

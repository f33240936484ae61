// Times of stages, by queries and by the clock.
#include "gl/timer.hpp"
#include "gl_tests.hpp"

#include <thread>

namespace sheetsplat::gl::testing {
namespace {

class Timer : public WithContext {
  protected:
    // Some work for the device: the whole of a texture, many times.
    void draw(int times) const {
        const Texture target(gl(), GL_RGBA32F, 256, 256);
        const Framebuffer framebuffer(gl(), {&target});
        const VertexArray vertices(gl());
        const Program program(gl(), plain_files(), "all.vert", "value.frag", {}, glsl_330, {"color"});
        framebuffer.bind();
        vertices.bind();
        program.use();
        gl().Viewport(0, 0, 256, 256);
        for (int i = 0; i < times; ++i) {
            gl().DrawArrays(GL_TRIANGLES, 0, 3);
        }
    }
    [[nodiscard]] Capabilities as_hardware() const {
        Capabilities c = capabilities();
        c.software = false;
        return c;
    }
};

TEST_F(Timer, does_nothing_unless_enabled) {
    StageTimer timer(gl(), as_hardware(), false);
    timer.begin("a");
    timer.end();
    timer.begin("b");
    EXPECT_TRUE(timer.seconds().empty());
    GLint query = -1;
    gl().GetQueryiv(GL_TIME_ELAPSED, GL_CURRENT_QUERY, &query);
    EXPECT_EQ(query, 0);
}

TEST_F(Timer, queries_of_stages_that_follow_one_another) {
    if (!capabilities().timer_query) {
        GTEST_SKIP() << "no timer queries";
    }
    StageTimer timer(gl(), as_hardware(), true);
    for (int i = 0; i < 20; ++i) {
        timer.begin("splat");
        draw(20);
        timer.begin("shade"); // ends the one before
        draw(1);
        timer.end();
    }
    const std::map<std::string, double> seconds = timer.seconds();
    ASSERT_EQ(seconds.size(), 2U);
    if (!capabilities().software) { // an answer of llvmpipe is at times the time since the machine was switched on
        EXPECT_GT(seconds.at("shade"), 0.0);
        EXPECT_GT(seconds.at("splat"), seconds.at("shade"));
        EXPECT_LT(seconds.at("splat"), 60.0);
    }
    EXPECT_EQ(timer.seconds(), seconds);
    EXPECT_NO_THROW(check_errors(gl(), "timing"));
}

TEST_F(Timer, asked_while_a_stage_is_open) {
    if (!capabilities().timer_query) {
        GTEST_SKIP() << "no timer queries";
    }
    StageTimer timer(gl(), as_hardware(), true);
    timer.begin("a");
    draw(5);
    timer.begin("b");
    EXPECT_EQ(timer.seconds().count("a"), 1U);
    EXPECT_EQ(timer.seconds().count("b"), 0U);
    draw(5);
    timer.end();
    EXPECT_EQ(timer.seconds().count("b"), 1U);
    EXPECT_NO_THROW(check_errors(gl(), "timing"));
}

TEST_F(Timer, one_that_is_left_open_does_not_block_the_next) {
    if (!capabilities().timer_query) {
        GTEST_SKIP() << "no timer queries";
    }
    {
        StageTimer timer(gl(), as_hardware(), true);
        timer.begin("left open");
    }
    StageTimer timer(gl(), as_hardware(), true);
    timer.begin("a");
    timer.end();
    EXPECT_EQ(timer.seconds().size(), 1U);
    EXPECT_NO_THROW(check_errors(gl(), "timing"));
}

TEST_F(Timer, the_clock_on_software_devices) {
    Capabilities c = capabilities();
    c.software = true;
    StageTimer timer(gl(), c, true);
    timer.begin("sleep");
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
    timer.begin("nothing");
    timer.end();
    GLint query = -1;
    gl().GetQueryiv(GL_TIME_ELAPSED, GL_CURRENT_QUERY, &query);
    EXPECT_EQ(query, 0);
    const std::map<std::string, double> seconds = timer.seconds();
    EXPECT_GE(seconds.at("sleep"), 0.020);
    EXPECT_LT(seconds.at("nothing"), 0.020);
}

TEST_F(Timer, exact_charges_a_stage_for_what_it_asked_for) {
    if (!capabilities().software) {
        GTEST_SKIP() << "a device with a queue is timed by queries";
    }
    // Without exact, drawing is put off until the read-back has to pay for it.
    const auto share_of_drawing = [&](bool exact) {
        StageTimer timer(gl(), capabilities(), true, exact);
        const Texture target(gl(), GL_RGBA32F, 512, 512);
        const Framebuffer framebuffer(gl(), {&target});
        const VertexArray vertices(gl());
        const Program program(gl(), plain_files(), "all.vert", "value.frag", {}, glsl_330, {"color"});
        framebuffer.bind();
        vertices.bind();
        program.use();
        gl().Viewport(0, 0, 512, 512);
        gl().Enable(GL_BLEND);
        gl().BlendFunc(GL_ONE, GL_ONE);
        gl().DrawArrays(GL_TRIANGLES, 0, 3);
        gl().Finish();
        timer.begin("draw");
        for (int i = 0; i < 50; ++i) {
            gl().DrawArrays(GL_TRIANGLES, 0, 3);
        }
        timer.begin("finish");
        gl().Finish();
        timer.end();
        const std::map<std::string, double> seconds = timer.seconds();
        return seconds.at("draw") / (seconds.at("draw") + seconds.at("finish"));
    };
    EXPECT_GT(share_of_drawing(true), 0.9);
    if (capabilities().renderer.find("llvmpipe") != std::string::npos) {
        EXPECT_LT(share_of_drawing(false), 0.9);
    }
}

} // namespace
} // namespace sheetsplat::gl::testing

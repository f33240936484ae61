// Fragments that were drawn.
#include "fragment_counter.hpp"
#include "gl/gl_tests.hpp"

namespace sheetsplat::gl::testing {
namespace {

using lab::FragmentCounter;

class Fragments : public WithContext {
  protected:
    void SetUp() override {
        WithContext::SetUp();
        if (IsSkipped()) {
            return;
        }
        target_ = Texture(gl(), GL_RGBA8, 64, 64);
        depth_ = Texture(gl(), GL_DEPTH_COMPONENT24, 64, 64);
        framebuffer_ = Framebuffer(gl(), {&target_}, &depth_);
        vertices_ = VertexArray(gl());
        program_ = Program(gl(), plain_files(), "all.vert", "value.frag", {}, glsl_330, {"color"});
        framebuffer_.bind();
        vertices_.bind();
        program_.use();
    }
    // Fills a rectangle from the corner on.
    void fill(int width, int height, float depth = 0.5F) const {
        gl().Viewport(0, 0, 64, 64);
        gl().Scissor(0, 0, width, height);
        gl().Enable(GL_SCISSOR_TEST);
        program_.set("depth", depth);
        gl().DrawArrays(GL_TRIANGLES, 0, 3);
        gl().Disable(GL_SCISSOR_TEST);
    }
    void TearDown() override {
        program_ = Program();
        vertices_ = VertexArray();
        framebuffer_ = Framebuffer();
        depth_ = Texture();
        target_ = Texture();
    }

  private:
    Texture target_, depth_;
    Framebuffer framebuffer_;
    VertexArray vertices_;
    Program program_;
};

TEST_F(Fragments, are_counted_between_begin_and_end) {
    FragmentCounter counter(gl());
    EXPECT_EQ(counter.count(), 0U);
    fill(64, 64); // before it begins
    counter.begin();
    fill(10, 7);
    fill(3, 3); // the same pixels once more
    counter.end();
    fill(64, 64); // after it has ended
    EXPECT_EQ(counter.count(), 79U);
    EXPECT_EQ(counter.count(), 79U) << "asked again";
    EXPECT_NO_THROW(check_errors(gl(), "counting"));
}

TEST_F(Fragments, add_up_over_many_stretches) {
    FragmentCounter counter(gl());
    std::uint64_t sum = 0;
    for (int n = 1; n <= 40; ++n) {
        counter.begin();
        fill(n, 2);
        counter.end();
        sum += static_cast<std::uint64_t>(2 * n);
        fill(64, 1);
    }
    counter.begin();
    counter.end();
    EXPECT_EQ(counter.count(), sum);
    EXPECT_NO_THROW(check_errors(gl(), "counting"));
}

TEST_F(Fragments, that_the_depth_test_drops_do_not_count) {
    gl().Enable(GL_DEPTH_TEST);
    gl().DepthFunc(GL_LESS);
    gl().DepthMask(GL_TRUE);
    gl().Clear(GL_DEPTH_BUFFER_BIT);
    FragmentCounter counter(gl());
    counter.begin();
    fill(8, 8, 0.25F);
    fill(16, 8, 0.75F); // half of it lies behind the first
    counter.end();
    gl().Disable(GL_DEPTH_TEST);
    EXPECT_EQ(counter.count(), 128U);
}

TEST_F(Fragments, two_counters_keep_their_own) {
    FragmentCounter first(gl()), second(gl());
    first.begin();
    fill(4, 4);
    first.end();
    second.begin();
    fill(5, 5);
    second.end();
    EXPECT_EQ(first.count(), 16U);
    EXPECT_EQ(second.count(), 25U);
}

} // namespace
} // namespace sheetsplat::gl::testing

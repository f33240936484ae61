// Textures, framebuffers, buffers and read-backs.
#include "gl_tests.hpp"

#include <chrono>
#include <cstring>
#include <numeric>
#include <thread>

namespace sheetsplat::gl::testing {
namespace {

class Objects : public WithContext {};

TEST_F(Objects, texture_has_the_size_and_bytes_of_its_format) {
    const Texture texture(gl(), GL_RGBA16F, 7, 5);
    EXPECT_EQ(texture.width(), 7);
    EXPECT_EQ(texture.height(), 5);
    EXPECT_EQ(texture.internal_format(), static_cast<GLenum>(GL_RGBA16F));
    EXPECT_EQ(texture.bytes(), 7U * 5U * 8U);
    EXPECT_EQ(Texture(gl(), GL_R32I, 3, 3).bytes(), 36U);
    EXPECT_EQ(Texture(gl(), GL_DEPTH_COMPONENT32F, 3, 3).bytes(), 36U);
    EXPECT_EQ(Texture().bytes(), 0U);
    EXPECT_FALSE(Texture());
}

TEST_F(Objects, every_format_of_the_table_can_be_made) {
    for (const GLenum format : {GL_RGBA8, GL_RGBA16F, GL_R32F, GL_RG32F, GL_RGBA32F, GL_R32I, GL_R32UI, GL_RG32I,
                                GL_DEPTH_COMPONENT24, GL_DEPTH_COMPONENT32F}) {
        EXPECT_NO_THROW(Texture(gl(), static_cast<GLenum>(format), 4, 4)) << std::hex << format;
    }
}

TEST_F(Objects, textures_that_cannot_be) {
    EXPECT_TRUE(contains(message_of<InvalidInput>([&] { Texture(gl(), GL_RGBA8, 0, 4); }), "0 x 4"));
    EXPECT_TRUE(contains(message_of<InvalidInput>([&] { Texture(gl(), GL_RGBA8, 4, -1); }), "4 x -1"));
    EXPECT_TRUE(contains(message_of<InvalidInput>([&] { Texture(gl(), GL_RGBA, 4, 4); }), std::to_string(GL_RGBA)));
    const int largest = capabilities().max_texture_size;
    EXPECT_TRUE(
        contains(message_of<Unsupported>([&] { Texture(gl(), GL_R32F, largest + 1, 1); }), std::to_string(largest)));
    EXPECT_EQ(gl().GetError(), static_cast<GLenum>(GL_NO_ERROR));
    EXPECT_NO_THROW(Texture(gl(), GL_R32F, largest, 1));
}

TEST_F(Objects, an_error_from_before_is_not_blamed_on_memory) {
    gl().Enable(0xFFFF);
    EXPECT_TRUE(contains(message_of<Error>([&] { Texture(gl(), GL_RGBA8, 4, 4); }), "before a texture was made"));
}

TEST_F(Objects, texture_upload_and_read_back) {
    std::vector<std::uint8_t> texels(3 * 5 * 4);
    std::iota(texels.begin(), texels.end(), std::uint8_t{7});
    Texture texture(gl(), GL_RGBA8, 3, 5);
    texture.upload(GL_RGBA, GL_UNSIGNED_BYTE, texels.data());
    const Framebuffer framebuffer(gl(), {&texture});
    framebuffer.bind();
    std::vector<std::uint8_t> back(texels.size());
    gl().ReadPixels(0, 0, 3, 5, GL_RGBA, GL_UNSIGNED_BYTE, back.data());
    EXPECT_EQ(back, texels);
    texels[11] = static_cast<std::uint8_t>(texels[11] + 1);
    EXPECT_NE(back, texels);
}

TEST_F(Objects, bindings_survive_the_making_of_others) {
    const Texture first(gl(), GL_RGBA8, 2, 2);
    const Framebuffer bound(gl(), {&first});
    bound.bind();
    for (int unit = 0; unit < capabilities().max_texture_units; ++unit) {
        first.bind(unit);
    }
    Texture second(gl(), GL_RGBA8, 2, 2);
    const std::vector<std::uint8_t> texels(16);
    second.upload(GL_RGBA, GL_UNSIGNED_BYTE, texels.data());
    const Framebuffer other(gl(), {&second});
    GLint framebuffer = 0;
    gl().GetIntegerv(GL_DRAW_FRAMEBUFFER_BINDING, &framebuffer);
    EXPECT_EQ(static_cast<GLuint>(framebuffer), bound.name());
    for (int unit = 0; unit < capabilities().max_texture_units; ++unit) {
        gl().ActiveTexture(static_cast<GLenum>(GL_TEXTURE0 + unit));
        GLint texture = 0;
        gl().GetIntegerv(GL_TEXTURE_BINDING_2D, &texture);
        EXPECT_EQ(static_cast<GLuint>(texture), first.name()) << unit;
    }
}

TEST_F(Objects, moves_leave_nothing_behind_and_delete_once) {
    Texture first(gl(), GL_RGBA8, 2, 2);
    const GLuint name = first.name();
    Texture second(std::move(first));
    EXPECT_FALSE(first); // NOLINT(bugprone-use-after-move): what a move leaves is what is tested
    EXPECT_EQ(second.name(), name);
    first = Texture(gl(), GL_RGBA8, 4, 4);
    const GLuint replaced = first.name();
    first = std::move(second);
    EXPECT_EQ(gl().IsTexture(replaced), GL_FALSE);
    EXPECT_EQ(gl().IsTexture(name), GL_TRUE);
    EXPECT_EQ(first.width(), 2);
    first = Texture();
    EXPECT_EQ(gl().IsTexture(name), GL_FALSE);

    Buffer buffer(gl(), GL_ARRAY_BUFFER);
    buffer.upload("abc", 3);
    const GLuint of_buffer = buffer.name();
    {
        const Buffer taken(std::move(buffer));
        EXPECT_EQ(taken.name(), of_buffer);
        EXPECT_EQ(gl().IsBuffer(of_buffer), GL_TRUE);
    }
    EXPECT_EQ(gl().IsBuffer(of_buffer), GL_FALSE);

    GLuint of_framebuffer = 0;
    {
        const Texture texture(gl(), GL_RGBA8, 2, 2);
        std::vector<Framebuffer> list;
        list.emplace_back(gl(), std::vector<Attachment>{&texture});
        list.emplace_back(gl(), std::vector<Attachment>{&texture});
        list.emplace_back(gl(), std::vector<Attachment>{&texture});
        list[0].bind();
        of_framebuffer = list[0].name();
        EXPECT_EQ(gl().IsFramebuffer(of_framebuffer), GL_TRUE);
    }
    EXPECT_EQ(gl().IsFramebuffer(of_framebuffer), GL_FALSE);
    EXPECT_NO_THROW(check_errors(gl(), "moving"));
}

TEST_F(Objects, framebuffer_draws_to_its_attachments_in_order) {
    const Texture first(gl(), GL_RGBA32F, 2, 2);
    const Texture second(gl(), GL_RGBA32F, 2, 2);
    const Texture depth(gl(), GL_DEPTH_COMPONENT24, 2, 2);
    const Framebuffer framebuffer(gl(), {&first, &second}, &depth);
    framebuffer.bind();
    const std::array<float, 4> one = {1.0F, 1.0F, 1.0F, 1.0F};
    const std::array<float, 4> two = {2.0F, 2.0F, 2.0F, 2.0F};
    gl().ClearBufferfv(GL_COLOR, 0, one.data());
    gl().ClearBufferfv(GL_COLOR, 1, two.data());
    EXPECT_EQ(pixels(2, 2, 0)[5], 1.0F);
    EXPECT_EQ(pixels(2, 2, 1)[5], 2.0F);
    EXPECT_NO_THROW(check_errors(gl(), "drawing to attachments"));
}

TEST_F(Objects, framebuffer_draws_to_layers_of_an_array) {
    const Texture layers(gl(), GL_RGBA32F, 2, 2, 3);
    EXPECT_EQ(layers.layers(), 3);
    EXPECT_EQ(layers.bytes(), 3U * 2U * 2U * 16U);
    std::vector<Framebuffer> each;
    for (int layer = 0; layer < 3; ++layer) {
        each.emplace_back(gl(), std::vector<Attachment>{{&layers, layer}});
    }
    for (int layer = 0; layer < 3; ++layer) {
        const auto value = static_cast<float>(layer + 1);
        const std::array<float, 4> color = {value, value, value, value};
        each[static_cast<std::size_t>(layer)].bind();
        gl().ClearBufferfv(GL_COLOR, 0, color.data());
    }
    for (int layer = 0; layer < 3; ++layer) {
        each[static_cast<std::size_t>(layer)].bind();
        EXPECT_EQ(pixels(2, 2, 0)[5], static_cast<float>(layer + 1));
    }
    EXPECT_NO_THROW(check_errors(gl(), "drawing to layers"));
}

TEST_F(Objects, framebuffer_of_depth_alone) {
    const Texture depth(gl(), GL_DEPTH_COMPONENT32F, 2, 2);
    const Framebuffer framebuffer(gl(), {}, &depth);
    framebuffer.bind();
    gl().ClearDepth(0.375);
    gl().Clear(GL_DEPTH_BUFFER_BIT);
    std::array<float, 4> depths{};
    gl().ReadPixels(0, 0, 2, 2, GL_DEPTH_COMPONENT, GL_FLOAT, depths.data());
    EXPECT_EQ(depths, (std::array<float, 4>{0.375F, 0.375F, 0.375F, 0.375F}));
}

TEST_F(Objects, incomplete_framebuffers_are_told_in_words) {
    const Texture color(gl(), GL_RGBA8, 2, 2);
    const Texture depth(gl(), GL_DEPTH_COMPONENT24, 4, 2);
    const std::string wrong_kind = message_of<Error>([&] { Framebuffer(gl(), {&depth}); });
    EXPECT_TRUE(contains(wrong_kind, "framebuffer is not complete"));
    EXPECT_TRUE(contains(wrong_kind, "GL_DEPTH_COMPONENT24 4 x 2"));
    const std::string color_as_depth = message_of<Error>([&] { Framebuffer(gl(), {&color}, &color); });
    EXPECT_TRUE(contains(color_as_depth, "depth: GL_RGBA8 2 x 2"));
    const std::string nothing = message_of<Error>([&] { Framebuffer(gl(), {}); });
    EXPECT_TRUE(contains(nothing, "it has no attachments"));
    const std::vector<Attachment> many(100, &color);
    EXPECT_TRUE(contains(message_of<Unsupported>([&] { Framebuffer(gl(), many); }), "100"));
    EXPECT_EQ(gl().GetError(), static_cast<GLenum>(GL_NO_ERROR));
}

std::vector<char> contents(const Api& gl, const Buffer& buffer, std::size_t bytes) {
    std::vector<char> text(bytes);
    gl.BindBuffer(GL_COPY_READ_BUFFER, buffer.name());
    gl.GetBufferSubData(GL_COPY_READ_BUFFER, 0, static_cast<GLsizeiptr>(bytes), text.data());
    return text;
}

TEST_F(Objects, buffer_grows_and_keeps_the_last_contents) {
    Buffer buffer(gl(), GL_ARRAY_BUFFER);
    EXPECT_EQ(buffer.capacity(), 0U);
    std::size_t before = 0;
    for (const std::size_t size : {10U, 11U, 5U, 1000U, 100'000U, 3U}) {
        std::vector<char> data(size);
        std::iota(data.begin(), data.end(), static_cast<char>(size % 100));
        buffer.upload(data.data(), data.size());
        EXPECT_GE(buffer.capacity(), size);
        EXPECT_GE(buffer.capacity(), before) << "a buffer does not shrink";
        before = buffer.capacity();
        EXPECT_EQ(contents(gl(), buffer, size), data) << size;
    }
    EXPECT_NO_THROW(buffer.upload(nullptr, 0));
    EXPECT_NO_THROW(check_errors(gl(), "growing a buffer"));
}

TEST_F(Objects, buffer_that_grows_slowly_asks_for_memory_seldom) {
    Buffer buffer(gl(), GL_ARRAY_BUFFER);
    std::size_t growths = 0;
    std::size_t before = 0;
    for (std::size_t size = 1; size <= 4096; ++size) {
        std::memset(buffer.map(size), 0, size);
        buffer.unmap();
        growths += buffer.capacity() != before ? 1 : 0;
        before = buffer.capacity();
    }
    EXPECT_LE(growths, 40U);
    EXPECT_LE(buffer.capacity(), 2U * 4096U);
}

TEST_F(Objects, buffer_mapping_does_not_disturb_the_vertex_array) {
    const VertexArray vertices(gl());
    vertices.bind();
    Buffer indices(gl(), GL_ELEMENT_ARRAY_BUFFER);
    indices.upload("abcd", 4);
    indices.bind();
    Buffer other(gl(), GL_ELEMENT_ARRAY_BUFFER);
    other.upload("abcdefgh", 8);
    GLint bound = 0;
    gl().GetIntegerv(GL_ELEMENT_ARRAY_BUFFER_BINDING, &bound);
    EXPECT_EQ(static_cast<GLuint>(bound), indices.name());
}

TEST_F(Objects, buffer_beyond_all_memory) {
    Buffer buffer(gl(), GL_ARRAY_BUFFER);
    EXPECT_TRUE(contains(message_of<OutOfMemory>([&] { (void)buffer.map(std::size_t{1} << 62U); }),
                         std::to_string(std::size_t{1} << 62U)));
    EXPECT_TRUE(contains(message_of<OutOfMemory>([&] { (void)buffer.map(~std::size_t{0}); }), "bytes"));
    EXPECT_EQ(gl().GetError(), static_cast<GLenum>(GL_NO_ERROR));
    EXPECT_NO_THROW(buffer.upload("usable", 6));
    EXPECT_EQ(contents(gl(), buffer, 6), std::vector<char>({'u', 's', 'a', 'b', 'l', 'e'}));
}

class ReadBack : public WithContext {
  protected:
    // 4 x 3 pixels whose red channel counts from `first`.
    [[nodiscard]] Texture counting(float first) const {
        std::vector<float> texels(4 * 3 * 4);
        for (std::size_t i = 0; i < texels.size(); ++i) {
            texels[i] = first + static_cast<float>(i);
        }
        Texture texture(gl(), GL_RGBA32F, 4, 3);
        texture.upload(GL_RGBA, GL_FLOAT, texels.data());
        return texture;
    }
};

TEST_F(ReadBack, is_the_pixels_without_waiting) {
    const Texture texture = counting(100.0F);
    const Framebuffer framebuffer(gl(), {&texture});
    framebuffer.bind();
    AsyncReadback readback(gl(), 4, 3);
    EXPECT_FALSE(readback.pending());
    EXPECT_FALSE(readback.ready());
    readback.start();
    EXPECT_TRUE(readback.pending());
    std::vector<float> back;
    readback.fetch(back);
    EXPECT_FALSE(readback.pending());
    std::vector<float> expected(4 * 3 * 4);
    std::iota(expected.begin(), expected.end(), 100.0F);
    EXPECT_EQ(back, expected);
    EXPECT_TRUE(contains(message_of<Error>([&] { readback.fetch(back); }), "no read-back was started"));
}

TEST_F(ReadBack, becomes_ready_by_itself) {
    const Texture texture = counting(0.0F);
    const Framebuffer framebuffer(gl(), {&texture});
    framebuffer.bind();
    AsyncReadback readback(gl(), 4, 3);
    readback.start();
    const auto until = std::chrono::steady_clock::now() + std::chrono::seconds(10);
    while (!readback.ready() && std::chrono::steady_clock::now() < until) {
        std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
    EXPECT_TRUE(readback.ready());
    EXPECT_TRUE(readback.pending());
}

TEST_F(ReadBack, two_in_flight_and_moves) {
    const Texture first = counting(0.0F);
    const Texture second = counting(1000.0F);
    const Framebuffer of_first(gl(), {&first});
    const Framebuffer of_second(gl(), {&second});
    std::vector<AsyncReadback> readbacks;
    readbacks.emplace_back(gl(), 1, 1);
    of_first.bind();
    readbacks[0].start();
    readbacks.emplace_back(gl(), 1, 1);
    of_second.bind();
    readbacks[1].start();
    AsyncReadback taken = std::move(readbacks[0]);
    EXPECT_FALSE(readbacks[0].pending()); // NOLINT(bugprone-use-after-move): what a move leaves is what is tested
    std::vector<float> back;
    taken.fetch(back);
    EXPECT_EQ(back[1], 1.0F);
    taken = std::move(readbacks[1]);
    taken.fetch(back);
    EXPECT_EQ(back[1], 1001.0F);
}

TEST_F(ReadBack, a_second_start_gives_up_the_first) {
    const Texture first = counting(0.0F);
    const Texture second = counting(1000.0F);
    const Framebuffer of_first(gl(), {&first});
    const Framebuffer of_second(gl(), {&second});
    AsyncReadback readback(gl(), 4, 3);
    of_first.bind();
    readback.start();
    of_second.bind();
    readback.start();
    std::vector<float> back;
    readback.fetch(back);
    EXPECT_EQ(back[0], 1000.0F);
}

} // namespace
} // namespace sheetsplat::gl::testing

// Pixels that are read back from OpenGL without waiting.
#include <cstring>
#include <string>

#include "gl/objects.hpp"
#include "platforms.hpp"
#include "sheetsplat/error.hpp"
#include "texture_formats.hpp"

namespace sheetsplat::gl {

AsyncReadback::AsyncReadback(const Api& gl, int width, int height) : width_(width), height_(height) {
    check_errors(gl, "before a read-back buffer was made");
    GLuint name = 0;
    gl.GenBuffers(1, &name);
    buffer_ = Handle<delete_buffer>(gl, name);
    const auto bytes = static_cast<GLsizeiptr>(width) * height * static_cast<GLsizeiptr>(4 * sizeof(float));
    gl.BindBuffer(GL_PIXEL_PACK_BUFFER, name);
    gl.BufferData(GL_PIXEL_PACK_BUFFER, bytes, nullptr, GL_STREAM_READ);
    gl.BindBuffer(GL_PIXEL_PACK_BUFFER, 0);
    const GlErrors errors = take_errors(gl);
    if (!errors.names.empty()) {
        throw OutOfMemory(Complaint{"the device has no memory for a read-back buffer",
                                    in_pixels(width, height) + " pixels: " + errors.names, "", "render smaller tiles"});
    }
}

void AsyncReadback::start() {
    const Api& gl = buffer_.api();
    check_errors(gl, "before a read-back");
    gl.BindBuffer(GL_PIXEL_PACK_BUFFER, buffer_.name());
    gl.PixelStorei(GL_PACK_ALIGNMENT, 1);
    gl.ReadBuffer(GL_COLOR_ATTACHMENT0);
    gl.ReadPixels(0, 0, width_, height_, GL_RGBA, GL_FLOAT, nullptr);
    gl.BindBuffer(GL_PIXEL_PACK_BUFFER, 0);
    check_errors(gl, "reading pixels back");
    fence_ = decltype(fence_)(gl.FenceSync(GL_SYNC_GPU_COMMANDS_COMPLETE, 0), DeleteFence{&gl});
    // Otherwise the fence could stay in the driver's queue and never be signalled.
    gl.Flush();
}

bool AsyncReadback::ready() const {
    if (!pending()) {
        return false;
    }
    const GLenum state = buffer_.api().ClientWaitSync(fence_.get(), 0, 0);
    return state == GL_ALREADY_SIGNALED || state == GL_CONDITION_SATISFIED;
}

void AsyncReadback::fetch(std::vector<float>& rgba) {
    if (!pending()) {
        throw Error(
            Complaint{"there are no pixels to fetch", "no read-back was started", "start() before fetch()", ""});
    }
    const Api& gl = buffer_.api();
    constexpr GLuint64 one_second = 1'000'000'000;
    GLenum state = GL_TIMEOUT_EXPIRED;
    while (state == GL_TIMEOUT_EXPIRED) {
        state = gl.ClientWaitSync(fence_.get(), GL_SYNC_FLUSH_COMMANDS_BIT, one_second);
    }
    fence_.reset();
    rgba.resize(4 * static_cast<std::size_t>(width_) * static_cast<std::size_t>(height_));
    const std::size_t bytes = rgba.size() * sizeof(float);
    gl.BindBuffer(GL_PIXEL_PACK_BUFFER, buffer_.name());
    const void* memory = gl.MapBufferRange(GL_PIXEL_PACK_BUFFER, 0, static_cast<GLsizeiptr>(bytes), GL_MAP_READ_BIT);
    if (memory != nullptr) {
        std::memcpy(rgba.data(), memory, bytes);
        gl.UnmapBuffer(GL_PIXEL_PACK_BUFFER);
    }
    gl.BindBuffer(GL_PIXEL_PACK_BUFFER, 0);
    check_errors(gl, "fetching a read-back");
    if (memory == nullptr || state == GL_WAIT_FAILED) {
        throw Error(Complaint{"fetching a read-back failed", "an error of the driver", "", ""});
    }
}

} // namespace sheetsplat::gl

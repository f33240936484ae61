#include <cstring>
#include <limits>
#include <string>

#include "gl/objects.hpp"
#include "platforms.hpp"
#include "sheetsplat/error.hpp"
#include "texture_formats.hpp"

namespace sheetsplat::gl {

namespace {

std::size_t channels_of(GLenum format) {
    switch (format) {
    case GL_RED:
    case GL_GREEN:
    case GL_BLUE:
    case GL_ALPHA:
    case GL_RED_INTEGER:
    case GL_DEPTH_COMPONENT:
    case GL_STENCIL_INDEX:
        return 1;
    case GL_RG:
    case GL_RG_INTEGER:
        return 2;
    case GL_RGB:
    case GL_BGR:
    case GL_RGB_INTEGER:
        return 3;
    case GL_RGBA:
    case GL_BGRA:
    case GL_RGBA_INTEGER:
        return 4;
    default:
        return 0;
    }
}

std::size_t channel_bytes(GLenum type) {
    switch (type) {
    case GL_UNSIGNED_BYTE:
    case GL_BYTE:
        return 1;
    case GL_UNSIGNED_SHORT:
    case GL_SHORT:
    case GL_HALF_FLOAT:
        return 2;
    case GL_UNSIGNED_INT:
    case GL_INT:
    case GL_FLOAT:
        return 4;
    default:
        return 0;
    }
}

} // namespace

AsyncReadback::AsyncReadback(const Api& gl, std::size_t bytes) : api_(&gl), capacity_(bytes) {
    check_errors(gl, "before a read-back buffer was made");
    GLuint name = 0;
    gl.GenBuffers(1, &name);
    buffer_ = Handle<delete_buffer>(gl, name);
    if (bytes > static_cast<std::size_t>(std::numeric_limits<GLsizeiptr>::max())) {
        throw OutOfMemory(
            Complaint{"a read-back buffer is too large", std::to_string(bytes) + " bytes", "", "read smaller tiles"});
    }
    gl.BindBuffer(GL_PIXEL_PACK_BUFFER, name);
    gl.BufferData(GL_PIXEL_PACK_BUFFER, static_cast<GLsizeiptr>(bytes), nullptr, GL_STREAM_READ);
    gl.BindBuffer(GL_PIXEL_PACK_BUFFER, 0);
    const GlErrors errors = take_errors(gl);
    if (!errors.names.empty()) {
        throw OutOfMemory(Complaint{"the device has no memory for a read-back buffer",
                                    std::to_string(bytes) + " bytes: " + errors.names, "", "read smaller tiles"});
    }
}

AsyncReadback::~AsyncReadback() { forget(); }

AsyncReadback::AsyncReadback(AsyncReadback&& other) noexcept
    : api_(other.api_), buffer_(std::move(other.buffer_)), fence_(std::exchange(other.fence_, nullptr)),
      capacity_(std::exchange(other.capacity_, 0)), started_(std::exchange(other.started_, 0)) {}

AsyncReadback& AsyncReadback::operator=(AsyncReadback&& other) noexcept {
    if (this != &other) {
        forget();
        api_ = other.api_;
        buffer_ = std::move(other.buffer_);
        fence_ = std::exchange(other.fence_, nullptr);
        capacity_ = std::exchange(other.capacity_, 0);
        started_ = std::exchange(other.started_, 0);
    }
    return *this;
}

void AsyncReadback::forget() noexcept {
    if (fence_ != nullptr) {
        api_->DeleteSync(fence_);
        fence_ = nullptr;
    }
    started_ = 0;
}

void AsyncReadback::start(int attachment, int x, int y, int width, int height, GLenum format, GLenum type) {
    if (!buffer_) {
        throw Error(Complaint{"a read-back was started that has no buffer", "an empty AsyncReadback",
                              "one made with a size", ""});
    }
    const std::size_t texel = channels_of(format) * channel_bytes(type);
    if (texel == 0 || width < 1 || height < 1 || attachment < 0) {
        throw InvalidInput(Complaint{"these pixels cannot be read back",
                                     in_pixels(width, height) + " of attachment " + std::to_string(attachment) +
                                         ", format " + hexadecimal(format) + ", type " + hexadecimal(type),
                                     "at least 1 x 1 pixels in plain channels of 1, 2 or 4 bytes", ""});
    }
    const std::size_t bytes = static_cast<std::size_t>(width) * static_cast<std::size_t>(height) * texel;
    if (bytes > capacity_) {
        throw InvalidInput(Complaint{"the read-back buffer is too small", std::to_string(capacity_) + " bytes",
                                     std::to_string(bytes) + " bytes for " + in_pixels(width, height) + " pixels",
                                     "make it larger"});
    }
    const Api& gl = *api_;
    forget();
    check_errors(gl, "before a read-back");
    gl.BindBuffer(GL_PIXEL_PACK_BUFFER, buffer_.name());
    gl.PixelStorei(GL_PACK_ALIGNMENT, 1);
    gl.ReadBuffer(static_cast<GLenum>(GL_COLOR_ATTACHMENT0 + attachment));
    gl.ReadPixels(x, y, width, height, format, type, nullptr);
    gl.BindBuffer(GL_PIXEL_PACK_BUFFER, 0);
    check_errors(gl, "starting a read-back");
    fence_ = gl.FenceSync(GL_SYNC_GPU_COMMANDS_COMPLETE, 0);
    // Without this the fence might stay in the driver's queue, and ready() false for ever.
    gl.Flush();
    started_ = bytes;
}

bool AsyncReadback::ready() const {
    if (fence_ == nullptr) {
        return false;
    }
    const GLenum state = api_->ClientWaitSync(fence_, 0, 0);
    return state == GL_ALREADY_SIGNALED || state == GL_CONDITION_SATISFIED;
}

void AsyncReadback::fetch(void* out, std::size_t bytes) {
    if (fence_ == nullptr) {
        throw Error(
            Complaint{"there are no pixels to fetch", "no read-back was started", "start() before fetch()", ""});
    }
    if (bytes > started_) {
        throw InvalidInput(Complaint{"more pixels were asked for than were read back", std::to_string(bytes) + " bytes",
                                     "at most " + std::to_string(started_) + " bytes", ""});
    }
    const Api& gl = *api_;
    constexpr GLuint64 one_second = 1'000'000'000;
    GLenum state = GL_TIMEOUT_EXPIRED;
    while (state == GL_TIMEOUT_EXPIRED) {
        state = gl.ClientWaitSync(fence_, GL_SYNC_FLUSH_COMMANDS_BIT, one_second);
    }
    forget();
    if (state == GL_WAIT_FAILED) {
        check_errors(gl, "waiting for a read-back");
        throw Error(Complaint{"waiting for a read-back failed", "an error of the driver", "", ""});
    }
    if (bytes == 0) {
        return;
    }
    gl.BindBuffer(GL_PIXEL_PACK_BUFFER, buffer_.name());
    const void* memory = gl.MapBufferRange(GL_PIXEL_PACK_BUFFER, 0, static_cast<GLsizeiptr>(bytes), GL_MAP_READ_BIT);
    if (memory != nullptr) {
        std::memcpy(out, memory, bytes);
        gl.UnmapBuffer(GL_PIXEL_PACK_BUFFER);
    }
    gl.BindBuffer(GL_PIXEL_PACK_BUFFER, 0);
    check_errors(gl, "fetching a read-back");
    if (memory == nullptr) {
        throw Error(Complaint{"fetching a read-back failed", "a buffer that the driver cannot map", "", ""});
    }
}

} // namespace sheetsplat::gl

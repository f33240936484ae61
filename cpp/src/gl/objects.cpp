#include "gl/objects.hpp"

#include <algorithm>
#include <array>
#include <cstring>
#include <limits>
#include <string>

#include "platforms.hpp"
#include "sheetsplat/error.hpp"

namespace sheetsplat::gl {
namespace {

struct Format {
    GLenum internal;
    GLenum format; // that glTexImage2D accepts with it
    GLenum type;
    std::size_t bytes; // a texel
    const char* name;
};

constexpr std::array<Format, 34> formats = {{
    {GL_R8, GL_RED, GL_UNSIGNED_BYTE, 1, "GL_R8"},
    {GL_RG8, GL_RG, GL_UNSIGNED_BYTE, 2, "GL_RG8"},
    {GL_RGBA8, GL_RGBA, GL_UNSIGNED_BYTE, 4, "GL_RGBA8"},
    {GL_SRGB8_ALPHA8, GL_RGBA, GL_UNSIGNED_BYTE, 4, "GL_SRGB8_ALPHA8"},
    {GL_R16, GL_RED, GL_UNSIGNED_SHORT, 2, "GL_R16"},
    {GL_RG16, GL_RG, GL_UNSIGNED_SHORT, 4, "GL_RG16"},
    {GL_RGBA16, GL_RGBA, GL_UNSIGNED_SHORT, 8, "GL_RGBA16"},
    {GL_R16F, GL_RED, GL_HALF_FLOAT, 2, "GL_R16F"},
    {GL_RG16F, GL_RG, GL_HALF_FLOAT, 4, "GL_RG16F"},
    {GL_RGBA16F, GL_RGBA, GL_HALF_FLOAT, 8, "GL_RGBA16F"},
    {GL_R32F, GL_RED, GL_FLOAT, 4, "GL_R32F"},
    {GL_RG32F, GL_RG, GL_FLOAT, 8, "GL_RG32F"},
    {GL_RGB32F, GL_RGB, GL_FLOAT, 12, "GL_RGB32F"},
    {GL_RGBA32F, GL_RGBA, GL_FLOAT, 16, "GL_RGBA32F"},
    {GL_R11F_G11F_B10F, GL_RGB, GL_UNSIGNED_INT_10F_11F_11F_REV, 4, "GL_R11F_G11F_B10F"},
    {GL_RGB10_A2, GL_RGBA, GL_UNSIGNED_INT_2_10_10_10_REV, 4, "GL_RGB10_A2"},
    {GL_R8I, GL_RED_INTEGER, GL_BYTE, 1, "GL_R8I"},
    {GL_R8UI, GL_RED_INTEGER, GL_UNSIGNED_BYTE, 1, "GL_R8UI"},
    {GL_R16I, GL_RED_INTEGER, GL_SHORT, 2, "GL_R16I"},
    {GL_R16UI, GL_RED_INTEGER, GL_UNSIGNED_SHORT, 2, "GL_R16UI"},
    {GL_R32I, GL_RED_INTEGER, GL_INT, 4, "GL_R32I"},
    {GL_R32UI, GL_RED_INTEGER, GL_UNSIGNED_INT, 4, "GL_R32UI"},
    {GL_RG16I, GL_RG_INTEGER, GL_SHORT, 4, "GL_RG16I"},
    {GL_RG16UI, GL_RG_INTEGER, GL_UNSIGNED_SHORT, 4, "GL_RG16UI"},
    {GL_RG32I, GL_RG_INTEGER, GL_INT, 8, "GL_RG32I"},
    {GL_RG32UI, GL_RG_INTEGER, GL_UNSIGNED_INT, 8, "GL_RG32UI"},
    {GL_RGBA8UI, GL_RGBA_INTEGER, GL_UNSIGNED_BYTE, 4, "GL_RGBA8UI"},
    {GL_RGBA32I, GL_RGBA_INTEGER, GL_INT, 16, "GL_RGBA32I"},
    {GL_RGBA32UI, GL_RGBA_INTEGER, GL_UNSIGNED_INT, 16, "GL_RGBA32UI"},
    {GL_DEPTH_COMPONENT16, GL_DEPTH_COMPONENT, GL_UNSIGNED_SHORT, 2, "GL_DEPTH_COMPONENT16"},
    {GL_DEPTH_COMPONENT24, GL_DEPTH_COMPONENT, GL_UNSIGNED_INT, 4, "GL_DEPTH_COMPONENT24"},
    {GL_DEPTH_COMPONENT32F, GL_DEPTH_COMPONENT, GL_FLOAT, 4, "GL_DEPTH_COMPONENT32F"},
    {GL_DEPTH24_STENCIL8, GL_DEPTH_STENCIL, GL_UNSIGNED_INT_24_8, 4, "GL_DEPTH24_STENCIL8"},
    {GL_DEPTH32F_STENCIL8, GL_DEPTH_STENCIL, GL_FLOAT_32_UNSIGNED_INT_24_8_REV, 8, "GL_DEPTH32F_STENCIL8"},
}};

std::string hexadecimal(GLenum value) {
    static constexpr const char* digits = "0123456789ABCDEF";
    std::string text = "0x0000";
    for (std::size_t i = 0; i < 4; ++i) {
        text[5 - i] = digits[(value >> (4 * i)) & 15U];
    }
    return text;
}

const Format& format_of(GLenum internal) {
    const auto* found =
        std::find_if(formats.begin(), formats.end(), [&](const Format& each) { return each.internal == internal; });
    if (found == formats.end()) {
        throw InvalidInput(
            Complaint{"a texture cannot have this internal format", hexadecimal(internal),
                      "a sized format of colour or depth, such as GL_RGBA32F (" + hexadecimal(GL_RGBA32F) + ")",
                      "add it to the table in gl/objects.cpp if OpenGL 3.3 has it"});
    }
    return *found;
}

std::string in_pixels(int width, int height) { return std::to_string(width) + " x " + std::to_string(height); }

// Making and filling a texture binds it; that happens at the last unit that OpenGL 3.3 promises over all stages, beyond
// those that a single stage has, so that the bindings that passes work with stay as they are.
constexpr int work_unit = 47;

void bind_for_work(const Api& gl, GLuint name) {
    gl.ActiveTexture(static_cast<GLenum>(GL_TEXTURE0 + work_unit));
    gl.BindTexture(GL_TEXTURE_2D, name);
}

const char* status_in_words(GLenum status) {
    switch (status) {
    case GL_FRAMEBUFFER_UNDEFINED:
        return "GL_FRAMEBUFFER_UNDEFINED: there is no default framebuffer";
    case GL_FRAMEBUFFER_INCOMPLETE_ATTACHMENT:
        return "GL_FRAMEBUFFER_INCOMPLETE_ATTACHMENT: an attachment's format cannot be drawn to, or is not of the kind "
               "(colour, depth) "
               "that it is attached as";
    case GL_FRAMEBUFFER_INCOMPLETE_MISSING_ATTACHMENT:
        return "GL_FRAMEBUFFER_INCOMPLETE_MISSING_ATTACHMENT: it has no attachments";
    case GL_FRAMEBUFFER_INCOMPLETE_DRAW_BUFFER:
        return "GL_FRAMEBUFFER_INCOMPLETE_DRAW_BUFFER: a draw buffer has no attachment";
    case GL_FRAMEBUFFER_INCOMPLETE_READ_BUFFER:
        return "GL_FRAMEBUFFER_INCOMPLETE_READ_BUFFER: the read buffer has no attachment";
    case GL_FRAMEBUFFER_UNSUPPORTED:
        return "GL_FRAMEBUFFER_UNSUPPORTED: the driver does not draw to this combination of formats";
    case GL_FRAMEBUFFER_INCOMPLETE_MULTISAMPLE:
        return "GL_FRAMEBUFFER_INCOMPLETE_MULTISAMPLE: the attachments' sample counts differ";
    case GL_FRAMEBUFFER_INCOMPLETE_LAYER_TARGETS:
        return "GL_FRAMEBUFFER_INCOMPLETE_LAYER_TARGETS: some attachments are layered and some are not";
    default:
        return "a status that OpenGL does not name";
    }
}

std::string described(const Texture* texture) {
    return texture == nullptr ? std::string("none")
                              : std::string(format_of(texture->internal_format()).name) + " " +
                                    in_pixels(texture->width(), texture->height());
}

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

void delete_texture(const Api& gl, GLuint name) { gl.DeleteTextures(1, &name); }
void delete_renderbuffer(const Api& gl, GLuint name) { gl.DeleteRenderbuffers(1, &name); }
void delete_framebuffer(const Api& gl, GLuint name) { gl.DeleteFramebuffers(1, &name); }
void delete_buffer(const Api& gl, GLuint name) { gl.DeleteBuffers(1, &name); }
void delete_vertex_array(const Api& gl, GLuint name) { gl.DeleteVertexArrays(1, &name); }

Texture::Texture(const Api& gl, GLenum internal_format, int width, int height)
    : width_(width), height_(height), internal_format_(internal_format) {
    const Format& format = format_of(internal_format);
    GLint largest = 0;
    gl.GetIntegerv(GL_MAX_TEXTURE_SIZE, &largest);
    if (width < 1 || height < 1) {
        throw InvalidInput(Complaint{"a texture needs a size", in_pixels(width, height), "at least 1 x 1", ""});
    }
    if (width > largest || height > largest) {
        throw Unsupported(Complaint{"a texture is larger than this device supports", in_pixels(width, height),
                                    "at most " + in_pixels(largest, largest), "render smaller tiles"});
    }
    check_errors(gl, "before a texture was made");

    GLuint name = 0;
    gl.GenTextures(1, &name);
    handle_ = Handle<delete_texture>(gl, name);
    bind_for_work(gl, name);
    gl.TexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MIN_FILTER, GL_NEAREST);
    gl.TexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MAG_FILTER, GL_NEAREST);
    gl.TexParameteri(GL_TEXTURE_2D, GL_TEXTURE_WRAP_S, GL_CLAMP_TO_EDGE);
    gl.TexParameteri(GL_TEXTURE_2D, GL_TEXTURE_WRAP_T, GL_CLAMP_TO_EDGE);
    gl.TexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MAX_LEVEL, 0);
    if (gl.VERSION_4_2 != 0) {
        gl.TexStorage2D(GL_TEXTURE_2D, 1, internal_format, width, height);
    } else {
        gl.TexImage2D(GL_TEXTURE_2D, 0, static_cast<GLint>(internal_format), width, height, 0, format.format,
                      format.type, nullptr);
    }
    const GlErrors errors = take_errors(gl);
    if (errors.out_of_memory) {
        throw OutOfMemory(Complaint{"the device has no memory for a texture",
                                    std::string(format.name) + ", " + in_pixels(width, height) + ": " +
                                        std::to_string(bytes()) + " bytes",
                                    "", "render smaller tiles, or free memory of the device"});
    }
    if (!errors.names.empty()) {
        throw Error(Complaint{"a texture could not be made",
                              std::string(format.name) + ", " + in_pixels(width, height) + ": " + errors.names,
                              "no error", ""});
    }
}

std::size_t Texture::bytes() const {
    if (!handle_) {
        return 0;
    }
    return static_cast<std::size_t>(width_) * static_cast<std::size_t>(height_) * format_of(internal_format_).bytes;
}

void Texture::upload(GLenum format, GLenum type, const void* pixels) {
    const Api& gl = handle_.api();
    bind_for_work(gl, name());
    gl.BindBuffer(GL_PIXEL_UNPACK_BUFFER, 0);
    gl.PixelStorei(GL_UNPACK_ALIGNMENT, 1);
    gl.TexSubImage2D(GL_TEXTURE_2D, 0, 0, 0, width_, height_, format, type, pixels);
    check_errors(gl, "filling a texture");
}

void Texture::bind(int unit) const {
    const Api& gl = handle_.api();
    gl.ActiveTexture(static_cast<GLenum>(GL_TEXTURE0 + unit));
    gl.BindTexture(GL_TEXTURE_2D, name());
}

Framebuffer::Framebuffer(const Api& gl, const std::vector<const Texture*>& colors, const Texture* depth) {
    check_errors(gl, "before a framebuffer was made");
    GLint most_colors = 0;
    GLint most_buffers = 0;
    gl.GetIntegerv(GL_MAX_COLOR_ATTACHMENTS, &most_colors);
    gl.GetIntegerv(GL_MAX_DRAW_BUFFERS, &most_buffers);
    const auto most = static_cast<std::size_t>(std::min(most_colors, most_buffers));
    if (colors.size() > most) {
        throw Unsupported(Complaint{"a framebuffer has more colour attachments than this device draws to",
                                    std::to_string(colors.size()), "at most " + std::to_string(most), ""});
    }
    GLint draw_before = 0;
    GLint read_before = 0;
    gl.GetIntegerv(GL_DRAW_FRAMEBUFFER_BINDING, &draw_before);
    gl.GetIntegerv(GL_READ_FRAMEBUFFER_BINDING, &read_before);

    GLuint name = 0;
    gl.GenFramebuffers(1, &name);
    handle_ = Handle<delete_framebuffer>(gl, name);
    gl.BindFramebuffer(GL_FRAMEBUFFER, name);
    std::vector<GLenum> draw_buffers;
    GLenum read_buffer = GL_NONE;
    for (std::size_t i = 0; i < colors.size(); ++i) {
        const auto attachment = static_cast<GLenum>(GL_COLOR_ATTACHMENT0 + i);
        const bool there = colors[i] != nullptr;
        draw_buffers.push_back(there ? attachment : static_cast<GLenum>(GL_NONE));
        if (there) {
            gl.FramebufferTexture2D(GL_FRAMEBUFFER, attachment, GL_TEXTURE_2D, colors[i]->name(), 0);
            read_buffer = read_buffer == GL_NONE ? attachment : read_buffer;
        }
    }
    if (depth != nullptr) {
        const bool with_stencil = format_of(depth->internal_format()).format == GL_DEPTH_STENCIL;
        gl.FramebufferTexture2D(GL_FRAMEBUFFER, with_stencil ? GL_DEPTH_STENCIL_ATTACHMENT : GL_DEPTH_ATTACHMENT,
                                GL_TEXTURE_2D, depth->name(), 0);
    }
    if (draw_buffers.empty()) {
        gl.DrawBuffer(GL_NONE);
    } else {
        gl.DrawBuffers(static_cast<GLsizei>(draw_buffers.size()), draw_buffers.data());
    }
    gl.ReadBuffer(read_buffer);
    const GLenum status = gl.CheckFramebufferStatus(GL_FRAMEBUFFER);
    const GlErrors errors = take_errors(gl);
    gl.BindFramebuffer(GL_DRAW_FRAMEBUFFER, static_cast<GLuint>(draw_before));
    gl.BindFramebuffer(GL_READ_FRAMEBUFFER, static_cast<GLuint>(read_before));

    if (status == GL_FRAMEBUFFER_COMPLETE && errors.names.empty()) {
        return;
    }
    std::string found = status == GL_FRAMEBUFFER_COMPLETE ? std::string() : std::string(status_in_words(status)) + "; ";
    found += errors.names.empty() ? "" : errors.names + "; ";
    for (std::size_t i = 0; i < colors.size(); ++i) {
        found += "colour " + std::to_string(i) + ": " + described(colors[i]) + ", ";
    }
    found += "depth: " + described(depth);
    throw Error(Complaint{"a framebuffer is not complete", found, "attachments that this device can draw to together",
                          "choose other formats for them"});
}

void Framebuffer::bind() const { handle_.api().BindFramebuffer(GL_FRAMEBUFFER, name()); }

Buffer::Buffer(const Api& gl, GLenum target) : target_(target) {
    GLuint name = 0;
    gl.GenBuffers(1, &name);
    handle_ = Handle<delete_buffer>(gl, name);
}

void Buffer::bind() const { handle_.api().BindBuffer(target_, name()); }

namespace {

/// Storage that is kept for a frame's vertices; a larger frame hands its storage back part by part.
constexpr std::size_t most_ring_bytes = std::size_t{16} << 20;

} // namespace

void* Buffer::map(std::size_t bytes) {
    const Api& gl = handle_.api();
    // Its contents pass through a target that no drawing reads: GL_ELEMENT_ARRAY_BUFFER would change the bound vertex
    // array.
    gl.BindBuffer(GL_COPY_WRITE_BUFFER, name());
    std::size_t capacity = std::max<std::size_t>(capacity_, 1);
    if (bytes > capacity) {
        // By half more than before, so that slowly growing contents do not ask for new memory every time.
        capacity = std::max(bytes, capacity_ + capacity_ / 2);
    }
    constexpr auto most = static_cast<std::size_t>(std::numeric_limits<GLsizeiptr>::max());
    const auto refuse = [&](const std::string& found) {
        // What the driver keeps of it is not defined any more.
        capacity_ = 0;
        throw OutOfMemory(Complaint{"the device has no memory for a buffer", std::to_string(bytes) + " bytes: " + found,
                                    "", "draw fewer kernels at once, or free memory of the device"});
    };
    if (capacity > most) {
        refuse("more than an address can name");
    }
    const bool grows = capacity > capacity_;
    if (grows) {
        check_errors(gl, "before a buffer grew");
    }
    gl.BufferData(GL_COPY_WRITE_BUFFER, static_cast<GLsizeiptr>(capacity), nullptr, GL_STREAM_DRAW);
    if (grows) {
        const GlErrors errors = take_errors(gl);
        if (!errors.names.empty()) {
            refuse(errors.names);
        }
    }
    capacity_ = capacity;
    void* memory = gl.MapBufferRange(GL_COPY_WRITE_BUFFER, 0, static_cast<GLsizeiptr>(std::max<std::size_t>(bytes, 1)),
                                     GL_MAP_WRITE_BIT | GL_MAP_INVALIDATE_BUFFER_BIT);
    if (memory == nullptr) {
        refuse(take_errors(gl).names);
    }
    return memory;
}

void* Buffer::map_next(std::size_t bytes) {
    constexpr std::size_t alignment = 64;
    constexpr std::size_t least = std::size_t{1} << 20;
    const std::size_t begin = (used_ + alignment - 1) / alignment * alignment;
    if (capacity_ == 0 || begin + bytes > capacity_) {
        // A frame that outgrows the storage doubles it for the frames to come; what is queued keeps the old one.
        void* memory = map(std::max({bytes, least, std::min(2 * capacity_, most_ring_bytes)}));
        offset_ = 0;
        used_ = bytes;
        return memory;
    }
    const Api& gl = handle_.api();
    gl.BindBuffer(GL_COPY_WRITE_BUFFER, name());
    void* memory = gl.MapBufferRange(GL_COPY_WRITE_BUFFER, static_cast<GLintptr>(begin),
                                     static_cast<GLsizeiptr>(std::max<std::size_t>(bytes, 1)),
                                     GL_MAP_WRITE_BIT | GL_MAP_UNSYNCHRONIZED_BIT | GL_MAP_INVALIDATE_RANGE_BIT);
    if (memory == nullptr) {
        used_ = capacity_;
        return map_next(bytes);
    }
    offset_ = begin;
    used_ = begin + bytes;
    return memory;
}

void Buffer::unmap() {
    const Api& gl = handle_.api();
    gl.BindBuffer(GL_COPY_WRITE_BUFFER, name());
    if (gl.UnmapBuffer(GL_COPY_WRITE_BUFFER) == GL_FALSE) {
        check_errors(gl, "handing over a buffer");
        throw Error(Complaint{"the driver lost the contents of a buffer while they were written",
                              "glUnmapBuffer gave GL_FALSE", "", "render again"});
    }
}

void Buffer::upload(const void* data, std::size_t bytes) {
    void* memory = map(bytes);
    if (bytes > 0) {
        std::memcpy(memory, data, bytes);
    }
    unmap();
}

BufferTexture::BufferTexture(const Api& gl, GLenum internal_format, const Buffer& buffer) {
    GLuint name = 0;
    gl.GenTextures(1, &name);
    handle_ = Handle<delete_texture>(gl, name);
    gl.BindTexture(GL_TEXTURE_BUFFER, name);
    gl.TexBuffer(GL_TEXTURE_BUFFER, internal_format, buffer.name());
    check_errors(gl, "making a texture of a buffer");
}

void BufferTexture::bind(int unit) const {
    const Api& gl = handle_.api();
    gl.ActiveTexture(GL_TEXTURE0 + static_cast<GLenum>(unit));
    gl.BindTexture(GL_TEXTURE_BUFFER, handle_.name());
}

VertexArray::VertexArray(const Api& gl) {
    GLuint name = 0;
    gl.GenVertexArrays(1, &name);
    handle_ = Handle<delete_vertex_array>(gl, name);
}

void VertexArray::bind() const { handle_.api().BindVertexArray(name()); }

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

// OpenGL objects as values: made whole, moved, destroyed with the context current.
#pragma once

#include <cstddef>
#include <cstdint>
#include <initializer_list>
#include <utility>
#include <vector>

#include "gl/context.hpp"

namespace sheetsplat::gl {

/// A name that is deleted once. `Deleter` is a pointer to a function (const Api&, GLuint).
template <void (*Deleter)(const Api&, GLuint)>
class Handle {
  public:
    Handle() = default;
    Handle(const Api& api, GLuint name) : api_(&api), name_(name) {}
    Handle(Handle&& other) noexcept : api_(other.api_), name_(std::exchange(other.name_, 0U)) {}
    Handle& operator=(Handle&& other) noexcept {
        if (this != &other) {
            reset();
            api_ = other.api_;
            name_ = std::exchange(other.name_, 0U);
        }
        return *this;
    }
    Handle(const Handle&) = delete;
    Handle& operator=(const Handle&) = delete;
    ~Handle() { reset(); }

    [[nodiscard]] GLuint name() const { return name_; }
    [[nodiscard]] const Api& api() const { return *api_; }
    explicit operator bool() const { return name_ != 0; }
    void reset() noexcept {
        if (name_ != 0) {
            Deleter(*api_, name_);
            name_ = 0;
        }
    }

  private:
    const Api* api_ = nullptr;
    GLuint name_ = 0;
};

void delete_texture(const Api& gl, GLuint name);
void delete_framebuffer(const Api& gl, GLuint name);
void delete_buffer(const Api& gl, GLuint name);
void delete_vertex_array(const Api& gl, GLuint name);

/// A 2D texture without mipmaps: nearest filter, clamped to the edge. Storage is undefined until written.
/// Making and filling one binds it to unit 47 and leaves that unit active; all others keep their bindings.
class Texture {
  public:
    Texture() = default;
    /// internal_format: GL_RGBA32F, GL_RGBA16F, GL_RGBA8, GL_R32F, GL_R32I, GL_DEPTH_COMPONENT32F, GL_DEPTH_COMPONENT24
    /// ... Throws OutOfMemory where the driver has no memory for it, Unsupported beyond its largest size.
    Texture(const Api& gl, GLenum internal_format, int width, int height);

    [[nodiscard]] GLuint name() const { return handle_.name(); }
    [[nodiscard]] int width() const { return width_; }
    [[nodiscard]] int height() const { return height_; }
    [[nodiscard]] GLenum internal_format() const { return internal_format_; }
    /// Bytes of its storage, as the format says.
    [[nodiscard]] std::size_t bytes() const;
    /// Replaces all of it. format and type are those of glTexSubImage2D.
    void upload(GLenum format, GLenum type, const void* pixels);
    /// Binds it to GL_TEXTURE0 + unit.
    void bind(int unit) const;
    explicit operator bool() const { return static_cast<bool>(handle_); }

  private:
    Handle<delete_texture> handle_;
    int width_ = 0, height_ = 0;
    GLenum internal_format_ = 0;
};

/// A framebuffer of textures that it does not own; complete, or Error with the status in words.
class Framebuffer {
  public:
    Framebuffer() = default;
    /// colors become attachments 0, 1, ... and the draw buffers; depth may be null. Attachments without a texture
    /// (nullptr) become GL_NONE draw buffers. What was bound stays bound.
    Framebuffer(const Api& gl, const std::vector<const Texture*>& colors, const Texture* depth = nullptr);
    void bind() const; ///< as draw and read framebuffer
    [[nodiscard]] GLuint name() const { return handle_.name(); }
    explicit operator bool() const { return static_cast<bool>(handle_); }

  private:
    Handle<delete_framebuffer> handle_;
};

/// A buffer whose contents are replaced as a whole (orphaned, so that the driver need not wait). map and unmap bind it
/// to GL_COPY_WRITE_BUFFER only.
class Buffer {
  public:
    Buffer() = default;
    Buffer(const Api& gl, GLenum target);
    void bind() const;
    /// Grows to at least `bytes` and returns memory to write them to; unmap() hands them over. Throws OutOfMemory.
    [[nodiscard]] void* map(std::size_t bytes);
    void unmap();
    /// Like map, but behind what was written since the last rewind(): the storage stays, so that the driver neither
    /// waits nor takes new memory. The bytes begin at offset(). A buffer that is full starts anew as map does.
    [[nodiscard]] void* map_next(std::size_t bytes);
    [[nodiscard]] std::size_t offset() const { return offset_; }
    /// The device has drawn everything that was written: the storage may be used again from its start.
    void rewind() { used_ = offset_ = 0; }
    /// map + copy + unmap
    void upload(const void* data, std::size_t bytes);
    [[nodiscard]] GLuint name() const { return handle_.name(); }
    [[nodiscard]] std::size_t capacity() const { return capacity_; }

  private:
    Handle<delete_buffer> handle_;
    GLenum target_ = 0;
    std::size_t capacity_ = 0;
    std::size_t used_ = 0, offset_ = 0;
};

/// A buffer's bytes as a texture of one row that shaders fetch from; the buffer is another's.
class BufferTexture {
  public:
    BufferTexture() = default;
    BufferTexture(const Api& gl, GLenum internal_format, const Buffer& buffer);
    void bind(int unit) const;
    explicit operator bool() const { return static_cast<bool>(handle_); }

  private:
    Handle<delete_texture> handle_;
};

class VertexArray {
  public:
    VertexArray() = default;
    explicit VertexArray(const Api& gl);
    void bind() const;
    [[nodiscard]] GLuint name() const { return handle_.name(); }

  private:
    Handle<delete_vertex_array> handle_;
};

/// Pixels that are read back without waiting: start() queues the copy, ready() asks the fence, data() maps.
class AsyncReadback {
  public:
    AsyncReadback() = default;
    AsyncReadback(const Api& gl, std::size_t bytes);
    ~AsyncReadback();
    AsyncReadback(AsyncReadback&&) noexcept;
    AsyncReadback& operator=(AsyncReadback&&) noexcept;
    /// Reads x, y, width, height of colour attachment `attachment` of the bound read framebuffer, rows without padding,
    /// from the lowest up. Pixels that are still pending are given up. Throws InvalidInput where they do not fit
    /// `bytes`.
    void start(int attachment, int x, int y, int width, int height, GLenum format, GLenum type);
    [[nodiscard]] bool pending() const { return fence_ != nullptr; }
    [[nodiscard]] bool ready() const; ///< never blocks
    /// Waits if needed and copies the first `bytes` of the pixels to `out`; then no longer pending.
    void fetch(void* out, std::size_t bytes);

  private:
    void forget() noexcept;
    const Api* api_ = nullptr;
    Handle<delete_buffer> buffer_;
    GLsync fence_ = nullptr;
    std::size_t capacity_ = 0;
    std::size_t started_ = 0; // bytes of the pixels that are on their way
};

} // namespace sheetsplat::gl

// OpenGL objects with RAII: made, moved and destroyed with the context current.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <type_traits>
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

/// A 2D texture, or an array of them, without mipmaps: nearest filter, clamped to the edge. Storage is undefined until
/// written.
/// Making and filling one binds it to unit 47 and leaves that unit active; all others keep their bindings.
class Texture {
  public:
    Texture() = default;
    /// internal_format: one of the table in gl/texture_formats.cpp. layers: 0 for a 2D texture, else those of a 2D
    /// array. Throws OutOfMemory where the driver has no memory for it, Unsupported beyond its largest size.
    Texture(const Api& gl, GLenum internal_format, int width, int height, int layers = 0);

    [[nodiscard]] GLuint name() const { return handle_.name(); }
    [[nodiscard]] int width() const { return width_; }
    [[nodiscard]] int height() const { return height_; }
    [[nodiscard]] GLenum internal_format() const { return internal_format_; }
    /// Bytes of its storage, as the format says.
    [[nodiscard]] std::size_t bytes() const;
    /// Layers of an array; 0: the texture is none.
    [[nodiscard]] int layers() const { return layers_; }
    /// Replaces all of a texture, of an array all layers. format and type are those of glTexSubImage2D.
    void upload(GLenum format, GLenum type, const void* pixels) const;
    /// Binds it to GL_TEXTURE0 + unit.
    void bind(int unit) const;
    /// As image number `unit` of programs that read and write it (OpenGL 4.2).
    void bind_image(int unit) const;
    explicit operator bool() const { return static_cast<bool>(handle_); }

  private:
    Handle<delete_texture> handle_;
    int width_ = 0, height_ = 0, layers_ = 0;
    GLenum internal_format_ = 0;
};

/// A 3D texture without mipmaps, for texelFetch alone. Making and filling one binds it to unit 47, as Texture does.
class VolumeTexture {
  public:
    VolumeTexture() = default;
    /// internal_format: of the table in gl/texture_formats.cpp. Throws OutOfMemory where the driver has no memory for
    /// it, Unsupported beyond its largest size.
    VolumeTexture(const Api& gl, GLenum internal_format, int width, int height, int depth);
    /// Replaces layers first ... first + count - 1: tight rows of the type that glTexSubImage3D takes for the format.
    void upload(int first, int count, const void* texels) const;
    void bind(int unit) const;
    [[nodiscard]] std::size_t bytes() const;
    explicit operator bool() const { return static_cast<bool>(handle_); }

  private:
    Handle<delete_texture> handle_;
    int width_ = 0, height_ = 0, depth_ = 0;
    GLenum internal_format_ = 0;
};

/// A texture that a framebuffer draws to, or one layer of an array.
struct Attachment {
    Attachment(const Texture* texture_, int layer_ = 0) : texture(texture_), layer(layer_) {}
    const Texture* texture;
    int layer;
};

/// A framebuffer of textures that it does not own; complete, or Error with the status in words.
class Framebuffer {
  public:
    Framebuffer() = default;
    /// colors become attachments 0, 1, ... and the draw buffers; depth may be null. What was bound stays bound.
    Framebuffer(const Api& gl, const std::vector<Attachment>& colors, const Texture* depth = nullptr);
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
    /// As storage buffer number `index` of programs (OpenGL 4.3).
    void bind_storage(GLuint index) const;
    /// Grows to at least `bytes` and returns memory to write them to; unmap() hands them over. Throws OutOfMemory.
    [[nodiscard]] void* map(std::size_t bytes);
    void unmap();
    /// Like map, but behind what was written since the last rewind(): the storage stays, so that the driver neither
    /// waits nor takes new memory. The bytes begin at offset(). A buffer that is full starts anew as map does.
    [[nodiscard]] void* map_next(std::size_t bytes);
    [[nodiscard]] std::size_t offset() const { return offset_; }
    /// The device has drawn everything that was written: the storage may be used again from its start.
    void rewind() { used_ = offset_ = 0; }
    /// Waits for the device and copies the first bytes back.
    void read(void* to, std::size_t bytes) const;
    /// map + copy + unmap
    void upload(const void* data, std::size_t bytes);
    /// map_next + copy + unmap
    void upload_next(const void* data, std::size_t bytes);
    /// Makes the bytes from `begin` on, counted from offset(), an attribute of the bound vertex array: `components`
    /// numbers, which the shader reads as floats.
    void attribute(GLuint location, int components, GLenum type, std::size_t stride, std::size_t begin,
                   GLuint divisor) const;
    [[nodiscard]] GLuint name() const { return handle_.name(); }
    [[nodiscard]] std::size_t capacity() const { return capacity_; }

  private:
    Handle<delete_buffer> handle_;
    GLenum target_ = 0;
    std::size_t capacity_ = 0;
    std::size_t used_ = 0, offset_ = 0;
};

/// A buffer's bytes as a texture of one row that shaders fetch from. Does not own the buffer.
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

/// A picture of four float32 channels that is read back without waiting: start() queues the copy, ready() asks the
/// fence, fetch() copies. Made and destroyed with the context current.
class AsyncReadback {
  public:
    AsyncReadback() = default;
    /// Throws OutOfMemory.
    AsyncReadback(const Api& gl, int width, int height);
    /// Reads colour attachment 0 of the bound read framebuffer, rows without padding, from the lowest up.
    void start();
    [[nodiscard]] bool pending() const { return fence_ != nullptr; }
    [[nodiscard]] bool ready() const; ///< never blocks
    /// Waits if needed and copies the pixels; then no longer pending.
    void fetch(std::vector<float>& rgba);

  private:
    struct DeleteFence {
        const Api* gl;
        void operator()(GLsync fence) const { gl->DeleteSync(fence); }
    };
    Handle<delete_buffer> buffer_;
    std::unique_ptr<std::remove_pointer_t<GLsync>, DeleteFence> fence_{nullptr, DeleteFence{nullptr}};
    int width_ = 0, height_ = 0;
};

} // namespace sheetsplat::gl

// Buffers of OpenGL.
#include <algorithm>
#include <cstring>
#include <limits>
#include <string>

#include "gl/objects.hpp"
#include "platforms.hpp"
#include "sheetsplat/error.hpp"

namespace sheetsplat::gl {

namespace {

/// Most storage that is reserved in advance for a frame's vertices.
constexpr std::size_t most_ring_bytes = std::size_t{16} << 20;

} // namespace

void delete_buffer(const Api& gl, GLuint name) { gl.DeleteBuffers(1, &name); }
void delete_vertex_array(const Api& gl, GLuint name) { gl.DeleteVertexArrays(1, &name); }

Buffer::Buffer(const Api& gl, GLenum target) : target_(target) {
    GLuint name = 0;
    gl.GenBuffers(1, &name);
    handle_ = Handle<delete_buffer>(gl, name);
}

void Buffer::bind() const { handle_.api().BindBuffer(target_, name()); }

void Buffer::bind_storage(GLuint index) const { handle_.api().BindBufferBase(GL_SHADER_STORAGE_BUFFER, index, name()); }

void Buffer::read(void* to, std::size_t bytes) const {
    const Api& gl = handle_.api();
    gl.BindBuffer(GL_COPY_READ_BUFFER, name());
    gl.GetBufferSubData(GL_COPY_READ_BUFFER, 0, static_cast<GLsizeiptr>(bytes), to);
    check_errors(gl, "reading a buffer back");
}

void* Buffer::map(std::size_t bytes) {
    const Api& gl = handle_.api();
    // GL_COPY_WRITE_BUFFER, since binding to GL_ELEMENT_ARRAY_BUFFER would change the bound vertex array.
    gl.BindBuffer(GL_COPY_WRITE_BUFFER, name());
    std::size_t capacity = std::max<std::size_t>(capacity_, 1);
    if (bytes > capacity) {
        // At least half more than before, so that slowly growing contents rarely need new memory.
        capacity = std::max(bytes, capacity_ + capacity_ / 2);
    }
    constexpr auto most = static_cast<std::size_t>(std::numeric_limits<GLsizeiptr>::max());
    const auto refuse = [&](const std::string& found) {
        // The buffer's contents are undefined now.
        capacity_ = 0;
        throw OutOfMemory(Complaint{"the device has no memory for a buffer", std::to_string(bytes) + " bytes: " + found,
                                    "", "draw fewer kernels at once, or free memory of the device"});
    };
    if (capacity > most) {
        refuse("more than the address space");
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
        // The storage doubles for later frames; queued drawing commands keep the old one.
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

void Buffer::upload_next(const void* data, std::size_t bytes) {
    std::memcpy(map_next(bytes), data, bytes);
    unmap();
}

void Buffer::attribute(GLuint location, int components, GLenum type, std::size_t stride, std::size_t begin,
                       GLuint divisor) const {
    const Api& gl = handle_.api();
    bind();
    gl.EnableVertexAttribArray(location);
    gl.VertexAttribPointer(location, components, type, GL_FALSE, static_cast<GLsizei>(stride),
                           reinterpret_cast<const void*>(offset_ + begin));
    gl.VertexAttribDivisor(location, divisor);
}

VertexArray::VertexArray(const Api& gl) {
    GLuint name = 0;
    gl.GenVertexArrays(1, &name);
    handle_ = Handle<delete_vertex_array>(gl, name);
}

void VertexArray::bind() const { handle_.api().BindVertexArray(name()); }

} // namespace sheetsplat::gl

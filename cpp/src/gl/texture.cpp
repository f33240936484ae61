// Textures of OpenGL.
#include <algorithm>
#include <string>

#include "gl/objects.hpp"
#include "platforms.hpp"
#include "sheetsplat/error.hpp"
#include "texture_formats.hpp"

namespace sheetsplat::gl {

namespace {

// Making and filling a texture binds it; that happens at the last unit that OpenGL 3.3 promises over all stages, beyond
// those that a single stage has, so that the bindings that passes work with stay as they are.
constexpr int work_unit = 47;

GLenum target_of(int layers) { return layers > 0 ? GL_TEXTURE_2D_ARRAY : GL_TEXTURE_2D; }

void bind_for_work(const Api& gl, GLenum target, GLuint name) {
    gl.ActiveTexture(static_cast<GLenum>(GL_TEXTURE0 + work_unit));
    gl.BindTexture(target, name);
}

} // namespace

std::size_t bytes_of(const Format& format, int width, int height, int layers) {
    return static_cast<std::size_t>(width) * static_cast<std::size_t>(height) *
           static_cast<std::size_t>(std::max(layers, 1)) * format.bytes;
}

void delete_texture(const Api& gl, GLuint name) { gl.DeleteTextures(1, &name); }

Texture::Texture(const Api& gl, GLenum internal_format, int width, int height, int layers)
    : width_(width), height_(height), layers_(layers), internal_format_(internal_format) {
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
    require_room(bytes_of(format, width, height, layers), "a texture of " + in_pixels(width, height) + " pixels");
    check_errors(gl, "before a texture was made");

    GLuint name = 0;
    gl.GenTextures(1, &name);
    handle_ = Handle<delete_texture>(gl, name);
    const GLenum target = target_of(layers);
    bind_for_work(gl, target, name);
    gl.TexParameteri(target, GL_TEXTURE_MIN_FILTER, GL_NEAREST);
    gl.TexParameteri(target, GL_TEXTURE_MAG_FILTER, GL_NEAREST);
    gl.TexParameteri(target, GL_TEXTURE_WRAP_S, GL_CLAMP_TO_EDGE);
    gl.TexParameteri(target, GL_TEXTURE_WRAP_T, GL_CLAMP_TO_EDGE);
    gl.TexParameteri(target, GL_TEXTURE_MAX_LEVEL, 0);
    const auto format_of_storage = static_cast<GLint>(internal_format);
    if (gl.VERSION_4_2 != 0) {
        layers > 0 ? gl.TexStorage3D(target, 1, internal_format, width, height, layers)
                   : gl.TexStorage2D(target, 1, internal_format, width, height);
    } else if (layers > 0) {
        gl.TexImage3D(target, 0, format_of_storage, width, height, layers, 0, format.format, format.type, nullptr);
    } else {
        gl.TexImage2D(target, 0, format_of_storage, width, height, 0, format.format, format.type, nullptr);
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
    return handle_ ? bytes_of(format_of(internal_format_), width_, height_, layers_) : 0;
}

void Texture::upload(GLenum format, GLenum type, const void* pixels) const {
    const Api& gl = handle_.api();
    const GLenum target = target_of(layers_);
    bind_for_work(gl, target, name());
    gl.BindBuffer(GL_PIXEL_UNPACK_BUFFER, 0);
    gl.PixelStorei(GL_UNPACK_ALIGNMENT, 1);
    if (layers_ > 0) {
        gl.TexSubImage3D(target, 0, 0, 0, 0, width_, height_, layers_, format, type, pixels);
    } else {
        gl.TexSubImage2D(target, 0, 0, 0, width_, height_, format, type, pixels);
    }
    check_errors(gl, "filling a texture");
}

void Texture::bind(int unit) const {
    const Api& gl = handle_.api();
    gl.ActiveTexture(static_cast<GLenum>(GL_TEXTURE0 + unit));
    gl.BindTexture(target_of(layers_), name());
}

void Texture::bind_image(int unit) const {
    handle_.api().BindImageTexture(static_cast<GLuint>(unit), name(), 0, GL_FALSE, 0, GL_READ_WRITE, internal_format_);
}

VolumeTexture::VolumeTexture(const Api& gl, GLenum internal_format, int width, int height, int depth)
    : width_(width), height_(height), depth_(depth), internal_format_(internal_format) {
    const Format& format = format_of(internal_format);
    const std::string size = in_pixels(width, height) + " x " + std::to_string(depth);
    GLint largest = 0;
    gl.GetIntegerv(GL_MAX_3D_TEXTURE_SIZE, &largest);
    if (std::max({width, height, depth}) > largest) {
        throw Unsupported(Complaint{"a volume is larger than this device supports", size,
                                    "at most " + std::to_string(largest) + " along each axis", "draw it in bricks"});
    }
    require_room(bytes_of(format, width, height, depth), "a volume of " + size);
    check_errors(gl, "before a volume was made");
    GLuint name = 0;
    gl.GenTextures(1, &name);
    handle_ = Handle<delete_texture>(gl, name);
    bind_for_work(gl, GL_TEXTURE_3D, name);
    gl.TexParameteri(GL_TEXTURE_3D, GL_TEXTURE_MIN_FILTER, GL_NEAREST);
    gl.TexParameteri(GL_TEXTURE_3D, GL_TEXTURE_MAG_FILTER, GL_NEAREST);
    gl.TexParameteri(GL_TEXTURE_3D, GL_TEXTURE_MAX_LEVEL, 0);
    gl.TexImage3D(GL_TEXTURE_3D, 0, static_cast<GLint>(internal_format), width, height, depth, 0, format.format,
                  format.type, nullptr);
    const GlErrors errors = take_errors(gl);
    if (!errors.names.empty()) {
        throw OutOfMemory(Complaint{"the device has no memory for a volume",
                                    std::string(format.name) + ", " + size + ": " + errors.names, "",
                                    "draw it in bricks, or free memory of the device"});
    }
}

void VolumeTexture::upload(int first, int count, const void* texels) const {
    const Api& gl = handle_.api();
    const Format& format = format_of(internal_format_);
    bind_for_work(gl, GL_TEXTURE_3D, handle_.name());
    gl.BindBuffer(GL_PIXEL_UNPACK_BUFFER, 0);
    gl.PixelStorei(GL_UNPACK_ALIGNMENT, 1);
    gl.TexSubImage3D(GL_TEXTURE_3D, 0, 0, 0, first, width_, height_, count, format.format, format.type, texels);
    check_errors(gl, "filling a volume");
}

void VolumeTexture::bind(int unit) const {
    const Api& gl = handle_.api();
    gl.ActiveTexture(static_cast<GLenum>(GL_TEXTURE0 + unit));
    gl.BindTexture(GL_TEXTURE_3D, handle_.name());
}

std::size_t VolumeTexture::bytes() const {
    return handle_ ? bytes_of(format_of(internal_format_), width_, height_, depth_) : 0;
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

} // namespace sheetsplat::gl

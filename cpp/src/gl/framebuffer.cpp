// Framebuffers of OpenGL.
#include <algorithm>
#include <string>

#include "gl/objects.hpp"
#include "platforms.hpp"
#include "sheetsplat/error.hpp"
#include "texture_formats.hpp"

namespace sheetsplat::gl {

namespace {

const char* name_of(GLenum status) {
    switch (status) {
    case GL_FRAMEBUFFER_INCOMPLETE_ATTACHMENT:
        return "GL_FRAMEBUFFER_INCOMPLETE_ATTACHMENT: the format of an attachment cannot be drawn to, or is of the "
               "wrong "
               "kind (colour, depth)";
    case GL_FRAMEBUFFER_INCOMPLETE_MISSING_ATTACHMENT:
        return "GL_FRAMEBUFFER_INCOMPLETE_MISSING_ATTACHMENT: it has no attachments";
    case GL_FRAMEBUFFER_UNSUPPORTED:
        return "GL_FRAMEBUFFER_UNSUPPORTED: the driver does not draw to this combination of formats";
    default:
        return "a status that it should not have";
    }
}

std::string described(const Texture* texture) {
    return texture == nullptr ? std::string("none")
                              : std::string(format_of(texture->internal_format()).name) + " " +
                                    in_pixels(texture->width(), texture->height());
}

} // namespace

void delete_framebuffer(const Api& gl, GLuint name) { gl.DeleteFramebuffers(1, &name); }

Framebuffer::Framebuffer(const Api& gl, const std::vector<Attachment>& colors, const Texture* depth) {
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
    for (std::size_t i = 0; i < colors.size(); ++i) {
        const auto attachment = static_cast<GLenum>(GL_COLOR_ATTACHMENT0 + i);
        draw_buffers.push_back(attachment);
        const auto& [texture, layer] = colors[i];
        if (texture->layers() > 0) {
            gl.FramebufferTextureLayer(GL_FRAMEBUFFER, attachment, texture->name(), 0, layer);
        } else {
            gl.FramebufferTexture2D(GL_FRAMEBUFFER, attachment, GL_TEXTURE_2D, texture->name(), 0);
        }
    }
    if (depth != nullptr) {
        gl.FramebufferTexture2D(GL_FRAMEBUFFER, GL_DEPTH_ATTACHMENT, GL_TEXTURE_2D, depth->name(), 0);
    }
    if (draw_buffers.empty()) {
        gl.DrawBuffer(GL_NONE);
    } else {
        gl.DrawBuffers(static_cast<GLsizei>(draw_buffers.size()), draw_buffers.data());
    }
    gl.ReadBuffer(colors.empty() ? GL_NONE : GL_COLOR_ATTACHMENT0);
    const GLenum status = gl.CheckFramebufferStatus(GL_FRAMEBUFFER);
    const GlErrors errors = take_errors(gl);
    gl.BindFramebuffer(GL_DRAW_FRAMEBUFFER, static_cast<GLuint>(draw_before));
    gl.BindFramebuffer(GL_READ_FRAMEBUFFER, static_cast<GLuint>(read_before));

    if (status == GL_FRAMEBUFFER_COMPLETE && errors.names.empty()) {
        return;
    }
    std::string found = status == GL_FRAMEBUFFER_COMPLETE ? std::string() : std::string(name_of(status)) + "; ";
    found += errors.names.empty() ? "" : errors.names + "; ";
    for (std::size_t i = 0; i < colors.size(); ++i) {
        found += "colour " + std::to_string(i) + ": " + described(colors[i].texture) + ", ";
    }
    found += "depth: " + described(depth);
    throw Error(Complaint{"a framebuffer is not complete", found, "attachments that this device can draw to together",
                          "choose other formats for them"});
}

void Framebuffer::bind() const { handle_.api().BindFramebuffer(GL_FRAMEBUFFER, name()); }

} // namespace sheetsplat::gl

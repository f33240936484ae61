#include "texture_formats.hpp"

#include <algorithm>
#include <array>

#include "sheetsplat/error.hpp"

namespace sheetsplat::gl {

namespace {

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

} // namespace

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
                      "add it to the table in gl/texture_formats.cpp if OpenGL 3.3 has it"});
    }
    return *found;
}

std::string in_pixels(int width, int height) { return std::to_string(width) + " x " + std::to_string(height); }

} // namespace sheetsplat::gl

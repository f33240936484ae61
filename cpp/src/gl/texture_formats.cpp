#include "texture_formats.hpp"

#include <algorithm>
#include <array>

#include "sheetsplat/error.hpp"

namespace sheetsplat::gl {

namespace {

constexpr std::array<Format, 15> formats = {{
    {GL_R8, GL_RED, GL_UNSIGNED_BYTE, 1, "GL_R8"},
    {GL_R8UI, GL_RED_INTEGER, GL_UNSIGNED_BYTE, 1, "GL_R8UI"},
    {GL_R16, GL_RED, GL_UNSIGNED_SHORT, 2, "GL_R16"},
    {GL_RGBA8, GL_RGBA, GL_UNSIGNED_BYTE, 4, "GL_RGBA8"},
    {GL_RGBA16F, GL_RGBA, GL_HALF_FLOAT, 8, "GL_RGBA16F"},
    {GL_R32F, GL_RED, GL_FLOAT, 4, "GL_R32F"},
    {GL_RG32F, GL_RG, GL_FLOAT, 8, "GL_RG32F"},
    {GL_RGBA32F, GL_RGBA, GL_FLOAT, 16, "GL_RGBA32F"},
    {GL_R32I, GL_RED_INTEGER, GL_INT, 4, "GL_R32I"},
    {GL_R32UI, GL_RED_INTEGER, GL_UNSIGNED_INT, 4, "GL_R32UI"},
    {GL_RG32I, GL_RG_INTEGER, GL_INT, 8, "GL_RG32I"},
    {GL_RGBA32I, GL_RGBA_INTEGER, GL_INT, 16, "GL_RGBA32I"},
    {GL_RG32UI, GL_RG_INTEGER, GL_UNSIGNED_INT, 8, "GL_RG32UI"},
    {GL_DEPTH_COMPONENT24, GL_DEPTH_COMPONENT, GL_UNSIGNED_INT, 4, "GL_DEPTH_COMPONENT24"},
    {GL_DEPTH_COMPONENT32F, GL_DEPTH_COMPONENT, GL_FLOAT, 4, "GL_DEPTH_COMPONENT32F"},
}};

} // namespace

const Format& format_of(GLenum internal) {
    const auto* found =
        std::find_if(formats.begin(), formats.end(), [&](const Format& each) { return each.internal == internal; });
    if (found == formats.end()) {
        throw InvalidInput(Complaint{"a texture cannot have this internal format", std::to_string(internal),
                                     "a format of the table in gl/texture_formats.cpp", ""});
    }
    return *found;
}

std::string in_pixels(int width, int height) { return std::to_string(width) + " x " + std::to_string(height); }

} // namespace sheetsplat::gl

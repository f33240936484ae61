// Formats of textures that passes use, and what a texel of each takes.
#pragma once

#include <cstddef>
#include <string>

#include "gl/context.hpp"

namespace sheetsplat::gl {

struct Format {
    GLenum internal;
    GLenum format; ///< that glTexImage2D accepts with it
    GLenum type;
    std::size_t bytes; ///< a texel
    const char* name;
};

/// Throws InvalidInput for formats that are not in the table.
const Format& format_of(GLenum internal);
/// "640 x 480"
std::string in_pixels(int width, int height);

} // namespace sheetsplat::gl

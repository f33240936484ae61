// The GLSL files of glsl/, made strings at build.
#pragma once

#include <map>
#include <string>

namespace sheetsplat::backend_gl {

/// Path below glsl/ -> text.
const std::map<std::string, std::string>& embedded_glsl();

} // namespace sheetsplat::backend_gl

// The GLSL files of cpp/lab/glsl, made strings at build.
#pragma once

#include <map>
#include <string>

namespace sheetsplat::lab {

/// Path below glsl/ -> text.
const std::map<std::string, std::string>& embedded_glsl();

} // namespace sheetsplat::lab

// The text of shader stages: GLSL files with #include, specialised by #defines.
#pragma once

#include <map>
#include <string>
#include <vector>

namespace sheetsplat::gl {

/// The GLSL files, by path: "splat.vert", "lib/phong.glsl".
using SourceFiles = std::map<std::string, std::string>;

/// NAME -> value; sorted, so that equal sets compare equal.
using Defines = std::map<std::string, std::string>;

/// The text of one stage: version_line, the defines, then `file` with every line #include "lib/x.glsl" replaced by that
/// file; the compiler skips a second include of a file. #line directives trace a compiler's message: source string
/// number = position in `files_used`. Throws Error for a missing file or an include that contains itself.
struct StageSource {
    std::string text;
    std::vector<std::string> files_used;
};
StageSource preprocess(const SourceFiles& files, const std::string& file, const std::string& version_line,
                       const Defines& defines);

/// A compiler's message in which places as Mesa, NVIDIA or glslang write them are replaced by files and lines of
/// `source`, each with that line of the file. Lines that name no place stay as they are; at most 40.
std::string translate_log(const std::string& log, const StageSource& source, const SourceFiles& files);

} // namespace sheetsplat::gl

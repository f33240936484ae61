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

/// The text of one stage: "#version", the defines, then `file` with every #include "lib/x.glsl" replaced by that file,
/// once (a second include of the same file is empty), with #line directives so that a compiler's message can be traced:
/// source string number = position in `files_used`. Throws Error for a missing file or an include that contains itself.
///
/// Includes may stand inside #if: whether an earlier one counts is then left to the compiler by a guard. Groups on
/// __cplusplus are decided here, as GLSL would, and become empty lines, as do "#pragma once" and the files' own
/// "#version". Each file must close the conditions and comments that it opens.
struct StageSource {
    std::string text;
    std::vector<std::string> files_used;
};
StageSource preprocess(const SourceFiles& files, const std::string& file, const std::string& version_line,
                       const Defines& defines);

/// A compiler's message with the places that it names, in the manner of Mesa, NVIDIA or glslang, turned into files and
/// lines of `source`, each with that line of the file. Lines that name no place are passed on; at most 40.
std::string translate_log(const std::string& log, const StageSource& source, const SourceFiles& files);

} // namespace sheetsplat::gl

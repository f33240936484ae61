// What a shared library needs, as its file says.
#pragma once

#include <string>
#include <vector>

namespace sheetsplat::gl {

/// Names of the libraries that an ELF file of this machine's kind needs (DT_NEEDED), in their order; none where the
/// file is no such, or damaged. Offsets and lengths in the file are checked before they are used.
std::vector<std::string> needed_libraries(const std::string& path);

} // namespace sheetsplat::gl

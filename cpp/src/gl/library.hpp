// Libraries that are found while the program runs.
#pragma once

#include <string>

namespace sheetsplat::gl {

/// A library opened by name or path; handle is null where it could not be, and story says why (or what was opened).
struct Library {
    void* handle = nullptr;
    std::string story;

    /// Address of a symbol, or null.
    [[nodiscard]] void* symbol(const char* name) const;
};

/// Adds a step to a story.
void tell(std::string& story, const std::string& step);

/// Opens the first of `names` (nullptr ends them) that can be opened. A path may lie beside libraries that it needs.
/// Libraries stay open until the process ends.
Library open_library(const char* const* names);

/// The value of an environment variable; "" where it is not set.
std::string environment(const char* name);

} // namespace sheetsplat::gl

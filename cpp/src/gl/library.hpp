// Shared libraries that are opened at run time.
#pragma once

#include <string>

namespace sheetsplat::gl {

/// A library opened by name or path; handle is null where it could not be, and story says why (or what was opened).
struct Library {
    void* handle = nullptr;
    std::string story;

    /// Sets `function` to the address of a symbol, or null; returns whether there is one.
    template <class Function>
    bool find(const char* name, Function& function) const {
        function = reinterpret_cast<Function>(symbol(name));
        return function != nullptr;
    }

  private:
    [[nodiscard]] void* symbol(const char* name) const;
};

/// Appends a step to the account of an attempt.
void tell(std::string& story, const std::string& step);

/// Opens the first of `names` (nullptr ends them) that can be opened. A path may lie beside libraries that it needs.
/// Libraries stay open until the process ends.
Library open_library(const char* const* names);

/// The value of an environment variable; "" where it is not set.
std::string environment(const char* name);

} // namespace sheetsplat::gl

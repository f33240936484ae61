#include "library.hpp"

#include <cstdlib>

#include <dlfcn.h>

#include "needed_libraries.hpp"

namespace sheetsplat::gl {

namespace {

// RTLD_LOCAL: two Mesas of different versions in one process must not resolve each other's symbols. There is no dlclose
// anywhere: drivers register thread and exit handlers that would then point into unmapped code.
void* open_quietly(const std::string& name) { return dlopen(name.c_str(), RTLD_NOW | RTLD_LOCAL); }

std::string last_reason(const std::string& name) {
    const char* reason = dlerror();
    return reason != nullptr ? reason : name;
}

// A library from a Python wheel lies in one folder with its dependencies but has no search path to them, because the
// wheel loads them itself. Those that the linker does not find are opened from that folder first; at most `left`.
void* open_with_neighbours(const std::string& path, int& left, std::string& reason) {
    void* handle = open_quietly(path);
    if (handle != nullptr) {
        return handle;
    }
    reason = last_reason(path);
    const std::size_t slash = path.rfind('/');
    if (slash == std::string::npos) {
        return nullptr;
    }
    bool opened = false;
    for (const std::string& name : needed_libraries(path)) {
        if (name.find('/') != std::string::npos || open_quietly(name) != nullptr) {
            continue;
        }
        if (--left < 0) {
            return nullptr;
        }
        std::string of_neighbour;
        opened = open_with_neighbours(path.substr(0, slash + 1) + name, left, of_neighbour) != nullptr || opened;
    }
    if (opened) {
        handle = open_quietly(path);
        reason = handle == nullptr ? last_reason(path) : "";
    }
    return handle;
}

} // namespace

void* Library::symbol(const char* name) const { return handle == nullptr ? nullptr : dlsym(handle, name); }

Library open_library(const char* const* names) {
    Library library;
    for (; *names != nullptr; ++names) {
        int neighbours = 64;
        std::string reason;
        library.handle = open_with_neighbours(*names, neighbours, reason);
        if (library.handle != nullptr) {
            library.story = std::string(*names) + " loaded";
            return library;
        }
        tell(library.story, reason);
    }
    return library;
}

void tell(std::string& story, const std::string& step) { story += (story.empty() || step.empty() ? "" : "; ") + step; }

std::string environment(const char* name) {
    const char* value = std::getenv(name);
    return value != nullptr ? value : "";
}

} // namespace sheetsplat::gl

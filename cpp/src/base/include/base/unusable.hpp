// The first field of errors about one option.
#pragma once

#include <string>

#include "sheetsplat/error.hpp"

namespace sheetsplat {

/// "Camera: up cannot be used", with a reference to the option `up`.
inline Words unusable(const char* owner, const char* option) {
    return std::string(owner) + ": " + option_ref(option) + " cannot be used";
}

} // namespace sheetsplat

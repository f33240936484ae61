// The errors of the library. Every message has four parts: what failed, what was found, what was wanted, what to do
// next.
#pragma once

#include <stdexcept>
#include <string>

namespace sheetsplat {

/// The four parts of a message. Empty parts are left out of the text.
struct Complaint {
    std::string failed; ///< what could not be done: "RegularField: the samples cannot be used"
    std::string found;  ///< what was there instead of what was needed
    std::string wanted; ///< what would have been right
    std::string next;   ///< what the reader can do about it

    [[nodiscard]] std::string text() const;
};

/// Base of all errors that this library throws on purpose.
class Error : public std::runtime_error {
  public:
    explicit Error(const Complaint& complaint);
    explicit Error(const std::string& text);
};

/// A number, an array or an option that has no meaning here.
class InvalidInput : public Error {
  public:
    using Error::Error;
};

/// No OpenGL context (or other device) could be made; the text lists every try.
class DeviceUnavailable : public Error {
  public:
    using Error::Error;
};

/// More memory would be needed than there is; nothing was left allocated.
class OutOfMemory : public Error {
  public:
    using Error::Error;
};

/// A sensible request that this backend, or this version, cannot fulfil within its error bound.
class Unsupported : public Error {
  public:
    using Error::Error;
};

/// The progress callback asked to stop. Not a failure; the renderer stays usable.
class Cancelled : public Error {
  public:
    using Error::Error;
};

} // namespace sheetsplat

// The errors of the library. An error carries its message in fields, and the message refers to options by name, so that
// each front end (C++, Python, command line) spells options its own way and none has to search the text.
#pragma once

#include <functional>
#include <memory>
#include <stdexcept>
#include <string>
#include <variant>
#include <vector>

namespace sheetsplat {

/// A reference to an option within a message.
struct OptionRef {
    std::string name; ///< the member of the options struct, which is Python's argument too: "max_error"
    std::string
        value{}; ///< true, false, a number, the name of an enumerator; "...": any value; empty: the option alone
};

/// How C++ spells a reference: `allow_inexact = true`, `max_error`.
[[nodiscard]] std::string spelled_in_cpp(const OptionRef& option);

/// A text in pieces, each of which is literal text or a reference to an option. Made from strings without a cast.
class Words {
  public:
    using Piece = std::variant<std::string, OptionRef>;
    using Spelling = std::function<std::string(const OptionRef&)>;

    Words() = default;
    Words(std::string text); // NOLINT(google-explicit-constructor): messages are written as plain strings
    Words(const char* text); // NOLINT(google-explicit-constructor)
    explicit Words(OptionRef option);

    Words& operator+=(const Words& other);
    friend Words operator+(Words first, const Words& second) { return first += second; }

    [[nodiscard]] bool empty() const { return pieces_.empty(); }
    [[nodiscard]] const std::vector<Piece>& pieces() const { return pieces_; }
    [[nodiscard]] std::string text(const Spelling& spelling = spelled_in_cpp) const;

  private:
    std::vector<Piece> pieces_; // no empty strings
};

/// A piece of a message that refers to an option: `"pass " + option_ref("allow_inexact", "true")`.
[[nodiscard]] Words option_ref(std::string name, std::string value = {});

/// The fields of a message. Empty fields are left out of the text.
struct Complaint {
    Words what{};   ///< what could not be done: "RegularField: the samples cannot be used"
    Words found{};  ///< the value or state that prevented it
    Words wanted{}; ///< what would have been accepted
    Words advice{}; ///< what the reader can do next
    std::string
        option{}; ///< what the error is about; if empty, Error takes the option that alone is referred to in `what`

    /// All fields as one text: "what: found ...; wanted ...; advice".
    [[nodiscard]] Words words() const;
    [[nodiscard]] std::string text(const Words::Spelling& spelling = spelled_in_cpp) const;
};

/// Base of all errors that this library throws on purpose. what() is the complaint's text, spelled in C++.
class Error : public std::runtime_error {
  public:
    explicit Error(Complaint complaint);

    [[nodiscard]] const Complaint& complaint() const { return *complaint_; }

  private:
    std::shared_ptr<const Complaint> complaint_; // shared: copies of an exception must not throw
};

/// A number, an array, a file or an option that has no meaning here.
class InvalidInput : public Error {
  public:
    using Error::Error;
};

/// No OpenGL context (or other device) could be made; the text lists every attempt.
class DeviceUnavailable : public Error {
  public:
    using Error::Error;
};

/// More memory would be needed than is available; nothing was left allocated.
class OutOfMemory : public Error {
  public:
    using Error::Error;
};

/// A valid request that this backend, or this version, cannot fulfil within its error bound.
class Unsupported : public Error {
  public:
    using Error::Error;
};

/// The progress callback asked to stop. Not a failure; the renderer stays usable.
class Cancelled : public Error {
  public:
    Cancelled();
};

} // namespace sheetsplat

#include "sheetsplat/error.hpp"

#include <utility>

namespace sheetsplat {
namespace {

/// The name of the one option that a text refers to; empty where there is none, or more than one.
std::string only_option(const Words& words) {
    std::string name;
    for (const Words::Piece& piece : words.pieces()) {
        if (const auto* option = std::get_if<OptionRef>(&piece)) {
            if (!name.empty() && name != option->name) {
                return {};
            }
            name = option->name;
        }
    }
    return name;
}

} // namespace

std::string spelled_in_cpp(const OptionRef& option) {
    return option.value.empty() ? option.name : option.name + " = " + option.value;
}

Words::Words(std::string text) {
    if (!text.empty()) {
        pieces_.emplace_back(std::move(text));
    }
}

Words::Words(const char* text) : Words(std::string(text)) {}

Words::Words(OptionRef option) { pieces_.emplace_back(std::move(option)); }

Words& Words::operator+=(const Words& other) {
    pieces_.reserve(pieces_.size() + other.pieces_.size()); // `other` may be *this
    for (std::size_t i = 0, count = other.pieces_.size(); i < count; ++i) {
        pieces_.push_back(other.pieces_[i]);
    }
    return *this;
}

std::string Words::text(const Spelling& spelling) const {
    std::string result;
    for (const Piece& piece : pieces_) {
        const auto* option = std::get_if<OptionRef>(&piece);
        result += option != nullptr ? spelling(*option) : std::get<std::string>(piece);
    }
    return result;
}

Words option_ref(std::string name, std::string value) { return Words(OptionRef{std::move(name), std::move(value)}); }

Words Complaint::words() const {
    Words result = what;
    const char* separator = what.empty() ? "" : ": ";
    const auto add = [&](const char* introduction, const Words& part) {
        if (!part.empty()) {
            result += std::string(separator) + introduction;
            result += part;
            separator = "; ";
        }
    };
    add("found ", found);
    add("wanted ", wanted);
    add("", advice);
    return result;
}

std::string Complaint::text(const Words::Spelling& spelling) const { return words().text(spelling); }

Error::Error(Complaint complaint) : std::runtime_error(complaint.text()) {
    if (complaint.option.empty()) {
        complaint.option = only_option(complaint.what);
    }
    complaint_ = std::make_shared<const Complaint>(std::move(complaint));
}

Cancelled::Cancelled() : Error(Complaint{"the rendering was cancelled by its progress callback"}) {}

} // namespace sheetsplat

#include "sheetsplat/error.hpp"

namespace sheetsplat {

std::string Complaint::text() const {
    std::string result = failed;
    const char* separator = failed.empty() ? "" : ": ";
    const auto add = [&](const char* introduction, const std::string& part) {
        if (!part.empty()) {
            result += separator;
            result += introduction;
            result += part;
            separator = "; ";
        }
    };
    add("found ", found);
    add("wanted ", wanted);
    add("", next);
    return result;
}

Error::Error(const Complaint& complaint) : std::runtime_error(complaint.text()) {}

Error::Error(const std::string& text) : std::runtime_error(text) {}

} // namespace sheetsplat

#include "gl/shader_source.hpp"

#include <algorithm>
#include <regex>
#include <sstream>

#include "sheetsplat/error.hpp"

namespace sheetsplat::gl {

namespace {

/// Replaces the includes of one stage.
class Expansion {
  public:
    explicit Expansion(const SourceFiles& files) : files_(files) {}

    void expand(const std::string& file, const std::string& included_at) {
        const auto found = files_.find(file);
        if (found == files_.end()) {
            throw Error(Complaint{"a shader file is missing",
                                  "\"" + file + "\"" + (included_at.empty() ? "" : ", included at " + included_at),
                                  "one of the shader files", "correct the name"});
        }
        if (std::find(open_.begin(), open_.end(), file) != open_.end()) {
            throw Error(Complaint{"a shader file includes itself", included_at + " includes " + file,
                                  "includes without a cycle", ""});
        }
        open_.push_back(file);
        static const std::regex include(R"(\s*#\s*include\s+"([^"]*)\".*)");
        const std::string number = number_of(file);
        source.text += "#line 1 " + number + "\n";
        std::istringstream lines(found->second);
        std::size_t at = 0;
        for (std::string line; std::getline(lines, line);) {
            ++at;
            std::smatch parts;
            if (!std::regex_match(line, parts, include)) {
                source.text += line + "\n";
                continue;
            }
            const std::string included = parts[1];
            // An include may stand inside #if, so only the compiler knows whether it is the first one of its file.
            const std::string guard = "SHEETSPLAT_INCLUDED_" + number_of(included);
            source.text.append("#ifndef ").append(guard).append("\n#define ").append(guard).append("\n");
            expand(included, file + ":" + std::to_string(at));
            source.text += "#endif\n#line " + std::to_string(at + 1) + " " + number + "\n";
        }
        open_.pop_back();
    }

    StageSource source;

  private:
    std::string number_of(const std::string& file) {
        std::vector<std::string>& used = source.files_used;
        const auto found = std::find(used.begin(), used.end(), file);
        const auto number = static_cast<std::size_t>(found - used.begin());
        if (found == used.end()) {
            used.push_back(file);
        }
        return std::to_string(number);
    }

    const SourceFiles& files_;
    std::vector<std::string> open_; ///< files that are being read, outermost first
};

/// Line `number` of a text, from 1 on; empty where there is no such line.
std::string line_of(const std::string& text, std::size_t number) {
    std::istringstream lines(text);
    std::string line;
    for (std::size_t at = 0; at < number; ++at) {
        if (!std::getline(lines, line)) {
            return {};
        }
    }
    return line;
}

} // namespace

StageSource preprocess(const SourceFiles& files, const std::string& file, const std::string& version_line,
                       const Defines& defines) {
    Expansion expansion(files);
    expansion.source.text = version_line + "\n";
    for (const auto& [name, value] : defines) {
        expansion.source.text.append("#define ").append(name).append(" ").append(value).append("\n");
    }
    expansion.expand(file, "");
    return std::move(expansion.source);
}

std::string translate_log(const std::string& log, const StageSource& source, const SourceFiles& files) {
    constexpr int most_lines = 40;
    // "0:12(5): error: text" (Mesa), "0(12) : error C1008: text" (NVIDIA), "ERROR: 0:12: text" (glslang).
    static const std::regex place(
        R"((?:ERROR: |WARNING: )?(\d{1,9})(?::(\d{1,9})(?:\(\d+\))?|\((\d{1,9})\)) ?:\s*(.*))");
    std::string text;
    std::istringstream lines(log);
    int count = 0;
    for (std::string line; std::getline(lines, line) && count < most_lines; ++count) {
        std::smatch parts;
        if (!std::regex_match(line, parts, place) || std::stoul(parts[1]) >= source.files_used.size()) {
            text += line.empty() ? "" : "\n  " + line;
            continue;
        }
        const std::string& file = source.files_used[std::stoul(parts[1])];
        const std::string number = parts[2].matched ? parts[2] : parts[3];
        const std::string shown = line_of(files.at(file), std::stoul(number));
        text.append("\n  ").append(file).append(":").append(number).append(": ").append(parts[4]);
        text += shown.empty() ? "" : "\n      " + number + " | " + shown;
    }
    return text;
}

} // namespace sheetsplat::gl

#include "gl/shader_source.hpp"

#include <cctype>
#include <charconv>
#include <optional>
#include <set>
#include <sstream>
#include <string_view>

#include "sheetsplat/error.hpp"

namespace sheetsplat::gl {

namespace {

std::vector<std::string> lines_of(const std::string& text) {
    std::vector<std::string> lines;
    std::istringstream stream(text);
    for (std::string line; std::getline(stream, line);) {
        if (!line.empty() && line.back() == '\r') {
            line.pop_back();
        }
        lines.push_back(line);
    }
    return lines;
}

// A line of the preprocessor: "# include <x>" -> {"include", "<x>"}.
struct Directive {
    std::string word;
    std::string rest;
};

std::string trimmed(const std::string& text) {
    const auto first = text.find_first_not_of(" \t");
    return first == std::string::npos ? std::string() : text.substr(first, text.find_last_not_of(" \t") - first + 1);
}

// The line without its comments; in_comment says whether a block comment is open, before and after.
std::string without_comments(const std::string& line, bool& in_comment) {
    std::string kept;
    for (std::size_t i = 0; i < line.size(); ++i) {
        const std::string two = line.substr(i, 2);
        if (in_comment) {
            if (two == "*/") {
                in_comment = false;
                kept += ' ';
                ++i;
            }
        } else if (two == "//") {
            break;
        } else if (two == "/*") {
            in_comment = true;
            ++i;
        } else {
            kept += line[i];
        }
    }
    return kept;
}

std::optional<Directive> directive_of(const std::string& line) {
    const std::string text = trimmed(line);
    if (text.empty() || text.front() != '#') {
        return std::nullopt;
    }
    const std::string after = trimmed(text.substr(1));
    const auto is_letter = [](char c) { return std::isalpha(static_cast<unsigned char>(c)) != 0; };
    const auto end = std::find_if_not(after.begin(), after.end(), is_letter);
    return Directive{std::string(after.begin(), end), trimmed(std::string(end, after.end()))};
}

bool is_identifier(const std::string& text) {
    const auto fits = [](char c) { return c == '_' || std::isalnum(static_cast<unsigned char>(c)) != 0; };
    return !text.empty() && std::isdigit(static_cast<unsigned char>(text.front())) == 0 &&
           std::all_of(text.begin(), text.end(), fits);
}

// 1 where the directive opens a group that only C++ reads, 0 where one that only GLSL reads, none for any other.
std::optional<bool> asks_for_cplusplus(const Directive& directive) {
    if (directive.word == "ifdef" || directive.word == "ifndef") {
        return directive.rest == "__cplusplus" ? std::optional<bool>(directive.word == "ifdef") : std::nullopt;
    }
    if (directive.word != "if") {
        return std::nullopt;
    }
    std::string condition;
    for (const char c : directive.rest) {
        if (c != ' ' && c != '\t' && c != '(' && c != ')') {
            condition += c;
        }
    }
    if (condition == "defined__cplusplus") {
        return true;
    }
    return condition == "!defined__cplusplus" ? std::optional<bool>(false) : std::nullopt;
}

class Preprocessor {
  public:
    explicit Preprocessor(const SourceFiles& files) : files_(files) {}

    void expand(const std::string& file, const std::string& included_from);
    StageSource take(std::string head) {
        result_.text = std::move(head) + text_;
        return std::move(result_);
    }

  private:
    // A conditional group that is open. Those on __cplusplus are decided here, since GLSL reserves that name and since
    // includes inside them are none of GLSL's; all others are left to the compiler.
    struct Group {
        int branch = 0;       // a number of its own for each branch of each group
        bool decided = false; // on __cplusplus
        bool skipped = false; // and its lines are for C++ only
    };

    [[nodiscard]] bool skipping() const {
        return std::any_of(groups_.begin(), groups_.end(), [](const Group& group) { return group.skipped; });
    }
    [[nodiscard]] std::vector<int> branches() const {
        std::vector<int> path;
        for (const Group& group : groups_) {
            if (!group.decided) {
                path.push_back(group.branch);
            }
        }
        return path;
    }
    // True where the compiler has certainly seen the file when it reads on here: it was included outside of any
    // condition, or in a branch that is still open.
    [[nodiscard]] bool seen(const std::string& file) const {
        const auto found = included_in_.find(file);
        const std::vector<int> here = branches();
        return found != included_in_.end() &&
               std::any_of(found->second.begin(), found->second.end(), [&](const std::vector<int>& there) {
                   return there.size() <= here.size() && std::equal(there.begin(), there.end(), here.begin());
               });
    }
    std::size_t number_of(const std::string& file) {
        const auto found = std::find(result_.files_used.begin(), result_.files_used.end(), file);
        if (found != result_.files_used.end()) {
            return static_cast<std::size_t>(found - result_.files_used.begin());
        }
        result_.files_used.push_back(file);
        return result_.files_used.size() - 1;
    }
    // Returns the line to emit for a directive that opens, turns or closes a group.
    std::string group_line(const Directive& directive, const std::string& line);
    void include(const Directive& directive, const std::string& from, std::size_t line);

    const SourceFiles& files_;
    StageSource result_;
    std::string text_;
    std::vector<std::string> open_; // the files that are being read, outermost first
    std::vector<Group> groups_;
    int branches_ = 0;
    std::map<std::string, std::vector<std::vector<int>>> included_in_;
};

std::string Preprocessor::group_line(const Directive& directive, const std::string& line) {
    const bool outer_skips = skipping();
    if (directive.word == "if" || directive.word == "ifdef" || directive.word == "ifndef") {
        const std::optional<bool> for_cplusplus = asks_for_cplusplus(directive);
        groups_.push_back(Group{++branches_, for_cplusplus.has_value(), for_cplusplus.value_or(false)});
        return outer_skips || for_cplusplus.has_value() ? std::string() : line;
    }
    if (groups_.empty()) {
        return line;
    }
    Group& group = groups_.back();
    if (directive.word == "endif") {
        const bool decided = group.decided;
        groups_.pop_back();
        return decided || skipping() ? std::string() : line;
    }
    // else, elif
    const bool decided = group.decided;
    group.branch = ++branches_;
    if (!decided) {
        return outer_skips ? std::string() : line;
    }
    if (directive.word == "elif") {
        throw Error(Complaint{"a shader file could not be read", open_.back() + " has #elif in a group on __cplusplus",
                              "#ifdef __cplusplus, #else, #endif", "nest an #if inside the #else"});
    }
    group.skipped = !group.skipped;
    return {};
}

void Preprocessor::include(const Directive& directive, const std::string& from, std::size_t line) {
    const std::string& quoted = directive.rest;
    const std::string place = from + ":" + std::to_string(line);
    if (quoted.size() < 3 || quoted.front() != '"' || quoted.find('"', 1) != quoted.size() - 1) {
        throw Error(Complaint{"a shader's #include could not be read", place + ": #include " + quoted,
                              "#include \"lib/x.glsl\"", ""});
    }
    const std::string file = quoted.substr(1, quoted.size() - 2);
    if (std::find(open_.begin(), open_.end(), file) != open_.end()) {
        std::string chain;
        for (const std::string& each : open_) {
            chain += each + " -> ";
        }
        throw Error(
            Complaint{"a shader file includes itself", place + ": " + chain + file, "includes without a circle", ""});
    }
    if (seen(file)) {
        text_ += "\n";
        return;
    }
    // Where an earlier include stands in a branch that the compiler may or may not take, only the compiler knows
    // whether this one is the first.
    const std::vector<int> here = branches();
    const bool guarded = !here.empty() || included_in_.count(file) != 0;
    included_in_[file].push_back(here);
    const std::string guard = "SHEETSPLAT_INCLUDED_" + std::to_string(number_of(file));
    if (guarded) {
        text_ += "#ifndef " + guard + "\n#define " + guard + "\n";
    }
    expand(file, place);
    if (guarded) {
        text_ += "#endif\n";
    }
    text_ += "#line " + std::to_string(line + 1) + " " + std::to_string(number_of(from)) + "\n";
}

void Preprocessor::expand(const std::string& file, const std::string& included_from) {
    const auto found = files_.find(file);
    if (found == files_.end()) {
        std::string known;
        for (const auto& each : files_) {
            known += (known.empty() ? "" : ", ") + each.first;
        }
        throw Error(
            Complaint{"a shader file is missing",
                      "\"" + file + "\"" + (included_from.empty() ? std::string() : ", included at " + included_from),
                      "one of " + (known.empty() ? std::string("no files at all") : known), "correct the name"});
    }
    text_ += "#line 1 " + std::to_string(number_of(file)) + "\n";
    open_.push_back(file);
    const std::size_t outer_groups = groups_.size();
    bool in_comment = false;
    std::size_t number = 0;
    for (const std::string& line : lines_of(found->second)) {
        ++number;
        const bool comment_before = in_comment;
        const std::string code = without_comments(line, in_comment);
        // A line inside of, or opening, a comment of several lines is passed on whole: the comment must stay balanced.
        const std::optional<Directive> directive = comment_before || in_comment ? std::nullopt : directive_of(code);
        const std::string word = directive ? directive->word : std::string();
        if (word == "if" || word == "ifdef" || word == "ifndef" || word == "else" || word == "elif" ||
            word == "endif") {
            if (word != "if" && word != "ifdef" && word != "ifndef" && groups_.size() <= outer_groups) {
                throw Error(Complaint{"a shader file could not be read",
                                      std::string(file)
                                          .append(":")
                                          .append(std::to_string(number))
                                          .append(": #")
                                          .append(word)
                                          .append(" without #if"),
                                      "conditions that begin and end in one file", ""});
            }
            text_ += group_line(*directive, line) + "\n";
        } else if (skipping() || word == "version" || (word == "pragma" && directive->rest == "once")) {
            text_ += "\n";
        } else if (word == "include") {
            include(*directive, file, number);
        } else {
            text_ += line + "\n";
        }
    }
    if (groups_.size() != outer_groups || in_comment) {
        throw Error(Complaint{"a shader file could not be read",
                              file + (in_comment ? " ends inside a comment" : " ends inside an #if"),
                              "conditions and comments that begin and end in one file", ""});
    }
    open_.pop_back();
}

// Reads `text` from the left, piece by piece.
class Reader {
  public:
    explicit Reader(std::string_view text) : rest_(text) {}

    bool take(std::string_view piece) {
        const bool there = rest_.substr(0, piece.size()) == piece;
        rest_.remove_prefix(there ? piece.size() : 0);
        return there;
    }
    bool take_number(std::size_t& number) {
        const char* end = rest_.data() + rest_.size();
        const auto [after, error] = std::from_chars(rest_.data(), end, number);
        rest_.remove_prefix(static_cast<std::size_t>(after - rest_.data()));
        return error == std::errc();
    }
    [[nodiscard]] std::string rest() const { return trimmed(std::string(rest_)); }

  private:
    std::string_view rest_;
};

// The place that a line of a compiler's message names.
struct Place {
    std::size_t source = 0;
    std::size_t line = 0;
    std::string message;
};

std::optional<Place> place_of(const std::string& text) {
    Place place;
    std::size_t column = 0;
    Reader mesa(text); // 0:12(5): error: text
    if (mesa.take_number(place.source) && mesa.take(":") && mesa.take_number(place.line) && mesa.take("(") &&
        mesa.take_number(column) && mesa.take("):")) {
        place.message = mesa.rest();
        return place;
    }
    Reader nvidia(text); // 0(12) : error C1008: text
    if (nvidia.take_number(place.source) && nvidia.take("(") && nvidia.take_number(place.line) && nvidia.take(")") &&
        (nvidia.take(" :") || nvidia.take(":"))) {
        place.message = nvidia.rest();
        return place;
    }
    Reader glslang(text); // ERROR: 0:12: text
    if ((glslang.take("ERROR: ") || glslang.take("WARNING: ")) && glslang.take_number(place.source) &&
        glslang.take(":") && glslang.take_number(place.line) && glslang.take(":")) {
        place.message = glslang.rest();
        return place;
    }
    return std::nullopt;
}

} // namespace

std::string translate_log(const std::string& log, const StageSource& source, const SourceFiles& files) {
    constexpr std::size_t most_lines = 40;
    std::string text;
    std::size_t count = 0;
    for (const std::string& line : lines_of(log)) {
        if (line.empty() || ++count > most_lines) {
            continue;
        }
        const std::optional<Place> place = place_of(line);
        if (!place || place->source >= source.files_used.size()) {
            text += "\n  " + line;
            continue;
        }
        const std::string& file = source.files_used[place->source];
        text.append("\n  ")
            .append(file)
            .append(":")
            .append(std::to_string(place->line))
            .append(": ")
            .append(place->message);
        const std::vector<std::string> lines = lines_of(files.at(file));
        if (place->line >= 1 && place->line <= lines.size()) {
            text += "\n      " + std::to_string(place->line) + " | " + lines[place->line - 1];
        }
    }
    return text;
}

StageSource preprocess(const SourceFiles& files, const std::string& file, const std::string& version_line,
                       const Defines& defines) {
    std::string head = version_line + "\n";
    for (const auto& [name, value] : defines) {
        if (!is_identifier(name) || value.find_first_of("\r\n") != std::string::npos) {
            throw Error(Complaint{"a shader cannot have this define",
                                  std::string("\"").append(name).append("\" = \"").append(value).append("\""),
                                  "an identifier and one line", ""});
        }
        head.append("#define ").append(name).append(" ").append(value).append("\n");
    }
    Preprocessor preprocessor(files);
    preprocessor.expand(file, "");
    return preprocessor.take(std::move(head));
}

} // namespace sheetsplat::gl

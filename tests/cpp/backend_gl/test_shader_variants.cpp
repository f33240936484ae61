// What is left of the shaders once a plan's defines are decided: nothing of effects that are off, and no branch on one.
#include <array>
#include <cctype>
#include <map>
#include <memory>
#include <regex>
#include <set>
#include <sstream>
#include <stdexcept>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "backend_gl/embedded_glsl.hpp"
#include "gl/program.hpp"
#include "plan/make_plan.hpp"
#include "shader_variants.hpp"
#include "support/lattices.hpp"

namespace sheetsplat::backend_gl {
namespace {

/// Decides the conditions of a shader's text as the GLSL preprocessor does. Macros are not replaced in the text.
class Decider {
  public:
    std::string decide(const std::string& text) {
        std::istringstream lines(text);
        std::string kept;
        for (std::string line; std::getline(lines, line);) {
            while (!line.empty() && line.back() == '\\') {
                line.pop_back();
                std::string more;
                std::getline(lines, more);
                line += more;
            }
            const auto comment = line.find("//");
            if (comment != std::string::npos) {
                line.erase(comment);
            }
            const auto first = line.find_first_not_of(" \t");
            if (first != std::string::npos && line[first] == '#') {
                directive(line.substr(first + 1));
            } else if (reading()) {
                kept += line + "\n";
            }
        }
        if (!groups_.empty()) {
            throw std::runtime_error("a condition is not closed");
        }
        return kept;
    }

  private:
    struct Group {
        bool reading, taken;
    };

    [[nodiscard]] bool reading() const {
        for (const Group& group : groups_) {
            if (!group.reading) {
                return false;
            }
        }
        return true;
    }

    void directive(const std::string& text) {
        std::istringstream words(text);
        std::string word, rest;
        words >> word;
        std::getline(words, rest);
        const std::string name = std::regex_replace(rest, std::regex("^\\s+|\\s+$"), "");
        if (word == "ifdef" || word == "ifndef") {
            open((macros_.count(name) != 0) == (word == "ifdef"));
        } else if (word == "if") {
            open(reading() && value_of(rest) != 0);
        } else if (word == "elif") {
            Group& group = groups_.back();
            group.reading = false;
            const bool now = !group.taken && reading_outside() && value_of(rest) != 0;
            group.reading = now;
            group.taken = group.taken || now;
        } else if (word == "else") {
            Group& group = groups_.back();
            group.reading = !group.taken;
            group.taken = true;
        } else if (word == "endif") {
            groups_.pop_back();
        } else if (word == "define" && reading()) {
            const auto end = name.find_first_of(" \t(");
            macros_[name.substr(0, end)] = end == std::string::npos || name[end] == '(' ? "" : name.substr(end);
        } else if (word == "undef" && reading()) {
            macros_.erase(name);
        }
    }

    void open(bool condition) { groups_.push_back({condition, condition}); }
    [[nodiscard]] bool reading_outside() const {
        for (std::size_t n = 0; n + 1 < groups_.size(); ++n) {
            if (!groups_[n].reading) {
                return false;
            }
        }
        return true;
    }

    // Expressions: a descent through the operators that the shaders use.
    long value_of(const std::string& text) {
        const std::string outer = std::exchange(text_, text);
        const std::size_t place = std::exchange(at_, 0);
        const long value = any();
        if (peek() != '\0') {
            throw std::runtime_error("a condition that is not understood: " + text);
        }
        text_ = outer;
        at_ = place;
        return value;
    }
    char peek() {
        while (at_ < text_.size() && std::isspace(static_cast<unsigned char>(text_[at_])) != 0) {
            ++at_;
        }
        return at_ < text_.size() ? text_[at_] : '\0';
    }
    bool take(const std::string& sign) {
        peek();
        if (text_.compare(at_, sign.size(), sign) != 0) {
            return false;
        }
        at_ += sign.size();
        return true;
    }
    long any() {
        long value = all();
        while (take("||")) {
            value = static_cast<long>(all() != 0 || value != 0);
        }
        return value;
    }
    long all() {
        long value = compared();
        while (take("&&")) {
            value = static_cast<long>(compared() != 0 && value != 0);
        }
        return value;
    }
    long compared() {
        const long left = sum();
        for (const char* sign : {"==", "!=", ">=", "<=", ">", "<"}) {
            if (take(sign)) {
                const long right = sum();
                const std::string s = sign;
                return static_cast<long>(s == "=="   ? left == right
                                         : s == "!=" ? left != right
                                         : s == ">=" ? left >= right
                                         : s == "<=" ? left <= right
                                         : s == ">"  ? left > right
                                                     : left < right);
            }
        }
        return left;
    }
    long sum() {
        long value = single();
        for (;;) {
            if (take("+")) {
                value += single();
            } else if (take("-")) {
                value -= single();
            } else {
                return value;
            }
        }
    }
    long single() {
        if (peek() == '!' && text_.compare(at_, 2, "!=") != 0) {
            ++at_;
            return static_cast<long>(single() == 0);
        }
        if (take("(")) {
            const long value = any();
            take(")");
            return value;
        }
        std::string word;
        peek();
        while (at_ < text_.size() && (std::isalnum(static_cast<unsigned char>(text_[at_])) != 0 || text_[at_] == '_')) {
            word += text_[at_++];
        }
        if (word == "defined") {
            const bool bracket = take("(");
            std::string name;
            peek();
            while (at_ < text_.size() &&
                   (std::isalnum(static_cast<unsigned char>(text_[at_])) != 0 || text_[at_] == '_')) {
                name += text_[at_++];
            }
            if (bracket) {
                take(")");
            }
            return static_cast<long>(macros_.count(name) != 0);
        }
        if (word.empty()) {
            throw std::runtime_error("a condition that is not understood: " + text_);
        }
        if (std::isdigit(static_cast<unsigned char>(word.front())) != 0) {
            return std::stol(word);
        }
        const auto found = macros_.find(word);
        return found == macros_.end() || found->second.empty() ? 0 : value_of(found->second);
    }

    std::map<std::string, std::string> macros_;
    std::vector<Group> groups_;
    std::string text_;
    std::size_t at_ = 0;
};

std::string decided(const std::string& file, const gl::Defines& defines) {
    return Decider().decide(gl::preprocess(embedded_glsl(), file, "#version 330 core", defines).text);
}

bool mentions(const std::string& source, const std::string& word) {
    return std::regex_search(source, std::regex("\\b" + word + "\\b"));
}

DrawPlan plain() {
    DrawPlan plan;
    plan.mode = Mode::composite;
    return plan;
}

std::string shade_of(const DrawPlan& plan, std::size_t lights = 2) {
    return decided("shade.frag", shade_defines(plan, {lights}, 0));
}

struct Marked {
    const char* name;
    std::vector<const char*> marks; ///< of the source where the effect is on, and nowhere else
    void (*turn_on)(DrawPlan&);
};

void light(DrawPlan& plan) { plan.gradient = plan.lit = true; }

const std::vector<Marked>& marked() {
    static const std::vector<Marked> all{
        {"gradient", {"gradient", "gradient_scale", "weakest_gradient", "light_direction", "light_color"}, light},
        {"specular",
         {"power", "mirrored"},
         [](DrawPlan& plan) {
             light(plan);
             plan.specular = true;
         }},
        {"weight", {"weights_at"}, [](DrawPlan& plan) { plan.weight = plan.threshold = true; }},
        {"clip", {"clip_texture", "is_kept", "kept"}, [](DrawPlan& plan) { plan.clip = true; }},
        {"depth_cue", {"cue", "cue_share", "cued"}, [](DrawPlan& plan) { plan.depth_cue = true; }},
        {"gradient_opacity", {"full_gradient"}, [](DrawPlan& plan) { plan.gradient = plan.gradient_opacity = true; }},
        {"cut_faces",
         {"face", "face_of", "face_texture", "face_length"},
         [](DrawPlan& plan) {
             light(plan);
             plan.clip = plan.read_image = plan.cut_faces = true;
         }},
        {"preintegration", {"ramp"}, [](DrawPlan& plan) { plan.preintegration = true; }},
        {"second_order", {"bent_ramp"}, [](DrawPlan& plan) { plan.preintegration = plan.second_order = true; }},
        {"opacity_correction", {"opacity_of\\(classified"}, [](DrawPlan& plan) { plan.opacity_correction = true; }},
        {"opacity_stop", {"opacity_stop"}, [](DrawPlan& plan) { plan.stop = plan.read_image = true; }},
        {"perspective", {"pixel", "first_depth"}, [](DrawPlan& plan) { plan.projection = Projection::perspective; }},
        {"coverage", {"coverage_out"}, [](DrawPlan& plan) { plan.weight = plan.coverage = plan.read_image = true; }},
        {"depth", {"depth_out"}, [](DrawPlan& plan) { plan.depth = plan.read_image = true; }},
        {"compensation", {"error_out"}, [](DrawPlan& plan) { plan.compensated = plan.read_image = true; }},
        {"isosurface",
         {"iso_value", "iso_color"},
         [](DrawPlan& plan) {
             plan.mode = Mode::isosurface;
             plan.read_image = true;
         }},
        {"shadows",
         {"left_of"},
         [](DrawPlan& plan) {
             light(plan);
             plan.shadows = true;
         }},
        {"ambient_occlusion", {"ambient_left"}, [](DrawPlan& plan) { plan.ambient_occlusion = true; }},
        {"fine_gradient",
         {"slopes_at"},
         [](DrawPlan& plan) {
             light(plan);
             plan.fine_gradient = plan.fine_across = true;
         }},
    };
    return all;
}

TEST(ShaderVariants, HoldNothingOfEffectsThatAreOff) {
    const std::string bare = shade_of(plain());
    for (const Marked& effect : marked()) {
        DrawPlan plan = plain();
        effect.turn_on(plan);
        const std::string source = shade_of(plan);
        for (const char* mark : effect.marks) {
            EXPECT_TRUE(mentions(source, mark)) << effect.name << ": " << mark << " is how it is known";
            EXPECT_FALSE(mentions(bare, mark)) << effect.name << ": " << mark << " where it is off";
        }
    }
}

TEST(ShaderVariants, GroupsAndSurfacesHaveAShaderOfTheirOwn) {
    Scene scene{{}, TransferFunction({{0.0, {1.0, 1.0, 1.0}, 0.0}, {1.0, {1.0, 1.0, 1.0}, 0.5}})};
    scene.fields.assign(3, std::make_shared<RegularField>(std::vector<float>{1.0F}, std::array<std::size_t, 3>{1, 1, 1},
                                                          test::zero_boundary()));
    EXPECT_FALSE(shaded_parts(scene).several());
    scene.mode = Mode::isosurface;
    scene.iso_values = {0.5};
    EXPECT_FALSE(shaded_parts(scene).several());
    scene.iso_values = {{0.5, 0.5}};
    EXPECT_TRUE(shaded_parts(scene).several());
    scene.iso_values = {0.5, 0.7};
    scene.later_groups = {{2, scene.transfer_function}};
    EXPECT_EQ(shaded_parts(scene).groups, 2U);
    EXPECT_EQ(shaded_parts(scene).surfaces, 4U);
    // In scalar modes all fields add up.
    scene.mode = Mode::average;
    EXPECT_FALSE(shaded_parts(scene).several());
    scene.mode = Mode::composite;
    EXPECT_TRUE(shaded_parts(scene).several());
    const gl::Defines defines = shade_defines(plain(), shaded_parts(scene), 0);
    EXPECT_EQ(defines.at("GROUPS"), "2");
    EXPECT_EQ(defines.count("SURFACES"), 0U);
    // One group reads textures, several layers of arrays.
    EXPECT_TRUE(mentions(decided("shade.frag", defines), "group"));
    EXPECT_FALSE(mentions(shade_of(plain()), "group"));
}

TEST(ShaderVariants, WithoutLightsNothingTouchesGradients) {
    // Every effect that needs no gradient, all at once.
    DrawPlan plan = plain();
    plan.weight = plan.threshold = plan.clip = plan.depth_cue = plan.preintegration = plan.second_order = true;
    plan.opacity_correction = plan.stop = plan.read_image = plan.depth = plan.coverage = plan.empty_test = true;
    plan.ambient_occlusion = true;
    const std::string dark = shade_of(plan, 0);
    light(plan);
    const std::string lit = shade_of(plan);
    for (const char* word : {"gradient", "normal_gradient", "gradient_scale", "weakest_gradient", "light_direction",
                             "left", "right", "above", "below", "slopes", "shade"}) {
        EXPECT_FALSE(mentions(dark, word)) << word;
    }
    for (const char* word : {"gradient", "gradient_scale", "light_direction", "left", "right", "above", "below"}) {
        EXPECT_TRUE(mentions(lit, word)) << word;
    }
    // A splat without a gradient adds to no sheet of changes.
    FieldView view;
    const SplatTarget target;
    const std::string splat = decided("splat.frag", splat_defines(plain(), view, target));
    DrawPlan slopes = plain();
    light(slopes);
    slopes.analytic_gradient = true;
    EXPECT_NE(splat, decided("splat.frag", splat_defines(slopes, view, target)));
    EXPECT_EQ(4 * splat_outputs(plain(), target).size(), splat_outputs(slopes, target).size())
        << "the sum, and its changes along x, y and z";
}

/// Names that a text declares as uniforms.
std::set<std::string> uniforms_of(const std::string& source) {
    std::set<std::string> names;
    const std::regex declaration("uniform\\s+(?:(?:lowp|mediump|highp)\\s+)?\\w+\\s+(\\w+)");
    for (std::sregex_iterator it(source.begin(), source.end(), declaration), end; it != end; ++it) {
        names.insert((*it)[1]);
    }
    return names;
}

/// What stands between the brackets after each "if", and before each "?" back to the start of its statement.
std::vector<std::string> conditions_of(const std::string& source) {
    std::vector<std::string> conditions;
    const std::regex branch("\\bif\\s*\\(");
    for (std::sregex_iterator it(source.begin(), source.end(), branch), end; it != end; ++it) {
        std::size_t at = static_cast<std::size_t>(it->position()) + static_cast<std::size_t>(it->length());
        std::string condition;
        for (int depth = 1; at < source.size() && depth > 0; ++at) {
            depth += source[at] == '(' ? 1 : source[at] == ')' ? -1 : 0;
            condition += source[at];
        }
        condition.pop_back();
        conditions.push_back(condition);
    }
    return conditions;
}

/// True where all that a condition depends on is the same for every pixel.
bool is_a_switch(const std::string& condition, const std::set<std::string>& uniforms) {
    const std::regex name("[A-Za-z_]\\w*");
    for (std::sregex_iterator it(condition.begin(), condition.end(), name), end; it != end; ++it) {
        if (uniforms.count(it->str()) == 0) {
            return false;
        }
    }
    return true;
}

TEST(ShaderVariants, HoldNoBranchOnAnEffect) {
    std::vector<DrawPlan> plans{plain()};
    for (const Marked& effect : marked()) {
        DrawPlan plan = plain();
        effect.turn_on(plan);
        plans.push_back(plan);
    }
    std::size_t conditions = 0;
    const auto check = [&](const std::string& file, const gl::Defines& defines) {
        const std::string source = decided(file, defines);
        const std::set<std::string> uniforms = uniforms_of(source);
        EXPECT_FALSE(std::regex_search(source, std::regex("uniform\\s+bool\\b"))) << file;
        for (const std::string& condition : conditions_of(source)) {
            EXPECT_FALSE(is_a_switch(condition, uniforms)) << file << ": if (" << condition << ")";
            ++conditions;
        }
    };
    for (const DrawPlan& plan : plans) {
        check("shade.frag", shade_defines(plan, {2}, 0));
        check("splat.frag", splat_defines(plan, FieldView{}, SplatTarget{}));
        check("ellipsoid.frag", ellipsoid_defines(plan, SectionGroup::plain, SplatTarget{}));
    }
    EXPECT_GT(conditions, plans.size()) << "there are branches on data";
    // The check finds what it looks for.
    EXPECT_TRUE(is_a_switch("lit != 0 && fogged", {"lit", "fogged"}));
    EXPECT_TRUE(is_a_switch("true", {"true"}));
    EXPECT_FALSE(is_a_switch("alpha > limit", {"limit"}));
    EXPECT_EQ(conditions_of("if (f(a) > b) { } else if (c) x = 1;"), (std::vector<std::string>{"f(a) > b", "c"}));
}

TEST(ShaderVariants, ConditionsAreDecidedAsGlslDoes) {
    const std::string text = "#define A\n#define N 3\n#if defined(A) && !defined(B)\none\n#elif N > 2\ntwo\n#endif\n"
                             "#ifdef B\nthree\n#else\nfour // five\n#endif\n#if N == 3 && (N - 1) >= 2\nsix\n#endif\n"
                             "#ifndef A\n#if N\nseven\n#else\neight\n#endif\n#elif N\nnine\n#endif\n";
    EXPECT_EQ(Decider().decide(text), "one\nfour \nsix\nnine\n");
}

} // namespace
} // namespace sheetsplat::backend_gl

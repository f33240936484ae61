// Sources with includes and the programs that are made of them.
#include "gl_tests.hpp"

#include <cstring>

namespace sheetsplat::gl::testing {
namespace {

std::string text_of(const SourceFiles& files, const std::string& file, const Defines& defines = {}) {
    return preprocess(files, file, glsl_330, defines).text;
}

TEST(Preprocess, version_then_defines_then_the_file) {
    const SourceFiles files = {{"a.frag", "void main() {}\n"}};
    EXPECT_EQ(text_of(files, "a.frag", {{"TAPS", "4"}, {"MODE", "x + 1"}}),
              "#version 330 core\n#define MODE x + 1\n#define TAPS 4\n#line 1 0\nvoid main() {}\n");
}

TEST(Preprocess, includes_are_replaced_with_guards_and_lines_can_be_traced) {
    const SourceFiles files = {
        {"a.frag", "// a\n#include \"lib/b.glsl\"\n  # include \"lib/c.glsl\" // again c\nint a;\n"},
        {"lib/b.glsl", "int b1;\n#include \"lib/c.glsl\"\nint b3;\n"},
        {"lib/c.glsl", "int c;"}};
    const StageSource source = preprocess(files, "a.frag", glsl_330, {});
    EXPECT_EQ(source.files_used, (std::vector<std::string>{"a.frag", "lib/b.glsl", "lib/c.glsl"}));
    EXPECT_EQ(source.text, "#version 330 core\n#line 1 0\n// a\n"
                           "#ifndef SHEETSPLAT_INCLUDED_1\n#define SHEETSPLAT_INCLUDED_1\n"
                           "#line 1 1\nint b1;\n"
                           "#ifndef SHEETSPLAT_INCLUDED_2\n#define SHEETSPLAT_INCLUDED_2\n"
                           "#line 1 2\nint c;\n#endif\n"
                           "#line 3 1\nint b3;\n#endif\n"
                           "#line 3 0\n"
                           "#ifndef SHEETSPLAT_INCLUDED_2\n#define SHEETSPLAT_INCLUDED_2\n"
                           "#line 1 2\nint c;\n#endif\n"
                           "#line 4 0\nint a;\n");
}

TEST(Preprocess, a_missing_file_is_named_with_the_place_that_wants_it) {
    const SourceFiles files = {{"a.frag", "\n#include \"lib/b.glsl\"\n"},
                               {"lib/b.glsl", "\n\n#include \"lib/fog.glsl\"\n"}};
    const std::string text = message_of<Error>([&] { (void)text_of(files, "a.frag"); });
    EXPECT_TRUE(contains(text, "\"lib/fog.glsl\", included at lib/b.glsl:3"));
    EXPECT_TRUE(contains(message_of<Error>([&] { (void)text_of(files, "z.frag"); }), "\"z.frag\""));
}

TEST(Preprocess, a_circle_is_told) {
    const SourceFiles files = {{"a.frag", "#include \"b\"\n"},
                               {"b", "#include \"c\"\n"},
                               {"c", "\n#include \"b\"\n"},
                               {"self", "#include \"self\"\n"}};
    EXPECT_TRUE(contains(message_of<Error>([&] { (void)text_of(files, "a.frag"); }), "c:2 includes b"));
    EXPECT_TRUE(contains(message_of<Error>([&] { (void)text_of(files, "self"); }), "self:1 includes self"));
}

TEST(Preprocess, other_lines_stay_as_they_are) {
    const SourceFiles files = {
        {"a.frag", "// #include \"no\"\n/* #include \"no\" */\n#if TAPS > 2\nint t;\n#endif\n#include <b>\n"}};
    EXPECT_EQ(text_of(files, "a.frag"), "#version 330 core\n#line 1 0\n" + files.at("a.frag"));
}

TEST(TranslateLog, messages_of_three_compilers) {
    const SourceFiles files = {{"a.frag", "int a;\nint b;\n"}, {"lib/b.glsl", "float x;\nfloat y = oops;\n"}};
    StageSource source;
    source.files_used = {"a.frag", "lib/b.glsl"};
    for (const char* log : {"1:2(11): error: `oops' undeclared\n", "1(2) : error C1503: undefined variable \"oops\"\n",
                            "ERROR: 1:2: 'oops' : undeclared identifier\n"}) {
        const std::string text = translate_log(log, source, files);
        EXPECT_TRUE(contains(text, "lib/b.glsl:2: "));
        EXPECT_TRUE(contains(text, "2 | float y = oops;"));
        EXPECT_TRUE(contains(text, "oops"));
    }
    EXPECT_TRUE(contains(translate_log("0:1(1): error: x", source, files), "1 | int a;"));
    // What names no place, or one that is not there, is passed on.
    EXPECT_TRUE(contains(translate_log("link failed\n", source, files), "link failed"));
    EXPECT_TRUE(contains(translate_log("7:2(1): error: x\n", source, files), "7:2(1): error: x"));
    EXPECT_TRUE(contains(translate_log("0:99(1): error: x\n", source, files), "a.frag:99: error: x"));
    EXPECT_TRUE(contains(translate_log("99999999999999999999:2(1): error: x\n", source, files), "error: x"));
}

class Programs : public WithContext {
  protected:
    // The bound framebuffer's first pixel after a draw over all of it.
    [[nodiscard]] std::array<float, 4> drawn(const Program& program, int attachment = 0) const {
        const VertexArray vertices(gl());
        vertices.bind();
        program.use();
        gl().Viewport(0, 0, 1, 1);
        gl().DrawArrays(GL_TRIANGLES, 0, 3);
        const std::vector<float> all = pixels(1, 1, attachment);
        return {all[0], all[1], all[2], all[3]};
    }
};

TEST_F(Programs, an_error_in_an_included_file_names_that_file_and_line) {
    SourceFiles files = plain_files();
    files["fine.glsl"] = "float fine() { return 1.0; }\n";
    files["broken.glsl"] = "// one\n// two\nfloat broken() { return undeclared_name; }\n";
    files["a.frag"] = "#include \"fine.glsl\"\n#include \"broken.glsl\"\nout vec4 color;\nvoid main() { color = "
                      "vec4(fine() + broken()); }\n";
    const std::string text = message_of<Error>([&] {
        Program(gl(), files, "all.vert", "a.frag", {{"TAPS", "4"}}, glsl_330, {"color"});
    });
    EXPECT_TRUE(contains(text, "a.frag does not compile"));
    EXPECT_TRUE(contains(text, "TAPS=4"));
    EXPECT_TRUE(contains(text, "broken.glsl:3: "));
    EXPECT_TRUE(contains(text, "3 | float broken() { return undeclared_name; }"));
    EXPECT_FALSE(contains(text, "fine.glsl"));

    // After the includes the outer file's own lines count again; before them too.
    files["broken.glsl"] = "float broken() { return 1.0; }\n";
    files["a.frag"] = "#include \"fine.glsl\"\n#include \"broken.glsl\"\nout vec4 color;\nvoid main() {\n    color = "
                      "undeclared_too;\n}\n";
    const std::string outer =
        message_of<Error>([&] { Program(gl(), files, "all.vert", "a.frag", {}, glsl_330, {"color"}); });
    EXPECT_TRUE(contains(outer, "a.frag:5: "));
    EXPECT_TRUE(contains(outer, "5 |     color = undeclared_too;"));
    files["a.frag"] =
        "float x = undeclared_first;\n#include \"fine.glsl\"\nout vec4 color;\nvoid main() { color = vec4(x); }\n";
    EXPECT_TRUE(contains(
        message_of<Error>([&] { Program(gl(), files, "all.vert", "a.frag", {}, glsl_330, {"color"}); }), "a.frag:1: "));

    files["b.vert"] = "\nvoid main() { gl_Position = nothing; }\n";
    EXPECT_TRUE(
        contains(message_of<Error>([&] { Program(gl(), files, "b.vert", "value.frag", {}, glsl_330, {"color"}); }),
                 "b.vert:2: "));
    EXPECT_EQ(gl().GetError(), static_cast<GLenum>(GL_NO_ERROR));
}

TEST_F(Programs, lines_are_right_after_guarded_includes) {
    SourceFiles files = plain_files();
    files["part.glsl"] = "#ifdef NEVER\nint none;\n#endif\nfloat part() { return 1.0; }\n";
    files["a.frag"] = "#if 1\n#include \"part.glsl\"\n#endif\n#include \"part.glsl\"\nout vec4 color;\nvoid main() {\n "
                      "   color = missing;\n}\n";
    EXPECT_TRUE(contains(
        message_of<Error>([&] { Program(gl(), files, "all.vert", "a.frag", {}, glsl_330, {"color"}); }), "a.frag:7: "));
    files["part.glsl"] = "#ifdef NEVER\nint none;\n#endif\nfloat part() { return missing; }\n";
    EXPECT_TRUE(
        contains(message_of<Error>([&] { Program(gl(), files, "all.vert", "a.frag", {}, glsl_330, {"color"}); }),
                 "part.glsl:4: "));
}

TEST_F(Programs, includes_inside_conditions_count_only_where_they_are_read) {
    const Texture target(gl(), GL_RGBA32F, 1, 1);
    const Framebuffer framebuffer(gl(), {&target});
    framebuffer.bind();
    SourceFiles files = plain_files();
    files["part.glsl"] = "float part() { return 0.5; }\n";
    files["other.glsl"] = "#include \"part.glsl\"\nfloat other() { return part() + 1.0; }\n";
    files["a.frag"] =
        "#if A\n#include \"part.glsl\"\n#endif\n#if B\n#include \"other.glsl\"\n#else\n#include \"part.glsl\"\n#endif\n"
        "#include \"other.glsl\"\n#include \"part.glsl\"\nout vec4 color;\nvoid main() { color = vec4(part(), other(), "
        "0.0, 1.0); }\n";
    for (const char* a : {"0", "1"}) {
        for (const char* b : {"0", "1"}) {
            const Program program(gl(), files, "all.vert", "a.frag", {{"A", a}, {"B", b}}, glsl_330, {"color"});
            EXPECT_EQ(drawn(program), (std::array<float, 4>{0.5F, 1.5F, 0.0F, 1.0F})) << a << b;
        }
    }
}

TEST_F(Programs, defines_specialise) {
    const Texture target(gl(), GL_RGBA32F, 1, 1);
    const Framebuffer framebuffer(gl(), {&target});
    framebuffer.bind();
    SourceFiles files = plain_files();
    files["a.frag"] = "out vec4 color;\nvoid main() { color = vec4(VALUE); }\n";
    EXPECT_EQ(drawn(Program(gl(), files, "all.vert", "a.frag", {{"VALUE", "2.5"}}, glsl_330, {"color"}))[0], 2.5F);
    EXPECT_EQ(drawn(Program(gl(), files, "all.vert", "a.frag", {{"VALUE", "-1.0"}}, glsl_330, {"color"}))[0], -1.0F);
}

TEST_F(Programs, outputs_are_bound_in_the_order_that_is_asked_for) {
    const Texture first(gl(), GL_RGBA32F, 1, 1);
    const Texture second(gl(), GL_RGBA32F, 1, 1);
    const Framebuffer framebuffer(gl(), {&first, &second});
    framebuffer.bind();
    SourceFiles files = plain_files();
    files["a.frag"] = "out vec4 one;\nout vec4 two;\nvoid main() { one = vec4(1.0); two = vec4(2.0); }\n";
    for (const bool swapped : {false, true}) {
        const std::vector<std::string> outputs =
            swapped ? std::vector<std::string>{"two", "one"} : std::vector<std::string>{"one", "two"};
        const Program program(gl(), files, "all.vert", "a.frag", {}, glsl_330, outputs);
        EXPECT_EQ(drawn(program, 0)[0], swapped ? 2.0F : 1.0F);
        EXPECT_EQ(drawn(program, 1)[0], swapped ? 1.0F : 2.0F);
    }
}

TEST_F(Programs, uniforms) {
    const Texture target(gl(), GL_RGBA32F, 1, 1);
    const Framebuffer framebuffer(gl(), {&target});
    framebuffer.bind();
    SourceFiles files = plain_files();
    files["a.frag"] =
        "uniform int i; uniform float f; uniform vec2 v2; uniform vec3 v3; uniform vec4 v4; uniform ivec2 i2;\n"
        "uniform vec3 a3[2];\n"
        "out vec4 color;\n"
        "void main() { color = vec4(float(i) + f, v2.y + v3.z + v4.w, float(i2.y), a3[1].z); }\n";
    const Program program(gl(), files, "all.vert", "a.frag", {}, glsl_330, {"color"});
    program.use();
    program.set("i", 3);
    program.set("f", 0.25F);
    program.set("v2", 1.0F, 2.0F);
    program.set("v3", 1.0F, 2.0F, 30.0F);
    program.set("v4", 1.0F, 2.0F, 3.0F, 400.0F);
    program.set("i2", 5, 7);
    const std::array<float, 6> a3 = {0, 0, 0, 0, 0, 90.0F};
    program.set_array3("a3", a3.data(), 2);
    EXPECT_EQ(drawn(program), (std::array<float, 4>{3.25F, 432.0F, 7.0F, 90.0F}));
    EXPECT_EQ(program.location("not there"), -1);
    program.use();
    program.set("not there", 1.0F);
    EXPECT_NO_THROW(check_errors(gl(), "uniforms"));
}

TEST_F(Programs, link_errors_are_told) {
    SourceFiles files = plain_files();
    files["a.frag"] = "float from_nowhere();\nout vec4 color;\nvoid main() { color = vec4(from_nowhere()); }\n";
    const std::string text =
        message_of<Error>([&] { Program(gl(), files, "all.vert", "a.frag", {}, glsl_330, {"color"}); });
    EXPECT_TRUE(contains(text, "all.vert and a.frag do not link"));
    EXPECT_TRUE(contains(text, "from_nowhere"));
}

TEST_F(Programs, moves_delete_once) {
    Program first(gl(), plain_files(), "all.vert", "value.frag", {}, glsl_330, {"color"});
    const GLuint name = first.name();
    {
        const Program second(std::move(first));
        EXPECT_EQ(second.name(), name);
        EXPECT_FALSE(first); // NOLINT(bugprone-use-after-move): what a move leaves is what is tested
        EXPECT_EQ(gl().IsProgram(name), GL_TRUE);
    }
    EXPECT_EQ(gl().IsProgram(name), GL_FALSE);
}

} // namespace
} // namespace sheetsplat::gl::testing

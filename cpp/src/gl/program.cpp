#include "gl/program.hpp"

#include <algorithm>

#include "platforms.hpp"
#include "sheetsplat/error.hpp"

namespace sheetsplat::gl {

void delete_program(const Api& gl, GLuint name) { gl.DeleteProgram(name); }

namespace {

void delete_shader(const Api& gl, GLuint name) { gl.DeleteShader(name); }

std::string listed(const Defines& defines) {
    std::string text;
    for (const auto& [name, value] : defines) {
        text.append(text.empty() ? "" : ", ").append(name).append("=").append(value);
    }
    return text.empty() ? "none" : text;
}

/// The compiler's or linker's message; get_number and get_log: those of shaders or of programs.
std::string log_of(PFNGLGETSHADERIVPROC get_number, PFNGLGETSHADERINFOLOGPROC get_log, GLuint name) {
    GLint length = 0;
    get_number(name, GL_INFO_LOG_LENGTH, &length);
    std::string log(static_cast<std::size_t>(std::max(length, 1)), '\0');
    GLsizei written = 0;
    get_log(name, static_cast<GLsizei>(log.size()), &written, log.data());
    log.resize(static_cast<std::size_t>(std::max(written, 0)));
    return log;
}

Handle<delete_shader> compile(const Api& gl, GLenum stage, const std::string& file, const SourceFiles& files,
                              const Defines& defines, const std::string& version_line) {
    const StageSource source = preprocess(files, file, version_line, defines);
    Handle<delete_shader> shader(gl, gl.CreateShader(stage));
    const GLchar* text = source.text.data();
    const auto length = static_cast<GLint>(source.text.size());
    gl.ShaderSource(shader.name(), 1, &text, &length);
    gl.CompileShader(shader.name());
    GLint compiled = GL_FALSE;
    gl.GetShaderiv(shader.name(), GL_COMPILE_STATUS, &compiled);
    if (compiled != GL_TRUE) {
        throw Error(Complaint{"the shader " + file + " does not compile (defines: " + listed(defines) + ")",
                              translate_log(log_of(gl.GetShaderiv, gl.GetShaderInfoLog, shader.name()), source, files),
                              "", ""});
    }
    return shader;
}

/// Compiles and links stages. prepare(program) is called between the two.
template <class Prepare>
Handle<delete_program> linked(const Api& gl, const std::vector<std::pair<GLenum, std::string>>& stages,
                              const SourceFiles& files, const Defines& defines, const std::string& version_line,
                              const Prepare& prepare) {
    check_errors(gl, "before a program was made");
    std::vector<Handle<delete_shader>> shaders;
    std::string names;
    for (const auto& [stage, file] : stages) {
        shaders.push_back(compile(gl, stage, file, files, defines, version_line));
        names += (names.empty() ? "" : " and ") + file;
    }
    Handle<delete_program> program(gl, gl.CreateProgram());
    const GLuint name = program.name();
    for (const auto& shader : shaders) {
        gl.AttachShader(name, shader.name());
    }
    prepare(name);
    gl.LinkProgram(name);
    // Attached shaders would live as long as the program.
    for (const auto& shader : shaders) {
        gl.DetachShader(name, shader.name());
    }
    GLint is_linked = GL_FALSE;
    gl.GetProgramiv(name, GL_LINK_STATUS, &is_linked);
    if (is_linked != GL_TRUE) {
        throw Error(Complaint{"the shaders " + names + " do not link (defines: " + listed(defines) + ")",
                              log_of(gl.GetProgramiv, gl.GetProgramInfoLog, name), "", ""});
    }
    check_errors(gl, "making a program");
    return program;
}

} // namespace

Program::Program(const Api& gl, const SourceFiles& files, const std::string& vertex_file,
                 const std::string& fragment_file, const Defines& defines, const std::string& version_line,
                 const std::vector<std::string>& outputs)
    : handle_(linked(gl, {{GL_VERTEX_SHADER, vertex_file}, {GL_FRAGMENT_SHADER, fragment_file}}, files, defines,
                     version_line, [&](GLuint program) {
                         for (std::size_t i = 0; i < outputs.size(); ++i) {
                             gl.BindFragDataLocation(program, static_cast<GLuint>(i), outputs[i].c_str());
                         }
                     })) {}

Program Program::capturing(const Api& gl, const SourceFiles& files, const std::string& vertex_file,
                           const Defines& defines, const std::string& version_line,
                           const std::vector<std::string>& captured) {
    std::vector<const char*> names;
    for (const std::string& name : captured) {
        names.push_back(name.c_str());
    }
    Program program;
    program.handle_ = linked(gl, {{GL_VERTEX_SHADER, vertex_file}}, files, defines, version_line, [&](GLuint name) {
        gl.TransformFeedbackVaryings(name, static_cast<GLsizei>(names.size()), names.data(), GL_INTERLEAVED_ATTRIBS);
    });
    return program;
}

Program Program::computing(const Api& gl, const SourceFiles& files, const std::string& file, const Defines& defines,
                           const std::string& version_line) {
    Program program;
    program.handle_ = linked(gl, {{GL_COMPUTE_SHADER, file}}, files, defines, version_line, [](GLuint) {});
    return program;
}

void Program::bind(const std::string& sampler, const Texture& texture, int unit) const {
    texture.bind(unit);
    set(sampler, unit);
}

void Program::set(const std::string& uniform, double value) const { handle_.api().Uniform1d(location(uniform), value); }

void Program::set(const std::string& uniform, double x, double y, double z) const {
    handle_.api().Uniform3d(location(uniform), x, y, z);
}

void Program::use() const {
    handle_.api().UseProgram(name());
    used_ = true;
}

GLint Program::location(const std::string& uniform) const {
    const auto known = locations_.find(uniform);
    if (known != locations_.end()) {
        return known->second;
    }
    const GLint found = handle_.api().GetUniformLocation(name(), uniform.c_str());
    locations_.emplace(uniform, found);
    return found;
}

void Program::set(const std::string& uniform, int value) const { handle_.api().Uniform1i(location(uniform), value); }

void Program::set(const std::string& uniform, float value) const { handle_.api().Uniform1f(location(uniform), value); }

void Program::set_matrix2(const std::string& uniform, float a, float b, float c, float d) const {
    const float columns[4] = {a, b, c, d};
    handle_.api().UniformMatrix2fv(location(uniform), 1, GL_FALSE, columns);
}

void Program::set(const std::string& uniform, float x, float y) const {
    handle_.api().Uniform2f(location(uniform), x, y);
}

void Program::set(const std::string& uniform, float x, float y, float z) const {
    handle_.api().Uniform3f(location(uniform), x, y, z);
}

void Program::set(const std::string& uniform, float x, float y, float z, float w) const {
    handle_.api().Uniform4f(location(uniform), x, y, z, w);
}

void Program::set(const std::string& uniform, int x, int y) const { handle_.api().Uniform2i(location(uniform), x, y); }

void Program::set_array3(const std::string& uniform, const float* values, int count) const {
    handle_.api().Uniform3fv(location(uniform), count, values);
}

} // namespace sheetsplat::gl

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

std::string shader_log(const Api& gl, GLuint shader) {
    GLint length = 0;
    gl.GetShaderiv(shader, GL_INFO_LOG_LENGTH, &length);
    std::string log(static_cast<std::size_t>(std::max(length, 1)), '\0');
    GLsizei written = 0;
    gl.GetShaderInfoLog(shader, static_cast<GLsizei>(log.size()), &written, log.data());
    log.resize(static_cast<std::size_t>(std::max(written, 0)));
    return log;
}

std::string program_log(const Api& gl, GLuint program) {
    GLint length = 0;
    gl.GetProgramiv(program, GL_INFO_LOG_LENGTH, &length);
    std::string log(static_cast<std::size_t>(std::max(length, 1)), '\0');
    GLsizei written = 0;
    gl.GetProgramInfoLog(program, static_cast<GLsizei>(log.size()), &written, log.data());
    log.resize(static_cast<std::size_t>(std::max(written, 0)));
    return log;
}

Handle<delete_shader> compile(const Api& gl, GLenum stage, const StageSource& source, const SourceFiles& files,
                              const std::string& file, const Defines& defines) {
    Handle<delete_shader> shader(gl, gl.CreateShader(stage));
    const GLchar* text = source.text.data();
    const auto length = static_cast<GLint>(source.text.size());
    gl.ShaderSource(shader.name(), 1, &text, &length);
    gl.CompileShader(shader.name());
    GLint compiled = GL_FALSE;
    gl.GetShaderiv(shader.name(), GL_COMPILE_STATUS, &compiled);
    if (compiled != GL_TRUE) {
        throw Error(Complaint{"the shader " + file + " does not compile (defines: " + listed(defines) + ")",
                              translate_log(shader_log(gl, shader.name()), source, files), "", ""});
    }
    return shader;
}

} // namespace

Program::Program(const Api& gl, const SourceFiles& files, const std::string& vertex_file,
                 const std::string& fragment_file, const Defines& defines, const std::string& version_line,
                 const std::vector<std::string>& outputs) {
    const StageSource vertex_source = preprocess(files, vertex_file, version_line, defines);
    const StageSource fragment_source = preprocess(files, fragment_file, version_line, defines);
    check_errors(gl, "before a program was made");
    const auto vertex = compile(gl, GL_VERTEX_SHADER, vertex_source, files, vertex_file, defines);
    const auto fragment = compile(gl, GL_FRAGMENT_SHADER, fragment_source, files, fragment_file, defines);

    handle_ = Handle<delete_program>(gl, gl.CreateProgram());
    gl.AttachShader(name(), vertex.name());
    gl.AttachShader(name(), fragment.name());
    for (std::size_t i = 0; i < outputs.size(); ++i) {
        gl.BindFragDataLocation(name(), static_cast<GLuint>(i), outputs[i].c_str());
    }
    gl.LinkProgram(name());
    // Attached shaders would live as long as the program.
    gl.DetachShader(name(), vertex.name());
    gl.DetachShader(name(), fragment.name());
    GLint linked = GL_FALSE;
    gl.GetProgramiv(name(), GL_LINK_STATUS, &linked);
    if (linked != GL_TRUE) {
        throw Error(Complaint{"the shaders " + vertex_file + " and " + fragment_file +
                                  " do not link (defines: " + listed(defines) + ")",
                              program_log(gl, name()), "", ""});
    }
    check_errors(gl, "making a program");
}

Program Program::capturing(const Api& gl, const SourceFiles& files, const std::string& vertex_file,
                           const Defines& defines, const std::string& version_line,
                           const std::vector<std::string>& captured) {
    const StageSource source = preprocess(files, vertex_file, version_line, defines);
    check_errors(gl, "before a program was made");
    const auto vertex = compile(gl, GL_VERTEX_SHADER, source, files, vertex_file, defines);
    Program program;
    program.handle_ = Handle<delete_program>(gl, gl.CreateProgram());
    gl.AttachShader(program.name(), vertex.name());
    std::vector<const char*> names;
    for (const std::string& name : captured) {
        names.push_back(name.c_str());
    }
    gl.TransformFeedbackVaryings(program.name(), static_cast<GLsizei>(names.size()), names.data(),
                                 GL_INTERLEAVED_ATTRIBS);
    gl.LinkProgram(program.name());
    gl.DetachShader(program.name(), vertex.name());
    GLint linked = GL_FALSE;
    gl.GetProgramiv(program.name(), GL_LINK_STATUS, &linked);
    if (linked != GL_TRUE) {
        throw Error(Complaint{"the shader " + vertex_file + " does not link (defines: " + listed(defines) + ")",
                              program_log(gl, program.name()), "", ""});
    }
    check_errors(gl, "making a program");
    return program;
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

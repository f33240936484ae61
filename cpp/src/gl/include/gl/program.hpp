// Shader programs.
#pragma once

#include <map>
#include <string>
#include <vector>

#include "gl/objects.hpp"
#include "gl/shader_source.hpp"

namespace sheetsplat::gl {

void delete_program(const Api& gl, GLuint name);

/// A linked program. Errors of the compiler name the file and line that they came from, and show that line.
class Program {
  public:
    Program() = default;
    /// version_line: "#version 330 core" or better, chosen by the caller. outputs: fragment outputs, bound to locations
    /// 0, 1, ... in this order.
    Program(const Api& gl, const SourceFiles& files, const std::string& vertex_file, const std::string& fragment_file,
            const Defines& defines, const std::string& version_line, const std::vector<std::string>& outputs = {});

    /// A vertex stage alone, whose outputs are captured: `captured` one after another in one buffer, in this order.
    static Program capturing(const Api& gl, const SourceFiles& files, const std::string& vertex_file,
                             const Defines& defines, const std::string& version_line,
                             const std::vector<std::string>& captured);

    /// A compute stage (OpenGL 4.3).
    static Program computing(const Api& gl, const SourceFiles& files, const std::string& file, const Defines& defines,
                             const std::string& version_line);

    void use() const;
    /// True once use() was called.
    [[nodiscard]] bool used() const { return used_; }
    [[nodiscard]] GLuint name() const { return handle_.name(); }
    explicit operator bool() const { return static_cast<bool>(handle_); }
    /// -1 where the compiler removed it: setting it then does nothing.
    [[nodiscard]] GLint location(const std::string& uniform) const;

    // Set a uniform; the program must be in use. Names that are not active are ignored.
    void set(const std::string& uniform, int value) const;
    void set(const std::string& uniform, float value) const;
    void set(const std::string& uniform, float x, float y) const;
    void set(const std::string& uniform, float x, float y, float z) const;
    void set(const std::string& uniform, float x, float y, float z, float w) const;
    void set(const std::string& uniform, int x, int y) const;
    /// Float64, OpenGL 4.0.
    void set(const std::string& uniform, double value) const;
    void set(const std::string& uniform, double x, double y, double z) const;
    /// Columns (a, b) and (c, d).
    void set_matrix2(const std::string& uniform, float a, float b, float c, float d) const;
    /// Binds a texture to a unit and sets the sampler to it.
    void bind(const std::string& sampler, const Texture& texture, int unit) const;
    /// count vec3 of an array uniform ("name" without [0])
    void set_array3(const std::string& uniform, const float* values, int count) const;

  private:
    Handle<delete_program> handle_;
    mutable std::map<std::string, GLint> locations_;
    mutable bool used_ = false;
};

} // namespace sheetsplat::gl

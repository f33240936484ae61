// What is kept in a context between frames: surfaces, compiled programs, buffers.
#pragma once

#include <map>
#include <memory>
#include <string>
#include <utility>

#include "classification.hpp"
#include "gl/objects.hpp"
#include "gl/program.hpp"
#include "light_textures.hpp"
#include "papers/paper_slicing.hpp"
#include "resident_fields.hpp"
#include "section_pass.hpp"
#include "shader_variants.hpp"
#include "targets.hpp"

namespace sheetsplat::backend_gl {

/// Made and destroyed with the context current.
class Resources {
  public:
    Resources(const gl::Api& gl, const Capabilities& capabilities);

    /// The program of a variant, compiled from the sources at its first use.
    const gl::Program& program(const ShaderVariant& variant);
    /// The same of a compute stage (OpenGL 4.3).
    const gl::Program& compute_program(const std::string& file, const gl::Defines& defines);
    /// The GLSL files: embedded_glsl() unless hooks bring others.
    void set_sources(const gl::SourceFiles& sources) { sources_ = &sources; }
    /// Programs that were compiled in this context, and those of them that were put to use.
    [[nodiscard]] std::size_t programs() const { return programs_.size(); }
    [[nodiscard]] std::size_t programs_used() const;
    /// Surfaces of this shape; those of another shape are given back first.
    const Targets& targets(const TargetShape& shape);

    gl::Buffer samples, boxes, records, rests, rectangles;
    /// Of the compute path, as lib/tile_scene.glsl has them.
    gl::Buffer parts, sections, order, bounds, counts;
    double seconds_a_step = 0.0; ///< of one tile of the compute path, as last seen; 0: not known
    /// Made at their first use.
    SectionPass& section_pass();
    PaperSlicing& paper_slicing();
    LightTextures& light();
    ResidentFields& fields();
    /// Of what is kept for fields and views; surfaces and buffers are not counted.
    [[nodiscard]] std::size_t bytes() const;
    /// The device has drawn all that was written to the buffers: their storage may be used again.
    void rewind();

    gl::VertexArray splat_array, record_array, rectangle_array;

  private:
    const gl::Api* gl_;
    const gl::SourceFiles* sources_;
    bool precise_; ///< GLSL 4.00: the compiler can be told not to rearrange sums
    std::map<std::pair<std::string, gl::Defines>, gl::Program> programs_;
    std::unique_ptr<Targets> targets_;
    std::unique_ptr<SectionPass> section_pass_;
    std::unique_ptr<PaperSlicing> paper_slicing_;
    std::unique_ptr<LightTextures> light_;
    std::unique_ptr<ResidentFields> fields_;
};

} // namespace sheetsplat::backend_gl

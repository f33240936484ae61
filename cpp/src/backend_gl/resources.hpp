// What is kept in a context between frames: surfaces, compiled programs, buffers.
#pragma once

#include <map>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "classification.hpp"
#include "gather.hpp"
#include "gl/objects.hpp"
#include "gl/program.hpp"
#include "light_textures.hpp"
#include "paper_slicing.hpp"
#include "section_pass.hpp"
#include "targets.hpp"

namespace sheetsplat::backend_gl {

/// Made and destroyed with the context current.
class Resources {
  public:
    Resources(const gl::Api& gl, const Capabilities& capabilities);

    /// The program of two stages under these defines, compiled at its first use.
    const gl::Program& program(const std::string& vertex, const std::string& fragment, const gl::Defines& defines,
                               const std::vector<std::string>& outputs);
    /// Programs that were compiled in this context, and those of them that were put to use.
    [[nodiscard]] std::size_t programs() const { return programs_.size(); }
    [[nodiscard]] std::size_t programs_used() const;
    /// Surfaces of this shape; those of another shape are given back first.
    const Targets& targets(const TargetShape& shape);

    gl::Buffer samples, boxes, records, rests, rectangles;
    /// Made at its first use: it needs OpenGL 4.1.
    SectionPass& section_pass();
    /// Null where it was not used.
    [[nodiscard]] const SectionPass* sections() const { return section_pass_.get(); }
    /// Made at their first use; null where they were not used.
    PaperSlicing& paper_slicing();
    Gather& gather();
    /// Made at its first use.
    LightTextures& light();
    [[nodiscard]] std::size_t light_bytes() const { return light_ ? light_->bytes() : 0; }
    [[nodiscard]] std::size_t comparison_bytes() const {
        return (paper_slicing_ ? paper_slicing_->bytes() : 0) + (gather_ ? gather_->bytes() : 0);
    }

    gl::VertexArray splat_array, record_array, rectangle_array;

  private:
    const gl::Api* gl_;
    bool precise_; ///< GLSL 4.00: the compiler can be told not to rearrange sums
    std::map<std::pair<std::string, gl::Defines>, gl::Program> programs_;
    std::unique_ptr<Targets> targets_;
    std::unique_ptr<SectionPass> section_pass_;
    std::unique_ptr<PaperSlicing> paper_slicing_;
    std::unique_ptr<Gather> gather_;
    std::unique_ptr<LightTextures> light_;
};

} // namespace sheetsplat::backend_gl

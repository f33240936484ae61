// One pass over all ellipsoids of a field slices them for a view ([NM06] section 4.1, by transform feedback): the
// records stay on the device, and nothing is read back.
#pragma once

#include <map>
#include <memory>
#include <vector>

#include "gl/objects.hpp"
#include "gl/program.hpp"
#include "view/ellipsoid_view.hpp"

namespace sheetsplat::backend_gl {

/// Needs OpenGL 4.1. Kernels are uploaded once a field, 112 bytes each; records take 64 bytes a kernel.
class SectionPass {
  public:
    explicit SectionPass(const gl::Api& gl);

    /// Slices all kernels of a view's field. `kernels` owns the field. counting: of its values.
    void slice(const std::shared_ptr<const EllipsoidField>& kernels, const EllipsoidView& view,
               const Counting& counting);
    /// The same to a buffer of records, from number `first` on. rests: each record is followed by what float32 cut off
    /// it, a SectionRest, and says which of the two it needs.
    void slice(const std::shared_ptr<const EllipsoidField>& kernels, const EllipsoidView& view,
               const Counting& counting, const gl::Buffer& into, std::size_t first, bool rests);
    /// The records of the field that was sliced last, or before it, as texels of a buffer.
    [[nodiscard]] const gl::BufferTexture& records(const EllipsoidField& field) const;
    /// Gives back what belongs to other fields.
    void keep(const std::vector<const EllipsoidField*>& fields);
    [[nodiscard]] std::size_t bytes() const;

  private:
    struct Entry {
        std::shared_ptr<const EllipsoidField> kernels;
        gl::Buffer input, output;
        gl::BufferTexture texture;
        gl::VertexArray array;
    };
    /// Storage for the records of a field, made at its first use.
    void make_output(Entry& entry) const;
    Entry& entry_of(const std::shared_ptr<const EllipsoidField>& kernels);
    [[nodiscard]] const gl::Program& program(Projection projection, bool rests);

    const gl::Api* gl_;
    std::map<const EllipsoidField*, Entry> entries_;
    gl::Program programs_[2][2]; ///< orthographic and perspective; with rests
    gl::Texture pixel_;          ///< of a framebuffer that is bound because a context without a window has none
    gl::Framebuffer nowhere_;
};

} // namespace sheetsplat::backend_gl

// Ellipsoids as [NM06] draws them, step by step: kernels in textures, one
// pass of a fragment program that slices them all for a view (sections 3.3 and 4.1), then one slice a pass, each kernel
// a polygon with a texture of the Gaussian, drawn or culled by the vertex program alone (sections 4.1 and 4.2).
//
// Where it departs from the paper: a quaternion stands for the first two rows of R, so that a kernel with its weight is
// 12 numbers and no two of them share a float; n is B^T e_z / |B^T e_z|, the same vector as the u x v of equation 11
// without an inverse; u and v are turned until B u and B v are orthogonal on the screen, because rasterisers lose
// digits in slivers, which leaves the length of B v to be kept; the Gaussian's texels are mixed by the shader, because
// filters of 8 fractional bits show.
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <vector>

#include "backend_gl/gl_renderer.hpp"
#include "gl/objects.hpp"
#include "papers/active_cells.hpp"
#include "shader_variants.hpp"
#include "view/ellipsoid_view.hpp"

namespace sheetsplat::backend_gl {

class Resources;
class Splatting;
struct TileScope;

/// Orthographic cameras, point sampling, no filter. 48 bytes a kernel are kept for a field, 52 for each kernel drawn in
/// a view. Made and destroyed with the context current.
class PaperSlicing {
  public:
    /// opengl_4: the device has OpenGL 4.0. Then kernels are sliced in float64, though what is kept of them is float32,
    /// and four texels are fetched at once.
    PaperSlicing(const gl::Api& gl, bool opengl_4);

    /// Uploads what is new of a field and slices its kernels for a view. `kernels` owns the view's field.
    void slice(Resources& resources, const std::shared_ptr<const EllipsoidField>& kernels, const EllipsoidView& view,
               const CellTraversal& traversal);
    /// Draws the slice of a pass: the kernels of one field (a number in job.ellipsoids) that was sliced for the view,
    /// to the one channel that is the slice's number modulo 4.
    void splat(Splatting& splatting, std::size_t part, std::int64_t pass);
    /// Gives back what belongs to other fields.
    void keep(const std::vector<const EllipsoidField*>& fields);
    [[nodiscard]] std::size_t bytes() const;

  private:
    struct Entry {
        std::shared_ptr<const EllipsoidField> kernels;
        double length_unit = 1.0, value_unit = 1.0; ///< of the numbers in the textures
        gl::Texture center, scale, rotation;        ///< of all kernels
        gl::Texture order;                          ///< kernel of each entry of the traversal
        gl::Texture start, axes, step;              ///< of each entry
        gl::Framebuffer framebuffer;
        double whole_x = 0.0, whole_y = 0.0, whole_slice = 0.0; ///< what the starts are counted from
        std::vector<std::uint32_t> met;                         ///< kernels that meet each slice
    };
    Entry& entry_of(const std::shared_ptr<const EllipsoidField>& kernels);
    /// Draws the kernels of these cells. The target is bound.
    void draw(const TileScope& scope, const EllipsoidPart& ellipsoids, const std::vector<std::size_t>& cells,
              const SplatTarget& target, const SlabPass& pass);
    /// Kernels of a field that meet a slice.
    [[nodiscard]] std::size_t kernels_at(const EllipsoidField& field, std::int64_t slice) const;
    /// exp(-falloff (x^2 + y^2)) at cells + 1 places of 0 <= x, y <= 1 each. Mixed linearly it is at most falloff / (2
    /// cells^2) too large.
    const gl::Texture& table(double falloff, int cells);

    const gl::Api* gl_;
    bool opengl_4_;
    std::map<const EllipsoidField*, Entry> entries_;
    gl::VertexArray no_attributes_;
    std::map<double, gl::Texture> tables_; ///< by falloff
    std::vector<GLint> firsts_;
    std::vector<GLsizei> counts_;
};

} // namespace sheetsplat::backend_gl

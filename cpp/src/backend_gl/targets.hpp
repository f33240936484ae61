// The off-screen surfaces of a tile: the PBuffer of [NM05] section 4.5 as framebuffers that share one depth buffer.
#pragma once

#include <string>
#include <vector>

#include "gl/objects.hpp"
#include "gl/program.hpp"
#include "plan/make_plan.hpp"

namespace sheetsplat::backend_gl {

/// What the surfaces are for a plan. Two equal shapes can share their surfaces.
struct TargetShape {
    int width = 0, height = 0; ///< with the border
    GLenum sheet_format = GL_RGBA32F;
    bool wide = true;   ///< three sheets in a ring; else a splat buffer and a copy buffer
    bool sheets = true; ///< false: tiles are computed, and only the picture has surfaces
    bool weight = false;
    bool slopes = false;        ///< changes along x, y and z beside each sheet
    bool weight_slopes = false; ///< those of the weights too, for quotients that are taken where a slab is shaded
    bool shared_depth = false;  ///< tags or elimination
    bool depth = false;         ///< a picture of depths
    bool coverage = false;
    bool compensated = false; ///< rounding errors of the picture are kept beside it
    bool doubts = false;      ///< how much of rounding lit colours show (lib/doubt.glsl)
    bool copies = false;      ///< no texture barrier: the picture so far is copied before it is read
    int own = 0;              ///< fields that are normalised by themselves before they are added
    int groups = 1;           ///< of fields that are classified apart: of several each has a layer of the sheets

    [[nodiscard]] bool operator==(const TargetShape& other) const;
};

/// One slab's sums, or those of four: of values and weights, and their changes along x, y and z. Where several groups
/// are classified apart, each texture is an array of a layer for each.
struct Sheet {
    gl::Texture value, weight;
    gl::Texture slope[3], weight_slope[3];

    /// Binds what there is of it to the samplers NAME_SIDE_texture; side: "front" or "back".
    void bind(const gl::Program& program, const std::string& side) const;
    [[nodiscard]] std::size_t bytes() const;
};

class Targets {
  public:
    Targets() = default;
    Targets(const gl::Api& gl, const TargetShape& shape);

    [[nodiscard]] const TargetShape& shape() const { return shape_; }
    [[nodiscard]] std::size_t bytes() const;

    /// wide: sheet r of the ring (0..2). paper: 0 is the splat buffer, 1 the copy buffer.
    [[nodiscard]] const Sheet& sheet(int r) const { return sheets_[static_cast<std::size_t>(r)]; }
    /// Draws to sheets r and r + 1 of the ring (wide), or to the splat buffer (paper). own: number of a field with
    /// sheets of its own, -1 for the sheets of its group. Without slopes values, and weights where there are any; with
    /// slopes values and their changes, or `weights` and theirs. one: sheet r of the ring alone.
    void bind_splat(int own, std::size_t group, int r, bool weights, bool one) const {
        const Ways& ways = own < 0 ? ways_[group] : own_[static_cast<std::size_t>(own)].ways;
        const Way& way = weights ? ways.weights : ways.values;
        (one ? way.one : way.both)[static_cast<std::size_t>(r)].bind();
    }
    void bind_copy(bool weights) const { (weights ? copy_weight_ : copy_).bind(); }
    void bind_image() const { image_fbo_.bind(); }
    void bind_depth_only() const { depth_fbo_.bind(); }

    /// Sheets of a field that is normalised by itself, values and weights: r as above (paper: 0 alone).
    [[nodiscard]] const Sheet& own_sheet(int field, int r) const {
        return own_[static_cast<std::size_t>(field)].sheets[static_cast<std::size_t>(r)];
    }
    void clear_own(int field, int r) const;
    /// Draws to one of the sheets of a group without tags, where fields have sheets of their own: values, their changes
    /// where there are any, and weights where there are any.
    void bind_sum(std::size_t group, int r) const { sum_[group * sheets_.size() + static_cast<std::size_t>(r)].bind(); }

    /// Sets everything to its start: sheets and picture 0, depths of the picture infinite, tags 1.
    void clear_all() const;
    /// Puts a picture, RGBA of all pixels with their border, in place of the cleared one.
    void start_behind(const std::vector<float>& rgba) const;
    /// All sheets, those of fields included.
    void clear_sheets() const;
    void clear_sheet(int r) const;
    /// Fills the values of a clear sheet with what stands for points that nothing reaches, a number a group.
    void fill(int r, const std::vector<float>& empty) const;
    void clear_tags() const;
    /// The picture so far as textures that the shading pass may read: the picture itself, or a copy that is brought up
    /// to date.
    void bind_so_far(const gl::Program& program) const;

    [[nodiscard]] const gl::Texture& image() const { return pictures_.front().now; }
    /// The picture, and what there is beside it, as images of the compute path: in the order of IMAGE_PICTURE ...
    void bind_images() const;
    /// Reads a rectangle of attachment 0 (picture), 1 (depth or coverage), 2 (coverage after depth).
    void read(int attachment, int x, int y, int width, int height, GLenum format, float* out) const;

  private:
    const gl::Api* gl_ = nullptr;
    TargetShape shape_;
    std::vector<Sheet> sheets_;
    /// What can be drawn to at once, for each sheet of the ring: both sheets of a batch; one sheet, with tags; one
    /// sheet without tags, to be cleared.
    struct Way {
        std::vector<gl::Framebuffer> both, one, clear;
    };
    struct Ways {
        Way values;  ///< with the weights, unless there are slopes
        Way weights; ///< where there are slopes
    };
    /// A result of the shading pass, with its copy where the shader cannot read what it draws to.
    struct Picture {
        const char* sampler;
        int unit;
        float empty; ///< what its first channel is cleared to
        gl::Texture now, copy;
    };
    [[nodiscard]] Sheet make_sheet(bool weight, bool weight_slopes, int layers) const;
    [[nodiscard]] Ways make_ways(const std::vector<Sheet>& sheets, bool weight, int layer) const;
    void clear(const Ways& ways, int r) const;

    struct Own {
        std::vector<Sheet> sheets;
        Ways ways;
    };
    std::vector<Ways> ways_; ///< one a group
    std::vector<Own> own_;
    gl::Texture depth_tags_;
    std::vector<Picture> pictures_; ///< in the order of their attachments
    std::vector<gl::Framebuffer> sum_;
    gl::Framebuffer copy_, copy_weight_, image_fbo_, depth_fbo_;
};

} // namespace sheetsplat::backend_gl

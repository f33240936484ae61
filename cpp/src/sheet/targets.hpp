// The off-screen surfaces of a tile: the PBuffer of [NM05] section 4.5 as framebuffers that share one depth buffer.
#pragma once

#include <vector>

#include "gl/objects.hpp"
#include "gl/program.hpp"
#include "plan/make_plan.hpp"

namespace sheetsplat::sheet {

/// What the surfaces are for a plan. Two equal shapes can share their surfaces.
struct TargetShape {
    int width = 0, height = 0; ///< with the border
    GLenum sheet_format = GL_RGBA32F;
    bool wide = true; ///< three sheets in a ring; else a splat buffer and a copy buffer
    bool weight = false;
    bool fine = false;         ///< differences along x, y and z beside each sheet
    bool shared_depth = false; ///< tags or elimination
    bool depth = false;        ///< a picture of depths
    bool coverage = false;
    bool compensated = false; ///< rounding errors of the picture are kept beside it
    bool copies = false;      ///< no texture barrier: the picture so far is copied before it is read
    int own = 0;              ///< fields that are normalised by themselves before all are added

    [[nodiscard]] bool operator==(const TargetShape& other) const;
};

/// Sheets that are drawn to at once: values, then weights, then differences of values, then of weights.
struct Sheet {
    gl::Texture value, weight;
    gl::Texture slope[3], weight_slope[3];
};

class Targets {
  public:
    Targets() = default;
    Targets(const gl::Api& gl, const TargetShape& shape);

    [[nodiscard]] const TargetShape& shape() const { return shape_; }
    [[nodiscard]] std::size_t bytes() const;

    /// wide: sheet r of the ring (0..2). paper: 0 is the splat buffer, 1 the copy buffer.
    [[nodiscard]] const Sheet& sheet(int r) const { return sheets_[static_cast<std::size_t>(r)]; }
    /// Draws to sheets r and r + 1 of the ring (wide), or to the splat buffer (paper): values, and weights where there
    /// are any.
    void bind_splat(int r) const { splat_[static_cast<std::size_t>(r)].bind(); }
    /// fine only: values with their differences, or weights with theirs.
    void bind_splat_fine(int r, bool weights) const {
        (weights ? splat_weight_ : splat_)[static_cast<std::size_t>(r)].bind();
    }
    void bind_copy(bool weights) const { (weights ? copy_weight_ : copy_).bind(); }
    void bind_image() const { image_fbo_.bind(); }
    void bind_depth_only() const { depth_fbo_.bind(); }

    /// Sheets of a field that is normalised by itself, values and weights: r as above (paper: 0 alone).
    [[nodiscard]] const Sheet& own_sheet(int field, int r) const {
        return own_[static_cast<std::size_t>(field)].sheets[static_cast<std::size_t>(r)];
    }
    void bind_splat_own(int field, int r) const {
        own_[static_cast<std::size_t>(field)].splat[static_cast<std::size_t>(r)].bind();
    }
    void clear_own(int field, int r) const;
    /// Draws to one sheet of the ring alone, with tags.
    void bind_splat_one(int r) const { splat_one_[static_cast<std::size_t>(r)].bind(); }
    void bind_splat_own_one(int field, int r) const {
        own_[static_cast<std::size_t>(field)].splat_one[static_cast<std::size_t>(r)].bind();
    }
    /// Draws to one sheet alone: values, and weights where there are any.
    void bind_sheet(int r) const { clear_[static_cast<std::size_t>(r)].bind(); }

    /// Sets everything to its start: sheets and picture 0, depths of the picture infinite, tags 1.
    void clear_all() const;
    void clear_sheet(int r) const;
    void clear_tags() const;
    /// The picture so far as textures that the shading pass may read: the picture itself, or a copy that is brought up
    /// to date.
    void bind_so_far(const gl::Program& program) const;

    [[nodiscard]] const gl::Texture& image() const { return image_; }
    [[nodiscard]] const gl::Texture& image_depth() const { return image_depth_; }
    [[nodiscard]] const gl::Texture& image_coverage() const { return image_coverage_; }
    /// Reads a rectangle of attachment 0 (picture), 1 (depth or coverage), 2 (coverage after depth).
    void read(int attachment, int x, int y, int width, int height, GLenum format, float* out) const;

  private:
    const gl::Api* gl_ = nullptr;
    TargetShape shape_;
    std::vector<Sheet> sheets_;
    struct Own {
        std::vector<Sheet> sheets;
        std::vector<gl::Framebuffer> splat, splat_one, clear;
    };
    std::vector<Own> own_;
    gl::Texture depth_tags_, image_, image_depth_, image_coverage_, image_error_;
    gl::Texture image_copy_, image_depth_copy_, image_coverage_copy_, image_error_copy_;
    std::vector<gl::Framebuffer> splat_, splat_one_, splat_weight_, clear_, clear_weight_;
    gl::Framebuffer copy_, copy_weight_, image_fbo_, depth_fbo_;
};

} // namespace sheetsplat::sheet

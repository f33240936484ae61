// One tile of a picture: for each batch splat, (copy,) shade and composite ([NM05] figure 5).
#pragma once

#include <array>
#include <functional>
#include <vector>

#include "active_cells.hpp"
#include "backend_gl/gl_renderer.hpp"
#include "base/capabilities.hpp"
#include "gl/fragment_counter.hpp"
#include "opacity_buffer.hpp"
#include "resources.hpp"
#include "shader_variants.hpp"
#include "tile_marks.hpp"

namespace sheetsplat::backend_gl {

class TileLoop {
  public:
    TileLoop(const Job& job, const gl::Api& gl, const Capabilities& capabilities, Resources& resources,
             const Classification* classification, const Tile& tile);

    /// progress: called after each pass with the share of this tile that is done.
    void run(const std::function<void(double)>& progress);

    /// Kernels that were drawn, counted at every batch that they stand in, and kernels that the opacity buffer dropped.
    [[nodiscard]] std::size_t drawn() const { return drawn_; }
    [[nodiscard]] std::size_t dropped() const { return dropped_; }
    /// Fragments of splats, where the plan counts them. Waits for the drawing.
    [[nodiscard]] std::uint64_t fragments() { return fragments_.count(); }
    [[nodiscard]] const Targets& targets() const { return *targets_; }
    /// Seconds of vertex making, of which the device knows nothing.
    [[nodiscard]] double vertex_seconds() const { return vertex_seconds_; }

  private:
    void splat(std::int64_t pass);
    void splat_regular(std::size_t part, std::int64_t pass, std::int64_t first_slab);
    void draw_kernels(const gl::Program& program, const FieldView& view, const VertexMaker& maker,
                      std::int64_t first_slab, std::size_t count);
    void splat_ellipsoids(std::size_t part, std::int64_t pass, std::int64_t first_slab);
    /// Draws what was gathered for one group of the newest batch (numbered as records_ is), and forgets it.
    void draw_group(std::size_t part, std::size_t group, std::int64_t pass, std::int64_t first_slab);
    void draw_records(const EllipsoidView& view, std::size_t numbered, std::size_t records, const SplatTarget& target,
                      std::int64_t pass, std::int64_t first_slab);
    /// The two ways of drawing ellipsoids that are kept for comparison.
    void splat_paper(std::size_t part, std::int64_t pass);
    void gather(std::size_t part, std::int64_t pass);
    /// Marks what the active cells of a part can touch; calls visit(cell, box) for those that can be seen.
    template <class Visit>
    void for_each_active(std::size_t part, Visit&& visit);
    [[nodiscard]] SlabPass slab_pass(std::int64_t pass) const;
    void set_offsets(const gl::Program& program, std::int64_t first_slab) const;
    /// Binds the sheets that a field's splats go to.
    void bind_target(const SplatTarget& target, std::int64_t pass) const;
    /// Calls draw(target) for each pass that a field's splats take.
    template <class Draw>
    void for_each_target(std::size_t field, bool narrow, Draw&& draw) const;
    /// Divides the fields with sheets of their own and adds them to the sheets of all.
    void resolve(std::int64_t pass);
    void copy(std::int64_t pass);
    void shade(std::int64_t pass);
    void set_shading(const gl::Program& program, std::int64_t pass);
    /// Uploads which slices each pixel keeps.
    void make_clip();
    void bind_sheets(const gl::Program& program, std::int64_t pass) const;
    void draw_touched(const gl::Program& program);
    void eliminate();
    void restart_tags();
    void update_opacity(std::int64_t pass);
    void draw_rectangles(const std::vector<Rectangle>& rectangles);
    [[nodiscard]] float tag_of(int batch) const;
    [[nodiscard]] bool tags_by_depth() const {
        return plan_.tagging == Tagging::depth_bounds || plan_.tagging == Tagging::depth_equal;
    }
    /// Where the optical axis meets the targets, pixels.
    [[nodiscard]] double axis_x() const { return 0.5 * frame_.size.width - tile_.x + Tile::border; }
    [[nodiscard]] double axis_y() const { return 0.5 * frame_.size.height - tile_.y + Tile::border; }
    [[nodiscard]] int ring(std::int64_t pass) const { return static_cast<int>(pass % 3); }

    const Job& job_;
    const gl::Api& gl_;
    const Capabilities& capabilities_;
    Resources& resources_;
    const Classification* classification_;
    const DrawPlan& plan_;
    const Frame& frame_;
    Tile tile_;
    Steps steps_;
    TileMarks marks_;
    std::vector<VertexMaker> makers_;
    std::vector<CellWalk> walks_;
    std::vector<float> pivots_; ///< of each field with sheets of its own, in the sheets' unit: see pivots_of
    std::vector<ActiveCells> active_;
    std::array<std::vector<SectionRecord>, 2 * section_groups> records_; ///< wide ones, then narrow ones
    std::array<std::vector<SectionRest>, 2 * section_groups> rests_;     ///< of the precise ones
    std::array<std::vector<std::uint32_t>, 2 * section_groups> indices_; ///< the same where sections are resident
    const Targets* targets_ = nullptr;
    int tags_limit_;
    int tag_ = 0;      ///< of the newest batch, counted since the tags were cleared
    int untagged_ = 0; ///< passes for which tags are missing, since they were cleared
    gl::Texture kept_; ///< of each pixel the first slice that the clip keeps, and the last one
    OpacityBuffer opacity_;
    gl::AsyncReadback readback_;
    std::vector<float> readback_pixels_;
    std::int64_t last_readback_ = 0;
    std::size_t drawn_ = 0, dropped_ = 0;
    gl::FragmentCounter fragments_;
    double vertex_seconds_ = 0.0;
};

} // namespace sheetsplat::backend_gl

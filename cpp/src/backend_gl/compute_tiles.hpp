// The compute path (OpenGL 4.3): work groups draw small tiles from the first slab to the last (glsl/tile.comp), and
// nothing but the picture is written to the device's memory.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <vector>

#include "classification.hpp"
#include "resident_fields.hpp"
#include "shading_pass.hpp"
#include "tile_scope.hpp"

namespace sheetsplat::backend_gl {

/// How the program of a picture is specialised, and what it takes of a work group's memory.
struct TileProgram {
    gl::Defines defines;
    int edge = 16;  ///< points along an edge of a work group's tile
    int border = 0; ///< of them, neighbours that gradients read on each side
};

class ComputeTiles {
  public:
    /// classification: null where the mode has none.
    ComputeTiles(const TileScope& scope, const Classification* classification);

    /// progress: called with the share of this tile that is done.
    void run(const std::function<void(double)>& progress);
    /// Kernels that were drawn.
    [[nodiscard]] std::size_t drawn() const { return drawn_; }

    /// Where hooks count work: sections of kernels at points, samples that were read, barriers, over all threads.
    [[nodiscard]] const std::array<std::uint64_t, 3>& counts() const { return counts_; }
    /// What a work group takes.
    [[nodiscard]] int shared_bytes() const { return shared_bytes_; }
    [[nodiscard]] int threads() const { return threads_; }

  private:
    struct PartRecord;
    /// Uploads what the device does not have yet, slices ellipsoids and bounds them. Returns about how many turns of
    /// loops four slices take at a point, at most.
    double prepare();
    [[nodiscard]] double turns_of(const PartRecord& part) const;
    /// Steps of four slices of one call, for drivers that end loops early. Throws Unsupported where one is too many.
    [[nodiscard]] int most_steps_a_call(double turns_a_step) const;
    /// Kernels of lattices are products of three Gaussians, which are summed point by point.
    [[nodiscard]] bool gathers_products() const;
    [[nodiscard]] PartRecord lattice_record(const RegularPart& part, int number);
    [[nodiscard]] PartRecord kernels_record(const EllipsoidPart& part);
    /// What both kinds of fields have.
    [[nodiscard]] PartRecord record_of(std::size_t field) const;
    /// Of the record of a kernel, with what float32 cut off it where the plan needs that.
    [[nodiscard]] std::size_t record_floats() const;
    /// Slices all kernels for the view, into the buffer of records.
    void slice_kernels() const;
    void find_bounds(const std::vector<PartRecord>& parts) const;
    [[nodiscard]] TileProgram program() const;
    void clear_counts(std::size_t groups);
    void add_counts(std::size_t groups);
    /// How far kernels reach beyond their supports: slabs, pixels.
    void set_reach(const gl::Program& program) const;

    const TileScope& scope_;
    ShadingPass shading_;
    std::vector<const ResidentLattice*> lattices_;
    std::size_t parts_ = 0, records_ = 0, ordered_ = 0, leaves_ = 0, drawn_ = 0;
    bool holes_ = false;
    std::array<std::uint64_t, 3> counts_{};
    int shared_bytes_ = 0, threads_ = 0;
};

} // namespace sheetsplat::backend_gl

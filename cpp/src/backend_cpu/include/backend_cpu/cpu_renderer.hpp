// The slice loop on the processor: image tiles small enough for the cache, each walked front to back by one thread with
// a ring of sheets, in vectors of float32 or float64. Pictures do not depend on the number of threads.
// Source: conventions; [NM05] figure 5 for the loop, [NM06] for scattered ellipsoids.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "base/threads.hpp"
#include "index/visible_runs.hpp"
#include "plan/make_plan.hpp"
#include "sheetsplat/image.hpp"
#include "sheetsplat/light_volume.hpp"
#include "sheetsplat/renderer.hpp"
#include "view/ellipsoid_view.hpp"
#include "view/field_view.hpp"

namespace sheetsplat::backend_cpu {

/// A lattice whose kernels are those of another one but for their values.
struct LatticeBeside {
    std::size_t field = 0;
    const FieldView* view = nullptr;
    const VisibleRuns* runs = nullptr; ///< which of its samples are drawn
};

/// A lattice in the scene.
struct RegularPart {
    std::size_t field = 0; ///< in the scene
    const FieldView* view = nullptr;
    const VisibleRuns* runs = nullptr; ///< which samples are drawn; with others beside, of any
    const VisibleRuns* own = nullptr;  ///< of this one
    /// Summed with these kernels, so that they are no parts of their own: each in sheets of its own, without weights
    /// and derivatives.
    std::vector<LatticeBeside> beside = {};
};

/// A lattice of labels that is not splatted: its sums are those of all samples less those of the other labels of its
/// set, which are in the scene and share the samples of the lattice among each other.
struct RestPart {
    std::size_t field = 0;
    const FieldView* view = nullptr;
    const VisibleRuns* runs = nullptr; ///< which samples would be drawn: its sum is 0 elsewhere
    /// At each end of an axis, in which samples may be missing where they meet those of another axis.
    std::size_t layers = 0;
};
/// Whether the sum of all samples of a lattice is found by places alone: at points, of kernels that are alike.
[[nodiscard]] bool finds_rests(const DrawPlan& plan, const FieldView& view);

/// Whether kernels of lattices add their values alone to sheets of slices, at points, so that one walk may be for
/// several (RegularPart::beside).
[[nodiscard]] bool sums_values_alone(const DrawPlan& plan);

/// A field whose kernels are those of another one but for their values.
struct ValuesBeside {
    std::size_t field = 0;
    const EllipsoidView* view = nullptr;
    std::uint64_t visible_version = 0; ///< of the flags that it would be drawn with
};

/// Scattered ellipsoids in the scene.
struct EllipsoidPart {
    std::size_t field = 0;
    std::shared_ptr<const EllipsoidField> kernels;
    const EllipsoidView* view = nullptr;
    const std::vector<std::uint8_t>* visible = nullptr; ///< one flag a kernel
    /// Changes whenever `visible` does, so that what was sorted for the one is not used for the other.
    std::uint64_t visible_version = 0;
    /// Summed with these kernels, so that it is no part of its own. Both fields are divided by their weights, each is
    /// all of its group, and no derivatives are summed.
    std::optional<ValuesBeside> beside = {};
};

/// One view, ready to be drawn. Nothing is owned.
struct Job {
    const Scene* scene = nullptr;
    const Camera* camera = nullptr;
    const Frame* frame = nullptr;
    const DrawPlan* plan = nullptr;
    std::vector<RegularPart> regular;
    std::vector<RestPart> rests; ///< one of a set of labels
    std::vector<EllipsoidPart> ellipsoids;
    int tile_size = 0; ///< largest edge of an image tile, pixels; 0: what fits the cache
    int threads = 0;   ///< 0: as many as the process may run on
    const Progress* progress = nullptr;
    const LightVolumes* volumes = nullptr; ///< where the plan has shadows or ambient occlusion
    /// Of an excerpt, a flag for each tile with edges of tile_size: tiles of 0 stay empty. Null: all are drawn.
    const std::vector<std::uint8_t>* drawn_tiles = nullptr;
};

struct SliceRecord;

/// Owns threads, and what was sorted by tiles for the last view.
class CpuRenderer {
  public:
    CpuRenderer();
    ~CpuRenderer();
    CpuRenderer(const CpuRenderer&) = delete;
    CpuRenderer& operator=(const CpuRenderer&) = delete;

    /// Fills the picture and adds to its stats: kernels_drawn, bytes_view, bytes_device, seconds_bucket, seconds_draw,
    /// tiles, threads, buckets_reused. Throws OutOfMemory, Cancelled, Error; it can be used again after each.
    void render(const Job& job, Image& image);
    /// What light loses in slices of an orthographic view, as -ln of what is left of it: sums over so many slices,
    /// the first ones first. values: zeros, an element a pixel in rows, a plane for each sum. The plan must be one of
    /// slices that are points, unlit. What was sorted for pictures stays. Throws as render does.
    void absorb(const Job& job, int every, float* values);
    /// The same of rho over the plan's value_unit, a plane for each slice.
    void sample(const Job& job, std::size_t group, float* values);

  private:
    /// Draws into planes in place of a picture.
    void record(const Job& job, const SliceRecord& record);

    struct State;
    std::unique_ptr<State> state_;
};

} // namespace sheetsplat::backend_cpu

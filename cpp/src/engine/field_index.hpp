// What does not depend on the camera: which samples and kernels are drawn, and grids of scattered kernels. Kept between
// pictures.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <vector>

#include "facts/frame.hpp"
#include "index/spatial_grid.hpp"
#include "index/visible_runs.hpp"
#include "plan/make_plan.hpp"
#include "sheetsplat/scene.hpp"

namespace sheetsplat {

/// Which samples of a lattice are drawn, and what that was decided from.
struct RunsEntry {
    std::shared_ptr<const Field> field;
    std::vector<TransferPoint> points; ///< of the transfer function; none where it was not asked
    VisibilityQuery query;
    VisibleRuns runs;
    std::uint64_t version = 0; ///< another one for other runs

    [[nodiscard]] bool answers(const VisibilityQuery& other) const;
};

/// Scattered kernels with their grid, and which of them are drawn.
struct GridEntry {
    std::shared_ptr<const Field> field;            ///< of the scene
    std::shared_ptr<const EllipsoidField> kernels; ///< the field itself, or a lattice's kernels one by one
    SpatialGrid grid;
    std::unique_ptr<ReachLists> reach; ///< made for OpenGL alone; null too where kernels begin in their homes
    bool judged = false;
    std::vector<TransferPoint> points; ///< what `visible` was decided from
    EllipsoidVisibility query;
    std::vector<std::uint8_t> visible;
    std::size_t visible_count = 0;
    std::uint64_t version = 0; ///< another one for other flags

    [[nodiscard]] bool answers(const EllipsoidVisibility& other) const;
    [[nodiscard]] std::size_t bytes() const { return grid.bytes() + (reach ? reach->bytes() : 0) + visible.capacity(); }
};

class FieldIndex {
  public:
    /// slant: largest of the picture. Throws OutOfMemory, Unsupported.
    const RunsEntry& runs_of(const std::shared_ptr<const Field>& field, const Scene& scene, const DrawPlan& plan,
                             const Frame& frame, double slant);
    const GridEntry& grid_of(const std::shared_ptr<const Field>& field, const Scene& scene, const DrawPlan& plan,
                             const Frame& frame, double slant);
    /// Field::reach_along, by way of the field's grid where there is one.
    [[nodiscard]] std::array<double, 2> reach_along(const Field& field, const Vec3& from, const Vec3& direction) const;
    /// Drops what belongs to fields that the scene does not hold.
    void forget_others(const Scene& scene);

  private:
    [[nodiscard]] GridEntry* find_grid(const Field* field) const;

    std::vector<std::unique_ptr<RunsEntry>> runs_;
    std::vector<std::unique_ptr<GridEntry>> grids_;
    std::uint64_t versions_ = 0;
};

} // namespace sheetsplat

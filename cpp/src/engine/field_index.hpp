// What does not depend on the camera: which samples and kernels are drawn, and grids of scattered kernels. Kept between
// pictures.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "facts/field_survey.hpp"
#include "facts/frame.hpp"
#include "index/spatial_grid.hpp"
#include "index/visible_runs.hpp"
#include "plan/make_plan.hpp"
#include "sheetsplat/scene.hpp"

namespace sheetsplat {

/// What the drawn kernels of a field were decided from.
struct Decision {
    VisibilityQuery query;             ///< without its transfer function
    std::vector<TransferPoint> points; ///< of the transfer function; none where it was not used

    /// Whether a query has the same answer, or one that draws little more than it needs.
    [[nodiscard]] bool answers(const VisibilityQuery& other) const;
};

/// Which samples of a lattice are drawn.
struct RunsEntry {
    std::weak_ptr<const Field> field;
    std::size_t copy = 0; ///< how often the scene holds the field before
    Decision decided;
    VisibleRuns runs;
    std::uint64_t version = 0; ///< another one for other runs
};

/// Scattered kernels with their grid, and which of them are drawn.
struct GridEntry {
    std::weak_ptr<const Field> field;              ///< of the scene
    std::size_t copy = 0;                          ///< how often the scene holds the field before
    std::shared_ptr<const EllipsoidField> kernels; ///< the field itself, or a lattice's kernels one by one
    SpatialGrid grid;
    std::unique_ptr<StartCells> starts; ///< for OpenGL alone; null too where kernels start in their homes
    std::optional<Decision> decided;
    std::vector<std::uint8_t> visible;
    std::size_t visible_count = 0;
    std::uint64_t version = 0; ///< another one for other flags

    [[nodiscard]] std::size_t bytes() const {
        return grid.bytes() + (starts ? starts->bytes() : 0) + visible.capacity();
    }
};

class FieldIndex {
  public:
    /// Throw OutOfMemory, Unsupported.
    /// number: of a field of the scene.
    const RunsEntry& runs_of(std::size_t number, const Scene& scene, const DrawPlan& plan, const Frame& frame);
    const GridEntry& grid_of(std::size_t number, const Scene& scene, const DrawPlan& plan, const Frame& frame);
    /// Whether two fields are of the same scattered kernels, but for their values: bit for bit.
    [[nodiscard]] bool differ_in_values(const std::shared_ptr<const Field>& a, const std::shared_ptr<const Field>& b) {
        return compared(a, b).same_weights;
    }
    /// Where each sample of lattices that lie alike is 1 in one of the fields and 0 in the others, so that their sums
    /// add up to that of the kernels of all samples: how many layers at each end of an axis may lack samples where they
    /// meet those of another axis. Nothing where the fields are others. fields: one or more.
    [[nodiscard]] std::optional<std::size_t> share_samples(const std::vector<std::shared_ptr<const Field>>& fields);
    /// Whether two lattices without holes lie alike and have kernels of one profile.
    [[nodiscard]] static bool have_the_same_kernels(const Field& a, const Field& b);
    /// The samples of lattices that lie alike which any of some entries draw.
    const VisibleRuns& runs_of_any(const std::vector<const RunsEntry*>& entries);
    /// Field::reach_along, by way of the field's grid where there is one.
    [[nodiscard]] std::array<double, 2> reach_along(const Field& field, const Vec3& from, const Vec3& direction) const;
    /// Drops what belongs to other fields. As FieldSurveys::forget_others; of `parts` what takes little beside them.
    void forget_others(const std::vector<std::shared_ptr<const Field>>& fields, bool parts);

  private:
    /// Two fields, whether their kernels have the same places and sizes, and whether nothing but values differs.
    struct Alike {
        std::weak_ptr<const Field> one, other;
        bool same;
        bool same_weights;
    };
    struct Sharing {
        std::vector<std::weak_ptr<const Field>> fields;
        std::optional<std::size_t> layers;
    };
    struct AnyRuns {
        std::vector<std::uint64_t> versions; ///< of the entries
        VisibleRuns runs;
    };
    [[nodiscard]] const Alike& compared(const std::shared_ptr<const Field>& a, const std::shared_ptr<const Field>& b);
    [[nodiscard]] bool lies_alike(const std::shared_ptr<const Field>& a, const std::shared_ptr<const Field>& b) {
        return compared(a, b).same;
    }
    /// Of a group that is there for others: beside what alone its kernels matter; nothing where that is not known.
    [[nodiscard]] std::vector<SeenBeside> seen_beside(std::size_t number, const Scene& scene, const DrawPlan& plan,
                                                      const Frame& frame);
    [[nodiscard]] GridEntry* find_grid(const Field* field, std::size_t copy) const;

    std::vector<std::unique_ptr<RunsEntry>> runs_;
    std::vector<std::unique_ptr<GridEntry>> grids_;
    std::vector<Alike> alike_;
    std::vector<Sharing> sharing_;
    std::vector<std::unique_ptr<AnyRuns>> any_runs_;
    std::uint64_t versions_ = 0;
};

} // namespace sheetsplat

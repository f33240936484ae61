// How far light at points of a picture is from its definition: what the picture's light volumes, or lines through its
// grid of rho, leave of light, less the exact products along lines, in float64 from the kernels. Source: conventions,
// section 10.
#pragma once

#include <array>
#include <cstddef>
#include <functional>
#include <memory>
#include <vector>

#include "light/blocks.hpp"
#include "light/lit_view.hpp"
#include "light/surface_lines.hpp"
#include "light/volumes.hpp"
#include "point_values.hpp"
#include "reference/clip.hpp"
#include "scene/mode_rules.hpp"
#include "sheetsplat/light_volume.hpp"

namespace sheetsplat {

/// The blocks of one of a picture's volumes of rho.
using BlocksOf = std::function<const LightBlocks&(const LightVolume&)>;
/// The clear cells of what a picture's volumes were made from.
using ClearOf = std::function<const ClearCells&()>;

/// Of one picture, whose scene, camera, plan and volumes must stay while it is used. Points are in world units.
class LightAtPoints {
  public:
    /// absorption: what the volumes were made from; null where it is not there any more. values: of each field.
    LightAtPoints(const LitView& lit, const LightVolumes& volumes, const LightVolume* absorption,
                  const BlocksOf& blocks, const ClearOf& clear, std::vector<std::shared_ptr<const PointValues>> values);

    /// Whether light is followed along lines, from surfaces.
    [[nodiscard]] bool surfaces() const { return surfaces_; }
    [[nodiscard]] const std::vector<Group>& groups() const { return groups_; }
    /// Of all supports, with what a filter adds.
    [[nodiscard]] const Box& box() const { return box_; }
    /// Length of a slice distance in reference lengths.
    [[nodiscard]] double lengths() const { return lengths_; }

    /// rho of a group of fields, and whether no kernel reaches the point.
    [[nodiscard]] PointValues::Value value_at(std::size_t group, const Vec3& world) const;
    /// What slab sampling shows of a line between two points.
    [[nodiscard]] PointValues::Value mean_between(std::size_t group, const Vec3& from, const Vec3& to) const;
    /// rho at a point where it decides on which side of each surface the point is; else any value of that side.
    [[nodiscard]] PointValues::Value side_of(std::size_t group, const Vec3& world) const;
    /// What surfaces of a group between -infinity and rho absorb.
    [[nodiscard]] double absorbed_below(std::size_t group, double rho) const;
    /// Whether a point lies inside of where a group's fields end, if other groups' do not end there.
    [[nodiscard]] bool inside_end(std::size_t group, const Vec3& world) const;
    /// Whether two points lie in blocks on the same side of all surfaces.
    [[nodiscard]] bool on_one_side(const Vec3& front, const Vec3& back) const;
    /// A line in the grid of absorption: point t lies at start + t along.
    struct ClearLine {
        Vec3 start{0.0}, along{0.0};
    };
    [[nodiscard]] ClearLine clear_line(const Vec3& start, const Vec3& along) const;
    /// Whether the grid of absorption shows nothing around point t of a line.
    [[nodiscard]] bool clear_at(const ClearLine& line, double t) const {
        return clear_ != nullptr && clear_->at(line.start + t * line.along);
    }
    [[nodiscard]] bool clip_keeps(const Vec3& world) const;

    /// What the picture shows of a light at a point, and of what is open around it.
    [[nodiscard]] double light_shown(std::size_t number, const Vec3& world) const;
    [[nodiscard]] double open_shown(const Vec3& world) const;
    /// What the scene's part leaves on the way of a light, or of one of directions_around, to a point that may lie
    /// elsewhere: all of it are multiplied. Of surfaces what it absorbs: all of it add up.
    [[nodiscard]] double light_here(std::size_t number, const Vec3& world) const;
    [[nodiscard]] double open_here(std::size_t direction, const Vec3& world) const;
    /// Whether a point lies in the part's cell; without a part all do.
    [[nodiscard]] bool holds(const Vec3& world) const;

  private:
    /// What a group shows of `of` its fields at a point: of a label, less the largest of the others.
    template <class Of>
    [[nodiscard]] PointValues::Value sum_of(std::size_t group, const Vec3& world, const Of& of) const;
    /// Blocks of a grid of rho that lie on one side of every surface: absorbed_below there; of others `mixed`.
    static constexpr double mixed = -1.0;
    struct Sides {
        const LightBlocks* blocks;
        std::vector<double> below;
    };

    [[nodiscard]] Sides sides_of(std::size_t group, const LightBlocks& blocks) const;
    [[nodiscard]] double side_at(std::size_t group, const Vec3& place) const;
    [[nodiscard]] PointValues::Value side_in_cell(std::size_t group, const Vec3& world,
                                                  const LightVolume::Around& around) const;
    /// Steps to the last point where there is something on a line towards light. place, step: in the grid.
    [[nodiscard]] double last_step(const Vec3& world, const Vec3& direction, const Vec3& place, const Vec3& step) const;
    [[nodiscard]] double left_along(const Vec3& world, const Vec3& direction, double steps) const;
    [[nodiscard]] double absorbed_along(const Vec3& world, const Vec3& direction, const Vec3& step, double steps) const;

    const Scene& scene_;
    const Camera& camera_;
    const Frame& frame_;
    const DrawPlan& plan_;
    const LightVolumes& volumes_;
    std::vector<std::shared_ptr<const PointValues>> values_; ///< of each field
    bool surfaces_;
    std::vector<Group> groups_;
    std::vector<GroupRange> label_sets_;
    reference::Clipping clipping_;
    Parallelepiped cell_; ///< of the part: lower <= x < upper
    Box box_;
    double lengths_;
    double together_; ///< steps of a line to a light through a volume that are taken together
    std::vector<Vec3> to_lights_;
    std::array<Vec3, directions_around> around_ = around_world();
    SurfaceLines lines_;
    bool resolved_ = false;                   ///< the grid of rho shows every kernel
    std::vector<Sides> sides_;                ///< of each group, mode isosurface
    const LightVolume* absorption_ = nullptr; ///< null: not used
    const ClearCells* clear_ = nullptr;
    double occlusion_steps_ = 0.0;
};

} // namespace sheetsplat

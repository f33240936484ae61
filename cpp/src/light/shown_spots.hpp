// What pixels of a picture show, from the kernels in float64, and what light adds there. Source: conventions, sections
// 4 to 7 and 10.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "at_points.hpp"
#include "light/lit_view.hpp"
#include "reference/screen.hpp"
#include "reference/shade.hpp"
#include "sheetsplat/light_probe.hpp"
#include "view/cut_faces.hpp"
#include "view/kept_slices.hpp"

namespace sheetsplat {

/// Of one picture: what is referred to must stay while this is used.
class ShownSpots {
  public:
    ShownSpots(const LitView& lit, const LightAtPoints& light);

    /// What a pixel shows, from front to back. number: LightSpot.
    [[nodiscard]] std::vector<LightSpot> at(std::size_t number, int column, int row) const;
    /// Where a pixel's spot is.
    [[nodiscard]] Vec3 place_of(int column, int row, const LightSpot& spot) const;
    /// What all of each light adds at a spot that adds 1 to a pixel; 0 of those that add less than `least`.
    [[nodiscard]] std::vector<Vec3> most_of_lights(int column, int row, const LightSpot& spot, double least) const;
    /// The same of light from all around.
    [[nodiscard]] Vec3 most_open(const LightSpot& spot) const;

  private:
    struct Values {
        std::vector<PointValues::Value> groups; ///< none: empty in all
        bool looked_at = false;
        [[nodiscard]] double rho(std::size_t group) const { return groups.empty() ? 0.0 : groups[group].rho; }
        [[nodiscard]] bool empty(std::size_t group) const { return groups.empty() || groups[group].empty; }
    };
    /// The line of a pixel: the point at depth t is start + t along.
    struct Ray {
        int column = 0, row = 0;
        Vec3 start{0.0}, along{0.0};       ///< world
        std::int64_t first = 0, last = -1; ///< slices where it meets supports
        std::int64_t last_kept = 0;        ///< the last one in front of the depth limit
        [[nodiscard]] Vec3 point(double depth) const { return start + depth * along; }
    };

    [[nodiscard]] Vec3 to_world(const Vec3& eye) const;
    [[nodiscard]] Ray ray_of(int column, int row) const;
    [[nodiscard]] double depth_of(const LightSpot& spot) const {
        return lit_.frame.depth_of(spot.slice) + spot.behind * lit_.frame.slice_spacing;
    }
    [[nodiscard]] Values values_at(const Ray& ray, std::int64_t n) const;
    /// What a sheet shows at a pixel, or that much beside it: rho there, or of its slab.
    [[nodiscard]] PointValues::Value shown(std::size_t group, int column, int row, double depth,
                                           const Vec3& beside = Vec3(0.0)) const;
    /// rho where a pixel meets a slice; 0 beyond the slices.
    [[nodiscard]] double rho_on(std::size_t group, int column, int row, std::int64_t slice) const;
    /// Whether a ray's point of a slice is kept.
    [[nodiscard]] bool keeps(const Ray& ray, std::int64_t n) const;
    /// Each adds what an interval, or a slice, shows behind `alpha`, which grows.
    template <class At>
    void add_crossings(const Ray& ray, std::int64_t n, const At& values, double& alpha,
                       std::vector<LightSpot>& spots) const;
    template <class At>
    void add_slice(const Ray& ray, std::int64_t n, const At& values, double& alpha,
                   std::vector<LightSpot>& spots) const;
    /// The gradient as the picture has it (sections 4, 5, 7 and 10), per reference length: between two slices it is
    /// mixed of theirs. Eye space.
    [[nodiscard]] Vec3 gradient(int column, int row, const LightSpot& spot) const;
    [[nodiscard]] Vec3 gradient_on(int column, int row, std::int64_t slice, std::size_t group) const;
    /// What is left by the depth cue.
    [[nodiscard]] double cued(const LightSpot& spot) const;

    const LitView& lit_;
    const Scene& scene_;
    const LightAtPoints& light_;
    reference::Screen screen_;
    reference::Shader shader_;
    SlicesInFront in_front_;
    CutFaces faces_;
    double half_slab_; ///< 0: sheets show rho at points
};

} // namespace sheetsplat

// Ellipsoids as a camera sees them, and their cross-sections in factored form. Source: [NM06] sections 3.3 and 4.1
// (equations 8 to 19), with B = V R S in place of its inverse: no covariance is ever formed, so that needles of
// 1:100,000 keep their digits. EWA filter: conventions, section 10.
#pragma once

#include <algorithm>
#include <cstdint>
#include <limits>

#include <glm/vec2.hpp>

#include "facts/frame.hpp"
#include "sheetsplat/camera.hpp"
#include "sheetsplat/scene.hpp"
#include "view/counting.hpp"
#include "view/slab_batches.hpp"

namespace sheetsplat {

/// One kernel in eye space. With n = B^T e_z / h the direction of slicing in the unit sphere, h = |B^T e_z|, and u, v
/// completing n to a basis such that B u and B v are orthogonal on the screen, the section at height s along n is the
/// ellipse around (center + s B n) with semi-axes sqrt(1 - s^2) B u and sqrt(1 - s^2) B v. World units.
struct EyeKernel {
    Vec3 center{0.0};
    double half_depth = 1.0;     ///< h
    glm::dvec2 axis_u{1.0, 0.0}; ///< (B u)_xy, the longer one
    glm::dvec2 axis_v{0.0, 1.0}; ///< (B v)_xy
    glm::dvec2 lean{0.0};        ///< (B n)_xy: how far the section's centre moves from s = 0 to s = 1
    glm::dvec2 extent{1.0, 1.0}; ///< half the extents of the support along eye x and y
    double amplitude = 1.0;      ///< what a filter left of the height
};

/// Kernel from the rows of B: 3-vectors in the unit sphere for eye x, y and z. The longer axis comes first.
EyeKernel slice_kernel(const Vec3& center_eye, const Vec3& row_x, const Vec3& row_y, const Vec3& row_z);

/// What the GPU gets for one kernel: 64 bytes. Pixels are counted from the optical axis, rows downwards; in perspective
/// every length on the screen is pixels times depth, places are pixels of the ray.
struct SectionRecord {
    float whole_x, whole_y; ///< centre of the section on slice `first`: whole pixels
    float part_x, part_y;   ///< and what is left of them
    float first;            ///< slice that the record is anchored at
    float s;                ///< height of the section there
    float step_s;           ///< slice spacing over h
    float value;            ///< f m times the view's value_scale, or as Counting says
    float ux, uy, vx, vy;   ///< B u and B v
    float step_x, step_y; ///< movement of the centre from one slice to the next (perspective: off the ray of the first)
    float weight;         ///< m times the view's weight_scale
    float reserved;
};
static_assert(sizeof(SectionRecord) == 64, "shaders read records of four vec4");

/// What float32 cut off the numbers of a record: 48 bytes.
struct SectionRest {
    float part_x, part_y, s, step_s;
    float ux, uy, vx, vy;
    float step_x, step_y;
    float reserved[2];
};
static_assert(sizeof(SectionRest) == 48, "shaders read three vec4");

/// How a kernel is drawn: kernels of one group share a program.
enum class SectionGroup : std::uint8_t {
    sprite,        ///< a sphere in orthographic view, small enough for a point: one Gaussian serves all its sections
    compact,       ///< slabs are close against the kernel: the exponents of four of them are a polynomial
    plain,         ///< any point-sampled kernel
    thin,          ///< slab sampling, slabs thin against the kernel: 4 nodes
    medium,        ///< 6 nodes
    thick,         ///< erf
    precise_plain, ///< so slender or small that float32 cannot place it: places are computed in float64
    precise_thin,
    precise_medium,
    precise_thick,
};
constexpr std::size_t section_groups = 10;
[[nodiscard]] inline bool is_precise(SectionGroup group) { return group >= SectionGroup::precise_plain; }

/// How the kernels of one field of ellipsoids look in a view. Nothing is owned.
class EllipsoidView {
  public:
    /// value_unit: the amount of rho that the sheets call 1. weight_unit: the weight that they call 1.
    EllipsoidView(const EllipsoidField& field, const Camera& camera, const Frame& frame, Sampling sampling,
                  Filter filter, double value_unit, double weight_unit);

    [[nodiscard]] const EllipsoidField& field() const { return *field_; }
    [[nodiscard]] const Frame& frame() const { return *frame_; }
    [[nodiscard]] double value_scale() const { return value_scale_; }
    [[nodiscard]] double weight_scale() const { return weight_scale_; }
    [[nodiscard]] const Vec3& eye_world() const { return eye_; }
    [[nodiscard]] const Vec3& right_world() const { return right_; }
    [[nodiscard]] const Vec3& up_world() const { return up_; }
    [[nodiscard]] const Vec3& back_world() const { return back_; }
    /// All kernels are spheres in eye space and the camera is orthographic.
    [[nodiscard]] bool spheres() const { return spheres_; }
    /// Sampling slab: half a slice spacing; point: 0.
    [[nodiscard]] double slab_half() const { return slab_half_; }
    [[nodiscard]] bool filtered() const { return filter_ == Filter::ewa; }

    [[nodiscard]] EyeKernel kernel(std::size_t i) const;
    /// Depth of the centre and h alone, at a fraction of the cost.
    struct Depths {
        double center, half;
    };
    [[nodiscard]] Depths depths(std::size_t i) const;
    /// First and last slice that the kernel meets; first > last where it meets none. wider: slices more on both sides.
    struct Span {
        std::int64_t first, last;
    };
    [[nodiscard]] Span span(const Depths& depths, int wider = 0) const;
    /// The record of a kernel, anchored at a slice; precise for slices near it.
    [[nodiscard]] SectionRecord record(std::size_t i, const EyeKernel& kernel, std::int64_t anchor,
                                       SectionRest* rest = nullptr, const Counting& counting = {}) const;
    /// How the kernel is drawn. sprite_px: largest radius of a point sprite; precise_aspect: longest over shortest
    /// semi-axis from which on places are computed in float64.
    [[nodiscard]] SectionGroup group(std::size_t i, const Depths& depths, double sprite_px,
                                     double precise_aspect = std::numeric_limits<double>::infinity()) const;
    /// Of the slices first ... last, the one that a record for them is anchored at: nearest to the kernel's centre, and
    /// in perspective not much nearer to the eye than the others.
    [[nodiscard]] std::int64_t anchor(const EyeKernel& kernel, std::int64_t first, std::int64_t last) const;

    /// Bounds on the screen of the part of the support between two depths, pixels from the optical axis, rows
    /// downwards. `unbounded` where it reaches through the eye.
    struct ScreenBounds {
        double left, right, top, bottom;
        bool unbounded;
    };
    [[nodiscard]] ScreenBounds bounds(const EyeKernel& kernel, double nearest, double farthest) const;
    /// The same for a kernel that is not sliced yet.
    [[nodiscard]] ScreenBounds support_bounds(std::size_t i, double nearest, double farthest) const;
    /// The same as pixels of a tile's targets, `wider_px` larger.
    [[nodiscard]] static PixelBox pixels(const ScreenBounds& bounds, const Frame& frame, const Tile& tile,
                                         int wider_px);
    /// Depth between which a batch that starts at a slice draws.
    [[nodiscard]] double front_of(std::int64_t slice) const { return frame_->depth_of(slice) - slab_half_; }
    [[nodiscard]] double back_of(std::int64_t slice) const { return frame_->depth_of(slice) + slab_half_; }

    /// The point of the support that the viewer meets first, in the world: where its first slice lies ([NM06] 4.2).
    [[nodiscard]] Vec3 first_point_world(std::size_t i) const;

  private:
    [[nodiscard]] Vec3 center_eye(std::size_t i) const;
    [[nodiscard]] FilterWidth filter_at(const Vec3& center_eye) const;

    const EllipsoidField* field_;
    const Frame* frame_;
    Sampling sampling_;
    Filter filter_;
    Vec3 eye_, right_, up_, back_;
    double slab_half_ = 0.0;
    double value_scale_ = 1.0, weight_scale_ = 1.0;
    double per_depth_ = 1.0;
    bool spheres_ = false;
};

} // namespace sheetsplat

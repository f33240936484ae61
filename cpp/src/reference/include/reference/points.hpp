// rho at any point: what section 3 calls point sampling, away from slices and pixels. For shadows and ambient
// occlusion. Source: conventions, section 2.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "reference/kernels.hpp"
#include "reference/reference.hpp"
#include "reference/screen.hpp"
#include "reference/sums.hpp"
#include "sheetsplat/camera.hpp"
#include "sheetsplat/scene.hpp"

namespace sheetsplat::reference {

/// The mean of g over a line that begins at `start` and goes `way`, which is not 0: in units of the support, about the
/// kernel's centre.
Chord mean_of(const Profile& profile, const Vec3& start, const Vec3& way);

/// The kernels of one field in the cells of a grid in eye space, each in all cells that its support may
/// meet.
class PointSums {
  public:
    /// What is referred to must live as long as this. Throws OutOfMemory.
    PointSums(const Field& field, const Scene& scene, const Camera& camera, const Screen& screen, double radius_factor);

    struct Value {
        double rho = 0.0; ///< counted from the base
        bool empty = true;
    };
    [[nodiscard]] Value at(const Vec3& point_eye) const;
    /// D and W, before they are normalised.
    [[nodiscard]] Sums sums_at(const Vec3& point_eye) const;
    /// Their means over the line between two points.
    [[nodiscard]] Sums mean_sums(const Vec3& from_eye, const Vec3& to_eye) const;
    /// Counted from the base.
    [[nodiscard]] double rho(const Sums& sums) const { return normaliser_.rho(sums.d, sums.w); }
    /// Box around all supports, eye space; empty() where there is no kernel.
    [[nodiscard]] const Box& supports_eye() const { return box_; }

  private:
    struct Cells {
        std::array<std::size_t, 3> first, last;
    };
    [[nodiscard]] Cells cells_of(const Box& box) const;
    [[nodiscard]] std::size_t cell_along(int axis, double place) const;
    [[nodiscard]] std::size_t cell_at(const Vec3& place) const;
    /// The kernels in the cells that a box meets, each once, by their places in kernels_.
    [[nodiscard]] std::vector<std::uint32_t> members_in(const Box& box) const;
    void sort_kernels(std::size_t cells);
    /// visit(cell) for every cell that the kernel's support may meet.
    template <class Visit>
    void for_each_cell(const EyeKernel& kernel, Visit&& visit) const;

    std::vector<EyeKernel> kernels_; ///< by the cells of their centres
    Profile profile_;
    Normaliser normaliser_;
    Box box_;
    std::array<std::size_t, 3> cells_{1, 1, 1}; ///< along x, y, z
    Vec3 cell_size_{0.0};
    std::vector<std::uint64_t> offsets_; ///< where each cell's kernels begin; one more at the end
    std::vector<std::uint32_t> members_; ///< places in kernels_, rising within a cell
};

} // namespace sheetsplat::reference

// The fields of the compute path on the device: uploaded once, and again where other kernels are drawn.
#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <memory>
#include <utility>
#include <vector>

#include "backend_gl/gl_renderer.hpp"
#include "gl/objects.hpp"

namespace sheetsplat::backend_gl {

/// A lattice: its samples as a volume of the narrowest format that holds them, and the blocks that drawn ones reach.
struct ResidentLattice {
    gl::VolumeTexture samples, blocks;
    double unit = 1.0;  ///< what a texel is multiplied by for f, or
    double added = 0.0; ///< f - b, with what is added then
    bool holes = false; ///< some samples are no kernels: NaN
    std::uint64_t version = 0;
    std::array<std::size_t, 3> reach{}; ///< that blocks are marked with: samples along k, j and i
    std::shared_ptr<const Field> field;
};

/// How the kernels of a lattice lie around its points, counted in samples along i, j and k.
struct LatticeReach {
    /// Rows of: way from a sample to a point -> height in the unit sphere, place in the plane there.
    std::array<Vec3, 3> frame;
    Vec3 samples{0.0}; ///< how far supports reach
};
LatticeReach lattice_reach(const FieldView& view);

/// Scattered kernels: those that are drawn, neighbours in space next to one another.
struct ResidentKernels {
    std::vector<std::uint32_t> order;
    std::uint64_t version = 0;
    std::shared_ptr<const Field> field;
};

/// Made and destroyed with the context current.
class ResidentFields {
  public:
    explicit ResidentFields(const gl::Api& gl) : gl_(&gl) {}

    /// A field of a scene, and how many of the scene's fields before it are the same.
    using Key = std::pair<const Field*, std::size_t>;
    /// Throw OutOfMemory; Unsupported for lattices beyond the device's largest volume.
    const ResidentLattice& lattice(const Scene& scene, const RegularPart& part);
    const ResidentKernels& kernels(const Scene& scene, const EllipsoidPart& part);
    /// Uploads the orders of all parts, one after the other, unless the buffer holds them.
    void upload_order(const Scene& scene, const std::vector<EllipsoidPart>& parts, gl::Buffer& into);
    /// Gives back what belongs to other fields.
    void keep(const std::vector<std::shared_ptr<const Field>>& fields);
    [[nodiscard]] std::size_t bytes() const;

  private:
    const gl::Api* gl_;
    std::map<Key, ResidentLattice> lattices_;
    std::map<Key, ResidentKernels> kernels_;
    std::vector<std::pair<Key, std::uint64_t>> uploaded_; ///< orders: whose, in which version
};

} // namespace sheetsplat::backend_gl

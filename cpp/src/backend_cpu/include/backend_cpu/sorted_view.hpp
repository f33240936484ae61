// What is sorted by tiles for one view, and may serve the next picture: everything that does not depend on how kernels
// are classified, lit or composited.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <vector>

#include "backend_cpu/cpu_renderer.hpp"
#include "backend_cpu/tile_feed.hpp"
#include "base/threads.hpp"

namespace sheetsplat::backend_cpu {

/// Samples of a row between which all drawn ones lie.
struct RowExtent {
    std::uint32_t begin = 0, end = 0;
};

/// What was sorted by tiles for one lattice.
struct RowBuckets {
    std::shared_ptr<const Field> field; ///< kept, so that no other one gets the address that `view` knows it by
    FieldView view;
    std::vector<RowExtent> rows;
    Buckets<RowPart> parts;
};

/// And for scattered kernels.
struct KernelBuckets {
    std::shared_ptr<const EllipsoidField> kernels;
    Vec3 eye{0.0}, right{0.0}, up{0.0};
    bool filtered = false;
    std::uint64_t visible_version = 0;
    std::uint64_t beside_version = 0; ///< ValuesBeside::visible_version; 0: there is no field beside
    Buckets<std::uint32_t> indices;
};

struct SortedView {
    Frame frame;
    int edge = 0;
    std::vector<std::uint8_t> drawn; ///< TileLayout::drawn
    Sampling sampling = Sampling::point;
    std::vector<RowBuckets> lattices;
    std::vector<KernelBuckets> scattered;

    /// Throws OutOfMemory, and what poll throws.
    static SortedView of(const Job& job, const TileLayout& layout, int edge, RectsFunction rects, ThreadPool& pool,
                         const std::function<void()>& poll);
    [[nodiscard]] std::size_t bytes() const;
    /// Whether it is what `job` would be sorted to.
    [[nodiscard]] bool serves(const Job& job, const TileLayout& layout, int edge_now) const;
};

} // namespace sheetsplat::backend_cpu

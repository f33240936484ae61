// The opacity buffer of [NM05] section 4.4: opacity that is read back now and then, so that whole kernels can be
// dropped before they are drawn.
#pragma once

#include <vector>

#include "view/slab_batches.hpp"

namespace sheetsplat::backend_gl {

/// Answers whether a kernel's box, one pixel wider on every side, lies where nothing more can be seen.
class OpacityBuffer {
  public:
    OpacityBuffer() = default;
    /// average: the paper's test of the mean alpha over the splat instead of its minimum, which may drop kernels that
    /// still show.
    OpacityBuffer(int width, int height, double opacity_stop, bool average);

    /// alpha: width * height values. Pixels of the border count as opaque: no picture shows them.
    void update(const float* rgba);
    [[nodiscard]] bool hides(const PixelBox& box) const;

  private:
    int width_ = 0, height_ = 0;
    double stop_ = 1.0;
    bool average_ = false;
    bool any_ = false;
    /// Summed-area tables over the pixels: of alpha (average), of the count of pixels that are not opaque (minimum).
    std::vector<double> sums_;
};

} // namespace sheetsplat::backend_gl

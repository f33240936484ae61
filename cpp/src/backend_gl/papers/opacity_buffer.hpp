// The opacity buffer of [NM05] section 4.4: the picture's opacity is read back without waiting, so that whole kernels
// can be dropped before they are drawn.
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "gl/objects.hpp"
#include "view/slab_batches.hpp"

namespace sheetsplat::backend_gl {

struct TileScope;

/// Answers whether a kernel's box, one pixel wider on every side, lies where every pixel is opaque. (The paper tests
/// the mean opacity of the box, which drops kernels that still show: cpp/lab.)
class OpacityBuffer {
  public:
    OpacityBuffer(int width, int height, double opacity_stop) : OpacityBuffer(width, height, opacity_stop, 1) {}
    virtual ~OpacityBuffer() = default;
    OpacityBuffer(const OpacityBuffer&) = delete;
    OpacityBuffer& operator=(const OpacityBuffer&) = delete;

    /// rgba: width * height pixels. Those of the border count as opaque: no picture shows them.
    void update(const float* rgba);
    [[nodiscard]] bool hides(const PixelBox& box) const;

  protected:
    /// wider: pixels by which boxes are enlarged.
    OpacityBuffer(int width, int height, double opacity_stop, int wider);
    /// Of a pixel; is_opaque gets the sum of these over a box.
    [[nodiscard]] virtual double measure(float alpha) const;
    [[nodiscard]] virtual bool is_opaque(double sum, double pixels) const;
    [[nodiscard]] double opacity_stop() const { return stop_; }

  private:
    int width_, height_, wider_;
    double stop_;
    bool any_ = false;
    std::vector<double> sums_; ///< summed-area table of the measures
};

/// Keeps an opacity buffer up to date while a tile is drawn; hides nothing where the plan has none.
class OpacityCulling {
  public:
    explicit OpacityCulling(const TileScope& scope);
    [[nodiscard]] bool hides(const PixelBox& box) const { return buffer_ != nullptr && buffer_->hides(box); }
    /// After a pass: takes over what was read back, and starts to read again every ten slices.
    void update(std::int64_t pass);

  private:
    const TileScope& scope_;
    std::unique_ptr<OpacityBuffer> buffer_; ///< null without
    gl::AsyncReadback readback_;
    std::vector<float> pixels_;
    std::int64_t last_slices_ = 0; ///< that were drawn when reading started last
};

} // namespace sheetsplat::backend_gl

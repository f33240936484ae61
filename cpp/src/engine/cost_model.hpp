// What a picture costs: expected before it is drawn, and measured afterwards.
#pragma once

#include <array>

#include "facts/view_facts.hpp"
#include "sheetsplat/camera.hpp"
#include "sheetsplat/render_plan.hpp"
#include "sheetsplat/scene.hpp"

namespace sheetsplat {

/// Counts that a picture's time grows with.
struct Work {
    double kernels = 0.0;
    double slices_each = 0.0; ///< that a kernel meets, on the average
    double radius_px = 0.0;   ///< of a kernel, on the average
    double splats = 0.0;      ///< pixels of all sections
    double pixels = 0.0;      ///< times slices
    /// What a pixel of a section and one of a slice cost, in those of point sampling and of a flat composite.
    double splat_price = 1.0, shade_price = 1.0;
    double number_price = 1.0; ///< of everything: float64 takes longer
};

/// All kernels count, drawn or not.
Work work_of(const Scene& scene, const ViewFacts& view);

/// What a scene's sampling, classification and light cost.
void set_prices(Work& work, const Scene& scene, Projection projection, bool float64);

/// Seconds of the same view with pixels and slice distances so many times larger, on one of today's processors.
/// fewer_kernels: how many kernels stand one for, as wide as all of them.
double expected_seconds(const Work& work, double larger_pixels, double larger_spacing, int threads,
                        double fewer_kernels = 1.0);

/// Times of pictures over expected_seconds, for each backend: of whole pictures, and of coarse ones.
class Paces {
  public:
    void note(Backend backend, bool coarse, double pace);
    /// As last seen; a guess until one was timed.
    [[nodiscard]] double last(Backend backend, bool coarse) const { return at(backend, coarse).last; }
    /// The least of the last three of pictures, or where none was drawn yet of coarse ones.
    [[nodiscard]] double best(Backend backend) const;
    [[nodiscard]] bool knows_pictures(Backend backend) const { return at(backend, false).timed; }

  private:
    struct Pace {
        double last = 1.0;
        bool timed = false;
        std::array<double, 3> recent{};
    };
    [[nodiscard]] const Pace& at(Backend backend, bool coarse) const {
        return paces_[static_cast<std::size_t>(backend)][coarse ? 1 : 0];
    }
    /// In the order of Backend.
    std::array<std::array<Pace, 2>, 4> paces_{
        {{{{1.0}, {1.0}}}, {{{4.0}, {4.0}}}, {{{1.0}, {1.0}}}, {{{200.0}, {200.0}}}}};
};

} // namespace sheetsplat

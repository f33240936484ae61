// Where scattered kernels are densest: sums in float32 have larger errors there than on the average.
#pragma once

#include "facts/frame.hpp"
#include "sheetsplat/camera.hpp"
#include "sheetsplat/field.hpp"

namespace sheetsplat {

/// The same in every view.
struct Crowd {
    /// Estimate of the most kernels that overlap at a point: those of one volume, to a factor of 2, in one of the cells
    /// of that volume. Of more than 2^18 kernels, from a sample.
    double overlap = 0.0;
    /// Most kernels that are much alike: of one volume, to a factor of 2, and at one place, to a thousandth of their
    /// size. What they add to a sum is rounded alike, so that errors add up instead of cancelling.
    double alike = 0.0;
};
/// Linear in the number of kernels.
Crowd survey_crowd(const EllipsoidField& field);

/// Slabs this many times thicker than a leaning kernel's half-depth: beyond, float32 does not resolve its place in them
/// (at 1e4 the 99.9th percentile was seen at 1.2e-3).
constexpr double thick_slab = 3e3;

/// Kernels that are thin in slabs and whose sections move: float32 resolves them to 1e-7 of the slab's thickness over
/// h.
struct ThinInSlabs {
    double loss = 0.0; ///< largest mean, rho, that one of them adds to a slab, times that thickness (up to 1e7)
    double peak = 0.0; ///< largest mean that any kernel adds
};
/// All 0 where no kernel is thinner than 1 / `thick` of a slab.
ThinInSlabs survey_slabs(const EllipsoidField& field, const Camera& camera, const Frame& frame, double thick);

} // namespace sheetsplat

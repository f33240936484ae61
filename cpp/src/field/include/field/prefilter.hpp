// Coefficients of kernels whose sum passes through the samples of a lattice: the interpolating prefilter.
#pragma once

#include <array>
#include <cstddef>

#include "sheetsplat/field.hpp"

namespace sheetsplat {

/// The largest condition number of a kernel's equations: sums in float32 would lose too many digits.
constexpr double worst_prefilter_condition = 2e3;
/// The largest accepted distance of the sums from a sample, relative to the largest |f - b|.
constexpr double worst_prefilter_residual = 1e-6;

struct PrefilterLimits {
    int threads = 0;  ///< 0: as many as the process may run; the coefficients do not depend on their number
    int steps = 2000; ///< of each of the solutions in float32 and float64
};

/// The coefficients, counted from options.base (0 unless given), with which the kernels of the samples add up to f - b
/// at every sample; with options.boundary `edge` those of the mirrored samples are among them, which have the
/// coefficients of what they are images of (a BCC lattice of one layer has none). All of one value, the base, gives 0.
/// Needs, beside the samples and the coefficients, 4 bytes a sample. Throws as RegularField with `prefilter` does, and
/// what poll() throws.
PrefilteredSamples prefiltered(const SampleArray& samples, const std::array<std::size_t, 3>& shape,
                               const RegularFieldOptions& options, const PrefilterLimits& limits = {});

} // namespace sheetsplat

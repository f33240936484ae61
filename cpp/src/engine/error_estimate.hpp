// How far a picture is from the converged one, without computing that. Richardson extrapolation: the change from slice
// distance ds to ds / 2 gives the error at ds. Source: conventions, section 8; the shares were measured
// (error-estimate.md).
#pragma once

#include <vector>

#include "sheetsplat/image.hpp"
#include "sheetsplat/renderer.hpp"
#include "sheetsplat/scene.hpp"

namespace sheetsplat {

/// Distance between the pictures at ds and ds / 2 over that between the one at ds and the converged one. 3/4 where
/// errors fall at second order. Where slices meet kernels, or steps, by chance, the finer picture's error is
/// independent of the coarser one's, and this is about 1.
double richardson_share(const Scene& scene);

/// Pictures of one view that separate the causes of its error; null where a picture would be the same as another, or is
/// not available.
struct Probes {
    const Image* drawn = nullptr;     ///< the picture in question
    const Image* exact = nullptr;     ///< the same in float64; null: arithmetic is taken from the plan
    const Image* unstopped = nullptr; ///< without a stop, at ds, with the numbers of `exact`; null: there is no stop
    const Image* halved = nullptr;    ///< without a stop, at ds / 2, with the numbers of `exact`
};

/// True for causes that pictures of a backend share, whatever their numbers: shares of light looked up in volumes.
bool is_of_model(const ErrorShare& share);

/// Of a plan's causes the root of the sum of squares of those that are.
double model_error(const std::vector<ErrorShare>& budget);

/// share: richardson_share. budget: the plan's. Its causes of the model count unchanged, distributed over the pixels in
/// proportion to opacity; the error of arithmetic is divided among the others in proportion.
ErrorEstimate estimate_from(const Probes& probes, double share, const std::vector<ErrorShare>& budget);

} // namespace sheetsplat

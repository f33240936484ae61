// The result of a rendering, and distances between pictures. Source: conventions, sections 6 to 8.
#pragma once

#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "sheetsplat/render_plan.hpp"
#include "sheetsplat/scene.hpp"
#include "sheetsplat/types.hpp"

namespace sheetsplat {

/// What trades error for time in a picture.
struct Settings {
    double slice_spacing = 1.0; ///< world units
    Sampling sampling = Sampling::point;
    bool preintegration = false;
    bool second_order = false;
    double opacity_stop = default_opacity_stop;
    Precision precision = Precision::automatic;
};

/// Row 0 at the top. Exactly one of rgba and scalar is filled.
struct Image {
    Size size{};
    std::vector<float> rgba;     ///< h * w * 4, premultiplied, linear; empty in scalar modes
    std::vector<float> scalar;   ///< h * w, scalar modes; NaN where no slice counts (mode xray: 0)
    std::vector<float> coverage; ///< h * w, when asked for
    std::vector<float> depth;    ///< h * w, when asked for; infinite where nothing is
    std::vector<float> counts; ///< h * w, of a part in modes average, mip and minimum: slices that count, or 1 for any
    std::shared_ptr<const RenderPlan> plan;
    std::map<std::string, double> stats; ///< seconds per stage, slices, kernels drawn and culled, bytes
    /// What replaced the scene's own settings (RendererOptions::max_error and max_seconds); else nothing.
    std::optional<Settings> settings;
};

/// How far a picture is from the converged one (slice distance towards 0, A_stop = 1, exact arithmetic), estimated
/// without it. Distances are those of compare().
struct ErrorEstimate {
    Size size{};
    double rmse = 0.0;
    std::vector<ErrorShare> budget; ///< by cause; causes are independent: rmse^2 is the sum of their squares
    std::vector<float> map;         ///< h * w: each pixel's own, rmse^2 is the mean of their squares
};

/// Pictures of one view that separate the causes of its error; null where a picture would be the same as another, or is
/// not available.
struct ErrorPictures {
    const Image* drawn = nullptr;     ///< the picture in question
    const Image* exact = nullptr;     ///< the same in float64; null: arithmetic is taken from the plan
    const Image* unstopped = nullptr; ///< without a stop, at ds, with the numbers of `exact`; null: there is no stop
    const Image* halved = nullptr;    ///< without a stop, at ds / 2, with the numbers of `exact`
    const Image* doubled = nullptr;   ///< the same at 2 ds; null: errors are taken to fall as is usual for the mode
};
/// Richardson extrapolation: the change from slice distance ds to ds / 2 gives the error at ds. budget: the plan's. Its
/// shares of light looked up in volumes count unchanged, distributed over the pixels in proportion to opacity; the
/// error of arithmetic is divided among the others in proportion.
ErrorEstimate estimate_error(const ErrorPictures& pictures, Mode mode, bool preintegration,
                             const std::vector<ErrorShare>& budget);

/// What a pixel counts as that is no number in one of two pictures.
enum class Gaps {
    infinite, ///< infinitely far off
    left_out, ///< as far off as if both were none: whether any slice counts there is not what is asked
};

/// Distances of two pictures: over premultiplied RGBA in [0, 1], or scalars divided by max(1, largest absolute value of
/// the reference).
struct Difference {
    double rmse = 0.0;
    double p99_9 = 0.0; ///< 99.9th percentile of the largest channel difference of a pixel
    double maximum = 0.0;
};

/// channels: values a pixel, 4 or 1. Throws InvalidInput where the sizes differ. NaN in both counts as 0.
Difference compare(const std::vector<float>& picture, const std::vector<float>& reference, int channels,
                   Gaps gaps = Gaps::infinite);

/// Straight alpha, clamped, 8 bit, no gamma; scalar pictures are scaled to their largest value. Whole or not at all.
/// Throws Error where the file cannot be written.
void save_png(const Image& image, const std::string& path);
/// Portable float map of the colour (or scalar) channels, linear.
void save_pfm(const Image& image, const std::string& path);

} // namespace sheetsplat

#include "error_estimate.hpp"

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

#include "plan/effect_table.hpp"
#include "probe.hpp"
#include "renderer_state.hpp"
#include "scene/mode_rules.hpp"
#include "sheetsplat/error.hpp"

namespace sheetsplat {

namespace {

/// Distance between the pictures at ds and ds / 2 over that between the one at ds and the converged one, as measured
/// (error-estimate.md). Where slices meet kernels, or steps, by chance, the finer picture's error is independent of the
/// coarser one's, and this is about 1.
/// Of pictures whose errors fall at second order: mip, minimum and isosurfaces, and first- and second-order
/// pre-integration.
constexpr double smooth_share = 0.75;
/// Composites of single slices, pictures at steps, sums and means along rays.
constexpr double plain_share = 1.0;
double richardson_share(Mode mode, bool preintegration) {
    const bool plain = adds_slices(mode) || (is_composited(mode) && !preintegration);
    return plain ? plain_share : smooth_share;
}

/// Two numbers of a view that are the same up to rounding.
constexpr double same = 1e-9;
/// Of all that is done, what the pictures at half and at twice the slice distance are.
constexpr double halved_work = 0.4;
constexpr double doubled_work = 0.1;

void add(std::vector<double>& to, const std::vector<double>& from) {
    for (std::size_t i = 0; i < to.size(); ++i) {
        to[i] += from[i];
    }
}

/// Of the causes that are of the model, or of the others.
double expected(const std::vector<ErrorShare>& budget, bool of_model) {
    double sum = 0.0;
    for (const ErrorShare& share : budget) {
        sum += is_of_model(share) == of_model ? share.rmse * share.rmse : 0.0;
    }
    return std::sqrt(sum);
}

/// Squares of an error, a pixel, in proportion to those of opacity; nothing where there is none.
std::vector<double> by_opacity(const Image& image, double error) {
    std::vector<double> result(image.rgba.size() / 4, 0.0);
    double sum = 0.0;
    for (std::size_t i = 0; i < result.size(); ++i) {
        result[i] = static_cast<double>(image.rgba[4 * i + 3]) * static_cast<double>(image.rgba[4 * i + 3]);
        sum += result[i];
    }
    const double scale = sum > 0.0 ? error * error * static_cast<double>(result.size()) / sum : 0.0;
    for (double& value : result) {
        value *= scale;
    }
    return result;
}

[[noreturn]] void refuse(const std::string& found, const std::string& wanted, const std::string& advice) {
    throw InvalidInput(Complaint{"the error of this picture cannot be estimated", found, wanted, advice});
}

void check_origin(const Image& image, const Scene& scene) {
    if (!image.plan) {
        refuse("a picture without a plan", "one that a renderer drew", "render the scene");
    }
    const auto stage = image.stats.find("stage");
    const auto stages = image.stats.find("stages");
    if (stage != image.stats.end() && stages != image.stats.end() && stage->second < stages->second) {
        refuse("a coarse stage of a picture", "the last stage, or a picture that was rendered at once",
               "use its stats: estimated_rmse is its distance from the last stage");
    }
    const double spacing = scene.slice_distance();
    if (std::abs(image.plan->slice_spacing - spacing) > same * spacing) {
        refuse("slices " + std::to_string(image.plan->slice_spacing) + " apart in the picture, " +
                   std::to_string(spacing) + " in the scene",
               "the scene that the picture shows", "pass the scene and camera that it was rendered with");
    }
    const bool scalar = is_scalar(scene.mode);
    const std::size_t pixels = static_cast<std::size_t>(image.size.width) * static_cast<std::size_t>(image.size.height);
    if (channels_of(image).size() != (scalar ? 1U : 4U) * pixels || image.rgba.empty() != scalar) {
        refuse("a picture of another mode than the scene's", "the scene that the picture shows",
               "pass the scene and camera that it was rendered with");
    }
}

} // namespace

bool is_of_model(const ErrorShare& share) {
    return share.effect == name_of(EffectId::shadows) || share.effect == name_of(EffectId::ambient_occlusion);
}

double model_error(const std::vector<ErrorShare>& budget) { return expected(budget, true); }

ErrorEstimate estimate_error(const ErrorPictures& probes, Mode mode, bool preintegration,
                             const std::vector<ErrorShare>& budget) {
    const Image& drawn = *probes.drawn;
    const Image& exact = probes.exact != nullptr ? *probes.exact : drawn;
    const Image& unstopped = probes.unstopped != nullptr ? *probes.unstopped : exact;
    const double usual = richardson_share(mode, preintegration);
    const double share = probes.doubled == nullptr
                             ? usual
                             : std::min(usual, approach(*probes.doubled, unstopped, *probes.halved).share());
    const double scale = scale_of(*probes.halved);
    ErrorEstimate estimate;
    estimate.size = drawn.size;

    std::vector<double> sum = squares(unstopped, *probes.halved, scale);
    for (double& value : sum) {
        value /= share * share;
    }
    estimate.budget.push_back({"slice distance", root_of_mean(sum)});
    if (probes.unstopped != nullptr) {
        const std::vector<double> stopped = squares(exact, unstopped, scale);
        estimate.budget.push_back({"opacity stop", root_of_mean(stopped)});
        add(sum, stopped);
    }
    const double foreseen = expected(budget, false);
    double arithmetic = foreseen;
    if (probes.exact != nullptr) {
        const std::vector<double> rounded = squares(drawn, exact, scale);
        arithmetic = root_of_mean(rounded);
        add(sum, rounded);
    } else {
        for (double& value : sum) {
            value += foreseen * foreseen;
        }
    }
    for (const ErrorShare& part : budget) {
        if (!is_of_model(part)) {
            estimate.budget.push_back(
                {part.cause, foreseen > 0.0 ? arithmetic * part.rmse / foreseen : 0.0, part.effect});
        }
    }
    if (foreseen == 0.0 && arithmetic > 0.0) {
        estimate.budget.push_back({"arithmetic", arithmetic});
    }
    for (const ErrorShare& part : budget) {
        if (is_of_model(part)) {
            const std::vector<double> spread = by_opacity(drawn, part.rmse);
            estimate.budget.push_back({part.cause, root_of_mean(spread), part.effect});
            add(sum, spread);
        }
    }
    estimate.rmse = root_of_mean(sum);
    estimate.map.reserve(sum.size());
    for (const double value : sum) {
        estimate.map.push_back(static_cast<float>(std::sqrt(value)));
    }
    return estimate;
}

ErrorEstimate Renderer::State::estimate_error(const Image& image, const Scene& shown, const Camera& camera,
                                              const Progress& progress) {
    const Scene scene = image.settings ? with_settings(shown, *image.settings) : shown;
    check_origin(image, scene);
    Scene unstopped = scene;
    unstopped.opacity_stop = 1.0;
    unstopped.slice_spacing = scene.slice_distance();
    unstopped.reference_length = scene.reference_distance();
    Scene halved = unstopped;
    halved.slice_spacing = 0.5 * *unstopped.slice_spacing;
    Scene doubled = unstopped;
    doubled.slice_spacing = 2.0 * *unstopped.slice_spacing;

    const bool stops = image.plan->has(name_of(EffectId::opacity_stop)) && scene.opacity_stop < 1.0;
    double done = 0.0;
    double part = halved_work;
    const Outputs none;
    const RendererOptions in_float64 = exact_options(options_);
    const auto draw = [&](const Scene& what, bool exact) {
        const Progress watch = [&](double share) { return !progress || progress(done + part * share); };
        Image drawn = render({what, camera, image.size, none, watch, exact ? in_float64 : options_});
        done += part;
        return drawn;
    };

    // The reference sums light along each ray: against volumes its own pictures would seem to be wrong.
    bool exact = !can(image.plan->backend, Ability::defines) || !(scene.shadows || scene.ambient_occlusion);
    Image finer;
    try {
        finer = draw(halved, exact);
    } catch (const Unsupported&) {
        if (!exact) {
            throw;
        }
        exact = false;
        finer = draw(halved, false);
    }
    part = doubled_work;
    const Image coarser = draw(doubled, exact);
    part = (1.0 - done) / (1.0 + (stops && exact ? 1.0 : 0.0));
    Image same_scene, whole;
    ErrorPictures probes;
    probes.drawn = &image;
    probes.halved = &finer;
    probes.doubled = &coarser;
    if (exact) {
        same_scene = draw(scene, true);
        probes.exact = &same_scene;
    }
    if (stops) {
        whole = draw(unstopped, exact);
        probes.unstopped = &whole;
    }
    RenderPlan plan = *image.plan;
    measure_light({scene, camera, image.size, none, progress, options_}, plan, true);
    return sheetsplat::estimate_error(probes, scene.mode, scene.preintegration, plan.error_budget);
}

ErrorEstimate Renderer::estimate_error(const Image& image, const Scene& scene, const Camera& camera,
                                       const Progress& progress) {
    return state_->estimate_error(image, scene, camera, progress);
}

} // namespace sheetsplat

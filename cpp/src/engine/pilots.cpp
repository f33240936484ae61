#include "pilots.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "coarse_view.hpp"
#include "error_estimate.hpp"
#include "probe.hpp"
#include "scene/mode_rules.hpp"
#include "sheetsplat/error.hpp"

namespace sheetsplat {

namespace {

/// Slice distances of the picture that a pilot is compared with, in those of the pilot; rounded down to powers of two.
/// Where slices are close already, errors fall as they should, and less has to be drawn.
constexpr double converged = 0.25;
constexpr double converged_close = 0.5;
constexpr double close_spacing = 0.3;
/// Requested errors from which on the picture that a pilot is compared with may be in float32.
constexpr double plain_reference = 3e-5;
constexpr int timed_pilots = 3;
/// Pixels of pictures that excerpts are taken of: larger ones are drawn with larger pixels.
constexpr double most_excerpted = 1024.0 * 1024.0;

} // namespace

Renderer::State::Pilots::Pilots(State& state, const Request& request, const Settings& start, int larger, Part part)
    : state_(state), request_(request), start_(start), size_(coarse_size(request.size, larger)),
      camera_(coarse_camera(request.camera, request.size, larger)),
      scene_(coarse_scene(request.scene, request.size, larger)),
      watch_([this](double) { return !request_.progress || request_.progress(0.0); }) {
    const Prepared prepared = state_.prepare(whole(with_settings(request.scene, start), request.progress));
    backend_ = prepared.plan.summary.backend;
    projection_ = request.camera.projection();
    work_ = prepared.work;
    precision_ = prepared.plan.precision;
    const Backend drawing = slow() ? backend_that(Ability::exact) : backend_;
    if (part != Part::whole && can(drawing, Ability::tiles)) {
        const double pixels = static_cast<double>(request.size.width) * static_cast<double>(request.size.height);
        larger = static_cast<int>(std::ceil(std::sqrt(std::max(1.0, pixels / most_excerpted))));
        size_ = coarse_size(request.size, larger);
        camera_ = coarse_camera(request.camera, request.size, larger);
        scene_ = coarse_scene(request.scene, request.size, larger);
        excerpt_ = spread_tiles(size_, part == Part::checked);
    }
    // The pilot with the largest pixels and slice distance: kernels that it draws suffice for all pilots.
    widest_ = prepared.frame;
    widest_.slice_spacing *= coarsest_spacing;
    widest_.pixel *= larger;
}

std::optional<double> Renderer::State::Pilots::error(const Settings& settings) {
    try {
        const Image picture = draw(settings, false);
        const double spacing = settings.slice_spacing / start_.slice_spacing;
        const Image& reference = converged_for(spacing);
        const double apart = distance(picture, reference, excerpt());
        // The distance of two errors that are alike to a degree, of which one is known.
        const double alike = std::pow(approach_.alike, std::log2(spacing / reference_spacing_));
        const double across = reference_error_ * reference_error_ * (1.0 - alike * alike);
        const double found = alike * reference_error_ + std::sqrt(std::max(0.0, apart * apart - across));
        return std::hypot(found, of_model(settings));
    } catch (const Unsupported&) {
    } catch (const InvalidInput&) {}
    return std::nullopt;
}

double Renderer::State::Pilots::stop_error(const Settings& settings) {
    if (!is_composited(request_.scene.mode) || settings.opacity_stop >= 1.0) {
        return 0.0;
    }
    Settings unstopped = settings;
    unstopped.opacity_stop = 1.0;
    return distance(draw(settings, false), draw(unstopped, false), excerpt());
}

double Renderer::State::Pilots::seconds(const Settings& settings) {
    Work work = work_;
    const bool precise = settings.precision == Precision::float64 || precision_ == Precision::float64;
    set_prices(work, with_settings(request_.scene, settings), projection_, precise);
    return pace_ * expected_seconds(work, 1.0, settings.slice_spacing / start_.slice_spacing,
                                    thread_count(request_.options.threads));
}

Judge::Floor Renderer::State::Pilots::floor() {
    Settings finest = start_;
    finest.slice_spacing *= request_.scene.slice_spacing ? 1.0 : finest_spacing;
    double error = 0.0;
    try {
        error = of_model(finest);
    } catch (const Unsupported&) {
    } catch (const InvalidInput&) {}
    if (error == 0.0) {
        return {};
    }
    std::string causes;
    if (request_.scene.shadows) {
        causes = "shadows";
    }
    if (request_.scene.ambient_occlusion) {
        causes += causes.empty() ? "ambient occlusion" : " and ambient occlusion";
    }
    return {error, "the error expected of " + causes + " from volumes",
            "allow a larger " + option_ref("max_error") + ", leave out " + causes + ", or use " +
                option_ref("backend", "reference") + ", which computes them from the kernels"};
}

double Renderer::State::Pilots::arithmetic() {
    if (precision_ == Precision::float64) {
        return 0.0;
    }
    try {
        return distance(draw(start_, false), draw(start_, true), excerpt());
    } catch (const Unsupported&) {
        return 0.0;
    }
}

void Renderer::State::Pilots::find_pace() {
    for (int n = 0; n < timed_pilots && !state_.paces().knows_pictures(backend_); ++n) {
        draw(start_, false);
    }
    pace_ = state_.paces().best(backend_);
}

double Renderer::State::Pilots::of_model(const Settings& settings) {
    const Scene& scene = request_.scene;
    if ((!scene.shadows && !scene.ambient_occlusion) || slow()) {
        return 0.0;
    }
    const double spacing = settings.slice_spacing;
    const auto known = of_model_.find(spacing);
    if (known != of_model_.end()) {
        return known->second;
    }
    const auto estimated = [&](const Settings& of) {
        return state_.prepare(whole(with_settings(scene, of), watch_)).plan.summary;
    };
    if (!measured_over_estimated_) {
        // Measuring takes a volume of light in the picture's own size: once is enough.
        RenderPlan plan = estimated(start_);
        const double estimate = model_error(plan.error_budget);
        const Scene started = with_settings(scene, start_);
        state_.measure_light(whole(started, watch_), plan);
        measured_over_estimated_ = estimate > 0.0 ? model_error(plan.error_budget) / estimate : 1.0;
    }
    return of_model_[spacing] = *measured_over_estimated_ * model_error(estimated(settings).error_budget);
}

Image Renderer::State::Pilots::draw(const Settings& settings, bool exact) {
    RendererOptions options = exact || slow() ? exact_options(request_.options) : request_.options;
    if (settings.precision != Precision::automatic) {
        options.precision = settings.precision;
    }
    return state_.render({with_settings(scene_, settings), camera_, size_, no_outputs_, watch_, options, excerpt()},
                         &widest_);
}

const Image& Renderer::State::Pilots::fine(double spacing) {
    const auto known = fine_.find(spacing);
    if (known != fine_.end()) {
        return known->second;
    }
    Settings settings = start_;
    settings.slice_spacing = start_.slice_spacing * spacing;
    settings.opacity_stop = 1.0;
    settings.sampling = Sampling::point;
    settings.preintegration = is_composited(request_.scene.mode);
    settings.second_order = false;
    const bool plain = request_.options.precision == Precision::automatic &&
                       request_.options.max_error.value_or(plain_reference) >= plain_reference;
    Image drawn;
    try {
        drawn = draw(settings, !plain);
    } catch (const Unsupported&) {
        drawn = draw(settings, false);
    }
    return fine_.emplace(spacing, std::move(drawn)).first->second;
}

const Image& Renderer::State::Pilots::converged_for(double spacing) {
    const double share = spacing < close_spacing ? converged_close : converged;
    const double wanted = std::exp2(std::floor(std::log2(share * spacing) + 1e-9));
    if (!reference_ || wanted < reference_spacing_) {
        const Image &coarse = fine(4.0 * wanted), &middle = fine(2.0 * wanted), &closest = fine(wanted);
        approach_ = approach(coarse, middle, closest);
        reference_error_ = approach_.factor * distance(middle, closest, excerpt()) / approach_.share();
        reference_ = closest;
        reference_spacing_ = wanted;
        // Closer ones need the last two again.
        fine_.erase(fine_.upper_bound(2.0 * wanted), fine_.end());
    }
    return *reference_;
}

} // namespace sheetsplat

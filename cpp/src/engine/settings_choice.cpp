// max_error and max_seconds: settings are tried in pilots, pictures of few pixels, before the picture is drawn.
#include "settings_choice.hpp"

#include <algorithm>
#include <cmath>
#include <memory>
#include <utility>

#include <glm/geometric.hpp>

#include "base/checks.hpp"
#include "base/unusable.hpp"
#include "error_estimate.hpp"
#include "pilots.hpp"
#include "plan/effect_table.hpp"
#include "scene/mode_rules.hpp"
#include "scene/same_scene.hpp"
#include "sheetsplat/error.hpp"

namespace sheetsplat {

namespace {

/// Least number of a pilot's pixels: errors over so many were within some percent of those over all pixels. Errors of
/// surfaces occur at few pixels, on their edges, so their pilots have the full size up to 1024 x 1024.
constexpr double pilot_pixels = 64.0 * 64.0;
constexpr double surface_pilot_pixels = 1024.0 * 1024.0;
/// From so many times as many pixels on, pilots are tiles of the picture, whose time does not grow with the data.
constexpr double excerpted = 4.0;
/// Largest share of the requested error that float32 may cause; beyond it float64 is used.
constexpr double arithmetic_share = 0.3;
/// A check looks through pixels of this share of a pilot's width.
constexpr double check_pixels = 0.75;
constexpr int most_corrections = 3;
/// Shares of the requested error that are aimed at, and that a check may find. Lower with lights, because gradients are
/// differences between pixels, which larger pixels smooth.
constexpr double flat_aim = 0.85;
constexpr double flat_found = 0.93;
constexpr double lit_aim = 0.72;
constexpr double lit_found = 0.8;
constexpr double surface_aim = 0.5;
constexpr double surface_found = 0.6;
constexpr double refining_order = 1.5;
constexpr double least_move = 0.125; ///< of the height of the view
/// Times that pictures take, over those that they were expected to take: another choice is due beyond.
constexpr double pace_change = 1.25;

double view_height(const Camera& camera) {
    return camera.projection() == Projection::orthographic
               ? camera.height()
               : 2.0 * camera.half_height() * glm::length(camera.eye() - camera.target());
}

Settings settings_of(const Scene& scene) {
    return {scene.slice_distance(), scene.sampling,     scene.preintegration,
            scene.second_order,     scene.opacity_stop, Precision::automatic};
}

/// Only settings at their defaults may be changed.
Freedom freedom_of(const Scene& scene) {
    Freedom free;
    free.spacing = !scene.slice_spacing.has_value();
    free.preintegration = is_composited(scene.mode) && !scene.preintegration;
    free.sampling = scene.sampling == Sampling::point;
    free.stop = is_composited(scene.mode) && scene.opacity_stop == default_opacity_stop;
    return free;
}

} // namespace

void check_goals(const RendererOptions& options) {
    if (options.max_error) {
        const double error = *options.max_error;
        if (!(error > 0.0) || !std::isfinite(error)) {
            throw InvalidInput(Complaint{unusable("Renderer", "max_error"), text_of(error, 3),
                                         "a finite root mean square error above 0",
                                         "leave it out, or pass " + option_ref("max_error", "1e-3")});
        }
        if (error < least_max_error) {
            throw InvalidInput(
                Complaint{unusable("Renderer", "max_error"), text_of(error, 3),
                          "at least " + text_of(least_max_error, 3) + ", the resolution of pictures in float32",
                          "allow a larger error"});
        }
    }
    if (options.max_seconds && (!(*options.max_seconds > 0.0) || !std::isfinite(*options.max_seconds))) {
        throw InvalidInput(Complaint{unusable("Renderer", "max_seconds"), text_of(*options.max_seconds, 3),
                                     "a finite number of seconds above 0",
                                     "leave it out, or pass " + option_ref("max_seconds", "0.1")});
    }
}

bool Chosen::serves(const Scene& other, const Camera& from, Size other_size, double least_cosine) const {
    const double height = view_height(camera), other_height = view_height(from);
    const double near = least_move * std::min(height, other_height);
    // In perspective what is near the eye grows as the eye comes closer, though what is at the target does not.
    const double distance = glm::length(camera.eye() - camera.target());
    const double other_distance = glm::length(from.eye() - from.target());
    const bool as_far = from.projection() == Projection::orthographic ||
                        (std::abs(distance - other_distance) <= least_move * std::min(distance, other_distance) &&
                         std::abs(from.near() - camera.near()) <= least_move * std::min(from.near(), camera.near()));
    return as_far && other_size.width == size.width && other_size.height == size.height &&
           from.projection() == camera.projection() && from.shift() == camera.shift() &&
           std::abs(height - other_height) <= near &&
           glm::dot(from.back_world(), camera.back_world()) >= least_cosine &&
           glm::length(from.target() - camera.target()) <= near && same(scene, other);
}

Scene Chosen::scene_to_draw(const Scene& asked) const { return with_settings(asked, choice.settings); }

RendererOptions Chosen::options(const RendererOptions& options) const {
    RendererOptions chosen = options;
    if (choice.settings.precision != Precision::automatic) {
        chosen.precision = choice.settings.precision;
    }
    return chosen;
}

Choice Chosen::choice_for(const std::vector<ErrorShare>& budget, const RendererOptions& options) const {
    Choice drawn = choice;
    const double others = std::sqrt(std::max(0.0, choice.error * choice.error - of_light * of_light));
    drawn.error = std::hypot(others, model_error(budget));
    drawn.error_kept = choice.error_kept && (!options.max_error || drawn.error <= *options.max_error);
    return drawn;
}

Effect Chosen::plan_row(const Choice& chosen, const RendererOptions& options) const {
    const bool error = options.max_error.has_value(), seconds = options.max_seconds.has_value();
    const Settings& settings = chosen.settings;
    Effect row;
    row.name = error && seconds ? "settings for max_error and max_seconds"
               : error          ? "settings for max_error"
                                : "settings for max_seconds";
    row.on = true;
    std::string reason = kind_of(settings) + ", slices " + text_of(settings.slice_spacing, 3) + " apart (default " +
                         text_of(scene.default_slice_spacing(), 3) + "), opacity stop " +
                         std::string(settings.opacity_stop < 1.0 ? text_of(settings.opacity_stop, 3) : "off");
    if (settings.precision == Precision::float64) {
        reason += ", float64";
    }
    reason += ": expected are an error of " + text_of(chosen.error, 3) + " from the converged picture and " +
              text_of(chosen.seconds, 3) + " s";
    std::string looked;
    for (const std::string& kind : chosen.looked_at) {
        looked += (looked.empty() ? "" : ", ") + kind;
    }
    if (error) {
        reason += chosen.error_kept ? "; max_error = " + text_of(*options.max_error, 3) + " is kept"
                                    : "; max_error = " + text_of(*options.max_error, 3) + " is not kept";
    }
    if (seconds) {
        reason += chosen.seconds_kept ? "; max_seconds = " + text_of(*options.max_seconds, 3) + " is kept"
                                      : "; max_seconds = " + text_of(*options.max_seconds, 3) +
                                            " is not kept: nothing that was looked at is faster";
    }
    row.reason = reason + (refined ? "; refined after a check through other pixels" : "") + "; looked at " + looked;
    return row;
}

void Chosen::describe(RenderPlan& plan, const RendererOptions& options) const {
    const Settings& settings = choice.settings;
    const auto say_chosen = [&](EffectId id, bool chosen) {
        for (Effect& effect : plan.effects) {
            if (chosen && effect.on && effect.name == name_of(id)) {
                effect.reason = std::string("chosen for ") + (options.max_error ? "max_error" : "max_seconds");
            }
        }
    };
    say_chosen(EffectId::preintegration, settings.preintegration && !scene.preintegration);
    say_chosen(EffectId::second_order, settings.second_order && !scene.second_order);
    say_chosen(EffectId::slab_sampling, settings.sampling == Sampling::slab && scene.sampling != Sampling::slab);
    plan.effects.push_back(plan_row(choice_for(plan.error_budget, options), options));
}

const Chosen* Renderer::State::choose(const Request& request) {
    if (!options_.max_error && !options_.max_seconds) {
        return nullptr;
    }
    request.scene.validate();
    if (chosen_ && chosen_->serves(request.scene, request.camera, request.size)) {
        const double change = paces_.best(chosen_->backend) / chosen_->pace;
        if (!options_.max_seconds || (change < pace_change && change > 1.0 / pace_change)) {
            return chosen_.get();
        }
    }
    const double pixels = static_cast<double>(request.size.width) * static_cast<double>(request.size.height);
    const bool surface = shows_surfaces(request.scene.mode);
    const double wanted = surface ? surface_pilot_pixels : pilot_pixels;
    const int larger = static_cast<int>(std::sqrt(std::max(1.0, pixels / wanted)));
    Settings start = settings_of(request.scene);
    Freedom freedom = freedom_of(request.scene);
    auto made = std::make_unique<Chosen>(Chosen{request.scene, request.camera, request.size});
    const bool large = !surface && pixels >= excerpted * pilot_pixels;
    Pilots pilots(*this, request, start, larger, large ? Pilots::Part::searched : Pilots::Part::whole);
    const std::vector<Backend> backends = backends_.candidates(options_, false);
    const bool may_be_float64 =
        options_.precision == Precision::automatic &&
        std::find(backends.begin(), backends.end(), backend_that(Ability::exact)) != backends.end();
    if (options_.max_error && may_be_float64 && pilots.arithmetic() > arithmetic_share * *options_.max_error) {
        start.precision = Precision::float64;
    }
    pilots.find_pace();
    const bool lit =
        (!request.scene.lights.empty() || request.scene.gradient_opacity) && request.scene.gradient == Gradient::sheets;
    const bool smoothed = lit && !pilots.of_excerpts();
    const double aim = surface ? surface_aim : smoothed ? lit_aim : flat_aim;
    const double most_found = surface ? surface_found : smoothed ? lit_found : flat_found;
    made->choice = choose_settings(start, freedom, {options_.max_error, options_.max_seconds, aim}, pilots);
    made->pace = pilots.pace();
    if (options_.max_error && made->choice.error_kept && freedom.spacing && larger > 2) {
        Choice& choice = made->choice;
        Pilots check(*this, request, start, std::max(2, static_cast<int>(std::floor(check_pixels * larger))),
                     large ? Pilots::Part::checked : Pilots::Part::whole);
        for (int n = 0;; ++n) {
            const double found = check.error(choice.settings).value_or(choice.error);
            choice.error = n == 0 ? std::max(choice.error, found) : found;
            if (found <= most_found * *options_.max_error || n == most_corrections) {
                break;
            }
            choice.settings.slice_spacing *=
                std::min(0.95, std::pow(aim * *options_.max_error / found, 1.0 / refining_order));
            choice.seconds = pilots.seconds(choice.settings);
            made->refined = true;
        }
        choice.seconds_kept = !options_.max_seconds || choice.seconds <= *options_.max_seconds;
    }
    made->of_light = pilots.of_model(made->choice.settings);
    made->backend = pilots.backend();
    chosen_ = std::move(made);
    return chosen_.get();
}

RenderPlan Renderer::State::plan_chosen(const Request& request) {
    const Chosen* chosen = choose(request);
    if (chosen == nullptr) {
        RenderPlan plan = prepare(request).plan.summary;
        measure_light(request, plan);
        return plan;
    }
    const Scene scene = chosen->scene_to_draw(request.scene);
    const RendererOptions options = chosen->options(options_);
    const Request drawn = request.with(scene).with(options);
    RenderPlan plan = prepare(drawn).plan.summary;
    measure_light(drawn, plan);
    chosen->describe(plan, options_);
    return plan;
}

Image Renderer::State::render_chosen(const Request& request) {
    const Chosen* chosen = choose(request);
    if (chosen == nullptr) {
        Image image = render(request);
        RenderPlan plan = *image.plan;
        image.stats["light_measured"] = measure_light(request, plan) ? 1.0 : 0.0;
        image.plan = std::make_shared<const RenderPlan>(std::move(plan));
        return image;
    }
    const Scene scene = chosen->scene_to_draw(request.scene);
    const RendererOptions options = chosen->options(options_);
    const Request drawn = request.with(scene).with(options);
    Image image = render(drawn);
    RenderPlan plan = *image.plan;
    image.stats["light_measured"] = measure_light(drawn, plan) ? 1.0 : 0.0;
    chosen->describe(plan, options_);
    const Choice choice = chosen->choice_for(plan.error_budget, options_);
    image.plan = std::make_shared<const RenderPlan>(std::move(plan));
    image.settings = choice.settings;
    image.stats["estimated_rmse"] = choice.error;
    image.stats["expected_seconds"] = choice.seconds;
    image.stats["max_error_kept"] = choice.error_kept ? 1.0 : 0.0;
    image.stats["max_seconds_kept"] = choice.seconds_kept ? 1.0 : 0.0;
    return image;
}

} // namespace sheetsplat

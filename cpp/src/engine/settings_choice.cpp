// max_error and max_seconds: settings are tried in pilots, pictures of few pixels, before the picture is drawn.
#include "settings_choice.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <memory>
#include <utility>

#include <glm/geometric.hpp>

#include "base/unusable.hpp"
#include "coarse_view.hpp"
#include "error_estimate.hpp"
#include "renderer_state.hpp"
#include "sheetsplat/error.hpp"

namespace sheetsplat {

namespace {

/// Pixels of a pilot, at least: errors over so few were seen within some percent of those over all. Those of surfaces
/// are at few pixels, on their edges, so nearly all pictures are pilots of themselves.
constexpr double pilot_pixels = 64.0 * 64.0;
constexpr double surface_pilot_pixels = 1024.0 * 1024.0;
/// Slice distances of the picture that a pilot is compared with, in those of the pilot; rounded down to powers of two.
/// Where slices are close already, errors fall as they should, and less has to be drawn.
constexpr double converged = 0.25;
constexpr double converged_close = 0.5;
constexpr double close_spacing = 0.3;
/// What the distance to such a picture is of the distance to the converged one.
constexpr double converged_share = 0.92;
constexpr double converged_close_share = 0.8;
/// Errors that are asked for, from which on the picture that a pilot is compared with may be in float32.
constexpr double plain_reference = 3e-5;
/// Of the error that is asked for, what float32 may have before float64 is taken.
constexpr double arithmetic_share = 0.3;
/// A check looks through pixels of this share of a pilot's width.
constexpr double check_pixels = 0.75;
constexpr int most_mendings = 3;
/// Of the error that is asked for, what is aimed at, and what a check may find. Light sees differences between pixels,
/// which larger pixels smooth.
constexpr double flat_aim = 0.85;
constexpr double flat_found = 0.93;
constexpr double lit_aim = 0.72;
constexpr double lit_found = 0.8;
constexpr double surface_aim = 0.5;
constexpr double surface_found = 0.6;
constexpr double mending_order = 1.5;
constexpr int timed_pilots = 3;
constexpr double usual_opacity_stop = 0.98;
constexpr double least_turn_cosine = 0.9848; ///< of 10 degrees
constexpr double least_move = 0.125;         ///< of the height of the view
/// Times that pictures take, over those that they were expected to take: another choice is due beyond.
constexpr double pace_change = 1.25;

bool same(const Clip& a, const Clip& b) {
    const std::vector<Clip::Plane> first = a.half_spaces(), second = b.half_spaces();
    return std::equal(first.begin(), first.end(), second.begin(), second.end(),
                      [](const Clip::Plane& one, const Clip::Plane& other) {
                          return one.normal == other.normal && one.offset == other.offset;
                      });
}

bool same(const TransferFunction& a, const TransferFunction& b) {
    return std::equal(a.points().begin(), a.points().end(), b.points().begin(), b.points().end(),
                      [](const TransferPoint& one, const TransferPoint& other) {
                          return one.value == other.value && one.color == other.color && one.opacity == other.opacity;
                      });
}

bool same(const Light& a, const Light& b) {
    return a.direction == b.direction && a.color == b.color && a.space == b.space;
}

bool same(const Material& a, const Material& b) {
    return a.ambient == b.ambient && a.diffuse == b.diffuse && a.specular == b.specular && a.shininess == b.shininess &&
           a.two_sided == b.two_sided;
}

bool same(const std::optional<DepthCue>& a, const std::optional<DepthCue>& b) {
    return a.has_value() == b.has_value() &&
           (!a || (a->start == b->start && a->end == b->end && a->color == b->color && a->strength == b->strength));
}

bool same(const std::optional<AmbientOcclusion>& a, const std::optional<AmbientOcclusion>& b) {
    return a.has_value() == b.has_value() && (!a || (a->radius == b->radius && a->strength == b->strength));
}

bool same(const Scene& a, const Scene& b) {
    return a.fields == b.fields && same(a.transfer_function, b.transfer_function) &&
           a.slice_spacing == b.slice_spacing && a.sampling == b.sampling && a.reference_length == b.reference_length &&
           a.mode == b.mode && a.iso_value == b.iso_value &&
           std::equal(a.lights.begin(), a.lights.end(), b.lights.begin(), b.lights.end(),
                      [](const Light& one, const Light& other) { return same(one, other); }) &&
           same(a.material, b.material) && a.opacity_stop == b.opacity_stop && a.preintegration == b.preintegration &&
           a.second_order == b.second_order && a.filter == b.filter && a.gradient == b.gradient &&
           same(a.clip, b.clip) && a.gradient_opacity == b.gradient_opacity && same(a.depth_cue, b.depth_cue) &&
           a.shadows == b.shadows && same(a.ambient_occlusion, b.ambient_occlusion) && a.background == b.background;
}

double view_height(const Camera& camera) {
    return camera.projection() == Projection::orthographic
               ? camera.height()
               : 2.0 * camera.half_height() * glm::length(camera.eye() - camera.target());
}

double rmse(const Image& picture, const Image& reference) {
    return picture.rgba.empty() ? compare(picture.scalar, reference.scalar, 1).rmse
                                : compare(picture.rgba, reference.rgba, 4).rmse;
}

Settings settings_of(const Scene& scene) {
    return {scene.slice_distance(), scene.sampling,     scene.preintegration,
            scene.second_order,     scene.opacity_stop, Precision::automatic};
}

/// What is at its default is chosen, what is not is the caller's.
Freedom freedom_of(const Scene& scene) {
    Freedom free;
    free.spacing = !scene.slice_spacing.has_value();
    free.preintegration = scene.mode == Mode::composite && !scene.preintegration;
    free.sampling = scene.sampling == Sampling::point;
    free.stop = scene.mode == Mode::composite && scene.opacity_stop == usual_opacity_stop;
    return free;
}

} // namespace

void check_goals(const RendererOptions& options) {
    if (options.max_error) {
        const double error = *options.max_error;
        if (!(error > 0.0) || !std::isfinite(error)) {
            throw InvalidInput(Complaint{unusable("Renderer", "max_error"), short_number(error),
                                         "a finite root mean square error above 0",
                                         "leave it out, or pass " + option_ref("max_error", "1e-3")});
        }
        if (error < least_max_error) {
            throw InvalidInput(
                Complaint{unusable("Renderer", "max_error"), short_number(error),
                          "at least " + short_number(least_max_error) + ", the resolution of pictures in float32",
                          "allow a larger error"});
        }
    }
    if (options.max_seconds && (!(*options.max_seconds > 0.0) || !std::isfinite(*options.max_seconds))) {
        throw InvalidInput(Complaint{unusable("Renderer", "max_seconds"), short_number(*options.max_seconds),
                                     "a finite number of seconds above 0",
                                     "leave it out, or pass " + option_ref("max_seconds", "0.1")});
    }
}

bool Chosen::serves(const Scene& other, const Camera& from, Size other_size) const {
    const double height = view_height(camera), other_height = view_height(from);
    const double near = least_move * std::min(height, other_height);
    // Perspective: what is near the eye grows as it comes closer, though what is at the target does not.
    const double distance = glm::length(camera.eye() - camera.target());
    const double other_distance = glm::length(from.eye() - from.target());
    const bool as_far = from.projection() == Projection::orthographic ||
                        (std::abs(distance - other_distance) <= least_move * std::min(distance, other_distance) &&
                         std::abs(from.near() - camera.near()) <= least_move * std::min(from.near(), camera.near()));
    return as_far && other_size.width == size.width && other_size.height == size.height &&
           from.projection() == camera.projection() && std::abs(height - other_height) <= near &&
           glm::dot(from.back_world(), camera.back_world()) >= least_turn_cosine &&
           glm::length(from.target() - camera.target()) <= near && same(scene, other);
}

Effect Chosen::told(const RendererOptions& options) const {
    const bool error = options.max_error.has_value(), seconds = options.max_seconds.has_value();
    const Settings& settings = choice.settings;
    Effect row;
    row.name = error && seconds ? "settings for max_error and max_seconds"
               : error          ? "settings for max_error"
                                : "settings for max_seconds";
    row.on = true;
    std::string reason = kind_of(settings) + ", slices " + short_number(settings.slice_spacing) + " apart (default " +
                         short_number(scene.default_slice_spacing()) + "), opacity stop " +
                         std::string(settings.opacity_stop < 1.0 ? short_number(settings.opacity_stop) : "off");
    if (settings.precision == Precision::float64) {
        reason += ", float64";
    }
    reason += ": expected are an error of " + short_number(choice.error) + " from the converged picture and " +
              short_number(choice.seconds) + " s";
    std::string looked;
    for (const std::string& kind : choice.looked_at) {
        looked += (looked.empty() ? "" : ", ") + kind;
    }
    if (error) {
        reason += choice.error_kept ? "; max_error = " + short_number(*options.max_error) + " is kept"
                                    : "; max_error = " + short_number(*options.max_error) + " is not kept";
    }
    if (seconds) {
        reason += choice.seconds_kept ? "; max_seconds = " + short_number(*options.max_seconds) + " is kept"
                                      : "; max_seconds = " + short_number(*options.max_seconds) +
                                            " is not kept: nothing that was looked at is faster";
    }
    row.reason = reason + (mended ? "; refined after a check through other pixels" : "") + "; looked at " + looked;
    return row;
}

void Chosen::tell(RenderPlan& plan, const RendererOptions& options) const {
    const Settings& settings = choice.settings;
    const std::string asked = "asked for", goal = options.max_error ? "max_error" : "max_seconds";
    for (Effect& effect : plan.effects) {
        const bool chosen =
            (effect.name == "preintegration" && settings.preintegration && !scene.preintegration) ||
            (effect.name == "second_order" && settings.second_order && !scene.second_order) ||
            (effect.name == "slab_sampling" && settings.sampling == Sampling::slab && scene.sampling != Sampling::slab);
        if (chosen && effect.reason.compare(0, asked.size(), asked) == 0) {
            effect.reason.replace(0, asked.size(), "chosen for " + goal);
        }
    }
    plan.effects.push_back(told(options));
}

/// Draws pilots of a view with a renderer's state.
class Renderer::State::Pilots : public Judge {
  public:
    Pilots(State& state, const Request& request, const Settings& start, int larger)
        : state_(state), request_(request), start_(start), size_(coarse_size(request.size, larger)),
          camera_(coarse_camera(request.camera, request.size, larger)),
          watch_([this](double) { return !request_.progress || request_.progress(0.0); }) {
        const Prepared prepared = state_.prepare(
            {with_settings(request.scene, start), request.camera, request.size, no_outputs_, request.progress});
        backend_ = prepared.plan.summary.backend;
        projection_ = request.camera.projection();
        work_ = prepared.work;
        precision_ = prepared.plan.precision;
        // Of all pilots, the one that kernels reach furthest into.
        widest_ = prepared.frame;
        widest_.slice_spacing *= coarsest_spacing;
        widest_.pixel *= larger;
    }

    std::optional<double> error(const Settings& settings) override {
        try {
            const Image picture = draw(settings, false);
            const double spacing = settings.slice_spacing / start_.slice_spacing;
            const Image& reference = converged_for(spacing);
            const bool far = reference_spacing_ <= converged * spacing * (1.0 + 1e-9);
            const double distance = rmse(picture, reference) / (far ? converged_share : converged_close_share);
            return std::hypot(distance, of_model(settings));
        } catch (const Unsupported&) {
        } catch (const InvalidInput&) {}
        return std::nullopt;
    }

    double stop_error(const Settings& settings) override {
        if (request_.scene.mode != Mode::composite || settings.opacity_stop >= 1.0) {
            return 0.0;
        }
        Settings unstopped = settings;
        unstopped.opacity_stop = 1.0;
        return rmse(draw(settings, false), draw(unstopped, false));
    }

    double seconds(const Settings& settings) override {
        Work work = work_;
        const bool precise = settings.precision == Precision::float64 || precision_ == Precision::float64;
        set_prices(work, with_settings(request_.scene, settings), projection_, precise);
        return pace_ * expected_seconds(work, 1.0, settings.slice_spacing / start_.slice_spacing, state_.threads());
    }

    Floor floor() override {
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

    /// What the renderer's own numbers differ by from float64; 0 where that cannot be had.
    double arithmetic() {
        if (precision_ == Precision::float64) {
            return 0.0;
        }
        try {
            return rmse(draw(start_, false), draw(start_, true));
        } catch (const Unsupported&) {
            return 0.0;
        }
    }

    /// Times pilots, where no picture was timed yet.
    void find_pace() {
        for (int n = 0; n < timed_pilots && !state_.timed_[static_cast<std::size_t>(backend_)][0]; ++n) {
            draw(start_, false);
        }
        pace_ = state_.best_pace(backend_);
    }
    [[nodiscard]] double pace() const { return pace_; }
    [[nodiscard]] Backend backend() const { return backend_; }

  private:
    [[nodiscard]] bool pre_integrated() const { return request_.scene.mode == Mode::composite; }

    /// What shares of light looked up in volumes are expected to differ by: pilots and what they are compared with both
    /// have them.
    double of_model(const Settings& settings) {
        const Scene& scene = request_.scene;
        if ((!scene.shadows && !scene.ambient_occlusion) || backend_ == Backend::reference) {
            return 0.0;
        }
        const double spacing = settings.slice_spacing;
        const auto known = of_model_.find(spacing);
        if (known != of_model_.end()) {
            return known->second;
        }
        const Prepared prepared =
            state_.prepare({with_settings(scene, settings), request_.camera, request_.size, no_outputs_, watch_});
        return of_model_[spacing] = model_error(prepared.plan.summary.error_budget);
    }

    Image draw(const Settings& settings, bool exact) {
        // One thread that does everything in float64 would take minutes to say what vectors say as well.
        const bool slow = backend_ == Backend::reference;
        RendererOptions options = exact || slow ? state_.exact_options() : state_.options_;
        if (settings.precision != Precision::automatic) {
            options.precision = settings.precision;
        }
        return state_.render_with(
            options, {with_settings(request_.scene, settings), camera_, size_, no_outputs_, watch_}, &widest_);
    }

    const Image& converged_for(double spacing) {
        const double share = spacing < close_spacing ? converged_close : converged;
        const double wanted = std::exp2(std::floor(std::log2(share * spacing) + 1e-9));
        if (!reference_ || wanted < reference_spacing_) {
            Settings settings = start_;
            settings.slice_spacing = start_.slice_spacing * wanted;
            settings.opacity_stop = 1.0;
            settings.sampling = Sampling::point;
            settings.preintegration = pre_integrated();
            settings.second_order = false;
            Image drawn;
            try {
                const bool plain = state_.options_.precision == Precision::automatic &&
                                   state_.options_.max_error.value_or(plain_reference) >= plain_reference;
                drawn = draw(settings, !plain);
            } catch (const Unsupported&) {
                drawn = draw(settings, false);
            }
            reference_ = std::move(drawn);
            reference_spacing_ = wanted;
        }
        return *reference_;
    }

    State& state_;
    const Request& request_;
    Settings start_;
    Size size_;
    Camera camera_;
    Progress watch_;
    Outputs no_outputs_;
    Frame widest_;
    Work work_;
    Backend backend_ = Backend::cpu;
    Projection projection_ = Projection::orthographic;
    Precision precision_ = Precision::float32;
    double pace_ = 1.0;
    std::optional<Image> reference_;
    double reference_spacing_ = 1.0;
    std::map<double, double> of_model_; ///< by slice distance
};

RendererOptions Renderer::State::exact_options() const {
    RendererOptions options;
    options.backend = Backend::cpu;
    options.precision = Precision::float64;
    options.allow_inexact = true;
    options.threads = options_.threads;
    return options;
}

RendererOptions Renderer::State::options_for(const Settings& settings) const {
    RendererOptions options = options_;
    if (settings.precision != Precision::automatic) {
        options.precision = settings.precision;
    }
    return options;
}

Image Renderer::State::render_with(const RendererOptions& options, const Request& request, const Frame* drawn_like) {
    return with_options(options, [&] { return render(request, drawn_like); });
}

double Renderer::State::best_pace(Backend backend) const {
    const auto at = static_cast<std::size_t>(backend);
    const std::size_t coarse = timed_[at][0] || !timed_[at][1] ? 0 : 1;
    if (!timed_[at][coarse]) {
        return paces_[at][coarse];
    }
    // Other work on the machine only ever makes pictures slower.
    return *std::min_element(recent_paces_[at][coarse].begin(), recent_paces_[at][coarse].end());
}

const Chosen* Renderer::State::choose(const Request& request) {
    if (!options_.max_error && !options_.max_seconds) {
        return nullptr;
    }
    request.scene.validate();
    if (chosen_ && chosen_->serves(request.scene, request.camera, request.size)) {
        const double change = best_pace(chosen_backend_) / chosen_->pace;
        if (!options_.max_seconds || (change < pace_change && change > 1.0 / pace_change)) {
            return chosen_.get();
        }
    }
    const double pixels = static_cast<double>(request.size.width) * static_cast<double>(request.size.height);
    const bool surface = request.scene.mode == Mode::isosurface;
    const double wanted = surface ? surface_pilot_pixels : pilot_pixels;
    const int larger = static_cast<int>(std::sqrt(std::max(1.0, pixels / wanted)));
    Settings start = settings_of(request.scene);
    Freedom freedom = freedom_of(request.scene);
    auto made = std::make_unique<Chosen>(Chosen{request.scene, request.camera, request.size, 1.0, Choice{}, false});
    Pilots pilots(*this, request, start, larger);
    const std::vector<Backend> backends = candidates();
    const bool may_be_float64 = options_.precision == Precision::automatic &&
                                std::find(backends.begin(), backends.end(), Backend::cpu) != backends.end();
    if (options_.max_error && may_be_float64 && pilots.arithmetic() > arithmetic_share * *options_.max_error) {
        start.precision = Precision::float64;
    }
    pilots.find_pace();
    const bool lit =
        (!request.scene.lights.empty() || request.scene.gradient_opacity) && request.scene.gradient == Gradient::sheets;
    const double aim = surface ? surface_aim : lit ? lit_aim : flat_aim;
    const double most_found = surface ? surface_found : lit ? lit_found : flat_found;
    made->choice = choose_settings(start, freedom, {options_.max_error, options_.max_seconds, aim}, pilots);
    made->pace = pilots.pace();
    if (options_.max_error && made->choice.error_kept && freedom.spacing && larger > 2) {
        Choice& choice = made->choice;
        Pilots check(*this, request, start, std::max(2, static_cast<int>(std::floor(check_pixels * larger))));
        for (int n = 0; n < most_mendings; ++n) {
            const double found = check.error(choice.settings).value_or(choice.error);
            choice.error = n == 0 ? std::max(choice.error, found) : found;
            if (found <= most_found * *options_.max_error) {
                break;
            }
            choice.settings.slice_spacing *=
                std::min(0.95, std::pow(aim * *options_.max_error / found, 1.0 / mending_order));
            choice.seconds = pilots.seconds(choice.settings);
            made->mended = true;
        }
        choice.seconds_kept = !options_.max_seconds || choice.seconds <= *options_.max_seconds;
    }
    chosen_backend_ = pilots.backend();
    chosen_ = std::move(made);
    return chosen_.get();
}

RenderPlan Renderer::State::plan_chosen(const Request& request) {
    const Chosen* chosen = choose(request);
    if (chosen == nullptr) {
        return prepare(request).plan.summary;
    }
    const Scene scene = with_settings(request.scene, chosen->choice.settings);
    RenderPlan plan = with_options(options_for(chosen->choice.settings), [&] {
        return prepare({scene, request.camera, request.size, request.outputs, request.progress}).plan.summary;
    });
    chosen->tell(plan, options_);
    return plan;
}

Image Renderer::State::render_chosen(const Request& request) {
    const Chosen* chosen = choose(request);
    if (chosen == nullptr) {
        return render(request);
    }
    const Scene scene = with_settings(request.scene, chosen->choice.settings);
    Image image = render_with(options_for(chosen->choice.settings),
                              {scene, request.camera, request.size, request.outputs, request.progress});
    RenderPlan plan = *image.plan;
    chosen->tell(plan, options_);
    image.plan = std::make_shared<const RenderPlan>(std::move(plan));
    image.settings = chosen->choice.settings;
    image.stats["estimated_rmse"] = chosen->choice.error;
    image.stats["expected_seconds"] = chosen->choice.seconds;
    image.stats["max_error_kept"] = chosen->choice.error_kept ? 1.0 : 0.0;
    image.stats["max_seconds_kept"] = chosen->choice.seconds_kept ? 1.0 : 0.0;
    return image;
}

} // namespace sheetsplat

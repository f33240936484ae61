#include "pilots.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "backend_cpu/tile_feed.hpp"
#include "coarse_view.hpp"
#include "error_estimate.hpp"
#include "scene/mode_rules.hpp"
#include "sheetsplat/error.hpp"
#include "spread.hpp"

namespace sheetsplat {

namespace {

/// Slice distances of the picture that a pilot is compared with, in those of the pilot; rounded down to powers of two.
/// Where slices are close already, errors fall as they should, and less has to be drawn.
constexpr double converged = 0.25;
constexpr double converged_close = 0.5;
constexpr double close_spacing = 0.3;
/// Distance to such a picture over that to the converged one.
constexpr double converged_share = 0.92;
constexpr double converged_close_share = 0.8;
/// Requested errors from which on the picture that a pilot is compared with may be in float32.
constexpr double plain_reference = 3e-5;
constexpr int timed_pilots = 3;
/// Edge of a tile of an excerpt, pixels, and how many of a picture's tiles it has: enough that its error is the
/// picture's within some 20 %, few enough that it takes a small share of the picture's time.
constexpr int excerpt_edge = 16;
constexpr std::size_t least_tiles = 20, most_tiles = 64, tiles_of_picture = 16;
/// Pixels of pictures that excerpts are taken of: larger ones are drawn with larger pixels.
constexpr double most_excerpted = 1024.0 * 1024.0;

/// Every so many-th tile of a picture, spread evenly; for a check others, half as many.
Excerpt excerpt_of(Size size, bool checked) {
    const backend_cpu::TileLayout layout(size, excerpt_edge);
    const std::size_t all = layout.tiles();
    const std::size_t wanted = std::min(std::clamp(all / tiles_of_picture, least_tiles, most_tiles), all / 2);
    std::vector<std::uint8_t> passed(all, 0);
    Excerpt excerpt{excerpt_edge, std::vector<std::uint8_t>(all, 0), 0.0, 0};
    for (std::size_t number = 0, taken = 0; excerpt.tiles < (checked ? wanted / 2 : wanted); ++number) {
        const auto [column, row] = spread(number, {layout.columns(), layout.rows()});
        const std::size_t tile = static_cast<std::size_t>(row) * static_cast<std::size_t>(layout.columns()) +
                                 static_cast<std::size_t>(column);
        if (passed[tile] != 0) {
            continue;
        }
        passed[tile] = 1;
        if (!checked || taken >= wanted) {
            const backend_cpu::TileShape shape = layout.shape(tile);
            excerpt.drawn[tile] = 1;
            excerpt.pixels += static_cast<double>(shape.width) * shape.height;
            ++excerpt.tiles;
        }
        ++taken;
    }
    return excerpt;
}

/// Sum of squared differences over the pixels of a tile.
double squares_in(const backend_cpu::TileShape& shape, int width, int channels, const std::vector<float>& picture,
                  const std::vector<float>& reference) {
    double sum = 0.0;
    for (int y = shape.y; y < shape.y + shape.height; ++y) {
        const std::size_t start = static_cast<std::size_t>(y) * static_cast<std::size_t>(width);
        const auto first = (start + static_cast<std::size_t>(shape.x)) * static_cast<std::size_t>(channels);
        const auto count = static_cast<std::size_t>(shape.width) * static_cast<std::size_t>(channels);
        for (std::size_t n = first; n < first + count; ++n) {
            const double off = static_cast<double>(picture[n]) - static_cast<double>(reference[n]);
            sum += std::isnan(off) ? 0.0 : off * off;
        }
    }
    return sum;
}

double rmse(const Image& picture, const Image& reference) {
    return picture.rgba.empty() ? compare(picture.scalar, reference.scalar, 1, Gaps::left_out).rmse
                                : compare(picture.rgba, reference.rgba, 4).rmse;
}

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
        excerpt_ = excerpt_of(size_, part == Part::checked);
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
        const bool far = reference_spacing_ <= converged * spacing * (1.0 + 1e-9);
        const double found = distance(picture, reference) / (far ? converged_share : converged_close_share);
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
    return distance(draw(settings, false), draw(unstopped, false));
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
        return distance(draw(start_, false), draw(start_, true));
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

double Renderer::State::Pilots::distance(const Image& picture, const Image& reference) const {
    if (!excerpt_) {
        return rmse(picture, reference);
    }
    const bool scalar = picture.rgba.empty();
    const int channels = scalar ? 1 : 4;
    const backend_cpu::TileLayout layout(size_, excerpt_edge);
    double sum = 0.0, squares = 0.0;
    for (std::size_t tile = 0; tile < layout.tiles(); ++tile) {
        if (excerpt_->drawn[tile] == 0) {
            continue;
        }
        const backend_cpu::TileShape shape = layout.shape(tile);
        const double own = squares_in(shape, size_.width, channels, scalar ? picture.scalar : picture.rgba,
                                      scalar ? reference.scalar : reference.rgba) /
                           (static_cast<double>(channels) * shape.width * shape.height);
        sum += own;
        squares += own * own;
    }
    const auto tiles = static_cast<double>(excerpt_->tiles);
    const double mean = sum / tiles;
    const double variance = std::max(0.0, squares / tiles - mean * mean) / std::max(tiles - 1.0, 1.0);
    return std::sqrt(mean + std::sqrt(variance));
}

Image Renderer::State::Pilots::draw(const Settings& settings, bool exact) {
    RendererOptions options = exact || slow() ? exact_options(request_.options) : request_.options;
    if (settings.precision != Precision::automatic) {
        options.precision = settings.precision;
    }
    return state_.render({with_settings(scene_, settings), camera_, size_, no_outputs_, watch_, options,
                          excerpt_ ? &*excerpt_ : nullptr},
                         &widest_);
}

const Image& Renderer::State::Pilots::converged_for(double spacing) {
    const double share = spacing < close_spacing ? converged_close : converged;
    const double wanted = std::exp2(std::floor(std::log2(share * spacing) + 1e-9));
    if (!reference_ || wanted < reference_spacing_) {
        Settings settings = start_;
        settings.slice_spacing = start_.slice_spacing * wanted;
        settings.opacity_stop = 1.0;
        settings.sampling = Sampling::point;
        settings.preintegration = is_composited(request_.scene.mode);
        settings.second_order = false;
        Image drawn;
        try {
            const bool plain = request_.options.precision == Precision::automatic &&
                               request_.options.max_error.value_or(plain_reference) >= plain_reference;
            drawn = draw(settings, !plain);
        } catch (const Unsupported&) {
            drawn = draw(settings, false);
        }
        reference_ = std::move(drawn);
        reference_spacing_ = wanted;
    }
    return *reference_;
}

} // namespace sheetsplat

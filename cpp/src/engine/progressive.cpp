// Pictures in stages. Coarse stages see the same view through larger pixels, whose grid is centred on the picture's and
// reaches a little beyond it, so that interpolation has neighbours everywhere.
#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <utility>

#include "coarse_view.hpp"
#include "error_estimate.hpp"
#include "renderer_state.hpp"
#include "sheetsplat/error.hpp"

namespace sheetsplat {

namespace {

constexpr int coarsest = 32;
/// In default slice distances, which are half the smallest kernels: wider slices would miss some of them.
constexpr double largest_spacing = 2.0;
/// Slice distances grow with pixels beyond this factor: below it, slices are as close as in the last picture.
constexpr double pixels_before_slices = 4.0;
/// Distances of samples that a pixel spans before a kernel stands for two samples along an axis.
constexpr double samples_a_pixel = 1.0;
/// A stage that takes a larger share of the last one's time is left out: where many small kernels take the time, fewer
/// pixels save little of it.
constexpr double worth_a_stage = 0.5;
/// Share of the first stage's time that is planned with, because expected times are rough.
constexpr double kept_share = 0.7;
/// Orders in the size of pixels by which pictures approach the last one. Sums along rays are as smooth as the kernels:
/// nearly second order. Other pictures have edges and kinks, so an order from the last differences is clamped to the
/// range that was measured.
constexpr double highest_order = 2.0;
constexpr double smooth_order = 1.8;
constexpr double usual_order = 1.0;
constexpr double lowest_order = 0.8;

/// Pixels and slices of a stage, in those of the last picture, and what stands for its fields.
struct Step {
    int pixels = 1;
    double spacing = 1.0;
    Level level{};

    /// What errors grow with. Kernels of blocks blur about as much as the pixels do.
    [[nodiscard]] double blur() const { return level.fewer > 1.0 ? std::sqrt(2.0) * pixels : pixels; }
};

/// A picture on the grid of a step.
struct Coarse {
    Step step;
    Image image;
};

/// One axis of a bilinear interpolation: for each pixel the two neighbours and the weight of the second.
struct Neighbours {
    std::size_t first, second;
    float weight;
};

std::vector<Neighbours> neighbours(int from, int from_step, int to, int to_step) {
    std::vector<Neighbours> result;
    result.reserve(static_cast<std::size_t>(to));
    for (int i = 0; i < to; ++i) {
        const double middle = (i + 0.5 - 0.5 * to) * to_step / from_step + 0.5 * from - 0.5;
        const double at = std::clamp(middle, 0.0, static_cast<double>(from - 1));
        const double first = std::floor(at);
        const auto index = static_cast<std::size_t>(first);
        result.push_back(
            {index, std::min(index + 1, static_cast<std::size_t>(from - 1)), static_cast<float>(at - first)});
    }
    return result;
}

struct Grid {
    Size size{};
    int step = 1;
};

/// gaps: where a neighbour is infinite or no number, the nearest one counts alone.
std::vector<float> interpolated(const std::vector<float>& from, std::size_t channels, const Grid& grid, const Grid& to,
                                bool gaps = false) {
    if (from.empty()) {
        return {};
    }
    const std::vector<Neighbours> columns = neighbours(grid.size.width, grid.step, to.size.width, to.step);
    const std::vector<Neighbours> rows = neighbours(grid.size.height, grid.step, to.size.height, to.step);
    const std::size_t stride = static_cast<std::size_t>(grid.size.width) * channels;
    std::vector<float> result;
    result.reserve(rows.size() * columns.size() * channels);
    for (const Neighbours& row : rows) {
        const float* upper = from.data() + row.first * stride;
        const float* lower = from.data() + row.second * stride;
        for (const Neighbours& column : columns) {
            for (std::size_t c = 0; c < channels; ++c) {
                const std::size_t left = column.first * channels + c, right = column.second * channels + c;
                if (gaps && !(std::isfinite(upper[left]) && std::isfinite(upper[right]) && std::isfinite(lower[left]) &&
                              std::isfinite(lower[right]))) {
                    const float* near = row.weight < 0.5F ? upper : lower;
                    result.push_back(near[column.weight < 0.5F ? left : right]);
                    continue;
                }
                const float above = upper[left] + column.weight * (upper[right] - upper[left]);
                const float below = lower[left] + column.weight * (lower[right] - lower[left]);
                result.push_back(above + row.weight * (below - above));
            }
        }
    }
    return result;
}

/// Distance of two stages, on the grid of the finer one, as section 8 measures it.
double difference_of(const Coarse& coarse, const Coarse& fine, Size full) {
    const Grid from{coarse_size(full, coarse.step.pixels), coarse.step.pixels};
    const Grid to{coarse_size(full, fine.step.pixels), fine.step.pixels};
    Image seen;
    seen.rgba = interpolated(coarse.image.rgba, 4, from, to);
    seen.scalar = interpolated(coarse.image.scalar, 1, from, to, true);
    return distance(seen, fine.image);
}

/// Where differences between stages shrink by the order p, what is left of them between `fine` and the last picture.
double left_over(double difference, const Step& coarse, const Step& fine, double order) {
    const auto power = [&](const Step& step) { return std::pow(step.blur(), order); };
    return difference * (power(fine) - 1.0) / (power(coarse) - power(fine));
}

double spacing_of(int pixels, double most) {
    return std::clamp(pixels / pixels_before_slices, 1.0, std::max(1.0, most));
}

} // namespace

struct Stages::State {
    Renderer::State* renderer;
    Scene asked; ///< as the caller has it
    Scene scene; ///< with what was chosen for max_error or max_seconds
    Camera camera;
    Size size;
    Outputs outputs;
    Frame frame{};               ///< of the last picture
    std::vector<Step> steps{};   ///< of all stages, coarse ones first
    std::optional<Step> ahead{}; ///< drawn before the first stage, to compare it with
    std::size_t next = 0;
    std::optional<Coarse> before{};
    double difference = 0.0; ///< between the last two; 0: not known yet

    void choose_steps(double first_seconds) {
        const Prepared prepared = renderer->prepare({scene, camera, size, outputs, {}, renderer->options()});
        frame = prepared.frame;
        const Backend backend = prepared.plan.summary.backend;
        const int threads = thread_count(renderer->options().threads);
        // Light volumes and extremes of lattices belong to the fields themselves, and are kept for every stage.
        const bool whole = prepared.plan.shadows || prepared.plan.ambient_occlusion || prepared.plan.ray_extremes;
        const double pixel = std::sqrt(frame.smallest_pixel() * frame.largest_pixel());
        const auto step_of = [&](int pixels) {
            Level level = level_of(scene, pixels == 1 ? 0.0 : samples_a_pixel * pixels * pixel, whole);
            const double most = largest_spacing * level.slice_spacing / frame.slice_spacing;
            return Step{pixels, spacing_of(pixels, most), std::move(level)};
        };
        const auto expected = [&](int pixels) {
            const Step step = step_of(pixels);
            return expected_seconds(prepared.work, pixels, step.spacing, threads, step.level.fewer);
        };
        const auto seconds = [&](int pixels) { return renderer->paces().last(backend, pixels > 1) * expected(pixels); };
        const int largest = std::max(size.width, size.height);
        int first = 1;
        if (seconds(1) > first_seconds) {
            first = 2;
            while (first < coarsest && 4 * first < largest &&
                   seconds(first) + seconds(2 * first) > kept_share * first_seconds) {
                first *= 2;
            }
            ahead = step_of(2 * first);
        }
        for (int pixels = first; pixels > 1; pixels /= 2) {
            if (pixels == first || expected(pixels) <= worth_a_stage * expected(1)) {
                steps.push_back(step_of(pixels));
            }
        }
        steps.push_back(Step{});
    }

    Coarse draw(const Step& step, const Progress& progress) {
        const Camera through = coarse_camera(camera, size, step.pixels);
        Scene seen = renderer->at_level(coarse_scene(scene, size, step.pixels), step.level, progress);
        seen.reference_length = frame.reference_length;
        seen.slice_spacing = frame.slice_spacing * step.spacing;
        return {step,
                renderer->render(
                    {seen, through, coarse_size(size, step.pixels), outputs, progress, renderer->options()}, &frame)};
    }

    [[nodiscard]] double order_of(double newer) const {
        if (traits_of(scene.mode).integrates) {
            return smooth_order;
        }
        return difference > 0.0 && newer > 0.0 ? std::clamp(std::log2(difference / newer), lowest_order, highest_order)
                                               : usual_order;
    }

    Image shown(const Coarse& stage, double error) const {
        const Grid from{stage.image.size, stage.step.pixels};
        const Grid to{size, 1};
        Image image;
        image.size = size;
        image.rgba = interpolated(stage.image.rgba, 4, from, to);
        image.scalar = interpolated(stage.image.scalar, 1, from, to, true);
        image.coverage = interpolated(stage.image.coverage, 1, from, to);
        image.depth = interpolated(stage.image.depth, 1, from, to, true);
        image.plan = stage.image.plan;
        image.stats = stage.image.stats;
        image.stats["estimated_rmse"] = error;
        return image;
    }

    Image coarse_stage(const Step& step, const Progress& progress) {
        if (!before && ahead) {
            before = draw(*ahead, progress);
        }
        Coarse stage = draw(step, progress);
        const double newer = difference_of(*before, stage, size);
        const double order = order_of(newer);
        Image image = shown(stage, left_over(newer, before->step, step, order));
        difference = newer;
        before = std::move(stage);
        return image;
    }
};

Stages::Stages(Renderer& renderer, const Scene& scene, const Camera& camera, Size size, const Outputs& outputs,
               double first_seconds)
    : state_(new State{renderer.state_.get(), scene, scene, camera, size, outputs}) {
    if (!(first_seconds > 0.0)) {
        throw InvalidInput(Complaint{"the picture cannot be made in stages",
                                     option_ref("first_seconds", std::to_string(first_seconds)), "more than 0",
                                     "leave it out for 0.05", "first_seconds"});
    }
    if (const Chosen* chosen =
            renderer.state_->choose({scene, camera, size, outputs, {}, renderer.state_->options()})) {
        state_->scene = chosen->scene_to_draw(scene);
    }
    state_->choose_steps(first_seconds);
}
Stages::~Stages() = default;
Stages::Stages(Stages&&) noexcept = default;
Stages& Stages::operator=(Stages&&) noexcept = default;

bool Stages::done() const { return state_->next >= state_->steps.size(); }

Image Stages::next(const Progress& progress) {
    if (done()) {
        throw InvalidInput(Complaint{"there is no further stage", "all of them were made",
                                     "a call of done() before next()", "begin new stages"});
    }
    State& state = *state_;
    const bool last = state.next + 1 == state.steps.size();
    Image image;
    if (last) {
        image = state.renderer->render_chosen(
            {state.asked, state.camera, state.size, state.outputs, progress, state.renderer->options()});
        if (!image.settings) {
            image.stats["estimated_rmse"] = image.plan->expected_error();
        }
    } else {
        image = state.coarse_stage(state.steps[state.next], progress);
    }
    ++state.next;
    image.stats["stage"] = static_cast<double>(state.next);
    image.stats["stages"] = static_cast<double>(state.steps.size());
    return image;
}

bool Renderer::render_progressive(const Scene& scene, const Camera& camera, Size size, const Outputs& outputs,
                                  const OnStage& on_stage, const Progress& progress) {
    Stages stages(*this, scene, camera, size, outputs);
    while (!stages.done()) {
        const Image image = stages.next(progress);
        if (!on_stage(image, stages.done()) && !stages.done()) {
            return false;
        }
    }
    return true;
}

} // namespace sheetsplat

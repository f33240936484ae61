#include "sheetsplat/renderer.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "base/clock.hpp"
#include "base/memory.hpp"
#include "base/poll.hpp"
#include "base/unusable.hpp"
#include "error_estimate.hpp"
#include "light/grids.hpp"
#include "light_drawing.hpp"
#include "renderer_state.hpp"
#include "scene/mode_rules.hpp"
#include "sheetsplat/error.hpp"

namespace sheetsplat {

namespace {

constexpr double cosine_of_30_degrees = 0.86602540378443865;

void check_options(const RendererOptions& options) {
    if (options.threads < 0 || options.threads > most_threads) {
        throw InvalidInput(
            Complaint{unusable("Renderer", "threads"), std::to_string(options.threads),
                      "1 to " + std::to_string(most_threads) + ", or 0 for as many as the process may run on"});
    }
    check_goals(options);
}

void check_picture_memory(Size size, const Outputs& outputs) {
    const std::uint64_t pixels =
        checked_product(static_cast<std::uint64_t>(size.width), static_cast<std::uint64_t>(size.height), "the picture");
    const std::uint64_t bytes =
        checked_product(pixels, 16U + (outputs.coverage ? 4U : 0U) + (outputs.depth ? 4U : 0U), "the picture");
    require_memory(bytes,
                   "a picture of " + std::to_string(size.width) + " x " + std::to_string(size.height) + " pixels",
                   "make the picture smaller");
}

void check_finite(const std::vector<float>& sums, const char* advice) {
    for (const float value : sums) {
        // (NaN: no slice of the pixel counts.)
        if (std::isinf(value)) {
            throw Unsupported(Complaint{"the picture cannot be represented in float32", "sums beyond 3.4e38",
                                        "numbers that float32 can represent", advice});
        }
    }
}

TransferFunction with_colors_times(const TransferFunction& function, double factor) {
    std::vector<TransferPoint> points = function.points();
    for (TransferPoint& point : points) {
        point.color *= factor;
    }
    return TransferFunction(std::move(points));
}

/// The same scene without lights for a material that reflects ambient light only: the colours hold its coefficient.
Scene with_ambient_colors(const Scene& scene) {
    Scene drawn = scene;
    drawn.transfer_function = with_colors_times(scene.transfer_function, scene.material.ambient);
    for (Scene::LaterGroup& group : drawn.later_groups) {
        group.transfer_function = with_colors_times(group.transfer_function, scene.material.ambient);
    }
    drawn.lights.clear();
    return drawn;
}

/// The picture of a scene of which nothing can be seen.
void leave_blank(const Request& request, const Prepared& prepared, Image& image) {
    const std::size_t pixels =
        static_cast<std::size_t>(request.size.width) * static_cast<std::size_t>(request.size.height);
    if (is_scalar(request.scene.mode)) {
        const float none = counts_weighted_slices(request.scene.mode) ? std::numeric_limits<float>::quiet_NaN() : 0.0F;
        image.scalar.assign(pixels, none);
    } else {
        image.rgba.assign(4 * pixels, 0.0F);
        for (std::size_t pixel = 0; request.scene.part && request.scene.part->in_front && pixel < pixels; ++pixel) {
            image.rgba[4 * pixel + 3] = (*request.scene.part->in_front)[pixel];
        }
    }
    if (request.outputs.coverage) {
        image.coverage.assign(pixels, 0.0F);
    }
    if (request.outputs.depth) {
        image.depth.assign(pixels, std::numeric_limits<float>::infinity());
    }
    if (prepared.plan.counts) {
        image.counts.assign(pixels, 0.0F);
    }
    for (const char* name : {"seconds_view", "seconds_draw", "bytes_view", "bytes_device", "kernels_drawn"}) {
        image.stats[name] = 0.0;
    }
}

void put_background(std::vector<float>& rgba, const Vec3& background) {
    for (std::size_t pixel = 0; pixel < rgba.size(); pixel += 4) {
        const double behind = 1.0 - static_cast<double>(rgba[pixel + 3]);
        rgba[pixel] = static_cast<float>(static_cast<double>(rgba[pixel]) + behind * background.x);
        rgba[pixel + 1] = static_cast<float>(static_cast<double>(rgba[pixel + 1]) + behind * background.y);
        rgba[pixel + 2] = static_cast<float>(static_cast<double>(rgba[pixel + 2]) + behind * background.z);
        rgba[pixel + 3] = 1.0F;
    }
}

void require_in_front(const Scene& scene, Size size) {
    const std::size_t pixels = static_cast<std::size_t>(size.width) * static_cast<std::size_t>(size.height);
    if (scene.part && scene.part->in_front && scene.part->in_front->size() != pixels) {
        throw InvalidInput(Complaint{"a part cannot be drawn",
                                     std::to_string(scene.part->in_front->size()) + " opacities in front of it",
                                     std::to_string(pixels) + ", one for each pixel", ""});
    }
}

const LightVolumes& light_of_part(const Part& part) {
    if (!part.light) {
        // Light is dimmed by matter that may lie anywhere in the whole.
        throw Unsupported(Complaint{"a part of a whole cannot be drawn with shadows or ambient occlusion",
                                    "no light volumes of the whole", "those that Renderer::light_volumes makes",
                                    "give them, or draw the whole"});
    }
    return *part.light;
}

/// request: of the scene that is drawn.
LitView lit_view(const Request& request, const Prepared& prepared) {
    return {request.scene,
            request.camera,
            request.size,
            prepared.frame,
            prepared.plan,
            request.progress,
            thread_count(request.options.threads)};
}

void require_part(const Scene& scene) {
    if (!scene.part) {
        throw InvalidInput(Complaint{"light of a whole cannot be drawn in parts", "a scene that is no part of a whole",
                                     "a part of a whole", ""});
    }
}

void require_light(const Scene& scene) {
    require_part(scene);
    if (!scene.part->light) {
        throw InvalidInput(
            Complaint{"the light of a part cannot be measured", "no light volumes of the whole", "Part::light", ""});
    }
}

} // namespace

Renderer::State::State(const RendererOptions& options) : options_(options), backends_(options.device) {}
Renderer::State::~State() = default;

Reach Renderer::State::reach() const {
    return [this](const Field& field, const Vec3& from, const Vec3& direction) {
        return index_.reach_along(field, from, direction);
    };
}

Prepared Renderer::State::prepare(const Request& asked) {
    asked.scene.validate();
    if (asked.scene.depth_limit) {
        asked.scene.depth_limit->require_for(asked.size, asked.camera);
    }
    require_in_front(asked.scene, asked.size);
    Prepared prepared{counted_.counted(asked.scene, asked.camera, asked.size, asked.outputs), {}, {}, {}, {}, {}, {}};
    const Request request = asked.with(prepared.scene);
    const Scene& scene = prepared.scene;
    prepared.frame = make_frame(scene, request.camera, request.size, reach());
    check_picture_memory(request.size, request.outputs);
    surveys_.forget_others(kept_fields(asked.scene), scene.part.has_value());
    const ViewFacts facts = view_facts(scene, request.camera, prepared.frame, surveys_);
    prepared.plan = backends_.choose_plan(request, facts);
    prepared.work = work_of(scene, facts);
    set_prices(prepared.work, scene, request.camera.projection(), prepared.plan.precision == Precision::float64);
    for (std::size_t field = 0; field < scene.fields.size(); ++field) {
        const RegularField* regular = as_regular(scene.fields[field].get());
        if (regular != nullptr && keeps_lattices(prepared.plan)) {
            prepared.views.push_back(make_field_view(*regular, request.camera, prepared.frame, scene.sampling,
                                                     prepared.plan.unit_of(field), filter_of(prepared.plan)));
            prepared.view_fields.push_back(field);
        } else {
            prepared.ellipsoid_fields.push_back(field);
        }
    }
    return prepared;
}

std::vector<std::shared_ptr<const Field>> Renderer::State::kept_fields(const Scene& asked) {
    return counted_.keep(levels_.keep(asked));
}

Scene Renderer::State::at_level(Scene scene, const Level& level, const Progress& progress) {
    scene.fields = levels_.of(scene.fields, level, [&progress] { report_progress(progress, 0.0); });
    return scene;
}

Indexed Renderer::State::find_drawn(const Request& asked, const Prepared& prepared, const Frame& drawn_like) {
    index_.forget_others(kept_fields(asked.scene), asked.scene.part.has_value());
    const Scene& scene = prepared.scene;
    Indexed indexed;
    for (const std::size_t field : prepared.view_fields) {
        // Nothing has looked at the samples of a level yet, and what the stage's own frame calls for is found soon.
        const Frame& frame = levels_.made(asked.scene.fields[field]) ? prepared.frame : drawn_like;
        const RunsEntry& entry = index_.runs_of(field, scene, prepared.plan, frame);
        indexed.runs.push_back(&entry);
        indexed.visible += entry.runs.samples();
        indexed.bytes += entry.runs.bytes();
    }
    for (const std::size_t field : prepared.ellipsoid_fields) {
        const GridEntry& entry = index_.grid_of(field, scene, prepared.plan, drawn_like);
        indexed.grids.push_back(&entry);
        indexed.grid_fields.push_back(field);
        indexed.visible += entry.visible_count;
        indexed.bytes += entry.bytes();
    }
    indexed.twins = find_twins(indexed.grids, index_);
    indexed.rests = find_rests(scene, prepared.view_fields, indexed.runs, index_);
    indexed.together = find_together(scene, prepared.view_fields, indexed, index_);
    for (const auto& field : scene.fields) {
        indexed.all += field->size();
    }
    return indexed;
}

void Renderer::State::draw(const Request& asked, const Prepared& prepared, const Frame& drawn_like, Image& image) {
    const bool ambient = prepared.plan.ambient_only && !prepared.scene.lights.empty();
    const Scene ambient_scene =
        ambient ? with_ambient_colors(prepared.scene) : Scene{prepared.scene.fields, prepared.scene.transfer_function};
    const Request request = asked.with(ambient ? ambient_scene : prepared.scene);
    const auto indexing = Clock::now();
    Indexed indexed = find_drawn(asked, prepared, drawn_like);
    image.stats["seconds_index"] = seconds_since(indexing);
    if ((prepared.plan.shadows || prepared.plan.ambient_occlusion) && !prepared.plan.blank) {
        indexed.volumes =
            request.scene.part ? light_of_part(*request.scene.part) : light_volumes(request, prepared, indexed, image);
    }
    if (prepared.plan.blank) {
        leave_blank(request, prepared, image);
    } else {
        const Backend backend = prepared.plan.summary.backend;
        std::vector<float> doubts;
        backends_.painter(backend).draw(request, prepared, indexed, image, doubts);
        if (!can(backend, Ability::exact)) {
            draw_doubtful(asked, prepared, doubts, image);
        }
    }
    if (request.scene.background && !request.scene.part && !is_scalar(request.scene.mode)) {
        put_background(image.rgba, *request.scene.background);
    }
    auto& stats = image.stats;
    stats["kernels_visible"] = static_cast<double>(indexed.visible);
    stats["kernels_culled"] = static_cast<double>(indexed.all - indexed.visible);
    stats["bytes_index"] = static_cast<double>(indexed.bytes);
    stats["bytes"] = stats["bytes_index"] + stats["bytes_view"] + stats["bytes_device"];
}

void Renderer::State::draw_doubtful(const Request& asked, const Prepared& prepared, const std::vector<float>& doubts,
                                    Image& image) {
    const DrawPlan& plan = prepared.plan;
    Excerpt excerpt = doubtful_tiles(plan, asked.size, doubts, image);
    image.stats["tiles_in_float64"] = static_cast<double>(excerpt.tiles);
    if (excerpt.tiles == 0) {
        return;
    }
    RendererOptions options = asked.options;
    options.backend = backend_that(Ability::exact);
    options.packing = Packing::automatic;
    options.tagging = Tagging::automatic;
    options.path = Path::automatic;
    options.precision = Precision::automatic;
    options.effects.clear();
    const Request again{asked.scene, asked.camera, asked.size, asked.outputs, asked.progress, options, &excerpt};
    const Prepared by_cpu = prepare(again);
    Image exact;
    draw(again, by_cpu, by_cpu.frame, exact);
    copy_tiles(exact, excerpt, asked.size, image);
}

LightVolumes Renderer::State::light_volumes(const Request& request, const Prepared& prepared, const Indexed& indexed,
                                            Image& image) {
    std::vector<std::uint64_t> versions;
    for (const RunsEntry* entry : indexed.runs) {
        versions.push_back(entry->version);
    }
    for (const GridEntry* entry : indexed.grids) {
        versions.push_back(entry->version);
    }
    return light_.of(lit_view(request, prepared), std::move(versions), reach(),
                     fill_light(request, prepared, indexed, backends_.processor()), image);
}

LightPlan Renderer::State::plan_light(const Request& request) {
    require_part(request.scene);
    if (request.scene.part->supports.empty()) {
        throw InvalidInput(Complaint{"light of a whole cannot be planned", "no box of all supports of the whole",
                                     "Part::supports", ""});
    }
    const Prepared prepared = prepare(request);
    const DrawPlan& plan = prepared.plan;
    return (plan.shadows || plan.ambient_occlusion) && !plan.blank
               ? make_light_plan(lit_view(request.with(prepared.scene), prepared), reach())
               : LightPlan{};
}

std::vector<LightPiece> Renderer::State::light_pieces(const Request& request, const LightPlan& light) {
    require_part(request.scene);
    const PollScope polling([&request] { report_progress(request.progress, 0.0); });
    const Prepared prepared = prepare(request);
    const Indexed indexed = find_drawn(request, prepared, prepared.frame);
    const Request drawn = request.with(prepared.scene);
    return pieces_of(light, drawn.scene, fill_light(drawn, prepared, indexed, backends_.processor()));
}

std::vector<LightSpot> Renderer::State::light_spots(const Request& request, const std::vector<std::size_t>& numbers) {
    require_light(request.scene);
    const PollScope polling([&request] { report_progress(request.progress, 0.0); });
    const Prepared prepared = prepare(request);
    return prepared.plan.blank ? std::vector<LightSpot>{}
                               : light_probe_.spots(lit_view(request.with(prepared.scene), prepared), numbers);
}

LightLines Renderer::State::light_lines(const Request& request, const std::vector<LightSpot>& spots, std::size_t part) {
    require_light(request.scene);
    const PollScope polling([&request] { report_progress(request.progress, 0.0); });
    const Prepared prepared = prepare(request);
    return light_probe_.lines(lit_view(request.with(prepared.scene), prepared), spots, part);
}

bool Renderer::State::measure_light(const Request& request, RenderPlan& plan, bool anew) {
    // Nothing of the last scene's fields is kept.
    if (measured_ && measured_->view.scene.fields != request.scene.fields) {
        measured_.reset();
        light_probe_ = LightErrorProbe();
    }
    // (Lines to lights pass kernels that a part does not have.)
    if (can(plan.backend, Ability::defines) || request.scene.part ||
        std::none_of(plan.error_budget.begin(), plan.error_budget.end(), is_of_model)) {
        return false;
    }
    // Light that stands still is looked up in the same volumes from everywhere: only what is seen of them changes.
    const bool turns =
        request.scene.shadows && std::any_of(request.scene.lights.begin(), request.scene.lights.end(),
                                             [](const Light& light) { return light.space == LightSpace::eye; });
    const bool known = measured_ && measured_->backend == plan.backend &&
                       measured_->view.serves(request.scene, request.camera, request.size,
                                              turns ? cosine_of_10_degrees : cosine_of_30_degrees);
    if (anew || !known) {
        const Prepared prepared = prepare(request);
        const Request drawn = request.with(prepared.scene);
        if (prepared.plan.blank || (!anew && !LightErrorProbe::is_cheap(lit_view(drawn, prepared)))) {
            return false;
        }
        try {
            Image image;
            const Indexed indexed = find_drawn(request, prepared, prepared.frame);
            const LightVolumes volumes = light_volumes(drawn, prepared, indexed, image);
            // Before the aggregate: where an element of one throws, GCC 12 destroys nested aggregates before it twice.
            LightErrors errors = light_probe_.errors(lit_view(drawn, prepared), volumes, light_.absorption());
            measured_ = std::make_unique<MeasuredLight>(
                MeasuredLight{{request.scene, request.camera, request.size}, plan.backend, std::move(errors)});
        } catch (const OutOfMemory&) {
            // The estimate stands.
            return false;
        }
    }
    state_light_errors(measured_->errors, plan);
    return true;
}

Image Renderer::State::render(const Request& request, const Frame* drawn_like) {
    const auto started = Clock::now();
    // Surveys and indices of millions of kernels take long, so they can be cancelled too.
    const PollScope polling([&request] { report_progress(request.progress, 0.0); });
    const Prepared prepared = prepare(request);
    const Backend backend = prepared.plan.summary.backend;
    Image image;
    image.stats["seconds_plan"] = seconds_since(started);
    const auto drawing = Clock::now();
    if (can(backend, Ability::defines)) {
        std::vector<float> no_doubts;
        backends_.painter(backend).draw(request, prepared, {}, image, no_doubts);
    } else {
        draw(request, prepared, drawn_like != nullptr ? *drawn_like : prepared.frame, image);
        image.size = request.size;
        add_bases(prepared.scene, request.scene, request.camera, image);
        if (request.scene.part && is_extreme(request.scene.mode)) {
            // Whether any slice counts.
            image.counts.resize(image.scalar.size());
            std::transform(image.scalar.begin(), image.scalar.end(), image.counts.begin(),
                           [](float value) { return std::isnan(value) ? 0.0F : 1.0F; });
        }
    }
    if (request.outputs.depth && is_scalar(request.scene.mode)) {
        image.depth.assign(static_cast<std::size_t>(request.size.width) * static_cast<std::size_t>(request.size.height),
                           std::numeric_limits<float>::infinity());
    }
    check_finite(image.scalar, "divide the values by a constant");
    check_finite(image.coverage, "choose a larger unit of length");
    image.size = request.size;
    image.stats["slices"] = static_cast<double>(prepared.frame.slices);
    image.stats["seconds_total"] = seconds_since(started);
    image.plan = std::make_shared<const RenderPlan>(prepared.plan.summary);
    // The index is not counted, because the next picture has it already.
    const double drawn = seconds_since(drawing) - image.stats["seconds_index"];
    double expected = expected_seconds(prepared.work, 1.0, 1.0, thread_count(request.options.threads));
    if (request.excerpt != nullptr) {
        // Kernels reach beyond a tile's edges.
        const double pixels = static_cast<double>(request.size.width) * static_cast<double>(request.size.height);
        const double wider = 1.0 + 2.0 * prepared.work.radius_px / request.excerpt->edge;
        expected *= std::min(1.0, wider * wider * request.excerpt->pixels / pixels);
    }
    paces_.note(backend, drawn_like != nullptr, drawn / expected);
    return image;
}

Renderer::Renderer(const RendererOptions& options) {
    check_options(options);
    state_ = std::make_unique<State>(options);
}
Renderer::~Renderer() = default;
Renderer::Renderer(Renderer&&) noexcept = default;
Renderer& Renderer::operator=(Renderer&&) noexcept = default;

RenderPlan Renderer::plan(const Scene& scene, const Camera& camera, Size size, const Outputs& outputs) {
    return state_->plan_chosen({scene, camera, size, outputs, {}, state_->options()});
}

Image Renderer::render(const Scene& scene, const Camera& camera, Size size, const Outputs& outputs,
                       const Progress& progress) {
    return state_->render_chosen({scene, camera, size, outputs, progress, state_->options()});
}

LightPlan Renderer::plan_light(const Scene& part, const Camera& camera, Size size) {
    const Outputs none;
    const Progress quiet;
    return state_->plan_light({part, camera, size, none, quiet, state_->options()});
}

std::vector<LightPiece> Renderer::light_pieces(const Scene& part, const Camera& camera, Size size,
                                               const LightPlan& light, const Progress& progress) {
    const Outputs none;
    return state_->light_pieces({part, camera, size, none, progress, state_->options()}, light);
}

std::vector<LightSpot> Renderer::light_spots(const Scene& part, const Camera& camera, Size size,
                                             const std::vector<std::size_t>& numbers, const Progress& progress) {
    const Outputs none;
    return state_->light_spots({part, camera, size, none, progress, state_->options()}, numbers);
}

LightLines Renderer::light_lines(const Scene& part, const Camera& camera, Size size,
                                 const std::vector<LightSpot>& spots, std::size_t number, const Progress& progress) {
    const Outputs none;
    return state_->light_lines({part, camera, size, none, progress, state_->options()}, spots, number);
}

LightVolumes Renderer::light_volumes(const LightPlan& light, std::vector<LightVolume> grids,
                                     const Progress& progress) const {
    return light_volumes_of(light, std::move(grids), thread_count(state_->options().threads), progress);
}

} // namespace sheetsplat

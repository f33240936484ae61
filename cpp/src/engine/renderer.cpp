#include "sheetsplat/renderer.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdlib>
#include <limits>
#include <utility>

#include <glm/geometric.hpp>

#include "base/memory.hpp"
#include "index/visible_runs.hpp"
#include "plan/make_plan.hpp"
#include "reference/reference.hpp"
#include "sheet/sheet_renderer.hpp"
#include "sheetsplat/error.hpp"
#include "view/frame.hpp"
#include "view/slab_batches.hpp"

namespace sheetsplat {

namespace {

using Clock = std::chrono::steady_clock;

double seconds_since(Clock::time_point start) { return std::chrono::duration<double>(Clock::now() - start).count(); }

Backend requested_backend(Backend option) {
    if (option != Backend::automatic) {
        return option;
    }
    const char* name = std::getenv("SHEETSPLAT_BACKEND");
    if (name == nullptr || *name == '\0') {
        return option;
    }
    for (const Backend backend : {Backend::automatic, Backend::gl, Backend::cpu, Backend::reference}) {
        if (std::string(name) == to_string(backend)) {
            return backend;
        }
    }
    throw InvalidInput(Complaint{"the backend cannot be chosen", std::string("SHEETSPLAT_BACKEND=") + name,
                                 "auto, gl or reference", "correct or unset the variable"});
}

bool same(const std::vector<TransferPoint>& a, const std::vector<TransferPoint>& b) {
    return std::equal(a.begin(), a.end(), b.begin(), b.end(), [](const TransferPoint& x, const TransferPoint& y) {
        return x.value == y.value && x.color == y.color && x.opacity == y.opacity;
    });
}

/// Which samples of a field are drawn, and what that was decided from.
struct IndexEntry {
    std::shared_ptr<const Field> field;
    std::vector<TransferPoint> points; ///< of the transfer function; none where it was not asked
    VisibilityQuery query;
    VisibleRuns runs;

    [[nodiscard]] bool answers(const std::shared_ptr<const Field>& asked, const VisibilityQuery& other) const {
        const bool functions =
            other.transfer_function == nullptr ? points.empty() : same(points, other.transfer_function->points());
        // A longer reach than was asked for draws more than needed, which is never wrong; twice as long would be a
        // waste.
        const auto reaches = [](double kept, double asked_reach) {
            return kept >= asked_reach && (kept <= 2.0 * asked_reach || kept == asked_reach);
        };
        return field == asked && functions && query.weights_matter == other.weights_matter &&
               reaches(query.stencil_world, other.stencil_world) && query.cull == other.cull &&
               query.isosurface == other.isosurface && query.iso_value == other.iso_value &&
               query.alone == other.alone && reaches(query.slice_spacing, other.slice_spacing);
    }
};

/// Everything that is derived from scene, camera and size before a backend draws.
struct Prepared {
    Frame frame;
    DrawPlan plan;
    std::vector<FieldView> views;
};

void check_size(Size size) {
    if (size.width < 1 || size.height < 1) {
        throw InvalidInput(
            Complaint{"the picture cannot be made",
                      "a size of " + std::to_string(size.width) + " x " + std::to_string(size.height) + " pixels",
                      "at least 1 x 1", "pass size=(width, height)"});
    }
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

double largest_slant(const Camera& camera, Size size) {
    if (camera.projection() == Projection::orthographic) {
        return 1.0;
    }
    const double y = camera.half_height();
    const double x = y * size.width / size.height;
    return std::sqrt(1.0 + x * x + y * y);
}

ViewFacts facts_of(const Scene& scene, const Camera& camera, const Frame& frame) {
    ViewFacts facts;
    facts.size = frame.size;
    facts.first_slice = frame.first_slice;
    facts.slices = frame.slices;
    facts.slice_spacing = frame.slice_spacing;
    facts.reference_length = frame.reference_length;
    facts.smallest_pixel = frame.slices > 0 ? frame.smallest_pixel() : frame.reference_length;
    facts.largest_pixel = frame.largest_pixel();
    facts.largest_slant = largest_slant(camera, frame.size);
    facts.cut_by_near = frame.cut_by_near;
    facts.longest_span = 0;
    facts.widest_slab = 0.0;
    facts.largest_splat_px = 0.0;
    for (const auto& field : scene.fields) {
        const FieldView view = make_field_view(*as_regular(field.get()), camera, frame, scene.sampling, 1.0);
        facts.sheared = facts.sheared || view.sheared;
        facts.longest_span = std::max(facts.longest_span, view.longest_span);
        facts.smallest_falloff = field == scene.fields.front()
                                     ? field->kernel().falloff
                                     : std::min(facts.smallest_falloff, field->kernel().falloff);
        if (frame.slices == 0) {
            continue;
        }
        facts.largest_splat_px = std::max(
            {facts.largest_splat_px, view.extent_x / frame.smallest_pixel(), view.extent_y / frame.smallest_pixel()});
        // |w| ds / h: how far a ray gets through the unit sphere in one slab. Its part along n is ds / h; the smallest
        // semi-axis bounds it all.
        const Vec3 axes = as_regular(field.get())->semi_axes_world();
        const double thinnest = std::min({axes.x, axes.y, axes.z});
        const double along = frame.slice_spacing / view.half_depth;
        const double across = frame.projection == Projection::perspective || view.sheared
                                  ? frame.slice_spacing * facts.largest_slant / thinnest
                                  : along;
        facts.widest_slab = std::max(facts.widest_slab, std::sqrt(field->kernel().falloff) * std::max(along, across));
    }
    return facts;
}

} // namespace

struct Renderer::State {
    RendererOptions options;
    std::unique_ptr<sheet::SheetRenderer> sheets;
    std::string why_no_gl;
    std::vector<IndexEntry> index;

    Backend backend() {
        const Backend asked = requested_backend(options.backend);
        if (asked == Backend::cpu) {
            throw Unsupported(Complaint{"the backend cannot be chosen", "backend cpu",
                                        "auto, gl or reference in this version", "use backend auto"});
        }
        if (asked == Backend::reference) {
            return asked;
        }
        if (!sheets && why_no_gl.empty()) {
            try {
                sheets = std::make_unique<sheet::SheetRenderer>(options.device);
            } catch (const DeviceUnavailable& error) {
                if (asked == Backend::gl) {
                    throw;
                }
                why_no_gl = error.what();
            }
        }
        return sheets ? Backend::gl : Backend::reference;
    }

    Prepared prepare(const Scene& scene, const Camera& camera, Size size, const Outputs& outputs) {
        check_size(size);
        scene.validate();
        check_picture_memory(size, outputs);
        Prepared prepared;
        const Backend chosen = backend();
        prepared.frame = make_frame(scene, camera, size);
        const ViewFacts facts = facts_of(scene, camera, prepared.frame);
        prepared.plan = make_plan(scene, facts, options, outputs, camera.projection(), chosen,
                                  sheets ? &sheets->capabilities() : nullptr);
        if (chosen == Backend::reference && !why_no_gl.empty()) {
            prepared.plan.summary.device += "; no OpenGL: " + why_no_gl;
        }
        for (const auto& field : scene.fields) {
            prepared.views.push_back(
                make_field_view(*as_regular(field.get()), camera, prepared.frame, scene.sampling, prepared.plan.value_unit));
        }
        return prepared;
    }

    const VisibleRuns& runs_of(const std::shared_ptr<const Field>& field, const Scene& scene,
                               const DrawPlan& plan, const Frame& frame, double slant) {
        VisibilityQuery query;
        const bool scalar = plan.mode == Mode::xray || plan.mode == Mode::mip;
        query.transfer_function = scalar ? nullptr : &scene.transfer_function;
        query.weights_matter = plan.weight;
        // Coverage needs every kernel; elsewhere one whose value is 0 adds nothing where weights do not count.
        query.cull = plan.culling && !plan.coverage;
        query.stencil_world = plan.gradient ? std::max(frame.largest_pixel(), frame.slice_spacing * slant) : 0.0;
        query.isosurface = plan.mode == Mode::isosurface;
        query.iso_value = scene.iso_value.value_or(0.0);
        query.alone = scene.fields.size() == 1;
        // Slabs average over a spacing of depth, crossings and intervals reach one further: where both hold, their sum.
        const int reaches =
            (plan.sampling == Sampling::slab ? 1 : 0) + (plan.mode == Mode::isosurface || plan.preintegration ? 1 : 0);
        query.slice_spacing = reaches * frame.slice_spacing * slant;
        query.weights_matter = query.weights_matter || !plan.culling;
        for (const IndexEntry& entry : index) {
            if (entry.answers(field, query)) {
                return entry.runs;
            }
        }
        // One index a field is kept: that of the last scene.
        index.erase(
            std::remove_if(index.begin(), index.end(), [&](const IndexEntry& entry) { return entry.field == field; }),
            index.end());
        IndexEntry entry;
        entry.field = field;
        entry.query = query;
        entry.runs = VisibleRuns::of(*as_regular(field.get()), query);
        if (query.transfer_function != nullptr) {
            entry.points = query.transfer_function->points();
        }
        entry.query.transfer_function = nullptr;
        index.push_back(std::move(entry));
        return index.back().runs;
    }

    void forget_others(const Scene& scene) {
        index.erase(std::remove_if(index.begin(), index.end(),
                                   [&](const IndexEntry& entry) {
                                       return std::find(scene.fields.begin(), scene.fields.end(), entry.field) ==
                                              scene.fields.end();
                                   }),
                    index.end());
    }
};

Renderer::Renderer(const RendererOptions& options) : state_(std::make_unique<State>()) { state_->options = options; }
Renderer::~Renderer() = default;
Renderer::Renderer(Renderer&&) noexcept = default;
Renderer& Renderer::operator=(Renderer&&) noexcept = default;

RenderPlan Renderer::plan(const Scene& scene, const Camera& camera, Size size, const Outputs& outputs) {
    return state_->prepare(scene, camera, size, outputs).plan.summary;
}

namespace {

Image render_by_reference(const Scene& scene, const Camera& camera, Size size, const Outputs& outputs,
                          const Progress& progress) {
    reference::Request request;
    request.coverage = outputs.coverage;
    request.depth = outputs.depth;
    request.progress = progress;
    const reference::Picture picture = reference::render(scene, camera, size, request);
    Image image;
    const auto to_float = [](const std::vector<double>& from) {
        std::vector<float> to(from.size());
        std::transform(from.begin(), from.end(), to.begin(), [](double value) { return static_cast<float>(value); });
        return to;
    };
    image.rgba = to_float(picture.rgba);
    image.scalar = to_float(picture.scalar);
    image.coverage = to_float(picture.coverage);
    image.depth = to_float(picture.depth);
    image.stats["kernels_drawn"] = static_cast<double>(picture.kernels_drawn);
    return image;
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

} // namespace

Image Renderer::render(const Scene& scene, const Camera& camera, Size size, const Outputs& outputs,
                       const Progress& progress) {
    State& state = *state_;
    const auto started = Clock::now();
    const Prepared prepared = state.prepare(scene, camera, size, outputs);
    const bool scalar = scene.mode == Mode::xray || scene.mode == Mode::mip;
    Image image;
    if (prepared.plan.summary.backend == Backend::reference) {
        const auto drawing = Clock::now();
        image = render_by_reference(scene, camera, size, outputs, progress);
        image.stats["seconds_draw"] = seconds_since(drawing);
    } else {
        state.forget_others(scene);
        const auto indexing = Clock::now();
        std::vector<const VisibleRuns*> runs;
        std::size_t visible = 0, all = 0, index_bytes = 0;
        // Two passes, because an index that is made may move those that were made before.
        for (int round = 0; round < 2; ++round) {
            runs.clear();
            for (const auto& field : scene.fields) {
                runs.push_back(
                    &state.runs_of(field, scene, prepared.plan, prepared.frame, largest_slant(camera, size)));
            }
        }
        for (std::size_t field = 0; field < scene.fields.size(); ++field) {
            visible += runs[field]->samples();
            all += scene.fields[field]->size();
            index_bytes += runs[field]->bytes();
        }
        image.stats["seconds_index"] = seconds_since(indexing);

        const auto viewing = Clock::now();
        const BatchLayout layout = sheet::make_layout(prepared.plan);
        std::vector<SlabBatches> batches;
        std::size_t drawn = 0, view_bytes = 0;
        for (std::size_t field = 0; field < scene.fields.size(); ++field) {
            batches.push_back(SlabBatches::of(prepared.views[field], *runs[field], prepared.frame, scene.sampling,
                                              layout, prepared.plan.fine_along ? 1 : 0));
            drawn += batches.back().kernels();
            view_bytes += batches.back().bytes();
        }
        image.stats["seconds_view"] = seconds_since(viewing);

        sheet::Job job;
        job.scene = &scene;
        job.camera = &camera;
        job.frame = &prepared.frame;
        job.plan = &prepared.plan;
        job.views = &prepared.views;
        job.batches = &batches;
        job.layout = layout;
        job.tile_size = state.options.tile_size;
        job.tags_per_clear = state.options.tags_per_clear;
        job.progress = &progress;
        state.sheets->render(job, image);
        for (const float value : image.scalar) {
            if (!std::isfinite(value)) {
                throw Unsupported(Complaint{"the picture cannot be shown in float32", "sums beyond 3.4e38",
                                            "numbers that float32 holds", "divide the values by a constant"});
            }
        }
        if (scene.background && !scalar) {
            put_background(image.rgba, *scene.background);
        }
        image.stats["kernels_drawn"] = static_cast<double>(drawn);
        image.stats["kernels_visible"] = static_cast<double>(visible);
        image.stats["kernels_culled"] = static_cast<double>(all - visible);
        image.stats["bytes_index"] = static_cast<double>(index_bytes);
        image.stats["bytes_view"] = static_cast<double>(view_bytes);
        image.stats["bytes"] = static_cast<double>(index_bytes + view_bytes) + image.stats["bytes_device"];
    }
    image.size = size;
    if (outputs.depth && scalar) {
        image.depth.assign(static_cast<std::size_t>(size.width) * static_cast<std::size_t>(size.height),
                           std::numeric_limits<float>::infinity());
    }
    image.stats["slices"] = static_cast<double>(prepared.frame.slices);
    image.stats["seconds_total"] = seconds_since(started);
    image.plan = std::make_shared<const RenderPlan>(prepared.plan.summary);
    return image;
}

} // namespace sheetsplat

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
#include "view/cell_walk.hpp"
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

/// Scattered kernels with their grid, and which of them are drawn.
struct GridEntry {
    std::shared_ptr<const Field> field;            ///< of the scene
    std::shared_ptr<const EllipsoidField> kernels; ///< the field itself, or a lattice's kernels one by one
    SpatialGrid grid;
    std::unique_ptr<ReachLists> reach; ///< null where kernels begin in their homes
    bool judged = false;
    std::vector<TransferPoint> points; ///< what `visible` was decided from
    EllipsoidVisibility query;
    std::vector<std::uint8_t> visible;

    [[nodiscard]] bool answers(const EllipsoidVisibility& other) const {
        const bool functions =
            other.transfer_function == nullptr ? points.empty() : same(points, other.transfer_function->points());
        return judged && functions && query.weights_matter == other.weights_matter && query.cull == other.cull &&
               query.isosurface == other.isosurface && query.iso_value == other.iso_value &&
               query.alone == other.alone && query.reach_world >= other.reach_world &&
               query.reach_world <= 2.0 * other.reach_world + 1e-300;
    }
    [[nodiscard]] std::size_t bytes() const { return grid.bytes() + (reach ? reach->bytes() : 0) + visible.capacity(); }
};

/// Above, lists of the cells that kernels reach into would take more memory than the kernels.
constexpr std::size_t most_start_cells = 1U << 20;

/// The kernels of a lattice, one by one, for what makes each of them different.
std::shared_ptr<const EllipsoidField> scattered(const RegularField& field) {
    EllipsoidArrays arrays;
    const auto [nk, nj, ni] = field.shape();
    const Vec3 axes = field.semi_axes_world();
    const bool spheres = axes.x == axes.y && axes.y == axes.z;
    require_memory(checked_product(field.size(), spheres ? 40 : 56, "a lattice's kernels, one by one"),
                   "a lattice's kernels, one by one", "drop the filter, or use a smaller volume");
    arrays.centers.reserve(field.size());
    arrays.values.reserve(field.size());
    for (std::size_t k = 0; k < nk; ++k) {
        for (std::size_t j = 0; j < nj; ++j) {
            for (std::size_t i = 0; i < ni; ++i) {
                const double value = field.value(i, j, k);
                if (!std::isnan(value)) {
                    arrays.centers.push_back(field.position(i, j, k));
                    arrays.values.push_back(value);
                }
            }
        }
    }
    if (spheres) {
        arrays.radii.assign(field.size(), axes.x);
    } else {
        arrays.scales.assign(field.size(), axes);
    }
    EllipsoidFieldOptions options;
    options.normalization = field.normalization();
    options.w0 = field.w0();
    options.falloff = field.kernel().falloff;
    if (options.normalization == Normalization::lattice) {
        options.cell_volume = field.kernel().unit_mass() * axes.x * axes.y * axes.z / field.lattice_constant();
    }
    return std::make_shared<const EllipsoidField>(std::move(arrays), options);
}

/// Everything that is derived from scene, camera and size before a backend draws.
struct Prepared {
    Frame frame;
    DrawPlan plan;
    std::vector<FieldView> views;              ///< of the lattices, in the order of the scene's fields
    std::vector<std::size_t> view_fields;      ///< whose they are
    std::vector<std::size_t> ellipsoid_fields; ///< of scattered kernels
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

void add_facts(const RegularField& field, const Scene& scene, const Camera& camera, const Frame& frame,
               ViewFacts& facts) {
    const FieldView view = make_field_view(field, camera, frame, scene.sampling, 1.0);
    facts.sheared = facts.sheared || view.sheared;
    facts.longest_span = std::max(facts.longest_span, view.longest_span);
    const Vec3 axes = field.semi_axes_world();
    const double thinnest = std::min({axes.x, axes.y, axes.z});
    const double coarse = std::max(frame.largest_pixel(), frame.slice_spacing);
    facts.largest_filtering = std::max(facts.largest_filtering, coarse * coarse / (thinnest * thinnest));
    facts.unresolved += 2.0 * thinnest < std::max(frame.smallest_pixel(), frame.slice_spacing) ? field.size() : 0;
    if (frame.slices == 0) {
        return;
    }
    facts.largest_splat_px = std::max(
        {facts.largest_splat_px, view.extent_x / frame.smallest_pixel(), view.extent_y / frame.smallest_pixel()});
    // |w| ds / h: how far a ray gets through the unit sphere in one slab. Its part along n is ds / h; the smallest
    // semi-axis bounds it all.
    const double along = frame.slice_spacing / view.half_depth;
    const double across = frame.projection == Projection::perspective || view.sheared
                              ? frame.slice_spacing * facts.largest_slant / thinnest
                              : along;
    facts.widest_slab = std::max(facts.widest_slab, std::sqrt(field.kernel().falloff) * std::max(along, across));
}

void add_facts(const EllipsoidField& field, const Scene& scene, const Camera& camera, const Frame& frame,
               ViewFacts& facts) {
    const EllipsoidFacts own = survey_ellipsoids(field, camera, frame, scene.sampling);
    facts.ellipsoids = facts.ellipsoids || field.size() > 0;
    facts.longest_span = std::max(facts.longest_span, own.longest_span);
    facts.unresolved += own.unresolved;
    facts.largest_aspect = std::max(facts.largest_aspect, own.largest_aspect);
    facts.most_ellipsoids = std::max(facts.most_ellipsoids, field.size());
    facts.largest_filtering = std::max(facts.largest_filtering, own.largest_change);
    facts.largest_overlap = std::max(facts.largest_overlap, own.mean_overlap);
    facts.largest_weight = std::max(facts.largest_weight, field.weight_range()[1]);
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
    bool first = true;
    facts.largest_overlap = 0.0;
    for (const auto& field : scene.fields) {
        const double falloff = field->kernel().falloff;
        facts.smallest_falloff = first ? falloff : std::min(facts.smallest_falloff, falloff);
        first = false;
        if (const EllipsoidField* ellipsoids = as_ellipsoids(field.get())) {
            add_facts(*ellipsoids, scene, camera, frame, facts);
        } else {
            add_facts(*as_regular(field.get()), scene, camera, frame, facts);
        }
    }
    return facts;
}

} // namespace

struct Renderer::State {
    RendererOptions options;
    std::unique_ptr<sheet::SheetRenderer> sheets;
    std::string why_no_gl;
    std::vector<IndexEntry> index;
    std::vector<std::unique_ptr<GridEntry>> grids;

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
        for (std::size_t field = 0; field < scene.fields.size(); ++field) {
            const RegularField* regular = as_regular(scene.fields[field].get());
            if (regular != nullptr && !prepared.plan.filter) {
                prepared.views.push_back(
                    make_field_view(*regular, camera, prepared.frame, scene.sampling, prepared.plan.value_unit));
                prepared.view_fields.push_back(field);
            } else {
                prepared.ellipsoid_fields.push_back(field);
            }
        }
        return prepared;
    }

    const VisibleRuns& runs_of(const std::shared_ptr<const Field>& field, const Scene& scene, const DrawPlan& plan,
                               const Frame& frame, double slant) {
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

    GridEntry& grid_of(const std::shared_ptr<const Field>& field, const Scene& scene, const DrawPlan& plan,
                       const Frame& frame, double slant) {
        GridEntry* entry = nullptr;
        for (const auto& kept : grids) {
            if (kept->field == field) {
                entry = kept.get();
            }
        }
        if (entry == nullptr) {
            auto made = std::make_unique<GridEntry>();
            made->field = field;
            made->kernels = field->kind() == FieldKind::ellipsoid
                                ? std::static_pointer_cast<const EllipsoidField>(field)
                                : scattered(*as_regular(field.get()));
            made->grid = SpatialGrid::of(*made->kernels);
            if (made->kernels->size() <= most_start_cells) {
                made->reach = std::make_unique<ReachLists>(ReachLists::of(*made->kernels, made->grid));
            }
            grids.push_back(std::move(made));
            entry = grids.back().get();
        }
        const bool scalar = plan.mode == Mode::xray || plan.mode == Mode::mip;
        EllipsoidVisibility query;
        query.transfer_function = scalar ? nullptr : &scene.transfer_function;
        query.weights_matter = plan.weight || !plan.culling;
        // A filter makes kernels as large as a pixel is at their own depth, which has no bound behind the eye.
        query.cull = plan.culling && !plan.coverage && !(plan.filter && frame.cut_by_near);
        query.isosurface = plan.mode == Mode::isosurface;
        query.iso_value = scene.iso_value.value_or(0.0);
        query.alone = scene.fields.size() == 1;
        const int reaches =
            (plan.sampling == Sampling::slab ? 1 : 0) + (plan.mode == Mode::isosurface || plan.preintegration ? 1 : 0);
        query.reach_world = reaches * frame.slice_spacing * slant;
        if (plan.gradient) {
            query.reach_world += std::max(frame.largest_pixel(), frame.slice_spacing * slant);
        }
        if (plan.filter) {
            // Twice what it widens a support by, in any direction, at depths a little beyond the last slice too.
            query.reach_world += 4.0 * (2.0 * frame.largest_pixel() + frame.slice_spacing);
        }
        if (!entry->answers(query)) {
            entry->visible = visible_kernels(*entry->kernels, entry->grid, query);
            entry->judged = true;
            entry->query = query;
            entry->points =
                query.transfer_function != nullptr ? query.transfer_function->points() : std::vector<TransferPoint>{};
            entry->query.transfer_function = nullptr;
        }
        return *entry;
    }

    void forget_others(const Scene& scene) {
        grids.erase(std::remove_if(grids.begin(), grids.end(),
                                   [&](const std::unique_ptr<GridEntry>& entry) {
                                       return std::find(scene.fields.begin(), scene.fields.end(), entry->field) ==
                                              scene.fields.end();
                                   }),
                    grids.end());
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
        const double slant = largest_slant(camera, size);
        std::vector<const VisibleRuns*> runs;
        std::vector<GridEntry*> grids;
        std::size_t visible = 0, all = 0, index_bytes = 0;
        // Two passes, because an index that is made may move those that were made before.
        for (int round = 0; round < 2; ++round) {
            runs.clear();
            for (const std::size_t field : prepared.view_fields) {
                runs.push_back(&state.runs_of(scene.fields[field], scene, prepared.plan, prepared.frame, slant));
            }
        }
        for (const std::size_t field : prepared.ellipsoid_fields) {
            grids.push_back(&state.grid_of(scene.fields[field], scene, prepared.plan, prepared.frame, slant));
            visible += static_cast<std::size_t>(
                std::count(grids.back()->visible.begin(), grids.back()->visible.end(), std::uint8_t{1}));
            index_bytes += grids.back()->bytes();
        }
        for (const VisibleRuns* run : runs) {
            visible += run->samples();
            index_bytes += run->bytes();
        }
        for (const auto& field : scene.fields) {
            all += field->size();
        }
        image.stats["seconds_index"] = seconds_since(indexing);

        const auto viewing = Clock::now();
        const BatchLayout layout = sheet::make_layout(prepared.plan);
        const int wider = prepared.plan.fine_gradient ? 1 : 0;
        std::vector<SlabBatches> batches;
        std::vector<EllipsoidView> views;
        std::vector<CellTraversal> traversals;
        std::size_t drawn = 0, view_bytes = 0;
        sheet::Job job;
        batches.reserve(runs.size());
        for (std::size_t part = 0; part < runs.size(); ++part) {
            batches.push_back(SlabBatches::of(prepared.views[part], *runs[part], prepared.frame, scene.sampling, layout,
                                              prepared.plan.fine_along ? 1 : 0));
            drawn += batches.back().kernels();
            view_bytes += batches.back().bytes();
            job.regular.push_back({prepared.view_fields[part], &prepared.views[part], &batches.back()});
        }
        views.reserve(grids.size());
        traversals.reserve(grids.size());
        for (std::size_t part = 0; part < grids.size(); ++part) {
            const GridEntry& entry = *grids[part];
            views.emplace_back(*entry.kernels, camera, prepared.frame, scene.sampling,
                               prepared.plan.filter ? Filter::ewa : Filter::none, prepared.plan.value_unit, 1.0);
            traversals.push_back(CellTraversal::of(
                views.back(), entry.grid, entry.reach.get(), entry.visible, layout, wider, wider,
                prepared.plan.packing == Packing::wide && !prepared.plan.fine_gradient,
                sheet::largest_sprite(prepared.plan, state.sheets->capabilities()), prepared.plan.precise_aspect));
            drawn += traversals.back().kernels();
            view_bytes += traversals.back().bytes();
            job.ellipsoids.push_back(
                {prepared.ellipsoid_fields[part], entry.kernels, &views.back(), &traversals.back()});
        }
        image.stats["seconds_view"] = seconds_since(viewing);

        job.scene = &scene;
        job.camera = &camera;
        job.frame = &prepared.frame;
        job.plan = &prepared.plan;
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

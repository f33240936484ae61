#include "backend_cpu/cpu_renderer.hpp"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <limits>
#include <memory>
#include <new>

#include "backend_cpu/instruction_set.hpp"
#include "backend_cpu/shading.hpp"
#include "backend_cpu/tile_feed.hpp"
#include "backend_cpu/tile_task.hpp"
#include "base/clock.hpp"
#include "base/memory.hpp"
#include "base/poll.hpp"
#include "scene/mode_rules.hpp"
#include "sheetsplat/error.hpp"

namespace sheetsplat::backend_cpu {

namespace {

constexpr double log2_e = 1.4426950408889634;
/// Edge of a tile: a channel of the ring takes 330 kB in float32; larger and smaller tiles were measured slower.
constexpr int usual_tile = 62;
/// splat-inl.hpp keeps rows of so many pixels.
constexpr int largest_tile = 126;
/// Tiles, at least, as long as they are not tiny: enough for a dozen threads. The threads that there are must not
/// count, since numbers of one format are rounded otherwise from the corner of another tile.
constexpr std::int64_t enough_tiles = 48;
constexpr int smallest_tile = 24;
/// How often the caller hears of the progress.
constexpr double between_calls = 0.004;

int edge_of_tiles(Size size, int asked) {
    if (asked > 0) {
        return std::min(asked, largest_tile);
    }
    int edge = usual_tile;
    const auto tiles = [&](int length) {
        return ((size.width + length - 1) / length) * static_cast<std::int64_t>((size.height + length - 1) / length);
    };
    while (edge > smallest_tile && tiles(edge) < enough_tiles) {
        edge -= 8;
    }
    return edge;
}

/// Two frames that show kernels at the same places.
bool same_view(const Frame& a, const Frame& b) {
    return a.projection == b.projection && a.size.width == b.size.width && a.size.height == b.size.height &&
           a.pixel == b.pixel && a.slice_spacing == b.slice_spacing && a.near == b.near &&
           a.first_depth == b.first_depth && a.slices == b.slices;
}

bool same_place(const FieldView& a, const FieldView& b) {
    return a.field == b.field && a.first_eye == b.first_eye && a.step_i == b.step_i && a.step_j == b.step_j &&
           a.step_k == b.step_k && a.slab_half == b.slab_half;
}

bool same_place(const EllipsoidView& a, const Vec3& eye, const Vec3& right, const Vec3& up) {
    return a.eye_world() == eye && a.right_world() == right && a.up_world() == up;
}

/// Samples of a row between which all drawn ones lie.
struct RowExtent {
    std::uint32_t begin = 0, end = 0;
};

std::vector<RowExtent> extents_of(const VisibleRuns& runs) {
    std::vector<RowExtent> rows(runs.rows());
    for (std::size_t row = 0; row < rows.size(); ++row) {
        if (runs.begin(row) != runs.end(row)) {
            rows[row] = {runs.begin(row)->begin, (runs.end(row) - 1)->end};
        }
    }
    return rows;
}

bool covers(const std::vector<RowExtent>& kept, const VisibleRuns& runs) {
    if (kept.size() != runs.rows()) {
        return false;
    }
    for (std::size_t row = 0; row < kept.size(); ++row) {
        if (runs.begin(row) != runs.end(row) &&
            (runs.begin(row)->begin < kept[row].begin || (runs.end(row) - 1)->end > kept[row].end)) {
            return false;
        }
    }
    return true;
}

/// What was sorted by tiles for one lattice.
struct RowBuckets {
    std::shared_ptr<const Field> field; ///< kept, so that no other one gets the address that `view` knows it by
    FieldView view;
    std::vector<RowExtent> rows;
    Buckets<RowPart> parts;
};

/// And for scattered kernels.
struct KernelBuckets {
    std::shared_ptr<const EllipsoidField> kernels;
    Vec3 eye{0.0}, right{0.0}, up{0.0};
    bool filtered = false;
    std::uint64_t visible_version = 0;
    Buckets<std::uint32_t> indices;
};

/// Everything of a view that does not depend on how kernels are classified, lit or composited.
struct SortedView {
    Frame frame;
    int edge = 0;
    Sampling sampling = Sampling::point;
    std::vector<RowBuckets> lattices;
    std::vector<KernelBuckets> scattered;

    [[nodiscard]] std::size_t bytes() const {
        std::size_t sum = 0;
        for (const RowBuckets& part : lattices) {
            sum += part.parts.bytes() + part.rows.capacity() * sizeof(RowExtent);
        }
        for (const KernelBuckets& part : scattered) {
            sum += part.indices.bytes();
        }
        return sum;
    }

    [[nodiscard]] bool serves(const Job& job, int edge_now) const {
        if (edge != edge_now || !same_view(frame, *job.frame) || sampling != job.plan->sampling ||
            lattices.size() != job.regular.size() || scattered.size() != job.ellipsoids.size()) {
            return false;
        }
        for (std::size_t part = 0; part < lattices.size(); ++part) {
            if (!same_place(lattices[part].view, *job.regular[part].view) ||
                !covers(lattices[part].rows, *job.regular[part].runs)) {
                return false;
            }
        }
        for (std::size_t part = 0; part < scattered.size(); ++part) {
            const KernelBuckets& kept = scattered[part];
            const EllipsoidPart& asked = job.ellipsoids[part];
            if (kept.kernels != asked.kernels || kept.filtered != asked.view->filtered() ||
                kept.visible_version != asked.visible_version ||
                !same_place(*asked.view, kept.eye, kept.right, kept.up)) {
                return false;
            }
        }
        return true;
    }
};

/// A w0 that stays a number above 0 in the format: empty points are divided by it.
template <class T>
T divisor(double w0) {
    return static_cast<T>(std::clamp(w0, static_cast<double>(std::numeric_limits<T>::min()),
                                     static_cast<double>(std::numeric_limits<T>::max())));
}

template <class T>
LoopSetup<T> make_setup(const Job& job, const Shading<T>& shading) {
    const DrawPlan& plan = *job.plan;
    const Frame& frame = *job.frame;
    LoopSetup<T> setup;
    setup.shading = &shading;
    setup.keep_weight = plan.empty_test || plan.coverage;
    setup.slab = plan.sampling == Sampling::slab;
    setup.perspective = frame.projection == Projection::perspective;
    setup.intervals = uses_intervals(plan.mode, plan.preintegration);
    setup.stops = (plan.stop || plan.mode == Mode::isosurface) && !plan.coverage;
    setup.first_depth = frame.first_depth;
    setup.slice_spacing = frame.slice_spacing;
    setup.slices = frame.slices;
    // Channel 0 is rho in the end. Fields that share sheets add to it; each of the others has two of its own.
    setup.channels = 1;
    setup.threshold = plan.threshold;
    const bool shared_weight = plan.threshold || setup.keep_weight;
    if (shared_weight) {
        setup.weight_channel = setup.channels++;
    }
    const auto three = [&setup] {
        const int first = setup.channels;
        setup.channels += 3;
        return first;
    };
    const bool slopes = shading.analytic_gradient;
    if (slopes) {
        setup.slope_channel = three();
        setup.weight_slope_channel = shared_weight ? three() : -1;
    }
    const auto add_part = [&](std::size_t field) {
        const Field& source = *job.scene->fields[field];
        PartProfile<T> profile;
        const double k = source.kernel().falloff;
        profile.falloff_log2 = static_cast<T>(k * log2_e);
        profile.edge = static_cast<T>(source.kernel().edge());
        profile.root_falloff = static_cast<T>(std::sqrt(k));
        if (!plan.own_sheets.empty() && plan.own_sheets[field] >= 0) {
            OwnSheets<T> own;
            own.value_channel = profile.value_channel = setup.channels++;
            own.weight_channel = profile.weight_channel = setup.channels++;
            if (slopes) {
                own.slope_channel = profile.slope_channel = three();
                own.weight_slope_channel = profile.weight_slope_channel = three();
            }
            own.w0 = divisor<T>(source.w0());
            setup.own.push_back(own);
        } else {
            profile.value_channel = 0;
            profile.weight_channel = setup.weight_channel;
            profile.slope_channel = setup.slope_channel;
            profile.weight_slope_channel = setup.weight_slope_channel;
            if (plan.threshold) {
                setup.w0 = divisor<T>(source.w0());
            }
        }
        setup.parts.push_back(profile);
    };
    for (const RegularPart& part : job.regular) {
        add_part(part.field);
    }
    for (const EllipsoidPart& part : job.ellipsoids) {
        add_part(part.field);
    }
    return setup;
}

/// Planes of a tile's picture, cleared.
template <class T>
void clear_picture(const DrawPlan& plan, const TileShape& shape, TileScratch<T>& scratch) {
    const bool scalar = is_scalar(plan.mode);
    const std::size_t elements = shape.picture_elements();
    const std::size_t planes = (scalar ? 1U : 4U) + (plan.depth ? 1U : 0U) + (plan.coverage ? 1U : 0U);
    scratch.picture.assign(planes * elements, T(0));
    T* next = scratch.picture.data();
    const auto take = [&](bool wanted) {
        T* plane = wanted ? next : nullptr;
        next += wanted ? elements : 0;
        return plane;
    };
    TilePicture<T>& picture = scratch.planes;
    picture.red = take(!scalar);
    picture.green = take(!scalar);
    picture.blue = take(!scalar);
    picture.alpha = take(!scalar);
    picture.scalar = take(scalar);
    picture.coverage = take(plan.coverage);
    picture.depth = take(plan.depth);
    if (picture.depth != nullptr) {
        std::fill(picture.depth, picture.depth + elements, std::numeric_limits<T>::infinity());
    }
    scratch.row_alive.assign(static_cast<std::size_t>(shape.height), shape.width);
    picture.row_alive = scratch.row_alive.data();
    picture.alive = shape.width * shape.height;
}

template <class T>
void copy_picture(const TileShape& shape, const TilePicture<T>& picture, Image& image, Size size) {
    for (int y = 0; y < shape.height; ++y) {
        const std::size_t from = static_cast<std::size_t>(y) * static_cast<std::size_t>(shape.stride);
        const std::size_t to = static_cast<std::size_t>(shape.y + y) * static_cast<std::size_t>(size.width) +
                               static_cast<std::size_t>(shape.x);
        const auto width = static_cast<std::size_t>(shape.width);
        const auto copy = [&](const T* plane, std::vector<float>& out) {
            if (plane != nullptr) {
                std::transform(plane + from, plane + from + width, out.begin() + static_cast<std::ptrdiff_t>(to),
                               [](T value) { return static_cast<float>(value); });
            }
        };
        if (picture.red != nullptr) {
            float* rgba = image.rgba.data() + 4 * to;
            for (std::size_t x = 0; x < width; ++x) {
                rgba[4 * x] = static_cast<float>(picture.red[from + x]);
                rgba[4 * x + 1] = static_cast<float>(picture.green[from + x]);
                rgba[4 * x + 2] = static_cast<float>(picture.blue[from + x]);
                rgba[4 * x + 3] = static_cast<float>(picture.alpha[from + x]);
            }
        }
        copy(picture.scalar, image.scalar);
        copy(picture.coverage, image.coverage);
        copy(picture.depth, image.depth);
    }
}

[[noreturn]] void out_of_memory() {
    throw OutOfMemory(Complaint{"the picture cannot be drawn", "not enough memory", "memory for its kernels and tiles",
                                "make the picture or the field smaller"});
}

/// Leaves a task of a picture that has failed elsewhere: that error is the one that counts.
struct Ended {};

/// Tells the caller how far a picture is, not too often. Only the caller's thread may use it.
class Report {
  public:
    explicit Report(const Progress* progress) : progress_(progress) {}
    /// Throws Cancelled.
    void operator()(double share) {
        if (progress_ == nullptr || !*progress_) {
            return;
        }
        if (seconds_since(called_) < between_calls) {
            return;
        }
        called_ = Clock::now();
        report_progress(*progress_, share);
    }

  private:
    const Progress* progress_;
    Clock::time_point called_ = Clock::now();
};

} // namespace

struct CpuRenderer::State {
    OwnPool pool;
    std::unique_ptr<SortedView> sorted;
    std::vector<TileScratch<float>> scratch_float;
    std::vector<TileScratch<double>> scratch_double;

    template <class T>
    std::vector<TileScratch<T>>& scratch();

    void forget() {
        sorted.reset();
        scratch_float.clear();
        scratch_double.clear();
    }

    void sort(const Job& job, const TileLayout& layout, int edge, RectsFunction rects, Report& tell, Image& image) {
        const auto start = Clock::now();
        const bool reused = sorted && sorted->serves(job, edge);
        if (!reused) {
            sorted.reset();
            const std::function<void()> poll = [&] { tell(0.0); };
            SortedView view;
            view.frame = *job.frame;
            view.edge = edge;
            view.sampling = job.plan->sampling;
            for (const RegularPart& part : job.regular) {
                view.lattices.push_back({job.scene->fields[part.field], *part.view, extents_of(*part.runs),
                                         bucket_rows(*part.view, *part.runs, *job.frame, layout, *pool, poll)});
            }
            for (const EllipsoidPart& part : job.ellipsoids) {
                view.scattered.push_back({part.kernels, part.view->eye_world(), part.view->right_world(),
                                          part.view->up_world(), part.view->filtered(), part.visible_version,
                                          bucket_kernels(*part.view, *part.visible, layout, rects, *pool, poll)});
            }
            sorted = std::make_unique<SortedView>(std::move(view));
        }
        image.stats["buckets_reused"] = reused ? 1.0 : 0.0;
        image.stats["seconds_bucket"] = seconds_since(start);
        image.stats["bytes_view"] = static_cast<double>(sorted->bytes());
    }

    /// record: what is filled in the picture's place; null: the picture is.
    template <class T>
    void draw(const Job& job, const TileLayout& layout, const TileFunctions<T>& functions,
              const AbsorptionRecord* record, Report& tell, Image& image) {
        const auto start = Clock::now();
        const Size size = job.frame->size;
        const Shading<T> shading = make_shading<T>(*job.scene, *job.camera, *job.frame, *job.plan, job.volumes);
        LoopSetup<T> setup = make_setup(job, shading);
        setup.record = record;
        std::vector<TileScratch<T>>& rooms = scratch<T>();
        rooms.resize(static_cast<std::size_t>(pool->threads()));
        for (TileScratch<T>& room : rooms) {
            room.sections_drawn = room.kernels_drawn = 0;
        }
        const std::size_t tiles = layout.tiles();
        std::atomic<std::size_t> finished{0};
        const auto report = [&] {
            tell(static_cast<double>(finished.load(std::memory_order_relaxed)) / static_cast<double>(tiles));
        };
        pool->run(
            tiles,
            [&](std::size_t tile, int thread) {
                TileScratch<T>& room = rooms[static_cast<std::size_t>(thread)];
                const TileShape shape = layout.shape(tile);
                const bool first = thread == 0;
                const std::function<bool()> between = [&, first] {
                    if (first) {
                        report();
                    }
                    return !pool->failed();
                };
                draw_tile(job, setup, shape, tile, functions, room, between, image, size);
                finished.fetch_add(1, std::memory_order_relaxed);
            },
            report);
        std::uint64_t kernels = 0, sections = 0;
        std::size_t bytes = 0;
        for (const TileScratch<T>& room : rooms) {
            kernels += room.kernels_drawn;
            sections += room.sections_drawn;
            bytes += room.bytes();
        }
        image.stats["kernels_drawn"] = static_cast<double>(kernels);
        image.stats["sections_drawn"] = static_cast<double>(sections);
        image.stats["bytes_device"] = static_cast<double>(bytes);
        image.stats["tiles"] = static_cast<double>(tiles);
        image.stats["threads"] = static_cast<double>(pool->threads());
        image.stats["seconds_draw"] = seconds_since(start);
    }

    template <class T>
    void draw_tile(const Job& job, const LoopSetup<T>& setup, const TileShape& shape, std::size_t tile,
                   const TileFunctions<T>& functions, TileScratch<T>& room, const std::function<bool()>& between,
                   Image& image, Size size) const {
        const std::size_t parts = job.regular.size() + job.ellipsoids.size();
        if (room.kernels.size() != parts) {
            room.kernels.resize(parts);
        }
        for (TileKernels<T>& kernels : room.kernels) {
            kernels.poll = [&between] {
                if (!between()) {
                    throw Ended();
                }
            };
        }
        std::size_t part = 0;
        bool any = false;
        for (std::size_t lattice = 0; lattice < job.regular.size(); ++lattice, ++part) {
            const Buckets<RowPart>& rows = sorted->lattices[lattice].parts;
            functions.feed_rows(*job.regular[lattice].view, *job.regular[lattice].runs, *job.frame, job.plan->sampling,
                                rows.begin(tile), rows.end(tile), shape, room.kernels[part]);
            any = any || !room.kernels[part].sections.empty();
            room.kernels_drawn += room.kernels[part].counted;
        }
        for (std::size_t field = 0; field < job.ellipsoids.size(); ++field, ++part) {
            const Buckets<std::uint32_t>& kernels = sorted->scattered[field].indices;
            functions.feed_kernels(*job.ellipsoids[field].view, kernels.begin(tile), kernels.end(tile), shape,
                                   room.kernels[part]);
            any = any || !room.kernels[part].sections.empty();
            room.kernels_drawn += room.kernels[part].counted;
        }
        clear_picture(*job.plan, shape, room);
        if (any) {
            const std::size_t elements = shape.sheet_elements();
            const std::size_t wanted = elements * ring_slots * static_cast<std::size_t>(setup.channels);
            // Each tile leaves the ring as it found it: all zero.
            if (room.ring.size() < wanted) {
                room.ring.assign(wanted, T(0));
            }
            if (room.zeros.size() < elements) {
                room.zeros.assign(elements, T(0));
            }
            functions.run(setup, shape, room, between);
        }
        if (setup.record == nullptr) {
            copy_picture(shape, room.planes, image, size);
        }
    }

    void draw_in(Precision precision, const Job& job, const AbsorptionRecord* record, Report& tell, Image& image) {
        const int threads = job.threads > 0 ? job.threads : usable_threads();
        try {
            if (!pool || pool->threads() != threads || !pool->is_here()) {
                pool = OwnPool(new ThreadPool(threads));
            }
            const int edge = edge_of_tiles(job.frame->size, job.tile_size);
            const TileLayout layout(job.frame->size, edge);
            const InstructionSet set = chosen_instruction_set();
            sort(job, layout, edge, tile_functions_float(set)->rects, tell, image);
            if (precision == Precision::float64) {
                draw<double>(job, layout, *tile_functions_double(set), record, tell, image);
            } else {
                draw<float>(job, layout, *tile_functions_float(set), record, tell, image);
            }
        } catch (const std::bad_alloc&) {
            forget();
            out_of_memory();
        } catch (...) {
            // What was begun is let go: tiles that were left half-way are no start for others.
            forget();
            throw;
        }
    }
};

template <>
std::vector<TileScratch<float>>& CpuRenderer::State::scratch<float>() {
    return scratch_float;
}
template <>
std::vector<TileScratch<double>>& CpuRenderer::State::scratch<double>() {
    return scratch_double;
}

CpuRenderer::CpuRenderer() : state_(std::make_unique<State>()) {}
CpuRenderer::~CpuRenderer() = default;

void CpuRenderer::render(const Job& job, Image& image) {
    try {
        const Size size = job.frame->size;
        const auto pixels = static_cast<std::size_t>(size.width) * static_cast<std::size_t>(size.height);
        const bool scalar = is_scalar(job.plan->mode);
        image.rgba.assign(scalar ? 0 : 4 * pixels, 0.0F);
        image.scalar.assign(scalar ? pixels : 0, 0.0F);
        image.coverage.assign(job.plan->coverage ? pixels : 0, 0.0F);
        image.depth.assign(job.plan->depth ? pixels : 0, std::numeric_limits<float>::infinity());
    } catch (const std::bad_alloc&) {
        out_of_memory();
    }
    Report tell(job.progress);
    state_->draw_in(job.plan->precision, job, nullptr, tell, image);
}

void CpuRenderer::absorb(const Job& job, int every, LightVolume& volume) {
    const Frame& frame = *job.frame;
    const Camera& camera = *job.camera;
    const std::int64_t planes = (frame.slices + every - 1) / every + 1;
    volume.counts = {frame.size.width, frame.size.height, static_cast<int>(planes)};
    volume.per_step = {camera.right_world() / frame.pixel, -camera.up_world() / frame.pixel,
                       -camera.back_world() / (frame.slice_spacing * every)};
    volume.origin = camera.eye() - 0.5 * (frame.size.width - 1) * frame.pixel * camera.right_world() +
                    0.5 * (frame.size.height - 1) * frame.pixel * camera.up_world() -
                    frame.first_depth * camera.back_world();
    const auto row = static_cast<std::size_t>(frame.size.width);
    const std::size_t plane = row * static_cast<std::size_t>(frame.size.height);
    try {
        volume.values.assign(plane * static_cast<std::size_t>(planes), 0.0F);
    } catch (const std::bad_alloc&) {
        out_of_memory();
    }
    const AbsorptionRecord record{volume.values.data(), row, plane, planes, every};
    // Other views than the picture's must not cost it what was sorted for it.
    std::unique_ptr<SortedView> kept = std::move(state_->sorted);
    Image none;
    Report tell(job.progress);
    state_->draw_in(job.plan->precision, job, &record, tell, none);
    state_->sorted = std::move(kept);
}

} // namespace sheetsplat::backend_cpu

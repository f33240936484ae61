#include "backend_cpu/cpu_renderer.hpp"
#include "backend_cpu/measured.hpp"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <iterator>
#include <limits>
#include <memory>
#include <new>
#include <numeric>
#include <string>
#include <type_traits>

#include "backend_cpu/face_planes.hpp"
#include "backend_cpu/lattice_extremes.hpp"
#include "backend_cpu/loop_setup.hpp"
#include "backend_cpu/shading.hpp"
#include "backend_cpu/sorted_view.hpp"
#include "backend_cpu/tile_feed.hpp"
#include "backend_cpu/tile_task.hpp"
#include "base/checks.hpp"
#include "base/clock.hpp"
#include "base/instruction_set.hpp"
#include "base/memory.hpp"
#include "base/poll.hpp"
#include "plan/limits_common.hpp"
#include "scene/mode_rules.hpp"
#include "sheetsplat/error.hpp"
#include "view/kept_slices.hpp"

namespace sheetsplat::backend_cpu {

namespace {

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

/// Fills the plane of the last slices in front of the depth limit.
template <class T>
void set_last_kept(const Job& job, const TileShape& shape, T* plane) {
    const SlicesInFront in_front(&*job.scene->depth_limit, *job.frame);
    for (int y = 0; y < shape.height; ++y) {
        T* row = plane + static_cast<std::ptrdiff_t>(y) * shape.stride;
        for (int x = 0; x < shape.width; ++x) {
            row[x] = static_cast<T>(in_front.last(shape.x + x, shape.y + y));
        }
    }
}

/// Fills the planes of the slices that a part draws.
template <class T>
void set_owned(const Job& job, const TileShape& shape, T* first, T* last) {
    const OwnedSlices owned(*job.scene->part, *job.camera, *job.frame);
    for (int y = 0; y < shape.height; ++y) {
        const std::ptrdiff_t row = static_cast<std::ptrdiff_t>(y) * shape.stride;
        for (int x = 0; x < shape.width; ++x) {
            const SliceRun run = owned.at(shape.x + x, shape.y + y);
            first[row + x] = static_cast<T>(run.first);
            last[row + x] = static_cast<T>(run.last);
        }
    }
}

/// Starts with the opacity in front of a part. Pixels that it finishes do not change any more.
template <class T>
void start_behind(const Job& job, const TileShape& shape, T stop, TilePicture<T>& picture) {
    const std::vector<float>& in_front = *job.scene->part->in_front;
    const auto columns = static_cast<std::size_t>(job.frame->size.width);
    for (int y = 0; y < shape.height; ++y) {
        const auto from =
            in_front.begin() + static_cast<std::ptrdiff_t>(static_cast<std::size_t>(shape.y + y) * columns +
                                                           static_cast<std::size_t>(shape.x));
        T* row = picture.alpha + static_cast<std::ptrdiff_t>(y) * shape.stride;
        std::transform(from, from + shape.width, row, [](float opacity) { return static_cast<T>(opacity); });
        const auto ended =
            static_cast<int>(std::count_if(row, row + shape.width, [stop](T opacity) { return opacity >= stop; }));
        picture.row_alive[y] -= ended;
        picture.alive -= ended;
    }
}

/// Planes of a tile's picture, cleared.
template <class T>
void clear_picture(const Job& job, const LoopSetup<T>& setup, const TileShape& shape, TileScratch<T>& scratch) {
    const DrawPlan& plan = *job.plan;
    const bool scalar = is_scalar(plan.mode);
    const std::size_t elements = shape.picture_elements();
    const bool counts = traits_of(plan.mode).mean;
    const std::size_t faces = plan.cut_faces ? setup.shading->groups.size() : 0;
    const std::size_t planes = face_planes * faces + (scalar ? 1U : 4U) + (counts ? 1U : 0U) + (plan.depth ? 1U : 0U) +
                               (plan.coverage ? 1U : 0U) + (plan.depth_limit ? 1U : 0U) + (plan.owned ? 2U : 0U);
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
    picture.counted = take(counts);
    picture.coverage = take(plan.coverage);
    picture.depth = take(plan.depth);
    T* last_kept = take(plan.depth_limit);
    picture.last_kept = last_kept;
    if (last_kept != nullptr) {
        set_last_kept(job, shape, last_kept);
    }
    T* first_owned = take(plan.owned);
    T* last_owned = take(plan.owned);
    picture.first_owned = first_owned;
    picture.last_owned = last_owned;
    if (plan.owned) {
        set_owned(job, shape, first_owned, last_owned);
    }
    picture.faces.clear();
    if (faces > 0) {
        set_faces(job, shape, next, picture);
    }
    const auto fill_infinite = [elements](T* plane) {
        std::fill(plane, plane + elements, std::numeric_limits<T>::infinity());
    };
    if (picture.depth != nullptr) {
        fill_infinite(picture.depth);
    }
    if (is_extreme(plan.mode)) {
        std::fill(picture.scalar, picture.scalar + elements, static_cast<T>(start_of(plan.mode)));
    }
    std::fill(std::begin(picture.doubts), std::end(picture.doubts), T(0));
    scratch.row_alive.assign(static_cast<std::size_t>(shape.height), shape.width);
    picture.row_alive = scratch.row_alive.data();
    picture.alive = shape.width * shape.height;
    if (job.scene->part && job.scene->part->in_front && picture.alpha != nullptr) {
        start_behind(job, shape, setup.shading->stop, picture);
    }
}

/// Pixels where no slice counts are no number.
template <class T>
void finish_scalars(const DrawPlan& plan, const TileShape& shape, TilePicture<T>& picture) {
    const std::size_t elements = shape.picture_elements();
    const T none = std::numeric_limits<T>::quiet_NaN();
    if (is_extreme(plan.mode)) {
        std::replace(picture.scalar, picture.scalar + elements, static_cast<T>(start_of(plan.mode)), none);
    }
    for (std::size_t at = 0; at < elements && picture.counted != nullptr; ++at) {
        picture.scalar[at] = picture.counted[at] > T(0) ? picture.scalar[at] / picture.counted[at] : none;
    }
}

template <class T>
void copy_counts(const TileShape& shape, const TilePicture<T>& picture, Image& image, Size size) {
    for (int y = 0; y < shape.height; ++y) {
        const std::ptrdiff_t from = static_cast<std::ptrdiff_t>(y) * shape.stride;
        const std::size_t to = static_cast<std::size_t>(shape.y + y) * static_cast<std::size_t>(size.width) +
                               static_cast<std::size_t>(shape.x);
        for (int x = 0; x < shape.width; ++x) {
            image.counts[to + static_cast<std::size_t>(x)] = static_cast<float>(picture.counted[from + x]);
        }
    }
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

/// errors: of the drawn tiles.
void refuse_beyond(const Job& job, const TileLayout& layout, const std::vector<double>& errors) {
    const double error = picture_error(layout, errors);
    // (What is no number is beyond every bound.)
    if (job.plan->inexact || error <= refused_beyond * job.plan->bound) {
        return;
    }
    const auto worst = std::max_element(errors.begin(), errors.end(),
                                        [](double a, double b) { return a < b || (std::isnan(b) && !std::isnan(a)); });
    const TileShape shape = layout.shape(static_cast<std::size_t>(worst - errors.begin()));
    const bool forced = job.plan->precision == Precision::float32 && !job.plan->exact_tiles;
    const auto pixels = [](int first, int count) { return text_of(first) + " to " + text_of(first + count - 1); };
    throw Unsupported(
        Complaint{"the picture cannot be made within its error bound with " +
                      std::string(forced ? "precision float32" : "backend cpu"),
                  "lit gradients as weak as rounding, most in columns " + pixels(shape.x, shape.width) + ", rows " +
                      pixels(shape.y, shape.height) + ": an error of about " + text_of(error, 2),
                  "at most " + text_of(job.plan->bound, 2),
                  (forced ? "leave out " + option_ref("precision")
                          : "use a smaller " + option_ref("reference_length") + ", or leave out the lights") +
                      ", or pass " + option_ref("allow_inexact", "true"),
                  forced ? "precision" : ""});
}

[[noreturn]] void out_of_memory() {
    throw OutOfMemory(Complaint{"the picture cannot be drawn", "not enough memory", "memory for its kernels and tiles",
                                "make the picture or the field smaller"});
}

/// An element a pixel, in rows, and a plane for every few slices.
SliceRecord record_of(const Job& job, SliceRecord::Of what, int every, float* values) {
    const auto row = static_cast<std::size_t>(job.frame->size.width);
    const std::size_t plane = row * static_cast<std::size_t>(job.frame->size.height);
    return {what, values, row, plane, (job.frame->slices + every - 1) / every, every, 0};
}

LatticeRows rows_of(const Job& job, std::size_t lattice, const RowPart* begin, const RowPart* end) {
    const RegularPart& part = job.regular[lattice];
    return {part.view, part.runs, job.frame, job.plan->sampling, begin, end, part.own, &part.beside};
}

/// Ends a task of a picture that has failed in another task, whose error is the one that is thrown.
struct Ended {};

/// Calls the progress callback, at most every `between_calls` seconds. For the caller's thread only.
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
    /// Of the last lattice that was looked up, which is kept so that no other one gets its address.
    std::shared_ptr<const Field> extremes_field;
    double extremes_sign = 1.0;
    bool extremes_filled = false;
    LatticeExtremes extremes;
    std::vector<TileScratch<float>> scratch_float;
    std::vector<TileScratch<double>> scratch_double;

    template <class T>
    std::vector<TileScratch<T>>& scratch();

    void forget() {
        sorted.reset();
        extremes_field.reset();
        extremes = {};
        scratch_float.clear();
        scratch_double.clear();
    }

    void sort(const Job& job, const TileLayout& layout, int edge, RectsFunction rects, Report& tell, Image& image) {
        const auto start = Clock::now();
        const bool reused = sorted && sorted->serves(job, layout, edge);
        if (!reused) {
            sorted.reset();
            const std::function<void()> poll = [&] { tell(0.0); };
            sorted = std::make_unique<SortedView>(SortedView::of(job, layout, edge, rects, *pool, poll));
        }
        image.stats["buckets_reused"] = reused ? 1.0 : 0.0;
        image.stats["seconds_bucket"] = seconds_since(start);
        image.stats["bytes_view"] = static_cast<double>(sorted->bytes());
    }

    /// Calls draw(tile, thread, between) for each tile that is drawn; between: as TileFunctions::run takes it.
    template <class Draw>
    void run_tiles(const TileLayout& layout, Report& tell, const Draw& draw) {
        const std::size_t tiles = layout.tiles();
        std::atomic<std::size_t> finished{0};
        const auto report = [&] {
            tell(static_cast<double>(finished.load(std::memory_order_relaxed)) / static_cast<double>(tiles));
        };
        pool->run(
            tiles,
            [&](std::size_t tile, int thread) {
                if (!layout.draws(tile)) {
                    return;
                }
                const std::function<bool()> between = [&, first = thread == 0] {
                    if (first) {
                        report();
                    }
                    return !pool->failed();
                };
                draw(tile, static_cast<std::size_t>(thread), between);
                finished.fetch_add(1, std::memory_order_relaxed);
            },
            report);
    }

    /// The plan's effect ray_extremes.
    template <class T>
    void draw_extremes(const Job& job, const TileLayout& layout, const TileFunctions<T>& functions, Report& tell,
                       Image& image) {
        const auto preparing = Clock::now();
        const RegularPart& part = job.regular.front();
        const std::shared_ptr<const Field>& field = job.scene->fields[part.field];
        const double wanted = sign_of_extreme(job.plan->mode);
        const bool filled = ExtremeBlocks::filled(*job.scene);
        const bool reused = extremes_field == field && extremes_sign == wanted && extremes_filled == filled;
        if (!reused) {
            extremes_field.reset();
            extremes = LatticeExtremes::of(*part.view->field, wanted, filled, *pool, [&] { tell(0.0); });
            extremes_field = field;
            extremes_sign = wanted;
            extremes_filled = filled;
        }
        image.stats["buckets_reused"] = reused ? 1.0 : 0.0;
        image.stats["seconds_bucket"] = seconds_since(preparing);
        image.stats["bytes_view"] = static_cast<double>(extremes.bytes());

        const auto start = Clock::now();
        std::vector<LatticeReach> places;
        LatticeReach::add(*part.view, *job.frame, places);
        const Shading<T> shading = make_shading<T>(*job.scene, *job.camera, *job.frame, *job.plan, job.volumes);
        const LoopSetup<T> setup = make_setup(job, shading);
        const ExtremesView view{part.view->field,
                                wanted,
                                &extremes,
                                &places.front(),
                                job.frame,
                                &shading.kept,
                                part.view->value_scale,
                                static_cast<double>(shading.scalar_step)};
        std::vector<TileScratch<T>>& rooms = scratch<T>();
        rooms.resize(static_cast<std::size_t>(pool->threads()));
        std::atomic<std::uint64_t> looked_up{0};
        run_tiles(layout, tell, [&](std::size_t tile, std::size_t thread, const std::function<bool()>& between) {
            TileScratch<T>& room = rooms[thread];
            const TileShape shape = layout.shape(tile);
            clear_picture(job, setup, shape, room);
            looked_up.fetch_add(functions.find_extremes(view, shape, room.planes, between), std::memory_order_relaxed);
            copy_picture(shape, room.planes, image, job.frame->size);
        });
        std::size_t bytes = 0;
        for (const TileScratch<T>& room : rooms) {
            bytes += room.bytes();
        }
        image.stats["kernels_drawn"] = static_cast<double>(part.runs->samples());
        image.stats["points_looked_up"] = static_cast<double>(looked_up.load());
        image.stats["bytes_device"] = static_cast<double>(bytes);
        image.stats["tiles"] = static_cast<double>(layout.tiles());
        image.stats["threads"] = static_cast<double>(pool->threads());
        image.stats["seconds_draw"] = seconds_since(start);
    }

    /// record: what is filled in the picture's place; null: the picture is. In float32 tiles are drawn again whose
    /// light shows too much of its rounding.
    template <class T>
    void draw(const Job& job, const TileLayout& layout, const SliceRecord* record, Report& tell, Image& image) {
        const auto start = Clock::now();
        image.stats["kernels_drawn"] = image.stats["sections_drawn"] = image.stats["bytes_device"] = 0.0;
        std::vector<double> errors = draw_tiles<T>(job, layout, record, tell, image);
        std::size_t exact = std::is_same_v<T, float> ? 0 : layout.tiles();
        if (std::is_same_v<T, float> && job.plan->exact_tiles) {
            if (record == nullptr && job.plan->extremes_rounding > 0.0) {
                std::fill(errors.begin(), errors.end(), error_of_extremes(*job.plan, image.scalar, float32_epsilon));
            }
            const std::vector<std::uint8_t> again = doubtful_tiles(layout, errors, job.plan->bound);
            exact = static_cast<std::size_t>(std::count(again.begin(), again.end(), 1));
            if (exact > 0) {
                const TileLayout left = layout.only(again);
                refuse_beyond(job, left, draw_tiles<double>(job, left, record, tell, image));
            }
        } else {
            refuse_beyond(job, layout, errors);
        }
        // Before tiles were drawn again.
        image.stats["rounding_of_light"] = picture_error(layout, errors);
        image.stats["tiles_in_float64"] = static_cast<double>(exact);
        image.stats["tiles"] = static_cast<double>(layout.tiles());
        image.stats["threads"] = static_cast<double>(pool->threads());
        image.stats["seconds_draw"] = seconds_since(start);
    }

    /// Returns the error of each tile, root mean square, as far as light shows the rounding of rho.
    template <class T>
    std::vector<double> draw_tiles(const Job& job, const TileLayout& layout, const SliceRecord* record, Report& tell,
                                   Image& image) {
        const TileFunctions<T>& functions = *tile_functions<T>(chosen_instruction_set());
        Shading<T> shading = make_shading<T>(*job.scene, *job.camera, *job.frame, *job.plan, job.volumes);
        LoopSetup<T> setup = make_setup(job, shading);
        setup.record = record;
        sum_colors_at_points(job, setup, shading);
        std::vector<TileScratch<T>>& rooms = scratch<T>();
        rooms.resize(static_cast<std::size_t>(pool->threads()));
        for (TileScratch<T>& room : rooms) {
            room.sections_drawn = room.kernels_drawn = 0;
        }
        std::vector<double> errors(layout.tiles(), 0.0);
        run_tiles(layout, tell, [&](std::size_t tile, std::size_t thread, const std::function<bool()>& between) {
            errors[tile] = draw_tile(job, setup, layout.shape(tile), tile, functions, rooms[thread], between, image);
        });
        for (const TileScratch<T>& room : rooms) {
            image.stats["kernels_drawn"] += static_cast<double>(room.kernels_drawn);
            image.stats["sections_drawn"] += static_cast<double>(room.sections_drawn);
            image.stats["bytes_device"] += static_cast<double>(room.bytes());
        }
        return errors;
    }

    /// Returns the error of the tile, root mean square, as far as light shows the rounding of rho.
    template <class T>
    double draw_tile(const Job& job, const LoopSetup<T>& setup, const TileShape& shape, std::size_t tile,
                     const TileFunctions<T>& functions, TileScratch<T>& room, const std::function<bool()>& between,
                     Image& image) const {
        const Size size = job.frame->size;
        const std::size_t parts = job.regular.size() + job.ellipsoids.size();
        if (room.kernels.size() != parts) {
            room.kernels.resize(parts);
        }
        std::size_t part = 0;
        for (TileKernels<T>& kernels : room.kernels) {
            kernels.poll = [&between] {
                if (!between()) {
                    throw Ended();
                }
            };
            kernels.pivot = setup.parts[part++].pivot;
        }
        part = 0;
        bool any = setup.counts_by_place;
        room.lattices.clear();
        for (std::size_t lattice = 0; lattice < job.regular.size(); ++lattice, ++part) {
            const Buckets<RowPart>& rows = sorted->lattices[lattice].parts;
            room.kernels[part].clear();
            if (setup.parts[part].at_points) {
                room.lattices.push_back(rows_of(job, lattice, rows.begin(tile), rows.begin(tile)));
                continue;
            }
            room.lattices.push_back(rows_of(job, lattice, rows.begin(tile), rows.end(tile)));
            any = any || rows.begin(tile) != rows.end(tile);
        }
        for (std::size_t field = 0; field < job.ellipsoids.size(); ++field, ++part) {
            const Buckets<std::uint32_t>& kernels = sorted->scattered[field].indices;
            const std::optional<ValuesBeside>& beside = job.ellipsoids[field].beside;
            room.kernels[part].beside = beside ? beside->view : nullptr;
            room.kernels[part].beside_pivot = setup.parts[part].other_pivot;
            functions.feed_kernels(*job.ellipsoids[field].view, kernels.begin(tile), kernels.end(tile), shape,
                                   room.kernels[part]);
            any = any || !room.kernels[part].sections.empty();
        }
        clear_picture(job, setup, shape, room);
        if (any && !(setup.stops && room.planes.alive == 0)) {
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
        for (const TileKernels<T>& kernels : room.kernels) {
            room.kernels_drawn += kernels.counted;
        }
        if (setup.record == nullptr) {
            if (job.plan->counts) {
                copy_counts(shape, room.planes, image, size);
            }
            finish_scalars(*job.plan, shape, room.planes);
            copy_picture(shape, room.planes, image, size);
        }
        const double doubts = std::accumulate(std::begin(room.planes.doubts), std::end(room.planes.doubts), 0.0);
        const double epsilon = std::is_same_v<T, float> ? float32_epsilon : float64_epsilon;
        return setup.shading->lit ? job.plan->lit_rounding * epsilon *
                                        std::sqrt(doubts / (static_cast<double>(shape.width) * shape.height))
                                  : 0.0;
    }

    void draw_in(Precision precision, const Job& job, const SliceRecord* record, Report& tell, Image& image) {
        const int threads = job.threads > 0 ? job.threads : usable_threads();
        try {
            if (!pool || pool->threads() != threads || !pool->is_here()) {
                pool = OwnPool(new ThreadPool(threads));
            }
            const int edge = edge_of_tiles(job.frame->size, job.tile_size);
            const TileLayout layout(job.frame->size, edge,
                                    job.drawn_tiles != nullptr ? *job.drawn_tiles : std::vector<std::uint8_t>{});
            const InstructionSet set = chosen_instruction_set();
            if (record == nullptr && job.plan->ray_extremes) {
                if (precision == Precision::float64) {
                    draw_extremes<double>(job, layout, *tile_functions<double>(set), tell, image);
                } else {
                    draw_extremes<float>(job, layout, *tile_functions<float>(set), tell, image);
                }
                return;
            }
            sort(job, layout, edge, tile_functions<float>(set)->rects, tell, image);
            if (precision == Precision::float64) {
                draw<double>(job, layout, record, tell, image);
            } else {
                draw<float>(job, layout, record, tell, image);
            }
        } catch (const std::bad_alloc&) {
            forget();
            out_of_memory();
        } catch (...) {
            // Scratch memory may hold half a tile: the next picture starts afresh.
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
        image.counts.assign(job.plan->counts ? pixels : 0, 0.0F);
    } catch (const std::bad_alloc&) {
        out_of_memory();
    }
    Report tell(job.progress);
    state_->draw_in(job.plan->precision, job, nullptr, tell, image);
}

void CpuRenderer::absorb(const Job& job, int every, float* values) {
    record(job, record_of(job, SliceRecord::Of::absorption, every, values));
}

void CpuRenderer::sample(const Job& job, std::size_t group, float* values) {
    SliceRecord asked = record_of(job, SliceRecord::Of::rho, 1, values);
    asked.group = group;
    record(job, asked);
}

void CpuRenderer::record(const Job& job, const SliceRecord& record) {
    // What was sorted for the picture is kept: the next one may reuse it.
    std::unique_ptr<SortedView> kept = std::move(state_->sorted);
    Image none;
    Report tell(job.progress);
    state_->draw_in(job.plan->precision, job, &record, tell, none);
    state_->sorted = std::move(kept);
}

} // namespace sheetsplat::backend_cpu

#include "field_index.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <type_traits>
#include <variant>

#include <glm/geometric.hpp>

#include "base/memory.hpp"
#include "plan/tells_empty.hpp"
#include "scene/mode_rules.hpp"
#include "scene/same_scene.hpp"

namespace sheetsplat {

namespace {

/// Above, lists of the cells that kernels reach into would take more memory than the kernels.
constexpr std::size_t most_start_cells = 1U << 20;

/// A longer reach than needed draws more kernels than needed, which is correct; more than twice as long wastes time.
bool reaches(double kept, double asked) { return kept == asked || (kept >= asked && kept <= 2.0 * asked); }

/// How much farther than asked a reach is kept that grows with the camera's moves.
constexpr double spare_reach = 1.25;

/// A reach that grows by less than a factor of 2 is raised by another quarter, so that a camera that keeps moving in
/// the same direction does not need a new index for every picture.
double ahead(double kept, double asked) { return kept < asked && asked < 2.0 * kept ? spare_reach * asked : asked; }

/// The first one. In perspective the largest pixel grows a little where a camera goes around the data: the second
/// picture finds the index of the first.
double at_first(double asked, const Frame& frame) {
    return frame.projection == Projection::perspective ? spare_reach * asked : asked;
}

bool same_runs(const VisibleRuns& a, const VisibleRuns& b) {
    if (a.rows() != b.rows() || a.samples() != b.samples()) {
        return false;
    }
    for (std::size_t row = 0; row < a.rows(); ++row) {
        if (!std::equal(a.begin(row), a.end(row), b.begin(row), b.end(row),
                        [](const Run& x, const Run& y) { return x.begin == y.begin && x.end == y.end; })) {
            return false;
        }
    }
    return true;
}

/// The kernels of a lattice, one by one, for what makes each of them different.
std::shared_ptr<const EllipsoidField> scattered(const RegularField& field) {
    EllipsoidArrays arrays;
    const std::size_t nk = field.shape()[0], nj = field.shape()[1];
    const KernelAxes& axes = field.kernel_axes();
    const bool spheres = axes.is_sphere(), turned = axes.directions != Mat3(1.0);
    require_memory(checked_product(field.size(),
                                   spheres  ? 40
                                   : turned ? 88
                                            : 56,
                                   "a lattice's kernels, one by one"),
                   "a lattice's kernels, one by one",
                   "leave out " + option_ref("filter") + ", or use a smaller volume");
    arrays.centers.reserve(field.size());
    arrays.values.reserve(field.size());
    for (std::size_t k = 0; k < nk; ++k) {
        for (std::size_t j = 0; j < nj; ++j) {
            const SampleRange kernels = field.kernels_of_row(j, k);
            for (std::size_t i = kernels.begin; i < kernels.end; ++i) {
                const double value = field.value(i, j, k);
                if (!std::isnan(value)) {
                    arrays.centers.push_back(field.position(i, j, k));
                    arrays.values.push_back(value);
                }
            }
        }
    }
    if (spheres) {
        arrays.radii.assign(field.size(), axes.lengths.x);
    } else {
        arrays.scales.assign(field.size(), axes.lengths);
    }
    if (turned) {
        arrays.rotations.assign(field.size(), glm::normalize(glm::quat_cast(axes.directions)));
    }
    EllipsoidFieldOptions options;
    options.normalization = field.normalization();
    options.w0 = field.w0();
    options.falloff = field.kernel().falloff;
    options.least_weight = field.least_weight();
    if (options.normalization == Normalization::lattice) {
        options.cell_volume = field.kernel().unit_mass() * axes.volume() / field.lattice_constant();
    }
    return std::make_shared<const EllipsoidField>(std::move(arrays), options);
}

/// Slices beyond its own that a slice's colour depends on: slabs average over a spacing of depth, crossings and
/// intervals reach one further, second order reads four slices; where several hold, their sum.
int slices_beyond(const DrawPlan& plan) {
    return (plan.second_order ? 2 : 0) + (plan.sampling == Sampling::slab ? 1 : 0) +
           (uses_intervals(plan.mode, plan.preintegration) ? 1 : 0);
}

/// Slice distances around a point that shows in which rho must be right: lines towards lights interpolate it there.
constexpr double around_surfaces = 2.0;
/// How much farther than asked kernels are drawn. What light is looked up in is made anew when they change, so pixels
/// may grow a little first.
double reach_ahead(const DrawPlan& plan) { return plan.shadows || plan.ambient_occlusion ? 1.4 : 1.0; }

/// Shortest and longest semi-axis of a field's kernels.
std::array<double, 2> semi_axes_of(const Field& field) {
    if (const EllipsoidField* ellipsoids = as_ellipsoids(&field)) {
        return ellipsoids->scale_range();
    }
    const KernelAxes& axes = as_regular(&field)->kernel_axes();
    return {axes.least(), axes.longest()};
}

/// Of parts that are not drawn now, what takes more than the so-manieth part of their memory is dropped.
constexpr std::size_t little_of_part = 4;

/// Rounding of what the filter widens supports by.
constexpr double filter_rounding = 1e-9;

bool lie_alike(const RegularField& a, const RegularField& b) {
    return a.shape() == b.shape() && a.lattice() == b.lattice() && a.steps() == b.steps() &&
           a.position(0, 0, 0) == b.position(0, 0, 0) && a.options().radius == b.options().radius;
}

bool lie_alike(const EllipsoidField& a, const EllipsoidField& b) {
    const EllipsoidArrays &one = a.arrays(), &other = b.arrays();
    return one.centers == other.centers && one.radii == other.radii && one.scales == other.scales &&
           one.rotations == other.rotations;
}

/// Lattices whose kernels are the same, at all places of the lattice.
bool weigh_alike(const RegularField& a, const RegularField& b) {
    return lie_alike(a, b) && a.kernel().falloff == b.kernel().falloff && a.normalization() == b.normalization() &&
           !a.has_holes() && !b.has_holes();
}

/// Adds to the sums of `count` samples from number `first` on; false where one is neither 0 nor 1.
bool add_ones(const RegularField& field, std::size_t first, std::size_t count, std::uint16_t* sums) {
    return std::visit(
        [&](const auto& samples) {
            using T = typename std::decay_t<decltype(samples)>::value_type;
            const T* values = samples.data() + first;
            // (Loops that the compiler makes vectors of.)
            std::uint16_t others = 0;
            for (std::size_t i = 0; i < count; ++i) {
                std::uint16_t one = 0;
                if constexpr (std::is_integral_v<T>) {
                    one = static_cast<std::uint16_t>(values[i]);
                    others = static_cast<std::uint16_t>(others | (one & ~1U));
                } else {
                    one = values[i] == T(1) ? 1 : 0;
                    others = static_cast<std::uint16_t>(others | (values[i] == static_cast<T>(one) ? 0U : 2U));
                }
                sums[i] = static_cast<std::uint16_t>(sums[i] + one);
            }
            return others == 0;
        },
        field.samples());
}

/// Layers at each end of all axes outside of which a lattice has all samples, while it lacks none that lies there
/// along one axis alone: mirrored samples beyond edges and corners may be too far away to be kernels. Nothing where
/// others are missing.
std::optional<std::size_t> layers_with_gaps(const RegularField& field) {
    const auto [nk, nj, ni] = field.shape();
    std::size_t layers = 0;
    for (std::size_t row = 0; row < nk * nj; ++row) {
        const SampleRange kernels = field.kernels_of_row(row % nj, row / nj);
        if (kernels.begin < kernels.end) {
            layers = std::max<std::size_t>({layers, kernels.begin, ni - kernels.end});
        }
    }
    if (2 * layers >= std::min({nk, nj, ni}) || (layers > 0 && field.lattice() == Lattice::bcc)) {
        return layers == 0 ? std::optional<std::size_t>(0) : std::nullopt;
    }
    const auto outside = [layers](std::size_t at, std::size_t size) { return at < layers || at >= size - layers; };
    for (std::size_t row = 0; row < nk * nj; ++row) {
        const SampleRange kernels = field.kernels_of_row(row % nj, row / nj);
        const int out = (outside(row % nj, nj) ? 1 : 0) + (outside(row / nj, nk) ? 1 : 0);
        const std::size_t lacking = out == 0 ? 0 : layers;
        if (out < 2 && (kernels.begin > lacking || kernels.end < ni - lacking)) {
            return std::nullopt;
        }
    }
    return layers;
}

/// FieldIndex::share_samples.
std::optional<std::size_t> share_samples_of(const std::vector<const RegularField*>& fields) {
    const RegularField& first = *fields.front();
    if (first.normalization() != Normalization::lattice || fields.size() > std::numeric_limits<std::uint16_t>::max() ||
        !std::all_of(fields.begin(), fields.end(), [&](const RegularField* field) {
            return weigh_alike(first, *field) && field->counted_from() == 0.0;
        })) {
        return std::nullopt;
    }
    const auto [nk, nj, ni] = first.shape();
    std::vector<std::uint16_t> sums(ni);
    for (std::size_t row = 0; row < nk * nj; ++row) {
        const SampleRange kernels = first.kernels_of_row(row % nj, row / nj);
        const std::size_t begin = first.row(row % nj, row / nj) + kernels.begin;
        sums.assign(kernels.end - kernels.begin, 0);
        for (const RegularField* field : fields) {
            const SampleRange own = field->kernels_of_row(row % nj, row / nj);
            if (own.begin != kernels.begin || own.end != kernels.end ||
                !add_ones(*field, begin, sums.size(), sums.data())) {
                return std::nullopt;
            }
        }
        if (!std::all_of(sums.begin(), sums.end(), [](std::uint16_t sum) { return sum == 1; })) {
            return std::nullopt;
        }
    }
    return layers_with_gaps(first);
}

/// Whether labels are shown in no cell whose corners have none of them: all corners then have the one label that is not
/// shown. Of kernels of radius 2 and falloff 5 those of a cell's corners add up to more than all others, by a tenth of
/// C at least; so do those of an outermost layer that is mirrored.
bool corners_decide(const GroupRange& set, const std::vector<Group>& groups, const Scene& scene, const DrawPlan& plan) {
    const auto compared = [](const Group& group) { return group.use.role == GroupRole::compared; };
    const auto begin = groups.begin() + static_cast<std::ptrdiff_t>(set.first);
    const auto end = groups.begin() + static_cast<std::ptrdiff_t>(set.last);
    const RegularField& field = *as_regular(scene.fields[begin->first].get());
    // (Not where labels have corners of the lattice, beyond which nothing is mirrored.)
    const bool mirrored = field.domain() || (scene.counted && scene.counted->filled);
    return std::count_if(begin, end, compared) == 1 && field.lattice() == Lattice::cartesian && mirrored &&
           field.options().radius == 2.0 && field.kernel().falloff == 5.0 && !field.has_holes() && !plan.filter &&
           !scene.part;
}

/// Of kernels that lie alike.
bool weigh_alike(const EllipsoidField& a, const EllipsoidField& b) {
    return a.arrays().weights == b.arrays().weights && a.kernel().falloff == b.kernel().falloff;
}

VisibilityQuery query_of(std::size_t number, const Scene& scene, const DrawPlan& plan, const Frame& frame) {
    const Field& field = *scene.fields[number];
    const Group group = groups_drawn(scene)[group_drawn_of(scene, number)];
    const double slant = frame.largest_slant();
    VisibilityQuery query;
    const bool serves = serves_others(group);
    query.transfer_function = is_scalar(plan.mode) || serves ? nullptr : group.transfer_function;
    // Kernels of a label are those of its own samples.
    query.weights_matter = (plan.weight || !plan.culling) && !is_label(group);
    query.reach_matters = reach_decides(plan) && !is_label(group);
    // Where W > 0 decides, kernels without weight may not be drawn at all.
    query.cull = (plan.culling && !plan.coverage) || counts_weighted_slices(plan.mode) || is_label(group);
    query.isosurface = shows_surfaces(plan.mode) && !serves;
    for (const IsoValue& iso : iso_values_of(scene, query.isosurface ? group_drawn_of(scene, number) : 0)) {
        if (iso.opacity > 0.0 && !serves) {
            query.iso_values.push_back(iso.value);
        }
    }
    query.alone = group.last - group.first == 1;
    query.cubic = plan.second_order && plan.preintegration;
    query.reach_world = slices_beyond(plan) * frame.slice_spacing * slant;
    if (plan.gradient) {
        query.reach_world += std::max(frame.largest_pixel(), frame.slice_spacing * slant);
    }
    if (shows_surfaces(plan.mode) && (plan.shadows || plan.ambient_occlusion)) {
        query.reach_world = std::max(query.reach_world, around_surfaces * frame.slice_spacing);
    }
    if (plan.filter) {
        // What it widens two supports by, in any direction, at centres behind the last slice too: at most what it adds
        // to their shortest semi-axis.
        const auto [shortest, longest] = semi_axes_of(field);
        const double along = filter_width(frame, field.kernel(), 0.0).along;
        const double deepest = frame.depth_of(std::max<std::int64_t>(frame.slices, 1) - 1) + std::hypot(longest, along);
        const double widest = filter_width(frame, field.kernel(), deepest).across;
        const double wide = std::max(widest, along);
        query.reach_world += 2.0 * (std::hypot(shortest, wide) - shortest) * (1.0 + filter_rounding);
        if (as_regular(&field) != nullptr) {
            // A kernel is nowhere more than the widest one in its place, times the quotient of their amplitudes: of two
            // axes across the view, of which none was shorter than the shortest semi-axis.
            const double nearest = frame.depth_of(0) - std::hypot(longest, along);
            const double least = filter_width(frame, field.kernel(), nearest).across;
            const double squared = shortest * shortest;
            query.filter_gain = std::max(1.0, (squared + widest * widest) / (squared + least * least));
        }
    }
    return query;
}

/// How often the scene holds the same field before: in each place it may be drawn for another transfer function.
std::size_t copies_before(const Scene& scene, std::size_t number) {
    const auto begin = scene.fields.begin();
    return static_cast<std::size_t>(
        std::count(begin, begin + static_cast<std::ptrdiff_t>(number), scene.fields[number]));
}

Decision decision_of(VisibilityQuery query) {
    Decision decided;
    if (query.transfer_function != nullptr) {
        decided.points = query.transfer_function->points();
        query.transfer_function = nullptr;
    }
    decided.query = query;
    return decided;
}

} // namespace

bool Decision::answers(const VisibilityQuery& other) const {
    const TransferFunction* function = other.transfer_function;
    return (function == nullptr ? points.empty() : same(points, function->points())) &&
           query.weights_matter == other.weights_matter && query.reach_matters == other.reach_matters &&
           query.cull == other.cull && query.only_near == other.only_near && query.isosurface == other.isosurface &&
           query.iso_values == other.iso_values && query.alone == other.alone && query.cubic == other.cubic &&
           reaches(query.filter_gain, other.filter_gain) && reaches(query.reach_world, other.reach_world);
}

const FieldIndex::Alike& FieldIndex::compared(const std::shared_ptr<const Field>& a,
                                              const std::shared_ptr<const Field>& b) {
    const auto known = std::find_if(alike_.begin(), alike_.end(),
                                    [&](const Alike& one) { return one.one.lock() == a && one.other.lock() == b; });
    if (known != alike_.end()) {
        return *known;
    }
    const RegularField *lattice = as_regular(a.get()), *beside = as_regular(b.get());
    const EllipsoidField *kernels = as_ellipsoids(a.get()), *others = as_ellipsoids(b.get());
    Alike found{a, b, false, false};
    if (lattice != nullptr && beside != nullptr) {
        found.same = lie_alike(*lattice, *beside);
    } else if (kernels != nullptr && others != nullptr) {
        found.same = lie_alike(*kernels, *others);
        found.same_weights = found.same && weigh_alike(*kernels, *others);
    }
    alike_.erase(std::remove_if(alike_.begin(), alike_.end(),
                                [](const Alike& one) { return one.one.expired() || one.other.expired(); }),
                 alike_.end());
    alike_.push_back(std::move(found));
    return alike_.back();
}

std::optional<std::size_t> FieldIndex::share_samples(const std::vector<std::shared_ptr<const Field>>& fields) {
    const auto known = std::find_if(sharing_.begin(), sharing_.end(), [&](const Sharing& one) {
        return std::equal(one.fields.begin(), one.fields.end(), fields.begin(), fields.end(),
                          [](const auto& a, const auto& b) { return a.lock() == b; });
    });
    if (known != sharing_.end()) {
        return known->layers;
    }
    std::vector<const RegularField*> lattices;
    lattices.reserve(fields.size());
    for (const std::shared_ptr<const Field>& field : fields) {
        lattices.push_back(as_regular(field.get()));
    }
    const bool all = std::find(lattices.begin(), lattices.end(), nullptr) == lattices.end();
    sharing_.erase(std::remove_if(sharing_.begin(), sharing_.end(),
                                  [](const Sharing& one) {
                                      return std::any_of(one.fields.begin(), one.fields.end(),
                                                         [](const auto& field) { return field.expired(); });
                                  }),
                   sharing_.end());
    sharing_.push_back({{fields.begin(), fields.end()}, all ? share_samples_of(lattices) : std::nullopt});
    return sharing_.back().layers;
}

bool FieldIndex::have_the_same_kernels(const Field& a, const Field& b) {
    const RegularField *one = as_regular(&a), *other = as_regular(&b);
    return one != nullptr && other != nullptr && weigh_alike(*one, *other);
}

const VisibleRuns& FieldIndex::runs_of_any(const std::vector<const RunsEntry*>& entries) {
    std::vector<std::uint64_t> versions;
    std::vector<const VisibleRuns*> runs;
    for (const RunsEntry* entry : entries) {
        versions.push_back(entry->version);
        runs.push_back(&entry->runs);
    }
    const auto known =
        std::find_if(any_runs_.begin(), any_runs_.end(), [&](const auto& one) { return one->versions == versions; });
    if (known != any_runs_.end()) {
        return (*known)->runs;
    }
    const auto is_kept = [this](std::uint64_t version) {
        return std::any_of(runs_.begin(), runs_.end(), [version](const auto& one) { return one->version == version; });
    };
    any_runs_.erase(std::remove_if(any_runs_.begin(), any_runs_.end(),
                                   [&](const auto& one) {
                                       return !std::all_of(one->versions.begin(), one->versions.end(), is_kept);
                                   }),
                    any_runs_.end());
    any_runs_.push_back(std::make_unique<AnyRuns>(AnyRuns{std::move(versions), VisibleRuns::of_any(runs)}));
    return any_runs_.back()->runs;
}

std::vector<SeenBeside> FieldIndex::seen_beside(std::size_t number, const Scene& scene, const DrawPlan& plan,
                                                const Frame& frame) {
    const std::vector<Group> groups = groups_drawn(scene);
    const std::size_t own = group_drawn_of(scene, number);
    const std::shared_ptr<const Field>& field = scene.fields[number];
    std::vector<SeenBeside> near;
    if (plan.coverage || !plan.culling) {
        return near;
    }
    if (groups[own].use.role == GroupRole::compared && as_regular(field.get()) != nullptr) {
        for (const GroupRange& set : label_sets(groups)) {
            for (std::size_t group = set.first; group < set.last && own >= set.first && own < set.last; ++group) {
                const std::shared_ptr<const Field>& other = scene.fields[groups[group].first];
                if (!lies_alike(field, other)) {
                    return {};
                }
                if (groups[group].use.role == GroupRole::label) {
                    near.push_back({other, 0.0, 0.0, corners_decide(set, groups, scene, plan)});
                }
            }
        }
    }
    if (groups[own].use.role == GroupRole::colors) {
        std::size_t shown = own;
        while (groups[shown].use.role == GroupRole::colors) {
            --shown;
        }
        const std::shared_ptr<const Field>& other = scene.fields[groups[shown].first];
        const VisibilityQuery query = query_of(groups[shown].first, scene, plan, frame);
        const bool alone = query.alone && groups[own].last - groups[own].first == 1;
        if (!alone || plan.filter || (!query.isosurface && shows_at_base(groups[shown])) || !lies_alike(field, other)) {
            return near;
        }
        const VisibleFrom from = visible_from(query);
        const auto first = [](double x) { return x <= std::numeric_limits<double>::denorm_min() ? 0.0 : x; };
        const RegularField* lattice = as_regular(other.get());
        const double weight = lattice != nullptr ? largest_weight(*lattice, query.filter_gain) : 1.0;
        near.push_back({other, first(from.above) / weight, first(from.below) / weight});
    }
    return near;
}

const RunsEntry& FieldIndex::runs_of(std::size_t number, const Scene& scene, const DrawPlan& plan, const Frame& frame) {
    const std::shared_ptr<const Field>& field = scene.fields[number];
    VisibilityQuery query = query_of(number, scene, plan, frame);
    query.only_near = seen_beside(number, scene, plan, frame);
    const std::size_t copy = copies_before(scene, number);
    const auto found = std::find_if(runs_.begin(), runs_.end(), [&](const std::unique_ptr<RunsEntry>& entry) {
        return entry->copy == copy && entry->field.lock() == field;
    });
    if (found != runs_.end()) {
        if ((*found)->decided.answers(query)) {
            return **found;
        }
        query.reach_world = ahead((*found)->decided.query.reach_world, query.reach_world);
        query.filter_gain = ahead((*found)->decided.query.filter_gain, query.filter_gain);
    } else {
        query.reach_world = at_first(query.reach_world, frame);
    }
    query.reach_world *= reach_ahead(plan);
    auto made = std::make_unique<RunsEntry>();
    made->field = field;
    made->copy = copy;
    made->runs = VisibleRuns::of(*as_regular(field.get()), query);
    made->decided = decision_of(query);
    made->version = ++versions_;
    // One index is kept of each field that a scene holds: that of the last scene.
    if (found == runs_.end()) {
        runs_.push_back(std::move(made));
        return *runs_.back();
    }
    if (same_runs((*found)->runs, made->runs)) {
        made->version = (*found)->version;
        made->runs = std::move((*found)->runs);
    }
    *found = std::move(made);
    return **found;
}

GridEntry* FieldIndex::find_grid(const Field* field, std::size_t copy) const {
    for (const auto& entry : grids_) {
        if (entry->copy == copy && entry->field.lock().get() == field) {
            return entry.get();
        }
    }
    return nullptr;
}

const GridEntry& FieldIndex::grid_of(std::size_t number, const Scene& scene, const DrawPlan& plan, const Frame& frame) {
    const std::shared_ptr<const Field>& field = scene.fields[number];
    const std::size_t copy = copies_before(scene, number);
    GridEntry* entry = find_grid(field.get(), copy);
    if (entry == nullptr) {
        auto made = std::make_unique<GridEntry>();
        made->field = field;
        made->copy = copy;
        made->kernels = field->kind() == FieldKind::ellipsoid ? std::static_pointer_cast<const EllipsoidField>(field)
                                                              : scattered(*as_regular(field.get()));
        made->grid = SpatialGrid::of(*made->kernels);
        grids_.push_back(std::move(made));
        entry = grids_.back().get();
    }
    if (can(plan.summary.backend, Ability::start_cells) && !entry->starts &&
        entry->kernels->size() <= most_start_cells) {
        entry->starts = std::make_unique<StartCells>(StartCells::of(*entry->kernels, entry->grid));
    }
    VisibilityQuery query = query_of(number, scene, plan, frame);
    query.only_near = seen_beside(number, scene, plan, frame);
    if (as_ellipsoids(field.get()) == nullptr) {
        // Of a lattice's kernels, one by one, it is not looked for.
        query.only_near.clear();
    }
    if (entry->decided) {
        if (entry->decided->answers(query)) {
            return *entry;
        }
        query.reach_world = ahead(entry->decided->query.reach_world, query.reach_world);
    } else {
        query.reach_world = at_first(query.reach_world, frame);
    }
    query.reach_world *= reach_ahead(plan);
    // Kernels of the same places and sizes matter where the others show.
    const auto at = std::find_if(scene.fields.begin(), scene.fields.end(), [&](const auto& one) {
        return !query.only_near.empty() && one == query.only_near.front().field;
    });
    std::vector<std::uint8_t> visible =
        at != scene.fields.end()
            ? grid_of(static_cast<std::size_t>(at - scene.fields.begin()), scene, plan, frame).visible
            : visible_kernels(*entry->kernels, entry->grid, query);
    if (!entry->decided || visible != entry->visible) {
        entry->visible = std::move(visible);
        entry->visible_count =
            static_cast<std::size_t>(std::count(entry->visible.begin(), entry->visible.end(), std::uint8_t{1}));
        entry->version = ++versions_;
    }
    entry->decided = decision_of(query);
    return *entry;
}

std::array<double, 2> FieldIndex::reach_along(const Field& field, const Vec3& from, const Vec3& direction) const {
    const GridEntry* entry = find_grid(&field, 0);
    const EllipsoidField* kernels = as_ellipsoids(&field);
    if (entry == nullptr || kernels == nullptr) {
        return field.reach_along(from, direction);
    }
    constexpr double infinity = std::numeric_limits<double>::infinity();
    // Rounding of a box's bounds must not hide the kernel that reaches farthest.
    const Box all = kernels->supports_world();
    const double rounding = 1e-12 * (glm::length(all.extent()) + glm::length(all.centre() - from));
    std::array<double, 2> reach{infinity, -infinity};
    for (std::size_t cell = 0; cell < entry->grid.cells(); ++cell) {
        const Box& box = entry->grid.home_supports(cell);
        const double middle = glm::dot(box.centre() - from, direction);
        const double half = 0.5 * glm::dot(box.extent(), glm::abs(direction)) + rounding;
        if (middle - half >= reach[0] && middle + half <= reach[1]) {
            continue;
        }
        for (const std::uint32_t* i = entry->grid.home_begin(cell); i != entry->grid.home_end(cell); ++i) {
            const std::array<double, 2> own = kernels->reach_along(*i, from, direction);
            reach = {std::min(reach[0], own[0]), std::max(reach[1], own[1])};
        }
    }
    return reach;
}

void FieldIndex::forget_others(const std::vector<std::shared_ptr<const Field>>& fields, bool parts) {
    const auto takes_little = [parts](std::size_t bytes, const Field& field) {
        return parts && bytes <= field.memory() / little_of_part;
    };
    keep_fields(runs_, fields,
                [&](const RunsEntry& entry, const Field& field) { return takes_little(entry.runs.bytes(), field); });
    keep_fields(grids_, fields, [&](const GridEntry& entry, const Field& field) {
        return entry.kernels.get() != &field && takes_little(entry.bytes(), field);
    });
}

} // namespace sheetsplat

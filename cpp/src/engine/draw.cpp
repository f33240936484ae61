#include "draw.hpp"

#include <algorithm>
#include <utility>

#include "backend_cpu/cpu_renderer.hpp"
#include "backend_cpu/measured.hpp"
#include "base/memory.hpp"
#include "scene/mode_rules.hpp"
#include "view/ellipsoid_view.hpp"

namespace sheetsplat {

std::vector<EllipsoidView> views_of(const Indexed& indexed, const DrawPlan& plan, const Camera& camera,
                                    const Frame& frame, Sampling sampling) {
    std::vector<EllipsoidView> views;
    views.reserve(indexed.grids.size());
    for (std::size_t part = 0; part < indexed.grids.size(); ++part) {
        views.emplace_back(*indexed.grids[part]->kernels, camera, frame, sampling, filter_of(plan),
                           plan.unit_of(indexed.grid_fields[part]), 1.0);
    }
    return views;
}

std::vector<Twins> find_twins(const std::vector<const GridEntry*>& grids, FieldIndex& index) {
    std::vector<Twins> found;
    std::vector<std::uint8_t> taken(grids.size(), 0);
    for (std::size_t first = 0; first < grids.size(); ++first) {
        for (std::size_t second = first + 1; second < grids.size() && taken[first] == 0; ++second) {
            const GridEntry &one = *grids[first], &other = *grids[second];
            if (taken[second] != 0 || !index.differ_in_values(one.field.lock(), other.field.lock())) {
                continue;
            }
            Twins twins{first, second, {}};
            if (one.visible != other.visible) {
                require_memory(one.visible.size(), "the kernels of two fields", "draw fewer kernels");
                twins.visible.resize(one.visible.size());
                std::transform(one.visible.begin(), one.visible.end(), other.visible.begin(), twins.visible.begin(),
                               [](std::uint8_t a, std::uint8_t b) { return static_cast<std::uint8_t>(a | b); });
            }
            found.push_back(std::move(twins));
            taken[first] = taken[second] = 1;
        }
    }
    return found;
}

std::vector<Rest> find_rests(const Scene& scene, const std::vector<std::size_t>& fields,
                             const std::vector<const RunsEntry*>& runs, FieldIndex& index) {
    std::vector<Rest> found;
    const std::vector<Group> groups = groups_drawn(scene);
    for (const GroupRange& set : label_sets(groups)) {
        std::vector<std::shared_ptr<const Field>> all;
        std::size_t largest = 0, samples = 0;
        for (std::size_t group = set.first; group < set.last; ++group) {
            const std::size_t field = groups[group].first;
            all.push_back(scene.fields[field]);
            const auto part = static_cast<std::size_t>(std::find(fields.begin(), fields.end(), field) - fields.begin());
            if (groups[group].use.role == GroupRole::compared && part < runs.size() &&
                runs[part]->runs.samples() > samples) {
                largest = field;
                samples = runs[part]->runs.samples();
            }
        }
        if (samples > 0) {
            if (const std::optional<std::size_t> layers = index.share_samples(all)) {
                found.push_back({largest, *layers});
            }
        }
    }
    return found;
}

namespace {

/// Of the samples that several lattices draw, at most so many may be drawn by any: else one walk saves too little.
constexpr double most_of_any = 0.85;

/// Whether a lattice is splatted if others like it are: colours may be summed at single points.
bool may_go_together(const Scene& scene, std::size_t field) {
    const std::vector<Group> groups = groups_drawn(scene);
    const std::size_t own = group_drawn_of(scene, field);
    const auto gives_colors = [&](std::size_t group) {
        return group < groups.size() && groups[group].use.role == GroupRole::colors;
    };
    return groups[own].use.role == GroupRole::shown ||
           (gives_colors(own) && (gives_colors(own + 1) || gives_colors(own - 1)));
}

} // namespace

std::vector<Together> find_together(const Scene& scene, const std::vector<std::size_t>& fields, const Indexed& indexed,
                                    FieldIndex& index) {
    std::vector<Together> found;
    std::vector<std::uint8_t> taken(fields.size(), 0);
    for (std::size_t first = 0; first < fields.size(); ++first) {
        Together all{{}, nullptr};
        std::vector<const RunsEntry*> entries;
        std::size_t samples = 0;
        for (std::size_t part = first; part < fields.size() && all.parts.size() <= backend_cpu::most_beside; ++part) {
            const RunsEntry& entry = *indexed.runs[part];
            if (taken[part] == 0 && entry.runs.samples() > 0 && may_go_together(scene, fields[part]) &&
                FieldIndex::have_the_same_kernels(*scene.fields[fields[first]], *scene.fields[fields[part]])) {
                all.parts.push_back(part);
                entries.push_back(&entry);
                samples += entry.runs.samples();
            }
        }
        if (all.parts.size() < 2 || all.parts.front() != first) {
            continue;
        }
        all.runs = &index.runs_of_any(entries);
        if (static_cast<double>(all.runs->samples()) > most_of_any * static_cast<double>(samples)) {
            continue;
        }
        for (const std::size_t part : all.parts) {
            taken[part] = 1;
        }
        found.push_back(std::move(all));
    }
    return found;
}

namespace {

/// Whether the sums of a field's values are divided by those of its weights, in sheets of its own.
bool is_divided_alone(const Scene& scene, std::size_t field) {
    const Group group = groups_drawn(scene)[group_drawn_of(scene, field)];
    return group.last - group.first == 1 && scene.fields[field]->normalization() == Normalization::threshold;
}

} // namespace

backend_cpu::Job cpu_job(const Request& request, const Prepared& prepared, const Indexed& indexed,
                         const std::vector<FieldView>& lattices, const std::vector<EllipsoidView>& scattered,
                         const Camera& camera, const Frame& frame, const DrawPlan& plan, bool one_walk) {
    backend_cpu::Job job;
    std::vector<const Together*> walked_with(lattices.size(), nullptr);
    for (const Together& together : indexed.together) {
        for (const std::size_t part : together.parts) {
            walked_with[part] = one_walk && backend_cpu::sums_values_alone(plan) ? &together : nullptr;
        }
    }
    for (std::size_t part = 0; part < lattices.size(); ++part) {
        const std::size_t field = prepared.view_fields[part];
        const auto rest = std::find_if(indexed.rests.begin(), indexed.rests.end(),
                                       [field](const Rest& one) { return one.field == field; });
        if (rest != indexed.rests.end() && backend_cpu::finds_rests(plan, lattices[part])) {
            job.rests.push_back({field, &lattices[part], &indexed.runs[part]->runs, rest->layers});
            continue;
        }
        const Together* all = walked_with[part];
        if (all != nullptr && all->parts.front() != part) {
            continue;
        }
        const VisibleRuns* own = &indexed.runs[part]->runs;
        backend_cpu::RegularPart& made =
            job.regular.emplace_back(backend_cpu::RegularPart{field, &lattices[part], own, own, {}});
        if (all != nullptr) {
            made.runs = all->runs;
            for (std::size_t other = 1; other < all->parts.size(); ++other) {
                const std::size_t number = all->parts[other];
                made.beside.push_back({prepared.view_fields[number], &lattices[number], &indexed.runs[number]->runs});
            }
        }
    }
    std::vector<const Twins*> twins_of(scattered.size(), nullptr);
    for (const Twins& twins : indexed.twins) {
        if (!plan.analytic_gradient && is_divided_alone(request.scene, prepared.ellipsoid_fields[twins.first]) &&
            is_divided_alone(request.scene, prepared.ellipsoid_fields[twins.second])) {
            twins_of[twins.first] = twins_of[twins.second] = &twins;
        }
    }
    for (std::size_t part = 0; part < scattered.size(); ++part) {
        const Twins* twins = twins_of[part];
        if (twins != nullptr && twins->second == part) {
            continue;
        }
        const GridEntry& entry = *indexed.grids[part];
        backend_cpu::EllipsoidPart& made = job.ellipsoids.emplace_back();
        made = {prepared.ellipsoid_fields[part], entry.kernels, &scattered[part], &entry.visible, entry.version, {}};
        if (twins != nullptr) {
            made.visible = twins->visible.empty() ? &entry.visible : &twins->visible;
            made.beside = {prepared.ellipsoid_fields[twins->second], &scattered[twins->second],
                           indexed.grids[twins->second]->version};
        }
    }
    job.scene = &request.scene;
    job.camera = &camera;
    job.frame = &frame;
    job.plan = &plan;
    job.tile_size = request.options.tile_size;
    job.threads = request.options.threads;
    job.progress = &request.progress;
    return job;
}

} // namespace sheetsplat

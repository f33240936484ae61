#include "draw.hpp"

#include <algorithm>
#include <utility>

#include "backend_cpu/cpu_renderer.hpp"
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

/// Whether the sums of a field's values are divided by those of its weights, in sheets of its own.
bool is_divided_alone(const Scene& scene, std::size_t field) {
    const Group group = groups_drawn(scene)[group_drawn_of(scene, field)];
    return group.last - group.first == 1 && scene.fields[field]->normalization() == Normalization::threshold;
}

} // namespace

backend_cpu::Job cpu_job(const Request& request, const Prepared& prepared, const Indexed& indexed,
                         const std::vector<FieldView>& lattices, const std::vector<EllipsoidView>& scattered,
                         const Camera& camera, const Frame& frame, const DrawPlan& plan) {
    backend_cpu::Job job;
    for (std::size_t part = 0; part < lattices.size(); ++part) {
        const std::size_t field = prepared.view_fields[part];
        const auto rest = std::find_if(indexed.rests.begin(), indexed.rests.end(),
                                       [field](const Rest& one) { return one.field == field; });
        if (rest != indexed.rests.end() && backend_cpu::finds_rests(plan, lattices[part])) {
            job.rests.push_back({field, &lattices[part], &indexed.runs[part]->runs, rest->layers});
        } else {
            job.regular.push_back({field, &lattices[part], &indexed.runs[part]->runs});
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

#include "draw.hpp"

#include <algorithm>

#include "backend_cpu/cpu_renderer.hpp"
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

backend_cpu::Job cpu_job(const Request& request, const Prepared& prepared, const Indexed& indexed,
                         const std::vector<FieldView>& lattices, const std::vector<EllipsoidView>& scattered,
                         const Camera& camera, const Frame& frame, const DrawPlan& plan) {
    backend_cpu::Job job;
    for (std::size_t part = 0; part < lattices.size(); ++part) {
        job.regular.push_back({prepared.view_fields[part], &lattices[part], &indexed.runs[part]->runs});
    }
    for (std::size_t part = 0; part < scattered.size(); ++part) {
        const GridEntry& entry = *indexed.grids[part];
        job.ellipsoids.push_back(
            {prepared.ellipsoid_fields[part], entry.kernels, &scattered[part], &entry.visible, entry.version});
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

#include "draw.hpp"

#include <algorithm>

#include "backend_cpu/cpu_renderer.hpp"
#include "backend_gl/gl_renderer.hpp"
#include "base/clock.hpp"
#include "base/poll.hpp"
#include "reference/reference.hpp"
#include "view/cell_walk.hpp"
#include "view/ellipsoid_view.hpp"
#include "view/slab_batches.hpp"

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

void draw_on_reference(const Request& request, Image& image) {
    const auto drawing = Clock::now();
    reference::Request asked;
    asked.coverage = request.outputs.coverage;
    asked.depth = request.outputs.depth;
    asked.progress = request.progress;
    const reference::Picture picture = reference::render(request.scene, request.camera, request.size, asked);
    const auto to_float = [](const std::vector<double>& from) {
        std::vector<float> to(from.size());
        std::transform(from.begin(), from.end(), to.begin(), [](double value) { return static_cast<float>(value); });
        return to;
    };
    image.rgba = to_float(picture.rgba);
    image.scalar = to_float(picture.scalar);
    image.coverage = to_float(picture.coverage);
    image.depth = to_float(picture.depth);
    if (request.scene.part) {
        image.counts = to_float(picture.counts);
    }
    image.stats["kernels_drawn"] = static_cast<double>(picture.kernels_drawn);
    image.stats["seconds_draw"] = seconds_since(drawing);
}

void draw_on_gl(backend_gl::GlRenderer& renderer, const Request& request, const Prepared& prepared,
                const Indexed& indexed, Image& image, std::vector<float>& doubts) {
    const auto viewing = Clock::now();
    const backend_gl::Setup setup = backend_gl::set_up(prepared.plan, request.scene, renderer.capabilities());
    const DrawPlan& plan = setup.plan;
    backend_gl::Job job;
    job.layout = setup.layout;
    std::size_t drawn = 0, bytes = 0;
    std::vector<SlabBatches> batches;
    batches.reserve(indexed.runs.size());
    for (std::size_t part = 0; part < indexed.runs.size(); ++part) {
        batches.push_back(SlabBatches::of(prepared.views[part], indexed.runs[part]->runs, prepared.frame,
                                          request.scene.sampling, job.layout, plan.fine_along ? 1 : 0));
        drawn += batches.back().kernels();
        bytes += batches.back().bytes();
        job.regular.push_back({prepared.view_fields[part], &prepared.views[part], &batches.back()});
    }
    const int wider = plan.fine_gradient ? 1 : 0;
    const bool may_narrow = plan.packing == Packing::wide && !plan.fine_gradient;
    const std::vector<EllipsoidView> views =
        views_of(indexed, plan, request.camera, prepared.frame, request.scene.sampling);
    std::vector<CellTraversal> traversals;
    traversals.reserve(views.size());
    for (std::size_t part = 0; part < views.size(); ++part) {
        const GridEntry& entry = *indexed.grids[part];
        traversals.push_back(CellTraversal::of(views[part], entry.grid, entry.starts.get(), entry.visible, job.layout,
                                               wider, wider, may_narrow, setup.largest_sprite, plan.precise_aspect));
        drawn += traversals.back().kernels();
        bytes += traversals.back().bytes();
        job.ellipsoids.push_back({prepared.ellipsoid_fields[part], entry.kernels, &views[part], &traversals.back()});
    }
    image.stats["seconds_view"] = seconds_since(viewing);

    job.scene = &request.scene;
    job.camera = &request.camera;
    job.frame = &prepared.frame;
    job.plan = &plan;
    job.tile_size = request.options.tile_size;
    job.tags_per_clear = request.options.tags_per_clear;
    job.volumes = &indexed.volumes;
    job.progress = &request.progress;
    job.doubts = &doubts;
    renderer.render(job, image);
    image.stats["kernels_drawn"] = static_cast<double>(drawn);
    image.stats["bytes_view"] = static_cast<double>(bytes);
}

void draw_on_cpu(backend_cpu::CpuRenderer& renderer, const Request& request, const Prepared& prepared,
                 const Indexed& indexed, Image& image) {
    const auto viewing = Clock::now();
    const std::vector<EllipsoidView> scattered =
        views_of(indexed, prepared.plan, request.camera, prepared.frame, request.scene.sampling);
    backend_cpu::Job job =
        cpu_job(request, prepared, indexed, prepared.views, scattered, request.camera, prepared.frame, prepared.plan);
    job.volumes = &indexed.volumes;
    if (request.excerpt != nullptr) {
        job.tile_size = request.excerpt->edge;
        job.drawn_tiles = &request.excerpt->drawn;
    }
    image.stats["seconds_view"] = seconds_since(viewing);
    // Short pictures end before the first poll.
    report_progress(request.progress, 0.0);
    renderer.render(job, image);
    report_progress(request.progress, 1.0);
}

} // namespace sheetsplat

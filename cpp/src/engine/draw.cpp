#include "draw.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "backend_cpu/cpu_renderer.hpp"
#include "backend_cpu/measured.hpp"
#include "backend_cpu/tile_feed.hpp"
#include "plan/limits_common.hpp"
#include "view/ellipsoid_view.hpp"

namespace sheetsplat {

namespace {

/// Calls visit(element of a picture, how many) for each row of a tile.
template <class Visit>
void for_each_row(const backend_cpu::TileShape& shape, Size size, const Visit& visit) {
    for (int y = shape.y; y < shape.y + shape.height; ++y) {
        visit(static_cast<std::size_t>(y) * static_cast<std::size_t>(size.width) + static_cast<std::size_t>(shape.x),
              static_cast<std::size_t>(shape.width));
    }
}

} // namespace

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

Excerpt doubtful_tiles(const DrawPlan& plan, Size size, const std::vector<float>& doubts) {
    const backend_cpu::TileLayout layout(size, backend_cpu::usual_tile);
    std::vector<double> errors(layout.tiles(), 0.0);
    for (std::size_t tile = 0; tile < layout.tiles() && !doubts.empty(); ++tile) {
        const backend_cpu::TileShape shape = layout.shape(tile);
        double sum = 0.0;
        for_each_row(shape, size, [&](std::size_t from, std::size_t count) {
            const auto row = doubts.begin() + static_cast<std::ptrdiff_t>(from);
            sum += std::accumulate(row, row + static_cast<std::ptrdiff_t>(count), 0.0);
        });
        errors[tile] = plan.lit_rounding * float32_epsilon * std::sqrt(sum / shape.pixels());
    }
    Excerpt excerpt{backend_cpu::usual_tile, backend_cpu::doubtful_tiles(layout, errors, plan.bound)};
    for (std::size_t tile = 0; tile < layout.tiles(); ++tile) {
        excerpt.pixels += excerpt.drawn[tile] != 0 ? layout.shape(tile).pixels() : 0.0;
        excerpt.tiles += excerpt.drawn[tile];
    }
    return excerpt;
}

void copy_tiles(const Image& from, const Excerpt& excerpt, Size size, Image& to) {
    const backend_cpu::TileLayout layout(size, excerpt.edge, excerpt.drawn);
    for (std::size_t tile = 0; tile < layout.tiles(); ++tile) {
        if (!layout.draws(tile)) {
            continue;
        }
        for_each_row(layout.shape(tile), size, [&](std::size_t first, std::size_t count) {
            const auto copy = [&](const std::vector<float>& source, std::vector<float>& target, std::size_t channels) {
                if (!target.empty()) {
                    const auto begin = source.begin() + static_cast<std::ptrdiff_t>(first * channels);
                    std::copy(begin, begin + static_cast<std::ptrdiff_t>(count * channels),
                              target.begin() + static_cast<std::ptrdiff_t>(first * channels));
                }
            };
            copy(from.rgba, to.rgba, 4);
            copy(from.coverage, to.coverage, 1);
            copy(from.depth, to.depth, 1);
        });
    }
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

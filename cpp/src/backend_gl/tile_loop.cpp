#include "tile_loop.hpp"

#include <vector>

#include "division_pass.hpp"
#include "papers/copy_pass.hpp"
#include "scene/mode_rules.hpp"

namespace sheetsplat::backend_gl {

namespace {

/// The picture of a tile, with its border, that holds nothing but the opacity in front of a part.
std::vector<float> in_front(const std::vector<float>& opacities, Size size, const Tile& tile) {
    std::vector<float> rgba(4 * static_cast<std::size_t>(tile.target_width()) *
                            static_cast<std::size_t>(tile.target_height()));
    for (int y = 0; y < tile.height; ++y) {
        for (int x = 0; x < tile.width; ++x) {
            const std::size_t to =
                static_cast<std::size_t>(y + Tile::border) * static_cast<std::size_t>(tile.target_width()) +
                static_cast<std::size_t>(x + Tile::border);
            rgba[4 * to + 3] = opacities[static_cast<std::size_t>(tile.y + y) * static_cast<std::size_t>(size.width) +
                                         static_cast<std::size_t>(tile.x + x)];
        }
    }
    return rgba;
}

} // namespace

TileLoop::TileLoop(const TileScope& scope, const Classification* classification)
    : scope_(scope), touched_(scope), opacity_(scope), splatting_(scope, touched_, opacity_), lattices_(splatting_),
      ellipsoids_(splatting_), shading_(scope, classification) {}

void TileLoop::run(const std::function<void(double)>& progress) {
    const Targets& targets = scope_.targets;
    const bool wide = targets.shape().wide;
    const std::int64_t passes = scope_.steps.passes;
    scope_.gl.Viewport(0, 0, scope_.tile.target_width(), scope_.tile.target_height());
    // Slabs before the first one are read, but no pass divides them: there rho is 0.
    const Scene& scene = *scope_.job.scene;
    const std::vector<double> pivots = group_pivots(scope_.plan, scene);
    std::vector<float> empty;
    for (const Group& group : groups_drawn(scene)) {
        empty.push_back(-static_cast<float>(pivots[empty.size()] / scope_.plan.unit_of(group.first)));
    }
    targets.clear_all(empty);
    if (scene.part && scene.part->in_front && !is_scalar(scene.mode)) {
        targets.start_behind(in_front(*scene.part->in_front, scope_.frame.size, scope_.tile));
    }
    // Slabs that no batch was drawn to yet stay clear: those before the first slice and after the last.
    for (std::int64_t pass = 0; pass < passes; ++pass) {
        touched_.next_batch();
        splat(pass);
        if (!wide) {
            copy_finished_slab(scope_, pass);
        }
        if (scope_.hooks.shades()) {
            divide_own_sheets(scope_, pass);
            shading_.shade(touched_, pass);
        }
        if (wide) {
            targets.clear_sheet(scope_.sheet_of(pass + 2));
        }
        if (scope_.plan.elimination && (wide || pass % 4 == 3)) {
            touched_.eliminate();
        }
        touched_.end_batch();
        opacity_.update(pass);
        progress(static_cast<double>(pass + 1) / static_cast<double>(passes));
    }
}

void TileLoop::splat(std::int64_t pass) {
    touched_.begin_splats();
    scope_.hooks.before_splats();
    for (std::size_t part = 0; part < scope_.job.regular.size(); ++part) {
        lattices_.splat(part, pass);
    }
    for (std::size_t part = 0; part < scope_.job.ellipsoids.size(); ++part) {
        if (scope_.plan.paper_slicing) {
            scope_.resources.paper_slicing().splat(splatting_, part, pass);
        } else if (!scope_.hooks.splat_ellipsoids(splatting_, part, pass)) {
            ellipsoids_.splat(part, pass);
        }
    }
    scope_.hooks.after_splats();
}

} // namespace sheetsplat::backend_gl

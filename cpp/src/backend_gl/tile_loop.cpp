#include "tile_loop.hpp"

#include <vector>

#include "division_pass.hpp"
#include "papers/copy_pass.hpp"
#include "scene/mode_rules.hpp"

namespace sheetsplat::backend_gl {

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

#include "tile_loop.hpp"

#include <vector>

#include "division_pass.hpp"
#include "papers/copy_pass.hpp"
#include "scene/mode_rules.hpp"

namespace sheetsplat::backend_gl {

namespace {

/// Where fields have sheets of their own, those of a group hold rho.
std::vector<float> empty_values(const TileScope& scope) {
    std::vector<float> empty;
    if (!scope.plan.own_sheets.empty()) {
        const Scene& scene = *scope.job.scene;
        const std::vector<double> pivots = group_pivots(scope.plan, scene);
        for (const Group& group : groups_drawn(scene)) {
            empty.push_back(-static_cast<float>(pivots[empty.size()] / scope.plan.unit_of(group.first)));
        }
    }
    return empty;
}

} // namespace

TileLoop::TileLoop(const TileScope& scope, const Classification* classification)
    : scope_(scope), empty_(empty_values(scope)), touched_(scope), opacity_(scope),
      splatting_(scope, touched_, opacity_), lattices_(splatting_), ellipsoids_(splatting_),
      shading_(scope, classification) {}

void TileLoop::run(const std::function<void(double)>& progress) {
    const Targets& targets = scope_.targets;
    const bool wide = targets.shape().wide;
    const std::int64_t passes = scope_.steps.passes;
    scope_.gl.Viewport(0, 0, scope_.tile.target_width(), scope_.tile.target_height());
    start_picture(scope_);
    // Slabs before the first one are read, but no pass divides them.
    fill_before(0);
    // Passes since something was splatted. Once no slab holds any of it, nothing is shaded until something is again.
    const std::int64_t until_empty = scope_.steps.history + scope_.steps.slabs / scope_.steps.stride;
    std::int64_t since = 0;
    const auto report = [&](std::int64_t pass) {
        progress(static_cast<double>(pass + 1) / static_cast<double>(passes));
    };
    // Slabs that no batch was drawn to yet stay clear: those before the first slice and after the last.
    for (std::int64_t pass = 0; pass < passes; ++pass) {
        touched_.next_batch();
        const bool splatted = splat(pass);
        if (splatted && since > until_empty) {
            fill_before(pass);
        }
        since = splatted ? 0 : since + 1;
        if (since > until_empty) {
            if (since == until_empty + 1) {
                targets.clear_sheets();
            }
            report(pass);
            continue;
        }
        ++shaded_;
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
        report(pass);
    }
}

void TileLoop::fill_before(std::int64_t pass) const {
    scope_.targets.fill(scope_.targets.shape().wide ? scope_.sheet_of(pass + 2) : 1, empty_);
}

bool TileLoop::splat(std::int64_t pass) {
    const std::size_t drawn = splatting_.drawn;
    bool by_hooks = false;
    touched_.begin_splats();
    scope_.hooks.before_splats();
    for (std::size_t part = 0; part < scope_.job.regular.size(); ++part) {
        lattices_.splat(part, pass);
    }
    for (std::size_t part = 0; part < scope_.job.ellipsoids.size(); ++part) {
        if (scope_.plan.paper_slicing) {
            scope_.resources.paper_slicing().splat(splatting_, part, pass);
        } else if (scope_.hooks.splat_ellipsoids(splatting_, part, pass)) {
            by_hooks = true;
        } else {
            ellipsoids_.splat(part, pass);
        }
    }
    scope_.hooks.after_splats();
    return by_hooks || splatting_.drawn > drawn;
}

} // namespace sheetsplat::backend_gl

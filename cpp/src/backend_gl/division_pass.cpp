#include "division_pass.hpp"

#include "interop.h"
#include "scene/mode_rules.hpp"

namespace sheetsplat::backend_gl {

void divide_own_sheets(const TileScope& scope, std::int64_t pass) {
    const Targets& targets = scope.targets;
    if (targets.shape().own == 0) {
        return;
    }
    const gl::Api& gl = scope.gl;
    const bool wide = targets.shape().wide;
    const int sheet_number = scope.sheet_of(pass);
    gl.Disable(GL_DEPTH_TEST);
    gl.DepthMask(GL_FALSE);
    ShaderVariant variant{"rectangle.vert", "resolve.frag", {}, {"sheet_sum"}};
    const bool slopes = splats_slopes(scope.plan);
    if (slopes) {
        variant.defines["SLOPES"] = "1";
        variant.outputs.insert(variant.outputs.end(), {"x_sum", "y_sum", "z_sum"});
    }
    if (scope.plan.weight) {
        variant.defines["WEIGHT"] = "1";
        variant.outputs.emplace_back("weight_sum");
    }
    const gl::Program& program = scope.resources.program(variant);
    for (std::size_t field = 0; field < scope.plan.own_sheets.size(); ++field) {
        const int own = scope.plan.own_sheets[field];
        if (own < 0) {
            continue;
        }
        wide ? scope.write_all_channels() : scope.write_channel(scope.channel_of(pass));
        gl.Enable(GL_BLEND);
        gl.BlendFunc(GL_ONE, GL_ONE);
        targets.bind_sum(group_drawn_of(*scope.job.scene, field), wide ? sheet_number : 1);
        program.use();
        const Sheet& sheet = targets.own_sheet(own, sheet_number);
        sheet.bind(program, "front");
        const TileScope::Division division = scope.division_of(field);
        program.set("w0", division.w0);
        program.set("pivot", division.pivot);
        program.set("half_range", division.half_range);
        program.set("least_weight", division.least_weight);
        scope.draw_targets(program);
        targets.clear_own(own, sheet_number);
    }
    scope.write_all_channels();
}

} // namespace sheetsplat::backend_gl

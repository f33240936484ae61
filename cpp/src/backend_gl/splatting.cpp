#include "splatting.hpp"

#include <cmath>

namespace sheetsplat::backend_gl {

namespace {

constexpr double log2_e = 1.4426950408889634;

} // namespace

double sprite_margin(const Capabilities& capabilities) { return 4.0 * std::exp2(-capabilities.subpixel_bits); }

Splatting::Splatting(const TileScope& scope_, TouchedPixels& touched, const OpacityCulling& opacity)
    : scope(scope_), touched_(touched), opacity_(opacity) {
    for (const EllipsoidPart& part : scope.job.ellipsoids) {
        active_.emplace_back(*part.traversal);
    }
}

bool Splatting::counts(const PixelBox& box) {
    if (opacity_.hides(box)) {
        ++dropped;
        return false;
    }
    touched_.touch(box);
    return true;
}

void Splatting::for_each_active(std::size_t part, const std::function<void(std::size_t, const PixelBox&)>& visit) {
    const auto& cells = scope.job.ellipsoids[part].traversal->cells();
    for (const std::size_t number : active_[part].next()) {
        const PixelBox box = EllipsoidView::pixels(cells[number].bounds, scope.frame, scope.tile, 0);
        if (box.empty()) {
            continue;
        }
        if (opacity_.hides(box)) {
            dropped += cells[number].end - cells[number].begin;
            continue;
        }
        touched_.touch(box);
        visit(number, box);
    }
}

void Splatting::bind_target(const SplatTarget& target, std::int64_t pass) const {
    scope.targets.bind_splat(target.own, target.group, scope.sheet_of(pass), target.weights_alone, target.narrow);
}

const gl::Program& Splatting::use(const char* vertex, const char* fragment, gl::Defines defines,
                                  const SplatTarget& target, const Kernel& kernel, std::int64_t first_slab) const {
    ShaderVariant variant{vertex, fragment, std::move(defines), splat_outputs(scope.plan, target)};
    scope.hooks.adjust_splats(variant);
    const gl::Program& program = scope.resources.program(variant);
    program.use();
    program.set("falloff_log2", static_cast<float>(kernel.falloff * log2_e));
    program.set("edge", static_cast<float>(kernel.edge()));
    program.set("falloff_root", static_cast<float>(std::sqrt(kernel.falloff)));
    program.set("tag", touched_.splat_depth());
    scope.set_target_size(program);
    set_offsets(program, first_slab);
    return program;
}

void Splatting::set_offsets(const gl::Program& program, std::int64_t first_slab) const {
    const auto front = channel_offsets(scope.job.layout, first_slab);
    program.set("offset_front", front[0], front[1], front[2], front[3]);
    program.set("offset_back", front[0] + 4.0F, front[1] + 4.0F, front[2] + 4.0F, front[3] + 4.0F);
    if (scope.plan.projection == Projection::perspective) {
        const auto depth = [&](std::size_t channel, float more) {
            return static_cast<float>(scope.frame.depth_of(first_slab) +
                                      static_cast<double>(front[channel] + more) * scope.frame.slice_spacing);
        };
        program.set("depth_front", depth(0, 0.0F), depth(1, 0.0F), depth(2, 0.0F), depth(3, 0.0F));
        program.set("depth_back", depth(0, 4.0F), depth(1, 4.0F), depth(2, 4.0F), depth(3, 4.0F));
        program.set("slice_spacing", static_cast<float>(scope.frame.slice_spacing));
    }
}

SlabPass Splatting::slab_pass(std::int64_t pass) const {
    SlabPass slabs;
    slabs.first_slab = scope.first_slab_of_batch(pass);
    slabs.axis_x = scope.axis_x();
    slabs.axis_y = scope.axis_y();
    slabs.target_width = scope.tile.target_width();
    slabs.target_height = scope.tile.target_height();
    slabs.tag = touched_.splat_depth();
    slabs.margin = sprite_margin(scope.capabilities);
    return slabs;
}

} // namespace sheetsplat::backend_gl

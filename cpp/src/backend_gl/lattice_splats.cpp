#include "lattice_splats.hpp"

#include <algorithm>
#include <cmath>

#include "base/clock.hpp"
#include "interop.h"

namespace sheetsplat::backend_gl {

namespace {

constexpr double log2_e = 1.4426950408889634;
float f(double value) { return static_cast<float>(value); }

} // namespace

LatticeSplats::LatticeSplats(Splatting& splatting) : splatting_(splatting), scope_(splatting.scope) {
    for (const RegularPart& part : scope_.job.regular) {
        makers_.emplace_back(*part.view, scope_.frame, scope_.tile, scope_.job.layout,
                             scope_.plan.fine_gradient ? 1 : 0, scope_.counting[part.field]);
    }
}

void LatticeSplats::splat(std::size_t part, std::int64_t pass) {
    const SlabBatches& batches = *scope_.job.regular[part].batches;
    if (pass >= static_cast<std::int64_t>(batches.batches())) {
        return;
    }
    const auto batch = static_cast<std::size_t>(pass);
    const std::size_t count = batches.count(batch);
    if (count == 0) {
        return;
    }
    const std::int64_t first_slab = scope_.first_slab_of_batch(pass);
    const FieldView& view = *scope_.job.regular[part].view;
    const VertexMaker& maker = makers_[part];
    const bool boxed = scope_.plan.projection == Projection::perspective;
    gl::Buffer& samples = scope_.resources.samples;
    const auto started = Clock::now();
    auto* vertices = static_cast<SplatVertex*>(samples.map_next(count * sizeof(SplatVertex)));
    auto* boxes = boxed ? static_cast<PixelBox*>(scope_.resources.boxes.map_next(count * sizeof(PixelBox))) : nullptr;
    const std::size_t made = maker.make(batches.begin(batch), count, first_slab, vertices, boxes,
                                        [&](const PixelBox& box, std::uint32_t) { return splatting_.counts(box); });
    samples.unmap();
    if (boxed) {
        scope_.resources.boxes.unmap();
    }
    splatting_.vertex_seconds += seconds_since(started);
    if (made == 0) {
        return;
    }
    splatting_.drawn += made;
    splatting_.for_each_target(scope_.job.regular[part].field, false, [&](const SplatTarget& target) {
        splatting_.bind_target(target, pass);
        draw(splatting_.use("splat.vert", "splat.frag", splat_defines(scope_.plan, view, target), target,
                            view.field->kernel(), first_slab),
             view, maker, first_slab, made);
    });
}

void LatticeSplats::bind_attributes(std::size_t first) const {
    const Resources& resources = scope_.resources;
    resources.splat_array.bind();
    resources.samples.attribute(ATTRIBUTE_SAMPLE, 4, GL_FLOAT, sizeof(SplatVertex), first * sizeof(SplatVertex),
                                scope_.plan.points ? 0 : 1);
    if (scope_.plan.projection == Projection::perspective) {
        resources.boxes.attribute(ATTRIBUTE_BOX, 4, GL_INT, sizeof(PixelBox), first * sizeof(PixelBox), 1);
    } else {
        scope_.gl.DisableVertexAttribArray(ATTRIBUTE_BOX);
    }
}

void LatticeSplats::draw(const gl::Program& program, const FieldView& view, const VertexMaker& maker,
                         std::int64_t first_slab, std::size_t count) const {
    const Frame& frame = scope_.frame;
    const double radius_px = view.extent_x / frame.pixel;
    program.set("falloff_px", f(-view.field->kernel().falloff * log2_e / (radius_px * radius_px)));
    program.set("slab_half", f(0.5 * frame.slice_spacing / view.half_depth));
    program.set("step_s", f(frame.slice_spacing / view.half_depth));
    program.set("weight_scale", f(view.weight_scale));
    program.set("axis", f(maker.origin_x()), f(maker.origin_y()));
    program.set("shear", f(view.shear.x), f(view.shear.y));
    // Rows count downwards, eye y upwards.
    program.set_matrix2("to_unit", f(view.to_unit[0].x * frame.pixel), f(view.to_unit[0].y * frame.pixel),
                        f(-view.to_unit[1].x * frame.pixel), f(-view.to_unit[1].y * frame.pixel));
    if (scope_.plan.projection == Projection::perspective) {
        program.set("half_depth", f(view.half_depth));
        program.set("first_depth", f(frame.depth_of(first_slab)));
        program.set("last_offset", f(scope_.job.layout.covered - 1));
    }
    if (scope_.plan.points) {
        program.set("point_size", f(2.0 * maker.half_size() + sprite_margin(scope_.capabilities)));
        splatting_.draw_points(program, static_cast<int>(std::ceil(maker.half_size())) + 1, [&] {
            bind_attributes(0);
            splatting_.in_calls(count, [&](std::size_t first, std::size_t now) {
                scope_.gl.DrawArrays(GL_POINTS, static_cast<GLint>(first), static_cast<GLsizei>(now));
            });
        });
        return;
    }
    program.set("half_size", f(maker.half_x()), f(maker.half_y()));
    splatting_.in_calls(count, [&](std::size_t first, std::size_t now) {
        bind_attributes(first);
        scope_.gl.DrawArraysInstanced(GL_TRIANGLE_STRIP, 0, 4, static_cast<GLsizei>(now));
    });
}

} // namespace sheetsplat::backend_gl

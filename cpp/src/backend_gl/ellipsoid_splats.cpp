#include "ellipsoid_splats.hpp"

#include <algorithm>
#include <cmath>

#include "base/clock.hpp"
#include "interop.h"

namespace sheetsplat::backend_gl {

namespace {

/// Records of one draw call: 16 MiB.
constexpr std::size_t records_at_once = 1U << 18;

float f(double value) { return static_cast<float>(value); }

} // namespace

EllipsoidSplats::EllipsoidSplats(Splatting& splatting) : splatting_(splatting), scope_(splatting.scope) {
    for (const EllipsoidPart& part : scope_.job.ellipsoids) {
        walks_.emplace_back(*part.traversal);
    }
}

void EllipsoidSplats::splat(std::size_t part, std::int64_t pass) {
    const Frame& frame = scope_.frame;
    const BatchLayout& layout = scope_.job.layout;
    const EllipsoidView& view = *scope_.job.ellipsoids[part].view;
    const std::int64_t first_slab = scope_.first_slab_of_batch(pass);
    const int wider = scope_.plan.fine_gradient ? 1 : 0;
    const std::int64_t last_slab = std::min<std::int64_t>(first_slab + layout.covered, frame.slices) - 1;
    const std::int64_t last_narrow = std::min<std::int64_t>(first_slab + layout.stride, frame.slices) - 1;
    const double front = view.front_of(first_slab - wider);
    const double back = view.back_of(last_slab + wider);
    const double back_narrow = view.back_of(last_narrow + wider);
    const auto pixels = [&](const EllipsoidView::ScreenBounds& bounds) {
        return EllipsoidView::pixels(bounds, frame, scope_.tile, wider);
    };
    const auto counts = [&](const PixelBox& box) { return !box.empty() && splatting_.counts(box); };
    const Counting& counting = scope_.counting[scope_.job.ellipsoids[part].field];
    const auto started = Clock::now();
    walks_[part].next([&](const EllipsoidView::ScreenBounds& bounds) { return splatting_.hides(pixels(bounds)); },
                      [&](const CellTraversal::Entry& entry) {
                          const bool narrow = entry.narrow != 0U;
                          const std::size_t number = entry.group + (narrow ? section_groups : 0);
                          Gathered& gathered = groups_[number];
                          const double behind = narrow ? back_narrow : back;
                          if (scope_.plan.resident_sections) {
                              if (counts(pixels(view.support_bounds(entry.kernel, front, behind)))) {
                                  gathered.indices.push_back(entry.kernel);
                              }
                              return;
                          }
                          const EyeKernel kernel = view.kernel(entry.kernel);
                          if (!counts(pixels(view.bounds(kernel, front, behind)))) {
                              return;
                          }
                          // Anchored where it is needed, a record keeps its digits.
                          const std::int64_t anchor = view.anchor(kernel, first_slab, narrow ? last_narrow : last_slab);
                          SectionRest* rest = is_precise(static_cast<SectionGroup>(entry.group))
                                                  ? &gathered.rests.emplace_back()
                                                  : nullptr;
                          gathered.records.push_back(view.record(entry.kernel, kernel, anchor, rest, counting));
                          if (gathered.records.size() == records_at_once) {
                              draw_group(part, number, pass);
                          }
                      });
    splatting_.vertex_seconds += seconds_since(started);
    for (std::size_t number = 0; number < groups_.size(); ++number) {
        draw_group(part, number, pass);
    }
}

void EllipsoidSplats::draw_group(std::size_t part, std::size_t number, std::int64_t pass) {
    const EllipsoidPart& ellipsoids = scope_.job.ellipsoids[part];
    Gathered& gathered = groups_[number];
    const std::size_t count = gathered.records.size() + gathered.indices.size();
    if (count == 0) {
        return;
    }
    splatting_.drawn += count;
    splatting_.for_each_target(ellipsoids.field, number >= section_groups, [&](const SplatTarget& target) {
        draw(*ellipsoids.view, gathered, static_cast<SectionGroup>(number % section_groups), target, pass);
    });
    gathered.records.clear();
    gathered.rests.clear();
    gathered.indices.clear();
}

void EllipsoidSplats::bind_attributes(SectionGroup group, std::size_t first) const {
    const gl::Api& gl = scope_.gl;
    const Resources& resources = scope_.resources;
    const GLuint divisor = group == SectionGroup::sprite ? 0 : 1;
    constexpr std::size_t quarter = 4 * sizeof(float);
    for (GLuint rest = 0; rest < 3; ++rest) {
        if (is_precise(group)) {
            resources.rests.attribute(ATTRIBUTE_REST_HEIGHTS + rest, 4, GL_FLOAT, sizeof(SectionRest),
                                      first * sizeof(SectionRest) + rest * quarter, 1);
        } else {
            gl.DisableVertexAttribArray(ATTRIBUTE_REST_HEIGHTS + rest);
        }
    }
    if (scope_.plan.resident_sections) {
        resources.records.bind();
        gl.EnableVertexAttribArray(ATTRIBUTE_RECORD_INDEX);
        gl.VertexAttribIPointer(
            ATTRIBUTE_RECORD_INDEX, 1, GL_UNSIGNED_INT, sizeof(std::uint32_t),
            reinterpret_cast<const void*>(resources.records.offset() + first * sizeof(std::uint32_t)));
        gl.VertexAttribDivisor(ATTRIBUTE_RECORD_INDEX, divisor);
        for (GLuint other = 1; other < 4; ++other) {
            gl.DisableVertexAttribArray(ATTRIBUTE_RECORD_PLACE + other);
        }
        return;
    }
    for (GLuint part = 0; part < 4; ++part) {
        resources.records.attribute(ATTRIBUTE_RECORD_PLACE + part, 4, GL_FLOAT, sizeof(SectionRecord),
                                    first * sizeof(SectionRecord) + part * quarter, divisor);
    }
}

void EllipsoidSplats::draw(const EllipsoidView& view, const Gathered& gathered, SectionGroup group,
                           const SplatTarget& target, std::int64_t pass) const {
    const Frame& frame = scope_.frame;
    const DrawPlan& plan = scope_.plan;
    const std::int64_t first_slab = scope_.first_slab_of_batch(pass);
    splatting_.bind_target(target, pass);
    const gl::Program& program =
        splatting_.use("ellipsoid.vert", "ellipsoid.frag", ellipsoid_defines(plan, group, target), target,
                       view.field().kernel(), first_slab);
    const BatchLayout& layout = scope_.job.layout;
    program.set("axis", f(scope_.axis_x()), f(scope_.axis_y()));
    program.set("batch_first", f(static_cast<double>(first_slab)));
    program.set("first_depth", f(frame.depth_of(first_slab)));
    program.set("last_offset", f((target.narrow ? layout.stride : layout.covered) - 1));
    program.set("slab_reach", f((plan.sampling == Sampling::slab ? 0.5 : 0.0) + (plan.fine_gradient ? 1.0 : 0.0)));
    // Half a pixel of a rectangle's edge that a pixel's centre lies on may be lost to rounding; differences between
    // neighbours reach a pixel further, along both axes.
    program.set("margin", f(sprite_margin(scope_.capabilities) + (plan.fine_gradient ? 1.5 : 0.0)));
    if (is_precise(group)) {
        program.set("exact_depth", frame.depth_of(first_slab));
        program.set("exact_spacing", frame.slice_spacing);
    }
    if (plan.resident_sections) {
        scope_.resources.section_pass().records(view.field()).bind(UNIT_RECORDS);
        program.set("records", UNIT_RECORDS);
    }
    const auto draw_all = [&] {
        scope_.resources.record_array.bind();
        const std::size_t size = plan.resident_sections ? sizeof(std::uint32_t) : sizeof(SectionRecord);
        const auto* data = plan.resident_sections ? reinterpret_cast<const char*>(gathered.indices.data())
                                                  : reinterpret_cast<const char*>(gathered.records.data());
        const std::size_t records = gathered.records.size() + gathered.indices.size();
        for (std::size_t begin = 0; begin < records; begin += records_at_once) {
            const std::size_t count = std::min(records_at_once, records - begin);
            scope_.resources.records.upload_next(data + begin * size, count * size);
            if (is_precise(group)) {
                scope_.resources.rests.upload_next(gathered.rests.data() + begin, count * sizeof(SectionRest));
            }
            if (group == SectionGroup::sprite) {
                bind_attributes(group, 0);
                scope_.gl.DrawArrays(GL_POINTS, 0, static_cast<GLsizei>(count));
                continue;
            }
            splatting_.in_calls(count, [&](std::size_t first, std::size_t now) {
                bind_attributes(group, first);
                scope_.gl.DrawArraysInstanced(GL_TRIANGLE_STRIP, 0, 4, static_cast<GLsizei>(now));
            });
        }
    };
    if (group != SectionGroup::sprite) {
        draw_all();
        return;
    }
    program.set("sprite_margin", f(sprite_margin(scope_.capabilities)));
    const int widest = static_cast<int>(std::ceil(view.field().scale_range()[1] / frame.pixel)) + 2;
    const int most = static_cast<int>(std::ceil(largest_sprite(plan, scope_.capabilities))) + 2;
    splatting_.draw_points(program, std::min(widest, most), draw_all);
}

} // namespace sheetsplat::backend_gl

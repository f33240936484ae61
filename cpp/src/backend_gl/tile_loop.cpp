#include "tile_loop.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstring>
#include <numeric>

#include <glm/geometric.hpp>

#include "interop.h"
#include "view/kept_slices.hpp"

namespace sheetsplat::backend_gl {

namespace {

constexpr double log2_e = 1.4426950408889634;
/// [NM05] section 4.4: the opacity buffer is brought up to date every ten slices.
constexpr std::int64_t opacity_buffer_period = 10;
/// Tags are multiples of tag_step below 1, so that a depth buffer of 24 bits or more tells neighbours apart by far.
constexpr int most_tags = 1 << 18;
constexpr float tag_step = 1.0F / (1 << 20);
/// A_stop that float32 would round to 0 must still let an empty pixel go on.
constexpr double smallest_stop = 1.2e-38;
/// Slice distances that a depth cue takes at least.
constexpr double shortest_cue = 1e-6;
/// Depth of splats where nothing is tagged: behind opaque pixels (0), before a clear buffer (1).
constexpr float middle = 0.0F;
/// Records of one draw call: 16 MiB.
constexpr std::size_t records_at_once = 1U << 18;

/// Rasterisers round positions and sizes to 2^-bits of a pixel: by so much sprites are larger, in pixels.
double sprite_margin(const Capabilities& capabilities) { return 4.0 * std::exp2(-capabilities.subpixel_bits); }

TargetShape shape_of(const DrawPlan& plan, const Capabilities& capabilities, const Tile& tile) {
    TargetShape shape;
    shape.width = tile.target_width();
    shape.height = tile.target_height();
    shape.sheet_format = plan.precision == Precision::float16 ? GL_RGBA16F
                         : plan.precision == Precision::uint8 ? GL_RGBA8
                                                              : GL_RGBA32F;
    shape.wide = plan.packing == Packing::wide;
    shape.weight = plan.weight;
    shape.slopes = splats_slopes(plan);
    shape.weight_slopes = plan.threshold;
    shape.shared_depth =
        plan.elimination || plan.tagging == Tagging::depth_bounds || plan.tagging == Tagging::depth_equal;
    shape.depth = plan.depth;
    shape.coverage = plan.coverage;
    shape.compensated = plan.compensated;
    shape.own = 1 + (plan.own_sheets.empty() ? -1 : *std::max_element(plan.own_sheets.begin(), plan.own_sheets.end()));
    shape.copies = plan.read_image && !capabilities.texture_barrier;
    return shape;
}

} // namespace

double largest_sprite(const DrawPlan& plan, const Capabilities& capabilities) {
    // Guards make viewports larger by a sprite's radius.
    return !plan.points || splats_slopes(plan) || plan.sampling == Sampling::slab
               ? 0.0
               : 0.5 * static_cast<double>(capabilities.max_point_size) - 1.0;
}

TileLoop::TileLoop(const Job& job, const gl::Api& gl, const Capabilities& capabilities, Resources& resources,
                   const Classification* classification, const Tile& tile)
    : job_(job), gl_(gl), capabilities_(capabilities), resources_(resources), classification_(classification),
      plan_(*job.plan), frame_(*job.frame), tile_(tile), steps_(make_steps(*job.plan, *job.frame)),
      marks_(tile, steps_.history + 1),
      tags_limit_(job.tags_per_clear > 0 ? std::min(job.tags_per_clear, most_tags) : most_tags), fragments_(gl) {
    for (const double pivot : pivots_of(plan_, *job.scene)) {
        pivots_.push_back(static_cast<float>(pivot / plan_.value_unit));
    }
    for (const RegularPart& part : job.regular) {
        makers_.emplace_back(*part.view, frame_, tile_, job.layout, plan_.fine_gradient ? 1 : 0);
    }
    for (const EllipsoidPart& part : job.ellipsoids) {
        walks_.emplace_back(*part.traversal);
        active_.emplace_back(*part.traversal);
    }
    if (plan_.opacity_buffer) {
        const auto pixels =
            static_cast<std::size_t>(tile.target_width()) * static_cast<std::size_t>(tile.target_height());
        opacity_ = OpacityBuffer(tile.target_width(), tile.target_height(), job.scene->opacity_stop,
                                 plan_.opacity_buffer_average);
        readback_ = gl::AsyncReadback(gl, pixels * 4 * sizeof(float));
        readback_pixels_.resize(pixels * 4);
    }
}

float TileLoop::tag_of(int batch) const {
    // In normalised device coordinates: the window's depth is half of this plus one half, both exact.
    return 1.0F - 2.0F * static_cast<float>(batch + 1) * tag_step;
}

void TileLoop::run(const std::function<void(double)>& progress) {
    targets_ = &resources_.targets(shape_of(plan_, capabilities_, tile_));
    gl_.Viewport(0, 0, tile_.target_width(), tile_.target_height());
    // Slabs before the first one are read, but no pass divides them: there rho is 0.
    targets_->clear_all(-std::accumulate(pivots_.begin(), pivots_.end(), 0.0F));
    if (plan_.clip) {
        make_clip();
    }
    // Slabs that no batch was drawn to yet stay clear: those before the first slice and after the last.
    for (std::int64_t pass = 0; pass < steps_.passes; ++pass) {
        marks_.next_batch();
        splat(pass);
        if (!targets_->shape().wide) {
            copy(pass);
        }
        if (!plan_.bare_fill) {
            resolve(pass);
            shade(pass);
        }
        if (targets_->shape().wide) {
            targets_->clear_sheet(ring(pass + 2));
        }
        if (plan_.elimination && (targets_->shape().wide || pass % 4 == 3)) {
            eliminate();
        }
        if (tags_by_depth() && ++tag_ >= tags_limit_) {
            restart_tags();
        } else if (untagged_ > 0) {
            --untagged_;
        }
        if (plan_.opacity_buffer) {
            update_opacity(pass);
        }
        progress(static_cast<double>(pass + 1) / static_cast<double>(steps_.passes));
    }
}

void TileLoop::splat(std::int64_t pass) {
    gl_.Enable(GL_BLEND);
    gl_.BlendFunc(GL_ONE, GL_ONE);
    gl_.ColorMask(GL_TRUE, GL_TRUE, GL_TRUE, GL_TRUE);
    if (tags_by_depth()) {
        gl_.Enable(GL_DEPTH_TEST);
        // Not LESS: the second splat of a batch has the depth that the first one left.
        gl_.DepthFunc(GL_LEQUAL);
        gl_.DepthMask(GL_TRUE);
    } else if (plan_.elimination) {
        gl_.Enable(GL_DEPTH_TEST);
        gl_.DepthFunc(GL_LEQUAL);
        gl_.DepthMask(GL_FALSE);
    } else {
        gl_.Disable(GL_DEPTH_TEST);
    }
    const std::int64_t first_slab = pass * steps_.stride;
    if (plan_.count_fragments) {
        fragments_.begin();
    }
    for (std::size_t part = 0; part < job_.regular.size(); ++part) {
        splat_regular(part, pass, first_slab);
    }
    for (std::size_t part = 0; part < job_.ellipsoids.size(); ++part) {
        if (plan_.paper_slicing) {
            splat_paper(part, pass);
        } else if (plan_.gather) {
            gather(part, pass);
        } else {
            splat_ellipsoids(part, pass, first_slab);
        }
    }
    if (plan_.count_fragments) {
        fragments_.end();
    }
}

void TileLoop::bind_target(const SplatTarget& target, std::int64_t pass) const {
    const int r = targets_->shape().wide ? ring(pass) : 0;
    targets_->bind_splat(target.own, r, target.weights_alone, target.narrow);
}

template <class Draw>
void TileLoop::for_each_target(std::size_t field, bool narrow, Draw&& draw) const {
    const int own = plan_.own_sheets.empty() ? -1 : plan_.own_sheets[field];
    draw(SplatTarget{own, plan_.weight || own >= 0, narrow, false});
    if (splats_slopes(plan_) && (plan_.weight || own >= 0)) {
        draw(SplatTarget{own, true, narrow, true});
    }
}

void TileLoop::splat_regular(std::size_t part, std::int64_t pass, std::int64_t first_slab) {
    const SlabBatches& batches = *job_.regular[part].batches;
    if (pass >= static_cast<std::int64_t>(batches.batches())) {
        return;
    }
    const auto batch = static_cast<std::size_t>(pass);
    const std::size_t count = batches.count(batch);
    if (count == 0) {
        return;
    }
    const FieldView& view = *job_.regular[part].view;
    const VertexMaker& maker = makers_[part];
    const bool boxed = plan_.projection == Projection::perspective;
    const auto started = std::chrono::steady_clock::now();
    auto* vertices = static_cast<SplatVertex*>(resources_.samples.map_next(count * sizeof(SplatVertex)));
    auto* boxes = boxed ? static_cast<PixelBox*>(resources_.boxes.map_next(count * sizeof(PixelBox))) : nullptr;
    const bool marking = plan_.tagging == Tagging::tiles;
    const std::size_t made =
        maker.make(batches.begin(batch), count, first_slab, vertices, boxes, [&](const PixelBox& box, std::uint32_t) {
            if (plan_.opacity_buffer && opacity_.hides(box)) {
                ++dropped_;
                return false;
            }
            if (marking) {
                marks_.touch(box);
            }
            return true;
        });
    resources_.samples.unmap();
    if (boxed) {
        resources_.boxes.unmap();
    }
    vertex_seconds_ += std::chrono::duration<double>(std::chrono::steady_clock::now() - started).count();
    if (made == 0) {
        return;
    }
    drawn_ += made;

    for_each_target(job_.regular[part].field, false, [&](const SplatTarget& target) {
        bind_target(target, pass);
        const gl::Program& program = resources_.program("splat.vert", "splat.frag", splat_defines(plan_, view, target),
                                                        splat_outputs(plan_, target));
        program.use();
        if (target.own >= 0) {
            program.set("pivot", pivots_[static_cast<std::size_t>(target.own)]);
        }
        draw_kernels(program, view, maker, first_slab, made);
    });
}

void TileLoop::splat_ellipsoids(std::size_t part, std::int64_t pass, std::int64_t first_slab) {
    const EllipsoidPart& ellipsoids = job_.ellipsoids[part];
    const EllipsoidView& view = *ellipsoids.view;
    const int wider = plan_.fine_gradient ? 1 : 0;
    const std::int64_t last_slab = std::min<std::int64_t>(first_slab + job_.layout.covered, frame_.slices) - 1;
    const double front = view.front_of(first_slab - wider);
    const double back = view.back_of(last_slab + wider);
    const std::int64_t last_narrow = std::min<std::int64_t>(first_slab + job_.layout.stride, frame_.slices) - 1;
    const double back_narrow = view.back_of(last_narrow + wider);
    const bool marking = plan_.tagging == Tagging::tiles;
    const auto started = std::chrono::steady_clock::now();
    walks_[part].next(
        [&](const EllipsoidView::ScreenBounds& bounds) {
            return plan_.opacity_buffer && opacity_.hides(EllipsoidView::pixels(bounds, frame_, tile_, wider));
        },
        [&](const CellTraversal::Entry& entry) {
            const bool narrow = entry.narrow != 0U;
            const std::size_t group = entry.group + (narrow ? section_groups : 0);
            const auto counts = [&](const PixelBox& box) {
                if (box.empty()) {
                    return false;
                }
                if (plan_.opacity_buffer && opacity_.hides(box)) {
                    ++dropped_;
                    return false;
                }
                if (marking) {
                    marks_.touch(box);
                }
                return true;
            };
            const double behind = narrow ? back_narrow : back;
            if (plan_.resident_sections) {
                if (counts(EllipsoidView::pixels(view.support_bounds(entry.kernel, front, behind), frame_, tile_,
                                                 wider))) {
                    indices_[group].push_back(entry.kernel);
                }
                return;
            }
            const EyeKernel kernel = view.kernel(entry.kernel);
            if (counts(EllipsoidView::pixels(view.bounds(kernel, front, behind), frame_, tile_, wider))) {
                // Anchored where it is needed, a record keeps its digits.
                const std::int64_t anchor = view.anchor(kernel, first_slab, narrow ? last_narrow : last_slab);
                if (is_precise(static_cast<SectionGroup>(entry.group))) {
                    records_[group].push_back(view.record(entry.kernel, kernel, anchor, &rests_[group].emplace_back()));
                } else {
                    records_[group].push_back(view.record(entry.kernel, kernel, anchor));
                }
                if (records_[group].size() == records_at_once) {
                    draw_group(part, group, pass, first_slab);
                }
            }
        });
    vertex_seconds_ += std::chrono::duration<double>(std::chrono::steady_clock::now() - started).count();
    for (std::size_t group = 0; group < records_.size(); ++group) {
        draw_group(part, group, pass, first_slab);
    }
}

void TileLoop::draw_group(std::size_t part, std::size_t group, std::int64_t pass, std::int64_t first_slab) {
    const EllipsoidPart& ellipsoids = job_.ellipsoids[part];
    const std::size_t count = plan_.resident_sections ? indices_[group].size() : records_[group].size();
    if (count == 0) {
        return;
    }
    drawn_ += count;
    for_each_target(ellipsoids.field, group >= section_groups, [&](const SplatTarget& target) {
        draw_records(*ellipsoids.view, group, count, target, pass, first_slab);
    });
    records_[group].clear();
    indices_[group].clear();
    rests_[group].clear();
}

template <class Visit>
void TileLoop::for_each_active(std::size_t part, Visit&& visit) {
    const auto& cells = job_.ellipsoids[part].traversal->cells();
    for (const std::size_t number : active_[part].next()) {
        const PixelBox box = EllipsoidView::pixels(cells[number].bounds, frame_, tile_, 0);
        if (box.empty()) {
            continue;
        }
        if (plan_.opacity_buffer && opacity_.hides(box)) {
            dropped_ += cells[number].end - cells[number].begin;
            continue;
        }
        if (plan_.tagging == Tagging::tiles) {
            marks_.touch(box);
        }
        visit(number, box);
    }
}

SlabPass TileLoop::slab_pass(std::int64_t pass) const {
    SlabPass slabs;
    slabs.first_slab = pass * steps_.stride;
    slabs.axis_x = axis_x();
    slabs.axis_y = axis_y();
    slabs.target_width = tile_.target_width();
    slabs.target_height = tile_.target_height();
    slabs.tag = tags_by_depth() ? tag_of(tag_) : middle;
    slabs.margin = sprite_margin(capabilities_);
    return slabs;
}

void TileLoop::splat_paper(std::size_t part, std::int64_t pass) {
    const EllipsoidPart& ellipsoids = job_.ellipsoids[part];
    std::vector<std::size_t> cells;
    for_each_active(part, [&](std::size_t number, const PixelBox&) { cells.push_back(number); });
    drawn_ += resources_.paper_slicing().kernels_at(ellipsoids.view->field(), pass);
    for_each_target(ellipsoids.field, false, [&](const SplatTarget& target) {
        bind_target(target, pass);
        resources_.paper_slicing().draw(resources_, plan_, *ellipsoids.view, *ellipsoids.traversal, cells, target,
                                        slab_pass(pass));
    });
}

void TileLoop::gather(std::size_t part, std::int64_t pass) {
    PixelBox touched{tile_.target_width(), tile_.target_height(), 0, 0};
    for_each_active(part, [&](std::size_t, const PixelBox& box) {
        touched = {std::min(touched.x0, box.x0), std::min(touched.y0, box.y0), std::max(touched.x1, box.x1),
                   std::max(touched.y1, box.y1)};
    });
    if (touched.empty()) {
        return;
    }
    bind_target({-1, plan_.weight, true, false}, pass);
    resources_.gather().use(resources_, plan_, *job_.ellipsoids[part].view, slab_pass(pass));
    // What is written is finished: nothing adds to it.
    gl_.Disable(GL_BLEND);
    draw_rectangles({{static_cast<float>(touched.x0), static_cast<float>(touched.y0), static_cast<float>(touched.x1),
                      static_cast<float>(touched.y1)}});
}

void TileLoop::set_offsets(const gl::Program& program, std::int64_t first_slab) const {
    const auto front = channel_offsets(plan_, first_slab);
    program.set("offset_front", front[0], front[1], front[2], front[3]);
    program.set("offset_back", front[0] + 4.0F, front[1] + 4.0F, front[2] + 4.0F, front[3] + 4.0F);
    if (plan_.projection == Projection::perspective) {
        const auto depth = [&](std::size_t channel, float more) {
            return static_cast<float>(frame_.depth_of(first_slab) +
                                      static_cast<double>(front[channel] + more) * frame_.slice_spacing);
        };
        program.set("depth_front", depth(0, 0.0F), depth(1, 0.0F), depth(2, 0.0F), depth(3, 0.0F));
        program.set("depth_back", depth(0, 4.0F), depth(1, 4.0F), depth(2, 4.0F), depth(3, 4.0F));
        program.set("slice_spacing", static_cast<float>(frame_.slice_spacing));
    }
}

void TileLoop::draw_records(const EllipsoidView& view, std::size_t numbered, std::size_t records,
                            const SplatTarget& target, std::int64_t pass, std::int64_t first_slab) {
    const auto group = static_cast<SectionGroup>(numbered % section_groups);
    const auto f = [](double value) { return static_cast<float>(value); };
    const double k = view.field().kernel().falloff;
    bind_target(target, pass);
    const gl::Program& program = resources_.program(
        "ellipsoid.vert", "ellipsoid.frag", ellipsoid_defines(plan_, group, target), splat_outputs(plan_, target));
    program.use();
    program.set("falloff_log2", f(k * log2_e));
    program.set("edge", f(view.field().kernel().edge()));
    program.set("falloff_root", f(std::sqrt(k)));
    program.set("target_size", f(tile_.target_width()), f(tile_.target_height()));
    program.set("axis", f(axis_x()), f(axis_y()));
    program.set("tag", tags_by_depth() ? tag_of(tag_) : middle);
    program.set("batch_first", f(static_cast<double>(first_slab)));
    program.set("first_depth", f(frame_.depth_of(first_slab)));
    program.set("last_offset", f((target.narrow ? job_.layout.stride : job_.layout.covered) - 1));
    program.set("slab_reach", f((plan_.sampling == Sampling::slab ? 0.5 : 0.0) + (plan_.fine_gradient ? 1.0 : 0.0)));
    // Half a pixel of a rectangle's edge that a pixel's centre lies on may be lost to rounding; differences between
    // neighbours reach a pixel further, along both axes.
    program.set("margin", f(sprite_margin(capabilities_) + (plan_.fine_gradient ? 1.5 : 0.0)));
    if (is_precise(group)) {
        program.set("exact_depth", frame_.depth_of(first_slab));
        program.set("exact_spacing", frame_.slice_spacing);
    }
    if (target.own >= 0) {
        program.set("pivot", pivots_[static_cast<std::size_t>(target.own)]);
    }
    set_offsets(program, first_slab);
    int guard = 0;
    if (group == SectionGroup::sprite) {
        // A point whose centre lies outside the viewport is not drawn, though its square may reach in: the viewport is
        // made larger.
        guard = static_cast<int>(std::ceil(view.field().scale_range()[1] / frame_.pixel)) + 2;
        guard = std::min(guard, static_cast<int>(std::ceil(largest_sprite(plan_, capabilities_))) + 2);
        gl_.Viewport(-guard, -guard, tile_.target_width() + 2 * guard, tile_.target_height() + 2 * guard);
        gl_.Enable(GL_SCISSOR_TEST);
        gl_.Scissor(0, 0, tile_.target_width(), tile_.target_height());
        gl_.Enable(GL_PROGRAM_POINT_SIZE);
        program.set("guard", f(guard), f(guard));
        program.set("sprite_margin", f(sprite_margin(capabilities_)));
    }
    resources_.record_array.bind();
    const GLuint divisor = group == SectionGroup::sprite ? 0 : 1;
    const auto draw = [&](std::size_t count, const auto& attributes) {
        attributes(0);
        if (group == SectionGroup::sprite) {
            gl_.DrawArrays(GL_POINTS, 0, static_cast<GLsizei>(count));
        } else if (plan_.vertex_arrays) {
            gl_.DrawArraysInstanced(GL_TRIANGLE_STRIP, 0, 4, static_cast<GLsizei>(count));
        } else {
            for (std::size_t record = 0; record < count; ++record) {
                attributes(record);
                gl_.DrawArraysInstanced(GL_TRIANGLE_STRIP, 0, 4, 1);
            }
        }
    };
    const std::size_t size = plan_.resident_sections ? sizeof(std::uint32_t) : sizeof(SectionRecord);
    const auto* data = plan_.resident_sections ? reinterpret_cast<const char*>(indices_[numbered].data())
                                               : reinterpret_cast<const char*>(records_[numbered].data());
    if (plan_.resident_sections) {
        resources_.section_pass().records(view.field()).bind(UNIT_RECORDS);
        program.set("records", UNIT_RECORDS);
    }
    for (std::size_t begin = 0; begin < records; begin += records_at_once) {
        const std::size_t count = std::min(records_at_once, records - begin);
        std::memcpy(resources_.records.map_next(count * size), data + begin * size, count * size);
        resources_.records.unmap();
        if (is_precise(group)) {
            std::memcpy(resources_.rests.map_next(count * sizeof(SectionRest)), rests_[numbered].data() + begin,
                        count * sizeof(SectionRest));
            resources_.rests.unmap();
        }
        draw(count, [&](std::size_t first) {
            for (GLuint rest = 0; rest < 3; ++rest) {
                if (!is_precise(group)) {
                    gl_.DisableVertexAttribArray(ATTRIBUTE_REST_HEIGHTS + rest);
                    continue;
                }
                resources_.rests.bind();
                const std::size_t start =
                    resources_.rests.offset() + first * sizeof(SectionRest) + rest * 4 * sizeof(float);
                gl_.EnableVertexAttribArray(ATTRIBUTE_REST_HEIGHTS + rest);
                gl_.VertexAttribPointer(ATTRIBUTE_REST_HEIGHTS + rest, 4, GL_FLOAT, GL_FALSE, sizeof(SectionRest),
                                        reinterpret_cast<const void*>(start));
                gl_.VertexAttribDivisor(ATTRIBUTE_REST_HEIGHTS + rest, 1);
            }
            resources_.records.bind();
            const std::size_t start = resources_.records.offset() + first * size;
            if (plan_.resident_sections) {
                gl_.EnableVertexAttribArray(ATTRIBUTE_RECORD_INDEX);
                gl_.VertexAttribIPointer(ATTRIBUTE_RECORD_INDEX, 1, GL_UNSIGNED_INT, static_cast<GLsizei>(size),
                                         reinterpret_cast<const void*>(start));
                gl_.VertexAttribDivisor(ATTRIBUTE_RECORD_INDEX, divisor);
                for (GLuint other = 1; other < 4; ++other) {
                    gl_.DisableVertexAttribArray(ATTRIBUTE_RECORD_PLACE + other);
                }
                return;
            }
            for (GLuint quarter = 0; quarter < 4; ++quarter) {
                gl_.EnableVertexAttribArray(ATTRIBUTE_RECORD_PLACE + quarter);
                gl_.VertexAttribPointer(ATTRIBUTE_RECORD_PLACE + quarter, 4, GL_FLOAT, GL_FALSE,
                                        static_cast<GLsizei>(size),
                                        reinterpret_cast<const void*>(start + quarter * 4 * sizeof(float)));
                gl_.VertexAttribDivisor(ATTRIBUTE_RECORD_PLACE + quarter, divisor);
            }
        });
    }
    if (guard > 0) {
        gl_.Disable(GL_SCISSOR_TEST);
        gl_.Viewport(0, 0, tile_.target_width(), tile_.target_height());
    }
}

void TileLoop::resolve(std::int64_t pass) {
    const int own_fields = targets_->shape().own;
    if (own_fields == 0) {
        return;
    }
    const bool wide = targets_->shape().wide;
    const int channel = wide ? 0 : static_cast<int>(pass % 4);
    const auto mask = [&](int only) {
        gl_.ColorMask(wide || only == 0 ? GL_TRUE : GL_FALSE, wide || only == 1 ? GL_TRUE : GL_FALSE,
                      wide || only == 2 ? GL_TRUE : GL_FALSE, wide || only == 3 ? GL_TRUE : GL_FALSE);
    };
    gl_.Disable(GL_DEPTH_TEST);
    gl_.DepthMask(GL_FALSE);
    gl::Defines defines;
    std::vector<std::string> outputs{"sheet_sum"};
    const bool slopes = splats_slopes(plan_);
    if (slopes) {
        defines["SLOPES"] = "1";
        outputs.insert(outputs.end(), {"x_sum", "y_sum", "z_sum"});
    }
    defines["PIVOT"] = "1";
    if (plan_.weight) {
        defines["WEIGHT"] = "1";
        outputs.emplace_back("weight_sum");
    }
    const gl::Program& program = resources_.program("rectangle.vert", "resolve.frag", defines, outputs);
    for (std::size_t field = 0; field < plan_.own_sheets.size(); ++field) {
        const int own = plan_.own_sheets[field];
        if (own < 0) {
            continue;
        }
        // The newest slabs that no later batch adds to.
        const int r = wide ? ring(pass) : 0;
        mask(channel);
        gl_.Enable(GL_BLEND);
        gl_.BlendFunc(GL_ONE, GL_ONE);
        targets_->bind_sum(wide ? r : 1);
        program.use();
        const Sheet& sheet = targets_->own_sheet(own, r);
        const auto bind = [&](const char* name, const gl::Texture& texture, int unit) {
            texture.bind(unit);
            program.set(name, unit);
        };
        bind("sheet_front_texture", sheet.value, UNIT_SHEET_FRONT);
        bind("weight_front_texture", sheet.weight, UNIT_WEIGHT_FRONT);
        program.set("pivot", pivots_[static_cast<std::size_t>(own)]);
        if (slopes) {
            bind("x_front_texture", sheet.slope[0], UNIT_SLOPE_X_FRONT);
            bind("y_front_texture", sheet.slope[1], UNIT_SLOPE_Y_FRONT);
            bind("z_front_texture", sheet.slope[2], UNIT_SLOPE_Z_FRONT);
            bind("weight_x_front_texture", sheet.weight_slope[0], UNIT_WEIGHT_X_FRONT);
            bind("weight_y_front_texture", sheet.weight_slope[1], UNIT_WEIGHT_Y_FRONT);
            bind("weight_z_front_texture", sheet.weight_slope[2], UNIT_WEIGHT_Z_FRONT);
        }
        program.set("w0", static_cast<float>(job_.scene->fields[field]->w0()));
        program.set("target_size", static_cast<float>(tile_.target_width()), static_cast<float>(tile_.target_height()));
        program.set("tag", middle);
        draw_rectangles(
            {{0.0F, 0.0F, static_cast<float>(tile_.target_width()), static_cast<float>(tile_.target_height())}});
        targets_->clear_own(own, r);
    }
    gl_.ColorMask(GL_TRUE, GL_TRUE, GL_TRUE, GL_TRUE);
}

void TileLoop::draw_kernels(const gl::Program& program, const FieldView& view, const VertexMaker& maker,
                            std::int64_t first_slab, std::size_t count) {
    program.use();
    const bool perspective = plan_.projection == Projection::perspective;
    const auto f = [](double value) { return static_cast<float>(value); };
    const double k = view.field->kernel().falloff;
    program.set("falloff_log2", f(k * log2_e));
    const double radius_px = view.extent_x / frame_.pixel;
    program.set("falloff_px", f(-k * log2_e / (radius_px * radius_px)));
    program.set("edge", f(view.field->kernel().edge()));
    program.set("falloff_root", f(std::sqrt(k)));
    program.set("slab_half", f(0.5 * frame_.slice_spacing / view.half_depth));
    program.set("step_s", f(frame_.slice_spacing / view.half_depth));
    program.set("weight_scale", f(view.weight_scale));
    program.set("target_size", f(tile_.target_width()), f(tile_.target_height()));
    program.set("axis", f(maker.origin_x()), f(maker.origin_y()));
    program.set("shear", f(view.shear.x), f(view.shear.y));
    // Rows count downwards, eye y upwards.
    program.set_matrix2("to_unit", f(view.to_unit[0].x * frame_.pixel), f(view.to_unit[0].y * frame_.pixel),
                        f(-view.to_unit[1].x * frame_.pixel), f(-view.to_unit[1].y * frame_.pixel));
    program.set("tag", tags_by_depth() ? tag_of(tag_) : middle);
    set_offsets(program, first_slab);
    if (perspective) {
        program.set("half_depth", f(view.half_depth));
        program.set("first_depth", f(frame_.depth_of(first_slab)));
        program.set("last_offset", f(job_.layout.covered - 1));
    }

    resources_.splat_array.bind();
    resources_.samples.bind();
    gl_.EnableVertexAttribArray(ATTRIBUTE_SAMPLE);
    gl_.VertexAttribPointer(ATTRIBUTE_SAMPLE, 4, GL_FLOAT, GL_FALSE, sizeof(SplatVertex),
                            reinterpret_cast<const void*>(resources_.samples.offset()));
    gl_.VertexAttribDivisor(ATTRIBUTE_SAMPLE, plan_.points ? 0 : 1);
    if (perspective) {
        resources_.boxes.bind();
        gl_.EnableVertexAttribArray(ATTRIBUTE_BOX);
        gl_.VertexAttribPointer(ATTRIBUTE_BOX, 4, GL_INT, GL_FALSE, sizeof(PixelBox),
                                reinterpret_cast<const void*>(resources_.boxes.offset()));
        gl_.VertexAttribDivisor(ATTRIBUTE_BOX, 1);
    } else {
        gl_.DisableVertexAttribArray(ATTRIBUTE_BOX);
    }

    if (plan_.points) {
        // A point whose centre lies outside the viewport is not drawn, though its square may reach in: the viewport is
        // made larger.
        const int guard = static_cast<int>(std::ceil(maker.half_size())) + 1;
        gl_.Viewport(-guard, -guard, tile_.target_width() + 2 * guard, tile_.target_height() + 2 * guard);
        gl_.Enable(GL_SCISSOR_TEST);
        gl_.Scissor(0, 0, tile_.target_width(), tile_.target_height());
        gl_.Enable(GL_PROGRAM_POINT_SIZE);
        program.set("guard", f(guard), f(guard));
        program.set("point_size", f(2.0 * maker.half_size() + sprite_margin(capabilities_)));
        if (plan_.vertex_arrays) {
            gl_.DrawArrays(GL_POINTS, 0, static_cast<GLsizei>(count));
        } else {
            for (std::size_t kernel = 0; kernel < count; ++kernel) {
                gl_.DrawArrays(GL_POINTS, static_cast<GLint>(kernel), 1);
            }
        }
        gl_.Disable(GL_SCISSOR_TEST);
        gl_.Viewport(0, 0, tile_.target_width(), tile_.target_height());
        return;
    }
    program.set("half_size", f(maker.half_x()), f(maker.half_y()));
    if (plan_.vertex_arrays) {
        gl_.DrawArraysInstanced(GL_TRIANGLE_STRIP, 0, 4, static_cast<GLsizei>(count));
        return;
    }
    for (std::size_t kernel = 0; kernel < count; ++kernel) {
        resources_.samples.bind();
        gl_.VertexAttribPointer(
            ATTRIBUTE_SAMPLE, 4, GL_FLOAT, GL_FALSE, sizeof(SplatVertex),
            reinterpret_cast<const void*>(resources_.samples.offset() + kernel * sizeof(SplatVertex)));
        if (perspective) {
            resources_.boxes.bind();
            gl_.VertexAttribPointer(
                ATTRIBUTE_BOX, 4, GL_INT, GL_FALSE, sizeof(PixelBox),
                reinterpret_cast<const void*>(resources_.boxes.offset() + kernel * sizeof(PixelBox)));
        }
        gl_.DrawArraysInstanced(GL_TRIANGLE_STRIP, 0, 4, 1);
    }
}

void TileLoop::draw_rectangles(const std::vector<Rectangle>& rectangles) {
    if (rectangles.empty()) {
        return;
    }
    std::memcpy(resources_.rectangles.map_next(rectangles.size() * sizeof(Rectangle)), rectangles.data(),
                rectangles.size() * sizeof(Rectangle));
    resources_.rectangles.unmap();
    resources_.rectangle_array.bind();
    resources_.rectangles.bind();
    gl_.EnableVertexAttribArray(ATTRIBUTE_RECTANGLE);
    gl_.VertexAttribPointer(ATTRIBUTE_RECTANGLE, 4, GL_FLOAT, GL_FALSE, sizeof(Rectangle),
                            reinterpret_cast<const void*>(resources_.rectangles.offset()));
    gl_.VertexAttribDivisor(ATTRIBUTE_RECTANGLE, 1);
    gl_.DrawArraysInstanced(GL_TRIANGLE_STRIP, 0, 4, static_cast<GLsizei>(rectangles.size()));
}

/// Draws with the program wherever the newest batches touched the tile, by the plan's way of telling. The target is
/// bound.
void TileLoop::draw_touched(const gl::Program& program) {
    program.set("target_size", static_cast<float>(tile_.target_width()), static_cast<float>(tile_.target_height()));
    program.set("tag", middle);
    gl_.DepthMask(GL_FALSE);
    const int oldest = std::max(tag_ - steps_.history, 0);
    switch (plan_.tagging) {
    case Tagging::depth_bounds: {
        // Half a step of distance on both sides; opaque pixels (0) lie below, untouched ones (1) above.
        const double low = 0.5 * static_cast<double>(tag_of(tag_)) + 0.5 - 0.5 * static_cast<double>(tag_step);
        const double high =
            untagged_ > 0 ? 1.0 : 0.5 * static_cast<double>(tag_of(oldest)) + 0.5 + 0.5 * static_cast<double>(tag_step);
        gl_.Disable(GL_DEPTH_TEST);
        gl_.Enable(GL_DEPTH_BOUNDS_TEST_EXT);
        gl_.DepthBoundsEXT(low, high);
        draw_rectangles(marks_.whole());
        gl_.Disable(GL_DEPTH_BOUNDS_TEST_EXT);
        return;
    }
    case Tagging::depth_equal:
        gl_.Enable(GL_DEPTH_TEST);
        gl_.DepthFunc(GL_EQUAL);
        for (int tag = oldest; tag <= tag_; ++tag) {
            program.set("tag", tag_of(tag));
            draw_rectangles(marks_.whole());
        }
        if (untagged_ > 0) {
            program.set("tag", 1.0F);
            draw_rectangles(marks_.whole());
        }
        return;
    case Tagging::tiles:
    case Tagging::off:
    case Tagging::automatic:
        if (plan_.elimination) {
            gl_.Enable(GL_DEPTH_TEST);
            gl_.DepthFunc(GL_LEQUAL);
        } else {
            gl_.Disable(GL_DEPTH_TEST);
        }
        draw_rectangles(plan_.tagging == Tagging::tiles ? marks_.touched() : marks_.whole());
        return;
    }
}

void TileLoop::copy(std::int64_t pass) {
    const auto channel = static_cast<int>(pass % 4);
    const auto mask = [&](int only) {
        gl_.ColorMask(only == 0 ? GL_TRUE : GL_FALSE, only == 1 ? GL_TRUE : GL_FALSE, only == 2 ? GL_TRUE : GL_FALSE,
                      only == 3 ? GL_TRUE : GL_FALSE);
    };
    mask(channel);
    // Copying what is tagged alone would leave an older slab's values elsewhere, and corrupt gradients.
    targets_->clear_sheet(1);
    gl_.Disable(GL_BLEND);
    gl_.DepthMask(GL_FALSE);
    gl_.Disable(GL_DEPTH_TEST);
    const auto copy_planes = [&](const gl::Texture& plane, const gl::Texture* slopes, const gl::Texture* weight) {
        gl::Defines defines;
        std::vector<std::string> outputs{"sheet_copy"};
        if (weight != nullptr) {
            defines["WEIGHT"] = "1";
            outputs.emplace_back("weight_copy");
        }
        if (slopes != nullptr) {
            defines["FINE"] = "1";
            outputs.insert(outputs.end(), {"x_copy", "y_copy", "z_copy"});
        }
        const gl::Program& program = resources_.program("rectangle.vert", "copy.frag", defines, outputs);
        program.use();
        const auto bind = [&](const char* name, const gl::Texture& texture, int unit) {
            texture.bind(unit);
            program.set(name, unit);
        };
        bind("sheet_front_texture", plane, UNIT_SHEET_FRONT);
        if (weight != nullptr) {
            bind("weight_front_texture", *weight, UNIT_WEIGHT_FRONT);
        }
        if (slopes != nullptr) {
            bind("x_front_texture", slopes[0], UNIT_SLOPE_X_FRONT);
            bind("y_front_texture", slopes[1], UNIT_SLOPE_Y_FRONT);
            bind("z_front_texture", slopes[2], UNIT_SLOPE_Z_FRONT);
        }
        program.set("target_size", static_cast<float>(tile_.target_width()), static_cast<float>(tile_.target_height()));
        program.set("tag", middle);
        // The border takes part: pixels at the edge look for their neighbours there.
        draw_rectangles(
            {{0.0F, 0.0F, static_cast<float>(tile_.target_width()), static_cast<float>(tile_.target_height())}});
    };
    const Sheet& from = targets_->sheet(0);
    const bool slopes = splats_slopes(plan_);
    targets_->bind_copy(false);
    copy_planes(from.value, slopes ? from.slope : nullptr, plan_.weight && !slopes ? &from.weight : nullptr);
    if (slopes && plan_.weight) {
        targets_->bind_copy(true);
        copy_planes(from.weight, targets_->shape().weight_slopes ? from.weight_slope : nullptr, nullptr);
    }
    // The channel is taken up again by the slab four further on.
    targets_->clear_sheet(0);
    gl_.ColorMask(GL_TRUE, GL_TRUE, GL_TRUE, GL_TRUE);
}

void TileLoop::make_clip() {
    const KeptSlices kept(*job_.scene, *job_.camera, frame_);
    const int width = tile_.target_width();
    const int height = tile_.target_height();
    std::vector<SliceRun> runs(static_cast<std::size_t>(width) * static_cast<std::size_t>(height));
    auto run = runs.begin();
    for (int y = 0; y < height; ++y) {
        for (int x = 0; x < width; ++x) {
            *run++ = kept.at(tile_.x + x - Tile::border, tile_.y + y - Tile::border);
        }
    }
    static_assert(sizeof(SliceRun) == 2 * sizeof(GLint), "runs are uploaded as they are");
    kept_ = gl::Texture(gl_, GL_RG32I, width, height);
    kept_.upload(GL_RG_INTEGER, GL_INT, runs.data());
}

void TileLoop::bind_sheets(const gl::Program& program, std::int64_t pass) const {
    const bool wide = targets_->shape().wide;
    const Sheet& front = wide ? targets_->sheet(ring(pass + 2)) : targets_->sheet(1);
    const Sheet& back = wide ? targets_->sheet(ring(pass)) : front;
    const auto bind = [&](const char* name, const gl::Texture& texture, int unit) {
        texture.bind(unit);
        program.set(name, unit);
    };
    bind("sheet_front_texture", front.value, UNIT_SHEET_FRONT);
    if (wide) {
        bind("sheet_back_texture", back.value, UNIT_SHEET_BACK);
    }
    if (plan_.weight) {
        bind("weight_front_texture", front.weight, UNIT_WEIGHT_FRONT);
        if (wide) {
            bind("weight_back_texture", back.weight, UNIT_WEIGHT_BACK);
        }
    }
    if (splats_slopes(plan_)) {
        bind("x_front_texture", front.slope[0], UNIT_SLOPE_X_FRONT);
        bind("y_front_texture", front.slope[1], UNIT_SLOPE_Y_FRONT);
        bind("z_front_texture", front.slope[2], UNIT_SLOPE_Z_FRONT);
        if (wide) {
            bind("x_back_texture", back.slope[0], UNIT_SLOPE_X_BACK);
            bind("y_back_texture", back.slope[1], UNIT_SLOPE_Y_BACK);
            bind("z_back_texture", back.slope[2], UNIT_SLOPE_Z_BACK);
        }
    }
    if (plan_.fine_gradient && plan_.threshold) {
        bind("weight_x_front_texture", front.weight_slope[0], UNIT_WEIGHT_X_FRONT);
        bind("weight_y_front_texture", front.weight_slope[1], UNIT_WEIGHT_Y_FRONT);
        bind("weight_z_front_texture", front.weight_slope[2], UNIT_WEIGHT_Z_FRONT);
        if (wide) {
            bind("weight_x_back_texture", back.weight_slope[0], UNIT_WEIGHT_X_BACK);
            bind("weight_y_back_texture", back.weight_slope[1], UNIT_WEIGHT_Y_BACK);
            bind("weight_z_back_texture", back.weight_slope[2], UNIT_WEIGHT_Z_BACK);
        }
    }
}

void TileLoop::set_shading(const gl::Program& program, std::int64_t pass) {
    const Scene& scene = *job_.scene;
    const auto f = [](double value) { return static_cast<float>(value); };
    const std::int64_t first_slab = steps_.first_slab(pass);
    const double reference = frame_.reference_length;
    program.set("scalar_step", 1.0F);
    program.set("axis", f(axis_x()), f(axis_y()));
    program.set("pixel", f(frame_.pixel));
    program.set("first_depth", f(frame_.depth_of(first_slab)));
    program.set("slice_spacing", f(frame_.slice_spacing));
    // Beyond float32 an opacity above 0 is 1 anyway; infinity times an opacity of 0 would be no number.
    program.set("exponent", f(std::min(frame_.slice_spacing / reference, 1e30)));
    program.set("w0", f(scene.fields.front()->w0()));
    program.set("opacity_stop", f(std::max(scene.opacity_stop, smallest_stop)));
    program.set("depth_of_first", f(frame_.depth_of(first_slab)));
    program.set("depth_step", f(frame_.slice_spacing));
    program.set("first_slab", static_cast<int>(first_slab));
    program.set("last_slab", static_cast<int>(frame_.slices - 1));
    if (plan_.clip) {
        kept_.bind(UNIT_CLIP);
        program.set("clip_texture", UNIT_CLIP);
    }
    if (plan_.shadows || plan_.ambient_occlusion) {
        resources_.light().bind(program, *job_.camera, frame_, first_slab);
        if (plan_.ambient_occlusion) {
            program.set("occlusion", f(scene.ambient_occlusion->strength));
        }
    }
    if (plan_.depth_cue) {
        const DepthCue& depth_cue = *scene.depth_cue;
        // A step in all but name stays one; its slope must not leave float32.
        const double length = std::max(depth_cue.end - depth_cue.start, shortest_cue * frame_.slice_spacing);
        program.set("cue", f(depth_cue.color.x), f(depth_cue.color.y), f(depth_cue.color.z), f(depth_cue.strength));
        program.set("cue_share", f((frame_.depth_of(first_slab) - depth_cue.start) / length),
                    f(frame_.slice_spacing / length));
    }
    if (classification_ != nullptr) {
        classification_->bind(program);
    }
    if (plan_.mode == Mode::isosurface) {
        const TransferPoint at = scene.transfer_function.at(*scene.iso_value);
        const std::vector<double> pivots = pivots_of(plan_, scene);
        const double less = std::accumulate(pivots.begin(), pivots.end(), 0.0);
        program.set("iso_value", f((*scene.iso_value - less) / plan_.value_unit));
        program.set("iso_color", f(at.color.x), f(at.color.y), f(at.color.z), f(at.opacity));
    }
    if (plan_.gradient) {
        std::vector<float> directions, colors;
        for (const Light& light : scene.lights) {
            const Vec3 unit = light.direction / glm::length(light.direction);
            const Vec3 eye = light.space == LightSpace::world ? job_.camera->direction_to_eye(unit) : unit;
            directions.insert(directions.end(), {f(eye.x), f(eye.y), f(eye.z)});
            colors.insert(colors.end(), {f(light.color.x), f(light.color.y), f(light.color.z)});
        }
        program.set_array3("light_direction", directions.data(), static_cast<int>(scene.lights.size()));
        program.set_array3("light_color", colors.data(), static_cast<int>(scene.lights.size()));
        const Material& material = scene.material;
        program.set("material", f(material.ambient), f(material.diffuse), f(material.specular), f(material.shininess));
        program.set("gradient_scale", f(0.5 * reference / frame_.pixel), f(0.5 * reference / frame_.slice_spacing));
        const TransferFunction& function = scene.transfer_function;
        if (plan_.gradient_opacity) {
            program.set("full_gradient", f(*scene.gradient_opacity * reference / plan_.value_unit));
        }
        program.set("weakest_gradient", f(1e-3 * (function.v_max() - function.v_min()) / plan_.value_unit));
    }
}

void TileLoop::shade(std::int64_t pass) {
    gl_.ColorMask(GL_TRUE, GL_TRUE, GL_TRUE, GL_TRUE);
    const gl::Program& program = resources_.program(
        "rectangle.vert", "shade.frag", shade_defines(plan_, job_.scene->lights.size(), static_cast<int>(pass % 4)),
        shade_outputs(plan_));
    program.use();
    bind_sheets(program, pass);
    set_shading(program, pass);
    if (plan_.read_image) {
        // Each texel is read by the one fragment that writes it: the barrier orders passes, copies stand in where there
        // is none.
        targets_->bind_so_far(program);
        if (!targets_->shape().copies) {
            if (gl_.TextureBarrier != nullptr) {
                gl_.TextureBarrier();
            } else {
                gl_.TextureBarrierNV();
            }
        }
        gl_.Disable(GL_BLEND);
    } else {
        gl_.Enable(GL_BLEND);
        gl_.BlendFunc(GL_ONE_MINUS_DST_ALPHA, GL_ONE);
    }
    targets_->bind_image();
    draw_touched(program);
}

void TileLoop::eliminate() {
    targets_->bind_depth_only();
    const gl::Program& program = resources_.program("rectangle.vert", "eliminate.frag", {}, {});
    program.use();
    targets_->image().bind(UNIT_IMAGE);
    program.set("image_texture", UNIT_IMAGE);
    program.set("opacity_stop", plan_.mode == Mode::isosurface ? 1.0F : static_cast<float>(job_.scene->opacity_stop));
    program.set("last_pixel", tile_.width, tile_.height);
    program.set("target_size", static_cast<float>(tile_.target_width()), static_cast<float>(tile_.target_height()));
    program.set("tag", -1.0F);
    gl_.Disable(GL_BLEND);
    gl_.Enable(GL_DEPTH_TEST);
    gl_.DepthFunc(GL_ALWAYS);
    gl_.DepthMask(GL_TRUE);
    draw_rectangles(plan_.tagging == Tagging::tiles ? marks_.touched() : marks_.whole());
    gl_.DepthMask(GL_FALSE);
}

void TileLoop::restart_tags() {
    targets_->clear_tags();
    tag_ = 0;
    // What the last batches touched is forgotten with their tags: until they are through, every pixel counts as
    // touched.
    untagged_ = steps_.history + 1;
    if (plan_.elimination) {
        eliminate();
    }
}

void TileLoop::update_opacity(std::int64_t pass) {
    if (readback_.pending() && readback_.ready()) {
        readback_.fetch(readback_pixels_.data(), readback_pixels_.size() * sizeof(float));
        opacity_.update(readback_pixels_.data());
    }
    const std::int64_t slices = (pass + 1) * steps_.stride;
    if (!readback_.pending() && slices - last_readback_ >= opacity_buffer_period) {
        last_readback_ = slices;
        targets_->bind_image();
        readback_.start(0, 0, 0, tile_.target_width(), tile_.target_height(), GL_RGBA, GL_FLOAT);
    }
}

} // namespace sheetsplat::backend_gl

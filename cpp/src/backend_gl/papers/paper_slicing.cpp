#include "papers/paper_slicing.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>

#include <glm/geometric.hpp>

#include "base/memory.hpp"
#include "interop.h"
#include "plan/limits_common.hpp"
#include "resources.hpp"
#include "splatting.hpp"

namespace sheetsplat::backend_gl {

namespace {

constexpr double log2_e = 1.4426950408889634;
/// A kernel's polygon is two triangles.
constexpr std::size_t corners = 6;

/// A texture of one texel a kernel, row by row.
gl::Texture texture_of(const gl::Api& gl, GLenum format, std::size_t texels) {
    const auto rows = std::max<std::size_t>((texels + KERNEL_COLUMNS - 1) / KERNEL_COLUMNS, 1);
    return gl::Texture(gl, format, KERNEL_COLUMNS, static_cast<int>(rows));
}

std::size_t padded(std::size_t texels) {
    return std::max<std::size_t>((texels + KERNEL_COLUMNS - 1) / KERNEL_COLUMNS, 1) * KERNEL_COLUMNS;
}

float f(double value) { return static_cast<float>(value); }

} // namespace

PaperSlicing::PaperSlicing(const gl::Api& gl, bool opengl_4) : gl_(&gl), opengl_4_(opengl_4), no_attributes_(gl) {}

PaperSlicing::Entry& PaperSlicing::entry_of(const std::shared_ptr<const EllipsoidField>& kernels) {
    const auto kept = entries_.find(kernels.get());
    if (kept != entries_.end()) {
        return kept->second;
    }
    const EllipsoidField& field = *kernels;
    const std::size_t n = field.size();
    Entry entry;
    entry.kernels = kernels;
    const Vec3 extent = field.supports_world().extent();
    const double largest_extent = 0.5 * std::max({extent.x, extent.y, extent.z});
    entry.length_unit = largest_extent > 0.0 ? largest_extent : 1.0;
    // Products of value and weight are scaled before float32 sees them.
    double largest = 0.0;
    for (std::size_t i = 0; i < n; ++i) {
        largest = std::max(largest, std::abs(field.value(i) * field.weight(i)));
    }
    entry.value_unit = largest > 0.0 ? largest : 1.0;

    require_memory(checked_product(padded(n), 12 * sizeof(float), "the kernels as textures"), "the kernels as textures",
                   "use fewer kernels at a time");
    const Vec3 middle = field.centres_world().centre();
    std::vector<float> center(4 * padded(n), 0.0F), scale(4 * padded(n), 0.0F), rotation(4 * padded(n), 0.0F);
    for (std::size_t i = 0; i < n; ++i) {
        const Vec3 at = (field.center(i) - middle) / entry.length_unit;
        const Vec3 axes = field.semi_axes(i) / entry.length_unit;
        const glm::dquat turn =
            field.arrays().rotations.empty() ? glm::dquat(1.0, 0.0, 0.0, 0.0) : field.arrays().rotations[i];
        const auto put = [&](std::vector<float>& to, double x, double y, double z, double w) {
            to[4 * i] = f(x);
            to[4 * i + 1] = f(y);
            to[4 * i + 2] = f(z);
            to[4 * i + 3] = f(w);
        };
        put(center, at.x, at.y, at.z, field.value(i) * field.weight(i) / entry.value_unit);
        put(scale, axes.x, axes.y, axes.z, field.weight(i));
        put(rotation, turn.x, turn.y, turn.z, turn.w);
    }
    const auto uploaded = [&](const std::vector<float>& texels) {
        gl::Texture texture = texture_of(*gl_, GL_RGBA32F, n);
        texture.upload(GL_RGBA, GL_FLOAT, texels.data());
        return texture;
    };
    entry.center = uploaded(center);
    entry.scale = uploaded(scale);
    entry.rotation = uploaded(rotation);
    return entries_.emplace(kernels.get(), std::move(entry)).first->second;
}

void PaperSlicing::slice(Resources& resources, const std::shared_ptr<const EllipsoidField>& kernels,
                         const EllipsoidView& view, const CellTraversal& traversal) {
    Entry& entry = entry_of(kernels);
    const Frame& frame = view.frame();
    const std::size_t n = traversal.kernels();
    // Cell by cell, as the lists of vertices will be drawn.
    std::vector<std::uint32_t> order(padded(n), 0U);
    entry.met.assign(static_cast<std::size_t>(frame.slices) + 1, 0U);
    for (std::size_t e = 0; e < n; ++e) {
        const CellTraversal::Entry& one = traversal.entries()[e];
        order[e] = one.kernel;
        ++entry.met[static_cast<std::size_t>(one.first_batch)];
        --entry.met[static_cast<std::size_t>(one.last_batch) + 1];
    }
    for (std::size_t at = 1; at < entry.met.size(); ++at) {
        entry.met[at] += entry.met[at - 1];
    }
    if (n == 0) {
        return;
    }
    const int rows = static_cast<int>(padded(n) / KERNEL_COLUMNS);
    if (!entry.start || entry.start.height() != rows) {
        entry.framebuffer = gl::Framebuffer();
        entry.order = texture_of(*gl_, GL_R32UI, n);
        entry.start = texture_of(*gl_, GL_RGBA32F, n);
        entry.axes = texture_of(*gl_, GL_RGBA32F, n);
        entry.step = texture_of(*gl_, GL_RGBA32F, n);
        entry.framebuffer = gl::Framebuffer(*gl_, {&entry.start, &entry.axes, &entry.step});
    }
    entry.order.upload(GL_RED_INTEGER, GL_UNSIGNED_INT, order.data());

    // The field's centre in pixels from the optical axis, rows downwards, and in slices. In float32 starts are counted
    // from whole ones there, so that no place loses digits to where the camera is; in float64 they lose none to where
    // the field's centre is.
    const Vec3 from_eye = kernels->centres_world().centre() - view.eye_world();
    const double x = glm::dot(from_eye, view.right_world()) / frame.pixel;
    const double y = -glm::dot(from_eye, view.up_world()) / frame.pixel;
    const double at = (-glm::dot(from_eye, view.back_world()) - frame.first_depth) / frame.slice_spacing;
    entry.whole_x = opengl_4_ ? 0.0 : std::floor(x);
    entry.whole_y = opengl_4_ ? 0.0 : std::floor(y);
    entry.whole_slice = std::floor(at);

    gl::Defines defines;
    if (opengl_4_) {
        defines["FLOAT64"] = "1";
    }
    const gl::Program& program =
        resources.program({"paper_slice.vert", "paper_slice.frag", defines, {"start_out", "axes_out", "step_out"}});
    program.use();
    program.bind("order_texture", entry.order, UNIT_KERNEL_ORDER);
    program.bind("center_texture", entry.center, UNIT_KERNEL_CENTER);
    program.bind("scale_texture", entry.scale, UNIT_KERNEL_SCALE);
    program.bind("rotation_texture", entry.rotation, UNIT_KERNEL_ROTATION);
    const auto set = [&](const char* name, const Vec3& v) {
        if (opengl_4_) {
            program.set(name, v.x, v.y, v.z);
        } else {
            program.set(name, f(v.x), f(v.y), f(v.z));
        }
    };
    const auto set_one = [&](const char* name, double number) {
        opengl_4_ ? program.set(name, number) : program.set(name, f(number));
    };
    set("right", view.right_world());
    set("up", view.up_world());
    set("back", view.back_world());
    set("middle", Vec3(x - entry.whole_x, y - entry.whole_y, at - entry.whole_slice));
    set_one("pixels", entry.length_unit / frame.pixel);
    set_one("slices", entry.length_unit / frame.slice_spacing);
    program.set("value_scale", f(entry.value_unit * view.value_scale()));
    program.set("weight_scale", f(view.weight_scale()));
    program.set("least_weight", f(least_drawn_weight));
    gl_->Viewport(0, 0, KERNEL_COLUMNS, rows);
    gl_->Disable(GL_SCISSOR_TEST);
    gl_->Disable(GL_DEPTH_TEST);
    gl_->Disable(GL_BLEND);
    gl_->ColorMask(GL_TRUE, GL_TRUE, GL_TRUE, GL_TRUE);
    entry.framebuffer.bind();
    no_attributes_.bind();
    gl_->DrawArrays(GL_TRIANGLES, 0, 3);
    gl::check_errors(*gl_, "slicing the ellipsoids by textures");
}

const gl::Texture& PaperSlicing::table(double falloff, int cells) {
    gl::Texture& kept = tables_[falloff];
    if (!kept || kept.width() != cells + 1) {
        const auto side = static_cast<std::size_t>(cells) + 1;
        std::vector<double> bell(side);
        for (std::size_t i = 0; i < side; ++i) {
            const double at = static_cast<double>(i) / cells;
            bell[i] = std::exp(-falloff * at * at);
        }
        std::vector<float> texels(side * side);
        for (std::size_t j = 0; j < side; ++j) {
            for (std::size_t i = 0; i < side; ++i) {
                texels[j * side + i] = f(bell[i] * bell[j]);
            }
        }
        kept = gl::Texture(*gl_, GL_R32F, cells + 1, cells + 1);
        kept.upload(GL_RED, GL_FLOAT, texels.data());
    }
    return kept;
}

void PaperSlicing::splat(Splatting& splatting, std::size_t part, std::int64_t pass) {
    const EllipsoidPart& ellipsoids = splatting.scope.job.ellipsoids[part];
    std::vector<std::size_t> cells;
    splatting.for_each_active(part, [&](std::size_t number, const PixelBox&) { cells.push_back(number); });
    splatting.drawn += kernels_at(ellipsoids.view->field(), pass);
    splatting.for_each_target(ellipsoids.field, false, [&](const SplatTarget& target) {
        splatting.bind_target(target, pass);
        draw(splatting.scope, ellipsoids, cells, target, splatting.slab_pass(pass));
    });
}

void PaperSlicing::draw(const TileScope& scope, const EllipsoidPart& ellipsoids, const std::vector<std::size_t>& cells,
                        const SplatTarget& target, const SlabPass& pass) {
    if (cells.empty()) {
        return;
    }
    const EllipsoidView& view = *ellipsoids.view;
    const Entry& entry = entries_.at(&view.field());
    const double k = view.field().kernel().falloff;
    const gl::Texture& gaussian = table(k, scope.plan.gaussian_cells);
    gl::Defines defines;
    if (target.weight) {
        defines["WEIGHT"] = "1";
    }
    if (opengl_4_) {
        defines["GATHER"] = "1";
    }
    const gl::Program& program = scope.resources.program(
        {"paper_splat.vert", "paper_splat.frag", std::move(defines), splat_outputs(scope.plan, target)});
    program.use();
    program.bind("start_texture", entry.start, UNIT_SLICED_START);
    program.bind("axes_texture", entry.axes, UNIT_SLICED_AXES);
    program.bind("step_texture", entry.step, UNIT_SLICED_STEP);
    program.bind("gaussian_texture", gaussian, UNIT_GAUSSIAN);
    program.set("gaussian_cells", f(gaussian.width() - 1));
    program.set("falloff_log2", f(k * log2_e));
    program.set("edge", f(view.field().kernel().edge()));
    program.set("current_slice", f(static_cast<double>(pass.first_slab) - entry.whole_slice));
    program.set("origin", f(pass.axis_x + entry.whole_x), f(pass.axis_y + entry.whole_y));
    program.set("target_size", f(pass.target_width), f(pass.target_height));
    program.set("tag", pass.tag);
    program.set("margin", f(pass.margin));
    firsts_.clear();
    counts_.clear();
    for (const std::size_t number : cells) {
        const CellTraversal::Cell& cell = ellipsoids.traversal->cells()[number];
        firsts_.push_back(static_cast<GLint>(cell.begin * corners));
        counts_.push_back(static_cast<GLsizei>((cell.end - cell.begin) * corners));
    }
    scope.write_channel(scope.channel_of(pass.first_slab));
    no_attributes_.bind();
    gl_->MultiDrawArrays(GL_TRIANGLES, firsts_.data(), counts_.data(), static_cast<GLsizei>(firsts_.size()));
    scope.write_all_channels();
}

std::size_t PaperSlicing::kernels_at(const EllipsoidField& field, std::int64_t slice) const {
    const std::vector<std::uint32_t>& met = entries_.at(&field).met;
    return slice < static_cast<std::int64_t>(met.size()) ? met[static_cast<std::size_t>(slice)] : 0;
}

void PaperSlicing::keep(const std::vector<const EllipsoidField*>& fields) {
    const auto used = [&](double falloff) {
        return std::any_of(fields.begin(), fields.end(),
                           [&](const EllipsoidField* field) { return field->kernel().falloff == falloff; });
    };
    for (auto table = tables_.begin(); table != tables_.end();) {
        table = used(table->first) ? std::next(table) : tables_.erase(table);
    }
    for (auto entry = entries_.begin(); entry != entries_.end();) {
        const bool kept = std::find(fields.begin(), fields.end(), entry->first) != fields.end();
        entry = kept ? std::next(entry) : entries_.erase(entry);
    }
}

std::size_t PaperSlicing::bytes() const {
    std::size_t sum = 0;
    for (const auto& [falloff, texture] : tables_) {
        sum += texture.bytes();
    }
    for (const auto& [field, entry] : entries_) {
        for (const gl::Texture* texture :
             {&entry.center, &entry.scale, &entry.rotation, &entry.order, &entry.start, &entry.axes, &entry.step}) {
            sum += texture->bytes();
        }
    }
    return sum;
}

} // namespace sheetsplat::backend_gl

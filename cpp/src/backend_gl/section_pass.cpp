#include "section_pass.hpp"

#include <algorithm>

#include "backend_gl/embedded_glsl.hpp"
#include "base/memory.hpp"
#include "interop.h"
#include "plan/limits_gl.hpp"

namespace sheetsplat::backend_gl {

namespace {

/// What the vertex program gets for one kernel.
struct KernelVertex {
    double center[3];
    double axes[9];
    double value, weight;
};
static_assert(sizeof(KernelVertex) == 112, "attributes are read at fixed places");

} // namespace

SectionPass::SectionPass(const gl::Api& gl)
    : gl_(&gl), pixel_(gl, GL_RGBA8, 1, 1), nowhere_(gl, std::vector<gl::Attachment>{&pixel_}) {}

const gl::Program& SectionPass::program(Projection projection, bool rests) {
    gl::Program& made = programs_[projection == Projection::perspective ? 1 : 0][rests ? 1 : 0];
    if (!made) {
        gl::Defines defines;
        if (projection == Projection::perspective) {
            defines["PERSPECTIVE"] = "1";
        }
        std::vector<std::string> captured{"record_place", "record_heights", "record_axes", "record_step"};
        if (rests) {
            defines["RESTS"] = "1";
            captured.insert(captured.end(), {"rest_heights", "rest_axes", "rest_step"});
        }
        made = gl::Program::capturing(*gl_, embedded_glsl(), "section.vert", defines, "#version 410 core", captured);
    }
    return made;
}

SectionPass::Entry& SectionPass::entry_of(const std::shared_ptr<const EllipsoidField>& kernels) {
    const auto known = entries_.find(kernels.get());
    if (known != entries_.end()) {
        return known->second;
    }
    Entry entry;
    entry.kernels = kernels;
    entry.input = gl::Buffer(*gl_, GL_ARRAY_BUFFER);
    entry.array = gl::VertexArray(*gl_);
    const EllipsoidField& field = *kernels;
    const Vec3 middle = field.centres_world().centre();
    auto* vertices = static_cast<KernelVertex*>(
        entry.input.map(checked_product(field.size(), sizeof(KernelVertex), "the kernels on the device")));
    for (std::size_t i = 0; i < field.size(); ++i) {
        const Vec3 center = field.center(i) - middle;
        const Mat3 shape = field.shape(i);
        KernelVertex vertex{};
        for (int axis = 0; axis < 3; ++axis) {
            vertex.center[axis] = center[axis];
            for (int part = 0; part < 3; ++part) {
                vertex.axes[3 * axis + part] = shape[axis][part];
            }
        }
        vertex.value = field.value(i);
        vertex.weight = field.weight(i);
        vertices[i] = vertex;
    }
    entry.input.unmap();
    entry.array.bind();
    entry.input.bind();
    const auto attribute = [&](GLuint location, GLint size, std::size_t offset) {
        gl_->EnableVertexAttribArray(location);
        gl_->VertexAttribLPointer(location, size, GL_DOUBLE, sizeof(KernelVertex),
                                  reinterpret_cast<const void*>(offset));
    };
    attribute(ATTRIBUTE_KERNEL_CENTER, 3, 0);
    for (GLuint axis = 0; axis < 3; ++axis) {
        attribute(ATTRIBUTE_KERNEL_AXIS_A + axis, 3, (3 + 3 * axis) * sizeof(double));
    }
    attribute(ATTRIBUTE_KERNEL_AMOUNT, 2, 12 * sizeof(double));
    return entries_.emplace(kernels.get(), std::move(entry)).first->second;
}

void SectionPass::make_output(Entry& entry) const {
    if (entry.output.name() != 0) {
        return;
    }
    entry.output = gl::Buffer(*gl_, GL_ARRAY_BUFFER);
    // Storage alone: the pass fills it.
    static_cast<void>(
        entry.output.map(checked_product(entry.kernels->size(), sizeof(SectionRecord), "the sections on the device")));
    entry.output.unmap();
    entry.texture = gl::BufferTexture(*gl_, GL_RGBA32F, entry.output);
}

void SectionPass::slice(const std::shared_ptr<const EllipsoidField>& kernels, const EllipsoidView& view,
                        const Counting& counting) {
    if (kernels->size() == 0) {
        return;
    }
    Entry& entry = entry_of(kernels);
    make_output(entry);
    slice(kernels, view, counting, entry.output, 0, false);
}

void SectionPass::slice(const std::shared_ptr<const EllipsoidField>& kernels, const EllipsoidView& view,
                        const Counting& counting, const gl::Buffer& into, std::size_t first, bool rests) {
    if (kernels->size() == 0 || view.frame().slices == 0) {
        return;
    }
    const Entry& entry = entry_of(kernels);
    const Frame& frame = view.frame();
    const gl::Program& pass = program(frame.projection, rests);
    pass.use();
    // The eye from the field's centre: what is left keeps its digits wherever both are.
    const Vec3 eye = view.eye_world() - kernels->centres_world().centre();
    const auto set = [&](const char* name, const Vec3& v) { pass.set(name, v.x, v.y, v.z); };
    set("eye", eye);
    set("right", view.right_world());
    set("up", view.up_world());
    set("back", view.back_world());
    pass.set("pixel", frame.pixel);
    pass.set("slice_spacing", frame.slice_spacing);
    pass.set("first_depth", frame.first_depth);
    pass.set("last_slice", static_cast<double>(frame.slices - 1));
    pass.set("pivot", counting.pivot);
    pass.set("half_range", counting.half_range);
    pass.set("value_scale", view.value_scale());
    pass.set("weight_scale", view.weight_scale());
    pass.set("least_weight", least_drawn_weight);
    pass.set("precise_aspect", gl_limits::largest_resident_aspect);
    pass.set("least_px", gl_limits::least_plain_px);
    const std::size_t bytes = sizeof(SectionRecord) + (rests ? sizeof(SectionRest) : 0);
    nowhere_.bind();
    entry.array.bind();
    gl_->BindBufferRange(GL_TRANSFORM_FEEDBACK_BUFFER, 0, into.name(), static_cast<GLintptr>(first * bytes),
                         static_cast<GLsizeiptr>(kernels->size() * bytes));
    gl_->Enable(GL_RASTERIZER_DISCARD);
    gl_->BeginTransformFeedback(GL_POINTS);
    gl_->DrawArrays(GL_POINTS, 0, static_cast<GLsizei>(kernels->size()));
    gl_->EndTransformFeedback();
    gl_->Disable(GL_RASTERIZER_DISCARD);
    gl_->BindBufferBase(GL_TRANSFORM_FEEDBACK_BUFFER, 0, 0);
    gl::check_errors(*gl_, "slicing the ellipsoids");
}

const gl::BufferTexture& SectionPass::records(const EllipsoidField& field) const { return entries_.at(&field).texture; }

void SectionPass::keep(const std::vector<const EllipsoidField*>& fields) {
    for (auto entry = entries_.begin(); entry != entries_.end();) {
        const bool used = std::find(fields.begin(), fields.end(), entry->first) != fields.end();
        entry = used ? std::next(entry) : entries_.erase(entry);
    }
}

std::size_t SectionPass::bytes() const {
    std::size_t sum = 0;
    for (const auto& [field, entry] : entries_) {
        sum += entry.input.capacity() + entry.output.capacity();
    }
    return sum;
}

} // namespace sheetsplat::backend_gl

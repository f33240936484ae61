#include "targets.hpp"

#include <array>
#include <limits>

#include "interop.h"

namespace sheetsplat::backend_gl {

bool TargetShape::operator==(const TargetShape& other) const {
    return width == other.width && height == other.height && sheet_format == other.sheet_format && wide == other.wide &&
           sheets == other.sheets && weight == other.weight && slopes == other.slopes &&
           weight_slopes == other.weight_slopes && shared_depth == other.shared_depth && depth == other.depth &&
           coverage == other.coverage && compensated == other.compensated && doubts == other.doubts &&
           copies == other.copies && own == other.own && groups == other.groups;
}

namespace {

/// Attachments as the splat shaders' outputs are numbered: the values of all sheets or their weights, then what
/// changes.
void append(std::vector<gl::Attachment>& list, const std::vector<const Sheet*>& sheets, bool weights, bool slopes,
            int layer = 0) {
    for (const Sheet* sheet : sheets) {
        list.emplace_back(weights ? &sheet->weight : &sheet->value, layer);
    }
    for (int axis = 0; slopes && axis < 3; ++axis) {
        for (const Sheet* sheet : sheets) {
            list.emplace_back(weights ? &sheet->weight_slope[axis] : &sheet->slope[axis], layer);
        }
    }
}

} // namespace

void Sheet::bind(const gl::Program& program, const std::string& side) const {
    // Samplers of the back follow those of the front.
    const int offset = side == "back" ? 1 : 0;
    const auto bind_plane = [&](const gl::Texture& plane, const std::string& name, int front_unit) {
        if (plane) {
            program.bind(name + "_" + side + "_texture", plane, front_unit + offset);
        }
    };
    bind_plane(value, "sheet", UNIT_SHEET_FRONT);
    bind_plane(weight, "weight", UNIT_WEIGHT_FRONT);
    constexpr std::array<const char*, 3> axes{"x", "y", "z"};
    for (int axis = 0; axis < 3; ++axis) {
        const std::string name = axes[static_cast<std::size_t>(axis)];
        bind_plane(slope[axis], name, UNIT_SLOPE_X_FRONT + 2 * axis);
        bind_plane(weight_slope[axis], "weight_" + name, UNIT_WEIGHT_X_FRONT + 2 * axis);
    }
}

std::size_t Sheet::bytes() const {
    std::size_t sum = value.bytes() + weight.bytes();
    for (int axis = 0; axis < 3; ++axis) {
        sum += slope[axis].bytes() + weight_slope[axis].bytes();
    }
    return sum;
}

Sheet Targets::make_sheet(bool weight, bool weight_slopes, int layers) const {
    const auto texture = [&](bool wanted) {
        return wanted ? gl::Texture(*gl_, shape_.sheet_format, shape_.width, shape_.height, layers) : gl::Texture();
    };
    Sheet sheet;
    sheet.value = texture(true);
    sheet.weight = texture(weight);
    for (int axis = 0; axis < 3; ++axis) {
        sheet.slope[axis] = texture(shape_.slopes);
        sheet.weight_slope[axis] = texture(shape_.slopes && weight_slopes);
    }
    return sheet;
}

Targets::Ways Targets::make_ways(const std::vector<Sheet>& sheets, bool weight, int layer) const {
    const gl::Texture* tags = shape_.shared_depth ? &depth_tags_ : nullptr;
    const bool weight_slopes = static_cast<bool>(sheets.front().weight_slope[0]);
    Ways ways;
    for (std::size_t r = 0; r < sheets.size(); ++r) {
        const auto made = [&](bool both, bool weights, const gl::Texture* depth) {
            std::vector<const Sheet*> drawn{&sheets[r]};
            if (both && shape_.wide) {
                drawn.push_back(&sheets[(r + 1) % sheets.size()]);
            }
            std::vector<gl::Attachment> colors;
            append(colors, drawn, weights, weights ? weight_slopes : shape_.slopes, layer);
            if (weight && !shape_.slopes) {
                append(colors, drawn, true, false, layer);
            }
            return gl::Framebuffer(*gl_, colors, depth);
        };
        const auto add = [&](Way& way, bool weights) {
            way.both.push_back(made(true, weights, tags));
            way.clear.push_back(made(false, weights, nullptr));
            if (shape_.wide) {
                way.one.push_back(made(false, weights, tags));
            }
        };
        add(ways.values, false);
        if (weight && shape_.slopes) {
            add(ways.weights, true);
        }
    }
    return ways;
}

Targets::Targets(const gl::Api& gl, const TargetShape& shape) : gl_(&gl), shape_(shape) {
    const auto texture = [&](GLenum format) { return gl::Texture(gl, format, shape.width, shape.height); };
    const int count = !shape.sheets ? 0 : shape.wide ? 3 : 2;
    for (int r = 0; r < count; ++r) {
        sheets_.push_back(make_sheet(shape.weight, shape.weight_slopes, shape.groups > 1 ? shape.groups : 0));
    }
    if (shape.shared_depth) {
        depth_tags_ = texture(GL_DEPTH_COMPONENT32F);
    }
    const gl::Texture* tags = shape.shared_depth ? &depth_tags_ : nullptr;
    const auto add = [&](bool wanted, GLenum format, const char* sampler, int unit, float empty) {
        if (wanted) {
            pictures_.push_back({sampler, unit, empty, texture(format), {}});
            if (shape.copies) {
                pictures_.back().copy = texture(format);
            }
        }
    };
    add(true, GL_RGBA32F, "image_texture", UNIT_IMAGE, 0.0F);
    add(shape.depth, GL_R32F, "image_depth_texture", UNIT_IMAGE_DEPTH, std::numeric_limits<float>::infinity());
    add(shape.coverage, GL_RG32F, "image_coverage_texture", UNIT_IMAGE_COVERAGE, 0.0F);
    add(shape.compensated, GL_RGBA32F, "image_error_texture", UNIT_IMAGE_ERROR, 0.0F);
    add(shape.doubts, GL_RGBA32F, "image_doubt_texture", UNIT_IMAGE_DOUBT, 0.0F);
    std::vector<gl::Attachment> attachments;
    for (const Picture& picture : pictures_) {
        attachments.emplace_back(&picture.now);
    }
    image_fbo_ = gl::Framebuffer(gl, attachments, tags);
    if (tags != nullptr) {
        depth_fbo_ = gl::Framebuffer(gl, {}, tags);
    }
    if (!shape.sheets) {
        return;
    }
    for (int group = 0; group < shape.groups; ++group) {
        ways_.push_back(make_ways(sheets_, shape.weight, group));
    }
    for (int field = 0; field < shape.own; ++field) {
        Own& own = own_.emplace_back();
        for (int r = 0; r < (shape.wide ? 3 : 1); ++r) {
            own.sheets.push_back(make_sheet(true, true, 0));
        }
        own.ways = make_ways(own.sheets, true, 0);
    }
    for (int group = 0; shape.own > 0 && group < shape.groups; ++group) {
        for (const Sheet& summed : sheets_) {
            const std::vector<const Sheet*> sheet{&summed};
            std::vector<gl::Attachment> colors;
            append(colors, sheet, false, shape.slopes, group);
            if (shape.weight) {
                append(colors, sheet, true, false, group);
            }
            sum_.emplace_back(gl, colors, nullptr);
        }
    }
    if (!shape.wide) {
        const std::vector<const Sheet*> sheet{&sheets_[1]};
        std::vector<gl::Attachment> colors;
        append(colors, sheet, false, shape.slopes);
        if (shape.weight && !shape.slopes) {
            append(colors, sheet, true, false);
        }
        copy_ = gl::Framebuffer(gl, colors, tags);
        if (shape.weight && shape.slopes) {
            colors.clear();
            append(colors, sheet, true, shape.weight_slopes);
            copy_weight_ = gl::Framebuffer(gl, colors, tags);
        }
    }
}

std::size_t Targets::bytes() const {
    std::size_t sum = depth_tags_.bytes();
    for (const Picture& picture : pictures_) {
        sum += picture.now.bytes() + picture.copy.bytes();
    }
    for (const Own& own : own_) {
        for (const Sheet& sheet : own.sheets) {
            sum += sheet.bytes();
        }
    }
    for (const Sheet& sheet : sheets_) {
        sum += sheet.bytes();
    }
    return sum;
}

void Targets::clear(const Ways& ways, int r) const {
    gl_->ClearColor(0.0F, 0.0F, 0.0F, 0.0F);
    for (const Way* way : {&ways.values, &ways.weights}) {
        if (!way->clear.empty()) {
            way->clear[static_cast<std::size_t>(r)].bind();
            gl_->Clear(GL_COLOR_BUFFER_BIT);
        }
    }
}

void Targets::clear_sheet(int r) const {
    for (const Ways& ways : ways_) {
        clear(ways, r);
    }
}

void Targets::clear_own(int field, int r) const { clear(own_[static_cast<std::size_t>(field)].ways, r); }

void Targets::clear_tags() const {
    if (shape_.shared_depth) {
        depth_fbo_.bind();
        gl_->DepthMask(GL_TRUE);
        gl_->ClearDepth(1.0);
        gl_->Clear(GL_DEPTH_BUFFER_BIT);
    }
}

void Targets::clear_sheets() const {
    gl_->Disable(GL_SCISSOR_TEST);
    gl_->ColorMask(GL_TRUE, GL_TRUE, GL_TRUE, GL_TRUE);
    for (int r = 0; r < static_cast<int>(sheets_.size()); ++r) {
        clear_sheet(r);
    }
    for (std::size_t field = 0; field < own_.size(); ++field) {
        for (std::size_t r = 0; r < own_[field].sheets.size(); ++r) {
            clear_own(static_cast<int>(field), static_cast<int>(r));
        }
    }
}

void Targets::fill(int r, const std::vector<float>& empty) const {
    for (std::size_t group = 0; group < empty.size(); ++group) {
        if (empty[group] != 0.0F) {
            const float values[4] = {empty[group], empty[group], empty[group], empty[group]};
            ways_[group].values.clear[static_cast<std::size_t>(r)].bind();
            gl_->ClearBufferfv(GL_COLOR, 0, values);
        }
    }
}

void Targets::clear_all() const {
    clear_sheets();
    image_fbo_.bind();
    for (std::size_t i = 0; i < pictures_.size(); ++i) {
        const float start[4] = {pictures_[i].empty, 0.0F, 0.0F, 0.0F};
        gl_->ClearBufferfv(GL_COLOR, static_cast<GLint>(i), start);
    }
    clear_tags();
}

void Targets::start_behind(const std::vector<float>& rgba) const {
    pictures_.front().now.upload(GL_RGBA, GL_FLOAT, rgba.data());
}

void Targets::bind_so_far(const gl::Program& program) const {
    image_fbo_.bind();
    for (std::size_t i = 0; i < pictures_.size(); ++i) {
        const Picture& picture = pictures_[i];
        program.bind(picture.sampler, shape_.copies ? picture.copy : picture.now, picture.unit);
        if (shape_.copies) {
            gl_->ReadBuffer(static_cast<GLenum>(GL_COLOR_ATTACHMENT0 + i));
            gl_->CopyTexSubImage2D(GL_TEXTURE_2D, 0, 0, 0, 0, 0, shape_.width, shape_.height);
        }
    }
}

void Targets::bind_images() const {
    for (const Picture& picture : pictures_) {
        const int image = picture.unit == UNIT_IMAGE            ? IMAGE_PICTURE
                          : picture.unit == UNIT_IMAGE_DEPTH    ? IMAGE_DEPTH
                          : picture.unit == UNIT_IMAGE_COVERAGE ? IMAGE_COVERAGE
                          : picture.unit == UNIT_IMAGE_ERROR    ? IMAGE_ERROR
                                                                : IMAGE_DOUBT;
        picture.now.bind_image(image);
    }
}

void Targets::read(int attachment, int x, int y, int width, int height, GLenum format, float* out) const {
    image_fbo_.bind();
    gl_->ReadBuffer(GL_COLOR_ATTACHMENT0 + static_cast<GLenum>(attachment));
    gl_->PixelStorei(GL_PACK_ALIGNMENT, 4);
    gl_->ReadPixels(x, y, width, height, format, GL_FLOAT, out);
}

} // namespace sheetsplat::backend_gl

#include "targets.hpp"

#include <limits>

#include "interop.h"

namespace sheetsplat::backend_gl {

bool TargetShape::operator==(const TargetShape& other) const {
    return width == other.width && height == other.height && sheet_format == other.sheet_format && wide == other.wide &&
           weight == other.weight && slopes == other.slopes && weight_slopes == other.weight_slopes &&
           shared_depth == other.shared_depth && depth == other.depth && coverage == other.coverage &&
           compensated == other.compensated && copies == other.copies && own == other.own;
}

namespace {

/// Attachments as the splat shaders' outputs are numbered: the values of all sheets or their weights, then what
/// changes.
void append(std::vector<const gl::Texture*>& list, const std::vector<const Sheet*>& sheets, bool weights, bool slopes) {
    for (const Sheet* sheet : sheets) {
        list.push_back(weights ? &sheet->weight : &sheet->value);
    }
    for (int axis = 0; slopes && axis < 3; ++axis) {
        for (const Sheet* sheet : sheets) {
            list.push_back(weights ? &sheet->weight_slope[axis] : &sheet->slope[axis]);
        }
    }
}

} // namespace

Sheet Targets::make_sheet(bool weight, bool weight_slopes) const {
    const auto texture = [&](bool wanted) {
        return wanted ? gl::Texture(*gl_, shape_.sheet_format, shape_.width, shape_.height) : gl::Texture();
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

Targets::Ways Targets::make_ways(const std::vector<Sheet>& sheets, bool weight) const {
    const gl::Texture* tags = shape_.shared_depth ? &depth_tags_ : nullptr;
    const bool weight_slopes = static_cast<bool>(sheets.front().weight_slope[0]);
    Ways ways;
    for (std::size_t r = 0; r < sheets.size(); ++r) {
        const auto made = [&](bool both, bool weights, const gl::Texture* depth) {
            std::vector<const Sheet*> drawn{&sheets[r]};
            if (both && shape_.wide) {
                drawn.push_back(&sheets[(r + 1) % sheets.size()]);
            }
            std::vector<const gl::Texture*> colors;
            append(colors, drawn, weights, weights ? weight_slopes : shape_.slopes);
            if (weight && !shape_.slopes) {
                append(colors, drawn, true, false);
            }
            return gl::Framebuffer(*gl_, colors, depth);
        };
        ways.values.push_back(made(true, false, tags));
        ways.clear.push_back(made(false, false, nullptr));
        if (shape_.wide) {
            ways.one.push_back(made(false, false, tags));
        }
        if (weight && shape_.slopes) {
            ways.weights.push_back(made(true, true, tags));
            ways.clear_weights.push_back(made(false, true, nullptr));
            if (shape_.wide) {
                ways.one_weights.push_back(made(false, true, tags));
            }
        }
    }
    return ways;
}

Targets::Targets(const gl::Api& gl, const TargetShape& shape) : gl_(&gl), shape_(shape) {
    const int w = shape.width;
    const int h = shape.height;
    const int count = shape.wide ? 3 : 2;
    for (int r = 0; r < count; ++r) {
        sheets_.push_back(make_sheet(shape.weight, shape.weight_slopes));
    }
    if (shape.shared_depth) {
        depth_tags_ = gl::Texture(gl, GL_DEPTH_COMPONENT32F, w, h);
    }
    const gl::Texture* tags = shape.shared_depth ? &depth_tags_ : nullptr;
    image_ = gl::Texture(gl, GL_RGBA32F, w, h);
    std::vector<const gl::Texture*> picture{&image_};
    if (shape.depth) {
        image_depth_ = gl::Texture(gl, GL_R32F, w, h);
        picture.push_back(&image_depth_);
    }
    if (shape.coverage) {
        image_coverage_ = gl::Texture(gl, GL_RG32F, w, h);
        picture.push_back(&image_coverage_);
    }
    if (shape.compensated) {
        image_error_ = gl::Texture(gl, GL_RGBA32F, w, h);
        picture.push_back(&image_error_);
    }
    if (shape.copies) {
        image_copy_ = gl::Texture(gl, GL_RGBA32F, w, h);
        if (shape.depth) {
            image_depth_copy_ = gl::Texture(gl, GL_R32F, w, h);
        }
        if (shape.coverage) {
            image_coverage_copy_ = gl::Texture(gl, GL_RG32F, w, h);
        }
        if (shape.compensated) {
            image_error_copy_ = gl::Texture(gl, GL_RGBA32F, w, h);
        }
    }
    image_fbo_ = gl::Framebuffer(gl, picture, tags);
    if (tags != nullptr) {
        depth_fbo_ = gl::Framebuffer(gl, {}, tags);
    }
    ways_ = make_ways(sheets_, shape.weight);
    for (int field = 0; field < shape.own; ++field) {
        Own& own = own_.emplace_back();
        for (int r = 0; r < (shape.wide ? 3 : 1); ++r) {
            own.sheets.push_back(make_sheet(true, true));
        }
        own.ways = make_ways(own.sheets, true);
    }
    for (int r = 0; shape.own > 0 && r < count; ++r) {
        const std::vector<const Sheet*> sheet{&sheets_[static_cast<std::size_t>(r)]};
        std::vector<const gl::Texture*> colors;
        append(colors, sheet, false, shape.slopes);
        if (shape.weight) {
            append(colors, sheet, true, false);
        }
        sum_.emplace_back(gl, colors, nullptr);
    }
    if (!shape.wide) {
        const std::vector<const Sheet*> sheet{&sheets_[1]};
        std::vector<const gl::Texture*> colors;
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
    std::size_t sum = depth_tags_.bytes() + image_.bytes() + image_depth_.bytes() + image_coverage_.bytes() +
                      image_copy_.bytes() + image_depth_copy_.bytes() + image_coverage_copy_.bytes() +
                      image_error_.bytes() + image_error_copy_.bytes();
    const auto add = [&](const Sheet& sheet) {
        sum += sheet.value.bytes() + sheet.weight.bytes();
        for (int axis = 0; axis < 3; ++axis) {
            sum += sheet.slope[axis].bytes() + sheet.weight_slope[axis].bytes();
        }
    };
    for (const Own& own : own_) {
        for (const Sheet& sheet : own.sheets) {
            add(sheet);
        }
    }
    for (const Sheet& sheet : sheets_) {
        add(sheet);
    }
    return sum;
}

void Targets::clear(const Ways& ways, int r) const {
    const auto at = static_cast<std::size_t>(r);
    ways.clear[at].bind();
    gl_->ClearColor(0.0F, 0.0F, 0.0F, 0.0F);
    gl_->Clear(GL_COLOR_BUFFER_BIT);
    if (!ways.clear_weights.empty()) {
        ways.clear_weights[at].bind();
        gl_->Clear(GL_COLOR_BUFFER_BIT);
    }
}

void Targets::clear_sheet(int r) const { clear(ways_, r); }

void Targets::clear_own(int field, int r) const { clear(own_[static_cast<std::size_t>(field)].ways, r); }

void Targets::clear_tags() const {
    if (shape_.shared_depth) {
        depth_fbo_.bind();
        gl_->DepthMask(GL_TRUE);
        gl_->ClearDepth(1.0);
        gl_->Clear(GL_DEPTH_BUFFER_BIT);
    }
}

void Targets::clear_all(float empty) const {
    gl_->Disable(GL_SCISSOR_TEST);
    gl_->ColorMask(GL_TRUE, GL_TRUE, GL_TRUE, GL_TRUE);
    for (int r = 0; r < static_cast<int>(sheets_.size()); ++r) {
        clear_sheet(r);
    }
    if (empty != 0.0F) {
        const float values[4] = {empty, empty, empty, empty};
        ways_.clear.back().bind();
        gl_->ClearBufferfv(GL_COLOR, 0, values);
    }
    for (std::size_t field = 0; field < own_.size(); ++field) {
        for (std::size_t r = 0; r < own_[field].sheets.size(); ++r) {
            clear_own(static_cast<int>(field), static_cast<int>(r));
        }
    }
    image_fbo_.bind();
    const float zero[4] = {0.0F, 0.0F, 0.0F, 0.0F};
    const float far_away[4] = {std::numeric_limits<float>::infinity(), 0.0F, 0.0F, 0.0F};
    int attachment = 0;
    gl_->ClearBufferfv(GL_COLOR, attachment++, zero);
    if (shape_.depth) {
        gl_->ClearBufferfv(GL_COLOR, attachment++, far_away);
    }
    if (shape_.coverage) {
        gl_->ClearBufferfv(GL_COLOR, attachment++, zero);
    }
    if (shape_.compensated) {
        gl_->ClearBufferfv(GL_COLOR, attachment++, zero);
    }
    clear_tags();
}

void Targets::bind_so_far(const gl::Program& program) const {
    program.set("image_texture", UNIT_IMAGE);
    program.set("image_depth_texture", UNIT_IMAGE_DEPTH);
    program.set("image_coverage_texture", UNIT_IMAGE_COVERAGE);
    program.set("image_error_texture", UNIT_IMAGE_ERROR);
    if (!shape_.copies) {
        image_.bind(UNIT_IMAGE);
        if (shape_.depth) {
            image_depth_.bind(UNIT_IMAGE_DEPTH);
        }
        if (shape_.coverage) {
            image_coverage_.bind(UNIT_IMAGE_COVERAGE);
        }
        if (shape_.compensated) {
            image_error_.bind(UNIT_IMAGE_ERROR);
        }
        return;
    }
    image_fbo_.bind();
    int attachment = 0;
    const auto copy = [&](const gl::Texture& to, int unit) {
        gl_->ReadBuffer(GL_COLOR_ATTACHMENT0 + static_cast<GLenum>(attachment++));
        to.bind(unit);
        gl_->CopyTexSubImage2D(GL_TEXTURE_2D, 0, 0, 0, 0, 0, shape_.width, shape_.height);
    };
    copy(image_copy_, UNIT_IMAGE);
    if (shape_.depth) {
        copy(image_depth_copy_, UNIT_IMAGE_DEPTH);
    }
    if (shape_.coverage) {
        copy(image_coverage_copy_, UNIT_IMAGE_COVERAGE);
    }
    if (shape_.compensated) {
        copy(image_error_copy_, UNIT_IMAGE_ERROR);
    }
}

void Targets::read(int attachment, int x, int y, int width, int height, GLenum format, float* out) const {
    image_fbo_.bind();
    gl_->ReadBuffer(GL_COLOR_ATTACHMENT0 + static_cast<GLenum>(attachment));
    gl_->PixelStorei(GL_PACK_ALIGNMENT, 4);
    gl_->ReadPixels(x, y, width, height, format, GL_FLOAT, out);
}

} // namespace sheetsplat::backend_gl

#include "targets.hpp"

#include <limits>

#include "interop.h"

namespace sheetsplat::sheet {

bool TargetShape::operator==(const TargetShape& other) const {
    return width == other.width && height == other.height && sheet_format == other.sheet_format && wide == other.wide &&
           weight == other.weight && fine == other.fine && shared_depth == other.shared_depth && depth == other.depth &&
           coverage == other.coverage && compensated == other.compensated && copies == other.copies && own == other.own;
}

namespace {

/// Attachments of one sheet as the splat shader's outputs are numbered.
void append(std::vector<const gl::Texture*>& list, const std::vector<const Sheet*>& sheets, const TargetShape& shape,
            bool weights) {
    if (!shape.fine) {
        for (const Sheet* sheet : sheets) {
            list.push_back(&sheet->value);
        }
        if (shape.weight) {
            for (const Sheet* sheet : sheets) {
                list.push_back(&sheet->weight);
            }
        }
        return;
    }
    for (const Sheet* sheet : sheets) {
        list.push_back(weights ? &sheet->weight : &sheet->value);
    }
    for (int axis = 0; axis < 3; ++axis) {
        for (const Sheet* sheet : sheets) {
            list.push_back(weights ? &sheet->weight_slope[axis] : &sheet->slope[axis]);
        }
    }
}

} // namespace

Targets::Targets(const gl::Api& gl, const TargetShape& shape) : gl_(&gl), shape_(shape) {
    const int w = shape.width;
    const int h = shape.height;
    const int count = shape.wide ? 3 : 2;
    sheets_.resize(static_cast<std::size_t>(count));
    for (Sheet& sheet : sheets_) {
        sheet.value = gl::Texture(gl, shape.sheet_format, w, h);
        if (shape.weight) {
            sheet.weight = gl::Texture(gl, shape.sheet_format, w, h);
        }
        if (shape.fine) {
            for (int axis = 0; axis < 3; ++axis) {
                sheet.slope[axis] = gl::Texture(gl, shape.sheet_format, w, h);
                if (shape.weight) {
                    sheet.weight_slope[axis] = gl::Texture(gl, shape.sheet_format, w, h);
                }
            }
        }
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
    for (int r = 0; r < (shape.wide ? 3 : 1); ++r) {
        const Sheet& front = sheets_[static_cast<std::size_t>(r)];
        std::vector<const Sheet*> pair{&front};
        if (shape.wide) {
            pair.push_back(&sheets_[static_cast<std::size_t>((r + 1) % 3)]);
        }
        std::vector<const gl::Texture*> colors;
        append(colors, pair, shape, false);
        splat_.emplace_back(gl, colors, tags);
        if (shape.fine && shape.weight) {
            colors.clear();
            append(colors, pair, shape, true);
            splat_weight_.emplace_back(gl, colors, tags);
        }
    }
    for (int r = 0; r < count; ++r) {
        std::vector<const gl::Texture*> colors;
        append(colors, {&sheets_[static_cast<std::size_t>(r)]}, shape, false);
        clear_.emplace_back(gl, colors, nullptr);
        if (shape.wide && !shape.fine) {
            splat_one_.emplace_back(gl, colors, tags);
        }
        if (shape.fine && shape.weight) {
            colors.clear();
            append(colors, {&sheets_[static_cast<std::size_t>(r)]}, shape, true);
            clear_weight_.emplace_back(gl, colors, nullptr);
        }
    }
    TargetShape own_shape = shape;
    own_shape.weight = true;
    own_shape.fine = false;
    for (int field = 0; field < shape.own; ++field) {
        Own& own = own_.emplace_back();
        own.sheets.resize(shape.wide ? 3 : 1);
        for (Sheet& sheet : own.sheets) {
            sheet.value = gl::Texture(gl, shape.sheet_format, w, h);
            sheet.weight = gl::Texture(gl, shape.sheet_format, w, h);
        }
        for (std::size_t r = 0; r < own.sheets.size(); ++r) {
            std::vector<const Sheet*> pair{&own.sheets[r]};
            std::vector<const gl::Texture*> colors;
            append(colors, pair, own_shape, false);
            own.clear.emplace_back(gl, colors, nullptr);
            own.splat_one.emplace_back(gl, colors, tags);
            if (shape.wide) {
                pair.push_back(&own.sheets[(r + 1) % 3]);
            }
            colors.clear();
            append(colors, pair, own_shape, false);
            own.splat.emplace_back(gl, colors, tags);
        }
    }
    if (!shape.wide) {
        std::vector<const gl::Texture*> colors;
        append(colors, {&sheets_[1]}, shape, false);
        copy_ = gl::Framebuffer(gl, colors, tags);
        if (shape.fine && shape.weight) {
            colors.clear();
            append(colors, {&sheets_[1]}, shape, true);
            copy_weight_ = gl::Framebuffer(gl, colors, tags);
        }
    }
}

std::size_t Targets::bytes() const {
    std::size_t sum = depth_tags_.bytes() + image_.bytes() + image_depth_.bytes() + image_coverage_.bytes() +
                      image_copy_.bytes() + image_depth_copy_.bytes() + image_coverage_copy_.bytes() +
                      image_error_.bytes() + image_error_copy_.bytes();
    for (const Own& own : own_) {
        for (const Sheet& sheet : own.sheets) {
            sum += sheet.value.bytes() + sheet.weight.bytes();
        }
    }
    for (const Sheet& sheet : sheets_) {
        sum += sheet.value.bytes() + sheet.weight.bytes();
        for (int axis = 0; axis < 3; ++axis) {
            sum += sheet.slope[axis].bytes() + sheet.weight_slope[axis].bytes();
        }
    }
    return sum;
}

void Targets::clear_sheet(int r) const {
    const auto at = static_cast<std::size_t>(r);
    clear_[at].bind();
    gl_->ClearColor(0.0F, 0.0F, 0.0F, 0.0F);
    gl_->Clear(GL_COLOR_BUFFER_BIT);
    if (!clear_weight_.empty()) {
        clear_weight_[at].bind();
        gl_->Clear(GL_COLOR_BUFFER_BIT);
    }
}

void Targets::clear_own(int field, int r) const {
    own_[static_cast<std::size_t>(field)].clear[static_cast<std::size_t>(r)].bind();
    gl_->ClearColor(0.0F, 0.0F, 0.0F, 0.0F);
    gl_->Clear(GL_COLOR_BUFFER_BIT);
}

void Targets::clear_tags() const {
    if (shape_.shared_depth) {
        depth_fbo_.bind();
        gl_->DepthMask(GL_TRUE);
        gl_->ClearDepth(1.0);
        gl_->Clear(GL_DEPTH_BUFFER_BIT);
    }
}

void Targets::clear_all() const {
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

} // namespace sheetsplat::sheet

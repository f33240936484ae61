#include "resources.hpp"

#include <algorithm>

#include "backend_gl/embedded_glsl.hpp"

namespace sheetsplat::backend_gl {

Resources::Resources(const gl::Api& gl, const Capabilities& capabilities)
    : samples(gl, GL_ARRAY_BUFFER), boxes(gl, GL_ARRAY_BUFFER), records(gl, GL_ARRAY_BUFFER),
      rests(gl, GL_ARRAY_BUFFER), rectangles(gl, GL_ARRAY_BUFFER), splat_array(gl), record_array(gl),
      rectangle_array(gl), gl_(&gl), precise_(capabilities.at_least(4, 0)) {}

const gl::Program& Resources::program(const std::string& vertex, const std::string& fragment,
                                      const gl::Defines& defines, const std::vector<std::string>& outputs) {
    auto key = std::make_pair(vertex + " + " + fragment, defines);
    const auto found = programs_.find(key);
    if (found != programs_.end()) {
        return found->second;
    }
    gl::Defines all = defines;
    all["PRECISE"] = precise_ ? "precise" : "";
    gl::Program made(*gl_, embedded_glsl(), vertex, fragment, all, precise_ ? "#version 400 core" : "#version 330 core",
                     outputs);
    return programs_.emplace(std::move(key), std::move(made)).first->second;
}

std::size_t Resources::programs_used() const {
    return static_cast<std::size_t>(
        std::count_if(programs_.begin(), programs_.end(), [](const auto& entry) { return entry.second.used(); }));
}

SectionPass& Resources::section_pass() {
    if (!section_pass_) {
        section_pass_ = std::make_unique<SectionPass>(*gl_);
    }
    return *section_pass_;
}

PaperSlicing& Resources::paper_slicing() {
    if (!paper_slicing_) {
        paper_slicing_ = std::make_unique<PaperSlicing>(*gl_, precise_);
    }
    return *paper_slicing_;
}

Gather& Resources::gather() {
    if (!gather_) {
        gather_ = std::make_unique<Gather>(*gl_);
    }
    return *gather_;
}

LightTextures& Resources::light() {
    if (!light_) {
        light_ = std::make_unique<LightTextures>(*gl_);
    }
    return *light_;
}

const Targets& Resources::targets(const TargetShape& shape) {
    if (!targets_ || !(targets_->shape() == shape)) {
        targets_.reset();
        targets_ = std::make_unique<Targets>(*gl_, shape);
    }
    return *targets_;
}

} // namespace sheetsplat::backend_gl

#include "resources.hpp"

#include <algorithm>

#include "backend_gl/embedded_glsl.hpp"

namespace sheetsplat::backend_gl {

namespace {

template <class Kept, class... Arguments>
Kept& made_once(std::unique_ptr<Kept>& kept, const Arguments&... arguments) {
    if (!kept) {
        kept = std::make_unique<Kept>(arguments...);
    }
    return *kept;
}

} // namespace

Resources::Resources(const gl::Api& gl, const Capabilities& capabilities)
    : samples(gl, GL_ARRAY_BUFFER), boxes(gl, GL_ARRAY_BUFFER), records(gl, GL_ARRAY_BUFFER),
      rests(gl, GL_ARRAY_BUFFER), rectangles(gl, GL_ARRAY_BUFFER), parts(gl, GL_SHADER_STORAGE_BUFFER),
      sections(gl, GL_SHADER_STORAGE_BUFFER), order(gl, GL_SHADER_STORAGE_BUFFER), bounds(gl, GL_SHADER_STORAGE_BUFFER),
      counts(gl, GL_SHADER_STORAGE_BUFFER), splat_array(gl), record_array(gl), rectangle_array(gl), gl_(&gl),
      sources_(&embedded_glsl()), precise_(capabilities.at_least(4, 0)) {}

const gl::Program& Resources::program(const ShaderVariant& variant) {
    auto key = std::make_pair(variant.vertex + " + " + variant.fragment, variant.defines);
    const auto found = programs_.find(key);
    if (found != programs_.end()) {
        return found->second;
    }
    gl::Defines all = variant.defines;
    all["PRECISE"] = precise_ ? "precise" : "";
    gl::Program made(*gl_, *sources_, variant.vertex, variant.fragment, all,
                     precise_ ? "#version 400 core" : "#version 330 core", variant.outputs);
    return programs_.emplace(std::move(key), std::move(made)).first->second;
}

const gl::Program& Resources::compute_program(const std::string& file, const gl::Defines& defines) {
    auto key = std::make_pair(file, defines);
    const auto found = programs_.find(key);
    if (found != programs_.end()) {
        return found->second;
    }
    gl::Defines all = defines;
    all["PRECISE"] = "precise";
    gl::Program made = gl::Program::computing(*gl_, *sources_, file, all, "#version 430 core");
    return programs_.emplace(std::move(key), std::move(made)).first->second;
}

std::size_t Resources::programs_used() const {
    return static_cast<std::size_t>(
        std::count_if(programs_.begin(), programs_.end(), [](const auto& entry) { return entry.second.used(); }));
}

std::size_t Resources::bytes() const {
    return (section_pass_ ? section_pass_->bytes() : 0) + (paper_slicing_ ? paper_slicing_->bytes() : 0) +
           (light_ ? light_->bytes() : 0) + (fields_ ? fields_->bytes() : 0) + parts.capacity() + sections.capacity() +
           order.capacity() + bounds.capacity();
}

void Resources::rewind() {
    for (gl::Buffer* buffer : {&samples, &records, &rests, &boxes, &rectangles}) {
        buffer->rewind();
    }
}

SectionPass& Resources::section_pass() { return made_once(section_pass_, *gl_); }
PaperSlicing& Resources::paper_slicing() { return made_once(paper_slicing_, *gl_, precise_); }
LightTextures& Resources::light() { return made_once(light_, *gl_); }
ResidentFields& Resources::fields() { return made_once(fields_, *gl_); }

const Targets& Resources::targets(const TargetShape& shape) {
    if (!targets_ || !(targets_->shape() == shape)) {
        targets_.reset();
        targets_ = std::make_unique<Targets>(*gl_, shape);
    }
    return *targets_;
}

} // namespace sheetsplat::backend_gl

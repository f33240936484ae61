#include "backend_gl/gl_renderer.hpp"

#include "backend_gl/slice_loop_hooks.hpp"
#include "gl/context.hpp"
#include "picture.hpp"
#include "resources.hpp"
#include "shader_variants.hpp"

namespace sheetsplat::backend_gl {

Setup set_up(const DrawPlan& plan, const Scene& scene, const Capabilities& capabilities) {
    SliceLoopHooks& hooks = slice_loop_hooks();
    Setup setup{plan};
    hooks.adjust(setup.plan, scene);
    setup.layout = hooks.layout(make_layout(setup.plan));
    setup.largest_sprite = largest_sprite(setup.plan, capabilities);
    return setup;
}

struct GlRenderer::State {
    std::unique_ptr<gl::Context> context;
    std::unique_ptr<Resources> resources;
};

GlRenderer::GlRenderer(std::optional<int> egl_device) : state_(std::make_unique<State>()) {
    gl::ContextOptions options;
    options.egl_device = egl_device;
    state_->context = gl::Context::create(options);
}

GlRenderer::~GlRenderer() {
    if (state_->resources) {
        try {
            const gl::Current current(*state_->context);
            state_->resources.reset();
        } catch (const std::exception&) {
            // A context that cannot be made current any more takes its objects with it.
            static_cast<void>(state_->resources.release());
        }
    }
}

const Capabilities& GlRenderer::capabilities() const { return state_->context->capabilities(); }

void GlRenderer::render(const Job& job, Image& image) {
    const gl::Current current(*state_->context);
    if (!state_->resources) {
        state_->resources = std::make_unique<Resources>(state_->context->api(), capabilities());
    }
    SliceLoopHooks& hooks = slice_loop_hooks();
    Resources& resources = *state_->resources;
    resources.set_sources(hooks.sources());
    try {
        hooks.begin_picture(job, state_->context->api(), resources);
        Picture(job, *state_->context, resources, hooks, image).draw();
        hooks.end_picture(image);
    } catch (...) {
        hooks.abandon_picture();
        throw;
    }
}

std::vector<DeviceReport> survey() {
    std::vector<DeviceReport> reports;
    for (const gl::Attempt& attempt : gl::Context::survey()) {
        DeviceReport report;
        report.backend = "gl";
        report.platform = attempt.platform;
        report.available = attempt.succeeded;
        report.description = attempt.succeeded
                                 ? attempt.capabilities.renderer + ", OpenGL " + attempt.capabilities.version
                                 : attempt.story;
        report.extensions = attempt.capabilities.extensions;
        report.workarounds = attempt.capabilities.workarounds;
        reports.push_back(std::move(report));
    }
    return reports;
}

} // namespace sheetsplat::backend_gl

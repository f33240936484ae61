#include "backend_gl/gl_renderer.hpp"

#include "backend_gl/slice_loop_hooks.hpp"
#include "gl/context.hpp"
#include "picture.hpp"
#include "resources.hpp"
#include "shader_variants.hpp"
#include "sheetsplat/error.hpp"

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
    gl::ContextOptions options;
    std::unique_ptr<gl::Context> context;
    std::unique_ptr<Resources> resources;
    Capabilities capabilities; // plans hold references to them, also while the context is made anew

    void drop_context() {
        context->forget_objects();
        resources.reset();
        context.reset();
    }

    /// Makes the context current, and makes another of the same kind where other code has ended the first.
    gl::Current enter() {
        if (context) {
            try {
                return gl::Current(*context);
            } catch (const gl::ContextLost&) {
                drop_context();
            }
        }
        options.platform = capabilities.platform;
        context = gl::Context::create(options);
        const Capabilities& now = context->capabilities();
        if (now.renderer != capabilities.renderer || now.version != capabilities.version) {
            const std::string found = now.renderer + ", OpenGL " + now.version;
            context.reset();
            throw DeviceUnavailable(Complaint{"the OpenGL context was lost, and no other is like it", found,
                                              capabilities.renderer + ", OpenGL " + capabilities.version,
                                              "make a new renderer"});
        }
        return gl::Current(*context);
    }
};

GlRenderer::GlRenderer(std::optional<int> egl_device) : state_(std::make_unique<State>()) {
    state_->options.egl_device = egl_device;
    state_->context = gl::Context::create(state_->options);
    state_->capabilities = state_->context->capabilities();
}

GlRenderer::~GlRenderer() {
    if (state_->resources) {
        try {
            const gl::Current current(*state_->context);
            state_->resources.reset();
        } catch (const std::exception&) {
            state_->drop_context();
        }
    }
}

const Capabilities& GlRenderer::capabilities() const { return state_->capabilities; }

void GlRenderer::set_rates(const DeviceRates& rates) { state_->capabilities.rates = rates; }

void GlRenderer::render(const Job& job, Image& image) {
    const gl::Current current = state_->enter();
    if (!state_->resources) {
        state_->resources = std::make_unique<Resources>(state_->context->api(), capabilities());
    }
    gl::require_room(0, "a picture by OpenGL");
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

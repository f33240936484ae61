#include "backend_gl/slice_loop_hooks.hpp"

#include "backend_gl/embedded_glsl.hpp"
#include "papers/opacity_buffer.hpp"

namespace sheetsplat::backend_gl {

namespace {

thread_local SliceLoopHooks* installed = nullptr;

} // namespace

const gl::SourceFiles& SliceLoopHooks::sources() { return embedded_glsl(); }

std::unique_ptr<OpacityBuffer> SliceLoopHooks::opacity_buffer(int /*width*/, int /*height*/, double /*opacity_stop*/) {
    return nullptr;
}

SliceLoopHooks& slice_loop_hooks() {
    static SliceLoopHooks none;
    return installed != nullptr ? *installed : none;
}

InstalledHooks::InstalledHooks(SliceLoopHooks& hooks) : before_(installed) { installed = &hooks; }
InstalledHooks::~InstalledHooks() { installed = before_; }

} // namespace sheetsplat::backend_gl

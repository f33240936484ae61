// A program outside the tree: renders three samples by the reference and checks that something is seen.
#include <algorithm>
#include <memory>

#include "sheetsplat/camera.hpp"
#include "sheetsplat/field.hpp"
#include "sheetsplat/renderer.hpp"
#include "sheetsplat/scene.hpp"

// The layers' own headers stay inside the library.
#if __has_include("engine/registry.hpp") || __has_include("base/checks.hpp") || __has_include("glad/gl.h")
#error "a private header was installed"
#endif

int main() {
    namespace ss = sheetsplat;
    const auto field = std::make_shared<const ss::RegularField>(std::vector<float>{1.0F, 2.0F, 3.0F},
                                                                std::array<std::size_t, 3>{1, 1, 3});
    const ss::Scene scene{{field}, ss::TransferFunction({{0.0, {1.0, 1.0, 1.0}, 0.0}, {1.0, {1.0, 1.0, 1.0}, 0.5}})};
    const ss::Camera camera = ss::Camera::fit(field->supports_world(), {0.0, 0.0, -1.0}, {0.0, 1.0, 0.0});
    ss::RendererOptions options;
    options.backend = ss::Backend::reference;
    const ss::Image image = ss::Renderer(options).render(scene, camera, {8, 8});
    const bool something = std::any_of(image.rgba.begin(), image.rgba.end(), [](float value) { return value > 0.1F; });
    return image.rgba.size() == 8 * 8 * 4 && something ? 0 : 1;
}

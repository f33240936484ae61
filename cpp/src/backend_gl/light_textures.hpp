// Volumes of shadows and ambient occlusion, in mode isosurface grids of rho, as a texture of the shading pass.
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "facts/frame.hpp"
#include "gl/objects.hpp"
#include "gl/program.hpp"
#include "sheetsplat/camera.hpp"
#include "sheetsplat/light_volume.hpp"
#include "sheetsplat/scene.hpp"

namespace sheetsplat::backend_gl {

/// Made and destroyed with the context current.
class LightTextures {
  public:
    explicit LightTextures(const gl::Api& gl) : gl_(&gl), buffer_(gl, GL_ARRAY_BUFFER) {}

    /// The grids of rho if there are any, else one volume a light where there are shadows, then openness where there is
    /// ambient occlusion; what is on the device already stays. largest: texels that a buffer texture may have. Throws
    /// Unsupported, OutOfMemory.
    void upload(const LightVolumes& volumes, bool shadows, bool occlusion, int largest);
    /// Binds the buffer and sets the uniforms of lib/light_volume.glsl. first_slab: of the shader's array.
    void bind(const gl::Program& program, const Camera& camera, const Frame& frame, std::int64_t first_slab) const;
    /// For grids of rho: sets the uniforms of lines through them.
    void set_lines(const gl::Program& program, const Scene& scene, const Camera& camera, double slice_spacing,
                   double value_unit) const;
    [[nodiscard]] std::size_t bytes() const { return buffer_.capacity(); }

  private:
    const gl::Api* gl_;
    gl::Buffer buffer_;
    gl::BufferTexture texture_;
    std::vector<std::shared_ptr<const LightVolume>> volumes_; ///< null: a transmittance of 1 everywhere
};

} // namespace sheetsplat::backend_gl

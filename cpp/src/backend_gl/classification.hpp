// The transfer function as the shaders read it.
#pragma once

#include "gl/objects.hpp"
#include "gl/program.hpp"
#include "sheetsplat/transfer_function.hpp"

namespace sheetsplat::backend_gl {

/// Exact between its points: a table of cells leads to the interval that a value lies in.
class Classification {
  public:
    Classification() = default;
    /// value_unit: the amount of rho that sheets call 1; origin: the rho that they call 0.
    Classification(const gl::Api& gl, const TransferFunction& function, double value_unit, double origin);
    /// Binds the textures and sets the uniforms of lib/transfer.glsl.
    void bind(const gl::Program& program) const;

  private:
    gl::Texture index_, points_;
    float first_ = 0.0F, cells_per_unit_ = 0.0F;
    int last_ = 0;
};

} // namespace sheetsplat::backend_gl

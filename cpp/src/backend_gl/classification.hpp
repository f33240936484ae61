// The transfer functions as the shaders read them.
#pragma once

#include <vector>

#include "gl/objects.hpp"
#include "gl/program.hpp"
#include "sheetsplat/transfer_function.hpp"

namespace sheetsplat::backend_gl {

/// Exact between its points: a table of cells leads to the interval that a value lies in.
class Classification {
  public:
    /// Of a group of fields.
    struct Part {
        const TransferFunction* function;
        double value_unit; ///< the amount of rho that the group's sheets call 1
        double origin;     ///< the rho that they call 0
    };

    Classification() = default;
    Classification(const gl::Api& gl, const std::vector<Part>& parts);
    /// Binds the textures and sets the uniforms of lib/transfer.glsl.
    void bind(const gl::Program& program) const;

  private:
    /// The uniforms of a transfer function.
    struct Range {
        float first = 0.0F, cells_per_unit = 0.0F;
        int last = 0;
    };

    gl::Texture index_, points_;
    std::vector<Range> ranges_;
};

} // namespace sheetsplat::backend_gl

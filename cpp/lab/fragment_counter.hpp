// Fragments that were drawn, by occlusion queries.
#pragma once

#include <cstdint>
#include <vector>

#include "gl/objects.hpp"

namespace sheetsplat::lab {

void delete_query(const gl::Api& gl, GLuint name);

/// Counts the fragments that pass between begin() and end(), as often as these are called. The answers are asked for
/// at the end alone, so that no drawing waits for them.
class FragmentCounter {
  public:
    explicit FragmentCounter(const gl::Api& gl) : gl_(&gl) {}
    void begin();
    void end();
    /// All of them so far. Waits for the drawing.
    [[nodiscard]] std::uint64_t count();

  private:
    const gl::Api* gl_;
    std::vector<gl::Handle<delete_query>> queries_;
};

} // namespace sheetsplat::lab

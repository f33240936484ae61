#include "fragment_counter.hpp"

namespace sheetsplat::lab {

void delete_query(const gl::Api& gl, GLuint name) { gl.DeleteQueries(1, &name); }

void FragmentCounter::begin() {
    GLuint name = 0;
    gl_->GenQueries(1, &name);
    queries_.emplace_back(*gl_, name);
    gl_->BeginQuery(GL_SAMPLES_PASSED, name);
}

void FragmentCounter::end() { gl_->EndQuery(GL_SAMPLES_PASSED); }

std::uint64_t FragmentCounter::count() {
    std::uint64_t sum = 0;
    for (const auto& query : queries_) {
        GLuint passed = 0;
        gl_->GetQueryObjectuiv(query.name(), GL_QUERY_RESULT, &passed);
        sum += passed;
    }
    return sum;
}

} // namespace sheetsplat::lab

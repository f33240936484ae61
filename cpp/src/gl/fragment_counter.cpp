#include "gl/fragment_counter.hpp"

namespace sheetsplat::gl {

void FragmentCounter::begin() {
    GLuint name = 0;
    api_->GenQueries(1, &name);
    queries_.emplace_back(*api_, name);
    api_->BeginQuery(GL_SAMPLES_PASSED, name);
}

void FragmentCounter::end() { api_->EndQuery(GL_SAMPLES_PASSED); }

std::uint64_t FragmentCounter::count() {
    std::uint64_t sum = 0;
    for (const auto& query : queries_) {
        GLuint passed = 0;
        api_->GetQueryObjectuiv(query.name(), GL_QUERY_RESULT, &passed);
        sum += passed;
    }
    return sum;
}

} // namespace sheetsplat::gl

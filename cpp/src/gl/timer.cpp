#include "gl/timer.hpp"

#include <utility>

namespace sheetsplat::gl {

void delete_query(const Api& gl, GLuint name) { gl.DeleteQueries(1, &name); }

StageTimer::StageTimer(const Api& gl, const Capabilities& capabilities, bool enabled, bool exact)
    // llvmpipe and softpipe answer timer queries, but each one ends the batch of drawing that they have put off, and an
    // answer of llvmpipe (22.3) is at times the time since the machine was switched on.
    : api_(&gl), enabled_(enabled), queries_(capabilities.timer_query && !capabilities.software), exact_(exact) {}

StageTimer::~StageTimer() {
    if (open_ && queries_) {
        // A query that is deleted while open would stay open without a name, and no other could begin.
        api_->EndQuery(GL_TIME_ELAPSED);
    }
}

void StageTimer::begin(const char* stage) {
    if (!enabled_) {
        return;
    }
    end();
    stage_ = stage;
    open_ = true;
    if (!queries_) {
        started_ = std::chrono::steady_clock::now();
        return;
    }
    Handle<delete_query> query;
    if (spare_.empty()) {
        GLuint name = 0;
        api_->GenQueries(1, &name);
        query = Handle<delete_query>(*api_, name);
    } else {
        query = std::move(spare_.back());
        spare_.pop_back();
    }
    api_->BeginQuery(GL_TIME_ELAPSED, query.name());
    pending_.push_back(Pending{stage_, std::move(query)});
}

void StageTimer::end() {
    if (!enabled_ || !open_) {
        return;
    }
    open_ = false;
    if (queries_) {
        api_->EndQuery(GL_TIME_ELAPSED);
        harvest(false);
        return;
    }
    if (exact_) {
        api_->Finish();
    }
    seconds_[stage_] += std::chrono::duration<double>(std::chrono::steady_clock::now() - started_).count();
}

void StageTimer::harvest(bool wait) {
    while (!pending_.empty() && !(open_ && pending_.size() == 1)) {
        Pending& first = pending_.front();
        if (!wait) {
            GLint available = GL_FALSE;
            api_->GetQueryObjectiv(first.query.name(), GL_QUERY_RESULT_AVAILABLE, &available);
            if (available == GL_FALSE) {
                return;
            }
        }
        GLuint64 nanoseconds = 0;
        api_->GetQueryObjectui64v(first.query.name(), GL_QUERY_RESULT, &nanoseconds);
        seconds_[first.stage] += static_cast<double>(nanoseconds) * 1e-9;
        spare_.push_back(std::move(first.query));
        pending_.pop_front();
    }
}

std::map<std::string, double> StageTimer::seconds() {
    if (queries_) {
        harvest(true);
    }
    return seconds_;
}

} // namespace sheetsplat::gl

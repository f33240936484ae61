// GPU time of named stages by timer queries; wall-clock time where the device has none.
#pragma once

#include <chrono>
#include <deque>
#include <map>
#include <string>
#include <vector>

#include "gl/objects.hpp"

namespace sheetsplat::gl {

void delete_query(const Api& gl, GLuint name);

/// Adds up the time of stages that follow one another. Costs nothing when `enabled` is false.
///
/// Where there is a real GPU queue: GL_TIME_ELAPSED queries, which cost no waiting; no other such query may be open
/// meanwhile. On software devices, where the work is done by the calling process, and where there are no timer queries:
/// wall-clock time. Such drivers put drawing off until somebody needs the result, so without `exact` a stage is charged
/// for what it makes the driver do, not for what it asked for (a read-back may pay for the draws before it; the sum is
/// right). With `exact` each stage ends with glFinish: right stage by stage, but the frame as a whole takes longer.
class StageTimer {
  public:
    StageTimer(const Api& gl, const Capabilities& capabilities, bool enabled, bool exact = false);
    ~StageTimer(); ///< ends the stage that is open; the context must be current
    StageTimer(const StageTimer&) = delete;
    StageTimer& operator=(const StageTimer&) = delete;

    void begin(const char* stage); ///< ends the stage before
    void end();
    /// Seconds per stage so far. Waits for the queries that are still open.
    [[nodiscard]] std::map<std::string, double> seconds();

  private:
    struct Pending {
        std::string stage;
        Handle<delete_query> query;
    };
    void harvest(bool wait);
    const Api* api_;
    bool enabled_;
    bool queries_;
    bool exact_;
    bool open_ = false;
    std::string stage_;
    std::chrono::steady_clock::time_point started_;
    std::deque<Pending> pending_;             // in the order of their stages; the last one may be open
    std::vector<Handle<delete_query>> spare_; // queries that were read and can be used again
    std::map<std::string, double> seconds_;
};

} // namespace sheetsplat::gl

// Progress reports and cancellation, for every layer.
#pragma once

#include <chrono>
#include <cstddef>
#include <functional>

namespace sheetsplat {

/// While it lives, poll() of this thread asks `ask`: at its first call, then at most every few milliseconds. ask may
/// throw, which ends the work. Scopes nest; the innermost one counts.
class PollScope {
  public:
    explicit PollScope(std::function<void()> ask);
    ~PollScope();
    PollScope(const PollScope&) = delete;
    PollScope& operator=(const PollScope&) = delete;

    void ask_now_and_then();

  private:
    std::function<void()> ask_;
    std::chrono::steady_clock::time_point asked_{};
    PollScope* outer_;
};

/// Calls `progress`, if it is set, with the share that is done (0 to 1). Throws Cancelled where it returns false.
void report_progress(const std::function<bool(double)>& progress, double share);

/// Calls the innermost scope's `ask`, at most every few milliseconds; does nothing outside every PollScope.
void poll();

/// The same for the i-th of very many short steps.
inline void poll_at(std::size_t i) {
    if (i % 4096 == 0) {
        poll();
    }
}

} // namespace sheetsplat

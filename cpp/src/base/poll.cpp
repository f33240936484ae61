#include "base/poll.hpp"

#include <utility>

#include "sheetsplat/error.hpp"

namespace sheetsplat {

namespace {

constexpr std::chrono::milliseconds between_questions{4};
thread_local PollScope* innermost = nullptr;

} // namespace

PollScope::PollScope(std::function<void()> ask) : ask_(std::move(ask)), outer_(std::exchange(innermost, this)) {}

PollScope::~PollScope() { innermost = outer_; }

void PollScope::ask_now_and_then() {
    const auto now = std::chrono::steady_clock::now();
    if (ask_ && now - asked_ >= between_questions) {
        asked_ = now;
        ask_();
    }
}

void report_progress(const std::function<bool(double)>& progress, double share) {
    if (progress && !progress(share)) {
        throw Cancelled();
    }
}

void poll() {
    if (innermost != nullptr) {
        innermost->ask_now_and_then();
    }
}

} // namespace sheetsplat

// Threads that work through a list of tasks and stay for the next one.
#pragma once

#include <atomic>
#include <condition_variable>
#include <cstddef>
#include <exception>
#include <functional>
#include <memory>
#include <mutex>
#include <thread>
#include <vector>

namespace sheetsplat {

/// Threads that this process may run at once: its affinity mask, at least 1.
int usable_threads();

/// The caller's thread is one of them. Not to be used by two threads at once.
class ThreadPool {
  public:
    /// threads >= 1, the caller's included. Where the system has no room for so many there are fewer. Throws
    /// OutOfMemory where there is none for what the caller's own thread needs.
    explicit ThreadPool(int threads);
    ~ThreadPool();
    ThreadPool(const ThreadPool&) = delete;
    ThreadPool& operator=(const ThreadPool&) = delete;

    /// False in a process that was forked from the pool's: its threads are not there, so that it can neither run nor be
    /// taken down.
    [[nodiscard]] bool is_here() const;
    [[nodiscard]] int threads() const { return static_cast<int>(workers_.size()) + 1; }

    /// task(i, thread) for every i < count, in no particular order; thread 0 is the caller's. Returns when all are
    /// done. The first exception stops what has not begun, and is thrown here. poll, if there is one, is called by the
    /// caller's thread between its tasks, and every few milliseconds while it waits for the others; it may throw too.
    void run(std::size_t count, const std::function<void(std::size_t, int)>& task,
             const std::function<void()>& poll = {});
    /// True once a task of the current run() threw: the others may leave early.
    [[nodiscard]] bool failed() const { return failed_.load(std::memory_order_relaxed); }

  private:
    bool start(int thread);
    void work(int thread);
    void drain(int thread, const std::function<void()>& poll = {});
    void fail();

    long process_;
    std::vector<std::thread> workers_;
    std::mutex mutex_;
    std::condition_variable begin_, end_;
    const std::function<void(std::size_t, int)>* task_ = nullptr;
    std::size_t count_ = 0;
    std::atomic<std::size_t> next_{0};
    std::atomic<bool> failed_{false};
    std::exception_ptr error_;
    unsigned long round_ = 0;
    int busy_ = 0;
    std::size_t settled_ = 0; ///< threads that have all that they need
    bool quit_ = false;
};

/// Leaves alone what a forked process cannot take down.
struct ForgetPool {
    void operator()(ThreadPool* pool) const;
};
using OwnPool = std::unique_ptr<ThreadPool, ForgetPool>;

} // namespace sheetsplat

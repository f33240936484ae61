#include "base/threads.hpp"

#if defined(__linux__)
#include <sched.h>
#endif
#if defined(__unix__) || defined(__APPLE__)
#include <unistd.h>
#endif

#include <algorithm>
#include <chrono>
#include <new>
#include <system_error>
#include <utility>

namespace sheetsplat {

namespace {

constexpr std::chrono::milliseconds polling{5};

long this_process() {
#if defined(__unix__) || defined(__APPLE__)
    return static_cast<long>(getpid());
#else
    return 0;
#endif
}

} // namespace

int usable_threads() {
#if defined(__linux__)
    cpu_set_t set;
    CPU_ZERO(&set);
    if (sched_getaffinity(0, sizeof set, &set) == 0) {
        return std::max(1, CPU_COUNT(&set));
    }
#endif
    return static_cast<int>(std::max(1U, std::thread::hardware_concurrency()));
}

ThreadPool::ThreadPool(int threads) : process_(this_process()) {
    workers_.reserve(static_cast<std::size_t>(std::max(0, threads - 1)));
    for (int thread = 1; thread < threads; ++thread) {
        try {
            workers_.emplace_back([this, thread] { work(thread); });
        } catch (const std::system_error&) {
            // The system has no more threads: the picture is the same with fewer.
            break;
        } catch (const std::bad_alloc&) {
            // Threads that run already keep their owner.
            break;
        }
    }
}

ThreadPool::~ThreadPool() {
    {
        const std::lock_guard<std::mutex> lock(mutex_);
        quit_ = true;
    }
    begin_.notify_all();
    for (std::thread& worker : workers_) {
        worker.join();
    }
}

bool ThreadPool::is_here() const { return process_ == this_process(); }

void ForgetPool::operator()(ThreadPool* pool) const {
    if (pool->is_here()) {
        delete pool;
    }
}

void ThreadPool::drain(int thread, const std::function<void()>& poll) {
    while (!failed()) {
        const std::size_t index = next_.fetch_add(1, std::memory_order_relaxed);
        if (index >= count_) {
            return;
        }
        try {
            (*task_)(index, thread);
            if (poll) {
                poll();
            }
        } catch (...) {
            fail();
        }
    }
}

void ThreadPool::fail() {
    const std::lock_guard<std::mutex> lock(mutex_);
    if (!error_) {
        error_ = std::current_exception();
    }
    failed_.store(true, std::memory_order_relaxed);
}

void ThreadPool::work(int thread) {
    unsigned long seen = 0;
    std::unique_lock<std::mutex> lock(mutex_);
    while (true) {
        begin_.wait(lock, [&] { return quit_ || round_ != seen; });
        if (quit_) {
            return;
        }
        seen = round_;
        lock.unlock();
        drain(thread);
        lock.lock();
        if (--busy_ == 0) {
            end_.notify_one();
        }
    }
}

void ThreadPool::run(std::size_t count, const std::function<void(std::size_t, int)>& task,
                     const std::function<void()>& poll) {
    {
        const std::lock_guard<std::mutex> lock(mutex_);
        task_ = &task;
        count_ = count;
        next_.store(0, std::memory_order_relaxed);
        failed_.store(false, std::memory_order_relaxed);
        error_ = nullptr;
        busy_ = static_cast<int>(workers_.size());
        ++round_;
    }
    begin_.notify_all();
    drain(0, poll);
    std::unique_lock<std::mutex> lock(mutex_);
    while (!end_.wait_for(lock, polling, [&] { return busy_ == 0; })) {
        if (poll && !failed()) {
            lock.unlock();
            try {
                poll();
            } catch (...) {
                fail();
            }
            lock.lock();
        }
    }
    task_ = nullptr;
    if (error_) {
        const std::exception_ptr error = std::exchange(error_, nullptr);
        std::rethrow_exception(error);
    }
}

} // namespace sheetsplat

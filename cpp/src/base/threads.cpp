#include "base/threads.hpp"

#if defined(__linux__)
#include <sched.h>
#endif
#if defined(__unix__) || defined(__APPLE__)
#include <pthread.h>
#include <unistd.h>
#endif

#include <algorithm>
#include <chrono>
#include <exception>
#include <new>
#include <system_error>
#include <utility>

#include "base/memory.hpp"
#include "base/poll.hpp"

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

/// The C library keeps the thread-local data of a library that was loaded late in memory that a thread asks for when it
/// first looks at them, and ends the process where there is none. So threads look at once, with room left.
constexpr std::uint64_t room_for_own_data = 1 << 20;

void take_own_data() {
    static_cast<void>(std::uncaught_exceptions());
    poll();
}

/// Address space that glibc takes for a thread's own heap at its first allocation: it asks for 128 MiB, and keeps 64 of
/// them. Threads that find less share the heap of the others, and leave nothing for the picture.
constexpr std::uint64_t room_for_a_heap = 128ULL << 20;

/// Address space that a thread takes before it does anything.
std::uint64_t room_for_a_thread() {
    std::size_t stack = 0;
#if defined(__unix__) || defined(__APPLE__)
    pthread_attr_t attributes;
    if (pthread_attr_init(&attributes) == 0) {
        pthread_attr_getstacksize(&attributes, &stack);
        pthread_attr_destroy(&attributes);
    }
#endif
    return stack + room_for_a_heap;
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
    if (available_address_space() < room_for_own_data) {
        require_memory(room_for_own_data, "threads", "raise the limit on the process's address space");
    }
    take_own_data();
    workers_.reserve(static_cast<std::size_t>(std::max(0, threads - 1)));
    // Where the system has no more threads, the picture is the same with fewer.
    for (int thread = 1; thread < threads && start(thread); ++thread) {}
}

bool ThreadPool::start(int thread) {
    if (available_address_space() < room_for_a_thread()) {
        return false;
    }
    try {
        workers_.emplace_back([this, thread] { work(thread); });
    } catch (const std::system_error&) {
        return false;
    } catch (const std::bad_alloc&) {
        // Threads that run already keep their owner.
        return false;
    }
    // One after the other: the next one asks what this one left.
    std::unique_lock<std::mutex> lock(mutex_);
    end_.wait(lock, [&] { return settled_ == workers_.size(); });
    return true;
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
    take_own_data();
    unsigned long seen = 0;
    std::unique_lock<std::mutex> lock(mutex_);
    ++settled_;
    end_.notify_one();
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

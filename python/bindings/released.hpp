// Native work without the GIL, also while the process ends.
#pragma once

#include <atomic>
#include <chrono>
#include <thread>

#include <pybind11/pybind11.h>

#if defined(__unix__) || defined(__APPLE__)
#include <pthread.h>
#endif

namespace sheetsplat::bindings {

/// Lets go of the GIL for a scope.
///
/// While the interpreter is torn down, a thread that asks for the GIL is ended where it stands, in the middle of our
/// destructors. So before that, all threads but the one that ends the process leave these scopes: their pictures are
/// given up, and they wait for the end of the process with all locks given back.
class Released {
  public:
    Released() {
        const bool stays_out = ending_elsewhere();
        if (!stays_out) {
            ++active();
        }
        state_ = PyEval_SaveThread();
        if (stays_out) {
            wait_for_the_end();
        }
    }
    ~Released() {
        if (ending_elsewhere()) {
            --active();
            wait_for_the_end();
        }
        PyEval_RestoreThread(state_);
        --active();
    }
    Released(const Released&) = delete;
    Released& operator=(const Released&) = delete;

    /// True where another thread ends the process: work is to be given up.
    [[nodiscard]] static bool ending_elsewhere() {
        const std::thread::id thread = ending().load();
        return thread != std::thread::id() && thread != std::this_thread::get_id();
    }

    /// Waits for threads as above before the interpreter is torn down. Once, for the module.
    static void prepare_for_the_end() {
        pybind11::module_::import("atexit").attr("register")(pybind11::cpp_function([] {
            // What cannot be given up, such as a field's coefficients, ends by itself.
            constexpr auto longest = std::chrono::seconds(30);
            ending() = std::this_thread::get_id();
            const pybind11::gil_scoped_release release;
            const auto until = std::chrono::steady_clock::now() + longest;
            while (active() > 0 && std::chrono::steady_clock::now() < until) {
                std::this_thread::sleep_for(std::chrono::milliseconds(1));
            }
        }));
#if defined(__unix__) || defined(__APPLE__)
        // A forked process has none of its parent's other threads.
        pthread_atfork(nullptr, nullptr, [] {
            active() = 0;
            ++fork_count();
        });
#endif
    }

    /// How many forks lie between the process that imported the module and this one: threads and locks are those of a
    /// process with the same number.
    [[nodiscard]] static int forks() { return fork_count().load(); }

  private:
    /// Threads in these scopes.
    static std::atomic<int>& active() {
        static std::atomic<int> count{0};
        return count;
    }
    static std::atomic<int>& fork_count() {
        static std::atomic<int> count{0};
        return count;
    }
    /// The thread that ends the process, once it does. Set with the GIL held.
    static std::atomic<std::thread::id>& ending() {
        static std::atomic<std::thread::id> thread{};
        return thread;
    }
    [[noreturn]] static void wait_for_the_end() {
        while (true) {
            std::this_thread::sleep_for(std::chrono::hours(1));
        }
    }

    PyThreadState* state_;
};

} // namespace sheetsplat::bindings

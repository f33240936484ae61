#include <atomic>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include <gtest/gtest.h>

#include "base/instruction_set.hpp"
#include "base/threads.hpp"
#include "sheetsplat/error.hpp"

namespace sheetsplat {
namespace {

TEST(ThreadPool, DoesEverythingOnce) {
    for (const int threads : {1, 2, 5}) {
        ThreadPool pool(threads);
        EXPECT_EQ(pool.threads(), threads);
        for (const std::size_t count : {std::size_t{0}, std::size_t{1}, std::size_t{1000}}) {
            std::vector<std::atomic<int>> done(count);
            std::atomic<int> wrong{0};
            pool.run(count, [&](std::size_t n, int thread) {
                ++done[n];
                wrong += thread < 0 || thread >= threads ? 1 : 0;
            });
            for (const auto& times : done) {
                EXPECT_EQ(times, 1);
            }
            EXPECT_EQ(wrong, 0);
        }
    }
    EXPECT_GE(usable_threads(), 1);
}

TEST(ThreadPool, OneErrorEndsARun) {
    for (const int threads : {1, 2, 4}) {
        ThreadPool pool(threads);
        for (int round = 0; round < 20; ++round) {
            std::atomic<int> begun{0};
            try {
                pool.run(100000, [&](std::size_t n, int) {
                    ++begun;
                    if (n >= 10) {
                        throw std::runtime_error("task " + std::to_string(n));
                    }
                });
                ADD_FAILURE() << "no error";
            } catch (const std::runtime_error& error) {
                EXPECT_EQ(std::string(error.what()).compare(0, 5, "task "), 0) << error.what();
            }
            EXPECT_TRUE(pool.failed());
            EXPECT_LE(begun, 10 + threads);
            std::atomic<int> done{0};
            pool.run(50, [&](std::size_t, int) { ++done; });
            EXPECT_EQ(done, 50);
            EXPECT_FALSE(pool.failed());
        }
    }
}

TEST(ThreadPool, AsksWhileItWaitsAndEndsWhereThatThrows) {
    ThreadPool pool(2);
    std::atomic<int> asked{0}, begun{0};
    // The other thread's task ends once the caller was asked again and again: more often than it has tasks.
    const auto task = [&](std::size_t, int thread) {
        ++begun;
        while (begun < 2) {
            std::this_thread::yield();
        }
        while (thread != 0 && asked < 4) {
            std::this_thread::yield();
        }
    };
    pool.run(2, task, [&] { ++asked; });
    EXPECT_GE(asked, 4);
    asked = begun = 0;
    EXPECT_THROW(pool.run(2, task,
                          [&] {
                              if (++asked == 4) {
                                  throw Cancelled();
                              }
                          }),
                 Cancelled);
    EXPECT_TRUE(pool.failed());
}

/// Between tasks of the caller's own thread, too.
TEST(ThreadPool, AsksBetweenTasks) {
    ThreadPool pool(1);
    int done = 0, asked = 0;
    EXPECT_THROW(pool.run(
                     100, [&](std::size_t, int) { ++done; },
                     [&] {
                         if (++asked == 10) {
                             throw Cancelled();
                         }
                     }),
                 Cancelled);
    EXPECT_EQ(done, 10);
}

TEST(InstructionSets, AreChosenByName) {
    const std::vector<std::string> sets = instruction_sets();
    ASSERT_FALSE(sets.empty());
    EXPECT_NE(instruction_set().find(sets.front()), std::string::npos);
    for (const std::string& set : sets) {
        choose_instruction_set(set);
        EXPECT_NE(instruction_set().find(set), std::string::npos);
    }
    choose_instruction_set("");
    EXPECT_NE(instruction_set().find(sets.front()), std::string::npos);
    EXPECT_THROW(choose_instruction_set("AVX-1024"), InvalidInput);
}

} // namespace
} // namespace sheetsplat

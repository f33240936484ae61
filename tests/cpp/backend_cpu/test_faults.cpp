// What goes wrong in the middle of a picture: memory that runs out, callbacks and tasks that throw, arithmetic that
// would make a NaN in a thread of the pool. Afterwards the same renderer draws as before.
//
// The allocation functions of this executable are replaced: they can be told to fail, and to hand out memory that holds
// NaN, before and behind what was asked for. The thread sanitizer has its own, which no program may replace.
#include <atomic>
#include <cfenv>
#include <chrono>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <new>
#include <string>
#include <thread>

#include <gtest/gtest.h>

#include "backend_cpu/cpu_renderer.hpp"
#include "base/threads.hpp"
#include "sheetsplat/error.hpp"
#include "support/cpu_drawing.hpp"
#include "support/lattices.hpp"

#if defined(__SANITIZE_THREAD__)
#define ALLOCATIONS_ARE_THE_SANITIZERS
#elif defined(__has_feature)
#if __has_feature(thread_sanitizer)
#define ALLOCATIONS_ARE_THE_SANITIZERS
#endif
#endif

namespace {

/// Allocations until the one that fails; negative: none does, or it is past.
std::atomic<std::int64_t> allocations_left{-1};
/// Whether all further ones of some size fail too.
std::atomic<bool> stays_exhausted{false};
std::atomic<bool> exhausted{false};
/// Allocations that failed.
std::atomic<std::int64_t> failures{0};
std::atomic<bool> garbage{false};
#ifndef ALLOCATIONS_ARE_THE_SANITIZERS
/// Behind memory for vectors of numbers; the address sanitizer sees by itself what is read there.
#ifdef SHEETSPLAT_SANITIZED
constexpr std::size_t behind = 0;
#else
constexpr std::size_t behind = 1 << 16;
#endif
/// What an error's text takes is there even when memory for pictures is not.
constexpr std::size_t small = 1024;

bool refused(std::size_t size) {
    if (exhausted && size >= small) {
        ++failures;
        return true;
    }
    if (allocations_left.load(std::memory_order_relaxed) < 0 || allocations_left.fetch_sub(1) != 0) {
        return false;
    }
    exhausted = stays_exhausted.load();
    ++failures;
    return true;
}

void* allocate(std::size_t size, std::size_t alignment) {
    if (refused(size)) {
        throw std::bad_alloc();
    }
    const std::size_t extra = alignment > alignof(std::max_align_t) ? behind : 0;
    const std::size_t wanted = (std::max<std::size_t>(size, 1) + extra + alignment - 1) / alignment * alignment;
    void* memory = extra > 0 ? std::aligned_alloc(alignment, wanted) : std::malloc(wanted);
    if (memory == nullptr) {
        throw std::bad_alloc();
    }
    if (garbage.load(std::memory_order_relaxed)) {
        std::memset(memory, 0xFF, wanted); // NaN as float and as double
    }
    return memory;
}
#endif

} // namespace

#ifdef ALLOCATIONS_ARE_THE_SANITIZERS
#define NEEDS_ITS_OWN_ALLOCATIONS() GTEST_SKIP() << "the allocation functions are the sanitizer's"
#else
#define NEEDS_ITS_OWN_ALLOCATIONS() static_cast<void>(0)

void* operator new(std::size_t size) { return allocate(size, alignof(std::max_align_t)); }
void* operator new[](std::size_t size) { return allocate(size, alignof(std::max_align_t)); }
void* operator new(std::size_t size, std::align_val_t alignment) {
    return allocate(size, static_cast<std::size_t>(alignment));
}
void* operator new[](std::size_t size, std::align_val_t alignment) {
    return allocate(size, static_cast<std::size_t>(alignment));
}
void operator delete(void* memory) noexcept { std::free(memory); }
void operator delete[](void* memory) noexcept { std::free(memory); }
void operator delete(void* memory, std::size_t) noexcept { std::free(memory); }
void operator delete[](void* memory, std::size_t) noexcept { std::free(memory); }
void operator delete(void* memory, std::align_val_t) noexcept { std::free(memory); }
void operator delete[](void* memory, std::align_val_t) noexcept { std::free(memory); }
void operator delete(void* memory, std::size_t, std::align_val_t) noexcept { std::free(memory); }
void operator delete[](void* memory, std::size_t, std::align_val_t) noexcept { std::free(memory); }
#endif

namespace sheetsplat::backend_cpu {
namespace {

using test::askew;
using test::ball;
using test::cloud;
using test::CpuDrawing;
using test::pixels_of;
using test::scene_of;
using test::Shot;

/// While it lives, one allocation after `after` others fails (stays: and all further ones of some size).
class Exhaustion {
  public:
    explicit Exhaustion(std::int64_t after, bool stays) {
        failures = 0;
        stays_exhausted = stays;
        allocations_left = after;
    }
    ~Exhaustion() {
        allocations_left = -1;
        exhausted = false;
    }
    Exhaustion(const Exhaustion&) = delete;
    Exhaustion& operator=(const Exhaustion&) = delete;
};

/// Two kinds of fields in one picture, so that every stage has something to do.
Shot busy_shot(bool perspective = true) {
    RegularFieldOptions options = test::zero_boundary();
    options.spacing = Vec3(0.1);
    const auto lattice = ball(9, options);
    Shot shot{scene_of({lattice, cloud(200, 0.08, 4.0)}),
              askew(*lattice, perspective ? Projection::perspective : Projection::orthographic)};
    shot.scene.slice_spacing = 0.04;
    shot.size = {80, 60};
    shot.outputs = {true, true};
    return shot;
}

TEST(Faults, MemoryThatRunsOutAnywhereIsToldAndTheRendererDrawsOn) {
    NEEDS_ITS_OWN_ALLOCATIONS();
    for (const Precision precision : {Precision::float32, Precision::float64}) {
        for (const int threads : {1, 3}) {
            for (const bool stays : {false, true}) {
                const CpuDrawing drawing(busy_shot(), precision);
                const Image whole = drawing.draw({30, threads});
                const Job job = drawing.job_with({30, threads});
                std::int64_t told = 0;
                bool reached_end = false;
                // At first each allocation, later some: there is one or more a tile.
                for (std::int64_t after = 0; !reached_end; after += 1 + after / 12) {
                    CpuRenderer renderer;
                    bool drawn = false;
                    Image image;
                    try {
                        const Exhaustion exhaustion(after, stays);
                        renderer.render(job, image);
                        drawn = true;
                    } catch (const OutOfMemory& error) {
                        ++told;
                        if (after < 3) {
                            EXPECT_NE(std::string(error.what()).find("memory"), std::string::npos) << error.what();
                        }
                    }
                    if (drawn) {
                        // Nothing failed, or only a thread that the picture can do without.
                        EXPECT_EQ(pixels_of(image), pixels_of(whole)) << after;
                        reached_end = failures == 0;
                    }
                    const Image again = drawing.draw(renderer, {30, threads});
                    ASSERT_EQ(pixels_of(again), pixels_of(whole)) << "after allocation " << after;
                    ASSERT_EQ(again.depth, whole.depth) << "after allocation " << after;
                }
                EXPECT_GT(told, 20) << "nothing ran out";
            }
        }
    }
}

TEST(Faults, MemoryThatRunsOutInALaterPictureIsToldToo) {
    NEEDS_ITS_OWN_ALLOCATIONS();
    const CpuDrawing drawing(busy_shot(), Precision::float32), other(busy_shot(false), Precision::float32);
    const Image whole = drawing.draw({30, 2}), whole_other = other.draw({30, 2});
    const Job job = other.job_with({30, 2});
    CpuRenderer renderer;
    std::int64_t told = 0;
    for (std::int64_t after = 0; after < 60; after += 3) {
        ASSERT_EQ(pixels_of(drawing.draw(renderer, {30, 2})), pixels_of(whole));
        try {
            Image image;
            const Exhaustion exhaustion(after, true);
            renderer.render(job, image);
        } catch (const OutOfMemory&) {
            ++told;
        }
        ASSERT_EQ(pixels_of(other.draw(renderer, {30, 2})), pixels_of(whole_other));
    }
    EXPECT_GT(told, 5);
}

/// What is read was written: pictures are the same on memory that holds NaN all around. Channels and sizes of tiles
/// change from picture to picture.
TEST(Faults, NothingIsReadThatWasNotWritten) {
    NEEDS_ITS_OWN_ALLOCATIONS();
    // Its first slice covers all of it, and is looked at together with the one before, where there is nothing.
    const auto block = std::make_shared<const RegularField>(std::vector<float>(6 * 6 * 6, 1.0F),
                                                            std::array<std::size_t, 3>{6, 6, 6}, test::zero_boundary());
    Shot plain{scene_of({block}), Camera::fit(block->supports_world(), Vec3(0, 0, -1), Vec3(0, 1, 0))};
    plain.scene.preintegration = true;
    plain.scene.transfer_function = TransferFunction({{0.0, {0.1, 0.2, 0.9}, 0.0}, {1.0, {1.0, 0.8, 0.2}, 0.4}});
    plain.size = {130, 120};
    Shot shot = busy_shot();
    shot.size = {130, 120};
    for (const Precision precision : {Precision::float32, Precision::float64}) {
        const CpuDrawing one(plain, precision), many(shot, precision);
        // (Several channels of small tiles take more room than one of larger ones.)
        const int sizes[] = {40, 60, 17, 126, 126, 100, 62, 7, 31, 126};
        std::vector<Image> expected;
        for (std::size_t n = 0; n < std::size(sizes); ++n) {
            expected.push_back((n % 2 == 0 ? many : one).draw({sizes[n], 1}));
        }
        garbage = true;
        {
            CpuRenderer renderer;
            for (std::size_t n = 0; n < expected.size(); ++n) {
                const Image image = (n % 2 == 0 ? many : one).draw(renderer, {sizes[n], 2});
                EXPECT_EQ(pixels_of(image), pixels_of(expected[n])) << "tiles of " << sizes[n];
                EXPECT_EQ(image.coverage, expected[n].coverage) << "tiles of " << sizes[n];
            }
        }
        garbage = false;
    }
}

/// Long enough that the renderer asks: it does so every few milliseconds.
Shot long_shot() {
    const auto field = cloud(20000, 0.08, 3.0);
    Shot shot{scene_of({field}), askew(*field, Projection::perspective)};
    shot.scene.slice_spacing = 0.01;
    shot.size = {300, 300};
    return shot;
}

TEST(Faults, ProgressCanEndAPictureAnyTime) {
    const Shot quick = busy_shot();
    const CpuDrawing drawing(long_shot(), Precision::float64), after(quick, Precision::float64);
    const Image whole = after.draw();
    for (const int threads : {1, 3}) {
        CpuRenderer renderer;
        for (const int call : {1, 2, 5}) {
            int calls = 0;
            double share = 0.0;
            std::thread::id caller;
            const Progress stop = [&](double done) {
                EXPECT_GE(done, share);
                EXPECT_LE(done, 1.0);
                share = done;
                caller = std::this_thread::get_id();
                return ++calls < call;
            };
            EXPECT_THROW(static_cast<void>(drawing.draw(renderer, {0, threads, &stop})), Cancelled);
            EXPECT_EQ(calls, call) << "nobody is asked twice after the end";
            EXPECT_EQ(caller, std::this_thread::get_id());
            calls = 0;
            const Progress thrower = [&](double) -> bool {
                if (++calls == call) {
                    throw std::runtime_error("from the callback");
                }
                return true;
            };
            try {
                static_cast<void>(drawing.draw(renderer, {0, threads, &thrower}));
                ADD_FAILURE() << "the callback's error was lost";
            } catch (const std::runtime_error& error) {
                EXPECT_STREQ(error.what(), "from the callback");
            }
            EXPECT_EQ(calls, call);
            ASSERT_EQ(pixels_of(after.draw(renderer, {0, threads})), pixels_of(whole));
        }
    }
}

/// Not a bound: machines differ. What is measured is printed.
TEST(Faults, MeasuresHowSoonAPictureEnds) {
    using Clock = std::chrono::steady_clock;
    const CpuDrawing drawing(long_shot(), Precision::float32);
    CpuRenderer renderer;
    double longest = 0.0, between = 0.0;
    for (int n = 1; n < 12; ++n) {
        int calls = 0;
        auto last = Clock::now();
        const Progress stop = [&](double) {
            const auto now = Clock::now();
            between = std::max(between, std::chrono::duration<double>(now - last).count());
            last = now;
            return ++calls < n;
        };
        try {
            static_cast<void>(drawing.draw(renderer, {0, 2, &stop}));
        } catch (const Cancelled&) {
            longest = std::max(longest, std::chrono::duration<double>(Clock::now() - last).count());
        }
    }
    std::printf("ends within %.2f ms of a refusal; asks at least every %.2f ms\n", 1e3 * longest, 1e3 * between);
    RecordProperty("milliseconds_to_end", std::to_string(1e3 * longest));
}

std::size_t threads_of_this_process() {
    std::size_t count = 0;
    for ([[maybe_unused]] const auto& task : std::filesystem::directory_iterator("/proc/self/task")) {
        ++count;
    }
    return count;
}

TEST(Faults, NoThreadIsLeftBehind) {
    if (!std::filesystem::exists("/proc/self/task")) {
        GTEST_SKIP() << "no /proc";
    }
    const std::size_t before = threads_of_this_process();
    const CpuDrawing drawing(busy_shot(), Precision::float32);
    for (int n = 0; n < 20; ++n) {
        CpuRenderer renderer;
        static_cast<void>(drawing.draw(renderer, {0, 1 + n % 5}));
        EXPECT_EQ(threads_of_this_process(), before + static_cast<std::size_t>(n % 5));
        const Progress stop = [](double) { return false; };
        try {
            static_cast<void>(drawing.draw(renderer, {0, 4, &stop}));
        } catch (const Cancelled&) {}
        try {
            const Job job = drawing.job_with({0, 3});
            Image image;
            const Exhaustion exhaustion(5 * n, true);
            renderer.render(job, image);
        } catch (const OutOfMemory&) {}
    }
    EXPECT_EQ(threads_of_this_process(), before);
}

#if defined(__GLIBC__) && defined(__x86_64__)
/// Threads take over what traps where they were made.
TEST(Traps, APictureOfManyThreadsSetsOffNone) {
    std::feclearexcept(FE_ALL_EXCEPT);
    const CpuDrawing one(busy_shot(), Precision::float32), other(busy_shot(false), Precision::float64);
    feenableexcept(FE_INVALID | FE_DIVBYZERO | FE_OVERFLOW);
    {
        CpuRenderer renderer;
        static_cast<void>(one.draw(renderer, {20, 4}));
        static_cast<void>(other.draw(renderer, {20, 4}));
    }
    fedisableexcept(FE_ALL_EXCEPT);
}

TEST(TrapsDeathTest, ANanInAThreadOfThePoolIsSeen) {
    ::testing::FLAGS_gtest_death_test_style = "threadsafe";
    const auto make_nan = [] {
        feenableexcept(FE_INVALID);
        ThreadPool pool(2);
        std::atomic<int> begun{0};
        volatile double zero = 0.0;
        pool.run(2, [&](std::size_t, int thread) {
            ++begun;
            while (begun < 2) {
                std::this_thread::yield();
            }
            if (thread != 0) {
                zero = zero / zero;
            }
        });
        std::_Exit(0);
    };
    EXPECT_EXIT(make_nan(), ::testing::KilledBySignal(SIGFPE), "");
}
#endif

} // namespace
} // namespace sheetsplat::backend_cpu

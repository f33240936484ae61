// Many contexts: one after the other without growth, and several at once in threads.
#include "gl_tests.hpp"

#include <atomic>
#include <chrono>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <thread>

#include <malloc.h>
#include <unistd.h>

namespace sheetsplat::gl::testing {
namespace {

struct Usage {
    double resident_mib = 0.0;
    double heap_mib = 0.0; // that malloc has given out: sees leaks that hide in memory which the process already has
    long descriptors = 0;
    long threads = 0;
};

Usage usage() {
    Usage now;
    long pages = 0;
    std::ifstream statm("/proc/self/statm");
    statm >> pages >> pages; // size, then resident
    now.resident_mib = static_cast<double>(pages) * static_cast<double>(sysconf(_SC_PAGESIZE)) / 1048576.0;
    const auto entries = [](const char* path) {
        return static_cast<long>(
            std::distance(std::filesystem::directory_iterator(path), std::filesystem::directory_iterator()));
    };
#if defined(__GLIBC__) && __GLIBC_PREREQ(2, 33)
    const auto heap = mallinfo2();
    now.heap_mib = static_cast<double>(heap.uordblks + heap.hblkhd) / 1048576.0;
#endif
    now.descriptors = entries("/proc/self/fd");
    now.threads = entries("/proc/self/task");
    return now;
}

void use_and_drop(const std::string& platform) {
    const std::unique_ptr<Context> context = Context::create(on(platform));
    const Current current(*context);
    const Texture texture(context->api(), GL_RGBA32F, 64, 64);
    const Framebuffer framebuffer(context->api(), {&texture});
    framebuffer.bind();
    context->api().ClearColor(1.0F, 0.5F, 0.25F, 1.0F);
    context->api().Clear(GL_COLOR_BUFFER_BIT);
    std::vector<float> back(64 * 64 * 4);
    context->api().ReadPixels(0, 0, 64, 64, GL_RGBA, GL_FLOAT, back.data());
    Buffer buffer(context->api(), GL_ARRAY_BUFFER);
    buffer.upload(back.data(), back.size() * sizeof(float));
    ASSERT_EQ(back[4 * 64 * 64 - 3], 0.5F);
}

class Lifetime : public ::testing::TestWithParam<const char*> {};
INSTANTIATE_TEST_SUITE_P(Platforms, Lifetime, ::testing::Values("egl", "surfaceless", "osmesa"),
                         [](const auto& name) { return std::string(name.param); });

TEST_P(Lifetime, contexts_that_come_and_go_leave_nothing) {
    if (!std::filesystem::exists("/proc/self/statm")) {
        GTEST_SKIP() << "no /proc to measure by";
    }
    const Tried tried = try_context(on(GetParam()));
    if (!tried.context) {
        GTEST_SKIP() << tried.reason;
    }
    // A context of softpipe takes 20 times as long.
    const int count = tried.context->capabilities().renderer.find("softpipe") == std::string::npos ? 250 : 50;
    constexpr int warm_up = 20;
    for (int i = 0; i < warm_up; ++i) {
        use_and_drop(GetParam());
    }
    const Usage before = usage();
    const auto start = std::chrono::steady_clock::now();
    for (int i = 0; i < count; ++i) {
        use_and_drop(GetParam());
    }
    const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    const Usage after = usage();
    std::printf("%s: %d contexts in %.2f s; resident %.1f -> %.1f MiB, heap %.2f -> %.2f MiB, descriptors %ld -> %ld, "
                "threads %ld -> %ld\n",
                GetParam(), count, seconds, before.resident_mib, after.resident_mib, before.heap_mib, after.heap_mib,
                before.descriptors, after.descriptors, before.threads, after.threads);
    // A thousandth of a MiB a context, and four of pages.
    EXPECT_LT(after.resident_mib - before.resident_mib, 4e-3 * 250);
    EXPECT_LT(after.heap_mib - before.heap_mib, 1e-3 * 250);
    EXPECT_EQ(after.descriptors, before.descriptors);
    EXPECT_EQ(after.threads, before.threads);
}

// The control: contexts that are not given back do show.
TEST_P(Lifetime, contexts_that_stay_are_seen) {
    const Tried tried = try_context(on(GetParam()));
    if (!tried.context) {
        GTEST_SKIP() << tried.reason;
    }
    // One of softpipe takes 195 MiB.
    const int count = tried.context->capabilities().renderer.find("softpipe") == std::string::npos ? 10 : 1;
    const Usage before = usage();
    std::vector<std::unique_ptr<Context>> kept;
    for (int i = 0; i < count; ++i) {
        kept.push_back(Context::create(on(GetParam())));
    }
    const Usage after = usage();
    if (before.heap_mib == 0.0) {
        GTEST_SKIP() << "this C library does not tell what malloc has given out";
    }
    EXPECT_GT(after.heap_mib - before.heap_mib, 1.0);
}

TEST_P(Lifetime, four_threads_draw_at_once) {
    const Tried tried = try_context(on(GetParam()));
    if (!tried.context) {
        GTEST_SKIP() << tried.reason;
    }
    constexpr int threads = 4;
    constexpr int rounds = 50;
    std::atomic<int> right{0};
    std::array<std::string, threads> failures;
    std::vector<std::thread> workers;
    for (int id = 0; id < threads; ++id) {
        workers.emplace_back([&, id] {
            try {
                const std::unique_ptr<Context> context = Context::create(on(GetParam()));
                const Current current(*context);
                const Api& gl = context->api();
                const Texture target(gl, GL_RGBA32F, 33, 17);
                const Framebuffer framebuffer(gl, {&target});
                const VertexArray vertices(gl);
                const Program program(gl, plain_files(), "all.vert", "value.frag", {}, glsl_330, {"color"});
                framebuffer.bind();
                vertices.bind();
                program.use();
                gl.Viewport(0, 0, 33, 17);
                gl.Enable(GL_BLEND);
                gl.BlendFunc(GL_ONE, GL_ONE);
                std::vector<float> back(33 * 17 * 4);
                for (int round = 0; round < rounds; ++round) {
                    const float part = static_cast<float>(1000 * id + round);
                    gl.ClearColor(0.5F, 0.0F, 0.0F, 0.0F);
                    gl.Clear(GL_COLOR_BUFFER_BIT);
                    program.set("value", part, 1.0F, 2.0F, 3.0F);
                    gl.DrawArrays(GL_TRIANGLES, 0, 3);
                    gl.ReadPixels(0, 0, 33, 17, GL_RGBA, GL_FLOAT, back.data());
                    bool all = true;
                    for (std::size_t i = 0; i < back.size(); i += 4) {
                        all = all && back[i] == part + 0.5F && back[i + 1] == 1.0F && back[i + 3] == 3.0F;
                    }
                    right += all ? 1 : 0;
                }
                check_errors(gl, "drawing in a thread");
            } catch (const std::exception& error) {
                failures.at(static_cast<std::size_t>(id)) = error.what();
            }
        });
    }
    for (std::thread& worker : workers) {
        worker.join();
    }
    for (const std::string& failure : failures) {
        EXPECT_EQ(failure, "");
    }
    EXPECT_EQ(right.load(), threads * rounds);
}

TEST_P(Lifetime, contexts_made_and_dropped_in_threads_at_once) {
    const Tried tried = try_context(on(GetParam()));
    if (!tried.context) {
        GTEST_SKIP() << tried.reason;
    }
    std::atomic<int> done{0};
    std::vector<std::thread> workers;
    for (int id = 0; id < 4; ++id) {
        workers.emplace_back([&] {
            for (int i = 0; i < 10; ++i) {
                use_and_drop(GetParam());
                ++done;
            }
        });
    }
    for (std::thread& worker : workers) {
        worker.join();
    }
    EXPECT_EQ(done.load(), 40);
}

TEST_P(Lifetime, a_context_moves_between_threads) {
    const Tried tried = try_context(on(GetParam()));
    if (!tried.context) {
        GTEST_SKIP() << tried.reason;
    }
    for (int i = 0; i < 3; ++i) {
        bool right = false;
        std::thread([&] {
            const Current current(*tried.context);
            right = clears_and_reads_back(tried.context->api(), {1.0F, 2.0F, 3.0F, static_cast<float>(i)});
        }).join();
        EXPECT_TRUE(right);
        const Current current(*tried.context);
        EXPECT_TRUE(clears_and_reads_back(tried.context->api(), {0.0F, 0.0F, 0.0F, static_cast<float>(i)}));
    }
}

} // namespace
} // namespace sheetsplat::gl::testing

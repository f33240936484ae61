#include <gtest/gtest.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cstdint>
#include <fstream>
#include <limits>
#include <string>

#include "base/memory.hpp"
#include "sheetsplat/error.hpp"
#include "support.hpp"

namespace sheetsplat {
namespace {

using test::expect_parts;
using test::message_of;

constexpr std::uint64_t unlimited = std::numeric_limits<std::uint64_t>::max();
constexpr std::uint64_t mib = 1ULL << 20;

/// A folder that looks like /proc and one that looks like mounted control groups.
class FakeSystem {
  public:
    void write(const std::string& path, const std::string& text) const {
        const std::filesystem::path file = folder_.path() / path;
        std::filesystem::create_directories(file.parent_path());
        std::ofstream(file) << text;
    }
    void meminfo(std::uint64_t available_kib) const {
        write("proc/meminfo", "MemTotal:       99999999 kB\nMemFree:  17 kB\nMemAvailable:   " +
                                  std::to_string(available_kib) + " kB\n");
    }
    void mount(const std::string& root, const std::string& type, const std::string& options) const {
        write("proc/self/mountinfo", "22 1 0:1 / / rw - ext4 /dev/root rw\n31 22 0:28 " + root + " " + groups() +
                                         " rw,relatime shared:9 - " + type + " cgroup " + options + "\n");
    }
    void group_2(const std::string& group, const std::string& limit, std::uint64_t usage,
                 std::uint64_t inactive = 0) const {
        write("groups" + group + "/memory.max", limit + "\n");
        write("groups" + group + "/memory.current", std::to_string(usage) + "\n");
        write("groups" + group + "/memory.stat", "anon 5\nfile 9\ninactive_file " + std::to_string(inactive) + "\n");
    }
    [[nodiscard]] std::string groups() const { return (folder_.path() / "groups").string(); }
    [[nodiscard]] std::uint64_t available() const { return available_memory_in((folder_.path() / "proc").string()); }

  private:
    test::TemporaryFolder folder_;
};

TEST(Memory, unknown_is_unlimited) { EXPECT_EQ(FakeSystem().available(), unlimited); }

TEST(Memory, reads_free_physical_memory) {
    const FakeSystem system;
    system.meminfo(2048);
    EXPECT_EQ(system.available(), 2 * mib);
}

TEST(Memory, control_group_version_2_is_limit_minus_what_is_held) {
    const FakeSystem system;
    system.meminfo(1 << 20);
    system.write("proc/self/cgroup", "0::/a/b\n");
    system.mount("/", "cgroup2", "rw");
    system.group_2("/a/b", "max", 70 * mib);
    EXPECT_EQ(system.available(), 1024 * mib);
    system.group_2("/a/b", std::to_string(100 * mib), 70 * mib, 20 * mib);
    EXPECT_EQ(system.available(), 50 * mib);
    // A group around it allows less.
    system.group_2("/a", std::to_string(90 * mib), 80 * mib);
    EXPECT_EQ(system.available(), 10 * mib);
    // Used up and more.
    system.group_2("/a", std::to_string(90 * mib), 95 * mib);
    EXPECT_EQ(system.available(), 0U);
}

TEST(Memory, a_group_that_is_itself_mounted_is_found) {
    const FakeSystem system;
    system.write("proc/self/cgroup", "0::/docker/x/job\n");
    system.mount("/docker/x", "cgroup2", "rw");
    system.group_2("/job", std::to_string(40 * mib), 10 * mib);
    EXPECT_EQ(system.available(), 30 * mib);
    system.group_2("", std::to_string(35 * mib), 10 * mib);
    EXPECT_EQ(system.available(), 25 * mib);
}

TEST(Memory, control_group_version_1) {
    const FakeSystem system;
    system.write("proc/self/cgroup", "5:cpu,cpuacct:/elsewhere\n4:memory:/job\n0::/\n");
    system.mount("/", "cgroup", "rw,memory");
    system.write("groups/job/memory.limit_in_bytes", std::to_string(64 * mib) + "\n");
    system.write("groups/job/memory.usage_in_bytes", std::to_string(32 * mib) + "\n");
    system.write("groups/job/memory.stat", "inactive_file 1\ntotal_inactive_file " + std::to_string(8 * mib) + "\n");
    EXPECT_EQ(system.available(), 40 * mib);
    // Mounted without the memory controller, the same files mean nothing.
    system.mount("/", "cgroup", "rw,cpu,cpuacct");
    EXPECT_EQ(system.available(), unlimited);
}

TEST(Memory, garbled_files_are_no_limit) {
    const FakeSystem system;
    system.write("proc/self/cgroup", "nonsense\n:\n0::\n4:memory:relative\n0::/a\n");
    system.write("proc/self/mountinfo", "short\n1 2 - \n - cgroup2\n");
    system.write("proc/meminfo", "MemAvailable: lots\n");
    EXPECT_EQ(system.available(), unlimited);
}

TEST(Memory, this_process_may_take_some_but_not_everything) {
    EXPECT_GT(available_memory(), mib);
    EXPECT_LT(available_memory(), 1ULL << 50);
}

#ifndef SHEETSPLAT_SANITIZED
TEST(Memory, the_limit_on_address_space_counts) {
    // In a child, since a limit cannot be raised again.
    const pid_t child = fork();
    if (child == 0) {
        const rlimit limit{512 * mib, 512 * mib};
        const bool set = setrlimit(RLIMIT_AS, &limit) == 0;
        const std::uint64_t left = available_memory();
        _exit(set && left < 512 * mib && left > 0 ? 0 : 1);
    }
    int status = -1;
    ASSERT_EQ(waitpid(child, &status, 0), child);
    EXPECT_TRUE(WIFEXITED(status) && WEXITSTATUS(status) == 0);
}
#endif

TEST(Memory, products_that_do_not_fit_are_refused) {
    EXPECT_EQ(checked_product(0, unlimited, "nothing"), 0U);
    EXPECT_EQ(checked_product(unlimited, 0, "nothing"), 0U);
    EXPECT_EQ(checked_product(unlimited, 1, "all"), unlimited);
    EXPECT_EQ(checked_product(1ULL << 32, (1ULL << 32) - 1, "much"), unlimited - ((1ULL << 32) - 1));
    const std::string text = message_of<OutOfMemory>([] { checked_product(1ULL << 32, 1ULL << 32, "the picture"); });
    expect_parts(text, {"the picture", "4294967296 times 4294967296"});
}

TEST(Memory, require_memory_names_both_sides) {
    EXPECT_NO_THROW(require_memory(0, "nothing", ""));
    EXPECT_NO_THROW(require_memory(1024, "a little", ""));
    const std::string text =
        message_of<OutOfMemory>([] { require_memory(3ULL << 59, "the sheet buffers", "render a smaller picture"); });
    expect_parts(text, {"the sheet buffers", "found ", "iB", "wanted 1.50 EiB", "render a smaller picture"});
}

} // namespace
} // namespace sheetsplat

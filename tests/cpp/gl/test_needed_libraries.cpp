// The libraries that a file needs, of whole and of damaged files.
#include <algorithm>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <random>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "needed_libraries.hpp"

namespace sheetsplat::gl {
namespace {

bool needs(const std::vector<std::string>& names, const std::string& stem) {
    return std::any_of(names.begin(), names.end(),
                       [&](const std::string& name) { return name.compare(0, stem.size(), stem) == 0; });
}

/// This program, and a place for spoilt copies of it.
class NeededLibraries : public testing::Test {
  protected:
    void SetUp() override {
        std::ifstream own("/proc/self/exe", std::ios::binary);
        bytes_.assign(std::istreambuf_iterator<char>(own), {});
        ASSERT_GT(bytes_.size(), 1000U);
    }
    void TearDown() override { std::filesystem::remove(path_); }

    std::vector<std::string> of(const std::string& bytes) const {
        std::ofstream(path_, std::ios::binary | std::ios::trunc) << bytes;
        return needed_libraries(path_);
    }

    std::string bytes_;
    std::string path_ = (std::filesystem::temp_directory_path() /
                         ("needed-" + std::to_string(std::random_device{}()) + std::to_string(std::random_device{}())))
                            .string();
};

TEST_F(NeededLibraries, AreThoseOfThisProgram) {
    const std::vector<std::string> names = needed_libraries("/proc/self/exe");
    EXPECT_TRUE(needs(names, "libc.so")) << names.size();
    EXPECT_TRUE(needs(names, "libstdc++.so") || needs(names, "libc++.so"));
    EXPECT_FALSE(needs(names, "libEGL"));
}

TEST_F(NeededLibraries, AreNoneWhereThereIsNoLibrary) {
    EXPECT_TRUE(needed_libraries("/nowhere/libnothing.so").empty());
    EXPECT_TRUE(needed_libraries("/tmp").empty());
    EXPECT_TRUE(of("").empty());
    EXPECT_TRUE(of("no library at all, but longer than the header of one would be: " + std::string(200, 'x')).empty());
}

TEST_F(NeededLibraries, OfDamagedFilesAreReadWithinTheFile) {
    for (std::size_t length = 0; length < 1200; length += 50) {
        EXPECT_TRUE(of(bytes_.substr(0, length)).empty()) << length;
    }
    const std::vector<std::string> whole = of(bytes_);
    EXPECT_EQ(whole, needed_libraries("/proc/self/exe"));
    // Damage of the header and the segments, and of the names.
    const std::size_t names = bytes_.find("libc.so");
    ASSERT_NE(names, std::string::npos);
    std::fstream file(path_, std::ios::binary | std::ios::in | std::ios::out);
    const auto put = [&](std::size_t at, char byte) {
        file.seekp(static_cast<std::streamoff>(at));
        file.put(byte);
    };
    std::mt19937 random(7);
    int others = 0;
    for (int trial = 0; trial < 500; ++trial) {
        std::vector<std::size_t> places;
        for (int change = 0; change < 4; ++change) {
            places.push_back(trial % 4 == 0 ? names + random() % 64 : random() % 900);
            put(places.back(), static_cast<char>(random()));
        }
        file.flush();
        const std::vector<std::string> found = needed_libraries(path_);
        EXPECT_LE(found.size(), 4096U);
        others += found != whole ? 1 : 0;
        for (const std::size_t at : places) {
            put(at, bytes_[at]);
        }
        file.flush();
    }
    EXPECT_EQ(needed_libraries(path_), whole);
    EXPECT_GT(others, 100) << "damage shows";
}

} // namespace
} // namespace sheetsplat::gl

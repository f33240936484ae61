#include <gtest/gtest.h>
#include <png.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <csignal>
#include <cstring>
#include <fstream>
#include <iterator>
#include <limits>
#include <string>
#include <vector>

#include "sheetsplat/error.hpp"
#include "sheetsplat/image.hpp"
#include "support.hpp"

namespace sheetsplat {
namespace {

namespace fs = std::filesystem;
using test::expect_parts;
using test::message_of;
using test::TemporaryFolder;

constexpr float infinity = std::numeric_limits<float>::infinity();
constexpr float nan = std::numeric_limits<float>::quiet_NaN();

Image colour(int width, int height, std::vector<float> rgba) {
    Image image;
    image.size = {width, height};
    image.rgba = std::move(rgba);
    return image;
}

Image scalar(int width, int height, std::vector<float> values) {
    Image image;
    image.size = {width, height};
    image.scalar = std::move(values);
    return image;
}

std::string bytes_of(const fs::path& path) {
    std::ifstream file(path, std::ios::binary);
    return {std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>()};
}

/// Decodes with libpng's simplified reader.
std::vector<int> pixels_of(const fs::path& path, png_uint_32 format) {
    png_image png{};
    png.version = PNG_IMAGE_VERSION;
    EXPECT_NE(png_image_begin_read_from_file(&png, path.c_str()), 0) << png.message;
    EXPECT_EQ(png.format, format);
    png.format = format;
    std::vector<png_byte> data(PNG_IMAGE_SIZE(png));
    EXPECT_NE(png_image_finish_read(&png, nullptr, data.data(), 0, nullptr), 0) << png.message;
    return {data.begin(), data.end()};
}

TEST(SavePng, writes_straight_alpha_clamped_and_rounded) {
    const TemporaryFolder folder;
    const fs::path path = folder.path() / "a.png";
    // Half of 1/255 is rounded upwards; a colour above 1 is clamped after the division by alpha.
    save_png(colour(3, 2, {0.25F, 0.125F, 0.0F,     0.5F, //
                           1.0F,  0.5F,   2.0F,     1.0F, //
                           0.0F,  0.0F,   0.0F,     0.0F, //
                           0.3F,  0.0F,   0.0F,     0.0F, // light without opacity: nothing to divide by
                           0.2F,  0.1F,   -0.1F,    0.2F, //
                           nan,   0.0F,   infinity, 1.0F}),
             path.string());
    const std::vector<int> expected{128, 64, 0, 128, 255, 128, 255, 255, 0, 0, 0,   0, //
                                    0,   0,  0, 0,   255, 128, 0,   51,  0, 0, 255, 255};
    EXPECT_EQ(pixels_of(path, PNG_FORMAT_RGBA), expected);
    EXPECT_EQ(folder.files(), 1U);
}

TEST(SavePng, rounds_halves_upwards) {
    const TemporaryFolder folder;
    const fs::path path = folder.path() / "a.png";
    const auto below = std::nextafter(0.5F / 255.0F, 0.0F);
    const auto above = std::nextafter(0.5F / 255.0F, 1.0F);
    save_png(colour(1, 1, {below, above, 0.5F, 1.0F}), path.string());
    EXPECT_EQ(pixels_of(path, PNG_FORMAT_RGBA), (std::vector<int>{0, 1, 128, 255}));
}

TEST(SavePng, has_no_gamma_nor_other_colour_chunk) {
    const TemporaryFolder folder;
    const fs::path path = folder.path() / "a.png";
    save_png(colour(1, 1, {0.5F, 0.5F, 0.5F, 1.0F}), path.string());
    const std::string bytes = bytes_of(path);
    for (const char* chunk : {"gAMA", "sRGB", "iCCP", "cHRM"}) {
        EXPECT_EQ(bytes.find(chunk), std::string::npos) << chunk;
    }
    EXPECT_NE(bytes.find("IHDR"), std::string::npos);
}

TEST(SavePng, scales_scalars_to_the_largest) {
    const TemporaryFolder folder;
    const fs::path path = folder.path() / "a.png";
    save_png(scalar(5, 1, {0.0F, 4.0F, 2.0F, -1.0F, 1.0F}), path.string());
    EXPECT_EQ(pixels_of(path, PNG_FORMAT_GRAY), (std::vector<int>{0, 255, 128, 0, 64}));
    save_png(scalar(2, 1, {0.0F, -3.0F}), path.string());
    EXPECT_EQ(pixels_of(path, PNG_FORMAT_GRAY), (std::vector<int>{0, 0}));
    save_png(scalar(4, 1, {infinity, 8.0F, nan, 2.0F}), path.string());
    EXPECT_EQ(pixels_of(path, PNG_FORMAT_GRAY), (std::vector<int>{255, 255, 0, 64}));
}

TEST(SavePfm, is_little_endian_and_starts_at_the_bottom) {
    const TemporaryFolder folder;
    const fs::path path = folder.path() / "a.pfm";
    save_pfm(colour(1, 2, {1.0F, 2.0F, 3.0F, 0.5F, -4.0F, 0.1F, nan, 0.25F}), path.string());
    const std::string bytes = bytes_of(path);
    const std::string header = "PF\n1 2\n-1.0\n";
    ASSERT_EQ(bytes.size(), header.size() + 2 * 3 * 4);
    EXPECT_EQ(bytes.substr(0, header.size()), header);
    // -4 is 0xC0800000.
    EXPECT_EQ(bytes.substr(header.size(), 4), std::string("\x00\x00\x80\xC0", 4));
    // The second row of the file is the top row: 1 is 0x3F800000.
    EXPECT_EQ(bytes.substr(header.size() + 12, 4), std::string("\x00\x00\x80\x3F", 4));

    save_pfm(scalar(2, 1, {0.0F, 1.0F}), path.string());
    EXPECT_EQ(bytes_of(path), std::string("Pf\n2 1\n-1.0\n") + std::string("\0\0\0\0\0\0\x80\x3F", 8));
}

TEST(Save, refuses_pictures_that_do_not_fit_their_size) {
    const TemporaryFolder folder;
    const std::string path = (folder.path() / "a.png").string();
    Image both = colour(1, 1, {0, 0, 0, 0});
    both.scalar = {1.0F};
    for (const Image& image :
         {colour(2, 1, {0, 0, 0, 0}), colour(0, 0, {}), scalar(2, 2, {1.0F}), colour(-1, -1, {0, 0, 0, 0}), both}) {
        expect_parts(message_of<InvalidInput>([&] { save_png(image, path); }), {"cannot be written", "size "});
        expect_parts(message_of<InvalidInput>([&] { save_pfm(image, path); }), {"cannot be written", "size "});
    }
    EXPECT_EQ(folder.files(), 0U);
}

TEST(Save, says_why_a_place_cannot_be_written) {
    const TemporaryFolder folder;
    const Image image = colour(1, 1, {0, 0, 0, 0});
    const std::string nowhere = (folder.path() / "missing" / "a.png").string();
    expect_parts(message_of<Error>([&] { save_png(image, nowhere); }), {nowhere, "found No such file or directory"});
    expect_parts(message_of<Error>([&] { save_pfm(image, nowhere); }), {nowhere, "found No such file or directory"});
    expect_parts(message_of<Error>([&] { save_png(image, folder.path().string()); }), {"a folder of that name"});
    expect_parts(message_of<Error>([&] { save_png(image, "/dev/null"); }), {"no regular file"});
    expect_parts(message_of<Error>([&] { save_png(image, ""); }), {"an empty file name"});
    EXPECT_EQ(folder.files(), 0U);
}

TEST(Save, replaces_what_was_there_and_keeps_links) {
    const TemporaryFolder folder;
    const fs::path path = folder.path() / "a.png";
    const fs::path link = folder.path() / "link.png";
    std::ofstream(path) << "old";
    fs::create_symlink(path, link);
    save_png(scalar(1, 1, {1.0F}), link.string());
    EXPECT_TRUE(fs::is_symlink(link));
    EXPECT_EQ(pixels_of(path, PNG_FORMAT_GRAY), (std::vector<int>{255}));
    EXPECT_EQ(folder.files(), 2U);
}

TEST(Save, makes_files_with_the_usual_rights) {
    const TemporaryFolder folder;
    const fs::path path = folder.path() / "a.png";
    const mode_t before = umask(022);
    save_png(scalar(1, 1, {1.0F}), path.string());
    umask(before);
    EXPECT_EQ(static_cast<int>(fs::status(path).permissions()), 0644);
}

/// Runs `write` in a child that may write no more than `bytes` to a file; expects an Error there, and the old file
/// untouched.
template <class Write>
void expect_whole_or_not_at_all(Write&& write) {
    const TemporaryFolder folder;
    const fs::path path = folder.path() / "a.out";
    std::ofstream(path) << "old";
    const pid_t child = fork();
    if (child == 0) {
        std::signal(SIGXFSZ, SIG_IGN);
        const rlimit limit{20000, 20000};
        int result = setrlimit(RLIMIT_FSIZE, &limit) == 0 ? 1 : 2;
        try {
            write(path.string());
        } catch (const Error& error) {
            result = std::strstr(error.what(), "File too large") != nullptr ? 0 : 3;
        } catch (...) {
            result = 4;
        }
        _exit(result);
    }
    int status = -1;
    ASSERT_EQ(waitpid(child, &status, 0), child);
    ASSERT_TRUE(WIFEXITED(status));
    EXPECT_EQ(WEXITSTATUS(status), 0);
    EXPECT_EQ(folder.files(), 1U);
    EXPECT_EQ(bytes_of(path), "old");
}

TEST(Save, leaves_nothing_half_written) {
    // Noise, since a picture that compresses well would fit.
    std::vector<float> noise(200 * 200);
    std::uint32_t state = 1;
    for (float& value : noise) {
        state = state * 1664525U + 1013904223U;
        value = static_cast<float>(state >> 8) / 16777216.0F;
    }
    const Image image = scalar(200, 200, std::move(noise));
    expect_whole_or_not_at_all([&](const std::string& path) { save_png(image, path); });
    expect_whole_or_not_at_all([&](const std::string& path) { save_pfm(image, path); });
    // The last bytes of a small file reach the disk only when it is closed.
    const Image small = scalar(72, 70, std::vector<float>(72 * 70, 1.0F));
    expect_whole_or_not_at_all([&](const std::string& path) { save_pfm(small, path); });
}

} // namespace
} // namespace sheetsplat

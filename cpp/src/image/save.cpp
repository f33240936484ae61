// Pictures as PNG and PFM files, which appear whole or not at all.
#include <fcntl.h>
#include <png.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <chrono>
#include <cmath>
#include <csetjmp>
#include <cstdint>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <string>
#include <system_error>
#include <utility>

#include "base/checks.hpp"
#include "sheetsplat/error.hpp"
#include "sheetsplat/image.hpp"

namespace sheetsplat {
namespace {

namespace fs = std::filesystem;

[[noreturn]] void refuse_file(const std::string& path, const std::string& found) {
    throw Error(Complaint{"the picture cannot be written to " + path, found, "a place where a file can be made",
                          "check folder, rights and free space"});
}

std::string reason_of(int error) { return std::generic_category().message(error); }

/// A file beside the target that takes the target's place when it is complete, and vanishes when it is not.
class WholeFile {
  public:
    explicit WholeFile(const std::string& path) : path_(path), target_(path) {
        if (path_.empty()) {
            refuse_file("\"\"", "an empty file name");
        }
        std::error_code error;
        const fs::file_status status = fs::status(target_, error);
        if (fs::exists(status)) {
            if (!fs::is_regular_file(status)) {
                refuse_file(path_, fs::is_directory(status) ? "a folder of that name"
                                                            : "something there that is no regular file");
            }
            // A link stays a link: the file that it points to is replaced.
            const fs::path real = fs::canonical(target_, error);
            if (!error) {
                target_ = real;
            }
        }
        static std::atomic<unsigned> counter{0};
        int descriptor = -1;
        do {
            const auto now = std::chrono::steady_clock::now().time_since_epoch().count();
            temporary_ = target_;
            temporary_ +=
                ".part-" + std::to_string(getpid()) + "-" + std::to_string(counter++) + "-" + std::to_string(now);
            descriptor = ::open(temporary_.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
        } while (descriptor < 0 && errno == EEXIST);
        if (descriptor < 0) {
            refuse_file(path_, reason_of(errno));
        }
        file_ = ::fdopen(descriptor, "wb");
        if (file_ == nullptr) {
            const int error_number = errno;
            ::close(descriptor);
            ::unlink(temporary_.c_str());
            refuse_file(path_, reason_of(error_number));
        }
    }
    ~WholeFile() {
        if (file_ != nullptr) {
            std::fclose(file_);
        }
        if (!done_) {
            ::unlink(temporary_.c_str());
        }
    }
    WholeFile(const WholeFile&) = delete;
    WholeFile& operator=(const WholeFile&) = delete;

    [[nodiscard]] std::FILE* stream() const { return file_; }
    [[noreturn]] void fail(const std::string& found) const { refuse_file(path_, found); }

    void finish() {
        std::FILE* file = std::exchange(file_, nullptr);
        const bool written = std::fflush(file) == 0 && std::ferror(file) == 0;
        const int write_error = errno;
        const bool closed = std::fclose(file) == 0;
        if (!written || !closed) {
            fail(reason_of(written ? errno : write_error));
        }
        if (std::rename(temporary_.c_str(), target_.c_str()) != 0) {
            fail(reason_of(errno));
        }
        done_ = true;
    }

  private:
    std::string path_;
    fs::path target_;
    fs::path temporary_;
    std::FILE* file_ = nullptr;
    bool done_ = false;
};

struct Picture {
    const float* values = nullptr;
    std::size_t width = 0;
    std::size_t height = 0;
    std::size_t channels = 0;
};

Picture picture_of(const Image& image) {
    const bool sized = image.size.width > 0 && image.size.height > 0;
    const auto width = static_cast<std::size_t>(sized ? image.size.width : 0);
    const auto height = static_cast<std::size_t>(sized ? image.size.height : 0);
    const std::size_t pixels = width * height;
    if (sized && image.scalar.empty() && image.rgba.size() == 4 * pixels) {
        return {image.rgba.data(), width, height, 4};
    }
    if (sized && image.rgba.empty() && image.scalar.size() == pixels) {
        return {image.scalar.data(), width, height, 1};
    }
    throw InvalidInput(Complaint{"the picture cannot be written",
                                 "size " + std::to_string(image.size.width) + " x " +
                                     std::to_string(image.size.height) + ", " + text_of_count(image.rgba.size()) +
                                     " colour numbers and " + text_of_count(image.scalar.size()) + " scalars",
                                 "a size of at least 1 x 1, and either four colour numbers a pixel or one scalar", ""});
}

/// [0, 1] to 0..255, halves upwards; NaN is 0.
png_byte to_byte(double value) {
    return value > 0.0 ? static_cast<png_byte>(std::floor(255.0 * std::min(value, 1.0) + 0.5)) : png_byte{0};
}

void fill_row(const Picture& picture, double scale, std::size_t y, png_byte* row) {
    const float* from = picture.values + y * picture.width * picture.channels;
    if (picture.channels == 1) {
        for (std::size_t x = 0; x < picture.width; ++x) {
            row[x] = to_byte(static_cast<double>(from[x]) * scale);
        }
        return;
    }
    for (std::size_t x = 0; x < picture.width; ++x, from += 4, row += 4) {
        const double alpha = static_cast<double>(from[3]);
        for (int c = 0; c < 3; ++c) {
            row[c] = alpha > 0.0 ? to_byte(static_cast<double>(from[c]) / alpha) : png_byte{0};
        }
        row[3] = to_byte(alpha);
    }
}

/// Copy of libpng's error message, which survives its longjmp.
struct PngError {
    char text[128] = "";
};

void keep_error(png_structp png, png_const_charp message) {
    auto* error = static_cast<PngError*>(png_get_error_ptr(png));
    std::strncpy(error->text, message, sizeof(error->text) - 1);
    png_longjmp(png, 1);
}

void ignore_warning(png_structp /*png*/, png_const_charp /*message*/) {}

/// Nothing in here may need a destructor: libpng leaves it by longjmp.
bool write_png(std::FILE* file, const Picture& picture, double scale, png_byte* row, PngError* error) {
    png_structp png = png_create_write_struct(PNG_LIBPNG_VER_STRING, error, keep_error, ignore_warning);
    if (png == nullptr) {
        std::strncpy(error->text, "no memory for the encoder", sizeof(error->text) - 1);
        return false;
    }
    png_infop info = png_create_info_struct(png);
    if (info == nullptr) {
        std::strncpy(error->text, "no memory for the encoder", sizeof(error->text) - 1);
        png_destroy_write_struct(&png, nullptr);
        return false;
    }
    if (setjmp(png_jmpbuf(png)) != 0) {
        png_destroy_write_struct(&png, &info);
        return false;
    }
    png_init_io(png, file);
    png_set_user_limits(png, PNG_UINT_31_MAX, PNG_UINT_31_MAX);
    png_set_IHDR(png, info, static_cast<png_uint_32>(picture.width), static_cast<png_uint_32>(picture.height), 8,
                 picture.channels == 4 ? PNG_COLOR_TYPE_RGBA : PNG_COLOR_TYPE_GRAY, PNG_INTERLACE_NONE,
                 PNG_COMPRESSION_TYPE_DEFAULT, PNG_FILTER_TYPE_DEFAULT);
    png_write_info(png, info);
    for (std::size_t y = 0; y < picture.height; ++y) {
        fill_row(picture, scale, y, row);
        png_write_row(png, row);
    }
    png_write_end(png, info);
    png_destroy_write_struct(&png, &info);
    return true;
}

} // namespace

void save_png(const Image& image, const std::string& path) {
    const Picture picture = picture_of(image);
    double largest = 0.0;
    for (const float value : image.scalar) {
        if (std::isfinite(value)) {
            largest = std::max(largest, static_cast<double>(value));
        }
    }
    std::vector<png_byte> row(picture.width * picture.channels);
    WholeFile file(path);
    PngError error;
    errno = 0;
    if (!write_png(file.stream(), picture, largest > 0.0 ? 1.0 / largest : 1.0, row.data(), &error)) {
        file.fail(errno != 0 ? reason_of(errno) : std::string(error.text));
    }
    file.finish();
}

void save_pfm(const Image& image, const std::string& path) {
    const Picture picture = picture_of(image);
    const std::size_t written = picture.channels == 4 ? 3 : 1;
    std::vector<unsigned char> row(picture.width * written * 4);
    WholeFile file(path);
    // The scale -1 says little-endian.
    bool good = std::fprintf(file.stream(), "%s\n%zu %zu\n-1.0\n", written == 3 ? "PF" : "Pf", picture.width,
                             picture.height) > 0;
    for (std::size_t y = picture.height; good && y-- > 0;) {
        unsigned char* to = row.data();
        for (std::size_t x = 0; x < picture.width; ++x) {
            for (std::size_t c = 0; c < written; ++c) {
                std::uint32_t bits = 0;
                std::memcpy(&bits, picture.values + (y * picture.width + x) * picture.channels + c, 4);
                for (unsigned shift = 0; shift < 32; shift += 8) {
                    *to++ = static_cast<unsigned char>(bits >> shift & 0xFFU);
                }
            }
        }
        good = std::fwrite(row.data(), 1, row.size(), file.stream()) == row.size();
    }
    if (!good) {
        file.fail(reason_of(errno));
    }
    file.finish();
}

} // namespace sheetsplat

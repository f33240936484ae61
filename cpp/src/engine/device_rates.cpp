#include "device_rates.hpp"

#include <unistd.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <limits>
#include <locale>
#include <map>
#include <mutex>
#include <sstream>
#include <string>

#include "base/clock.hpp"
#include "sheetsplat/error.hpp"
#include "sheetsplat/renderer.hpp"

namespace sheetsplat {

namespace {

namespace fs = std::filesystem;

constexpr int edge = 48; ///< samples
constexpr int spheres = 4096;
constexpr Size size{192, 192};
constexpr int frames = 3; ///< of which the fastest counts; programs are compiled before
constexpr double most_apart = 1e-4;
/// A new one where what is measured, or the file, changes.
constexpr const char* version = "1";
constexpr double never = std::numeric_limits<double>::infinity();
/// No measurement takes so long, and no file of the cache is so large: others are passed over.
constexpr double longest_seconds = 1e4;
constexpr std::uintmax_t largest_bytes = 1 << 20;

/// Two shells around the middle of a cube.
std::shared_ptr<const Field> lattice() {
    std::vector<std::uint8_t> samples;
    for (int n = 0; n < edge * edge * edge; ++n) {
        const double at[3] = {static_cast<double>(n % edge), static_cast<double>(n / edge % edge),
                              static_cast<double>(n / (edge * edge))};
        double square = 0.0;
        for (const double along : at) {
            square += std::pow(2.0 * along / (edge - 1) - 1.0, 2.0);
        }
        samples.push_back(static_cast<std::uint8_t>(127.5 + 127.5 * std::cos(9.0 * std::sqrt(square))));
    }
    return std::make_shared<RegularField>(std::move(samples), std::array<std::size_t, 3>{edge, edge, edge});
}

std::shared_ptr<const Field> scattered() {
    EllipsoidArrays arrays;
    for (int n = 0; n < spheres; ++n) {
        // Places that fill a cube evenly: multiples of the powers of the plastic number.
        const auto part = [n](double step) { return std::fmod(0.5 + step * n, 1.0); };
        arrays.centers.emplace_back(part(0.8191725134), part(0.6710436067), part(0.5497004779));
        arrays.radii.push_back(0.06);
        arrays.values.push_back(part(0.6180339887));
    }
    return std::make_shared<EllipsoidField>(std::move(arrays));
}

Scene scene_of(std::shared_ptr<const Field> field, double largest) {
    Scene scene{
        {std::move(field)},
        TransferFunction(
            {{0.0, {0.1, 0.2, 0.8}, 0.0}, {0.4 * largest, {0.2, 0.8, 0.4}, 0.0}, {largest, {1.0, 0.7, 0.3}, 0.4}})};
    scene.lights = {Light{}};
    return scene;
}

/// Seconds of a frame; the picture in `image`.
double timed(const RendererOptions& options, const Scene& scene, Image& image) {
    const Box box = scene.fields.front()->supports_world();
    const Camera camera = Camera::fit(box, Vec3(-1.0, -0.7, -1.6), Vec3(0.0, 1.0, 0.0));
    Renderer renderer(options);
    double best = never;
    for (int frame = 0; frame <= frames; ++frame) {
        const auto started = Clock::now();
        image = renderer.render(scene, camera, size);
        if (frame > 0) {
            best = std::min(best, seconds_since(started));
        }
    }
    return best;
}

std::array<double, DeviceRates::ways> measured(const Scene& scene, std::optional<int> device) {
    std::array<double, DeviceRates::ways> seconds{};
    Image expected;
    RendererOptions options;
    options.backend = Backend::cpu;
    seconds[DeviceRates::processor] = timed(options, scene, expected);
    options.backend = Backend::gl;
    options.device = device;
    for (const Path path : {Path::raster, Path::compute}) {
        options.path = path;
        double& found = seconds[path == Path::raster ? DeviceRates::raster : DeviceRates::compute];
        try {
            Image image;
            found = timed(options, scene, image);
            if (compare(image.rgba, expected.rgba, 4).rmse > most_apart) {
                found = never;
            }
        } catch (const Error&) {
            found = never;
        }
    }
    return seconds;
}

DeviceRates measure(std::optional<int> device) {
    return {true, measured(scene_of(lattice(), 255.0), device), measured(scene_of(scattered(), 1.0), device)};
}

/// Empty where there is no such folder.
fs::path cache_file() {
    // A relative path is none: XDG Base Directory Specification.
    const char* cache = std::getenv("XDG_CACHE_HOME");
    if (cache != nullptr && fs::path(cache).is_absolute()) {
        return fs::path(cache) / "sheetsplat" / "device-rates.txt";
    }
    const char* home = std::getenv("HOME");
    return home == nullptr || *home == '\0' ? fs::path() : fs::path(home) / ".cache/sheetsplat/device-rates.txt";
}

/// A line a device: its name, a tab, the seconds of the ways for a lattice, then those for scattered kernels.
std::map<std::string, std::string> read_lines(const fs::path& file) {
    std::map<std::string, std::string> lines;
    // Reading a pipe would wait, and a device may have no end.
    std::error_code failed;
    if (!fs::is_regular_file(file, failed) || fs::file_size(file, failed) > largest_bytes) {
        return lines;
    }
    std::ifstream stream(file);
    std::string line;
    while (lines.size() < 1000 && std::getline(stream, line)) {
        const std::size_t tab = line.find('\t');
        if (tab != std::string::npos) {
            lines[line.substr(0, tab)] = line.substr(tab + 1);
        }
    }
    return lines;
}

std::optional<DeviceRates> parsed(const std::string& text) {
    std::istringstream numbers(text);
    numbers.imbue(std::locale::classic());
    DeviceRates rates;
    rates.known = true;
    for (auto* seconds : {&rates.lattice, &rates.scattered}) {
        for (double& one : *seconds) {
            std::string word;
            if (!(numbers >> word)) {
                return std::nullopt;
            }
            std::istringstream number(word);
            number.imbue(std::locale::classic());
            const bool may_fail = &one != &(*seconds)[DeviceRates::processor];
            if (word == "never" && may_fail) {
                one = never;
            } else if (!(number >> one) || !number.eof() || !(one > 0.0 && one < longest_seconds)) {
                return std::nullopt;
            }
        }
    }
    std::string more;
    return numbers >> more ? std::nullopt : std::optional(rates);
}

void keep(const fs::path& file, const std::string& name, const DeviceRates& rates) {
    std::map<std::string, std::string> lines = read_lines(file);
    std::ostringstream text;
    text.imbue(std::locale::classic());
    for (const auto& seconds : {rates.lattice, rates.scattered}) {
        for (const double one : seconds) {
            std::isfinite(one) ? text << one << ' ' : text << "never ";
        }
    }
    lines[name] = text.str();
    std::error_code failed;
    fs::create_directories(file.parent_path(), failed);
    // Each process writes a file of its own; the last one that is renamed stays.
    fs::path part = file;
    part += "." + std::to_string(getpid()) + ".part";
    std::ofstream stream(part);
    for (const auto& [device, numbers] : lines) {
        stream << device << '\t' << numbers << '\n';
    }
    stream.close();
    if (stream) {
        fs::rename(part, file, failed);
    }
    if (!stream || failed) {
        fs::remove(part, failed);
    }
}

} // namespace

DeviceRates measured_rates(const Capabilities& capabilities, std::optional<int> device) {
    static std::mutex& mutex = *new std::mutex;
    static std::map<std::string, DeviceRates>& known = *new std::map<std::string, DeviceRates>;
    std::string name = std::string(version) + " " + capabilities.renderer + ", OpenGL " + capabilities.version;
    std::replace(name.begin(), name.end(), '\t', ' ');
    std::replace(name.begin(), name.end(), '\n', ' ');
    // Another thread waits: what it measured at the same time would be wrong.
    const std::lock_guard<std::mutex> lock(mutex);
    const auto found = known.find(name);
    if (found != known.end()) {
        return found->second;
    }
    const fs::path file = cache_file();
    std::optional<DeviceRates> rates;
    if (!file.empty()) {
        const std::map<std::string, std::string> lines = read_lines(file);
        const auto line = lines.find(name);
        rates = line != lines.end() ? parsed(line->second) : std::nullopt;
    }
    if (!rates) {
        rates = measure(device);
        if (!file.empty()) {
            keep(file, name, *rates);
        }
    }
    return known.emplace(name, *rates).first->second;
}

} // namespace sheetsplat

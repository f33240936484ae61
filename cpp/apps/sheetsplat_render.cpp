// sheetsplat_render: a raw or a generated volume, or generated ellipsoids, become a picture. It uses the public headers
// alone, and shows how. Exit codes: 0 done, 1 failed, 2 wrong usage.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <exception>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <limits>
#include <locale>
#include <memory>
#include <new>
#include <optional>
#include <sstream>
#include <string>
#include <system_error>
#include <utility>
#include <vector>

#include <CLI/CLI.hpp>
#include <glm/geometric.hpp>
#include <glm/gtc/quaternion.hpp>

#include "sheetsplat/camera.hpp"
#include "sheetsplat/error.hpp"
#include "sheetsplat/field.hpp"
#include "sheetsplat/image.hpp"
#include "sheetsplat/renderer.hpp"
#include "sheetsplat/scene.hpp"
#include "sheetsplat/transfer_function.hpp"

namespace {

namespace ss = sheetsplat;

constexpr double pi = 3.14159265358979323846;

enum class Generated { ball, marschner_lobb, ellipsoids };

struct Options {
    std::string raw;
    std::array<std::uint64_t, 3> shape{}; ///< samples along x, y, z
    std::string type = "uint8";
    std::optional<Generated> generated;
    std::size_t samples = 64;
    std::size_t kernels = 3000;
    std::array<double, 3> spacing{1.0, 1.0, 1.0};

    std::vector<ss::TransferPoint> points;
    std::optional<std::array<double, 2>> limits;
    ss::Mode mode = ss::Mode::composite;
    ss::Sampling sampling = ss::Sampling::point;
    std::optional<double> iso_value;
    std::optional<double> slice_spacing;
    double opacity_stop = ss::default_opacity_stop;
    bool shading = true;
    bool preintegration = false;
    std::optional<std::array<double, 3>> background;

    ss::Projection projection = ss::Projection::orthographic;
    double azimuth = 25.0;
    double elevation = 20.0;
    double zoom = 1.0;
    double fov_y = 30.0;

    std::array<int, 2> size{400, 400};
    ss::Backend backend = ss::Backend::automatic;
    int threads = 0;
    std::optional<double> max_error;
    std::optional<double> max_seconds;
    std::string output;
};

ss::Vec3 vector_of(const std::array<double, 3>& values) { return {values[0], values[1], values[2]}; }

/// "value r g b opacity" as one point. Throws CLI::ValidationError where it is not five numbers.
ss::TransferPoint parse_point(const std::string& text) {
    std::istringstream stream(text);
    stream.imbue(std::locale::classic());
    ss::TransferPoint point;
    std::string rest;
    stream >> point.value >> point.color.x >> point.color.y >> point.color.z >> point.opacity;
    if (stream.fail() || stream >> rest) {
        throw CLI::ValidationError("--tf", "'" + text + "' is not five numbers: value red green blue opacity");
    }
    return point;
}

/// Width and height of "300", "300x200", or of two texts. Throws CLI::ValidationError where they are not one or two
/// whole numbers of at least 1.
std::array<int, 2> parse_size(const std::vector<std::string>& texts) {
    std::string joined;
    for (const std::string& text : texts) {
        joined += (joined.empty() ? "" : "x") + text;
    }
    const CLI::ValidationError wrong("--size", "'" + joined +
                                                   "' is neither one nor two whole numbers from 1 to 2147483647, "
                                                   "WIDTHxHEIGHT, WIDTH HEIGHT, or one for both");
    std::vector<int> sizes;
    for (const std::string& part : CLI::detail::split(joined, 'x')) {
        int pixels = 0;
        const bool digits = !part.empty() && part.find_first_not_of("0123456789") == std::string::npos;
        if (!digits || !CLI::detail::lexical_cast(part, pixels) || pixels < 1) {
            throw wrong;
        }
        sizes.push_back(pixels);
    }
    if (sizes.size() > 2) {
        throw wrong;
    }
    return {sizes.front(), sizes.back()};
}

/// count samples of a headerless file in the byte order of this machine. The file's size is known to fit.
template <typename T>
ss::SampleArray read_samples(const std::string& path, std::size_t count) {
    std::vector<T> samples(count);
    std::ifstream file(path, std::ios::binary);
    file.read(reinterpret_cast<char*>(samples.data()), static_cast<std::streamsize>(count * sizeof(T)));
    if (!file) {
        throw ss::Error(ss::Complaint{path + ": could not be read", "the file ended or failed before its last sample",
                                      "a file that can be read to its end", "check the file and its permissions"});
    }
    return samples;
}

struct SampleType {
    const char* name;
    std::size_t bytes;
    ss::SampleArray (*read)(const std::string& path, std::size_t count);
};
constexpr std::array<SampleType, 5> sample_types{{{"uint8", 1, read_samples<std::uint8_t>},
                                                  {"int16", 2, read_samples<std::int16_t>},
                                                  {"uint16", 2, read_samples<std::uint16_t>},
                                                  {"float32", 4, read_samples<float>},
                                                  {"float64", 8, read_samples<double>}}};

/// Throws InvalidInput where the file is not exactly as long as shape and type say; takes memory only after that.
std::shared_ptr<const ss::RegularField> read_raw(const Options& options) {
    const std::string failed = options.raw + ": the volume cannot be read";
    const SampleType& type = *std::find_if(sample_types.begin(), sample_types.end(),
                                           [&](const SampleType& each) { return options.type == each.name; });
    const std::string shape_text = std::to_string(options.shape[0]) + " x " + std::to_string(options.shape[1]) + " x " +
                                   std::to_string(options.shape[2]) + " samples of " + std::to_string(type.bytes) +
                                   " bytes";
    std::uint64_t bytes = type.bytes;
    for (const std::uint64_t edge : options.shape) {
        if (edge == 0 || bytes > static_cast<std::uint64_t>(std::numeric_limits<std::streamsize>::max()) / edge) {
            throw ss::InvalidInput(
                ss::Complaint{failed, "a shape of " + shape_text,
                              "at least one sample along each axis, and a size that can be addressed",
                              "correct " + ss::option_ref("shape"), "shape"});
        }
        bytes *= edge;
    }
    std::error_code error;
    const std::uintmax_t found = std::filesystem::file_size(options.raw, error);
    if (error) {
        throw ss::InvalidInput(
            ss::Complaint{failed, error.message(), "a file that can be read", "check the path and its permissions"});
    }
    if (found != bytes) {
        throw ss::InvalidInput(ss::Complaint{
            failed, std::to_string(found) + " bytes", std::to_string(bytes) + " bytes for " + shape_text,
            "correct " + ss::option_ref("shape") + " or " + ss::option_ref("dtype") + ", or fetch the whole file"});
    }
    ss::SampleArray samples = type.read(options.raw, static_cast<std::size_t>(bytes) / type.bytes);
    ss::RegularFieldOptions field;
    field.spacing = vector_of(options.spacing);
    return std::make_shared<const ss::RegularField>(
        std::move(samples), std::array<std::size_t, 3>{options.shape[2], options.shape[1], options.shape[0]}, field);
}

/// A ball of radius 0.8 whose edge falls off over 0.3, in [-1, 1]^3; values 0 to 1.
double ball(double x, double y, double z) {
    const double inside = std::clamp((0.95 - std::sqrt(x * x + y * y + z * z)) / 0.3, 0.0, 1.0);
    return inside * inside * (3.0 - 2.0 * inside);
}

/// The test signal of Marschner & Lobb 1994 with their fM = 6 and alpha = 0.25; values 0 to 1.
double marschner_lobb(double x, double y, double z) {
    constexpr double frequency = 6.0;
    constexpr double alpha = 0.25;
    const double radial = std::cos(2.0 * pi * frequency * std::cos(0.5 * pi * std::sqrt(x * x + y * y)));
    return (1.0 - std::sin(0.5 * pi * z) + alpha * (1.0 + radial)) / (2.0 * (1.0 + alpha));
}

std::shared_ptr<const ss::RegularField> generate_volume(const Options& options) {
    const std::size_t n = options.samples;
    std::vector<float> samples;
    samples.reserve(n * n * n);
    const auto at = [n](std::size_t index) {
        return 2.0 * static_cast<double>(index) / static_cast<double>(n - 1) - 1.0;
    };
    for (std::size_t k = 0; k < n; ++k) {
        for (std::size_t j = 0; j < n; ++j) {
            for (std::size_t i = 0; i < n; ++i) {
                const double value = *options.generated == Generated::ball ? ball(at(i), at(j), at(k))
                                                                           : marschner_lobb(at(i), at(j), at(k));
                samples.push_back(static_cast<float>(value));
            }
        }
    }
    ss::RegularFieldOptions field;
    field.spacing = vector_of(options.spacing);
    return std::make_shared<const ss::RegularField>(std::move(samples), std::array<std::size_t, 3>{n, n, n}, field);
}

/// A point of the knot, a trefoil in a box of 6 x 6 x 2; turn: 0 to 2 pi.
ss::Vec3 knot(double turn) {
    const double out = 2.0 + std::cos(3.0 * turn);
    return {out * std::cos(2.0 * turn), out * std::sin(2.0 * turn), std::sin(3.0 * turn)};
}

/// Ellipsoids three times as long as thick that fill a tube around a trefoil knot and lie along it, placed by a
/// low-discrepancy sequence; values 0 to 1, twice along the knot. About 23 of them overlap at a point, so that the sum
/// of their weights is above 1 inside of the tube.
std::shared_ptr<const ss::EllipsoidField> generate_ellipsoids(const Options& options) {
    constexpr double tube = 0.35;
    constexpr double length = 31.9; // of the knot
    constexpr double aspect = 3.0;
    constexpr double overlaps = 23.0;
    constexpr double step = 1e-4;
    const auto count = static_cast<double>(options.kernels);
    const double thickness = std::cbrt(overlaps * tube * tube * length / count * 0.75 / aspect);
    const auto part = [](double value) { return value - std::floor(value); };
    ss::EllipsoidArrays arrays;
    for (std::size_t i = 0; i < options.kernels; ++i) {
        const auto at = static_cast<double>(i) + 0.5;
        // Powers of the inverse plastic number spread pairs evenly over a square (Roberts 2018).
        const double across = tube * std::sqrt(part(at * 0.7548776662466927));
        const double around = 2.0 * pi * part(at * 0.5698402909980532);
        const double turn = 2.0 * pi * at / count;
        const ss::Vec3 along = glm::normalize(knot(turn + step) - knot(turn - step));
        const ss::Vec3 side = glm::normalize(glm::cross(along, ss::Vec3(0.0, 0.0, 1.0)));
        const ss::Vec3 up = glm::cross(side, along);
        arrays.centers.push_back(knot(turn) + across * (std::cos(around) * side + std::sin(around) * up));
        arrays.scales.emplace_back(aspect * thickness, thickness, thickness);
        arrays.rotations.push_back(glm::normalize(glm::quat_cast(ss::Mat3(along, up, glm::cross(along, up)))));
        arrays.values.push_back(0.5 - 0.5 * std::cos(2.0 * turn));
    }
    return std::make_shared<const ss::EllipsoidField>(std::move(arrays));
}

std::shared_ptr<const ss::Field> make_field(const Options& options) {
    if (!options.generated) {
        return read_raw(options);
    }
    if (*options.generated == Generated::ellipsoids) {
        return generate_ellipsoids(options);
    }
    return generate_volume(options);
}

/// The points that were given, or a ramp from transparent blue to orange over the limits.
ss::TransferFunction make_transfer_function(const Options& options, const ss::Field& field) {
    if (!options.points.empty()) {
        return ss::TransferFunction(options.points);
    }
    const std::array<double, 2> limits = options.limits.value_or(field.value_range());
    const double lower = limits[0];
    // A constant field has no range to spread colours over.
    const double upper = !options.limits && limits[1] == lower ? lower + 1.0 : limits[1];
    const auto between = [&](double share) { return lower + share * (upper - lower); };
    return ss::TransferFunction({{lower, {0.10, 0.15, 0.45}, 0.0},
                                 {between(0.35), {0.15, 0.35, 0.75}, 0.0},
                                 {between(0.65), {0.85, 0.80, 0.65}, 0.08},
                                 {upper, {0.95, 0.50, 0.15}, 0.5}});
}

/// Azimuth turns the viewer about the y axis, elevation lifts it; at 0, 0 the camera looks along -z.
ss::Camera make_camera(const Options& options, const ss::Field& field) {
    const double azimuth = options.azimuth * pi / 180.0;
    const double elevation = options.elevation * pi / 180.0;
    const ss::Vec3 direction{-std::sin(azimuth) * std::cos(elevation), -std::sin(elevation),
                             -std::cos(azimuth) * std::cos(elevation)};
    // At right angles to the direction at every elevation, the poles included.
    const ss::Vec3 up{-std::sin(azimuth) * std::sin(elevation), std::cos(elevation),
                      -std::cos(azimuth) * std::sin(elevation)};
    const ss::Camera whole =
        ss::Camera::fit(field.supports_world(), direction, up, options.projection, 1.05, options.fov_y);
    if (options.projection == ss::Projection::orthographic) {
        return ss::Camera::orthographic(whole.eye(), whole.target(), up, whole.height() / options.zoom);
    }
    const double angle = 2.0 * std::atan(std::tan(options.fov_y * pi / 360.0) / options.zoom);
    return ss::Camera::perspective(whole.eye(), whole.target(), up, angle * 180.0 / pi);
}

ss::Scene make_scene(const Options& options, std::shared_ptr<const ss::Field> field) {
    ss::Scene scene{{field}, make_transfer_function(options, *field)};
    scene.mode = options.mode;
    scene.sampling = options.sampling;
    scene.slice_spacing = options.slice_spacing;
    scene.opacity_stop = options.opacity_stop;
    scene.preintegration = options.preintegration;
    if (options.iso_value) {
        scene.iso_values = {*options.iso_value};
    }
    if (ss::traits_of(options.mode).fold == ss::Fold::surfaces && !options.iso_value) {
        const std::array<double, 2> range = options.limits.value_or(field->value_range());
        scene.iso_values = {0.5 * (range[0] + range[1])};
    }
    const bool has_colour = ss::traits_of(options.mode).fold < ss::Fold::sum;
    if (options.shading && has_colour) {
        scene.lights.push_back({{0.4, 0.5, 1.0}, {1.0, 1.0, 1.0}, ss::LightSpace::eye});
        scene.material = {0.25, 0.75, 0.25, 32.0, true};
    }
    if (options.background && has_colour) {
        scene.background = vector_of(*options.background);
    }
    return scene;
}

bool ends_with(const std::string& text, const std::string& end) {
    return text.size() > end.size() && text.compare(text.size() - end.size(), end.size(), end) == 0;
}

void run(const Options& options) {
    const auto field = make_field(options);
    const ss::Scene scene = make_scene(options, field);
    const ss::Camera camera = make_camera(options, *field);
    ss::RendererOptions renderer_options;
    renderer_options.backend = options.backend;
    renderer_options.threads = options.threads;
    renderer_options.max_error = options.max_error;
    renderer_options.max_seconds = options.max_seconds;
    ss::Renderer renderer(renderer_options);
    const ss::Image image = renderer.render(scene, camera, {options.size[0], options.size[1]});
    if (ends_with(options.output, ".png")) {
        ss::save_png(image, options.output);
    } else {
        ss::save_pfm(image, options.output);
    }
    std::cout << options.output << ": " << image.size.width << " x " << image.size.height << " pixels";
    if (image.plan) {
        std::cout << ", " << image.plan->slices << " slices, backend " << ss::to_string(image.plan->backend);
    }
    if (image.settings) {
        std::cout << ", expected error " << image.stats.at("estimated_rmse");
        for (const char* goal : {"max_error", "max_seconds"}) {
            std::cout << (image.stats.at(goal + std::string("_kept")) == 0.0 ? std::string(", ") + goal + " not kept"
                                                                             : "");
        }
    }
    std::cout << '\n';
}

template <typename T>
CLI::Validator one_of(std::vector<std::pair<std::string, T>> names) {
    return CLI::CheckedTransformer(std::move(names), CLI::ignore_case).description("");
}

void declare(CLI::App& app, Options& options) {
    app.option_defaults()->group("Volume");
    auto* raw = app.add_option("--raw", options.raw, "headerless volume, x fastest, in this machine's byte order");
    auto* shape = app.add_option("--shape", options.shape, "samples along x, y, z, XxYxZ or X Y Z")->delimiter('x');
    app.add_option("--dtype", options.type, "uint8 | int16 | uint16 | float32 | float64")
        ->transform(CLI::IsMember({"uint8", "int16", "uint16", "float32", "float64"}, CLI::ignore_case).description(""))
        ->needs(raw);
    raw->needs(shape);
    shape->needs(raw);
    auto* generated = app.add_option("--generate", options.generated, "ball | marschner-lobb | ellipsoids")
                          ->transform(one_of<Generated>({{"ball", Generated::ball},
                                                         {"marschner-lobb", Generated::marschner_lobb},
                                                         {"ellipsoids", Generated::ellipsoids}}))
                          ->excludes(raw);
    app.add_option("--samples", options.samples, "of a generated volume, along each edge (64)")
        ->check(CLI::Range(2, 1024).description(""))
        ->needs(generated);
    app.add_option("--kernels", options.kernels, "how many generated ellipsoids (3000)")
        ->check(CLI::Range(1, 10'000'000).description(""))
        ->needs(generated);
    app.add_option("--spacing", options.spacing, "world units between samples, X Y Z (1 1 1)");

    app.option_defaults()->group("Classification");
    auto* points = app.add_option_function<std::vector<std::string>>(
        "--tf",
        [&options](const std::vector<std::string>& texts) {
            for (const std::string& text : texts) {
                options.points.push_back(parse_point(text));
            }
        },
        "a point of the transfer function, \"value red green blue opacity\"; repeated, values rising");
    points->expected(1)->take_all();
    app.add_option("--clim", options.limits, "values that the built-in transfer function spans (the volume's range)")
        ->excludes(points);
    std::vector<std::pair<std::string, ss::Mode>> modes;
    std::string names;
    for (const ss::ModeTraits& mode : ss::mode_table) {
        modes.emplace_back(mode.name, mode.mode);
        names += (names.empty() ? "" : " | ") + modes.back().first;
    }
    app.add_option("--mode", options.mode, names)->transform(one_of<ss::Mode>(std::move(modes)));
    app.add_option("--iso,--iso-value", options.iso_value, "value of the isosurface (the middle of the range)");
    app.add_option("--sampling", options.sampling, "point | slab")
        ->transform(one_of<ss::Sampling>({{"point", ss::Sampling::point}, {"slab", ss::Sampling::slab}}));
    app.add_option("--slice-spacing", options.slice_spacing,
                   "world units between slices (the smallest spacing; of ellipsoids half their median thickness)");
    app.add_option("--opacity-stop", options.opacity_stop, "opacity at which a pixel is done; 1: never (0.98)");
    app.add_flag("--shading,!--no-shading", options.shading, "light the volume (on)");
    app.add_flag("--preintegration", options.preintegration, "classify between slices, not on them");

    app.option_defaults()->group("Camera");
    app.add_option("--projection", options.projection, "orthographic | perspective")
        ->transform(one_of<ss::Projection>(
            {{"orthographic", ss::Projection::orthographic}, {"perspective", ss::Projection::perspective}}));
    app.add_option("--azimuth", options.azimuth, "degrees about the y axis (25)");
    app.add_option("--elevation", options.elevation, "degrees above the xz plane (20)");
    app.add_option("--zoom", options.zoom, "1 shows the whole volume")->check(CLI::PositiveNumber.description(""));
    app.add_option("--fov,--fov-y", options.fov_y, "vertical angle of the perspective camera in degrees (30)");

    app.option_defaults()->group("Picture");
    app.add_option_function<std::vector<std::string>>(
           "--size", [&options](const std::vector<std::string>& texts) { options.size = parse_size(texts); },
           "pixels, WIDTHxHEIGHT, WIDTH HEIGHT, or one number for both (400)")
        ->expected(1, 2);
    app.add_option("--background", options.background, "RED GREEN BLUE, 0 to 1 (transparent)");
    std::vector<std::pair<std::string, ss::Backend>> backends{{"auto", ss::Backend::automatic}};
    names = "auto";
    for (const ss::BackendTraits& backend : ss::backend_table) {
        backends.emplace_back(backend.name, backend.backend);
        names += " | " + backends.back().first;
    }
    app.add_option("--backend", options.backend, names)->transform(one_of<ss::Backend>(std::move(backends)));
    app.add_option("--threads", options.threads, "of backend cpu; 0: as many as the process may run on (0)")
        ->check(CLI::NonNegativeNumber.description(""));
    app.add_option("--max-error", options.max_error,
                   "root mean square error that the picture may have; chooses slices and classification");
    app.add_option("--max-seconds", options.max_seconds,
                   "how long drawing may take, about; chooses slices and classification");
    app.add_option("-o,--output", options.output, "the picture, .png or .pfm")
        ->required()
        ->check(CLI::Validator(
            [](const std::string& path) {
                return ends_with(path, ".png") || ends_with(path, ".pfm")
                           ? std::string()
                           : "'" + path + "' ends neither in .png nor in .pfm";
            },
            ""));
}

/// A reference to an option as this program spells it; without such an option, as C++ does.
std::string spelled(const CLI::App& app, const ss::OptionRef& option) {
    std::string name = "--" + option.name;
    std::replace(name.begin(), name.end(), '_', '-');
    const CLI::Option* known = app.get_option_no_throw(name);
    if (known == nullptr) {
        return ss::spelled_in_cpp(option);
    }
    const bool alone = option.value.empty() || option.value == "..." || known->get_items_expected_max() == 0;
    return alone ? known->get_name() : known->get_name() + " " + option.value;
}

/// Throws CLI::ValidationError for "--option=", which CLI11 would give the next word as its value.
void refuse_empty_values(int argc, char** argv) {
    for (int number = 1; number < argc; ++number) {
        const std::string word = argv[number];
        if (word.rfind("--", 0) == 0 && word.back() == '=') {
            throw CLI::ValidationError(word.substr(0, word.size() - 1), "there is no value after the equals sign");
        }
    }
}

/// Throws CLI::ValidationError for options that what is drawn does not use.
void refuse_unused(const CLI::App& app, const Options& options) {
    const bool scattered = options.generated == Generated::ellipsoids;
    for (const char* name : {"--samples", "--spacing"}) {
        if (scattered && app.count(name) > 0) {
            throw CLI::ValidationError(name, "not used by --generate ellipsoids; --kernels sets their number");
        }
    }
    if (!scattered && app.count("--kernels") > 0) {
        throw CLI::ValidationError("--kernels", "only used by --generate ellipsoids");
    }
}

} // namespace

int main(int argc, char** argv) {
    CLI::App app("Renders a regular volume or scattered ellipsoids by splatting them into image-aligned sheets.",
                 "sheetsplat_render");
    Options options;
    try {
        declare(app, options);
        refuse_empty_values(argc, argv);
        app.parse(argc, argv);
        if (options.raw.empty() && !options.generated) {
            throw CLI::RequiredError("--raw or --generate");
        }
        refuse_unused(app, options);
    } catch (const CLI::ParseError& error) {
        return app.exit(error) == 0 ? 0 : 2;
    }
    try {
        run(options);
    } catch (const std::bad_alloc&) {
        std::cerr << "sheetsplat_render: there is not enough memory for this volume and picture\n";
        return 1;
    } catch (const ss::Error& error) {
        const auto spelling = [&](const ss::OptionRef& option) { return spelled(app, option); };
        std::cerr << "sheetsplat_render: " << error.complaint().text(spelling) << '\n';
        return 1;
    } catch (const std::exception& error) {
        std::cerr << "sheetsplat_render: " << error.what() << '\n';
        return 1;
    }
    return 0;
}

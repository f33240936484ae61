#include "backend_gl/gl_renderer.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <ctime>
#include <limits>
#include <numeric>
#include <random>

#include "backend_gl/embedded_glsl.hpp"
#include "base/memory.hpp"
#include "classification.hpp"
#include "gl/context.hpp"
#include "interop.h"
#include "preshaded.hpp"
#include "resources.hpp"
#include "shader_variants.hpp"
#include "sheetsplat/error.hpp"
#include "tile_loop.hpp"

namespace sheetsplat::backend_gl {

namespace {

using Clock = std::chrono::steady_clock;

double seconds_since(Clock::time_point start) { return std::chrono::duration<double>(Clock::now() - start).count(); }

/// Tiles of at most `edge` pixels that cover a picture, as equal as they can be.
std::vector<Tile> tiles_of(Size size, int edge) {
    std::vector<Tile> tiles;
    const auto cut = [&](int length) {
        const int count = (length + edge - 1) / edge;
        std::vector<int> starts;
        for (int n = 0; n <= count; ++n) {
            starts.push_back(static_cast<int>(static_cast<std::int64_t>(length) * n / count));
        }
        return starts;
    };
    const std::vector<int> columns = cut(size.width);
    const std::vector<int> rows = cut(size.height);
    for (std::size_t row = 0; row + 1 < rows.size(); ++row) {
        for (std::size_t column = 0; column + 1 < columns.size(); ++column) {
            tiles.push_back(
                {columns[column], rows[row], columns[column + 1] - columns[column], rows[row + 1] - rows[row]});
        }
    }
    return tiles;
}

void copy_rows(const std::vector<float>& from, const Tile& tile, Size size, std::size_t channels,
               std::vector<float>& to) {
    const auto width = static_cast<std::size_t>(tile.width) * channels;
    for (int y = 0; y < tile.height; ++y) {
        const auto source = from.begin() + static_cast<std::ptrdiff_t>(static_cast<std::size_t>(y) * width);
        const std::size_t target = (static_cast<std::size_t>(tile.y + y) * static_cast<std::size_t>(size.width) +
                                    static_cast<std::size_t>(tile.x)) *
                                   channels;
        std::copy(source, source + static_cast<std::ptrdiff_t>(width),
                  to.begin() + static_cast<std::ptrdiff_t>(target));
    }
}

} // namespace

struct GlRenderer::State {
    std::unique_ptr<gl::Context> context;
    std::unique_ptr<Resources> resources;
};

GlRenderer::GlRenderer(std::optional<int> egl_device) : state_(std::make_unique<State>()) {
    gl::ContextOptions options;
    options.egl_device = egl_device;
    state_->context = gl::Context::create(options);
}

GlRenderer::~GlRenderer() {
    if (state_->resources) {
        try {
            const gl::Current current(*state_->context);
            state_->resources.reset();
        } catch (const std::exception&) {
            // A context that cannot be made current any more takes its objects with it.
            static_cast<void>(state_->resources.release());
        }
    }
}

const Capabilities& GlRenderer::capabilities() const { return state_->context->capabilities(); }

void GlRenderer::render(const Job& job, Image& image) {
    const gl::Current current(*state_->context);
    const gl::Api& gl = state_->context->api();
    const Capabilities& capabilities = state_->context->capabilities();
    if (!state_->resources) {
        state_->resources = std::make_unique<Resources>(gl, capabilities);
    }
    const DrawPlan& plan = *job.plan;
    const Size size = job.frame->size;
    const bool scalar = plan.mode == Mode::xray || plan.mode == Mode::mip;
    const auto pixels = static_cast<std::size_t>(size.width) * static_cast<std::size_t>(size.height);
    const auto started = Clock::now();

    Classification classification;
    if (plan.mode == Mode::composite) {
        const std::vector<double> pivots = pivots_of(plan, *job.scene);
        classification = Classification(gl, job.scene->transfer_function, plan.value_unit,
                                        std::accumulate(pivots.begin(), pivots.end(), 0.0));
    }
    int edge = std::min(capabilities.max_texture_size, capabilities.max_viewport) - 2 * Tile::border;
    // A viewport that is widened for sprites must fit too.
    edge = std::min(edge, 4096);
    if (job.tile_size > 0) {
        edge = std::min(edge, job.tile_size);
    }
    const std::vector<Tile> tiles = tiles_of(size, edge);

    if (scalar) {
        image.scalar.assign(pixels, 0.0F);
    } else {
        image.rgba.assign(pixels * 4, 0.0F);
    }
    if (plan.coverage) {
        image.coverage.assign(pixels, 0.0F);
    }
    if (plan.depth) {
        image.depth.assign(pixels, std::numeric_limits<float>::infinity());
    }
    if (plan.resident_sections) {
        std::vector<const EllipsoidField*> fields;
        for (const EllipsoidPart& part : job.ellipsoids) {
            fields.push_back(part.kernels.get());
        }
        state_->resources->section_pass().keep(fields);
        for (const EllipsoidPart& part : job.ellipsoids) {
            state_->resources->section_pass().slice(part.kernels, *part.view);
        }
    }
    if (plan.paper_slicing) {
        std::vector<const EllipsoidField*> fields;
        for (const EllipsoidPart& part : job.ellipsoids) {
            fields.push_back(part.kernels.get());
        }
        state_->resources->paper_slicing().keep(fields);
        for (const EllipsoidPart& part : job.ellipsoids) {
            state_->resources->paper_slicing().slice(*state_->resources, part.kernels, *part.view, *part.traversal);
        }
    }
    if (plan.gather) {
        state_->resources->gather().prepare(*job.ellipsoids.front().view, *job.ellipsoids.front().traversal);
    }
    if (plan.shadows || plan.ambient_occlusion) {
        state_->resources->light().upload(*job.volumes, plan.shadows, plan.ambient_occlusion,
                                          capabilities.max_buffer_texels);
    }
    // Reading the last picture back waited for all of its drawing.
    state_->resources->samples.rewind();
    state_->resources->records.rewind();
    state_->resources->rests.rewind();
    state_->resources->boxes.rewind();
    state_->resources->rectangles.rewind();
    std::size_t drawn = 0, dropped = 0, bytes = 0;
    std::uint64_t fragments = 0;
    double vertex_seconds = 0.0, read_seconds = 0.0;
    std::vector<float> buffer;
    for (std::size_t number = 0; number < tiles.size(); ++number) {
        const Tile& tile = tiles[number];
        const auto report = [&](double share) {
            if (job.progress != nullptr && *job.progress &&
                !(*job.progress)((static_cast<double>(number) + share) / static_cast<double>(tiles.size()))) {
                gl.Finish();
                throw Cancelled();
            }
        };
        const Targets* targets = nullptr;
        if (plan.preshaded) {
            targets = &state_->resources->targets(preshaded_shape(tile));
            drawn += draw_preshaded(job, gl, *state_->resources, *targets, tile, report);
        } else {
            TileLoop loop(job, gl, capabilities, *state_->resources,
                          plan.mode == Mode::composite ? &classification : nullptr, tile);
            loop.run(report);
            targets = &loop.targets();
            drawn += loop.drawn();
            dropped += loop.dropped();
            vertex_seconds += loop.vertex_seconds();
            fragments += loop.fragments();
        }
        bytes = std::max(bytes, targets->bytes());

        const auto reading = Clock::now();
        const auto tile_pixels = static_cast<std::size_t>(tile.width) * static_cast<std::size_t>(tile.height);
        const auto read = [&](int attachment, GLenum format, std::size_t channels, double scale,
                              std::vector<float>& to) {
            buffer.resize(tile_pixels * channels);
            targets->read(attachment, Tile::border, Tile::border, tile.width, tile.height, format, buffer.data());
            if (scale != 1.0) {
                for (float& value : buffer) {
                    value = static_cast<float>(static_cast<double>(value) * scale);
                }
            }
            copy_rows(buffer, tile, size, channels, to);
        };
        if (scalar) {
            read(0, GL_RED, 1, plan.mode == Mode::xray ? plan.value_unit * job.frame->slice_spacing : plan.value_unit,
                 image.scalar);
        } else {
            read(0, GL_RGBA, 4, 1.0, image.rgba);
        }
        int attachment = 1;
        if (plan.depth) {
            read(attachment++, GL_RED, 1, 1.0, image.depth);
        }
        if (plan.coverage) {
            read(attachment, GL_RED, 1, job.frame->slice_spacing, image.coverage);
        }
        read_seconds += seconds_since(reading);
    }
    gl::check_errors(gl, "drawing a picture");
    const std::vector<std::string> complaints = state_->context->take_debug_errors();
    if (!complaints.empty()) {
        throw Error(Complaint{"the picture may be wrong", "a report of the OpenGL driver: " + complaints.front(),
                              "none", "report this with the output of `sheetsplat devices`"});
    }
    image.stats["seconds_draw"] += seconds_since(started) - read_seconds;
    image.stats["seconds_vertices"] += vertex_seconds;
    image.stats["seconds_read"] += read_seconds;
    image.stats["splats"] += static_cast<double>(drawn);
    image.stats["kernels_hidden"] += static_cast<double>(dropped);
    if (plan.count_fragments) {
        image.stats["fragments"] += static_cast<double>(fragments);
    }
    image.stats["programs"] = static_cast<double>(state_->resources->programs());
    image.stats["programs_used"] = static_cast<double>(state_->resources->programs_used());
    image.stats["tiles"] = static_cast<double>(tiles.size());
    const SectionPass* sections = state_->resources->sections();
    image.stats["bytes_device"] =
        static_cast<double>(bytes + (sections != nullptr ? sections->bytes() : 0) + state_->resources->light_bytes() +
                            state_->resources->comparison_bytes());
}

Seconds GlRenderer::fill_test(std::size_t kernels, double diameter_px, int width, int height, int targets,
                              int repeats) {
    const gl::Current current(*state_->context);
    const gl::Api& gl = state_->context->api();
    std::vector<gl::Texture> textures;
    std::vector<const gl::Texture*> colors;
    std::vector<std::string> outputs;
    for (int target = 0; target < targets; ++target) {
        textures.emplace_back(gl, GL_RGBA32F, width, height);
        outputs.push_back("fill_" + std::to_string(target));
    }
    for (const gl::Texture& texture : textures) {
        colors.push_back(&texture);
    }
    const gl::Framebuffer framebuffer(gl, colors);
    const gl::Program program(gl, embedded_glsl(), "fill.vert", "fill.frag", {{"TARGETS", std::to_string(targets)}},
                              "#version 330 core", outputs);
    std::vector<float> positions;
    std::mt19937 random(1);
    std::uniform_real_distribution<float> spread(0.0F, 1.0F);
    for (std::size_t kernel = 0; kernel < kernels; ++kernel) {
        positions.push_back(spread(random) * 2.0F - 1.0F);
        positions.push_back(spread(random) * 2.0F - 1.0F);
    }
    gl::Buffer buffer(gl, GL_ARRAY_BUFFER);
    const gl::VertexArray array(gl);
    framebuffer.bind();
    gl.Viewport(0, 0, width, height);
    gl.Clear(GL_COLOR_BUFFER_BIT);
    gl.Enable(GL_BLEND);
    gl.BlendFunc(GL_ONE, GL_ONE);
    gl.Disable(GL_DEPTH_TEST);
    gl.Enable(GL_PROGRAM_POINT_SIZE);
    program.use();
    program.set("point_size", static_cast<float>(diameter_px));
    array.bind();
    buffer.upload(positions.data(), positions.size() * sizeof(float));
    gl.EnableVertexAttribArray(0);
    gl.VertexAttribPointer(0, 2, GL_FLOAT, GL_FALSE, 0, nullptr);
    // The first draw compiles the program.
    gl.DrawArrays(GL_POINTS, 0, 1);
    gl.Finish();
    std::vector<Seconds> times;
    for (int repeat = 0; repeat < repeats; ++repeat) {
        const auto started = Clock::now();
        const std::clock_t worked = std::clock();
        gl.DrawArrays(GL_POINTS, 0, static_cast<GLsizei>(kernels));
        gl.Finish();
        times.push_back({seconds_since(started), static_cast<double>(std::clock() - worked) / CLOCKS_PER_SEC});
    }
    gl::check_errors(gl, "the fill test");
    std::sort(times.begin(), times.end(), [](const Seconds& a, const Seconds& b) { return a.cpu < b.cpu; });
    return times[times.size() / 2];
}

std::vector<DeviceReport> survey() {
    std::vector<DeviceReport> reports;
    for (const gl::Attempt& attempt : gl::Context::survey()) {
        DeviceReport report;
        report.backend = "gl";
        report.platform = attempt.platform;
        report.available = attempt.succeeded;
        report.description = attempt.succeeded
                                 ? attempt.capabilities.renderer + ", OpenGL " + attempt.capabilities.version
                                 : attempt.story;
        report.extensions = attempt.capabilities.extensions;
        report.workarounds = attempt.capabilities.workarounds;
        reports.push_back(std::move(report));
    }
    return reports;
}

std::map<std::string, std::string> shader_sources(const DrawPlan& plan, const Scene& scene) {
    std::map<std::string, std::string> sources;
    const std::string version = "#version 330 core";
    FieldView plain;
    const gl::Defines splat = splat_defines(plan, plain, {-1, plan.weight, false, false});
    const gl::Defines shade = shade_defines(plan, scene.lights.size(), 0);
    sources["splat.vert"] = gl::preprocess(embedded_glsl(), "splat.vert", version, splat).text;
    sources["splat.frag"] = gl::preprocess(embedded_glsl(), "splat.frag", version, splat).text;
    sources["shade.frag"] = gl::preprocess(embedded_glsl(), "shade.frag", version, shade).text;
    return sources;
}

} // namespace sheetsplat::backend_gl

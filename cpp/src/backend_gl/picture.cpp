#include "picture.hpp"

#include <algorithm>
#include <limits>

#include "base/clock.hpp"
#include "base/poll.hpp"
#include "compute_tiles.hpp"
#include "scene/mode_rules.hpp"
#include "shader_variants.hpp"
#include "sheetsplat/error.hpp"
#include "tile_loop.hpp"

namespace sheetsplat::backend_gl {

namespace {

/// Largest edge of a tile, pixels: a viewport that is widened for sprites must fit too.
constexpr int most_pixels = 4096;

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

Picture::Picture(const Job& job, gl::Context& context, Resources& resources, SliceLoopHooks& hooks, Image& image)
    : job_(job), plan_(*job.plan), context_(context), resources_(resources), hooks_(hooks), image_(image) {}

void Picture::draw() {
    const auto started = Clock::now();
    const Size size = job_.frame->size;
    const auto pixels = static_cast<std::size_t>(size.width) * static_cast<std::size_t>(size.height);
    if (is_scalar()) {
        image_.scalar.assign(pixels, 0.0F);
    } else {
        image_.rgba.assign(pixels * 4, 0.0F);
    }
    if (plan_.coverage) {
        image_.coverage.assign(pixels, 0.0F);
    }
    if (plan_.counts) {
        image_.counts.assign(pixels, 0.0F);
    }
    if (plan_.depth) {
        image_.depth.assign(pixels, std::numeric_limits<float>::infinity());
    }
    if (job_.doubts != nullptr) {
        job_.doubts->assign(pixels, 0.0F);
    }
    upload();
    const Capabilities& capabilities = context_.capabilities();
    int edge = std::min(
        {capabilities.max_texture_size - 2 * Tile::border, capabilities.max_viewport - 2 * Tile::border, most_pixels});
    if (job_.tile_size > 0) {
        edge = std::min(edge, job_.tile_size);
    }
    const std::vector<Tile> tiles = tiles_of(size, edge);
    std::size_t bytes = 0;
    double read_seconds = 0.0;
    for (std::size_t number = 0; number < tiles.size(); ++number) {
        const Targets& targets = draw_tile(tiles[number], number, tiles.size());
        bytes = std::max(bytes, targets.bytes());
        const auto reading = Clock::now();
        read(targets, tiles[number]);
        read_seconds += seconds_since(reading);
    }
    gl::check_errors(context_.api(), "drawing a picture");
    const std::vector<std::string> complaints = context_.take_debug_errors();
    if (!complaints.empty()) {
        throw Error(Complaint{"the picture may be wrong", "a report of the OpenGL driver: " + complaints.front(),
                              "none", "report this with the output of `sheetsplat devices`"});
    }
    auto& stats = image_.stats;
    stats["seconds_draw"] += seconds_since(started) - read_seconds;
    stats["seconds_vertices"] += vertex_seconds_;
    stats["seconds_read"] += read_seconds;
    stats["splats"] += static_cast<double>(drawn_);
    stats["passes_shaded"] += static_cast<double>(shaded_);
    stats["kernels_hidden"] += static_cast<double>(dropped_);
    stats["programs"] = static_cast<double>(resources_.programs());
    stats["programs_used"] = static_cast<double>(resources_.programs_used());
    stats["tiles"] = static_cast<double>(tiles.size());
    stats["bytes_device"] = static_cast<double>(bytes + resources_.bytes());
}

bool Picture::classifies() const { return is_composited(plan_.mode) || shaded_parts(*job_.scene).serving; }

void Picture::upload() {
    if (classifies()) {
        const std::vector<double> pivots = group_pivots(plan_, *job_.scene);
        std::vector<Classification::Part> parts;
        for (const Group& group : groups_drawn(*job_.scene)) {
            parts.push_back({group.transfer_function, plan_.unit_of(group.first), pivots[parts.size()]});
        }
        classification_ = Classification(context_.api(), parts);
    }
    std::vector<const EllipsoidField*> fields;
    for (const EllipsoidPart& part : job_.ellipsoids) {
        fields.push_back(part.kernels.get());
    }
    if (plan_.resident_sections && !plan_.compute) {
        resources_.section_pass().keep(fields);
        const std::vector<Counting> counting = counting_of(plan_, *job_.scene);
        for (const EllipsoidPart& part : job_.ellipsoids) {
            resources_.section_pass().slice(part.kernels, *part.view, counting[part.field]);
        }
    }
    if (plan_.paper_slicing) {
        resources_.paper_slicing().keep(fields);
        for (const EllipsoidPart& part : job_.ellipsoids) {
            resources_.paper_slicing().slice(resources_, part.kernels, *part.view, *part.traversal);
        }
    }
    if (plan_.shadows || plan_.ambient_occlusion) {
        resources_.light().upload(*job_.volumes, plan_.shadows, plan_.ambient_occlusion,
                                  context_.capabilities().max_buffer_texels);
    }
    // Reading the last picture back waited for all of its drawing.
    resources_.rewind();
}

const Targets& Picture::draw_tile(const Tile& tile, std::size_t number, std::size_t tiles) {
    const auto report = [&](double share) {
        try {
            report_progress(job_.progress != nullptr ? *job_.progress : Progress(),
                            (static_cast<double>(number) + share) / static_cast<double>(tiles));
        } catch (const Cancelled&) {
            context_.api().Finish();
            throw;
        }
    };
    if (const Targets* targets = hooks_.draw_tile(job_, tile, report, drawn_)) {
        return *targets;
    }
    const TileScope scope(job_, context_.api(), context_.capabilities(), resources_, hooks_, tile);
    if (plan_.compute) {
        ComputeTiles computed(scope, classifies() ? &classification_ : nullptr);
        computed.run(report);
        drawn_ += computed.drawn();
        image_.stats["shared_bytes"] = computed.shared_bytes();
        image_.stats["threads_a_group"] = computed.threads();
        if (hooks_.counts_work()) {
            image_.stats["sections"] += static_cast<double>(computed.counts()[0]);
            image_.stats["samples_read"] += static_cast<double>(computed.counts()[1]);
            image_.stats["barriers"] += static_cast<double>(computed.counts()[2]);
        }
        return scope.targets;
    }
    TileLoop loop(scope, classifies() ? &classification_ : nullptr);
    loop.run(report);
    drawn_ += loop.splatting().drawn;
    shaded_ += loop.shaded();
    dropped_ += loop.splatting().dropped;
    vertex_seconds_ += loop.splatting().vertex_seconds;
    return scope.targets;
}

void Picture::read(const Targets& targets, const Tile& tile) {
    const double distance = job_.frame->slice_spacing;
    if (is_scalar()) {
        const double scale = scalar_unit(plan_.mode, plan_.value_unit, distance);
        if (counts_weighted_slices(plan_.mode)) {
            read_counted(targets, tile, scale);
        } else {
            read_channels(targets, tile, 0, 1, scale, image_.scalar);
        }
    } else {
        read_channels(targets, tile, 0, 4, 1.0, image_.rgba);
    }
    int attachment = 1;
    if (plan_.depth) {
        read_channels(targets, tile, attachment++, 1, 1.0, image_.depth);
    }
    if (plan_.coverage) {
        read_channels(targets, tile, attachment++, 1, distance, image_.coverage);
    }
    if (job_.doubts != nullptr && targets.shape().doubts) {
        read_channels(targets, tile, attachment + (plan_.compensated ? 1 : 0), 1, 1.0, *job_.doubts);
    }
}

void Picture::read_counted(const Targets& targets, const Tile& tile, double scale) {
    const auto pixels = static_cast<std::size_t>(tile.width) * static_cast<std::size_t>(tile.height);
    std::vector<float> sums(4 * pixels);
    targets.read(0, Tile::border, Tile::border, tile.width, tile.height, GL_RGBA, sums.data());
    buffer_.resize(pixels);
    const bool mean = traits_of(plan_.mode).mean;
    for (std::size_t pixel = 0; pixel < pixels; ++pixel) {
        const auto count = static_cast<double>(sums[4 * pixel + (mean ? 2 : 1)]);
        const double number = static_cast<double>(sums[4 * pixel]) * scale / (mean ? count : 1.0);
        buffer_[pixel] = count > 0.0 ? static_cast<float>(number) : std::numeric_limits<float>::quiet_NaN();
    }
    copy_rows(buffer_, tile, job_.frame->size, 1, image_.scalar);
    if (plan_.counts) {
        for (std::size_t pixel = 0; pixel < pixels; ++pixel) {
            buffer_[pixel] = sums[4 * pixel + 2];
        }
        copy_rows(buffer_, tile, job_.frame->size, 1, image_.counts);
    }
}

void Picture::read_channels(const Targets& targets, const Tile& tile, int attachment, std::size_t channels,
                            double scale, std::vector<float>& to) {
    buffer_.resize(static_cast<std::size_t>(tile.width) * static_cast<std::size_t>(tile.height) * channels);
    targets.read(attachment, Tile::border, Tile::border, tile.width, tile.height, channels == 4 ? GL_RGBA : GL_RED,
                 buffer_.data());
    if (scale != 1.0) {
        for (float& value : buffer_) {
            value = static_cast<float>(static_cast<double>(value) * scale);
        }
    }
    copy_rows(buffer_, tile, job_.frame->size, channels, to);
}

} // namespace sheetsplat::backend_gl

#include "probe.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>

#include "backend_cpu/measured.hpp"
#include "backend_cpu/tile_feed.hpp"
#include "base/spread.hpp"
#include "plan/limits_common.hpp"
#include "plan/make_plan.hpp"

namespace sheetsplat {

namespace {

/// Edge of a spread tile, pixels, and how many of a picture's tiles are taken.
constexpr int excerpt_edge = 16;
constexpr std::size_t least_tiles = 32, most_tiles = 64, tiles_of_picture = 16;

/// Factors that are measured where errors fall faster than at fourth order, or more slowly than at half, are chance.
constexpr double least_factor = 0.0625, largest_factor = 0.7071;

/// Calls visit(element of a picture, how many) for each row of a tile.
template <class Visit>
void for_each_row(const backend_cpu::TileShape& shape, Size size, const Visit& visit) {
    for (int y = shape.y; y < shape.y + shape.height; ++y) {
        visit(static_cast<std::size_t>(y) * static_cast<std::size_t>(size.width) + static_cast<std::size_t>(shape.x),
              static_cast<std::size_t>(shape.width));
    }
}

/// Means over the tiles that are drawn of numbers of pixels.
template <class Number>
std::vector<double> means_of_tiles(const std::vector<Number>& numbers, const backend_cpu::TileLayout& layout,
                                   Size size) {
    std::vector<double> means(layout.tiles(), 0.0);
    for (std::size_t tile = 0; tile < layout.tiles(); ++tile) {
        if (!layout.draws(tile)) {
            continue;
        }
        const backend_cpu::TileShape shape = layout.shape(tile);
        for_each_row(shape, size, [&](std::size_t from, std::size_t count) {
            const auto row = numbers.begin() + static_cast<std::ptrdiff_t>(from);
            means[tile] = std::accumulate(row, row + static_cast<std::ptrdiff_t>(count), means[tile]);
        });
        means[tile] /= shape.pixels();
    }
    return means;
}

} // namespace

Excerpt spread_tiles(Size size, bool checked) {
    const backend_cpu::TileLayout layout(size, excerpt_edge);
    const std::size_t all = layout.tiles();
    const std::size_t wanted = std::min(std::clamp(all / tiles_of_picture, least_tiles, most_tiles), all / 2);
    std::vector<std::uint8_t> passed(all, 0);
    Excerpt excerpt{excerpt_edge, std::vector<std::uint8_t>(all, 0), 0.0, 0};
    for (std::size_t number = 0, taken = 0; excerpt.tiles < (checked ? wanted / 2 : wanted); ++number) {
        const auto [column, row] = spread(number, {layout.columns(), layout.rows()});
        const std::size_t tile = static_cast<std::size_t>(row) * static_cast<std::size_t>(layout.columns()) +
                                 static_cast<std::size_t>(column);
        if (passed[tile] != 0) {
            continue;
        }
        passed[tile] = 1;
        if (!checked || taken >= wanted) {
            const backend_cpu::TileShape shape = layout.shape(tile);
            excerpt.drawn[tile] = 1;
            excerpt.pixels += shape.pixels();
            ++excerpt.tiles;
        }
        ++taken;
    }
    return excerpt;
}

Excerpt doubtful_tiles(const DrawPlan& plan, Size size, const std::vector<float>& doubts, const Image& image) {
    const backend_cpu::TileLayout layout(size, backend_cpu::usual_tile);
    std::vector<double> errors(layout.tiles(), backend_cpu::error_of_extremes(plan, image.scalar, float32_epsilon));
    if (!doubts.empty()) {
        const std::vector<double> means = means_of_tiles(doubts, layout, size);
        std::transform(means.begin(), means.end(), errors.begin(), errors.begin(), [&plan](double mean, double error) {
            return error + plan.lit_rounding * float32_epsilon * std::sqrt(mean);
        });
    }
    Excerpt excerpt{backend_cpu::usual_tile, backend_cpu::doubtful_tiles(layout, errors, plan.bound)};
    for (std::size_t tile = 0; tile < layout.tiles(); ++tile) {
        excerpt.pixels += excerpt.drawn[tile] != 0 ? layout.shape(tile).pixels() : 0.0;
        excerpt.tiles += excerpt.drawn[tile];
    }
    return excerpt;
}

void copy_tiles(const Image& from, const Excerpt& excerpt, Size size, Image& to) {
    const backend_cpu::TileLayout layout(size, excerpt.edge, excerpt.drawn);
    for (std::size_t tile = 0; tile < layout.tiles(); ++tile) {
        if (!layout.draws(tile)) {
            continue;
        }
        for_each_row(layout.shape(tile), size, [&](std::size_t first, std::size_t count) {
            const auto copy = [&](const std::vector<float>& source, std::vector<float>& target, std::size_t channels) {
                if (!target.empty()) {
                    const auto begin = source.begin() + static_cast<std::ptrdiff_t>(first * channels);
                    std::copy(begin, begin + static_cast<std::ptrdiff_t>(count * channels),
                              target.begin() + static_cast<std::ptrdiff_t>(first * channels));
                }
            };
            copy(from.rgba, to.rgba, 4);
            copy(from.scalar, to.scalar, 1);
            copy(from.coverage, to.coverage, 1);
            copy(from.depth, to.depth, 1);
        });
    }
}

RendererOptions exact_options(const RendererOptions& options) {
    RendererOptions exact;
    exact.backend = backend_that(Ability::exact);
    exact.precision = Precision::float64;
    exact.allow_inexact = true;
    exact.threads = options.threads;
    return exact;
}

Scene with_settings(const Scene& scene, const Settings& settings) {
    Scene changed = scene;
    changed.reference_length = scene.reference_distance();
    changed.slice_spacing = settings.slice_spacing;
    changed.sampling = settings.sampling;
    changed.preintegration = settings.preintegration;
    changed.second_order = settings.second_order;
    changed.opacity_stop = settings.opacity_stop;
    return changed;
}

const std::vector<float>& channels_of(const Image& image) { return image.rgba.empty() ? image.scalar : image.rgba; }

double scale_of(const Image& reference) {
    float largest = 1.0F;
    for (const float value : reference.scalar) {
        largest = std::isfinite(value) ? std::max(largest, std::abs(value)) : largest;
    }
    return static_cast<double>(largest);
}

double root_of_mean(const std::vector<double>& values) {
    return values.empty()
               ? 0.0
               : std::sqrt(std::accumulate(values.begin(), values.end(), 0.0) / static_cast<double>(values.size()));
}

std::vector<double> squares(const Image& picture, const Image& reference, double scale) {
    const std::vector<float>& first = channels_of(picture);
    const std::vector<float>& second = channels_of(reference);
    const std::size_t channels = picture.rgba.empty() ? 1 : 4;
    std::vector<double> result(first.size() / channels, 0.0);
    for (std::size_t i = 0; i < first.size(); ++i) {
        const double difference = (static_cast<double>(first[i]) - static_cast<double>(second[i])) / scale;
        result[i / channels] += std::isnan(difference) ? 0.0 : difference * difference / static_cast<double>(channels);
    }
    return result;
}

double Approach::share() const { return std::sqrt(1.0 + factor * factor - 2.0 * factor * alike); }

Approach approach(const Image& coarse, const Image& middle, const Image& fine) {
    const std::vector<float>&first = channels_of(coarse), &second = channels_of(middle), &third = channels_of(fine);
    double both = 0.0, before = 0.0, after = 0.0;
    for (std::size_t i = 0; i < first.size(); ++i) {
        const double step = static_cast<double>(second[i]) - static_cast<double>(first[i]);
        const double next = static_cast<double>(third[i]) - static_cast<double>(second[i]);
        if (std::isfinite(step) && std::isfinite(next)) {
            both += step * next;
            before += step * step;
            after += next * next;
        }
    }
    if (!(before > 0.0 && after > 0.0)) {
        return {};
    }
    Approach found;
    found.factor = std::clamp(std::sqrt(after / before), least_factor, largest_factor);
    // Errors e of pictures 0, 1 and 2 are in proportion to 1, q and q^2, with q the factor, and c^n alike n pictures
    // apart. The correlation of e0 - e1 and e1 - e2 is then (c s - c^2 - 1) / (s - 2 c) with s = q + 1/q.
    const double steps = both / std::sqrt(before * after), s = found.factor + 1.0 / found.factor;
    const double root = std::sqrt(std::max(0.0, s * s + 4.0 * steps * steps - 4.0));
    found.alike = std::clamp(0.5 * (s + 2.0 * steps - root), 0.0, 1.0);
    return found;
}

double distance(const Image& picture, const Image& reference, const Excerpt* excerpt) {
    const std::vector<double> off = squares(picture, reference, scale_of(reference));
    if (excerpt == nullptr) {
        return root_of_mean(off);
    }
    const std::vector<double> own =
        means_of_tiles(off, backend_cpu::TileLayout(picture.size, excerpt->edge, excerpt->drawn), picture.size);
    const auto tiles = static_cast<double>(excerpt->tiles), all = static_cast<double>(own.size());
    const double mean = std::accumulate(own.begin(), own.end(), 0.0) / tiles;
    const double variance =
        std::max(0.0, std::inner_product(own.begin(), own.end(), own.begin(), 0.0) / tiles - mean * mean) /
        std::max(tiles - 1.0, 1.0) * (1.0 - tiles / all); // (drawn without putting back)
    return std::sqrt(mean + std::sqrt(variance));
}

} // namespace sheetsplat

// Distances between pictures. Source: conventions, section 8.
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>

#include "base/checks.hpp"
#include "sheetsplat/error.hpp"
#include "sheetsplat/image.hpp"

namespace sheetsplat {
namespace {

double distance(float a, float b, Gaps gaps) {
    const bool either = std::isnan(a) || std::isnan(b), both = std::isnan(a) && std::isnan(b);
    if (a == b || both || (either && gaps == Gaps::left_out)) {
        return 0.0;
    }
    const double difference = std::abs(static_cast<double>(a) - static_cast<double>(b));
    return std::isnan(difference) ? std::numeric_limits<double>::infinity() : difference;
}

/// What scalars are divided by. Infinite values (depth where nothing is) say nothing about the scale.
double scale_of(const std::vector<float>& reference) {
    double scale = 1.0;
    for (const float value : reference) {
        if (std::isfinite(value)) {
            scale = std::max(scale, std::abs(static_cast<double>(value)));
        }
    }
    return scale;
}

} // namespace

Difference compare(const std::vector<float>& picture, const std::vector<float>& reference, int channels, Gaps gaps) {
    if (channels != 1 && channels != 4) {
        throw InvalidInput(Complaint{"compare: the pictures cannot be compared", std::to_string(channels) + " channels",
                                     "4 (colour) or 1 (scalar)", ""});
    }
    if (picture.size() != reference.size()) {
        throw InvalidInput(
            Complaint{"compare: the pictures cannot be compared",
                      text_of_count(picture.size()) + " numbers against " + text_of_count(reference.size()),
                      "pictures of one size", "render both with the same size and mode"});
    }
    const auto per_pixel = static_cast<std::size_t>(channels);
    if (picture.size() % per_pixel != 0) {
        throw InvalidInput(Complaint{"compare: the pictures cannot be compared",
                                     text_of_count(picture.size()) + " numbers",
                                     "a multiple of " + std::to_string(channels), ""});
    }
    Difference result;
    if (picture.empty()) {
        return result;
    }
    const double scale = channels == 1 ? scale_of(reference) : 1.0;
    const std::size_t pixels = picture.size() / per_pixel;
    std::vector<double> largest(pixels, 0.0);
    double squares = 0.0;
    for (std::size_t p = 0; p < pixels; ++p) {
        for (std::size_t c = 0; c < per_pixel; ++c) {
            const double d = distance(picture[p * per_pixel + c], reference[p * per_pixel + c], gaps) / scale;
            squares += d * d;
            largest[p] = std::max(largest[p], d);
        }
    }
    result.rmse = std::sqrt(squares / static_cast<double>(picture.size()));
    result.maximum = *std::max_element(largest.begin(), largest.end());
    // Nearest rank: the smallest value that at least 99.9 % of the pixels do not exceed; in whole numbers, so that
    // nothing is rounded.
    const std::size_t rank = pixels - pixels / 1000;
    const auto nth = largest.begin() + static_cast<std::ptrdiff_t>(rank - 1);
    std::nth_element(largest.begin(), nth, largest.end());
    result.p99_9 = *nth;
    return result;
}

} // namespace sheetsplat

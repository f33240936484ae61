#include "sheetsplat/light_probe.hpp"

#include <algorithm>
#include <cmath>

#include <glm/geometric.hpp>

#include "base/spread.hpp"

namespace sheetsplat {

namespace {

/// Pixels that show something and are looked at: errors of surfaces are large at the few pixels where an edge of a
/// shadow has moved, those of volumes spread over all.
constexpr std::size_t surface_probes = 2048, volume_probes = 256;
/// Pixels that are tried for them, where fewer show something; of a picture of so few, all are. (What shows at one
/// pixel in a hundred has its error at a few of those.)
constexpr std::size_t surface_tries = 16384, volume_tries = 8192;
/// Occlusion is looked at in every so many of them: it costs 14 lines, and changes slowly. (Of small pictures, in
/// all: few lines of few pixels are off.)
constexpr std::size_t every_occlusion = 4;
/// Pixels between two looks at whether there are enough.
constexpr std::size_t batch = 512;
/// Points of a pixel that are looked at on the average, of all that show something: lines to lights are what takes
/// time. More in pictures of few pixels.
constexpr double points_of_pixel = 8.0;
/// What is stated over what was measured: other pixels may be worse than those that were looked at.
constexpr double reserve = 1.25;

/// Hands out a step for every step that is passed, the first one after a part of it; what is a step or more is itself.
class Steps {
  public:
    Steps(double step, double chance) : step_(step), passed_(step * chance) {}
    double take(double share) {
        if (share >= step_) {
            return share;
        }
        passed_ += share;
        const double taken = passed_ < step_ ? 0.0 : step_;
        passed_ -= taken;
        return taken;
    }

  private:
    double step_, passed_;
};

/// Calls visit(first, last) for each run of spots of one pixel.
template <class Spots, class Visit>
void for_each_pixel(Spots& spots, const Visit& visit) {
    for (auto first = spots.begin(); first != spots.end();) {
        const auto last = std::find_if(
            first, spots.end(), [number = first->number](const LightSpot& spot) { return spot.number != number; });
        visit(first, last);
        first = last;
    }
}

/// The sum of squares of numbers of which two independent estimates are known. Their products have no share of what
/// each is off by chance, but their sum may be small by chance; a quarter of the squares of their means, which have
/// such a share, is the least that is stated.
class SquareSum {
  public:
    void add(const Vec3& one, const Vec3& other) {
        const Vec3 mean = 0.5 * (one + other);
        products_ += glm::dot(one, other);
        squares_ += glm::dot(mean, mean);
    }
    [[nodiscard]] double value() const { return std::max(products_, 0.25 * squares_); }

  private:
    double products_ = 0.0, squares_ = 0.0;
};

} // namespace

ProbePixels probe_pixels(Size size, bool surfaces) {
    const std::size_t pixels = static_cast<std::size_t>(size.width) * static_cast<std::size_t>(size.height);
    const std::size_t wanted = surfaces ? surface_probes : volume_probes;
    const double fewer = static_cast<double>(wanted) / static_cast<double>(pixels);
    ProbePixels probes;
    probes.batch = batch;
    probes.points = points_of_pixel * std::max(1.0, fewer * fewer);
    if (pixels <= wanted) {
        probes.wanted = pixels + 1;
        for (int row = 0; row < size.height; ++row) {
            for (int column = 0; column < size.width; ++column) {
                probes.pixels.push_back({column, row});
            }
        }
        return probes;
    }
    probes.wanted = wanted;
    probes.every_occlusion = every_occlusion;
    const std::size_t tries = std::min(surfaces ? surface_tries : volume_tries, pixels);
    std::vector<bool> tried(pixels, false);
    const auto add = [&](const std::array<int, 2>& pixel) {
        const std::size_t at = static_cast<std::size_t>(pixel[1]) * static_cast<std::size_t>(size.width) +
                               static_cast<std::size_t>(pixel[0]);
        if (!tried[at]) {
            tried[at] = true;
            probes.pixels.push_back(pixel);
        }
    };
    for (std::size_t number = 0; number < tries; ++number) {
        add(spread(number, size));
    }
    // The places so far leave out some pixels of a small picture, and meet others twice.
    for (int row = 0; row < size.height && pixels == tries; ++row) {
        for (int column = 0; column < size.width; ++column) {
            add({column, row});
        }
    }
    return probes;
}

std::vector<LightSpot> thinned(const std::vector<LightSpot>& spots, std::size_t most) {
    std::vector<LightSpot> kept;
    for_each_pixel(spots, [&](auto first, auto last) {
        if (static_cast<std::size_t>(last - first) <= most) {
            kept.insert(kept.end(), first, last);
            return;
        }
        double all = 0.0, taken = 0.0;
        std::for_each(first, last, [&all](const LightSpot& spot) { all += spot.share; });
        Steps steps(all / static_cast<double>(most), 0.5 * (first->chances[0] + first->chances[1]));
        const std::size_t start = kept.size();
        for (; first != last; ++first) {
            const double share = steps.take(first->share);
            if (share > 0.0) {
                kept.push_back(*first);
                kept.back().share = share;
                taken += share;
            }
        }
        for (std::size_t at = start; at < kept.size(); ++at) {
            kept[at].share *= all / taken;
        }
    });
    return kept;
}

std::vector<LightSpot> choose_spots(std::vector<LightSpot> spots, double points, double opacity_stop,
                                    std::size_t every) {
    std::stable_sort(spots.begin(), spots.end(), [](const LightSpot& a, const LightSpot& b) {
        const double front = static_cast<double>(a.slice) + a.behind, back = static_cast<double>(b.slice) + b.behind;
        return a.number != b.number ? a.number < b.number : front < back;
    });
    std::vector<LightSpot> chosen;
    for_each_pixel(spots, [&](auto first, auto last) {
        // What the parts in front leave of a part's shares; and of all the stop.
        double left = 1.0, alpha = 0.0, own = 0.0;
        for (auto spot = first; spot != last; ++spot) {
            if (spot != first && spot->part != (spot - 1)->part) {
                left *= 1.0 - own;
                own = 0.0;
            }
            own += spot->share;
            spot->share = alpha < opacity_stop ? left * spot->share : 0.0;
            alpha += spot->share;
        }
        const double step = 2.0 * alpha / points;
        Steps one(step, first->chances[0]), other(step, first->chances[1]);
        for (; first != last; ++first) {
            first->stands_for = {one.take(first->share), other.take(first->share)};
            if (first->stands_for[0] > 0.0 || first->stands_for[1] > 0.0) {
                first->occlusion = first->number % every == 0;
                chosen.push_back(*first);
            }
        }
    });
    return chosen;
}

LightErrors light_errors(const std::vector<LightSpot>& chosen, const LightLines& lines, std::size_t tried,
                         std::size_t every) {
    if (chosen.empty()) {
        return {};
    }
    const std::size_t around = lines.directions - lines.lights, shown_each = lines.shown.size() / chosen.size();
    const auto left_of = [&lines](double left) { return lines.absorbed ? std::exp2(-left) : left; };
    SquareSum shadows, occlusion, shadows_beside, together;
    for_each_pixel(chosen, [&](auto first, auto last) {
        const bool beside = first->number % every == 0;
        std::array<Vec3, 2> darker{Vec3(0.0), Vec3(0.0)}, closer = darker;
        for (; first != last; ++first) {
            const auto at = static_cast<std::size_t>(first - chosen.begin());
            const double* left = &lines.left[at * lines.directions];
            const double* shown = &lines.shown[at * shown_each];
            const auto too_bright = [&shown](double true_one) {
                const Vec3 bright = Vec3(shown[0], shown[1], shown[2]) * (shown[3] - true_one);
                shown += 4;
                return bright;
            };
            Vec3 of_lights(0.0), of_surroundings(0.0);
            for (std::size_t light = 0; light < lines.lights; ++light) {
                of_lights += too_bright(left_of(left[light]));
            }
            if (around > 0 && first->occlusion) {
                double open = 0.0;
                for (std::size_t direction = lines.lights; direction < lines.directions; ++direction) {
                    open += left_of(left[direction]);
                }
                of_surroundings = too_bright(open / static_cast<double>(around));
            }
            for (std::size_t half = 0; half < 2; ++half) {
                darker[half] += first->stands_for[half] * of_lights;
                closer[half] += first->stands_for[half] * of_surroundings;
            }
        }
        shadows.add(darker[0], darker[1]);
        if (beside) {
            occlusion.add(closer[0], closer[1]);
            shadows_beside.add(darker[0], darker[1]);
            together.add(darker[0] + closer[0], darker[1] + closer[1]);
        }
    });
    // Where both are too bright at the same points their errors add up, and so must the squares of what is stated.
    const double apart = shadows_beside.value() + occlusion.value();
    const double more = apart > 0.0 ? std::max(1.0, std::sqrt(together.value() / apart)) : 1.0;
    // Of four channels, of which opacity is right.
    const double channels = 4.0 * static_cast<double>(std::max<std::size_t>(tried, 1));
    return {reserve * more * std::sqrt(shadows.value() / channels),
            reserve * more * std::sqrt(occlusion.value() * static_cast<double>(every) / channels)};
}

} // namespace sheetsplat

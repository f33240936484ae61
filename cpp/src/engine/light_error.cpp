#include "light_error.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <utility>

#include <glm/common.hpp>
#include <glm/geometric.hpp>

#include "backend_choice.hpp"
#include "base/poll.hpp"
#include "base/threads.hpp"
#include "light_at_points.hpp"
#include "light_grids.hpp"
#include "plan/charge_effects.hpp"
#include "plan/effect_table.hpp"
#include "plan/make_plan.hpp"
#include "reference/classify.hpp"
#include "reference/screen.hpp"
#include "scene/mode_rules.hpp"
#include "spread.hpp"
#include "view/kept_slices.hpp"

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
/// Kernels of which a grid is made for a picture that nobody asked the error of.
constexpr std::size_t most_scattered = 200'000;
/// Pixels between two looks at whether there are enough.
constexpr std::size_t batch = 512;
/// Points of a pixel that are looked at on the average, of all that show something: lines to lights are what takes
/// time. More in pictures of few pixels.
constexpr double points_of_pixel = 8.0;
/// Light that adds less than this to a pixel is passed over.
constexpr double least_share = 1e-4;
/// Slice distances over which differences stand for derivatives.
constexpr double little_step = 1e-3;

/// What numbers between 0 and 1 follow from a pixel and a half: alike on every machine, unlike for neighbours.
double chance(int column, int row, std::size_t half) {
    auto bits = static_cast<std::uint64_t>(column) * 0x9E3779B97F4A7C15ULL +
                static_cast<std::uint64_t>(row) * 0xC2B2AE3D27D4EB4FULL +
                static_cast<std::uint64_t>(half) * 0x165667B19E3779F9ULL;
    bits = (bits ^ (bits >> 30)) * 0xBF58476D1CE4E5B9ULL;
    bits = (bits ^ (bits >> 27)) * 0x94D049BB133111EBULL;
    return static_cast<double>((bits ^ (bits >> 31)) >> 11) * 0x1p-53;
}

/// Looks at the pixels of a picture.
class View {
  public:
    /// points: those of a pixel that are looked at, on the average.
    View(const Request& request, const Prepared& prepared, const LightAtPoints& light, double points)
        : scene_(request.scene), camera_(request.camera), frame_(prepared.frame), plan_(prepared.plan), light_(light),
          screen_(camera_, request.size), in_front_(plan_.depth_limit ? &*scene_.depth_limit : nullptr, frame_),
          points_(points), half_slab_(scene_.sampling == Sampling::slab ? 0.5 * frame_.slice_spacing : 0.0) {}

    /// What light is too bright, times what it adds to a pixel.
    struct Bright {
        Vec3 shadows{0.0}, occlusion{0.0};
    };
    /// What a pixel's colour is off, twice, each time from other points, which are chosen independently.
    struct Off {
        std::array<Bright, 2> halves;
        bool seen = false; ///< the pixel shows something
    };

    [[nodiscard]] Off look(int column, int row, bool occlusion) const {
        const Ray ray = ray_of(column, row);
        const std::vector<Spot> spots = spots_on(ray);
        Off off;
        off.seen = std::any_of(spots.begin(), spots.end(), [](const Spot& spot) { return spot.share > 0.0; });
        look_at_some(ray, spots, occlusion, off);
        return off;
    }

    /// What a pixel shows, from front to back.
    [[nodiscard]] std::vector<LightSpot> spots_at(int column, int row) const {
        std::vector<LightSpot> found;
        for (const Spot& spot : spots_on(ray_of(column, row))) {
            found.push_back({0,
                             spot.slice,
                             spot.behind,
                             spot.group,
                             spot.color,
                             spot.share,
                             {chance(column, row, 0), chance(column, row, 1)}});
        }
        return found;
    }

    /// Of a pixel's spot: where it is; and for each light, and for what is open around, what all of it adds and how
    /// much of it the picture shows.
    [[nodiscard]] Vec3 place_of(int column, int row, const LightSpot& spot) const {
        return ray_of(column, row).point(depth_of(spot_of(spot)));
    }
    void add_shown(int column, int row, const LightSpot& lit, double* shown) const {
        const Ray ray = ray_of(column, row);
        const Spot spot = spot_of(lit);
        const Vec3 world = ray.point(depth_of(spot));
        const std::vector<Vec3> most = plan_.shadows ? most_of_lights(ray, spot, 0.0) : std::vector<Vec3>{};
        const auto put = [&shown](const Vec3& adds, double drawn) {
            shown = std::copy_n(&adds.x, 3, shown);
            *shown++ = drawn;
        };
        for (std::size_t number = 0; number < most.size(); ++number) {
            put(most[number], light_.light_shown(number, world));
        }
        if (plan_.ambient_occlusion && lit.occlusion) {
            put(most_open(spot), light_.open_shown(world));
        }
    }

  private:
    struct Values {
        std::vector<PointValues::Value> groups; ///< none: empty in all
        bool looked_at = false;
        [[nodiscard]] double rho(std::size_t group) const { return groups.empty() ? 0.0 : groups[group].rho; }
        [[nodiscard]] bool empty(std::size_t group) const { return groups.empty() || groups[group].empty; }
    };
    /// The line of a pixel: the point at depth t is start + t along.
    struct Ray {
        int column = 0, row = 0;
        Vec3 start{0.0}, along{0.0};       ///< world
        std::int64_t first = 0, last = -1; ///< slices where it meets supports
        std::int64_t last_kept = 0;        ///< the last one in front of the depth limit
        [[nodiscard]] Vec3 point(double depth) const { return start + depth * along; }
    };
    /// What is shaded.
    struct Spot {
        std::int64_t slice = 0;
        double behind = 0.0; ///< how far it is on the way to the next slice, 0 ... 1
        std::size_t group = 0;
        Vec3 color{0.0};
        double share = 0.0; ///< of the pixel
    };

    [[nodiscard]] std::vector<Spot> spots_on(const Ray& ray) const {
        std::vector<Spot> spots;
        if (ray.first > ray.last) {
            return spots;
        }
        std::vector<Values> known(static_cast<std::size_t>(ray.last - ray.first + 1));
        const auto values = [&](std::int64_t n) -> const Values& {
            static const Values nothing;
            if (n < ray.first || n > ray.last) {
                return nothing;
            }
            Values& here = known[static_cast<std::size_t>(n - ray.first)];
            if (!here.looked_at) {
                here = values_at(ray, n);
            }
            return here;
        };
        const bool between = uses_intervals(scene_.mode, scene_.preintegration);
        double alpha = 0.0;
        const LightAtPoints::ClearLine line = light_.clear_line(ray.start, ray.along);
        for (std::int64_t n = ray.first - (between ? 1 : 0); n <= ray.last && alpha < scene_.opacity_stop; ++n) {
            if (!light_.holds(ray.point(frame_.depth_of(std::max<std::int64_t>(n, 0))))) {
                continue;
            }
            // Of the slice, or the interval behind it.
            const double front = frame_.depth_of(n) - half_slab_;
            const double back = frame_.depth_of(between ? n + 1 : n) + half_slab_;
            if (light_.surfaces()) {
                if (!light_.on_one_side(ray.point(front), ray.point(back))) {
                    add_crossings(ray, n, values, alpha, spots);
                }
            } else if (!light_.clear_at(line, front) || (front < back && !light_.clear_at(line, back))) {
                add_slice(ray, n, values, alpha, spots);
            }
        }
        return spots;
    }

    [[nodiscard]] static Spot spot_of(const LightSpot& spot) {
        return {spot.slice, spot.behind, spot.group, spot.color, spot.share};
    }
    [[nodiscard]] double depth_of(const Spot& spot) const {
        return frame_.depth_of(spot.slice) + spot.behind * frame_.slice_spacing;
    }

    [[nodiscard]] Vec3 to_world(const Vec3& eye) const {
        return camera_.eye() + eye.x * camera_.right_world() + eye.y * camera_.up_world() +
               eye.z * camera_.back_world();
    }

    [[nodiscard]] Ray ray_of(int column, int row) const {
        Ray ray;
        ray.column = column;
        ray.row = row;
        ray.last_kept = in_front_.last(column, row);
        ray.start = to_world(screen_.point(column, row, 0.0));
        ray.along = to_world(screen_.point(column, row, 1.0)) - ray.start;
        double from = frame_.depth_of(0), to = frame_.depth_of(frame_.slices - 1);
        for (int axis = 0; axis < 3; ++axis) {
            if (ray.along[axis] != 0.0) {
                const double a = (light_.box().lower[axis] - ray.start[axis]) / ray.along[axis];
                const double b = (light_.box().upper[axis] - ray.start[axis]) / ray.along[axis];
                from = std::max(from, std::min(a, b) - half_slab_);
                to = std::min(to, std::max(a, b) + half_slab_);
            } else if (ray.start[axis] < light_.box().lower[axis] || ray.start[axis] > light_.box().upper[axis]) {
                return ray;
            }
        }
        if (from <= to && frame_.slices > 0) {
            const auto slice = [&](double depth) { return (depth - frame_.first_depth) / frame_.slice_spacing; };
            ray.first = std::max<std::int64_t>(0, static_cast<std::int64_t>(std::ceil(slice(from) - 1e-9)));
            ray.last =
                std::min<std::int64_t>(frame_.slices - 1, static_cast<std::int64_t>(std::floor(slice(to) + 1e-9)));
        }
        return ray;
    }

    [[nodiscard]] Values values_at(const Ray& ray, std::int64_t n) const {
        Values values;
        values.looked_at = true;
        for (std::size_t group = 0; group < light_.groups().size(); ++group) {
            values.groups.push_back(light_.surfaces() && half_slab_ == 0.0
                                        ? light_.side_of(group, ray.point(frame_.depth_of(n)))
                                        : shown(group, ray.column, ray.row, frame_.depth_of(n)));
        }
        return values;
    }

    /// What a sheet shows at a pixel, or that much beside it: rho there, or of its slab.
    [[nodiscard]] PointValues::Value shown(std::size_t group, int column, int row, double depth,
                                           const Vec3& beside = Vec3(0.0)) const {
        const auto at = [&](double place) { return to_world(screen_.point(column, row, place) + beside); };
        return half_slab_ == 0.0 ? light_.value_at(group, at(depth))
                                 : light_.mean_between(group, at(depth - half_slab_), at(depth + half_slab_));
    }

    /// Whether a ray's point of a slice is kept.
    [[nodiscard]] bool keeps(const Ray& ray, std::int64_t n) const {
        return n <= ray.last_kept && light_.clip_keeps(ray.point(frame_.depth_of(n)));
    }

    template <class At>
    void add_crossings(const Ray& ray, std::int64_t n, const At& values, double& alpha,
                       std::vector<Spot>& spots) const {
        if ((frame_.cut_by_near && n < 0) || !keeps(ray, n) || !keeps(ray, n + 1)) {
            return;
        }
        struct Crossing {
            double share;
            std::size_t group;
            IsoValue iso;
        };
        std::vector<Crossing> crossings;
        for (std::size_t group = 0; group < light_.groups().size(); ++group) {
            const double rho = values(n).rho(group), behind = values(n + 1).rho(group);
            const auto inside = [&](std::int64_t slice) {
                return light_.inside_end(group, ray.point(frame_.depth_of(slice)));
            };
            if (light_.absorbed_below(group, rho) == light_.absorbed_below(group, behind) || !inside(n) ||
                !inside(n + 1)) {
                continue;
            }
            const double front = rho_on(ray, n, group), back = rho_on(ray, n + 1, group);
            for (const IsoValue& iso : iso_values_of(scene_, group)) {
                if ((front < iso.value) != (back < iso.value)) {
                    crossings.push_back({(iso.value - front) / (back - front), group, iso});
                }
            }
        }
        std::stable_sort(crossings.begin(), crossings.end(),
                         [](const Crossing& a, const Crossing& b) { return a.share < b.share; });
        for (const Crossing& crossing : crossings) {
            if (alpha >= scene_.opacity_stop) {
                return;
            }
            const double share = (1.0 - alpha) * crossing.iso.opacity;
            spots.push_back({n, crossing.share, crossing.group,
                             light_.groups()[crossing.group].transfer_function->at(crossing.iso.value).color, share});
            alpha += share;
        }
    }

    /// A slice, or the interval behind it.
    template <class At>
    void add_slice(const Ray& ray, std::int64_t n, const At& values, double& alpha, std::vector<Spot>& spots) const {
        const bool interval = scene_.preintegration;
        const bool here = keeps(ray, n);
        const bool behind = interval && keeps(ray, n + 1);
        const double lengths = light_.lengths() * screen_.secant(ray.column, ray.row);
        const std::size_t before = spots.size();
        double extinction = 0.0, weights = 0.0;
        for (std::size_t group = 0; group < light_.groups().size(); ++group) {
            if (!(here && !values(n).empty(group)) && !(behind && !values(n + 1).empty(group))) {
                continue;
            }
            const TransferFunction& function = *light_.groups()[group].transfer_function;
            Spot spot{n, interval ? 0.5 : 0.0, group, Vec3(0.0), 0.0};
            const double faded = scene_.gradient_opacity
                                     ? std::min(1.0, glm::length(gradient(ray, spot)) / *scene_.gradient_opacity)
                                     : 1.0;
            double own = 0.0, weight = 0.0;
            if (plan_.second_order) {
                const std::array<double, 4> rho{values(n - 1).rho(group), values(n).rho(group),
                                                values(n + 1).rho(group), values(n + 2).rho(group)};
                const reference::ColorOpacity looks =
                    reference::preintegrate_second_order(function, rho, lengths * faded);
                own = weight = reference::extinction_of(looks.opacity);
                spot.color = looks.color;
            } else if (interval) {
                const reference::ColorExtinction mean =
                    reference::mean_over_ramp(function, values(n).rho(group), values(n + 1).rho(group));
                own = weight = lengths * faded * mean.extinction;
                spot.color = mean.color;
            } else {
                const reference::ColorOpacity looks = reference::look_up(function, values(n).rho(group));
                weight = reference::extinction_of(faded * looks.opacity);
                own = lengths * weight;
                spot.color = looks.color;
            }
            spot.share = weight;
            if (own > 0.0) {
                extinction += own;
                weights += weight;
                spots.push_back(spot);
            }
        }
        const double share = (1.0 - alpha) * -std::expm1(-extinction);
        for (std::size_t added = before; added < spots.size(); ++added) {
            spots[added].share *= share / weights;
        }
        alpha += share;
    }

    /// The gradient as the picture has it (sections 4, 5, 7 and 10): between two slices it is mixed of theirs. Eye
    /// space.
    [[nodiscard]] Vec3 gradient(const Ray& ray, const Spot& spot) const {
        const Vec3 front = gradient_on(ray, spot.slice, spot.group);
        return spot.behind == 0.0
                   ? front
                   : (1.0 - spot.behind) * front + spot.behind * gradient_on(ray, spot.slice + 1, spot.group);
    }

    [[nodiscard]] Vec3 gradient_on(const Ray& ray, std::int64_t slice, std::size_t group) const {
        const bool exists = slice >= 0 && slice < frame_.slices;
        const double depth = frame_.depth_of(slice);
        if (plan_.analytic_gradient) {
            const double h = little_step * frame_.slice_spacing;
            Vec3 slope(0.0);
            for (int axis = 0; exists && axis < 3; ++axis) {
                Vec3 by(0.0);
                by[axis] = h;
                slope[axis] = (shown(group, ray.column, ray.row, depth, by).rho -
                               shown(group, ray.column, ray.row, depth, -by).rho) /
                              (2.0 * h);
            }
            return slope;
        }
        const auto rho = [&](int column, int row) { return shown(group, column, row, depth).rho; };
        double dx = 0.0, dy = 0.0;
        if (exists) {
            const double two_pixels = 2.0 * screen_.pixel_width(depth);
            dx = (rho(ray.column + 1, ray.row) - rho(ray.column - 1, ray.row)) / two_pixels;
            dy = (rho(ray.column, ray.row - 1) - rho(ray.column, ray.row + 1)) / two_pixels;
        }
        const double along =
            (rho_on(ray, slice + 1, group) - rho_on(ray, slice - 1, group)) / (2.0 * frame_.slice_spacing);
        return {dx, dy, screen_.slope_x(ray.column) * dx + screen_.slope_y(ray.row) * dy - along};
    }

    [[nodiscard]] Vec3 facing_away(const Vec3& gradient, std::size_t group) const {
        const double weakest = weakest_difference(scene_, light_.groups()[group]) / frame_.reference_length;
        return -gradient / std::max({glm::length(gradient), weakest, 1e-300});
    }

    /// Looks at points at equal steps of what all add together, in each half with a first step of its own. Those that
    /// add more than a step are in both halves.
    void look_at_some(const Ray& ray, const std::vector<Spot>& spots, bool occlusion, Off& off) const {
        double all = 0.0;
        for (const Spot& spot : spots) {
            all += spot.share;
        }
        const double step = 2.0 * all / points_;
        std::array<double, 2> passed{};
        for (std::size_t half = 0; half < passed.size(); ++half) {
            passed[half] = step * chance(ray.column, ray.row, half);
        }
        for (const Spot& spot : spots) {
            std::array<double, 2> shares{spot.share, spot.share};
            for (std::size_t half = 0; half < passed.size() && spot.share < step; ++half) {
                passed[half] += spot.share;
                shares[half] = passed[half] < step ? 0.0 : step;
                passed[half] -= shares[half];
            }
            const double most = std::max(shares[0], shares[1]);
            if (most > 0.0) {
                const Bright bright = bright_at(ray, spot, occlusion, least_share / most);
                for (std::size_t half = 0; half < shares.size(); ++half) {
                    off.halves[half].shadows += shares[half] * bright.shadows;
                    off.halves[half].occlusion += shares[half] * bright.occlusion;
                }
            }
        }
    }

    /// At a point that adds 1 to a pixel. least: lights that add less are passed over.
    [[nodiscard]] Bright bright_at(const Ray& ray, const Spot& spot, bool occlusion, double least) const {
        Bright bright;
        const Vec3 world = ray.point(depth_of(spot));
        if (plan_.shadows) {
            const std::vector<Vec3> most = most_of_lights(ray, spot, least);
            for (std::size_t number = 0; number < most.size(); ++number) {
                if (most[number] != Vec3(0.0)) {
                    bright.shadows += most[number] * light_.light_off(number, world);
                }
            }
        }
        if (plan_.ambient_occlusion && occlusion) {
            bright.occlusion = light_.open_off(world) * most_open(spot);
        }
        return bright;
    }

    /// What is left by the depth cue.
    [[nodiscard]] double cued(const Spot& spot) const {
        if (!scene_.depth_cue) {
            return 1.0;
        }
        const DepthCue& cue = *scene_.depth_cue;
        return 1.0 - cue.strength * std::clamp((depth_of(spot) - cue.start) / (cue.end - cue.start), 0.0, 1.0);
    }

    /// What all of each light adds at a point that adds 1 to a pixel; 0 of those that add less than `least`.
    [[nodiscard]] std::vector<Vec3> most_of_lights(const Ray& ray, const Spot& spot, double least) const {
        const Material& material = scene_.material;
        const double left = cued(spot);
        const Vec3 outward = facing_away(gradient(ray, spot), spot.group),
                   to_viewer = screen_.to_viewer(ray.column, ray.row);
        std::vector<Vec3> most;
        for (std::size_t number = 0; number < scene_.lights.size(); ++number) {
            const Vec3 direction = camera_.direction_to_eye(light_.to_light(number));
            const double towards = glm::dot(outward, direction);
            const double facing = material.two_sided ? std::abs(towards) : std::max(0.0, towards);
            if (left * facing < least) {
                most.emplace_back(0.0);
                continue;
            }
            const Vec3 mirrored = 2.0 * towards * outward - direction;
            const double highlight =
                std::pow(std::max(0.0, glm::dot(mirrored, to_viewer)), material.shininess) * material.specular;
            most.push_back(left * facing * scene_.lights[number].color *
                           (spot.color * material.diffuse + Vec3(highlight)));
        }
        return most;
    }

    /// The same of light from all around.
    [[nodiscard]] Vec3 most_open(const Spot& spot) const {
        const double ambient = scene_.lights.empty() ? 1.0 : scene_.material.ambient;
        return cued(spot) * ambient * scene_.ambient_occlusion->strength * spot.color;
    }

    /// rho where a pixel meets a slice; 0 beyond the slices.
    [[nodiscard]] double rho_on(const Ray& ray, std::int64_t slice, std::size_t group) const {
        const bool exists = slice >= 0 && slice < frame_.slices;
        return exists ? shown(group, ray.column, ray.row, frame_.depth_of(slice)).rho : 0.0;
    }

    const Scene& scene_;
    const Camera& camera_;
    const Frame& frame_;
    const DrawPlan& plan_;
    const LightAtPoints& light_;
    reference::Screen screen_;
    SlicesInFront in_front_;
    double points_;
    double half_slab_; ///< 0: sheets show rho at points
};

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

bool LightErrorProbe::is_cheap(const Request& request, const Prepared& prepared) {
    std::size_t kernels = 0;
    for (const auto& field : request.scene.fields) {
        kernels += as_regular(field.get()) != nullptr && !prepared.plan.filter ? 0 : field->size();
    }
    return kernels <= most_scattered;
}

LightAtPoints LightErrorProbe::light_at(const Request& request, const Prepared& prepared, const LightVolumes& volumes,
                                        const std::shared_ptr<const LightVolume>& absorption) {
    std::vector<Known> known;
    std::vector<std::shared_ptr<const PointValues>> values;
    for (const auto& field : request.scene.fields) {
        if (prepared.plan.filter) {
            values.push_back(filtered_values(field, request.scene, request.camera, request.size));
            continue;
        }
        const auto found =
            std::find_if(known_.begin(), known_.end(), [&](const Known& one) { return one.field == field; });
        known.push_back(found != known_.end() ? *found : Known{field, point_values(field, request.scene)});
        values.push_back(known.back().values);
    }
    known_ = std::move(known);

    const BlocksOf blocks = [this, &volumes](const LightVolume& volume) -> const LightBlocks& {
        std::shared_ptr<const LightVolume> owner;
        for (const auto& group : volumes.groups) {
            owner = group.get() == &volume ? group : owner;
        }
        blocks_.erase(
            std::remove_if(blocks_.begin(), blocks_.end(), [](const auto& entry) { return entry.first.expired(); }),
            blocks_.end());
        for (const auto& [of, found] : blocks_) {
            if (of.lock() == owner) {
                return *found;
            }
        }
        blocks_.emplace_back(owner, std::make_unique<const LightBlocks>(volume));
        return *blocks_.back().second;
    };
    const ClearOf clear = [this, &absorption]() -> const ClearCells& {
        if (clear_.first.lock() != absorption) {
            clear_ = {absorption, std::make_unique<const ClearCells>(*absorption)};
        }
        return *clear_.second;
    };
    return LightAtPoints(request, prepared, volumes, absorption.get(), blocks, clear, std::move(values));
}

std::vector<LightSpot> LightErrorProbe::spots(const Request& request, const Prepared& prepared,
                                              const std::vector<std::size_t>& numbers) {
    const LightAtPoints light = light_at(request, prepared, *request.scene.part->light, nullptr);
    const ProbePixels probes = probe_pixels(request.size, light.surfaces());
    const View view(request, prepared, light, probes.points);
    std::vector<std::vector<LightSpot>> found(numbers.size());
    ThreadPool pool(thread_count(request.options.threads));
    pool.run(
        numbers.size(),
        [&](std::size_t task, int) {
            const std::size_t number = numbers[task];
            const auto [column, row] = probes.pixels.at(number);
            found[task] = view.spots_at(column, row);
            for (LightSpot& spot : found[task]) {
                spot.number = number;
                spot.occlusion = prepared.plan.ambient_occlusion && number % probes.every_occlusion == 0;
            }
        },
        [&] { report_progress(request.progress, 0.0); });
    std::vector<LightSpot> all;
    for (const std::vector<LightSpot>& one : found) {
        all.insert(all.end(), one.begin(), one.end());
    }
    return all;
}

LightLines LightErrorProbe::lines(const Request& request, const Prepared& prepared,
                                  const std::vector<LightSpot>& spots) {
    const LightAtPoints light = light_at(request, prepared, *request.scene.part->light, nullptr);
    const ProbePixels probes = probe_pixels(request.size, light.surfaces());
    const View view(request, prepared, light, probes.points);
    LightLines lines;
    lines.absorbed = light.surfaces();
    lines.lights = prepared.plan.shadows ? request.scene.lights.size() : 0;
    lines.directions = lines.lights + (prepared.plan.ambient_occlusion ? directions_around : 0);
    const std::size_t shown = 4 * (lines.lights + (prepared.plan.ambient_occlusion ? 1 : 0));
    lines.left.assign(spots.size() * lines.directions, lines.absorbed ? 0.0 : 1.0);
    lines.shown.assign(spots.size() * shown, 0.0);
    ThreadPool pool(thread_count(request.options.threads));
    pool.run(
        spots.size(),
        [&](std::size_t task, int) {
            const LightSpot& spot = spots[task];
            const auto [column, row] = probes.pixels.at(spot.number);
            const Vec3 world = view.place_of(column, row, spot);
            double* left = &lines.left[task * lines.directions];
            for (std::size_t number = 0; number < lines.directions; ++number) {
                if (number < lines.lights) {
                    left[number] = light.light_here(number, world);
                } else if (spot.occlusion) {
                    left[number] = light.open_here(number - lines.lights, world);
                }
            }
            if (spot.own) {
                view.add_shown(column, row, spot, &lines.shown[task * shown]);
            }
        },
        [&] { report_progress(request.progress, 0.0); });
    return lines;
}

LightErrors LightErrorProbe::errors(const Request& request, const Prepared& prepared, const LightVolumes& volumes,
                                    const std::shared_ptr<const LightVolume>& absorption) {
    const LightAtPoints light = light_at(request, prepared, volumes, absorption);
    // Where thin sheets of matter show, errors are at few pixels too.
    const ProbePixels probes =
        probe_pixels(request.size, shows_surfaces(request.scene.mode) || shows_narrowly(request.scene));
    const View view(request, prepared, light, probes.points);
    const std::size_t most = probes.pixels.size();
    std::size_t every = probes.every_occlusion;
    ThreadPool pool(thread_count(request.options.threads));
    std::vector<View::Off> found;
    std::size_t seen = 0;
    while (found.size() < most && seen < probes.wanted) {
        const std::size_t start = found.size();
        found.resize(std::min(most, start + probes.batch));
        pool.run(
            found.size() - start,
            [&](std::size_t task, int) {
                const std::size_t number = start + task;
                const auto [column, row] = probes.pixels[number];
                found[number] = view.look(column, row, number % every == 0);
            },
            [&] { report_progress(request.progress, 1.0); });
        seen += static_cast<std::size_t>(std::count_if(found.begin() + static_cast<std::ptrdiff_t>(start), found.end(),
                                                       [](const View::Off& off) { return off.seen; }));
    }
    if (prepared.plan.ambient_occlusion && every > 1 && seen <= probes.wanted / 2) {
        // Of few pixels that show anything, one in so many are too few to tell.
        every = 1;
        std::vector<std::size_t> left;
        for (std::size_t number = 0; number < found.size(); ++number) {
            if (found[number].seen && number % probes.every_occlusion != 0) {
                left.push_back(number);
            }
        }
        pool.run(
            left.size(),
            [&](std::size_t task, int) {
                const auto [column, row] = probes.pixels[left[task]];
                found[left[task]] = view.look(column, row, true);
            },
            [&] { report_progress(request.progress, 1.0); });
    }
    SquareSum shadows, occlusion, shadows_beside, together;
    for (std::size_t number = 0; number < found.size(); ++number) {
        const auto& [one, other] = found[number].halves;
        shadows.add(one.shadows, other.shadows);
        if (number % every == 0) {
            occlusion.add(one.occlusion, other.occlusion);
            shadows_beside.add(one.shadows, other.shadows);
            together.add(one.shadows + one.occlusion, other.shadows + other.occlusion);
        }
    }
    // Where both are too bright at the same points their errors add up, and so must the squares of what is stated.
    const double apart = shadows_beside.value() + occlusion.value();
    const double more = apart > 0.0 ? std::max(1.0, std::sqrt(together.value() / apart)) : 1.0;
    // Of four channels, of which opacity is right.
    const double channels = 4.0 * static_cast<double>(std::max<std::size_t>(found.size(), 1));
    return {light_reserve * more * std::sqrt(shadows.value() / channels),
            light_reserve * more * std::sqrt(occlusion.value() * static_cast<double>(every) / channels)};
}

void state_light_errors(const LightErrors& errors, RenderPlan& plan) {
    for (ErrorShare& share : plan.error_budget) {
        if (share.effect == name_of(EffectId::shadows)) {
            share.rmse = errors.shadows;
        } else if (share.effect == name_of(EffectId::ambient_occlusion)) {
            share.rmse = errors.occlusion;
        }
    }
    charge_effects(plan);
}

} // namespace sheetsplat

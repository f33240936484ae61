#include "light_error.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <utility>

#include <glm/common.hpp>
#include <glm/geometric.hpp>

#include "backend_choice.hpp"
#include "base/poll.hpp"
#include "base/threads.hpp"
#include "light_volumes.hpp"
#include "plan/charge_effects.hpp"
#include "plan/effect_table.hpp"
#include "plan/make_plan.hpp"
#include "reference/classify.hpp"
#include "reference/clip.hpp"
#include "reference/screen.hpp"
#include "scene/mode_rules.hpp"
#include "spread.hpp"
#include "view/kept_slices.hpp"
#include "view/surface_lines.hpp"

namespace sheetsplat {

namespace {

/// Pixels that show something and are looked at: errors of surfaces are large at the few pixels where an edge of a
/// shadow has moved, those of volumes spread over all.
constexpr std::size_t surface_probes = 2048, volume_probes = 256;
/// Pixels that are tried for them.
constexpr std::size_t tries_per_probe = 8;
/// Occlusion is looked at in every so many of them: it costs 14 lines, and changes slowly. (Of small pictures, in
/// all: few lines of few pixels are off.)
constexpr std::size_t every_occlusion = 4;
/// Kernels of which a grid is made for a picture that nobody asked the error of.
constexpr std::size_t most_scattered = 200'000;
/// Pixels between two looks at whether there are enough.
constexpr std::size_t batch = 512;
/// What is stated over what was measured: other pixels may be worse than those that were looked at.
constexpr double reserve = 1.25;
/// Points that add less than this to a pixel are passed over. Of those that add less than `small_share`, so many are
/// looked at, each for several, that the mean stays what it is.
constexpr double least_share = 1e-4, small_share = 0.02;
/// Where a grid shows all kernels, rho between elements is no farther from theirs than this share of what they differ
/// by.
constexpr double margin_of_cell = 0.5;
/// Slice distances over which differences stand for derivatives.
constexpr double little_step = 1e-3;
/// What is left of light where it no longer matters how much.
constexpr double dark = 1e-4;

/// What numbers between 0 and 1 follow from a pixel and a slice: alike on every machine, unlike for neighbours.
double chance(int column, int row, std::int64_t slice) {
    auto bits = static_cast<std::uint64_t>(column) * 0x9E3779B97F4A7C15ULL +
                static_cast<std::uint64_t>(row) * 0xC2B2AE3D27D4EB4FULL +
                static_cast<std::uint64_t>(slice) * 0x165667B19E3779F9ULL;
    bits = (bits ^ (bits >> 30)) * 0xBF58476D1CE4E5B9ULL;
    bits = (bits ^ (bits >> 27)) * 0x94D049BB133111EBULL;
    return static_cast<double>((bits ^ (bits >> 31)) >> 11) * 0x1p-53;
}

class View {
  public:
    View(const Request& request, const Prepared& prepared, const LightVolumes& volumes, const LightVolume* absorption,
         LightErrorProbe::BlocksOf& blocks, std::vector<std::shared_ptr<const PointValues>> values)
        : scene_(request.scene), camera_(request.camera), frame_(prepared.frame), plan_(prepared.plan),
          volumes_(volumes), values_(std::move(values)), surfaces_(!volumes.groups.empty()), groups_(scene_.groups()),
          screen_(camera_, request.size), clipping_(scene_, camera_),
          in_front_(plan_.depth_limit ? &*scene_.depth_limit : nullptr, frame_), box_(supports_world(scene_)),
          lengths_(frame_.slice_spacing / frame_.reference_length) {
        if (plan_.filter) {
            const double wider = 4.0 * (frame_.largest_pixel() + frame_.slice_spacing);
            box_ = {box_.lower - wider, box_.upper + wider};
        }
        for (const Light& light : scene_.lights) {
            to_lights_.push_back(world_direction(light, camera_));
        }
        if (surfaces_) {
            resolved_ = shows_kernels(scene_, *volumes.groups.front());
            lines_ =
                make_surface_lines(scene_, camera_, *volumes.groups.front(), frame_.slice_spacing, plan_.value_unit);
            for (const auto& group : volumes.groups) {
                find_sides(blocks(*group));
            }
        } else if (absorption != nullptr && shows_matter(scene_, plan_, *absorption)) {
            absorption_ = absorption;
            absorbing_ = &blocks(*absorption);
        }
        if (scene_.ambient_occlusion) {
            occlusion_steps_ = occlusion_steps(*scene_.ambient_occlusion, frame_.slice_spacing);
        }
    }

    /// What a pixel's colour is off.
    struct Off {
        Vec3 shadows{0.0}, occlusion{0.0};
        bool seen = false; ///< the pixel shows something
    };

    [[nodiscard]] Off look(int column, int row, bool occlusion) const {
        const Ray ray = ray_of(column, row);
        Off off;
        if (ray.first > ray.last) {
            return off;
        }
        std::vector<Values> known(static_cast<std::size_t>(ray.last - ray.first + 1));
        const auto values = [&](std::int64_t n) -> const Values& {
            static const Values nothing;
            if (n < ray.first || n > ray.last) {
                return nothing;
            }
            Values& here = known[static_cast<std::size_t>(n - ray.first)];
            if (!here.looked_at) {
                here = values_at(ray.point(frame_.depth_of(n)));
            }
            return here;
        };
        const bool between = uses_intervals(scene_.mode, scene_.preintegration);
        double alpha = 0.0;
        for (std::int64_t n = ray.first - (between ? 1 : 0); n <= ray.last && alpha < scene_.opacity_stop; ++n) {
            if (surfaces_) {
                if (!on_one_side(ray, n)) {
                    add_crossings(ray, n, values, occlusion, alpha, off);
                }
            } else if (!clear_at(ray.point(frame_.depth_of(n))) ||
                       (between && !clear_at(ray.point(frame_.depth_of(n + 1))))) {
                add_slice(ray, n, values, occlusion, alpha, off);
            }
        }
        off.seen = alpha > 0.0;
        return off;
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
                const double a = (box_.lower[axis] - ray.start[axis]) / ray.along[axis];
                const double b = (box_.upper[axis] - ray.start[axis]) / ray.along[axis];
                from = std::max(from, std::min(a, b));
                to = std::min(to, std::max(a, b));
            } else if (ray.start[axis] < box_.lower[axis] || ray.start[axis] > box_.upper[axis]) {
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

    [[nodiscard]] Values values_at(const Vec3& world) const {
        Values values;
        values.looked_at = true;
        for (std::size_t group = 0; group < groups_.size(); ++group) {
            values.groups.push_back(surfaces_ ? side_of(group, world) : value_at(group, world));
        }
        return values;
    }

    /// Blocks of a grid of rho that lie on one side of every surface: absorbed_below there; of others `mixed`.
    static constexpr double mixed = -1.0;
    struct Sides {
        const LightBlocks* blocks;
        std::vector<double> below;
    };

    void find_sides(const LightBlocks& blocks) {
        Sides sides{&blocks, {}};
        for (const LightBlocks::Range& range : blocks.ranges()) {
            const auto least = static_cast<double>(range.least), greatest = static_cast<double>(range.greatest);
            const double margin = margin_of_cell * (greatest - least);
            const double below = lines_.absorbed_below(least - margin);
            sides.below.push_back(resolved_ && below == lines_.absorbed_below(greatest + margin) ? below : mixed);
        }
        sides_.push_back(std::move(sides));
    }

    [[nodiscard]] double side_at(std::size_t group, const Vec3& place) const {
        return sides_[group].below[sides_[group].blocks->at(place)];
    }

    /// Whether a slice and the next lie in blocks on the same side of all surfaces.
    [[nodiscard]] bool on_one_side(const Ray& ray, std::int64_t n) const {
        const LightVolume& grid = *volumes_.groups.front();
        const Vec3 front = grid.place_of(ray.point(frame_.depth_of(n)));
        const Vec3 back = grid.place_of(ray.point(frame_.depth_of(n + 1)));
        for (std::size_t group = 0; group < groups_.size(); ++group) {
            const double side = side_at(group, front);
            if (side == mixed || side != side_at(group, back)) {
                return false;
            }
        }
        return true;
    }

    /// Whether a point lies where the grid of absorption shows nothing around.
    [[nodiscard]] bool clear_at(const Vec3& world) const {
        return absorbing_ != nullptr &&
               !(absorbing_->ranges()[absorbing_->at(absorption_->place_of(world))].greatest > 0.0F);
    }

    /// On which side of each surface a point is: rho where the grid leaves that open, else the grid's.
    [[nodiscard]] PointValues::Value side_of(std::size_t group, const Vec3& world) const {
        const LightVolume& grid = *volumes_.groups[group];
        const Vec3 place = grid.place_of(world);
        const std::size_t block = sides_[group].blocks->at(place);
        if (sides_[group].below[block] != mixed) {
            return {plan_.value_unit * static_cast<double>(sides_[group].blocks->ranges()[block].least), false};
        }
        return side_in_cell(group, world, grid.around(place));
    }

    [[nodiscard]] PointValues::Value side_in_cell(std::size_t group, const Vec3& world,
                                                  const LightVolume::Around& around) const {
        const double margin = margin_of_cell * (around.greatest - around.least);
        const bool sure = resolved_ && lines_.absorbed_below(around.least - margin) ==
                                           lines_.absorbed_below(around.greatest + margin);
        return sure ? PointValues::Value{plan_.value_unit * around.number, false} : value_at(group, world);
    }

    [[nodiscard]] bool clip_keeps(const Vec3& world) const {
        return scene_.clip.empty() || clipping_.keeps(camera_.to_eye(world));
    }
    /// Whether a ray's point of a slice is kept.
    [[nodiscard]] bool keeps(const Ray& ray, std::int64_t n) const {
        return n <= ray.last_kept && clip_keeps(ray.point(frame_.depth_of(n)));
    }

    template <class At>
    void add_crossings(const Ray& ray, std::int64_t n, const At& values, bool occlusion, double& alpha,
                       Off& off) const {
        if ((frame_.cut_by_near && n < 0) || !keeps(ray, n) || !keeps(ray, n + 1)) {
            return;
        }
        struct Crossing {
            double share;
            std::size_t group;
            const IsoValue* iso;
        };
        std::vector<Crossing> crossings;
        for (std::size_t group = 0; group < groups_.size(); ++group) {
            if (lines_.absorbed_below(values(n).rho(group) / plan_.value_unit) ==
                lines_.absorbed_below(values(n + 1).rho(group) / plan_.value_unit)) {
                continue;
            }
            const double front = rho_on(ray, n, group), back = rho_on(ray, n + 1, group);
            for (const IsoValue& iso : scene_.iso_values) {
                if ((front < iso.value) != (back < iso.value)) {
                    crossings.push_back({(iso.value - front) / (back - front), group, &iso});
                }
            }
        }
        std::stable_sort(crossings.begin(), crossings.end(),
                         [](const Crossing& a, const Crossing& b) { return a.share < b.share; });
        for (const Crossing& crossing : crossings) {
            if (alpha >= scene_.opacity_stop) {
                return;
            }
            const double share = (1.0 - alpha) * crossing.iso->opacity;
            shade(ray,
                  {n, crossing.share, crossing.group,
                   groups_[crossing.group].transfer_function->at(crossing.iso->value).color, share},
                  occlusion, off);
            alpha += share;
        }
    }

    /// A slice, or the interval behind it: pre-integration of second order as that of first.
    template <class At>
    void add_slice(const Ray& ray, std::int64_t n, const At& values, bool occlusion, double& alpha, Off& off) const {
        const bool interval = scene_.preintegration;
        const bool here = keeps(ray, n);
        const bool behind = interval && keeps(ray, n + 1);
        const double lengths = lengths_ * screen_.secant(ray.column, ray.row);
        std::vector<Spot> spots;
        double extinction = 0.0, weights = 0.0;
        for (std::size_t group = 0; group < groups_.size(); ++group) {
            if (!(here && !values(n).empty(group)) && !(behind && !values(n + 1).empty(group))) {
                continue;
            }
            const TransferFunction& function = *groups_[group].transfer_function;
            Spot spot{n, interval ? 0.5 : 0.0, group, Vec3(0.0), 0.0};
            const double faded = scene_.gradient_opacity
                                     ? std::min(1.0, glm::length(gradient(ray, spot)) / *scene_.gradient_opacity)
                                     : 1.0;
            double own = 0.0, weight = 0.0;
            if (interval) {
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
        for (Spot& spot : spots) {
            spot.share *= share / weights;
            shade(ray, spot, occlusion, off);
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
                const Vec3 here = screen_.point(ray.column, ray.row, depth);
                slope[axis] =
                    (value_at(group, to_world(here + by)).rho - value_at(group, to_world(here - by)).rho) / (2.0 * h);
            }
            return slope;
        }
        const auto rho = [&](int column, int row) {
            return value_at(group, to_world(screen_.point(column, row, depth))).rho;
        };
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
        const TransferFunction& function = *groups_[group].transfer_function;
        const double weakest = 1e-3 * (function.v_max() - function.v_min()) / frame_.reference_length;
        return -gradient / std::max({glm::length(gradient), weakest, 1e-300});
    }

    void shade(const Ray& ray, const Spot& spot, bool occlusion, Off& off) const {
        if (spot.share < least_share || chance(ray.column, ray.row, spot.slice) * small_share >= spot.share) {
            return;
        }
        double share = std::max(spot.share, small_share);
        const double depth = frame_.depth_of(spot.slice) + spot.behind * frame_.slice_spacing;
        if (scene_.depth_cue) {
            const DepthCue& cue = *scene_.depth_cue;
            share *= 1.0 - cue.strength * std::clamp((depth - cue.start) / (cue.end - cue.start), 0.0, 1.0);
        }
        const Vec3 world = ray.point(depth);
        const Material& material = scene_.material;
        if (plan_.shadows) {
            const Vec3 outward = facing_away(gradient(ray, spot), spot.group),
                       to_viewer = screen_.to_viewer(ray.column, ray.row);
            for (std::size_t number = 0; number < scene_.lights.size(); ++number) {
                const Vec3 direction = camera_.direction_to_eye(to_lights_[number]);
                const double towards = glm::dot(outward, direction);
                const double facing = material.two_sided ? std::abs(towards) : std::max(0.0, towards);
                if (share * facing < least_share) {
                    continue;
                }
                const Vec3 mirrored = 2.0 * towards * outward - direction;
                const double highlight =
                    std::pow(std::max(0.0, glm::dot(mirrored, to_viewer)), material.shininess) * material.specular;
                const Vec3 most =
                    share * facing * scene_.lights[number].color * (spot.color * material.diffuse + Vec3(highlight));
                off.shadows += most * light_off(number, world);
            }
        }
        if (plan_.ambient_occlusion && occlusion) {
            const double ambient = scene_.lights.empty() ? 1.0 : material.ambient;
            off.occlusion += share * ambient * scene_.ambient_occlusion->strength * open_off(world) * spot.color;
        }
    }

    /// By how much more of a light the picture shows than there is.
    [[nodiscard]] double light_off(std::size_t number, const Vec3& world) const {
        constexpr double all = std::numeric_limits<double>::max();
        if (surfaces_) {
            return line_off(world, to_lights_[number], lines_.to_lights[number], all);
        }
        const bool drawn = number < volumes_.lights.size() && volumes_.lights[number];
        return (drawn ? volumes_.lights[number]->at(world) : 1.0) - left_along(world, to_lights_[number], all);
    }

    /// The same of what is open around a point.
    [[nodiscard]] double open_off(const Vec3& world) const {
        double sum = 0.0;
        for (std::size_t n = 0; n < around_.size(); ++n) {
            sum += surfaces_ ? line_off(world, around_[n], lines_.around[n], occlusion_steps_)
                             : -left_along(world, around_[n], occlusion_steps_);
        }
        sum /= static_cast<double>(around_.size());
        return surfaces_ ? sum : sum + (volumes_.openness ? volumes_.openness->at(world) : 1.0);
    }

    /// rho where a pixel meets a slice; 0 beyond the slices.
    [[nodiscard]] double rho_on(const Ray& ray, std::int64_t slice, std::size_t group) const {
        const bool exists = slice >= 0 && slice < frame_.slices;
        return exists ? value_at(group, ray.point(frame_.depth_of(slice))).rho : 0.0;
    }

    [[nodiscard]] PointValues::Value value_at(std::size_t group, const Vec3& world) const {
        PointValues::Value sum;
        for (std::size_t field = groups_[group].first; field < groups_[group].last; ++field) {
            const PointValues::Value one = values_[field]->at(world);
            sum = {sum.rho + one.rho, sum.empty && one.empty};
        }
        return sum;
    }

    /// What a line through the grid of rho leaves of light, less what the definition leaves. rho is computed from the
    /// kernels where the grid leaves open on which side of a surface a point is.
    [[nodiscard]] double line_off(const Vec3& world, const Vec3& direction, const Vec3& step, double steps) const {
        const Vec3 place = volumes_.groups.front()->place_of(world);
        const double last = std::min(lines_.last_step(place, step), steps);
        double absorbed = 0.0, drawn = 0.0;
        for (std::size_t group = 0; group < groups_.size(); ++group) {
            double before = 0.0, drawn_before = 0.0;
            for (double point = 1.0; point <= last; point += 1.0) {
                if (absorbed >= SurfaceLines::opaque && drawn >= SurfaceLines::opaque) {
                    break;
                }
                const Vec3 there = place + point * step;
                double here = side_at(group, there), drawn_here = here;
                if (here == mixed) {
                    const LightVolume::Around around = volumes_.groups[group]->around(there);
                    const Vec3 at = world + point * frame_.slice_spacing * direction;
                    drawn_here = lines_.absorbed_below(around.number);
                    here = lines_.absorbed_below(side_in_cell(group, at, around).rho / plan_.value_unit);
                }
                absorbed += point > 1.0 ? std::abs(here - before) : 0.0;
                drawn += point > 1.0 ? std::abs(drawn_here - drawn_before) : 0.0;
                before = here;
                drawn_before = drawn_here;
            }
        }
        return SurfaceLines::left_of(drawn) - SurfaceLines::left_of(absorbed);
    }

    /// What the definition leaves of light in mode composite.
    [[nodiscard]] double left_along(const Vec3& world, const Vec3& direction, double steps) const {
        double end = std::numeric_limits<double>::max();
        for (int axis = 0; axis < 3; ++axis) {
            if (direction[axis] != 0.0) {
                const double side = direction[axis] > 0.0 ? box_.upper[axis] : box_.lower[axis];
                end = std::min(end, (side - world[axis]) / direction[axis]);
            }
        }
        const double last = std::min(steps, std::floor(end / frame_.slice_spacing) + 1.0);
        double left = 1.0;
        for (double step = 1.0; step <= last && left > dark; step += 1.0) {
            const Vec3 point = world + step * frame_.slice_spacing * direction;
            if (clear_at(point) || !clip_keeps(point)) {
                continue;
            }
            for (std::size_t group = 0; group < groups_.size(); ++group) {
                const PointValues::Value value = value_at(group, point);
                if (!value.empty) {
                    const double opacity = reference::look_up(*groups_[group].transfer_function, value.rho).opacity;
                    left *= 1.0 - reference::opacity_over(opacity, lengths_);
                }
            }
        }
        return left;
    }

    const Scene& scene_;
    const Camera& camera_;
    const Frame& frame_;
    const DrawPlan& plan_;
    const LightVolumes& volumes_;
    std::vector<std::shared_ptr<const PointValues>> values_; ///< of each field
    bool surfaces_;
    std::vector<Group> groups_;
    reference::Screen screen_;
    reference::Clipping clipping_;
    SlicesInFront in_front_;
    Box box_; ///< of all supports, world
    double lengths_;
    std::vector<Vec3> to_lights_; ///< world
    std::array<Vec3, directions_around> around_ = around_world();
    SurfaceLines lines_;
    bool resolved_ = false;                   ///< the grid of rho shows every kernel
    std::vector<Sides> sides_;                ///< of each group, mode isosurface
    const LightVolume* absorption_ = nullptr; ///< null: not used
    const LightBlocks* absorbing_ = nullptr;
    double occlusion_steps_ = 0.0;
};

} // namespace

bool LightErrorProbe::is_cheap(const Request& request, const Prepared& prepared) {
    std::size_t kernels = 0;
    for (const auto& field : request.scene.fields) {
        kernels += as_regular(field.get()) != nullptr && !prepared.plan.filter ? 0 : field->size();
    }
    return kernels <= most_scattered;
}

LightErrors LightErrorProbe::errors(const Request& request, const Prepared& prepared, const LightVolumes& volumes,
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

    BlocksOf blocks = [this, &volumes, &absorption](const LightVolume& volume) -> const LightBlocks& {
        std::shared_ptr<const LightVolume> owner = absorption;
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
    const View view(request, prepared, volumes, absorption.get(), blocks, std::move(values));
    const Size size = request.size;
    const std::size_t pixels = static_cast<std::size_t>(size.width) * static_cast<std::size_t>(size.height);
    const bool surfaces = request.scene.mode == Mode::isosurface;
    const std::size_t wanted = surfaces ? surface_probes : volume_probes;
    const bool all = pixels <= wanted;
    const std::size_t every = all ? 1 : every_occlusion;
    const std::size_t most = all ? pixels : tries_per_probe * wanted;
    ThreadPool pool(thread_count(request.options.threads));
    std::vector<View::Off> found;
    std::size_t seen = 0;
    while (found.size() < most && (all || seen < wanted)) {
        const std::size_t start = found.size();
        found.resize(std::min(most, start + batch));
        pool.run(
            found.size() - start,
            [&](std::size_t task, int) {
                const std::size_t number = start + task;
                const auto width = static_cast<std::size_t>(size.width);
                const std::array<int, 2> at =
                    all ? std::array<int, 2>{static_cast<int>(number % width), static_cast<int>(number / width)}
                        : spread(number, size);
                found[number] = view.look(at[0], at[1], number % every == 0);
            },
            [&] { report_progress(request.progress, 1.0); });
        seen += static_cast<std::size_t>(std::count_if(found.begin() + static_cast<std::ptrdiff_t>(start), found.end(),
                                                       [](const View::Off& off) { return off.seen; }));
    }
    double shadows = 0.0, occlusion = 0.0, apart = 0.0, together = 0.0;
    for (std::size_t number = 0; number < found.size(); ++number) {
        const View::Off& off = found[number];
        shadows += glm::dot(off.shadows, off.shadows);
        occlusion += glm::dot(off.occlusion, off.occlusion);
        if (number % every == 0) {
            const Vec3 both = off.shadows + off.occlusion;
            apart += glm::dot(off.shadows, off.shadows) + glm::dot(off.occlusion, off.occlusion);
            together += glm::dot(both, both);
        }
    }
    // Where both are too bright at the same points their errors add up, and so must the squares of what is stated.
    const double more = apart > 0.0 ? std::max(1.0, std::sqrt(together / apart)) : 1.0;
    // Of four channels, of which opacity is right.
    const double channels = 4.0 * static_cast<double>(std::max<std::size_t>(found.size(), 1));
    return {reserve * more * std::sqrt(shadows / channels),
            reserve * more * std::sqrt(occlusion * static_cast<double>(every) / channels)};
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

#include "reference/composite.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "reference/classify.hpp"
#include "scene/mode_rules.hpp"

namespace sheetsplat::reference {

namespace {

constexpr double never = std::numeric_limits<double>::infinity();

// A point so little in front of a depth limit, in slice distances, is at it.
constexpr double at_the_limit = 1e-6;

// -ln(2^-24): what is opaque.
constexpr double thickest_face = 16.635532333438686;

} // namespace

bool calls_for_gradients(const Scene& scene) {
    return !is_scalar(scene.mode) && (!scene.lights.empty() || scene.gradient_opacity.has_value());
}

Compositor::Compositor(const CountedScene& counted, const Camera& camera, const Screen& screen, const Slices& slices,
                       const Shader& shader, const Clipping& clipping, const Cell& cell,
                       const Surroundings* surroundings, const Request& request, const Nudge& nudge)
    : counted_(counted), scene_(counted.scene()), screen_(screen), slices_(slices), shader_(shader),
      clipping_(clipping), cell_(cell), surroundings_(surroundings), needs_gradient_(calls_for_gradients(scene_)),
      groups_(groups_drawn(scene_)), nudge_(nudge.rho), stop_(scene_.opacity_stop + nudge.stop),
      reference_distance_(scene_.reference_distance()) {
    const Scene& scene = scene_;
    for (const Group& group : groups_) {
        ends_.emplace_back(counted.end_of_group(ends_.size()), camera, scene.slice_distance());
        rho_shifts_.push_back(nudge.rho * (group.transfer_function->v_max() - group.transfer_function->v_min()));
    }
    const std::size_t pixels = static_cast<std::size_t>(screen.width()) * static_cast<std::size_t>(screen.height());
    picture_.size = {screen.width(), screen.height()};
    if (is_scalar(scene.mode)) {
        picture_.scalar.assign(pixels, start_of(scene.mode));
    } else {
        picture_.rgba.assign(4 * pixels, 0.0);
    }
    counts_.assign(counts_weighted_slices(scene.mode) ? pixels : 0, 0.0);
    if (scene.part && scene.part->in_front) {
        for (std::size_t at = 0; at < picture_.rgba.size() / 4; ++at) {
            picture_.rgba[4 * at + 3] = static_cast<double>((*scene.part->in_front)[at]);
        }
    }
    picture_.coverage.assign(request.coverage ? pixels : 0, 0.0);
    picture_.depth.assign(request.depth ? pixels : 0, never);
    picture_.first_slice = slices.first;
    picture_.slices = slices.count;
}

void Compositor::add(const SheetWindow& window, const std::function<void()>& poll) {
    const bool at_slice = slices_.exists(window.n);
    for (int row = 0; row < screen_.height(); ++row) {
        if (surroundings_ != nullptr) {
            poll();
        }
        for (int column = 0; column < screen_.width(); ++column) {
            const std::size_t number = static_cast<std::size_t>(row) * static_cast<std::size_t>(screen_.width()) +
                                       static_cast<std::size_t>(column);
            const Pixel pixel{column, row, number, slices_.spacing * screen_.secant(column, row) / reference_distance_};
            if (!owned(window, pixel)) {
                continue;
            }
            if (!picture_.coverage.empty() && at_slice) {
                add_coverage(window, pixel);
            }
            if (is_scalar(scene_.mode)) {
                add_scalar(window, pixel);
            } else if (shows_surfaces(scene_.mode)) {
                add_crossings(window, pixel);
            } else if (scene_.second_order) {
                add_second_order_interval(window, pixel);
            } else if (scene_.preintegration) {
                add_interval(window, pixel);
            } else {
                add_slice(window, pixel);
            }
        }
    }
}

void Compositor::add_coverage(const SheetWindow& window, const Pixel& pixel) {
    if (!kept(window, pixel, 0)) {
        return;
    }
    double weight = 0.0;
    for (std::size_t group = 0; group < groups_.size(); ++group) {
        const View view{window, pixel, group};
        weight += groups_[group].use.role != GroupRole::colors ? view.sheet(0).weight[view.index()] : 0.0;
    }
    picture_.coverage[pixel.number] += weight * slices_.spacing * screen_.secant(pixel.column, pixel.row);
}

void Compositor::add_slice(const SheetWindow& window, const Pixel& pixel) {
    if (stopped(pixel) || !kept(window, pixel, 0)) {
        return;
    }
    const double depth = slices_.depth(window.n);
    Mixture mixture;
    for (std::size_t group = 0; group < groups_.size(); ++group) {
        const View view{window, pixel, group};
        if (!is_classified(groups_[group]) || !view.reached(0)) {
            continue;
        }
        const ColorOpacity looks = look_up(*groups_[group].transfer_function, view.rho(0) + rho_shifts_[group]);
        if (looks.opacity == 0.0) {
            continue;
        }
        const Vec3 slope = needs_gradient_ ? gradient(view, 0) : Vec3(0.0);
        const double opacity = looks.opacity * gradient_share(slope);
        const double extinction = -pixel.lengths * std::log1p(-opacity);
        if (extinction > 0.0) {
            mixture.add(shaded(view, color_of(view, looks.color, 0.0), slope, depth, extinction), extinction,
                        extinction_of(opacity));
        }
    }
    put_behind(pixel, mixture.color(), mixture.opacity(), depth);
}

void Compositor::add_interval(const SheetWindow& window, const Pixel& pixel) {
    if (stopped(pixel)) {
        return;
    }
    Mixture mixture;
    for (std::size_t group = 0; group < groups_.size(); ++group) {
        const View view{window, pixel, group};
        if (!is_classified(groups_[group]) || !open_interval(view)) {
            continue;
        }
        const Vec3 slope = gradient_of_interval(view);
        const ColorExtinction mean = mean_over_ramp(*groups_[group].transfer_function, view.rho(0) + rho_shifts_[group],
                                                    view.rho(1) + rho_shifts_[group]);
        // mean(tau) times a share over a length is mean(tau) over the length times the share.
        const double extinction = pixel.lengths * gradient_share(slope) * mean.extinction;
        if (extinction > 0.0) {
            const Vec3 color = color_of_interval(view, mean.color);
            mixture.add(shaded(view, color, slope, middle_of_interval(window), extinction), extinction, extinction);
        }
    }
    put_behind(pixel, mixture.color(), mixture.opacity(), depth_of_interval(window));
}

void Compositor::add_second_order_interval(const SheetWindow& window, const Pixel& pixel) {
    // Scene::validate() allows it for one group only.
    const View view{window, pixel, 0};
    if (stopped(pixel) || !open_interval(view)) {
        return;
    }
    const Vec3 slope = gradient_of_interval(view);
    std::array<double, 4> values{};
    for (std::size_t n = 0; n < values.size(); ++n) {
        values[n] = window.groups[0][n]->rho[view.index()] + rho_shifts_[0];
    }
    const ColorOpacity looks =
        preintegrate_second_order(*groups_[0].transfer_function, values, pixel.lengths * gradient_share(slope));
    if (looks.opacity > 0.0) {
        const double extinction = extinction_of(looks.opacity);
        put_behind(pixel, shaded(view, looks.color, slope, middle_of_interval(window), extinction), looks.opacity,
                   depth_of_interval(window));
    }
}

std::vector<Compositor::Crossing> Compositor::find_crossings(const SheetWindow& window, const Pixel& pixel) const {
    std::vector<Crossing> crossings;
    for (std::size_t group = 0; group < groups_.size(); ++group) {
        const View view{window, pixel, group};
        if (!inside(view, 0) || !inside(view, 1)) {
            continue;
        }
        const double front = view.rho(0) + rho_shifts_[group], back = view.rho(1) + rho_shifts_[group];
        // Where a label has no kernel it is not, though its scalar may be 0 for want of any others.
        const auto below = [&](std::size_t ahead, double rho, double value) {
            return rho < value || (is_label(groups_[group]) && !view.reached(ahead));
        };
        for (const IsoValue& iso : counted_.iso_values(group)) {
            if (below(0, front, iso.value) != below(1, back, iso.value)) {
                const double share = back != front ? (iso.value - front) / (back - front) : 0.0;
                crossings.push_back({std::clamp(share, 0.0, 1.0), group, &iso});
            }
        }
    }
    std::stable_sort(crossings.begin(), crossings.end(),
                     [](const Crossing& a, const Crossing& b) { return a.share < b.share; });
    return crossings;
}

void Compositor::add_crossings(const SheetWindow& window, const Pixel& pixel) {
    // A cut is open: what the near plane removes may have any value.
    const bool cut = slices_.cut_by_near && window.n == slices_.first - 1;
    if (cut || stopped(pixel) || !kept(window, pixel, 0) || !kept(window, pixel, 1)) {
        return;
    }
    for (const Crossing& crossing : find_crossings(window, pixel)) {
        if (stopped(pixel)) {
            return;
        }
        const View view{window, pixel, crossing.group};
        const double share = crossing.share;
        const Vec3 slope = needs_gradient_ ? (1.0 - share) * gradient(view, 0) + share * gradient(view, 1) : Vec3(0.0);
        const Vec3 own = look_up(*groups_[crossing.group].transfer_function, crossing.iso->value).color;
        const Vec3 color = color_of(view, own, share);
        const double depth = slices_.depth(window.n) + share * slices_.spacing;
        put_behind(pixel, shaded(view, color, slope, depth, 0.0), crossing.iso->opacity, depth);
    }
}

void Compositor::add_scalar(const SheetWindow& window, const Pixel& pixel) {
    const View view{window, pixel, 0};
    if (!kept(window, pixel, 0) || view.sheet(0).counts[view.index()] == 0) {
        return;
    }
    if (!counts_.empty()) {
        counts_[pixel.number] += 1.0;
    }
    const ModeTraits& mode = traits_of(scene_.mode);
    double& value = picture_.scalar[pixel.number];
    if (mode.fold == Fold::largest) {
        value = std::max(value, view.rho(0));
    } else if (mode.fold == Fold::smallest) {
        value = std::min(value, view.rho(0));
    } else if (mode.integrates) {
        value += view.rho(0) * slices_.spacing * screen_.secant(pixel.column, pixel.row);
    } else {
        value += view.rho(0);
    }
}

Vec3 Compositor::color_of(const View& view, const Vec3& own, double share) const {
    const GroupRange range = colors_of(groups_, view.group);
    Vec3 sum(0.0);
    bool any = false;
    for (std::size_t group = range.first; group < range.last; ++group) {
        const View colors{view.window, view.pixel, group};
        // Of a crossing, a field is empty where both ends are.
        if (colors.reached(0) || (share > 0.0 && colors.reached(1))) {
            const double rho = share > 0.0 ? (1.0 - share) * colors.rho(0) + share * colors.rho(1) : colors.rho(0);
            sum += look_up(*groups_[group].transfer_function, rho + rho_shifts_[group]).color;
            any = true;
        }
    }
    return any ? sum : own;
}

Vec3 Compositor::color_of_interval(const View& view, const Vec3& own) const {
    const GroupRange range = colors_of(groups_, view.group);
    Vec3 sum(0.0);
    bool any = false;
    for (std::size_t group = range.first; group < range.last; ++group) {
        const View colors{view.window, view.pixel, group};
        if (colors.reached(0) || colors.reached(1)) {
            sum += mean_over_ramp(*groups_[group].transfer_function, colors.rho(0) + rho_shifts_[group],
                                  colors.rho(1) + rho_shifts_[group])
                       .color;
            any = true;
        }
    }
    return any ? sum : own;
}

bool Compositor::kept(const SheetWindow& window, const Pixel& pixel, std::size_t ahead) const {
    const double depth = slices_.depth(window.n + static_cast<std::int64_t>(ahead));
    if (scene_.depth_limit &&
        depth >= scene_.depth_limit->at(pixel.column, pixel.row) - at_the_limit * slices_.spacing) {
        return false;
    }
    return clipping_.keeps(screen_.point(pixel.column, pixel.row, depth));
}

bool Compositor::inside(const View& view, std::size_t ahead) const {
    const double depth = slices_.depth(view.window.n + static_cast<std::int64_t>(ahead));
    return ends_[view.group].keeps(screen_.point(view.pixel.column, view.pixel.row, depth));
}

bool Compositor::owned(const SheetWindow& window, const Pixel& pixel) const {
    return !scene_.part ||
           cell_.holds(screen_.point(pixel.column, pixel.row, slices_.depth(std::max(window.n, slices_.first))));
}

bool Compositor::open_interval(const View& view) const {
    return (view.reached(0) && kept(view.window, view.pixel, 0)) ||
           (view.reached(1) && kept(view.window, view.pixel, 1));
}

Vec3 Compositor::gradient(const View& view, std::size_t ahead) const {
    if (scene_.gradient == Gradient::analytic) {
        return view.sheet(ahead).gradient[view.index()];
    }
    const std::array<const Sheet*, 4>& sheets = view.window.groups[view.group];
    const auto rho = [&](int slice, int column, int row) {
        const Sheet& sheet = *sheets[ahead + static_cast<std::size_t>(slice + 1)];
        return sheet.rho[sheet.index(column, row)];
    };
    return gradient_eye(screen_, rho, slices_.depth(view.window.n + static_cast<std::int64_t>(ahead)), slices_.spacing,
                        reference_distance_, view.pixel.column, view.pixel.row);
}

Vec3 Compositor::gradient_of_interval(const View& view) const {
    return needs_gradient_ ? 0.5 * (gradient(view, 0) + gradient(view, 1)) : Vec3(0.0);
}

double Compositor::middle_of_interval(const SheetWindow& window) const {
    return slices_.depth(window.n) + 0.5 * slices_.spacing;
}

double Compositor::depth_of_interval(const SheetWindow& window) const {
    return std::max(middle_of_interval(window), slices_.depth(slices_.first));
}

double Compositor::gradient_share(const Vec3& gradient) const {
    if (!scene_.gradient_opacity) {
        return 1.0;
    }
    return std::min(1.0,
                    std::hypot(gradient.x, gradient.y, gradient.z) / (*scene_.gradient_opacity * reference_distance_));
}

void Compositor::turn_to_face(const View& view, double depth, double extinction, Lighting& lighting) const {
    const Vec3 start = screen_.point(view.pixel.column, view.pixel.row, 0.0);
    const Vec3 along = screen_.point(view.pixel.column, view.pixel.row, 1.0) - start;
    const CutFace face = ends_[view.group].entered(start, along, clipping_.entered(start, along));
    const double length = std::max(slices_.spacing, reference_distance_);
    const double thickness = std::min(extinction * length / slices_.spacing, thickest_face);
    const double behind = (depth - face.depth) / length;
    const double through = extinction_of(picture_.rgba[4 * view.pixel.number + 3]) / thickness;
    lighting.face = face.normal;
    lighting.on_face = -std::expm1(-4.0 * thickness) * std::clamp(2.0 - behind / 4.0, 0.0, 1.0) *
                       std::clamp(2.0 - (behind - through), 0.0, 1.0);
}

Vec3 Compositor::shaded(const View& view, const Vec3& color, const Vec3& gradient, double depth,
                        double extinction) const {
    const Pixel& pixel = view.pixel;
    Lighting lighting{screen_.to_viewer(pixel.column, pixel.row), screen_.point(pixel.column, pixel.row, depth),
                      surroundings_, nudge_, view.group};
    if (scene_.cut_faces && extinction > 0.0) {
        turn_to_face(view, depth, extinction, lighting);
    }
    const Vec3 lit = shader_.shade(color, gradient, lighting);
    if (!scene_.depth_cue) {
        return lit;
    }
    const DepthCue& cue = *scene_.depth_cue;
    const double share = cue.strength * std::clamp((depth - cue.start) / (cue.end - cue.start), 0.0, 1.0);
    return lit + (cue.color - lit) * share;
}

bool Compositor::stopped(const Pixel& pixel) const { return picture_.rgba[4 * pixel.number + 3] >= stop_; }

void Compositor::put_behind(const Pixel& pixel, const Vec3& color, double alpha, double depth) {
    if (alpha == 0.0) {
        return;
    }
    double* rgba = &picture_.rgba[4 * pixel.number];
    const double share = (1.0 - rgba[3]) * alpha;
    for (int channel = 0; channel < 3; ++channel) {
        rgba[channel] += share * color[channel];
    }
    rgba[3] += share;
    if (!picture_.depth.empty() && rgba[3] >= 0.5 && picture_.depth[pixel.number] == never) {
        picture_.depth[pixel.number] = depth;
    }
}

Picture Compositor::finish() {
    for (std::size_t at = 0; at < counts_.size(); ++at) {
        if (counts_[at] == 0.0) {
            picture_.scalar[at] = std::numeric_limits<double>::quiet_NaN();
        } else if (traits_of(scene_.mode).mean) {
            picture_.scalar[at] /= counts_[at];
        }
    }
    picture_.counts = std::move(counts_);
    if (scene_.background && !scene_.part) {
        for (std::size_t at = 0; at < picture_.rgba.size(); at += 4) {
            for (std::size_t channel = 0; channel < 3; ++channel) {
                picture_.rgba[at + channel] +=
                    (1.0 - picture_.rgba[at + 3]) * (*scene_.background)[static_cast<int>(channel)];
            }
            picture_.rgba[at + 3] = 1.0;
        }
    }
    return std::move(picture_);
}

} // namespace sheetsplat::reference

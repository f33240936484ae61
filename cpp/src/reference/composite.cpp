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

} // namespace

bool calls_for_gradients(const Scene& scene) {
    return !is_scalar(scene.mode) && (!scene.lights.empty() || scene.gradient_opacity.has_value());
}

Compositor::Compositor(const Scene& scene, const Screen& screen, const Slices& slices, const Shader& shader,
                       const Clipping& clipping, const Surroundings* surroundings, const Request& request,
                       const Nudge& nudge)
    : scene_(scene), screen_(screen), slices_(slices), shader_(shader), clipping_(clipping),
      surroundings_(surroundings), needs_gradient_(calls_for_gradients(scene)),
      rho_shift_(nudge.rho * (scene.transfer_function.v_max() - scene.transfer_function.v_min())),
      stop_(scene.opacity_stop + nudge.stop), reference_distance_(scene.reference_distance()) {
    const std::size_t pixels = static_cast<std::size_t>(screen.width()) * static_cast<std::size_t>(screen.height());
    picture_.size = {screen.width(), screen.height()};
    (is_scalar(scene.mode) ? picture_.scalar : picture_.rgba).assign(is_scalar(scene.mode) ? pixels : 4 * pixels, 0.0);
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
            if (!picture_.coverage.empty() && at_slice) {
                add_coverage(window, pixel);
            }
            if (is_scalar(scene_.mode)) {
                add_scalar(window, pixel);
            } else if (scene_.mode == Mode::isosurface) {
                add_crossing(window, pixel);
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
    const Sheet& here = *window.sheets[1];
    picture_.coverage[pixel.number] +=
        here.weight[here.index(pixel.column, pixel.row)] * slices_.spacing * screen_.secant(pixel.column, pixel.row);
}

void Compositor::add_slice(const SheetWindow& window, const Pixel& pixel) {
    if (stopped(pixel) || !open(window, pixel, 0)) {
        return;
    }
    const ColorOpacity looks = look_up(scene_.transfer_function, rho(window, pixel, 0) + rho_shift_);
    if (looks.opacity == 0.0) {
        return;
    }
    const Vec3 slope = needs_gradient_ ? gradient(window, pixel, 0) : Vec3(0.0);
    const double alpha = opacity_over(looks.opacity * gradient_share(slope), pixel.lengths);
    if (alpha == 0.0) {
        return;
    }
    const double depth = slices_.depth(window.n);
    put_behind(pixel, shaded(pixel, looks.color, slope, depth), alpha, depth);
}

void Compositor::add_interval(const SheetWindow& window, const Pixel& pixel) {
    if (stopped(pixel) || !(open(window, pixel, 0) || open(window, pixel, 1))) {
        return;
    }
    const Vec3 slope = needs_gradient_ ? 0.5 * (gradient(window, pixel, 0) + gradient(window, pixel, 1)) : Vec3(0.0);
    // mean(tau) times a share over a length is mean(tau) over the length times the share.
    const double lengths = pixel.lengths * gradient_share(slope);
    std::array<double, 4> values{};
    for (std::size_t n = 0; n < values.size(); ++n) {
        const Sheet& sheet = *window.sheets[n];
        values[n] = sheet.rho[sheet.index(pixel.column, pixel.row)] + rho_shift_;
    }
    const ColorOpacity looks = scene_.second_order
                                   ? preintegrate_second_order(scene_.transfer_function, values, lengths)
                                   : preintegrate(scene_.transfer_function, values[1], values[2], lengths);
    if (looks.opacity == 0.0) {
        return;
    }
    const double front = slices_.depth(window.n);
    put_behind(pixel, shaded(pixel, looks.color, slope, front + 0.5 * slices_.spacing), looks.opacity, front);
}

void Compositor::add_crossing(const SheetWindow& window, const Pixel& pixel) {
    if (picture_.rgba[4 * pixel.number + 3] > 0.0) {
        return;
    }
    const double iso = *scene_.iso_value;
    const double front = rho(window, pixel, 0) + rho_shift_, back = rho(window, pixel, 1) + rho_shift_;
    if ((front < iso) == (back < iso) || !kept(window, pixel, 0) || !kept(window, pixel, 1)) {
        return;
    }
    const double share = (iso - front) / (back - front);
    const Vec3 slope =
        needs_gradient_ ? (1.0 - share) * gradient(window, pixel, 0) + share * gradient(window, pixel, 1) : Vec3(0.0);
    const Vec3 color = look_up(scene_.transfer_function, iso).color;
    const double depth = slices_.depth(window.n) + share * slices_.spacing;
    put_behind(pixel, shaded(pixel, color, slope, depth), 1.0, depth);
}

void Compositor::add_scalar(const SheetWindow& window, const Pixel& pixel) {
    if (!kept(window, pixel, 0)) {
        return;
    }
    double& value = picture_.scalar[pixel.number];
    if (scene_.mode == Mode::xray) {
        value += rho(window, pixel, 0) * slices_.spacing * screen_.secant(pixel.column, pixel.row);
    } else {
        value = std::max(value, rho(window, pixel, 0));
    }
}

double Compositor::rho(const SheetWindow& window, const Pixel& pixel, std::size_t ahead) const {
    const Sheet& sheet = *window.sheets[1 + ahead];
    return sheet.rho[sheet.index(pixel.column, pixel.row)];
}

bool Compositor::kept(const SheetWindow& window, const Pixel& pixel, std::size_t ahead) const {
    const double depth = slices_.depth(window.n + static_cast<std::int64_t>(ahead));
    return clipping_.keeps(screen_.point(pixel.column, pixel.row, depth));
}

bool Compositor::open(const SheetWindow& window, const Pixel& pixel, std::size_t ahead) const {
    const Sheet& sheet = *window.sheets[1 + ahead];
    return sheet.reached[sheet.index(pixel.column, pixel.row)] != 0 && kept(window, pixel, ahead);
}

Vec3 Compositor::gradient(const SheetWindow& window, const Pixel& pixel, std::size_t ahead) const {
    if (scene_.gradient == Gradient::analytic) {
        const Sheet& sheet = *window.sheets[1 + ahead];
        return sheet.gradient[sheet.index(pixel.column, pixel.row)];
    }
    return gradient_eye(screen_, *window.sheets[ahead], *window.sheets[ahead + 1], *window.sheets[ahead + 2],
                        slices_.depth(window.n + static_cast<std::int64_t>(ahead)), slices_.spacing, pixel.column,
                        pixel.row);
}

double Compositor::gradient_share(const Vec3& gradient) const {
    if (!scene_.gradient_opacity) {
        return 1.0;
    }
    return std::min(1.0, std::hypot(gradient.x, gradient.y, gradient.z) / *scene_.gradient_opacity);
}

Vec3 Compositor::shaded(const Pixel& pixel, const Vec3& color, const Vec3& gradient, double depth) const {
    const Lighting lighting{screen_.to_viewer(pixel.column, pixel.row), screen_.point(pixel.column, pixel.row, depth),
                            surroundings_, rho_shift_};
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
    if (scene_.background) {
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

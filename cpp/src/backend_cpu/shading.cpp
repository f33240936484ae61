#include "backend_cpu/shading.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>

#include <glm/geometric.hpp>

#include "plan/make_plan.hpp"
#include "scene/mode_rules.hpp"

namespace sheetsplat::backend_cpu {

namespace {

/// [EKE01] as section 4 has it: 1 - a is never taken smaller.
constexpr double clearest = 0x1p-24;
/// Cells a stretch, so that a search rarely goes on beyond the first stretch of its cell.
constexpr std::size_t cells_per_stretch = 4;
constexpr std::size_t most_cells = 1U << 14;

/// The nearest number of the format, never infinite.
template <class T>
T number(double value) {
    constexpr auto largest = static_cast<double>(std::numeric_limits<T>::max());
    return static_cast<T>(std::clamp(value, -largest, largest));
}

/// Slopes and scales: so small that products with differences of rho stay finite.
template <class T>
T factor(double value) {
    const double largest = std::sqrt(static_cast<double>(std::numeric_limits<T>::max())) * 1e10;
    return static_cast<T>(std::clamp(value, -largest, largest));
}

/// Points with values in the sheets' unit, as the number format has them.
template <class T>
std::vector<TransferPoint> points_in(const TransferFunction& function, double value_unit) {
    std::vector<TransferPoint> points = function.points();
    for (TransferPoint& point : points) {
        point.value = static_cast<double>(number<T>(point.value / value_unit));
    }
    return points;
}

template <class T>
struct Stretch {
    TransferPoint from, to; ///< linear from one to the other
    bool constant = false;  ///< with the looks of `from`
};

/// As TransferTable describes them.
template <class T>
std::vector<Stretch<T>> stretches_of(const std::vector<TransferPoint>& points) {
    std::vector<Stretch<T>> stretches;
    TransferPoint end = points.back();
    end.value = std::numeric_limits<double>::infinity();
    if (points.size() > 1 && points[1].value == points[0].value) {
        // Smaller values keep the looks of the very first point, though no value at or above it has them.
        stretches.push_back({points[0], points[0], true});
    }
    for (std::size_t n = 0; n + 1 < points.size(); ++n) {
        if (points[n + 1].value > points[n].value) {
            stretches.push_back({points[n], points[n + 1], false});
        }
    }
    stretches.push_back({points.back(), end, true});
    return stretches;
}

template <class T>
void find_limits(const std::vector<Stretch<T>>& stretches, TransferTable<T>& table) {
    constexpr T infinity = std::numeric_limits<T>::infinity();
    const auto clear = [](const Stretch<T>& s) { return s.from.opacity == 0.0 && (s.constant || s.to.opacity == 0.0); };
    table.below = infinity;
    table.above = -infinity;
    for (std::size_t n = 0; n < stretches.size(); ++n) {
        if (!clear(stretches[n])) {
            const T start = static_cast<T>(stretches[n].from.value);
            table.below = stretches[n].from.opacity == 0.0 ? start
                          : n == 0                         ? -infinity
                                                           : std::nextafter(start, -infinity);
            break;
        }
    }
    for (std::size_t n = stretches.size(); n-- > 0;) {
        if (!clear(stretches[n])) {
            table.above = static_cast<T>(stretches[n].to.value);
            break;
        }
    }
}

/// starts: of all stretches; the first one's does not count, since it holds for all smaller values.
template <class T>
Cells<T> make_cells(const std::vector<T>& starts, int record) {
    Cells<T> made;
    const std::size_t count = std::min(most_cells, cells_per_stretch * starts.size());
    made.first = starts.size() > 1 ? starts[1] : T(0);
    made.last = starts.size() > 1 ? starts.back() : T(0);
    made.last_cell = static_cast<T>(count - 1);
    // A little fewer than `count` over the whole range: the starts of evenly spaced stretches then lie at the very end
    // of the cell before, and the search almost never goes on from where it begins.
    const double margin = 8.0 * static_cast<double>(std::numeric_limits<T>::epsilon());
    const double span = static_cast<double>(made.last) - static_cast<double>(made.first);
    made.per_unit = span > 0.0 ? factor<T>(static_cast<double>(count) / span * (1.0 - margin)) : T(0);
    made.records.assign(count, 0);
    // Values of a cell may be smaller than a start that lies in it, never than one that lies in a cell before.
    std::size_t cell = 0;
    for (std::size_t n = 1; n < starts.size(); ++n) {
        const T place = (std::clamp(starts[n], made.first, made.last) - made.first) * made.per_unit;
        const auto start = static_cast<std::size_t>(std::min(place, made.last_cell));
        for (; cell <= start; ++cell) {
            made.records[cell] = static_cast<std::int32_t>(n - 1) * record;
        }
    }
    for (; cell < count; ++cell) {
        made.records[cell] = static_cast<std::int32_t>(starts.size() - 1) * record;
    }
    return made;
}

template <class T>
RampStretch<T> ramp(double from, double to, const TransferPoint& first, const TransferPoint& last, bool constant) {
    RampStretch<T> r;
    r.from = number<T>(from);
    r.to = number<T>(to);
    const double width = static_cast<double>(r.to) - static_cast<double>(r.from);
    r.per_width = constant || !(width > 0.0) ? T(0) : factor<T>(1.0 / width);
    r.opacity = static_cast<T>(std::min(first.opacity, 1.0 - clearest));
    r.clearness = static_cast<T>(std::max(1.0 - first.opacity, clearest));
    if (!constant) {
        r.opacity_step = static_cast<T>(std::min(last.opacity, 1.0 - clearest)) - r.opacity;
        r.clearness_step = static_cast<T>(std::max(1.0 - last.opacity, clearest)) - r.clearness;
    }
    for (int c = 0; c < 3; ++c) {
        r.color[c] = number<T>(first.color[c]);
        r.color_step[c] = constant ? T(0) : number<T>(last.color[c] - first.color[c]);
    }
    return r;
}

/// The whole axis. Where opacity passes the largest one that is allowed a stretch ends, so that it stays linear.
template <class T>
std::vector<RampStretch<T>> ramps_of(const std::vector<TransferPoint>& points) {
    constexpr auto largest = static_cast<double>(std::numeric_limits<T>::max());
    constexpr double limit = 1.0 - clearest;
    std::vector<RampStretch<T>> ramps;
    ramps.push_back(ramp<T>(-largest, points.front().value, points.front(), points.front(), true));
    for (std::size_t n = 0; n + 1 < points.size(); ++n) {
        const TransferPoint& p = points[n];
        const TransferPoint& q = points[n + 1];
        if (!(q.value > p.value)) {
            continue;
        }
        if ((p.opacity > limit) != (q.opacity > limit)) {
            const double x = (limit - p.opacity) / (q.opacity - p.opacity);
            const TransferPoint middle{p.value + x * (q.value - p.value), p.color + (q.color - p.color) * x, limit};
            ramps.push_back(ramp<T>(p.value, middle.value, p, middle, false));
            ramps.push_back(ramp<T>(middle.value, q.value, middle, q, false));
        } else {
            ramps.push_back(ramp<T>(p.value, q.value, p, q, false));
        }
    }
    ramps.push_back(ramp<T>(points.back().value, largest, points.back(), points.back(), true));
    return ramps;
}

/// Means over a stretch of absorption and of its product with the share of the way: Gauss-Legendre where 1 - opacity
/// changes by less than a factor of two, else the logarithm's own integrals.
struct StretchMeans {
    double plain = 0.0, weighted = 0.0;

    StretchMeans(double opacity, double opacity_step, double clear, double clear_step) {
        const double to = clear + clear_step;
        if (std::max(clear, to) > 2.0 * std::min(clear, to)) {
            const double a = clear * std::log(clear), b = to * std::log(to);
            plain = 1.0 - (b - a) / clear_step;
            weighted = (0.25 * clear_step * (to + clear) - 0.5 * (to * b - clear * a) + clear * (b - a - clear_step)) /
                       (clear_step * clear_step);
            return;
        }
        constexpr double places[] = {0.425562830509184395, 0.283302302935376405, 0.160295215850487797,
                                     0.0674683166555077446, 0.0130467357414141399};
        constexpr double shares[] = {0.147762112357376435, 0.134633359654998178, 0.109543181257991022,
                                     0.0747256745752902966, 0.0333356721543440688};
        for (int n = 0; n < 5; ++n) {
            for (const double x : {places[n], 1.0 - places[n]}) {
                const double a = opacity + opacity_step * x;
                const double tau = a < 0.5 ? -std::log1p(-a) : -std::log(clear + clear_step * x);
                plain += shares[n] * tau;
                weighted += shares[n] * tau * x;
            }
        }
    }
};

template <class T>
RampTable<T> make_ramps(const TransferFunction& function, double value_unit) {
    RampTable<T> table;
    table.stretches = ramps_of<T>(points_in<T>(function, value_unit));
    if (table.stretches.size() <= RampTable<T>::most_to_walk) {
        return table;
    }
    constexpr auto record = static_cast<std::size_t>(RampTable<T>::record);
    const std::size_t count = table.stretches.size();
    table.records.assign((count + 1) * record, T(0));
    std::vector<T> starts;
    long double sums[4] = {};
    for (std::size_t n = 0; n < count; ++n) {
        const RampStretch<T>& s = table.stretches[n];
        starts.push_back(s.from);
        T* out = table.records.data() + n * record;
        const T numbers[] = {s.from,      s.to,
                             s.per_width, T(0),
                             s.opacity,   s.opacity_step,
                             s.clearness, s.clearness_step,
                             s.color[0],  s.color_step[0],
                             s.color[1],  s.color_step[1],
                             s.color[2],  s.color_step[2]};
        std::copy(std::begin(numbers), std::end(numbers), out);
        for (std::size_t k = 0; k < 4; ++k) {
            out[14 + 2 * k] = static_cast<T>(sums[k]);
            out[15 + 2 * k] = static_cast<T>(sums[k] - static_cast<long double>(out[14 + 2 * k]));
        }
        // The outermost stretches have no end: no ramp goes all through them.
        if (n > 0 && n + 1 < count) {
            const StretchMeans means(static_cast<double>(s.opacity), static_cast<double>(s.opacity_step),
                                     static_cast<double>(s.clearness), static_cast<double>(s.clearness_step));
            const double width = static_cast<double>(s.to) - static_cast<double>(s.from);
            sums[0] += width * means.plain;
            for (std::size_t c = 0; c < 3; ++c) {
                sums[c + 1] += width * (static_cast<double>(s.color[c]) * means.plain +
                                        static_cast<double>(s.color_step[c]) * means.weighted);
            }
        }
    }
    table.cells = make_cells(starts, RampTable<T>::record);
    return table;
}

template <class T>
void add_lights(const Scene& scene, const Camera& camera, const DrawPlan& plan, Shading<T>& shading) {
    const Material& material = scene.material;
    shading.gray = true;
    for (const Light& light : scene.lights) {
        // Scaled first: the length of a direction may be beyond float64's squares.
        const Vec3 size = glm::abs(light.direction);
        const Vec3 scaled = light.direction / std::max({size.x, size.y, size.z});
        const Vec3 unit = glm::normalize(scaled);
        const Vec3 eye = light.space == LightSpace::world ? glm::normalize(camera.direction_to_eye(unit)) : unit;
        ShadingLight<T> made;
        for (int c = 0; c < 3; ++c) {
            made.direction[c] = static_cast<T>(eye[c]);
            made.diffuse[c] = number<T>(light.color[c] * material.diffuse);
            made.specular[c] = number<T>(light.color[c] * material.specular);
        }
        shading.gray = shading.gray && light.color.x == light.color.y && light.color.y == light.color.z;
        shading.lights.push_back(made);
    }
    shading.ambient = number<T>(material.ambient);
    shading.shininess = static_cast<T>(std::min(material.shininess, 1e30));
    shading.specular = plan.specular;
    shading.two_sided = plan.two_sided;
}

/// A point on a plane is kept however its coordinates are rounded: in slice distances (conventions, section 10).
constexpr double on_a_plane = 1e-6;

std::vector<KeptHalfSpace> kept_of(const Clip& clip, const Camera& camera, double slice_spacing) {
    std::vector<KeptHalfSpace> kept;
    for (const Clip::Plane& plane : clip.half_spaces()) {
        // Scaled first: the length of a normal may be beyond float64's squares.
        const Vec3 size = glm::abs(plane.normal);
        const double largest = std::max({size.x, size.y, size.z});
        const Vec3 scaled = plane.normal / largest;
        const double length = glm::length(scaled);
        const Vec3 normal = scaled / length;
        kept.push_back({Vec3(glm::dot(normal, camera.right_world()), glm::dot(normal, camera.up_world()),
                             glm::dot(normal, camera.back_world())),
                        glm::dot(normal, camera.eye()) - plane.offset / largest / length + on_a_plane * slice_spacing});
    }
    return kept;
}

VolumeLookup lookup_of(const LightVolume& volume, const Camera& camera, const Frame& frame) {
    VolumeLookup lookup;
    lookup.volume = &volume;
    const auto along = [&](const Vec3& direction) {
        return Vec3(glm::dot(direction, volume.per_step[0]), glm::dot(direction, volume.per_step[1]),
                    glm::dot(direction, volume.per_step[2]));
    };
    // Pixel (i, j) looks along ((i - axis_x) right + (axis_y - j) up) pixel - back.
    lookup.by_column = frame.pixel * along(camera.right_world());
    lookup.by_row = -frame.pixel * along(camera.up_world());
    const Vec3 corner =
        -0.5 * (frame.size.width - 1) * lookup.by_column - 0.5 * (frame.size.height - 1) * lookup.by_row;
    lookup.constant = along(camera.eye() - volume.origin);
    lookup.by_depth = -along(camera.back_world());
    (frame.projection == Projection::perspective ? lookup.by_depth : lookup.constant) += corner;
    return lookup;
}

template <class T>
void add_effects(const Scene& scene, const Camera& camera, const Frame& frame, const DrawPlan& plan,
                 const LightVolumes* volumes, Shading<T>& shading) {
    shading.clip = plan.clip;
    if (plan.clip) {
        shading.kept = kept_of(scene.clip, camera, frame.slice_spacing);
    }
    shading.second_order = plan.second_order && plan.preintegration;
    shading.analytic_gradient = plan.analytic_gradient && plan.gradient;
    shading.gradient_opacity = plan.gradient_opacity;
    if (plan.gradient_opacity) {
        shading.full_gradient = *scene.gradient_opacity / plan.value_unit * frame.reference_length;
    }
    shading.depth_cue = plan.depth_cue;
    if (plan.depth_cue) {
        const DepthCue& cue = *scene.depth_cue;
        shading.cue_start = cue.start;
        shading.cue_per_depth = 1.0 / std::max(cue.end - cue.start, std::numeric_limits<double>::min());
        shading.cue_strength = static_cast<T>(cue.strength);
        for (int c = 0; c < 3; ++c) {
            shading.cue_color[c] = number<T>(cue.color[c]);
        }
    }
    shading.shadows = plan.shadows && volumes != nullptr;
    if (shading.shadows) {
        for (const auto& volume : volumes->lights) {
            shading.shadow_of.push_back(volume ? lookup_of(*volume, camera, frame) : VolumeLookup{});
        }
        shading.shadow_of.resize(scene.lights.size());
    }
    shading.occlusion = plan.ambient_occlusion && volumes != nullptr && volumes->openness != nullptr;
    if (shading.occlusion) {
        shading.openness = lookup_of(*volumes->openness, camera, frame);
        shading.occlusion_strength = static_cast<T>(scene.ambient_occlusion->strength);
    }
    shading.by_effects = shading.clip || shading.second_order || shading.analytic_gradient ||
                         shading.gradient_opacity || shading.depth_cue || shading.shadows || shading.occlusion;
}

} // namespace

template <class T>
TransferTable<T> make_transfer_table(const TransferFunction& function, double value_unit) {
    constexpr int record = TransferTable<T>::record;
    const std::vector<Stretch<T>> stretches = stretches_of<T>(points_in<T>(function, value_unit));
    TransferTable<T> table;
    table.stretches = static_cast<int>(stretches.size());
    table.records.assign(stretches.size() * record, T(0));
    for (std::size_t n = 0; n < stretches.size(); ++n) {
        const Stretch<T>& s = stretches[n];
        const double width = s.to.value - s.from.value;
        const auto slope = [&](double from, double to) { return s.constant ? T(0) : factor<T>((to - from) / width); };
        T* out = table.records.data() + n * record;
        out[0] = static_cast<T>(s.from.value);
        out[1] = static_cast<T>(s.to.value);
        out[2] = static_cast<T>(s.from.opacity);
        out[3] = slope(s.from.opacity, s.to.opacity);
        for (int c = 0; c < 3; ++c) {
            out[4 + 2 * c] = number<T>(s.from.color[c]);
            out[5 + 2 * c] = slope(s.from.color[c], s.to.color[c]);
        }
        for (std::size_t k = 0; k < TransferTable<T>::numbers && n < TransferTable<T>::most_in_lanes; ++k) {
            table.lanes[k][n] = out[k];
        }
    }
    find_limits(stretches, table);
    std::vector<T> starts;
    for (const Stretch<T>& s : stretches) {
        starts.push_back(static_cast<T>(s.from.value));
    }
    table.cells = make_cells(starts, record);
    return table;
}

template <class T>
Shading<T> make_shading(const Scene& scene, const Camera& camera, const Frame& frame, const DrawPlan& plan,
                        const LightVolumes* volumes) {
    Shading<T> shading;
    shading.mode = plan.mode;
    shading.perspective = frame.projection == Projection::perspective;
    shading.preintegration = plan.preintegration;
    shading.empty_test = plan.empty_test;
    shading.correct = plan.opacity_correction;

    // An opacity above 0 becomes 1 far below these; infinity times an opacity of 0 would be no number.
    shading.exponent = static_cast<T>(std::min(frame.slice_spacing / frame.reference_length, 1e30));
    // A stop that rounds to 0 must still let an empty pixel go on. At opacity 1 nothing changes any more.
    shading.stop = plan.mode == Mode::isosurface ? T(0.5)
                   : plan.stop ? std::max(static_cast<T>(scene.opacity_stop), std::numeric_limits<T>::min())
                               : T(1);
    shading.scalar_step = number<T>(scalar_unit(plan.mode, plan.value_unit, frame.slice_spacing));
    shading.coverage_step = number<T>(frame.slice_spacing);

    const TransferFunction& function = scene.transfer_function;
    if (plan.mode == Mode::composite) {
        shading.transfer = make_transfer_table<T>(function, plan.value_unit);
        if (plan.preintegration) {
            shading.ramps = make_ramps<T>(function, plan.value_unit);
        }
    } else if (plan.mode == Mode::isosurface) {
        const TransferPoint at = function.at(*scene.iso_value);
        shading.iso_value = number<T>(*scene.iso_value / plan.value_unit);
        for (int c = 0; c < 3; ++c) {
            shading.iso_color[c] = number<T>(at.color[c]);
        }
    }
    shading.gradient = plan.gradient;
    shading.lit = plan.lit && plan.gradient;
    if (shading.lit) {
        add_lights(scene, camera, plan, shading);
    }
    if (plan.gradient) {
        shading.gradient_across = 0.5 * frame.reference_length / frame.pixel;
        shading.gradient_along = 0.5 * frame.reference_length / frame.slice_spacing;
        shading.weakest_gradient = 1e-3 * (function.v_max() - function.v_min()) / plan.value_unit;
    }

    shading.first_depth = frame.first_depth;
    shading.slice_spacing = frame.slice_spacing;
    shading.axis_x = 0.5 * (frame.size.width - 1);
    shading.axis_y = 0.5 * (frame.size.height - 1);
    shading.pixel = frame.pixel;
    add_effects(scene, camera, frame, plan, volumes, shading);
    return shading;
}

template TransferTable<float> make_transfer_table<float>(const TransferFunction&, double);
template TransferTable<double> make_transfer_table<double>(const TransferFunction&, double);
template Shading<float> make_shading<float>(const Scene&, const Camera&, const Frame&, const DrawPlan&,
                                            const LightVolumes*);
template Shading<double> make_shading<double>(const Scene&, const Camera&, const Frame&, const DrawPlan&,
                                              const LightVolumes*);

} // namespace sheetsplat::backend_cpu

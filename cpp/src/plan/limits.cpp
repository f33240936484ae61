// The table of limits. Numbers were found by measurement against backend reference, unless they are those of a format.
// "seen at 1e-3 at 300": where the quantity was 300, an error of 1e-3 was measured; P99.9: the 99.9th percentile over
// the pixels of the largest channel difference. Tests: test_limits.py draws a picture on each side of each.
#include "limits.hpp"

#include <algorithm>
#include <cmath>

#include "facts/crowd.hpp"
#include "parts.hpp"
#include "plan/limits_gl.hpp"
#include "plan/tells_empty.hpp"
#include "scene/mode_rules.hpp"

namespace sheetsplat {

namespace {

constexpr auto most = Limit::Sense::most;
constexpr auto least = Limit::Sense::least;

bool deep(const Measures& m) { return m.plan.projection == Projection::perspective; }
bool in_slabs(const Measures& m) { return m.plan.sampling == Sampling::slab; }
double times_of(const SumFacts& sums) { return std::max(1.0, sums.ratio); }
double count(std::size_t number) { return static_cast<double>(number); }

/// Error of a picture that sums add, root mean square. Errors of single slices partly cancel along a ray; what a steep
/// ramp adds, it adds at few pixels.
double picture_error(const Measures& m) {
    return 0.25 * m.epsilon * std::sqrt(m.sums.overlap) * m.sums.ratio * std::min(m.sums.steepness, 4.0);
}

/// What rounding makes of a gradient of 0, over the g1 of gradient opacity.
double faded(const Measures& m) {
    if (!m.plan.gradient_opacity) {
        return none;
    }
    double rho = largest_rho(m.scene, m.view);
    for (const Group& group : m.scene.groups()) {
        rho = std::max(rho, group.transfer_function->v_max() - group.transfer_function->v_min());
    }
    return m.epsilon * std::sqrt(std::max(1.0, m.sums.overlap)) * rho / m.view.frame.smallest_step() /
           *m.scene.gradient_opacity;
}

/// Half a field's extent over its smallest semi-axis.
double extent_of_ellipsoids(const Measures& m) {
    double largest = 0.0;
    for (const auto& field : m.scene.fields) {
        if (const EllipsoidField* ellipsoids = as_ellipsoids(field.get())) {
            const Vec3 extent = ellipsoids->centres_world().extent();
            largest = std::max(largest, 0.5 * std::max({extent.x, extent.y, extent.z}) / ellipsoids->scale_range()[0]);
        }
    }
    // Centres that are moved in float32 lose four times as much.
    return m.device->at_least(4, 0) ? largest : 4.0 * largest;
}

/// What means over slabs lose of ellipsoids that are far thinner than a slab, over what is seen.
double lost_in_slabs(const Measures& m) {
    const double unit = traits_of(m.plan.mode).integrates ? m.view.frame.slice_spacing : 1.0;
    const double seen = is_scalar(m.plan.mode) ? std::max(1.0, unit * m.view.slabs.ellipsoids.peak) : m.sums.resolved;
    return unit * m.view.slabs.ellipsoids.loss / seen * std::min(m.sums.steepness, 4.0);
}

std::string with(std::string text, const std::string& place, double value) {
    const std::size_t at = text.find(place);
    return at == std::string::npos ? text : text.replace(at, place.size(), number(value));
}

Beyond beyond_of(const Limit& limit, const Measures& measures, double value, double end) {
    const std::string text = limit.found;
    const std::size_t word = text.rfind(' ', text.find("{}"));
    return {
        &limit,
        with(with(with(text, "{}", value), "{largest}", measures.sums.largest), "{resolved}", measures.sums.resolved),
        (limit.sense == Limit::Sense::most ? "at most " : "at least ") +
            with(text.substr(word == std::string::npos ? 0 : word + 1), "{}", end)};
}

} // namespace

const std::vector<Limit>& limits() {
    //                          float32, float64, sheets, OpenGL 3.3, papers
    static const std::vector<Limit> table{
        // ---- numbers of things that programs and buffers hold: layers of sheets, bits, uniforms, look-ups a point
        {"groups",
         most,
         {none, none, 16, none, 1},
         "{} transfer functions",
         "give more fields one transfer function",
         [](const Measures& m) { return count(groups_drawn(m.scene).size()); },
         true},
        {"surfaces",
         most,
         {none, none, 32, none, none},
         "iso values times transfer functions: {} surfaces",
         "use fewer iso values",
         [](const Measures& m) {
             return shows_surfaces(m.plan.mode)
                        ? count(groups_drawn(m.scene).size() * std::max<std::size_t>(m.scene.iso_values.size(), 1))
                        : none;
         },
         true},
        {"lights",
         most,
         {none, none, 64, none, none},
         "{} lights",
         "use fewer lights",
         [](const Measures& m) { return count(m.scene.lights.size()); },
         true},
        {"shadowing_lights",
         most,
         {none, none, 16, none, none},
         "{} lights with shadows",
         "use fewer lights, or leave out " + option_ref("shadows"),
         [](const Measures& m) { return m.plan.shadows ? count(m.scene.lights.size()) : none; },
         true},
        {"light_elements",
         least,
         {none, none, static_cast<double>(most_light_elements_of_all), none, none},
         "shadows or ambient occlusion on a device whose buffer textures hold {} texels",
         "",
         [](const Measures& m) {
             return m.plan.shadows || m.plan.ambient_occlusion ? static_cast<double>(m.device->max_buffer_texels)
                                                               : none;
         },
         true},
        {"resident_kernels",
         most,
         {none, none, none, none, count(gl_limits::most_resident_kernels)},
         "one field of {} kernels",
         "",
         [](const Measures& m) { return count(m.view.kernels.most_ellipsoids); },
         true},

        // ---- sizes and places
        // Errors of 2e-6 at 28,000 slices, 4e-5 at 280,000, 6e-4 at 1,750,000. OpenGL 4.0 allows compensated sums.
        {"slices",
         most,
         {count(most_plain_slices), none, none, 1 << 17, none},
         "a composite of {} slices",
         "use a larger " + option_ref("slice_spacing"),
         [](const Measures& m) {
             return is_composited(m.plan.mode) ? static_cast<double>(m.view.frame.slices) : none;
         }},
        // Sections in float32 are known to epsilon times the aspect.
        {"aspect",
         most,
         {512, none, none, 32768, 1024},
         "ellipsoids of 1:{}",
         "pass " + option_ref("min_scale", "...") + " to the field",
         [](const Measures& m) { return m.view.shapes.largest_aspect; }},
        // Places are counted from the corner of a tile, and known to 4e-6 pixels; of sheets at 1e-5 seen at 1e-2
        // (P99.9).
        {"smallest_px",
         least,
         {0.05, none, none, 1e-4, gl_limits::least_plain_px},
         "kernels of a semi-axis of {} pixels",
         "pass " + option_ref("min_scale", "...") + " to the field, or use " + option_ref("filter", "ewa"),
         [](const Measures& m) { return m.plan.filter ? none : m.view.screen_px.smallest; }},
        {"placed_px",
         most,
         {none, largest_splat_px, largest_splat_px, none, 1e7},
         "kernels of a radius of {} pixels",
         "magnify less",
         [](const Measures& m) { return deep(m) ? m.view.screen_px.largest_lattice : m.view.screen_px.largest(); }},
        // At 1e21 squares leave float32.
        {"deep_px",
         most,
         {1e15, none, 1e15, none, none},
         "ellipsoids of a semi-axis of {} pixels at a distance of one unit of length",
         "use a larger unit of length",
         [](const Measures& m) { return deep(m) ? m.view.screen_px.largest_ellipsoid_at_unit : none; }},
        {"place",
         most,
         {none, none, 1e-3, none, none},
         "kernels whose places on the screen are known to {} radii",
         "move the camera closer",
         [](const Measures& m) {
             const double known = std::max(m.view.frame.size.width, m.view.frame.size.height) * float32_epsilon;
             return m.view.screen_px.largest_lattice > 0.0 ? known / m.view.screen_px.largest_lattice : none;
         }},
        // Squares of lengths are numbers of the format.
        {"unit",
         most,
         {1e15, none, none, none, none},
         "a perspective view in slices of {} units, or as many slices a unit",
         "",
         [](const Measures& m) {
             const double unit = m.view.frame.slice_spacing;
             return deep(m) ? std::max(unit, 1.0 / unit) : none;
         }},
        // Centres in float32 are known to 6e-8 of the extent: errors of 4e-8 times the quotient.
        {"extent",
         most,
         {none, none, none, none, 2048},
         "a field that reaches {} times a semi-axis from its centre",
         "",
         extent_of_ellipsoids},

        // ---- profiles
        // exp(-k r^2) - exp(-k) is a difference of nearly equal numbers.
        {"falloff",
         least,
         {0.05, 1e-8, 0.05, none, none},
         "a falloff of {}",
         "use a larger " + option_ref("falloff"),
         [](const Measures& m) { return m.view.shapes.smallest_falloff; }},
        // Where kernels end: exp(-k) must be a number of the format, with digits of float32 to spare.
        {"steepest_falloff",
         most,
         {20, 600, 80, none, none},
         "empty points beside kernels of a falloff of {}",
         "use a smaller " + option_ref("falloff") + ", or an opacity of 0 at 0",
         [](const Measures& m) { return tells_empty(m.plan) ? steepest_falloff(m.scene) : none; }},
        {"paper_falloff",
         most,
         {none, none, none, none, 32},
         "a texture of a Gaussian of a falloff of {}",
         "use a smaller " + option_ref("falloff"),
         [](const Measures& m) { return steepest_falloff(m.scene); },
         true},
        // Differences of erf lose what a thin kernel adds: at 370 seen at 1.2e-4 (RMSE).
        {"thickest_slab",
         most,
         {100, none, none, none, none},
         "rays through slabs of {} half-depths of a kernel",
         "",
         [](const Measures& m) { return in_slabs(m) ? m.view.slabs.thickest : none; }},
        {"lost_in_slabs",
         most,
         {none, none, thick_slab, none, none},
         "float32 loses the place of ellipsoids in slabs of {} half-depths",
         "use a smaller " + option_ref("slice_spacing") + " or " + option_ref("filter", "ewa"),
         [](const Measures& m) { return in_slabs(m) && !m.plan.filter ? lost_in_slabs(m) : none; }},
        // Of x-rays seen at 6e-5 (RMSE, of the largest value) at 97, 2.7e-4 at 584.
        {"slant",
         most,
         {none, none, 100, none, none},
         "rays that go through a slab on {} times its thickness",
         "use a smaller " + option_ref("fov_y") + ", or leave out " + option_ref("sampling", "slab"),
         [](const Measures& m) {
             return in_slabs(m) && is_scalar(m.plan.mode) && !m.plan.filter
                        ? std::min(m.view.frame.largest_slant, m.view.slabs.thickest)
                        : none;
         }},

        // ---- sums
        {"sum",
         most,
         {1e30, 1e250, 1e36, none, none},
         "sums of weights, or of weighted values over what is resolved, of up to {}",
         "scale the values or the weights",
         [](const Measures& m) {
             const double shown =
                 is_scalar(m.plan.mode) ? scalar_unit(m.plan.mode, m.plan.value_unit, m.view.frame.slice_spacing) : 0.0;
             return std::max(m.sums.sum, shown);
         }},
        {"divisor",
         least,
         {none, least_divisor, least_divisor, none, none},
         "weights and a w0 of {}",
         "scale the weights and " + option_ref("w0") + " by one factor",
         [](const Measures& m) { return m.sums.least_scale; }},
        {"ratio",
         most,
         {float32_bound, float32_bound, float32_bound, none, none},
         "values up to {largest}, of which the transfer function distinguishes {resolved}: an error of {}",
         "use a wider transfer function or " + option_ref("clim") + ", or subtract an offset from the values",
         picture_error},
        // Of sheets at 1e-4 windows a reference length seen at 7e-4 (P99.9).
        {"gradient_opacity",
         most,
         {1.7e-3, 1.7e-3, 1.7e-3, none, none},
         "a gradient_opacity of which the rounding of gradients makes {}",
         "use a larger " + option_ref("gradient_opacity"),
         faded},
        {"nearest_end",
         most,
         {1e6, none, 1e6, none, none},
         "an iso value near the end of values that come to {} times the distance",
         "",
         [](const Measures& m) {
             return shows_surfaces(m.plan.mode) ? m.sums.ratio * m.sums.resolved / m.sums.nearest_end : none;
         }},
        // Kernels of one size at one place round alike, and errors grow as their number: at 10,000 of both signs seen
        // at 1.5e-4 (P99.9).
        {"alike",
         most,
         {1e4, none, 1e4, none, none},
         "ellipsoids of one size at one place: {}",
         "make one kernel of them",
         [](const Measures& m) { return m.view.overlap.alike * times_of(m.sums); }},
        // Where W is w0: at 1e3 seen at 2e-5, at 1e4 at 5e-4 (P99.9), lit at 340 at 2e-3; in float64 at 4e16 at 3e-3.
        {"weights_in_slabs",
         most,
         {300, 1e15, none, none, none},
         "means over slabs with weights of {} times w0",
         "use a larger " + option_ref("w0") + ", or leave out " + option_ref("sampling", "slab"),
         [](const Measures& m) { return weights_in_slabs(m.plan.sampling, m.sums); }},
        // Over the bound of 1e-4: of an average seen at 7e-5 (RMSE) at 7.7e5, of a plain picture at 2.4e-5 at 1.9e5.
        {"crowded_weights_in_slabs",
         most,
         {none, none, 3e5, none, none},
         "means over slabs with weights of {} times w0 at a point",
         "use a larger " + option_ref("w0") + ", or leave out " + option_ref("sampling", "slab"),
         [](const Measures& m) {
             return weights_in_slabs(m.plan.sampling, m.sums) * m.sums.crowd *
                    (bound_of(m.view, m.sums) == gentle_bound ? 2.0 : 1.0);
         }},
    };
    return table;
}

std::optional<Beyond> first_beyond(const Measures& measures, Way way, bool counts_alone) {
    const bool empty = measures.view.kernels.all == 0 || measures.view.frame.slices == 0;
    for (const Limit& limit : limits()) {
        const double end = limit.ends[static_cast<std::size_t>(way)];
        if (std::isnan(end) || ((counts_alone || empty) && !limit.counted)) {
            continue;
        }
        const double value = limit.measure(measures);
        if (!limit.keeps(value, way)) {
            return beyond_of(limit, measures, value, end);
        }
    }
    return std::nullopt;
}

void refuse_beyond(const Measures& measures, Way way, bool allow_inexact) {
    if (const std::optional<Beyond> beyond = first_beyond(measures, way, allow_inexact)) {
        const std::string backend = way == Way::float64 ? "cpu" : "gl";
        Words advice = beyond->limit->advice;
        if (!beyond->limit->counted) {
            advice += (advice.empty() ? "pass " : ", or pass ") + option_ref("allow_inexact", "true");
        }
        throw Unsupported(
            Complaint{(beyond->limit->counted ? "the scene cannot be drawn with backend "
                                              : "the scene cannot be drawn within its error bound with backend ") +
                          backend + (way == Way::papers ? " and effect paper_slicing" : "") +
                          (way == Way::old_sheets ? " on OpenGL " + measures.device->version : ""),
                      beyond->found, beyond->wanted, advice});
    }
}

} // namespace sheetsplat

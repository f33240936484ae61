#include "cost_model.hpp"

#include <algorithm>
#include <cmath>

#include "scene/mode_rules.hpp"

namespace sheetsplat {

namespace {

constexpr double pi = 3.14159265358979323846;
/// Seconds a kernel that is looked at, one that reaches a pixel, a section of it, a pixel of a section, and a pixel of
/// a slice that is shaded, in vectors of 8 to 16 numbers on one thread.
constexpr double look_seconds = 8e-9;
constexpr double place_seconds = 40e-9;
constexpr double section_seconds = 35e-9;
constexpr double splat_seconds = 0.4e-9;
constexpr double shade_seconds = 2e-9;
/// Prices as measured on two processors with AVX-512, one thread. Slabs: a lattice in an orthographic view is a product
/// of rows and columns with point sampling alone.
constexpr double slab_of_product = 60.0;
constexpr double slab_of_others = 18.0;
constexpr double lit_price = 1.8;
constexpr double first_order_price = 1.4;
constexpr double second_order_price = 2.6;
constexpr double float64_price = 1.7;
/// Seconds that every picture takes.
constexpr double least_seconds = 3e-4;

/// Sum of the volumes of all supports.
double volume_of(const Field& field, const ViewFacts& view) {
    if (const RegularField* regular = as_regular(&field)) {
        return static_cast<double>(field.size()) * 4.0 / 3.0 * pi * regular->kernel_axes().volume();
    }
    const Vec3 box = field.supports_world().extent();
    return view.overlap.typical * box.x * box.y * box.z;
}

} // namespace

Work work_of(const Scene& scene, const ViewFacts& view) {
    Work work;
    double sections = 0.0, radii = 0.0;
    const double pixel = std::sqrt(view.frame.smallest_pixel * view.frame.largest_pixel);
    for (const auto& field : scene.fields) {
        if (field->size() == 0) {
            continue;
        }
        const auto kernels = static_cast<double>(field->size());
        const double volume = volume_of(*field, view);
        const double radius = std::cbrt(volume / kernels * 3.0 / (4.0 * pi));
        work.kernels += kernels;
        sections += kernels * 2.0 * radius / view.frame.slice_spacing;
        radii += kernels * radius / pixel;
        work.splats += volume / view.frame.slice_spacing / (pixel * pixel);
    }
    if (work.kernels > 0.0) {
        work.slices_each = sections / work.kernels;
        work.radius_px = radii / work.kernels;
    }
    work.pixels = static_cast<double>(view.frame.size.width) * static_cast<double>(view.frame.size.height) *
                  static_cast<double>(view.frame.slices);
    // No kernel covers more than the picture.
    work.splats = std::min(work.splats, work.kernels * work.pixels);
    return work;
}

void set_prices(Work& work, const Scene& scene, Projection projection, bool float64) {
    bool product = projection == Projection::orthographic;
    for (const auto& field : scene.fields) {
        product = product && as_regular(field.get()) != nullptr;
    }
    work.splat_price = scene.sampling == Sampling::point ? 1.0 : product ? slab_of_product : slab_of_others;
    work.shade_price = scene.second_order ? second_order_price : scene.preintegration ? first_order_price : 1.0;
    work.shade_price *= scene.lights.empty() ? 1.0 : lit_price;
    work.shade_price *= static_cast<double>(groups_drawn(scene).size());
    work.number_price = float64 ? float64_price : 1.0;
}

double expected_seconds(const Work& work, double larger_pixels, double larger_spacing, int threads,
                        double fewer_kernels) {
    const double fewer = larger_pixels * larger_pixels * larger_spacing;
    const double wider = std::cbrt(fewer_kernels);
    const double sections = std::max(1.0, wider * work.slices_each / larger_spacing);
    // Some kernels smaller than a pixel fall between pixels: with a radius of 3/8 pixel, 70 % do.
    const double radius = wider * work.radius_px / larger_pixels;
    const double met = std::min(1.0, 2.2 * radius * radius);
    const double seconds =
        work.kernels / fewer_kernels * (look_seconds + met * (place_seconds + section_seconds * sections)) +
        work.splats * work.splat_price * splat_seconds / fewer + work.pixels * work.shade_price * shade_seconds / fewer;
    return least_seconds + work.number_price * seconds / threads;
}

void Paces::note(Backend backend, bool coarse, double pace) {
    Pace& known = paces_[static_cast<std::size_t>(backend)][coarse ? 1 : 0];
    if (!known.timed) {
        known.recent.fill(pace);
    }
    known.recent = {known.recent[1], known.recent[2], pace};
    known.last = pace;
    known.timed = true;
}

double Paces::best(Backend backend) const {
    const Pace& pictures = at(backend, false);
    const Pace& known = pictures.timed || !at(backend, true).timed ? pictures : at(backend, true);
    // Other work on the machine only ever makes pictures slower.
    return known.timed ? *std::min_element(known.recent.begin(), known.recent.end()) : known.last;
}

} // namespace sheetsplat

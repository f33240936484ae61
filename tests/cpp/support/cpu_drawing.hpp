// Scenes for backend_cpu::CpuRenderer, with everything that it is handed: frame, plan, views, what is drawn. All
// kernels are drawn, visible or not; which ones can be left out is a matter of other layers.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <memory>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include <glm/geometric.hpp>

#include "backend_cpu/cpu_renderer.hpp"
#include "index/visible_runs.hpp"
#include "plan/make_plan.hpp"
#include "reference/reference.hpp"
#include "sheetsplat/image.hpp"
#include "support/lattices.hpp"
#include "view/ellipsoid_view.hpp"
#include "view/field_view.hpp"

namespace sheetsplat::test {

/// A picture that is asked for.
struct Shot {
    Scene scene;
    Camera camera;
    Size size{40, 34};
    Outputs outputs{};
};

struct DrawOptions {
    int tile_size = 0;
    int threads = 1;
    const Progress* progress = nullptr;
};

inline std::uint64_t next_version() {
    static std::uint64_t version = 0;
    return ++version;
}

/// A shot that is ready to be drawn, any number of times.
class CpuDrawing {
  public:
    CpuDrawing(Shot shot, Precision precision)
        : shot_(std::move(shot)), frame_(make_frame(shot_.scene, shot_.camera, shot_.size)) {
        const Scene& scene = shot_.scene;
        FieldSurveys surveys;
        ViewFacts facts = view_facts(scene, shot_.camera, frame_, surveys);
        facts.shapes.largest_filtering =
            std::numeric_limits<double>::infinity(); // a filter that is asked for is applied
        RendererOptions options;
        options.backend = Backend::cpu;
        options.precision = precision;
        // What a precision is good for is judged by the tests.
        options.allow_inexact = true;
        plan_ = make_plan(scene, facts, options, shot_.outputs, shot_.camera.projection(), Backend::cpu, nullptr);
        for (std::size_t field = 0; field < scene.fields.size(); ++field) {
            add(scene.fields[field], field);
        }
        for (std::size_t part = 0; part < views_.size(); ++part) {
            job_.regular.push_back({regular_[part], &views_[part], &runs_[part]});
        }
        for (std::size_t part = 0; part < ellipsoid_views_.size(); ++part) {
            job_.ellipsoids.push_back({scattered_[part].first, scattered_[part].second, &ellipsoid_views_[part],
                                       &visible_[part], next_version()});
        }
        job_.scene = &shot_.scene;
        job_.camera = &shot_.camera;
        job_.frame = &frame_;
        job_.plan = &plan_;
    }
    CpuDrawing(const CpuDrawing&) = delete;
    CpuDrawing& operator=(const CpuDrawing&) = delete;

    [[nodiscard]] backend_cpu::Job job_with(const DrawOptions& options) const {
        backend_cpu::Job job = job_;
        job.tile_size = options.tile_size;
        job.threads = options.threads;
        job.progress = options.progress;
        return job;
    }
    [[nodiscard]] Image draw(backend_cpu::CpuRenderer& renderer, const DrawOptions& options = {}) const {
        Image image;
        image.size = shot_.size;
        renderer.render(job_with(options), image);
        return image;
    }
    [[nodiscard]] Image draw(const DrawOptions& options = {}) const {
        backend_cpu::CpuRenderer renderer;
        return draw(renderer, options);
    }

    [[nodiscard]] const Shot& shot() const { return shot_; }
    [[nodiscard]] const Frame& frame() const { return frame_; }
    [[nodiscard]] const DrawPlan& plan() const { return plan_; }
    [[nodiscard]] const backend_cpu::Job& job() const { return job_; }

  private:
    [[nodiscard]] Filter filter() const { return plan_.filter ? Filter::ewa : Filter::none; }
    void add(const std::shared_ptr<const Field>& field, std::size_t number) {
        if (const RegularField* lattice = as_regular(field.get())) {
            VisibilityQuery query;
            query.cull = false;
            regular_.push_back(number);
            runs_.push_back(VisibleRuns::of(*lattice, query));
            views_.push_back(
                make_field_view(*lattice, shot_.camera, frame_, shot_.scene.sampling, plan_.unit_of(number), filter()));
            return;
        }
        auto kernels = std::static_pointer_cast<const EllipsoidField>(field);
        visible_.emplace_back(kernels->size(), std::uint8_t{1});
        ellipsoid_views_.emplace_back(*kernels, shot_.camera, frame_, shot_.scene.sampling, filter(),
                                      plan_.unit_of(number), 1.0);
        scattered_.emplace_back(number, std::move(kernels));
    }

    Shot shot_;
    Frame frame_;
    DrawPlan plan_;
    std::vector<std::size_t> regular_;
    std::vector<VisibleRuns> runs_;
    std::vector<FieldView> views_;
    std::vector<std::pair<std::size_t, std::shared_ptr<const EllipsoidField>>> scattered_;
    std::vector<EllipsoidView> ellipsoid_views_;
    std::vector<std::vector<std::uint8_t>> visible_;
    backend_cpu::Job job_;
};

/// What a pixel without a number is compared as: no other pixel has this value.
constexpr double no_number = -3.0;

template <class T>
std::vector<T> without_nan(std::vector<T> pixels) {
    std::replace_if(
        pixels.begin(), pixels.end(), [](T value) { return std::isnan(value); }, static_cast<T>(no_number));
    return pixels;
}

/// Colour or scalar, whichever there is.
inline std::vector<float> pixels_of(const Image& image) {
    return without_nan(image.rgba.empty() ? image.scalar : image.rgba);
}
inline std::vector<double> pixels_of(const reference::Picture& picture) {
    return without_nan(picture.rgba.empty() ? picture.scalar : picture.rgba);
}

/// Root mean square and largest difference; of scalar pictures over max(1, largest of the second).
struct Distance {
    double rms = 0.0, most = 0.0;
};
template <class A, class B>
Distance distance(const std::vector<A>& a, const std::vector<B>& b, bool scalar,
                  const std::vector<unsigned char>* left_out = nullptr) {
    Distance result;
    if (a.size() != b.size() || a.empty()) {
        return {std::numeric_limits<double>::infinity(), std::numeric_limits<double>::infinity()};
    }
    const std::size_t channels = left_out != nullptr ? a.size() / left_out->size() : 1;
    double sum = 0.0, unit = 1.0;
    for (std::size_t n = 0; n < a.size(); ++n) {
        if (left_out != nullptr && (*left_out)[n / channels] != 0) {
            continue;
        }
        const auto x = static_cast<double>(a[n]), y = static_cast<double>(b[n]);
        unit = scalar && std::isfinite(y) ? std::max(unit, std::abs(y)) : unit;
        const double off = x == y ? 0.0 : std::isfinite(x - y) ? std::abs(x - y) : 1e30;
        sum += off * off;
        result.most = std::max(result.most, off);
    }
    result.rms = std::sqrt(sum / static_cast<double>(a.size())) / unit;
    result.most /= unit;
    return result;
}
inline Distance distance(const Image& image, const reference::Picture& picture,
                         const std::vector<unsigned char>* left_out = nullptr) {
    return distance(pixels_of(image), pixels_of(picture), picture.rgba.empty(), left_out);
}
inline Distance distance(const Image& image, const Image& other) {
    return distance(pixels_of(image), pixels_of(other), other.rgba.empty());
}

inline reference::Picture reference_of(const Shot& shot) {
    reference::Request request;
    request.coverage = shot.outputs.coverage;
    request.depth = shot.outputs.depth;
    return reference::render(shot.scene, shot.camera, shot.size, request);
}

inline double largest(const std::vector<double>& values) {
    double most = 0.0;
    for (const double value : values) {
        most = std::isfinite(value) ? std::max(most, std::abs(value)) : most;
    }
    return most;
}

// Scenes --------------------------------------------------------------------------------------------------------------

/// A soft ball with bumps, values 0 to 1.
inline std::shared_ptr<const RegularField> ball(std::size_t n,
                                                const RegularFieldOptions& options = test::zero_boundary()) {
    std::vector<float> samples(n * n * n);
    for (std::size_t k = 0; k < n; ++k) {
        for (std::size_t j = 0; j < n; ++j) {
            for (std::size_t i = 0; i < n; ++i) {
                const Vec3 at = 2.0 * Vec3(static_cast<double>(i), static_cast<double>(j), static_cast<double>(k)) /
                                    static_cast<double>(n - 1) -
                                1.0;
                const double bumps = 0.15 * std::sin(5.0 * at.x) * std::cos(4.0 * at.y + 1.0) * std::sin(3.0 * at.z);
                samples[(k * n + j) * n + i] =
                    static_cast<float>(std::clamp(1.0 - 0.9 * glm::dot(at, at) + bumps, 0.0, 1.0));
            }
        }
    }
    return std::make_shared<const RegularField>(std::move(samples), std::array<std::size_t, 3>{n, n, n}, options);
}

/// Kernels in the unit cube with the volume of balls of `radius`; aspect 1: spheres.
inline EllipsoidArrays cloud_arrays(std::size_t n, double radius, double aspect, unsigned seed = 5) {
    std::mt19937 random(seed);
    std::uniform_real_distribution<double> uniform(0.0, 1.0);
    std::normal_distribution<double> normal;
    EllipsoidArrays arrays;
    for (std::size_t i = 0; i < n; ++i) {
        const double x = uniform(random), y = uniform(random), z = uniform(random);
        arrays.centers.emplace_back(x, y, z);
        arrays.values.push_back(0.2 + 0.8 * uniform(random));
        if (aspect == 1.0) {
            arrays.radii.push_back(radius * (0.6 + 0.8 * uniform(random)));
            continue;
        }
        const double own = std::pow(aspect, 0.5 + 0.5 * uniform(random));
        Vec3 axes = i % 2 == 0 ? Vec3(own, 1.0, 1.0) : Vec3(own, own, 1.0);
        axes *= radius / std::cbrt(axes.x * axes.y * axes.z);
        arrays.scales.push_back(axes);
        const double a = normal(random), b = normal(random), c = normal(random), d = normal(random);
        arrays.rotations.push_back(glm::normalize(glm::dquat(a, b, c, d)));
    }
    return arrays;
}
inline std::shared_ptr<const EllipsoidField> cloud(std::size_t n, double radius, double aspect, unsigned seed = 5,
                                                   const EllipsoidFieldOptions& options = {}) {
    return std::make_shared<const EllipsoidField>(cloud_arrays(n, radius, aspect, seed), options);
}

inline TransferFunction gentle() {
    return TransferFunction({{0.05, {0.1, 0.2, 0.9}, 0.0}, {0.5, {0.2, 0.9, 0.3}, 0.08}, {1.0, {1.0, 0.8, 0.2}, 0.3}});
}
/// Opaque after a few slices.
inline TransferFunction dense() {
    return TransferFunction({{0.05, {0.1, 0.2, 0.9}, 0.0}, {0.3, {0.2, 0.9, 0.3}, 0.5}, {1.0, {1.0, 0.8, 0.2}, 0.9}});
}

/// Lit, without an end at A_stop.
inline Scene scene_of(std::vector<std::shared_ptr<const Field>> fields) {
    Scene scene{std::move(fields), gentle()};
    scene.lights = {Light{{0.3, 0.5, 1.0}, {1.0, 1.0, 1.0}, LightSpace::eye},
                    Light{{-0.8, 0.1, 0.2}, {0.2, 0.1, 0.3}, LightSpace::world}};
    scene.material = Material{0.2, 0.7, 0.3, 20.0, false};
    scene.iso_values = {0.45};
    scene.opacity_stop = 1.0;
    return scene;
}

inline Camera askew(const Field& field, Projection projection, double margin = 0.9) {
    return Camera::fit(field.supports_world(), Vec3(-0.5, -0.35, -0.8), Vec3(0, 1, 0), projection, margin, 40.0);
}
/// The eye is inside, so that the near plane cuts through the field.
inline Camera inside(const Field& field) {
    const Box box = field.supports_world();
    const Vec3 size = box.extent();
    return Camera::perspective(box.centre() + 0.2 * size * Vec3(0.6, 0.3, 1.0), box.centre(), Vec3(0, 1, 0), 70.0,
                               0.02 * size.x);
}

} // namespace sheetsplat::test

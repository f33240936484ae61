// Classification, shading and compositing of one slab, for every instruction set that was compiled and runs here,
// against a plain float64 statement of IMAGE FORMATION sections 4 to 7.
#include <cfenv>
#include <cmath>
#include <random>
#include <string>
#include <utility>

#include <glm/geometric.hpp>
#include <gtest/gtest.h>

#include "backend_cpu/instruction_set.hpp"
#include "plan/make_plan.hpp"

namespace sheetsplat::backend_cpu {
namespace {

template <class T>
using ShadeCall = void (*)(const Shading<T>&, const TileShape&, const SlabWindow<T>&, TilePicture<T>&);

template <class T>
struct Variant {
    const char* name;
    ShadeCall<T> call;
};

template <class T>
std::vector<Variant<T>> variants() {
    std::vector<Variant<T>> found;
    for (const InstructionSet set : usable_instruction_sets()) {
        found.push_back({to_string(set), tile_functions<T>(set)->shade});
    }
    return found;
}

class Random {
  public:
    explicit Random(unsigned seed) : engine_(seed) {}
    double uniform(double low, double high) { return std::uniform_real_distribution<double>(low, high)(engine_); }
    int whole(int low, int high) { return std::uniform_int_distribution<int>(low, high)(engine_); }
    bool chance(double p) { return uniform(0.0, 1.0) < p; }

  private:
    std::mt19937 engine_;
};

/// Exactly a float, so that both number formats start from the same.
double single(double value) { return static_cast<double>(static_cast<float>(value)); }

/// Floating-point exceptions stop the program while one lives.
class Traps {
  public:
    Traps() {
        std::feclearexcept(FE_ALL_EXCEPT);
#ifdef __GLIBC__
        feenableexcept(FE_INVALID | FE_DIVBYZERO | FE_OVERFLOW);
#endif
    }
    ~Traps() {
#ifdef __GLIBC__
        fedisableexcept(FE_ALL_EXCEPT);
#endif
        EXPECT_EQ(std::fetestexcept(FE_INVALID | FE_DIVBYZERO | FE_OVERFLOW), 0);
    }
    Traps(const Traps&) = delete;
    Traps& operator=(const Traps&) = delete;
};

// What a picture must be, pixel by pixel ------------------------------------------------------------------------------

using Exact = long double;

struct Looks {
    Vec3 color{0.0};
    double opacity = 0.0;
};

struct Pixel {
    Vec3 color{0.0};
    double alpha = 0.0, scalar = 0.0, depth = std::numeric_limits<double>::infinity(), coverage = 0.0;
};

struct Case {
    Scene scene{{}, TransferFunction({{0.0, Vec3(1.0), 0.0}, {1.0, Vec3(1.0), 1.0}})};
    Camera camera = Camera::orthographic({0.0, 0.0, 5.0}, {0.0, 0.0, 0.0}, {0.0, 1.0, 0.0}, 2.0);
    Frame frame;
    DrawPlan plan;
    TileShape shape;
    std::int64_t n = 0;
    Rect rect;
    std::vector<double> rho[4]; ///< in the sheets' unit, exactly floats
    std::vector<double> weight[2];
    std::vector<Pixel> before; ///< the picture so far, width times height
};

class Truth {
  public:
    explicit Truth(const Case& c) : c_(c) {}

    [[nodiscard]] Pixel pixel(int x, int y) const {
        Pixel p = c_.before[static_cast<std::size_t>(y) * static_cast<std::size_t>(c_.shape.width) +
                            static_cast<std::size_t>(x)];
        if (x < c_.rect.x0 || x >= c_.rect.x1 || y < c_.rect.y0 || y >= c_.rect.y1) {
            return p;
        }
        const double step = c_.frame.slice_spacing * secant(x, y);
        if (c_.plan.coverage && c_.n >= 0) {
            p.coverage += weight(0, x, y) * step;
        }
        if (c_.plan.mode == Mode::xray) {
            p.scalar += value(1, x, y) * step;
        } else if (c_.plan.mode == Mode::mip) {
            p.scalar = std::max(p.scalar, value(1, x, y));
        } else if (c_.plan.mode == Mode::isosurface) {
            cross(p, x, y);
        } else {
            composite(p, x, y, step / c_.frame.reference_length);
        }
        return p;
    }
    [[nodiscard]] bool alive(const Pixel& p) const {
        return c_.plan.mode == Mode::isosurface ? p.alpha == 0.0 : p.alpha < stop();
    }
    /// True where rounding may decide whether a pixel ends.
    [[nodiscard]] bool on_the_verge(const Pixel& p, double rounding) const {
        return c_.plan.mode == Mode::composite && std::abs(p.alpha - stop()) < rounding;
    }

  private:
    [[nodiscard]] double stop() const { return c_.plan.stop ? c_.scene.opacity_stop : 1.0; }
    [[nodiscard]] std::size_t at(int x, int y) const {
        return static_cast<std::size_t>(y + 1) * static_cast<std::size_t>(c_.shape.stride) +
               static_cast<std::size_t>(x + 1);
    }
    /// In world units. sheet: 1 is slice n.
    [[nodiscard]] double value(int sheet, int x, int y) const { return c_.rho[sheet][at(x, y)] * c_.plan.value_unit; }
    [[nodiscard]] double weight(int ahead, int x, int y) const { return c_.weight[ahead][at(x, y)]; }
    [[nodiscard]] bool perspective() const { return c_.frame.projection == Projection::perspective; }
    [[nodiscard]] Vec3 slope(int x, int y) const {
        if (!perspective()) {
            return Vec3(0.0);
        }
        return {(c_.shape.x + x + 0.5 - 0.5 * c_.frame.size.width) * c_.frame.pixel,
                (0.5 * c_.frame.size.height - (c_.shape.y + y + 0.5)) * c_.frame.pixel, 0.0};
    }
    [[nodiscard]] double secant(int x, int y) const {
        const Vec3 s = slope(x, y);
        return std::sqrt(1.0 + s.x * s.x + s.y * s.y);
    }
    [[nodiscard]] double depth(int ahead) const { return c_.frame.depth_of(c_.n + ahead); }

    [[nodiscard]] Looks look_up(double v) const {
        const auto& p = c_.scene.transfer_function.points();
        if (v < p.front().value) {
            return {p.front().color, p.front().opacity};
        }
        std::size_t last = 0;
        for (std::size_t n = 0; n < p.size(); ++n) {
            last = p[n].value <= v ? n : last;
        }
        if (last + 1 == p.size()) {
            return {p.back().color, p.back().opacity};
        }
        const double x = (v - p[last].value) / (p[last + 1].value - p[last].value);
        return {p[last].color + x * (p[last + 1].color - p[last].color),
                p[last].opacity + x * (p[last + 1].opacity - p[last].opacity)};
    }

    /// Places and weights of tanh-sinh quadrature on [0, 1].
    static const std::vector<std::pair<Exact, Exact>>& nodes() {
        static const std::vector<std::pair<Exact, Exact>> made = [] {
            constexpr Exact h = 1.0L / 16.0L, half_pi = 1.5707963267948966192L;
            std::vector<std::pair<Exact, Exact>> list;
            for (int k = -56; k <= 56; ++k) {
                const Exact s = std::sinh(k * h) * half_pi;
                list.emplace_back(0.5L + 0.5L * std::tanh(s),
                                  0.5L * h * half_pi * std::cosh(k * h) / (std::cosh(s) * std::cosh(s)));
            }
            return list;
        }();
        return made;
    }

    /// Means of tau l and tau l c over a ramp, by tanh-sinh quadrature between all the places where something bends.
    void ramp(double from, double to, double& mean, Vec3& color) const {
        constexpr double limit = 1.0 - 0x1p-24;
        const auto& p = c_.scene.transfer_function.points();
        std::vector<double> ends{from, to};
        const auto add = [&](double v) {
            if (v > from && v < to) {
                ends.push_back(v);
            }
        };
        for (std::size_t n = 0; n < p.size(); ++n) {
            add(p[n].value);
            if (n > 0 && (p[n].opacity > limit) != (p[n - 1].opacity > limit)) {
                add(p[n - 1].value +
                    (limit - p[n - 1].opacity) / (p[n].opacity - p[n - 1].opacity) * (p[n].value - p[n - 1].value));
            }
        }
        std::sort(ends.begin(), ends.end());
        Exact sum = 0.0L, sums[3] = {0.0L, 0.0L, 0.0L};
        if (from == to) {
            const Looks looks = look_up(from);
            mean = -std::log1p(-std::min(looks.opacity, limit));
            color = mean * looks.color;
            return;
        }
        for (std::size_t n = 0; n + 1 < ends.size(); ++n) {
            const double low = ends[n], high = ends[n + 1];
            if (!(high > low)) {
                continue;
            }
            // The two points around the piece; in extended arithmetic, as 1 - opacity may be small.
            std::size_t after = 0;
            while (after < p.size() && p[after].value <= 0.5 * (low + high)) {
                ++after;
            }
            const TransferPoint& from_point = p[after == 0 ? 0 : after - 1];
            const TransferPoint& to_point = p[std::min(after, p.size() - 1)];
            const Exact width = Exact(to_point.value) - from_point.value;
            for (const auto& [x, weight] : nodes()) {
                const Exact share = weight * (Exact(high) - low) / (Exact(to) - from);
                const Exact place =
                    width > 0.0L ? (low + x * (Exact(high) - low) - from_point.value) / width : Exact(0.0L);
                const auto mix = [&](double a, double b) { return a + place * (Exact(b) - a); };
                const Exact tau =
                    -std::log1p(-std::clamp(mix(from_point.opacity, to_point.opacity), Exact(0.0L), Exact(limit)));
                sum += share * tau;
                for (int channel = 0; channel < 3; ++channel) {
                    sums[channel] += share * tau * mix(from_point.color[channel], to_point.color[channel]);
                }
            }
        }
        mean = static_cast<double>(sum);
        color = {static_cast<double>(sums[0]), static_cast<double>(sums[1]), static_cast<double>(sums[2])};
    }

    [[nodiscard]] Vec3 gradient(int ahead, int x, int y) const {
        const double two = 2.0 * c_.frame.pixel * (perspective() ? depth(ahead) : 1.0);
        const int here = 1 + ahead;
        const double over_x = value(here, x + 1, y) - value(here, x - 1, y);
        const double over_y = value(here, x, y - 1) - value(here, x, y + 1);
        const double dx = over_x == 0.0 ? 0.0 : over_x / two, dy = over_y == 0.0 ? 0.0 : over_y / two;
        const double along = (value(here + 1, x, y) - value(here - 1, x, y)) / (2.0 * c_.frame.slice_spacing);
        const Vec3 s = slope(x, y);
        return {dx, dy, s.x * dx + s.y * dy - along};
    }

    [[nodiscard]] Vec3 shade(const Vec3& color, const Vec3& gradient, int x, int y) const {
        if (!c_.plan.gradient) {
            return color;
        }
        const auto& function = c_.scene.transfer_function;
        const double weakest = 1e-3 * (function.v_max() - function.v_min()) / c_.frame.reference_length;
        const double size = std::hypot(gradient.x, gradient.y, gradient.z);
        const Vec3 normal = size > 0.0 ? -gradient / std::max(size, weakest) : Vec3(0.0);
        const Vec3 s = slope(x, y);
        const Vec3 viewer = glm::normalize(Vec3(-s.x, -s.y, 1.0));
        const Material& m = c_.scene.material;
        Vec3 sum = color * m.ambient;
        for (const Light& light : c_.scene.lights) {
            Vec3 l = glm::normalize(light.direction);
            if (light.space == LightSpace::world) {
                l = {glm::dot(l, c_.camera.right_world()), glm::dot(l, c_.camera.up_world()),
                     glm::dot(l, c_.camera.back_world())};
            }
            Vec3 side = normal;
            if (c_.plan.two_sided && glm::dot(side, l) < 0.0) {
                side = -side;
            }
            const double facing = std::max(0.0, glm::dot(side, l));
            const Vec3 mirrored = 2.0 * facing * side - l;
            const double shine =
                c_.plan.specular ? m.specular * std::pow(std::max(0.0, glm::dot(mirrored, viewer)), m.shininess) : 0.0;
            sum += light.color * facing * (color * m.diffuse + Vec3(shine));
        }
        return sum;
    }

    void composite(Pixel& p, int x, int y, double lengths) const {
        if (p.alpha >= stop()) {
            return;
        }
        const bool front_empty = weight(0, x, y) == 0.0, back_empty = weight(1, x, y) == 0.0;
        if (c_.plan.empty_test && front_empty && (!c_.plan.preintegration || back_empty)) {
            return;
        }
        Looks looks;
        Vec3 slope(0.0);
        if (c_.plan.preintegration) {
            const double a = value(1, x, y), b = value(2, x, y);
            double mean = 0.0;
            ramp(std::min(a, b), std::max(a, b), mean, looks.color);
            if (!(mean > 0.0)) {
                return;
            }
            looks.color /= mean;
            looks.opacity = -std::expm1(-mean * lengths);
            slope = 0.5 * (gradient(0, x, y) + gradient(1, x, y));
        } else {
            looks = look_up(value(1, x, y));
            looks.opacity = -std::expm1(lengths * std::log1p(-looks.opacity));
            slope = gradient(0, x, y);
        }
        if (looks.opacity == 0.0) {
            return;
        }
        const double share = (1.0 - p.alpha) * looks.opacity;
        p.color += share * shade(looks.color, slope, x, y);
        const double old = p.alpha;
        p.alpha += share;
        if (c_.plan.depth && old < 0.5 && p.alpha >= 0.5) {
            p.depth = depth(0);
        }
    }

    void cross(Pixel& p, int x, int y) const {
        const double iso = *c_.scene.iso_value, a = value(1, x, y), b = value(2, x, y);
        if (p.alpha != 0.0 || (a < iso) == (b < iso)) {
            return;
        }
        const double share = (iso - a) / (b - a);
        const Vec3 slope = (1.0 - share) * gradient(0, x, y) + share * gradient(1, x, y);
        p.color = shade(look_up(iso).color, slope, x, y);
        p.alpha = 1.0;
        p.depth = c_.plan.depth ? depth(0) + share * c_.frame.slice_spacing : p.depth;
    }

    const Case& c_;
};

// What is drawn -------------------------------------------------------------------------------------------------------

/// Planes and sheets of one call.
template <class T>
struct Drawn {
    std::vector<T> sheets[6], planes[7];
    std::vector<int> row_alive;
    TilePicture<T> picture;
    SlabWindow<T> window;

    explicit Drawn(const Case& c) {
        const auto copy = [](const std::vector<double>& from, std::vector<T>& to) {
            to.assign(from.size(), T(0));
            for (std::size_t k = 0; k < from.size(); ++k) {
                to[k] = static_cast<T>(from[k]);
            }
            return to.data();
        };
        for (int k = 0; k < 4; ++k) {
            window.rho[k] = copy(c.rho[k], sheets[k]);
        }
        for (int k = 0; k < 2 && (c.plan.empty_test || c.plan.coverage); ++k) {
            window.weight[k] = copy(c.weight[k], sheets[4 + k]);
        }
        window.n = c.n;
        window.rect = c.rect;
        T** planes_of[] = {&picture.red,    &picture.green, &picture.blue,    &picture.alpha,
                           &picture.scalar, &picture.depth, &picture.coverage};
        for (int k = 0; k < 7; ++k) {
            planes[k].assign(c.shape.picture_elements(), k == 5 ? std::numeric_limits<T>::infinity() : T(0));
            *planes_of[k] = planes[k].data();
        }
        if (!c.plan.depth) {
            picture.depth = nullptr;
        }
        if (!c.plan.coverage) {
            picture.coverage = nullptr;
        }
        row_alive.assign(static_cast<std::size_t>(c.shape.height), 0);
        picture.row_alive = row_alive.data();
        const Truth truth(c);
        for (int y = 0; y < c.shape.height; ++y) {
            for (int x = 0; x < c.shape.width; ++x) {
                const Pixel& p = c.before[static_cast<std::size_t>(y * c.shape.width + x)];
                const auto at = static_cast<std::size_t>(y * c.shape.stride + x);
                for (int k = 0; k < 3; ++k) {
                    planes[k][at] = static_cast<T>(p.color[k]);
                }
                planes[3][at] = static_cast<T>(p.alpha);
                planes[4][at] = static_cast<T>(p.scalar);
                planes[5][at] = static_cast<T>(p.depth);
                planes[6][at] = static_cast<T>(p.coverage);
                const int alive = truth.alive(p) ? 1 : 0;
                row_alive[static_cast<std::size_t>(y)] += alive;
                picture.alive += alive;
            }
        }
    }
};

/// Rounding of some dozens of operations; highlights multiply it by their exponent.
template <class T>
double tolerance(const Case& c) {
    const double u = static_cast<double>(std::numeric_limits<T>::epsilon());
    return u * (c.plan.specular ? 200.0 : 50.0);
}

/// Largest differences between what was drawn and what must come out.
struct Distance {
    double color = 0.0, scalar = 0.0, depth = 0.0, coverage = 0.0;
    int alive = 0;   ///< pixels that are counted wrongly
    int changed = 0; ///< pixels that the slab changes
    [[nodiscard]] double largest() const { return std::max({color, scalar, depth, coverage}); }
};

template <class T>
Distance distance(const Case& truth_of, const Case& drawn_of, ShadeCall<T> call) {
    Drawn<T> drawn(drawn_of);
    {
        const Traps traps;
        const Shading<T> shading = make_shading<T>(drawn_of.scene, drawn_of.camera, drawn_of.frame, drawn_of.plan);
        call(shading, drawn_of.shape, drawn.window, drawn.picture);
    }
    const Truth truth(truth_of);
    Distance d;
    int alive = 0;
    for (int y = 0; y < truth_of.shape.height; ++y) {
        int in_row = 0, either = 0;
        for (int x = 0; x < truth_of.shape.width; ++x) {
            const Pixel wanted = truth.pixel(x, y);
            const Pixel& old = truth_of.before[static_cast<std::size_t>(y * truth_of.shape.width + x)];
            d.changed += wanted.alpha != old.alpha || wanted.scalar != old.scalar || wanted.coverage != old.coverage;
            const auto at = static_cast<std::size_t>(y * truth_of.shape.stride + x);
            const auto off = [&](int plane, double value) {
                return std::abs(static_cast<double>(drawn.planes[plane][at]) - value);
            };
            for (int k = 0; k < 3; ++k) {
                d.color = std::max(d.color, off(k, wanted.color[k]));
            }
            d.color = std::max(d.color, off(3, wanted.alpha));
            d.scalar = std::max(d.scalar, off(4, wanted.scalar) / std::max(1.0, std::abs(wanted.scalar)));
            if (std::isinf(wanted.depth) != std::isinf(drawn.planes[5][at])) {
                d.depth = std::numeric_limits<double>::infinity();
            } else if (!std::isinf(wanted.depth)) {
                d.depth = std::max(d.depth, off(5, wanted.depth) / std::max(1.0, std::abs(wanted.depth)));
            }
            d.coverage = std::max(d.coverage, off(6, wanted.coverage) / std::max(1.0, wanted.coverage));
            in_row += truth.alive(wanted) ? 1 : 0;
            either += truth.on_the_verge(wanted, tolerance<T>(truth_of)) ? 1 : 0;
        }
        const int counted = drawn.row_alive[static_cast<std::size_t>(y)];
        d.alive += std::max(std::abs(in_row - counted) - either, 0);
        alive += counted;
    }
    d.alive += std::abs(alive - drawn.picture.alive);
    return d;
}

// Cases ---------------------------------------------------------------------------------------------------------------

/// Points at exact floats, some of them at one value, with stretches without opacity.
TransferFunction random_function(Random& random, int points, double unit) {
    std::vector<TransferPoint> p;
    double value = single(random.uniform(-0.3, 0.2));
    for (int n = 0; n < points; ++n) {
        TransferPoint point;
        point.value = value * unit;
        point.color = {random.uniform(-0.2, 1.2), random.uniform(0.0, 1.0), random.uniform(0.0, 1.0)};
        point.opacity = random.chance(0.25) ? 0.0 : random.chance(0.1) ? 1.0 : random.uniform(0.0, 1.0);
        p.push_back(point);
        if (!random.chance(0.2)) {
            value = single(value + random.uniform(0.2, 1.8) / points);
        }
    }
    return TransferFunction(p);
}

Case random_case(Random& random, Mode mode, bool preintegration, bool perspective, int points) {
    Case c;
    const double unit = std::ldexp(1.0, random.whole(-3, 3));
    c.plan.mode = c.scene.mode = mode;
    c.plan.preintegration = c.scene.preintegration = preintegration;
    c.plan.value_unit = unit;
    c.scene.transfer_function = random_function(random, points, unit);
    c.scene.iso_value = single(random.uniform(0.1, 0.6)) * unit;
    c.frame.size = {random.whole(40, 70), random.whole(30, 60)};
    c.frame.projection = perspective ? Projection::perspective : Projection::orthographic;
    c.frame.slice_spacing = random.uniform(0.3, 2.0);
    c.frame.reference_length = random.chance(0.4) ? c.frame.slice_spacing : random.uniform(0.3, 3.0);
    c.frame.pixel = perspective ? random.uniform(0.005, 0.05) : random.uniform(0.3, 1.5);
    c.frame.slices = 9;
    c.frame.first_depth = random.uniform(3.0, 30.0);
    c.n = random.whole(preintegration || mode == Mode::isosurface ? -1 : 0, 8);
    c.plan.opacity_correction = perspective || c.frame.slice_spacing != c.frame.reference_length;
    c.plan.projection = c.frame.projection;
    c.plan.stop = random.chance(0.7);
    c.scene.opacity_stop = single(random.uniform(0.5, 0.98));
    c.plan.empty_test = mode == Mode::composite && random.chance(0.4);
    c.plan.coverage = random.chance(0.5);
    c.plan.depth = mode != Mode::xray && mode != Mode::mip && random.chance(0.5);
    c.camera = Camera::orthographic({3.0, -4.0, 2.0}, {0.0, 0.0, 0.0}, {0.0, 0.0, 1.0}, 2.0);
    const int lights = mode == Mode::xray || mode == Mode::mip ? 0 : random.whole(0, 3);
    const bool gray = random.chance(0.5);
    for (int l = 0; l < lights; ++l) {
        Light light;
        light.direction = {random.uniform(-2.0, 2.0), random.uniform(-2.0, 2.0), random.uniform(-1.0, 3.0)};
        light.color = gray ? Vec3(random.uniform(0.2, 1.0))
                           : Vec3(random.uniform(0.0, 1.0), random.uniform(0.0, 1.0), random.uniform(0.0, 1.0));
        light.space = random.chance(0.5) ? LightSpace::world : LightSpace::eye;
        c.scene.lights.push_back(light);
    }
    c.plan.gradient = c.plan.lit = lights > 0;
    c.scene.material.two_sided = c.plan.two_sided = c.plan.gradient && random.chance(0.5);
    c.plan.specular = c.plan.gradient && random.chance(0.5);
    c.scene.material.specular = c.plan.specular ? random.uniform(0.1, 0.8) : 0.0;
    c.scene.material.shininess = random.chance(0.1) ? 0.0 : random.uniform(1.0, 20.0);

    c.shape.x = random.whole(0, 20);
    c.shape.y = random.whole(0, 20);
    c.shape.width = random.whole(1, 45);
    c.shape.height = random.whole(1, 12);
    c.shape.stride = (c.shape.width + 2 + 2 * TileShape::padding - 1) / TileShape::padding * TileShape::padding;
    c.rect = {0, 0, c.shape.width, c.shape.height};
    if (random.chance(0.5)) {
        c.rect.x0 = random.whole(0, c.shape.width - 1);
        c.rect.x1 = random.whole(c.rect.x0 + 1, c.shape.width);
        c.rect.y0 = random.whole(0, c.shape.height - 1);
        c.rect.y1 = random.whole(c.rect.y0 + 1, c.shape.height);
    }
    // Waves with a hole; paddings too, which must not matter.
    const double a = random.uniform(0.1, 0.5), b = random.uniform(0.1, 0.5), e = random.uniform(0.2, 1.5);
    const double size = random.uniform(0.3, 1.5), middle = random.uniform(-0.1, 0.6);
    for (int k = 0; k < 4; ++k) {
        c.rho[k].assign(c.shape.sheet_elements(), 0.0);
        for (std::size_t at = 0; at < c.rho[k].size(); ++at) {
            const double x = static_cast<double>(at % static_cast<std::size_t>(c.shape.stride));
            const double y = static_cast<double>(at / static_cast<std::size_t>(c.shape.stride));
            const double wave = middle + size * std::sin(a * x + e * k) * std::cos(b * y - 0.3 * k);
            c.rho[k][at] = std::sin(0.37 * x * y + k) > 0.9 ? 0.0 : single(wave + random.uniform(0.0, 0.02));
            if (random.chance(0.02)) {
                // A value at a point of the transfer function.
                const auto& p = c.scene.transfer_function.points();
                c.rho[k][at] = p[static_cast<std::size_t>(random.whole(0, points - 1))].value / unit;
            }
        }
    }
    for (auto& weight : c.weight) {
        weight.assign(c.shape.sheet_elements(), 0.0);
        for (double& w : weight) {
            w = random.chance(0.3) ? 0.0 : single(random.uniform(0.01, 2.0));
        }
    }
    for (int y = 0; y < c.shape.height; ++y) {
        for (int x = 0; x < c.shape.width; ++x) {
            if (x < c.rect.x0 || x >= c.rect.x1 || y < c.rect.y0 || y >= c.rect.y1) {
                const auto at = static_cast<std::size_t>((y + 1) * c.shape.stride + x + 1);
                c.rho[1][at] = c.rho[2][at] = c.weight[0][at] = c.weight[1][at] = 0.0;
            }
        }
    }
    const bool fresh = random.chance(0.3);
    for (int k = 0; k < c.shape.width * c.shape.height; ++k) {
        Pixel p;
        if (mode == Mode::isosurface) {
            p.alpha = !fresh && random.chance(0.3) ? 1.0 : 0.0;
        } else {
            p.alpha = fresh || random.chance(0.2) ? 0.0 : random.chance(0.1) ? 1.0 : single(random.uniform(0.0, 1.0));
        }
        p.color = Vec3(single(random.uniform(0.0, 1.0)), single(random.uniform(0.0, 1.0)), 0.25) * p.alpha;
        for (int channel = 0; channel < 3; ++channel) {
            p.color[channel] = single(p.color[channel]);
        }
        p.scalar = fresh ? 0.0 : single(random.uniform(0.0, 2.0));
        p.coverage = fresh ? 0.0 : single(random.uniform(0.0, 2.0));
        p.depth = p.alpha >= 0.5 ? 2.5 : std::numeric_limits<double>::infinity();
        c.before.push_back(p);
    }
    return c;
}

struct Setting {
    const char* name;
    Mode mode;
    bool preintegration;
    bool perspective;
    int points;
};

constexpr Setting settings[] = {
    {"few_points", Mode::composite, false, false, 2},
    {"four_points", Mode::composite, false, false, 4},
    {"four_points_perspective", Mode::composite, false, true, 4},
    {"twelve_points", Mode::composite, false, false, 12},
    {"many_points", Mode::composite, false, false, 256},
    {"many_points_perspective", Mode::composite, false, true, 60},
    {"one_point", Mode::composite, false, true, 1},
    {"intervals", Mode::composite, true, false, 5},
    {"intervals_perspective", Mode::composite, true, true, 9},
    {"isosurface", Mode::isosurface, false, false, 4},
    {"isosurface_perspective", Mode::isosurface, false, true, 4},
    {"intervals_many_points", Mode::composite, true, false, 60},
    {"intervals_many_points_perspective", Mode::composite, true, true, 20},
    {"xray", Mode::xray, false, false, 2},
    {"xray_perspective", Mode::xray, false, true, 2},
    {"mip", Mode::mip, false, false, 2},
};

class ShadeSlab : public testing::TestWithParam<Setting> {};

template <class T>
void expect_truth(const Setting& s, double& worst) {
    for (const Variant<T>& variant : variants<T>()) {
        Random random(77U + static_cast<unsigned>(s.points));
        int changed = 0;
        for (int k = 0; k < (s.preintegration ? 30 : 60); ++k) {
            const Case c = random_case(random, s.mode, s.preintegration, s.perspective, s.points);
            const Distance d = distance<T>(c, c, variant.call);
            worst = std::max(worst, d.largest() / tolerance<T>(c));
            ASSERT_LE(d.largest(), tolerance<T>(c))
                << variant.name << " case " << k << ": colour " << d.color << " scalar " << d.scalar << " depth "
                << d.depth << " coverage " << d.coverage << " lights " << c.scene.lights.size() << " specular "
                << c.plan.specular << " n " << c.n;
            ASSERT_EQ(d.alive, 0) << variant.name << " case " << k;
            changed += d.changed;
        }
        EXPECT_GT(changed, 500) << variant.name << ": the cases show nothing";
    }
}

TEST_P(ShadeSlab, is_the_formula_in_float32) {
    double worst = 0.0;
    expect_truth<float>(GetParam(), worst);
    RecordProperty("worst", std::to_string(worst));
}
TEST_P(ShadeSlab, is_the_formula_in_float64) {
    double worst = 0.0;
    expect_truth<double>(GetParam(), worst);
    RecordProperty("worst", std::to_string(worst));
}

INSTANTIATE_TEST_SUITE_P(All, ShadeSlab, testing::ValuesIn(settings),
                         [](const auto& tested) { return std::string(tested.param.name); });

/// A small change of a case, which must show.
struct Change {
    const char* name;
    Setting setting;
    void (*make)(Case&);
};

constexpr Setting plain{"", Mode::composite, false, false, 4};
constexpr Setting plain_perspective{"", Mode::composite, false, true, 40};
constexpr Setting intervals{"", Mode::composite, true, false, 5};
constexpr Setting surface{"", Mode::isosurface, false, true, 4};

const Change changes[] = {
    {"slices_before_and_after_exchanged", plain, [](Case& c) { std::swap(c.rho[0], c.rho[2]); }},
    {"slices_after_exchanged", intervals, [](Case& c) { std::swap(c.rho[2], c.rho[3]); }},
    {"slices_around_a_surface_exchanged", surface, [](Case& c) { std::swap(c.rho[0], c.rho[3]); }},
    {"rays_of_another_row", plain_perspective, [](Case& c) { c.shape.y += 1; }},
    {"rays_of_another_column", surface, [](Case& c) { c.shape.x += 1; }},
    {"another_slice", surface, [](Case& c) { c.n += 1; }},
    {"more_ambient_light", plain, [](Case& c) { c.scene.material.ambient *= 1.001; }},
    {"sharper_highlights", plain_perspective, [](Case& c) { c.scene.material.shininess += 0.01; }},
    {"one_side_less", plain, [](Case& c) { c.plan.two_sided = false; }},
    {"light_of_the_world", plain,
     [](Case& c) {
         for (Light& light : c.scene.lights) {
             light.space = LightSpace::eye;
         }
     }},
    {"thicker_slices", plain_perspective, [](Case& c) { c.frame.slice_spacing *= 1.0001; }},
    {"shorter_reference", intervals, [](Case& c) { c.frame.reference_length *= 0.9999; }},
    {"earlier_stop", plain, [](Case& c) { c.scene.opacity_stop -= 0.2; }},
    {"a_point_more_opaque", plain_perspective,
     [](Case& c) {
         auto points = c.scene.transfer_function.points();
         points[points.size() / 2].opacity = std::min(1.0, points[points.size() / 2].opacity + 0.01);
         c.scene.transfer_function = TransferFunction(points);
     }},
    {"empty_points_shown", plain, [](Case& c) { c.plan.empty_test = false; }},
    {"a_narrower_rectangle", intervals, [](Case& c) { c.rect.x1 -= 1; }},
};

class ShadeSlabNotices : public testing::TestWithParam<Change> {};

TEST_P(ShadeSlabNotices, what_is_wrong) {
    const Change& change = GetParam();
    const Setting& s = change.setting;
    Random random(5);
    int noticed = 0;
    for (int k = 0; k < 60; ++k) {
        const Case c = random_case(random, s.mode, s.preintegration, s.perspective, s.points);
        Case wrong = c;
        change.make(wrong);
        const Distance d = distance<float>(c, wrong, variants<float>().front().call);
        noticed += d.largest() > tolerance<float>(c) || d.alive != 0 ? 1 : 0;
    }
    EXPECT_GE(noticed, 5);
}

INSTANTIATE_TEST_SUITE_P(All, ShadeSlabNotices, testing::ValuesIn(changes),
                         [](const auto& tested) { return std::string(tested.param.name); });

/// Numbers at the ends of what scenes may have: nothing but numbers comes out, and no trap is met on the way.
template <class T>
void expect_numbers() {
    for (const Variant<T>& variant : variants<T>()) {
        Random random(9);
        for (int k = 0; k < 200; ++k) {
            const Mode mode = k % 4 == 3 ? Mode::isosurface : Mode::composite;
            Case c = random_case(random, mode, k % 4 == 2, random.chance(0.5), random.chance(0.3) ? 1 : 6);
            const double large = sizeof(T) == 4 ? 1e12 : 1e100;
            if (random.chance(0.5)) {
                c.frame.pixel = random.chance(0.5)                              ? 1e-15
                                : c.frame.projection == Projection::perspective ? 50.0
                                                                                : 1e15;
            }
            if (random.chance(0.5)) {
                c.frame.reference_length = random.chance(0.5) ? 1e-35 : 1e35;
                c.plan.opacity_correction = true;
            }
            if (random.chance(0.3)) {
                c.frame.first_depth = -2.0 * c.frame.slice_spacing; // a slice at the eye
                for (auto& sheet : c.rho) {
                    sheet.assign(sheet.size(), 0.0);
                }
            }
            const double scale = random.chance(0.3) ? large : random.chance(0.3) ? 1.0 / large : 1.0;
            for (auto& sheet : c.rho) {
                for (double& rho : sheet) {
                    rho = random.chance(0.1) ? 0.0 : rho * scale;
                }
            }
            c.scene.material.shininess = random.chance(0.3) ? 1e300 : c.scene.material.shininess;
            Drawn<T> drawn(c);
            {
                const Traps traps;
                const Shading<T> shading = make_shading<T>(c.scene, c.camera, c.frame, c.plan);
                variant.call(shading, c.shape, drawn.window, drawn.picture);
            }
            int in_rows = 0;
            for (const int row : drawn.row_alive) {
                ASSERT_GE(row, 0);
                in_rows += row;
            }
            ASSERT_EQ(in_rows, drawn.picture.alive);
            for (int plane = 0; plane < 4; ++plane) {
                for (int y = 0; y < c.shape.height; ++y) {
                    for (int x = 0; x < c.shape.width; ++x) {
                        const auto value =
                            static_cast<double>(drawn.planes[plane][static_cast<std::size_t>(y * c.shape.stride + x)]);
                        ASSERT_TRUE(value >= -10.0 && value <= 10.0) << variant.name << " case " << k << ": " << value;
                    }
                }
            }
        }
    }
}
TEST(ShadeSlabAtExtremes, makes_numbers_in_float32) { expect_numbers<float>(); }
TEST(ShadeSlabAtExtremes, makes_numbers_in_float64) { expect_numbers<double>(); }

TEST(TransferTable, knows_where_nothing_shows) {
    const auto table = [](std::vector<TransferPoint> points) {
        return make_transfer_table<float>(TransferFunction(std::move(points)), 2.0);
    };
    const Vec3 c(1.0);
    const float infinity = std::numeric_limits<float>::infinity();
    const auto ramp = table({{0.0, c, 0.0}, {2.0, c, 0.0}, {4.0, c, 0.5}, {6.0, c, 0.0}, {8.0, c, 0.0}});
    EXPECT_EQ(ramp.below, 1.0F);
    EXPECT_EQ(ramp.above, 3.0F);
    const auto step = table({{0.0, c, 0.0}, {2.0, c, 0.0}, {2.0, c, 0.5}, {6.0, c, 0.5}, {6.0, c, 0.0}});
    EXPECT_EQ(step.below, std::nextafter(1.0F, 0.0F));
    EXPECT_EQ(step.above, 3.0F);
    const auto open = table({{0.0, c, 0.1}, {2.0, c, 0.5}});
    EXPECT_EQ(open.below, -infinity);
    EXPECT_EQ(open.above, infinity);
    const auto clear = table({{0.0, c, 0.0}, {2.0, c, 0.0}});
    EXPECT_FALSE(0.5F > clear.below && 0.5F < clear.above);
    // The very first of two points at one value holds for all smaller values.
    const auto first = table({{2.0, c, 0.3}, {2.0, c, 0.0}, {4.0, c, 0.0}});
    EXPECT_EQ(first.below, -infinity);
    EXPECT_EQ(first.above, 1.0F);
    EXPECT_EQ(first.stretches, 3);
}

} // namespace
} // namespace sheetsplat::backend_cpu

#endif // HWY_ONCE

#include "reference/kernels.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include <glm/geometric.hpp>
#include <glm/gtc/quaternion.hpp>

namespace sheetsplat::reference {

namespace {

constexpr double root_pi = 1.7724538509055160273;
// Below this length, in units of the Gaussian's width, the difference of two erf has lost too many digits.
constexpr double thin = 0.1;

struct Node {
    double place, weight; // on [-1, 1]
};
// Five points: exact to rounding for exp(-x^2) over a length of `thin`.
constexpr Node gauss_legendre_5[] = {{-0.90617984593866399, 0.23692688505618909},
                                     {-0.53846931010568309, 0.47862867049936647},
                                     {0.0, 0.56888888888888889},
                                     {0.53846931010568309, 0.47862867049936647},
                                     {0.90617984593866399, 0.23692688505618909}};

// Bounds are widened so that rounding cannot lose a pixel (the kernel's own end decides): by this much of 1 - s^2 in
// unit-sphere space, and by some fifty times the rounding of what they are made of.
constexpr double slack = 1e-12;
constexpr double rounding = 1e-14;

// Semi-axes may be so long or short that their squares do not fit.
double length_of(const Vec3& v) {
    const double plain = glm::length(v);
    return plain > 1e-140 && plain < 1e140 ? plain : std::hypot(v.x, v.y, v.z);
}

// a b c / (d e f), where neither product need fit.
double ratio_of_products(const std::array<double, 3>& above, const std::array<double, 3>& below) {
    double mantissa = 1.0;
    int exponent = 0, part = 0;
    for (const double factor : above) {
        mantissa *= std::frexp(factor, &part);
        exponent += part;
    }
    for (const double factor : below) {
        mantissa /= std::frexp(factor, &part);
        exponent -= part;
    }
    return std::ldexp(mantissa, exponent);
}

// The layer that one is the image of, in mirrors in layer 0 and in the last one.
std::int64_t mirrored(std::int64_t layer, std::int64_t last) {
    while (last > 0 && (layer < 0 || layer > last)) {
        layer = layer < 0 ? -layer : 2 * last - layer;
    }
    return last > 0 ? layer : 0;
}

// Largest a s + sqrt(h^2 - s^2) for s from `from` to `to`, both in [-h, h].
double largest_on_arc(double a, double h, double from, double to) {
    const double s = std::clamp(h * a / std::hypot(1.0, a), from, to);
    return a * s + std::sqrt(std::max(0.0, h * h - s * s));
}

// erf(to) - erf(from), of which far from 0 hardly a digit would be left.
double erf_between(double from, double to) {
    return from > 0.0 ? std::erfc(from) - std::erfc(to)
           : to < 0.0 ? std::erfc(-to) - std::erfc(-from)
                      : std::erf(to) - std::erf(from);
}

} // namespace

Profile::Profile(double falloff)
    : falloff_(falloff), root_falloff_(std::sqrt(falloff)), edge_(std::exp(-falloff)),
      gain_(-1.0 / std::expm1(-falloff)) {}

double Profile::gaussian(double b_squared, double from, double to) const {
    const double length = to - from;
    if (root_falloff_ * length < thin) {
        double sum = 0.0;
        for (const Node& node : gauss_legendre_5) {
            const double u = from + 0.5 * length * (1.0 + node.place);
            sum += node.weight * std::exp(-falloff_ * (b_squared + u * u));
        }
        return 0.5 * length * sum;
    }
    return std::exp(-falloff_ * b_squared) * 0.5 * root_pi / root_falloff_ *
           erf_between(root_falloff_ * from, root_falloff_ * to);
}

Profile::Moments Profile::moments(double b_squared, double from, double to) const {
    // exp(-k r^2) at the nearer end, less that at the farther one, as a product that does not cancel.
    const double first = -std::exp(-falloff_ * (b_squared + from * from)) *
                         std::expm1(-falloff_ * (to - from) * (to + from)) / (2.0 * falloff_);
    return {gain_ * gaussian(b_squared, from, to), gain_ * first};
}

double Profile::integral(double b_squared, double from, double to) const {
    const double length = to - from;
    if (root_falloff_ * length < thin) {
        double sum = 0.0;
        for (const Node& node : gauss_legendre_5) {
            const double u = from + 0.5 * length * (1.0 + node.place);
            sum += node.weight * at(b_squared + u * u);
        }
        return std::max(0.0, 0.5 * length * sum);
    }
    return std::max(0.0, (gaussian(b_squared, from, to) - edge_ * length) * gain_);
}

KernelShape::KernelShape(const Mat3& axes_eye, const Vec3& semi_axes)
    // B^-1 = S^-1 E^T, whose columns are the rows of E over the semi-axes.
    : to_unit_(glm::transpose(axes_eye)) {
    const Mat3 rows = to_unit_;
    for (int axis = 0; axis < 3; ++axis) {
        to_unit_[axis] /= semi_axes;
    }
    measure(rows[0] * semi_axes, rows[1] * semi_axes, rows[2] * semi_axes);
}

KernelShape KernelShape::filtered(const Mat3& axes_eye, const Vec3& semi_axes, double across, double along) {
    // Columns of the stack [B^T; diag]: one for each of the eye's axes.
    using Column = std::array<double, 6>;
    std::array<Column, 3> stack{};
    const std::array<double, 3> widths{across, across, along};
    for (int axis = 0; axis < 3; ++axis) {
        Column& column = stack[static_cast<std::size_t>(axis)];
        for (int own = 0; own < 3; ++own) {
            column[static_cast<std::size_t>(own)] = axes_eye[own][axis] * semi_axes[own];
        }
        column[static_cast<std::size_t>(3 + axis)] = widths[static_cast<std::size_t>(axis)];
    }
    const auto dot_from = [](const Column& a, const Column& b, std::size_t first) {
        double sum = 0.0;
        for (std::size_t row = first; row < 6; ++row) {
            sum += a[row] * b[row];
        }
        return sum;
    };
    for (std::size_t step = 0; step < 3; ++step) {
        // The mirror's normal, scaled to a largest part of 1.
        Column normal = stack[step];
        double largest = 0.0;
        for (std::size_t row = 0; row < 6; ++row) {
            normal[row] = row < step ? 0.0 : normal[row];
            largest = std::max(largest, std::abs(normal[row]));
        }
        for (double& part : normal) {
            part /= largest;
        }
        // Away from the axis, so that nothing cancels.
        const double length = std::sqrt(dot_from(normal, normal, step));
        const double onto = normal[step] > 0.0 ? -length : length;
        normal[step] -= onto;
        const double squared = dot_from(normal, normal, step);
        stack[step][step] = onto * largest;
        for (std::size_t column = step + 1; column < 3; ++column) {
            const double twice = 2.0 * dot_from(normal, stack[column], step) / squared;
            for (std::size_t row = step; row < 6; ++row) {
                stack[column][row] -= twice * normal[row];
            }
        }
    }

    // The new B: rows (r00, 0, 0), (r01, r11, 0), (r02, r12, r22).
    const double r00 = stack[0][0], r01 = stack[1][0], r11 = stack[1][1];
    const double r02 = stack[2][0], r12 = stack[2][1], r22 = stack[2][2];
    KernelShape shape;
    // Its inverse, column by column, by substitution.
    const double i10 = -r01 / r00 / r11;
    shape.to_unit_ = Mat3(Vec3(1.0 / r00, i10, -(r02 / r00 + r12 * i10) / r22), Vec3(0.0, 1.0 / r11, -r12 / r11 / r22),
                          Vec3(0.0, 0.0, 1.0 / r22));
    shape.measure(Vec3(r00, 0.0, 0.0), Vec3(r01, r11, 0.0), Vec3(r02, r12, r22));
    shape.amplitude_ =
        ratio_of_products({semi_axes.x, semi_axes.y, semi_axes.z}, {std::abs(r00), std::abs(r11), std::abs(r22)});
    return shape;
}

void KernelShape::measure(const Vec3& x, const Vec3& y, const Vec3& z) {
    half_depth_ = length_of(z);
    const Vec3 n = z / half_depth_;
    drift_x_ = glm::dot(x, n);
    drift_y_ = glm::dot(y, n);
    // A needle that leans has nearly parallel rows: what is left of their difference may be rounding.
    spread_x_ = length_of(x - drift_x_ * n) + rounding * length_of(x);
    spread_y_ = length_of(y - drift_y_ * n) + rounding * length_of(y);
}

Interval KernelShape::bounds(double drift, double spread, double front, double back) const {
    const double h = std::sqrt(1.0 + slack);
    const double from = std::clamp(-back / half_depth_, -h, h), to = std::clamp(-front / half_depth_, -h, h);
    const double a = drift / spread;
    return {-spread * largest_on_arc(-a, h, from, to) - rounding * std::abs(drift),
            spread * largest_on_arc(a, h, from, to) + rounding * std::abs(drift)};
}

Interval KernelShape::bounds_in_row(double y_0, double slope_y, double front, double back) const {
    // In the plane of the row, q = q_0 + x u + depth v. Two perpendicular directions in it, the first along u, and the
    // distance of the plane from the centre leave a circle: (q_v + depth |v'|)^2 + (q_u + x |u| + depth v_u)^2 < h^2.
    const Vec3 u = to_unit_[0], v = to_unit(Vec3(0.0, slope_y, -1.0)), q_0 = to_unit_[1] * y_0;
    const double length_u = length_of(u);
    const Vec3 along_u = u / length_u;
    const double v_u = glm::dot(v, along_u), q_u = glm::dot(q_0, along_u);
    const Vec3 v_rest = v - v_u * along_u;
    const double length_v = length_of(v_rest);
    const Vec3 along_v = v_rest / length_v;
    const Vec3 q_rest = q_0 - q_u * along_u;
    const double q_v = glm::dot(q_rest, along_v);
    const Vec3 beside = q_rest - q_v * along_v;

    const double a = -v_u / length_v, far = length_of(q_0);
    const double lost = rounding * (1.0 + std::abs(a)) * (1.0 + far);
    const double h_squared = 1.0 - glm::dot(beside, beside) + slack + 10.0 * lost;
    if (!(lost < 1e-3) || !std::isfinite(h_squared)) {
        return bounds_x(front, back);
    }
    if (h_squared <= 0.0) {
        return {};
    }
    const double h = std::sqrt(h_squared);
    const double from = q_v + front * length_v, to = q_v + back * length_v;
    if (from > h || to < -h) {
        return {};
    }
    const double s_from = std::clamp(from, -h, h), s_to = std::clamp(to, -h, h);
    // x |u| = middle + a s +- sqrt(h^2 - s^2)
    const double middle = -(q_u + a * q_v);
    const double margin = lost * (1.0 + std::abs(a));
    return {(middle - largest_on_arc(-a, h, s_from, s_to) - margin) / length_u,
            (middle + largest_on_arc(a, h, s_from, s_to) + margin) / length_u};
}

Chord KernelShape::mean(const Profile& profile, const Vec3& beside, double slope_x, double slope_y, double front,
                        double back, bool with_slope) const {
    const Vec3 per_depth = to_unit(Vec3(slope_x, slope_y, -1.0));
    const double speed = length_of(per_depth);
    const Vec3 along = per_depth / speed;
    const Vec3 q = to_unit(beside);
    const double start = glm::dot(q, along);
    // The foot of the perpendicular, not |q|^2 - start^2: that would lose b where the ray is oblique.
    const Vec3 foot = q - start * along;
    const double b_squared = glm::dot(foot, foot);
    if (!(b_squared < 1.0)) {
        return {};
    }
    const double half_chord = std::sqrt(1.0 - b_squared);
    const double from = std::max(-half_chord, start + front * speed);
    const double to = std::min(half_chord, start + back * speed);
    if (from >= to) {
        return {};
    }
    const double all = speed * (back - front);
    Chord chord{true, profile.integral(b_squared, from, to) / all};
    if (with_slope) {
        const Profile::Moments moments = profile.moments(b_squared, from, to);
        chord.slope = slope_to_eye(-2.0 * profile.falloff() / all * (moments.zeroth * foot + moments.first * along));
    }
    return chord;
}

WorldKernels::WorldKernels(const Field& field) : regular_(as_regular(&field)), ellipsoids_(as_ellipsoids(&field)) {
    if (regular_ == nullptr) {
        numbers_ = ellipsoids_->size();
        return;
    }
    bcc_ = regular_->lattice() == Lattice::bcc;
    const double radius = regular_->options().radius;
    reach_squared_ = bcc_ ? 2.0 * radius * radius : radius * radius;
    numbers_ = 1;
    for (int axis = 0; axis < 3; ++axis) {
        Axis& own = axes_[static_cast<std::size_t>(axis)];
        own = axis_of(axis);
        numbers_ *= static_cast<std::uint64_t>(own.count);
    }
}

double WorldKernels::Axis::outside(double layer) const { return std::max({0.0, domain[0] - layer, layer - domain[1]}); }

WorldKernels::Axis WorldKernels::axis_of(int axis) const {
    const auto samples = static_cast<std::int64_t>(regular_->shape()[static_cast<std::size_t>(2 - axis)]);
    const bool halves = bcc_ && axis < 2;
    Axis found;
    found.count = samples;
    found.last_layer = halves ? 2 * samples - 1 : samples - 1;
    if (!regular_->domain()) {
        return found;
    }
    if (regular_->options().domain) {
        const Parallelepiped& domain = *regular_->options().domain;
        const double apart = (domain.to_box * regular_->steps()[axis])[axis] * (halves ? 0.5 : 1.0);
        const double origin = (domain.to_box * regular_->options().origin)[axis];
        found.domain[0] = (domain.box.lower[axis] - origin) / apart;
        found.domain[1] = (domain.box.upper[axis] - origin) / apart;
    } else {
        // Half a layer beyond the first and the last one: of BCC, a / 4 beyond the box of all centres.
        found.domain[0] = -0.5;
        found.domain[1] = static_cast<double>(found.last_layer) + 0.5;
    }
    // A few too many do no harm: each is asked whether it reaches.
    const double per_index = halves ? 2.0 : 1.0, reach = std::sqrt(reach_squared_);
    found.first =
        std::min(std::int64_t{0}, static_cast<std::int64_t>(std::floor((found.domain[0] - reach) / per_index)) - 1);
    const auto last =
        std::max(samples - 1, static_cast<std::int64_t>(std::ceil((found.domain[1] + reach) / per_index)) + 1);
    found.count = last - found.first + 1;
    return found;
}

std::optional<WorldKernel> WorldKernels::sample(std::uint64_t number) const {
    std::array<std::int64_t, 3> index{};
    for (std::size_t axis = 0; axis < 3; ++axis) {
        const auto count = static_cast<std::uint64_t>(axes_[axis].count);
        index[axis] = axes_[axis].first + static_cast<std::int64_t>(number % count);
        number /= count;
    }
    // Mirrors keep the parity of layers.
    const std::int64_t odd = bcc_ ? ((index[2] % 2) + 2) % 2 : 0;
    std::array<std::size_t, 3> source{};
    Vec3 centre = regular_->options().origin, outside(0.0);
    for (int axis = 0; axis < 3; ++axis) {
        const auto own = static_cast<std::size_t>(axis);
        const bool halves = bcc_ && axis < 2;
        const std::int64_t layer = halves ? 2 * index[own] + odd : index[own];
        const std::int64_t given = mirrored(layer, axes_[own].last_layer);
        source[own] = static_cast<std::size_t>(halves ? given / 2 : given);
        centre += static_cast<double>(layer) * (halves ? 0.5 : 1.0) * regular_->steps()[axis];
        if (regular_->domain()) {
            outside[axis] = axes_[own].outside(static_cast<double>(layer));
        }
    }
    // Open supports that only touch the domain do not reach into it. (Of lattices that hold mirrored samples as their
    // own, rows say which of them are kernels.)
    const SampleRange row = regular_->kernels_of_row(source[1], source[2]);
    const bool reaches = source[0] >= row.begin && source[0] < row.end &&
                         (!regular_->domain() || glm::dot(outside, outside) < reach_squared_);
    const double value = reaches ? regular_->value(source[0], source[1], source[2]) : 0.0;
    if (!reaches || std::isnan(value)) {
        return std::nullopt;
    }
    return WorldKernel{centre, regular_->kernel_axes().directions, regular_->kernel_axes().lengths, value, 1.0};
}

std::optional<WorldKernel> WorldKernels::at(std::uint64_t number) const {
    if (regular_ != nullptr) {
        return sample(number);
    }
    const std::vector<glm::dquat>& rotations = ellipsoids_->arrays().rotations;
    return WorldKernel{ellipsoids_->center(number), rotations.empty() ? Mat3(1.0) : glm::mat3_cast(rotations[number]),
                       ellipsoids_->semi_axes(number), ellipsoids_->value(number), ellipsoids_->weight(number)};
}

double WorldKernels::lattice_constant() const {
    return regular_ != nullptr ? regular_->lattice_constant() : ellipsoids_->lattice_constant();
}

EyeKernels::EyeKernels(const Field& field, const Scene& scene, const Camera& camera, const Screen& screen,
                       double radius_factor)
    : world_(field), screen_(screen), eye_(camera.eye()), right_(camera.right_world()), up_(camera.up_world()),
      backward_(camera.back_world()), filter_(scene.filter == Filter::ewa),
      // A Gaussian of half a pixel's standard deviation has its support end at sqrt(2 k) times that.
      filter_radius_(0.5 * std::sqrt(2.0 * field.kernel().falloff)),
      nearest_(screen.perspective() ? camera.near() : 0.0), spacing_(scene.slice_distance()),
      radius_factor_(radius_factor) {
    // In perspective a pixel's width, and with it the filter, changes from kernel to kernel.
    if (const auto* regular = as_regular(&field); regular != nullptr && !(filter_ && screen.perspective())) {
        const KernelAxes& axes = regular->kernel_axes();
        common_shape_ = shape_of({Vec3(0.0), axes.directions, axes.lengths, 0.0, 1.0}, 0.0);
    }
}

KernelShape EyeKernels::shape_of(const WorldKernel& kernel, double depth) const {
    const Vec3 x = right_ * kernel.axes, y = up_ * kernel.axes, z = backward_ * kernel.axes;
    const Mat3 axes_eye = glm::transpose(Mat3(x, y, z));
    const Vec3 semi_axes = kernel.semi_axes * radius_factor_;
    if (!filter_) {
        return KernelShape(axes_eye, semi_axes);
    }
    return KernelShape::filtered(axes_eye, semi_axes, filter_radius_ * screen_.pixel_width(std::max(depth, nearest_)),
                                 filter_radius_ * spacing_);
}

EyeKernel EyeKernels::seen(const WorldKernel& kernel) const {
    // The eye first: what is left of large coordinates keeps its digits.
    const Vec3 from_eye = kernel.centre - eye_;
    const Vec3 centre(glm::dot(from_eye, right_), glm::dot(from_eye, up_), glm::dot(from_eye, backward_));
    const KernelShape shape = common_shape_ ? *common_shape_ : shape_of(kernel, -centre.z);
    const double weight = kernel.weight * shape.amplitude();
    return {centre, shape, weight * kernel.value, weight, kernel.value};
}

} // namespace sheetsplat::reference

// The page conventions once more, with nothing in common with cpp/src/reference and every sum over all kernels:
// what test_brute_force compares the reference with.
#pragma once

#include <map>
#include <optional>
#include <string>

#include "support.hpp"

namespace sheetsplat::reference::testing {

constexpr double infinity = std::numeric_limits<double>::infinity();

/// Deliberate mistakes, each small: a comparison that cannot see them is worth nothing.
struct Mistakes {
    double falloff = 0.0;   ///< added to k
    double secant = 0.0;    ///< added to s
    double depth = 0.0;     ///< added to every t_n
    double shininess = 0.0; ///< added to the material's
    double turn = 0.0;      ///< of every ellipsoid about the world's x, radians
    double weight = 0.0;    ///< added to every weight
    double filter = 0.0;    ///< relative, of the widths that the filter adds
    double base = 0.0;      ///< added to every base
    double domain = 0.0;    ///< what it is wider by, in sample distances
    double hole = 0.0;      ///< relative, of the least W of lattices with holes
    bool repeated = false;  ///< the outermost sample stands beyond itself, in place of its neighbour
};

struct Sample {
    Vec3 position{0.0};
    Mat3 form{1.0};     ///< r^2 = d . form d for world differences d from the centre
    double reach = 0.0; ///< nothing is farther away
    double value = 0.0;
    double weight = 1.0;
    bool mirrored = false;
};

/// B B^T, multiplied out.
Mat3 covariance(const Mat3& b) { return b * glm::transpose(b); }

class Page {
  public:
    Page(const Scene& scene, const Camera& camera, Size size, const Mistakes& mistakes)
        : scene_(scene), camera_(camera), size_(size), mistakes_(mistakes), spacing_(scene.slice_distance()),
          reference_length_(scene.reference_distance()) {
        collect_samples();
        choose_slices();
        sum_everything();
    }

    Picture picture() const {
        Picture result;
        result.size = size_;
        for (int j = 0; j < size_.height; ++j) {
            for (int i = 0; i < size_.width; ++i) {
                add_pixel(i, j, result);
            }
        }
        return result;
    }

  private:
    struct Point {
        double rho = 0.0; ///< less the base
        double w = 0.0;
        bool empty = true;
        bool inside = true; ///< the domain
        bool counts = false;
    };
    /// A field, and what its place among the others makes of it.
    struct Member {
        std::vector<Sample> samples;
        double base = 0.0, least = 0.0, w0 = 1.0;
        Normalization how = Normalization::none;
    };

    static std::optional<Box> domain_of(const Field& field, double wider) {
        const RegularField* lattice = as_regular(&field);
        if (lattice == nullptr || lattice->options().boundary == Boundary::zero) {
            return std::nullopt;
        }
        const RegularFieldOptions& o = lattice->options();
        const auto [nk, nj, ni] = lattice->shape();
        const Vec3 n(static_cast<double>(ni), static_cast<double>(nj), static_cast<double>(nk));
        if (o.lattice == Lattice::cartesian) {
            return Box{o.origin - (0.5 + wider) * o.spacing, o.origin + (n - 0.5 + wider) * o.spacing};
        }
        if (nk < 2) {
            return std::nullopt;
        }
        const double a = o.spacing.x;
        const Vec3 last(a * (n.x - 0.5), a * (n.y - 0.5), a * (n.z - 1.0) / 2.0);
        return Box{o.origin - (0.25 + wider) * a, o.origin + last + (0.25 + wider) * a};
    }

    void collect_samples() {
        Vec3 lower(infinity), upper(-infinity);
        domain_ = domain_of(*scene_.fields.front(), mistakes_.domain);
        bool differ = false;
        for (const auto& field : scene_.fields) {
            const std::optional<Box> other = domain_of(*field, mistakes_.domain);
            differ = differ || other.has_value() != domain_.has_value() ||
                     (other && (other->lower != domain_->lower || other->upper != domain_->upper));
        }
        if (differ) {
            domain_.reset();
        }
        for (const auto& field : scene_.fields) {
            members_.emplace_back();
            Member& member = members_.back();
            member.how = field->normalization();
            member.w0 = field->w0();
            const bool endless = differ && field->kind() == FieldKind::regular;
            member.base = endless ? 0.0 : field->base() + mistakes_.base;
            base_ += member.base;
            if (const RegularField* regular = as_regular(field.get())) {
                member.how = regular->options().normalization;
                member.w0 = regular->options().w0;
                collect_lattice(*regular, member);
            } else {
                collect_ellipsoids(*as_ellipsoids(field.get()), member);
            }
            for (const Sample& sample : member.samples) {
                if (sample.mirrored) {
                    continue;
                }
                const Vec3& p = sample.position;
                lower = Vec3(std::min(lower.x, p.x), std::min(lower.y, p.y), std::min(lower.z, p.z));
                upper = Vec3(std::max(upper.x, p.x), std::max(upper.y, p.y), std::max(upper.z, p.z));
            }
        }
        centre_ = 0.5 * (lower + upper);
        if (scene_.filter == Filter::ewa) {
            for (Member& member : members_) {
                const double falloff =
                    scene_.fields[static_cast<std::size_t>(&member - members_.data())]->kernel().falloff;
                for (Sample& sample : member.samples) {
                    widen(sample, falloff);
                }
            }
        }
    }

    /// The images of a place on a line between two mirrors, its own first, that are closer than `reach` to the part of
    /// the line from `lower` to `upper`.
    static std::vector<double> images(double place, double first, double last, double lower, double upper,
                                      double reach) {
        std::vector<double> found{place};
        const double there_and_back = 2.0 * (last - first);
        const auto add = [&](double image) {
            const bool known = std::any_of(found.begin(), found.end(), [&](double other) {
                return std::abs(other - image) < 1e-6 * (1.0 + there_and_back);
            });
            if (!known && image > lower - reach && image < upper + reach) {
                found.push_back(image);
            }
        };
        const int often = static_cast<int>((upper - lower + 2.0 * reach) / there_and_back) + 2;
        for (int n = -often; n <= often; ++n) {
            add(place + n * there_and_back);
            add(2.0 * first - place + n * there_and_back);
        }
        return found;
    }

    void collect_lattice(const RegularField& field, Member& member) {
        const RegularFieldOptions& o = field.options();
        const auto [nk, nj, ni] = field.shape();
        const Vec3 s = semi_axes(o);
        const bool bcc = o.lattice == Lattice::bcc;
        const double a = o.spacing.x;
        const Vec3 n(static_cast<double>(ni), static_cast<double>(nj), static_cast<double>(nk));
        const Vec3 first = mistakes_.repeated ? o.origin - 0.5 * o.spacing : o.origin;
        Vec3 last = bcc ? o.origin + Vec3(a * (n.x - 0.5), a * (n.y - 0.5), a * (n.z - 1.0) / 2.0)
                        : o.origin + (n - 1.0) * o.spacing;
        last += mistakes_.repeated ? 0.5 * o.spacing : Vec3(0.0);
        const bool edge = domain_ && o.boundary == Boundary::edge;
        const Box domain = edge ? domain_of(field, 0.0).value_or(Box{}) : Box{};
        bool holes = false;
        for (std::size_t k = 0; k < nk; ++k) {
            for (std::size_t j = 0; j < nj; ++j) {
                for (std::size_t i = 0; i < ni; ++i) {
                    const double value = std::get<std::vector<double>>(field.samples())[field.row(j, k) + i];
                    if (std::isnan(value)) {
                        holes = true;
                        continue;
                    }
                    const Vec3 index(static_cast<double>(i), static_cast<double>(j), static_cast<double>(k));
                    const double shift = 0.5 * static_cast<double>(k % 2);
                    const Vec3 p =
                        bcc ? o.origin + Vec3((index.x + shift) * a, (index.y + shift) * a, index.z * a / 2.0)
                            : o.origin + index * o.spacing;
                    Sample sample{p, Mat3(1.0), std::max({s.x, s.y, s.z}), value - member.base, 1.0 + mistakes_.weight};
                    for (int axis = 0; axis < 3; ++axis) {
                        sample.form[axis][axis] = 1.0 / (s[axis] * s[axis]);
                    }
                    if (!edge) {
                        member.samples.push_back(sample);
                        continue;
                    }
                    std::array<std::vector<double>, 3> places;
                    for (int axis = 0; axis < 3; ++axis) {
                        // A single layer is repeated: every other image of it in a mirror half a layer away.
                        const double half = last[axis] == first[axis] ? 0.5 * o.spacing[axis] : 0.0;
                        places[static_cast<std::size_t>(axis)] =
                            images(p[axis], first[axis] - half, last[axis] + half, domain.lower[axis],
                                   domain.upper[axis], s[axis]);
                    }
                    for (const double x : places[0]) {
                        for (const double y : places[1]) {
                            for (const double z : places[2]) {
                                sample.position = Vec3(x, y, z);
                                sample.mirrored = sample.position != p;
                                const Vec3 nearest = glm::clamp(sample.position, domain.lower, domain.upper);
                                if (glm::length((sample.position - nearest) / s) < 1.0) {
                                    member.samples.push_back(sample);
                                }
                            }
                        }
                    }
                }
            }
        }
        if (holes && edge && member.how == Normalization::lattice) {
            member.how = Normalization::threshold;
            member.w0 = 0.5 * lattice_constant(field);
            member.least = member.w0 * (1.0 + mistakes_.hole);
        }
    }

    void collect_ellipsoids(const EllipsoidField& field, Member& member) {
        const EllipsoidArrays& arrays = field.arrays();
        for (std::size_t n = 0; n < arrays.centers.size(); ++n) {
            const Vec3 s = arrays.scales.empty() ? Vec3(arrays.radii[n]) : arrays.scales[n];
            // The columns of a unit quaternion's rotation, by hand.
            const glm::dquat q = arrays.rotations.empty() ? glm::dquat(1.0, 0.0, 0.0, 0.0) : arrays.rotations[n];
            Mat3 m(Vec3(1.0 - 2.0 * (q.y * q.y + q.z * q.z), 2.0 * (q.x * q.y + q.w * q.z),
                        2.0 * (q.x * q.z - q.w * q.y)) *
                       s.x,
                   Vec3(2.0 * (q.x * q.y - q.w * q.z), 1.0 - 2.0 * (q.x * q.x + q.z * q.z),
                        2.0 * (q.y * q.z + q.w * q.x)) *
                       s.y,
                   Vec3(2.0 * (q.x * q.z + q.w * q.y), 2.0 * (q.y * q.z - q.w * q.x),
                        1.0 - 2.0 * (q.x * q.x + q.y * q.y)) *
                       s.z);
            const double c = std::cos(mistakes_.turn), sine = std::sin(mistakes_.turn);
            m = Mat3(Vec3(1.0, 0.0, 0.0), Vec3(0.0, c, sine), Vec3(0.0, -sine, c)) * m;
            member.samples.push_back({arrays.centers[n], glm::inverse(covariance(m)), std::max({s.x, s.y, s.z}),
                                      arrays.values[n] - member.base,
                                      (arrays.weights.empty() ? 1.0 : arrays.weights[n]) + mistakes_.weight, false});
        }
    }

    // Section 10: B B^T + 2 k diag(p^2, p^2, ds^2) / 4 along the eye's axes, the amplitude times
    // sqrt(det old / det new).
    void widen(Sample& sample, double falloff) const {
        const double depth = depth_of(sample.position),
                     half = std::sqrt(0.25 * 2.0 * falloff) * (1.0 + mistakes_.filter);
        const double across =
            half * 2.0 * half_height(perspective() ? std::max(depth, camera_.near()) : depth) / size_.height;
        const double along = half * spacing_;
        const Mat3 old = glm::inverse(sample.form);
        const Mat3 wide = old +
                          across * across *
                              (glm::outerProduct(camera_.right_world(), camera_.right_world()) +
                               glm::outerProduct(camera_.up_world(), camera_.up_world())) +
                          along * along * glm::outerProduct(camera_.back_world(), camera_.back_world());
        sample.form = glm::inverse(wide);
        sample.weight *= std::sqrt(glm::determinant(old) / glm::determinant(wide));
        sample.reach += across + along;
    }

    static Vec3 semi_axes(const RegularFieldOptions& o) {
        return o.lattice == Lattice::bcc ? Vec3(o.radius * o.spacing.x / std::sqrt(2.0)) : o.radius * o.spacing;
    }

    // C: mass of the kernel over the volume of a sample, by quadrature over spherical shells.
    double lattice_constant(const Field& field) const {
        const double k = field.kernel().falloff;
        const double mass = integrate([&](double r) { return 4.0 * pi * r * r * kernel_value(r, k); }, 0.0, 1.0, 1e-16);
        if (const EllipsoidField* ellipsoids = as_ellipsoids(&field)) {
            const Vec3 s = ellipsoids->semi_axes(0);
            return mass * s.x * s.y * s.z / ellipsoids->options().cell_volume.value_or(1.0);
        }
        const RegularFieldOptions& o = as_regular(&field)->options();
        const Vec3 s = semi_axes(o);
        const double volume =
            o.lattice == Lattice::bcc ? std::pow(o.spacing.x, 3) / 2.0 : o.spacing.x * o.spacing.y * o.spacing.z;
        return mass * s.x * s.y * s.z / volume;
    }

    // More slices than there are; those without kernels add nothing.
    void choose_slices() {
        anchor_ = depth_of(centre_) + mistakes_.depth;
        double reach = 0.0;
        for (const Member& member : members_) {
            for (const Sample& sample : member.samples) {
                reach = std::max(reach, glm::length(sample.position - centre_) + sample.reach);
            }
        }
        count_ = 2 * (static_cast<int>(reach / spacing_) + 2);
        first_ = -count_ / 2;
    }

    double depth_of(const Vec3& point) const { return -glm::dot(point - camera_.eye(), camera_.back_world()); }
    double depth(int n) const { return anchor_ + (n + 0.5) * spacing_; }
    bool perspective() const { return camera_.projection() == Projection::perspective; }
    bool exists(int n) const {
        return n >= first_ && n < first_ + count_ && (!perspective() || depth(n) > camera_.near());
    }
    // Whether slab n meets a support.
    bool met_by_support(int n) const {
        for (const Member& member : members_) {
            for (const Sample& sample : member.samples) {
                const Vec3 back = camera_.back_world();
                const double reach = std::sqrt(glm::dot(back, glm::inverse(sample.form) * back));
                if (std::abs(depth_of(sample.position) - depth(n)) < reach + 0.5 * spacing_) {
                    return true;
                }
            }
        }
        return false;
    }
    double first_depth() const {
        int n = first_;
        while (n < first_ + count_ && !(exists(n) && met_by_support(n))) {
            ++n;
        }
        return depth(n);
    }
    double half_height(double t) const {
        return perspective() ? t * std::tan(camera_.fov_y() * pi / 360.0) : camera_.height() / 2.0;
    }
    Vec3 world_point(int i, int j, double t) const {
        const double x = (2.0 * (i + 0.5) / size_.width - 1.0) * half_height(t) * size_.width / size_.height;
        const double y = (1.0 - 2.0 * (j + 0.5) / size_.height) * half_height(t);
        return camera_.eye() + x * camera_.right_world() + y * camera_.up_world() - t * camera_.back_world();
    }
    // The ray as eye-space (X, Y, -1).
    Vec3 ray(int i, int j) const {
        const Vec3 step = world_point(i, j, 2.0) - world_point(i, j, 1.0);
        return {glm::dot(step, camera_.right_world()), glm::dot(step, camera_.up_world()), -1.0};
    }
    double secant(int i, int j) const { return glm::length(ray(i, j)) + mistakes_.secant; }

    // D, W and emptiness of one field at a pixel and a slice.
    void sums(std::size_t f, int i, int j, int n, double& d, double& w, bool& empty) const {
        const double k = scene_.fields[f]->kernel().falloff + mistakes_.falloff;
        for (const Sample& sample : members_[f].samples) {
            const auto r_at = [&](const Vec3& x) {
                return std::sqrt(std::max(0.0, glm::dot(x - sample.position, sample.form * (x - sample.position))));
            };
            double g = 0.0;
            if (scene_.sampling == Sampling::point) {
                const double r = r_at(world_point(i, j, depth(n)));
                if (r >= 1.0) {
                    continue;
                }
                g = kernel_value(r, k);
            } else {
                // r(t)^2 = 1 is a quadratic in t; t counts from the slice.
                const double t0 = depth(n);
                const Vec3 start = world_point(i, j, t0), x0 = start - sample.position;
                const Vec3 v = world_point(i, j, t0 + 1.0) - start;
                const double a = glm::dot(v, sample.form * v), b = glm::dot(x0, sample.form * v),
                             c = glm::dot(x0, sample.form * x0) - 1.0;
                const double discriminant = b * b - a * c;
                if (discriminant <= 0.0) {
                    continue;
                }
                const double from = std::max((-b - std::sqrt(discriminant)) / a, -spacing_ / 2.0);
                const double to = std::min((-b + std::sqrt(discriminant)) / a, spacing_ / 2.0);
                if (from >= to) {
                    continue;
                }
                g = integrate([&](double t) { return kernel_value(r_at(start + t * v), k); }, from, to, 1e-15) /
                    spacing_;
            }
            g *= sample.weight;
            d += sample.value * g;
            w += g;
            empty = false;
        }
    }

    void sum_everything() {
        points_.resize(static_cast<std::size_t>((size_.width + 2) * (size_.height + 2) * count_));
        std::vector<double> constants;
        for (std::size_t f = 0; f < scene_.fields.size(); ++f) {
            constants.push_back(lattice_constant(*scene_.fields[f]));
        }
        for (int n = first_; n < first_ + count_; ++n) {
            for (int j = -1; j <= size_.height && exists(n); ++j) {
                for (int i = -1; i <= size_.width; ++i) {
                    Point& point = points_[at(i, j, n)];
                    point.inside = inside(i, j, n);
                    for (std::size_t f = 0; f < scene_.fields.size(); ++f) {
                        const Member& member = members_[f];
                        double d = 0.0, w = 0.0;
                        bool empty = true;
                        sums(f, i, j, n, d, w, empty);
                        point.rho += member.how == Normalization::none      ? d
                                     : member.how == Normalization::lattice ? d / constants[f]
                                                                            : d / std::max(member.w0, w);
                        point.w += point.inside ? w : 0.0;
                        if (point.inside && !empty && w >= member.least) {
                            point.empty = false;
                            point.counts = point.counts || w > 0.0;
                        }
                    }
                }
            }
        }
    }

    std::size_t at(int i, int j, int n) const {
        return static_cast<std::size_t>(((n - first_) * (size_.height + 2) + j + 1) * (size_.width + 2) + i + 1);
    }
    /// Where there is no slice, too.
    bool inside(int i, int j, int n) const {
        const Vec3 place = world_point(i, j, depth(n));
        bool in = true;
        for (int axis = 0; axis < 3 && domain_; ++axis) {
            in = in && place[axis] >= domain_->lower[axis] - 1e-6 * spacing_ &&
                 place[axis] <= domain_->upper[axis] + 1e-6 * spacing_;
        }
        return in;
    }
    Point point(int i, int j, int n) const { return exists(n) ? points_[at(i, j, n)] : Point{}; }

    /// Of rho less the base.
    TransferPoint function(double above_base) const {
        const double value = base_ + above_base;
        const auto& points = scene_.transfer_function.points();
        if (value < points.front().value) {
            return points.front();
        }
        for (std::size_t n = points.size(); n-- > 0;) {
            if (points[n].value > value) {
                continue;
            }
            if (n + 1 == points.size()) {
                return points[n];
            }
            const double x = (value - points[n].value) / (points[n + 1].value - points[n].value);
            return {value, (1.0 - x) * points[n].color + x * points[n + 1].color,
                    (1.0 - x) * points[n].opacity + x * points[n + 1].opacity};
        }
        return points.front();
    }

    Vec3 gradient(int i, int j, int n) const {
        if (!exists(n)) {
            return {0.0, 0.0, (point(i, j, n + 1).rho - point(i, j, n - 1).rho) / (-2.0 * spacing_)};
        }
        const double width = 2.0 * half_height(depth(n)) / size_.height;
        const double dx = (point(i + 1, j, n).rho - point(i - 1, j, n).rho) / (2.0 * width);
        const double dy = (point(i, j - 1, n).rho - point(i, j + 1, n).rho) / (2.0 * width);
        const double dt = (point(i, j, n + 1).rho - point(i, j, n - 1).rho) / (2.0 * spacing_);
        const Vec3 r = ray(i, j);
        return {dx, dy, r.x * dx + r.y * dy - dt};
    }

    Vec3 shaded(const Vec3& c, const Vec3& g, int i, int j) const {
        if (scene_.lights.empty()) {
            return c;
        }
        const auto& f = scene_.transfer_function;
        double range = 0.0;
        for (const Member& member : members_) {
            double low = infinity, high = -infinity;
            for (const Sample& sample : member.samples) {
                low = std::min(low, sample.value);
                high = std::max(high, sample.value);
            }
            range = std::max(range, high - low);
        }
        const double weakest = 1e-3 * std::max(f.v_max() - f.v_min(), range / 4096.0) / reference_length_;
        const Vec3 n = g == Vec3(0.0) ? g : -g / std::max(glm::length(g), weakest);
        const Vec3 v = -glm::normalize(ray(i, j));
        const Material& m = scene_.material;
        Vec3 color = c * m.ambient;
        for (const Light& light : scene_.lights) {
            const Vec3 l = glm::normalize(light.space == LightSpace::eye ? light.direction
                                                                         : camera_.direction_to_eye(light.direction));
            const Vec3 side = m.two_sided && glm::dot(n, l) < 0.0 ? -n : n;
            const double nl = glm::dot(side, l);
            const Vec3 r = 2.0 * nl * side - l;
            color += light.color * std::max(0.0, nl) *
                     (c * m.diffuse +
                      m.specular * std::pow(std::max(0.0, glm::dot(r, v)), m.shininess + mistakes_.shininess));
        }
        return color;
    }

    // Means of tau and tau c over the ramp, the opacity's limit and the function's points being the only places where
    // it is not smooth.
    void interval(double front, double back, double& tau, Vec3& tau_color) const {
        const double limit = 1.0 - std::pow(2.0, -24);
        const auto extinction = [&](double value) {
            return -std::log1p(-std::min(function(value).opacity, limit)) / reference_length_;
        };
        if (front == back) {
            tau = extinction(front);
            tau_color = tau * function(front).color;
            return;
        }
        const double lower = std::min(front, back), upper = std::max(front, back);
        std::vector<double> ends{lower, upper};
        const auto& points = scene_.transfer_function.points();
        for (std::size_t n = 0; n < points.size(); ++n) {
            ends.push_back(points[n].value - base_);
            if (n > 0 && points[n].opacity != points[n - 1].opacity) {
                const double x = (limit - points[n - 1].opacity) / (points[n].opacity - points[n - 1].opacity);
                if (x > 0.0 && x < 1.0) {
                    ends.push_back(points[n - 1].value - base_ + x * (points[n].value - points[n - 1].value));
                }
            }
        }
        std::sort(ends.begin(), ends.end());
        tau = 0.0;
        tau_color = Vec3(0.0);
        for (std::size_t n = 0; n + 1 < ends.size(); ++n) {
            const double from = std::max(ends[n], lower), to = std::min(ends[n + 1], upper);
            if (from >= to) {
                continue;
            }
            const double length = upper - lower;
            tau += integrate(extinction, from, to, 1e-14 * length) / length;
            for (int c = 0; c < 3; ++c) {
                tau_color[c] += integrate([&](double v) { return extinction(v) * function(v).color[c]; }, from, to,
                                          1e-14 * length) /
                                length;
            }
        }
    }

    void add_pixel(int i, int j, Picture& result) const {
        const double s = secant(i, j);
        double coverage = 0.0, scalar = 0.0, counted = 0.0, opacity = 0.0, half_depth = infinity;
        Vec3 color(0.0);
        const auto behind = [&](const Vec3& c, double alpha, double t) {
            color += (1.0 - opacity) * alpha * c;
            opacity += (1.0 - opacity) * alpha;
            if (opacity >= 0.5 && half_depth == infinity) {
                half_depth = t;
            }
        };
        bool crossed = false;
        for (int n = first_ - 1; n <= first_ + count_; ++n) {
            const Point here = point(i, j, n), next = point(i, j, n + 1);
            coverage += here.w * spacing_ * s;
            const bool scalar_mode = scene_.mode != Mode::composite && scene_.mode != Mode::isosurface;
            if (scalar_mode) {
                if (here.counts) {
                    const double rho = base_ + here.rho;
                    counted += 1.0;
                    scalar = scene_.mode == Mode::xray      ? scalar + rho * spacing_ * s
                             : scene_.mode == Mode::average ? scalar + rho
                             : counted == 1.0               ? rho
                             : scene_.mode == Mode::minimum ? std::min(scalar, rho)
                                                            : std::max(scalar, rho);
                }
            } else if (scene_.mode == Mode::isosurface) {
                const double iso = scene_.iso_values.front().value - base_;
                // Between what the near plane removes and what it leaves nothing crosses.
                const bool cut = perspective() && depth(n) <= camera_.near() && met_by_support(n);
                if (!cut && !crossed && inside(i, j, n) && inside(i, j, n + 1) &&
                    (here.rho < iso) != (next.rho < iso)) {
                    const double x = (iso - here.rho) / (next.rho - here.rho);
                    const Vec3 g = gradient(i, j, n) * (1.0 - x) + gradient(i, j, n + 1) * x;
                    behind(shaded(function(iso).color, g, i, j), 1.0, depth(n) + x * spacing_);
                    crossed = true;
                }
            } else if (opacity >= scene_.opacity_stop) {
                continue;
            } else if (scene_.preintegration) {
                double tau = 0.0;
                Vec3 tau_color(0.0);
                if (!here.empty || !next.empty) {
                    interval(here.rho, next.rho, tau, tau_color);
                }
                if (tau > 0.0) {
                    behind(shaded(tau_color / tau, 0.5 * (gradient(i, j, n) + gradient(i, j, n + 1)), i, j),
                           -std::expm1(-spacing_ * s * tau), std::max(depth(n) + 0.5 * spacing_, first_depth()));
                }
            } else if (!here.empty) {
                const TransferPoint looks = function(here.rho);
                behind(shaded(looks.color, gradient(i, j, n), i, j),
                       -std::expm1(spacing_ * s / reference_length_ * std::log1p(-looks.opacity)), depth(n));
            }
        }
        if (scene_.mode != Mode::composite && scene_.mode != Mode::isosurface) {
            const bool average = scene_.mode == Mode::average;
            result.scalar.push_back(counted > 0.0               ? scalar / (average ? counted : 1.0)
                                    : scene_.mode == Mode::xray ? 0.0
                                                                : std::numeric_limits<double>::quiet_NaN());
        } else {
            if (scene_.background) {
                color += (1.0 - opacity) * *scene_.background;
                opacity = 1.0;
            }
            result.rgba.insert(result.rgba.end(), {color.x, color.y, color.z, opacity});
        }
        result.coverage.push_back(coverage);
        result.depth.push_back(half_depth);
    }

    const Scene& scene_;
    const Camera& camera_;
    Size size_;
    Mistakes mistakes_;
    double spacing_, reference_length_;
    std::vector<Member> members_;
    std::optional<Box> domain_; ///< of all fields
    double base_ = 0.0;         ///< of all fields
    Vec3 centre_{0.0};
    double anchor_ = 0.0;
    int first_ = 0, count_ = 0;
    std::vector<Point> points_;
};

} // namespace sheetsplat::reference::testing

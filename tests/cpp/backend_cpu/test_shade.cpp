// Classification, shading and compositing of one slab, for every instruction set that was compiled and runs here,
// against a plain float64 statement of conventions, sections 4 to 7.
#include <cfenv>
#include <cmath>
#include <random>
#include <string>
#include <utility>

#include <glm/geometric.hpp>
#include <gtest/gtest.h>

#include "backend_cpu/tile_task.hpp"
#include "base/instruction_set.hpp"
#include "plan/make_plan.hpp"
#include "shade_truth.hpp"

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
        const bool weighted = c.plan.empty_test || c.plan.coverage || c.plan.mode == Mode::mip;
        for (int k = 0; k < 2 && weighted; ++k) {
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
    c.scene.iso_values = {single(random.uniform(0.1, 0.6)) * unit};
    c.frame.size = {random.whole(40, 70), random.whole(30, 60)};
    c.frame.axis_x = 0.5 * c.frame.size.width;
    c.frame.axis_y = 0.5 * c.frame.size.height;
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
            const int points = random.chance(0.3) ? 1 : random.chance(0.3) ? 40 : 6;
            Case c = random_case(random, mode, k % 4 == 2, random.chance(0.5), points);
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

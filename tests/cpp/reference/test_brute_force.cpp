// The renderer against a second evaluator of conventions, written against the page and not against the renderer:
// for each pixel and slice it visits every kernel, in world space, and integrates slabs and pre-integrated intervals
// numerically. Kernels are quadratic forms here, inverted and filtered as products: what the renderer avoids.
#include <map>
#include <string>

#include <gtest/gtest.h>

#include "brute_force.hpp"
#include "support.hpp"
#include "support/lattices.hpp"

namespace sheetsplat::reference::testing {

namespace {

struct Dice {
    std::mt19937_64 generator;
    double real(double from, double to) { return std::uniform_real_distribution<double>(from, to)(generator); }
    int whole(int from, int to) { return std::uniform_int_distribution<int>(from, to)(generator); }
    bool one_in(int sides) { return whole(1, sides) == 1; }
    Vec3 color() { return {real(0.0, 1.0), real(0.0, 1.0), real(0.0, 1.0)}; }
    Vec3 direction() {
        for (;;) {
            const Vec3 v(real(-1.0, 1.0), real(-1.0, 1.0), real(-1.0, 1.0));
            if (glm::length(v) > 0.2 && glm::length(v) < 1.0) {
                return glm::normalize(v);
            }
        }
    }
};

/// Now and then one that ends where `like` does.
std::shared_ptr<const RegularField> random_field(Dice& dice, const Field* like = nullptr) {
    RegularFieldOptions options = test::zero_boundary();
    options.boundary = dice.one_in(2) ? Boundary::edge : Boundary::zero;
    if (dice.one_in(3)) {
        options.base = dice.real(-1.0, 1.0);
    }
    options.spacing = Vec3(dice.real(0.6, 1.6), dice.real(0.6, 1.6), dice.real(0.6, 1.6));
    options.origin = Vec3(dice.real(-3.0, 3.0), dice.real(-3.0, 3.0), dice.real(-3.0, 3.0));
    options.lattice = dice.one_in(3) ? Lattice::bcc : Lattice::cartesian;
    options.radius = dice.real(0.8, 2.4);
    options.falloff = dice.real(2.0, 9.0);
    options.normalization =
        std::array{Normalization::none, Normalization::lattice, Normalization::threshold}[dice.generator() % 3];
    options.w0 = dice.real(0.1, 1.5);
    options.nan = NanPolicy::skip;
    std::array<std::size_t, 3> shape{static_cast<std::size_t>(dice.whole(1, 4)),
                                     static_cast<std::size_t>(dice.whole(1, 4)),
                                     static_cast<std::size_t>(dice.whole(2, 5))};
    if (const RegularField* lattice = as_regular(like); lattice != nullptr && dice.one_in(2)) {
        options.boundary = lattice->options().boundary;
        options.lattice = lattice->options().lattice;
        options.spacing = lattice->options().spacing;
        options.origin = lattice->options().origin;
        shape = lattice->shape();
    }
    const int missing = dice.one_in(3) ? 2 : 8;
    auto samples = sampled(shape, [&](int, int, int) {
        return dice.one_in(6)         ? 0.0
               : dice.one_in(missing) ? std::numeric_limits<double>::quiet_NaN()
                                      : dice.real(-0.4, 1.0);
    });
    samples[0] = 0.7;
    return make_field(std::move(samples), shape, options);
}

std::shared_ptr<const EllipsoidField> random_ellipsoids(Dice& dice) {
    EllipsoidFieldOptions options;
    options.normalization =
        std::array{Normalization::none, Normalization::lattice, Normalization::threshold}[dice.generator() % 3];
    options.falloff = dice.real(2.0, 9.0);
    options.w0 = dice.real(0.1, 1.5);
    options.cell_volume = dice.real(0.2, 3.0);
    options.base = dice.one_in(3) ? dice.real(-1.0, 1.0) : 0.0;
    const bool one_volume = options.normalization == Normalization::lattice;
    const bool spheres = !one_volume && dice.one_in(5), turned = !dice.one_in(5), weighted = dice.one_in(2);
    const Vec3 same(dice.real(0.3, 1.0), dice.real(0.3, 2.0), dice.real(0.5, 2.5));
    EllipsoidArrays arrays;
    const int count = dice.whole(1, 12);
    for (int n = 0; n < count; ++n) {
        arrays.centers.emplace_back(dice.real(-2.5, 2.5), dice.real(-2.5, 2.5), dice.real(-2.5, 2.5));
        if (spheres) {
            arrays.radii.push_back(dice.real(0.2, 2.0));
        } else {
            arrays.scales.push_back(one_volume ? same
                                               : Vec3(dice.real(0.1, 2.0), dice.real(0.1, 2.0), dice.real(0.2, 2.0)));
        }
        if (turned) {
            arrays.rotations.push_back(random_rotation(dice.generator));
        }
        arrays.values.push_back(dice.one_in(6) ? 0.0 : dice.real(-0.4, 1.0));
        if (weighted) {
            arrays.weights.push_back(n > 0 && dice.one_in(4) ? 0.0 : dice.real(0.1, 2.0));
        }
    }
    return make_ellipsoids(std::move(arrays), options);
}

TransferFunction random_function(Dice& dice) {
    std::vector<TransferPoint> points;
    double value = dice.real(-0.5, 0.3);
    const int count = dice.whole(1, 5);
    for (int n = 0; n < count; ++n) {
        points.push_back({value, dice.color(), dice.one_in(6) ? 1.0 : dice.one_in(4) ? 0.0 : dice.real(0.0, 0.9)});
        value += dice.one_in(4) ? 0.0 : dice.real(0.05, 0.5);
    }
    if (dice.one_in(2)) {
        // Nothing at 0, so that kernels of value 0 are left out.
        points.insert(points.begin(), {-2.0, dice.color(), 0.0});
        points.insert(points.begin() + 1, {0.0, dice.color(), 0.0});
        for (std::size_t n = 2; n < points.size(); ++n) {
            points[n].value += 0.6;
        }
    }
    return TransferFunction(points);
}

struct RandomPicture {
    Scene scene;
    Camera camera;
    Size size;
};

enum class Kinds { lattices, ellipsoids };

/// Kinds::ellipsoids: at least one field of them, the others of any kind, and now and then the EWA filter.
RandomPicture random_picture(unsigned seed, Kinds kinds = Kinds::lattices) {
    Dice dice{std::mt19937_64(seed)};
    std::shared_ptr<const Field> first;
    if (kinds == Kinds::ellipsoids) {
        first = random_ellipsoids(dice);
    } else {
        first = random_field(dice);
    }
    Scene scene{{first}, random_function(dice)};
    if (dice.one_in(3)) {
        if (kinds == Kinds::ellipsoids && dice.one_in(3)) {
            scene.fields.push_back(random_ellipsoids(dice));
        } else {
            scene.fields.push_back(random_field(dice, first.get()));
        }
    }
    if (kinds == Kinds::ellipsoids && dice.one_in(3)) {
        scene.filter = Filter::ewa;
    }
    scene.slice_spacing = dice.real(0.25, 1.5);
    scene.sampling = dice.one_in(2) ? Sampling::slab : Sampling::point;
    scene.reference_length = dice.real(0.5, 2.0);
    scene.mode = std::array{
        Mode::composite, Mode::composite, Mode::composite, Mode::isosurface, Mode::xray, Mode::mip}[seed % 6];
    if (scene.mode == Mode::mip) {
        scene.mode = std::array{Mode::mip, Mode::minimum, Mode::average}[dice.generator() % 3];
    }
    if (scene.mode == Mode::isosurface) {
        scene.iso_values = {dice.real(-0.1, 0.5)};
    }
    scene.preintegration = scene.mode == Mode::composite && dice.one_in(3);
    scene.opacity_stop = dice.one_in(2) ? 1.0 : dice.real(0.4, 0.95);
    const int lights = dice.whole(0, 3);
    for (int n = 0; n < lights; ++n) {
        scene.lights.push_back(
            {3.0 * dice.direction(), dice.color(), dice.one_in(2) ? LightSpace::eye : LightSpace::world});
    }
    scene.material = {dice.real(0.0, 0.5), dice.real(0.0, 1.0), dice.real(0.0, 0.8), dice.real(0.0, 20.0),
                      dice.one_in(2)};
    if (dice.one_in(3)) {
        scene.background = dice.color();
    }
    const Box box = scene.centres_world();
    const Vec3 target = box.centre() + dice.real(0.0, 1.0) * dice.direction();
    // Now and then the eye is among the kernels.
    const double distance = dice.one_in(4) ? dice.real(0.3, 2.0) : dice.real(4.0, 15.0);
    const Vec3 eye = target + distance * dice.direction();
    const Vec3 up = dice.direction();
    const Camera camera =
        dice.one_in(2) ? Camera::orthographic(eye, target, up, dice.real(2.0, 10.0))
                       : Camera::perspective(eye, target, up, dice.real(15.0, 90.0), dice.real(0.05, 1.0) * distance);
    // Wide ones too: in those the renderer looks for the ends of each row.
    const Size size = kinds == Kinds::ellipsoids && dice.one_in(2) ? Size{dice.whole(25, 50), dice.whole(1, 3)}
                                                                   : Size{dice.whole(1, 7), dice.whole(1, 6)};
    return {scene, camera, size};
}

/// Largest difference over all outputs; scalars are divided by max(1, largest reference value), depths by 1 as they
/// are.
double distance(const Picture& a, const Picture& b) {
    double largest = largest_difference(a.rgba, b.rgba);
    if (!a.scalar.empty() || !b.scalar.empty()) {
        largest = std::max(largest, largest_difference(a.scalar, b.scalar) / std::max(1.0, largest_of(b.scalar)));
    }
    largest = std::max(largest, largest_difference(a.coverage, b.coverage) / std::max(1.0, largest_of(b.coverage)));
    return std::max(largest, largest_difference(a.depth, b.depth));
}

Picture brute_force(const RandomPicture& random, const Mistakes& mistakes = {}) {
    return Page(random.scene, random.camera, random.size, mistakes).picture();
}

constexpr double tolerance = 1e-12;
constexpr unsigned scenes = 120;

} // namespace

TEST(BruteForce, RandomScenesAgree) {
    Request request;
    request.coverage = request.depth = true;
    double worst = 0.0;
    int showing = 0;
    std::map<std::string, int> kinds;
    for (unsigned seed = 0; seed < scenes; ++seed) {
        const RandomPicture random = random_picture(seed);
        const Picture expected = brute_force(random);
        const Picture actual = render(random.scene, random.camera, random.size, request);
        const double difference = distance(actual, expected);
        EXPECT_LE(difference, tolerance) << "seed " << seed;
        worst = std::max(worst, difference);
        showing += largest_of(expected.coverage) > 0.0 ? 1 : 0;
        // Without coverage kernels of value 0 may be left out, which must not show.
        Request less;
        less.depth = true;
        const Picture lean = render(random.scene, random.camera, random.size, less);
        EXPECT_LE(largest_difference(lean.rgba, actual.rgba), tolerance) << "seed " << seed;
        EXPECT_LE(largest_difference(lean.scalar, actual.scalar), tolerance) << "seed " << seed;
        kinds[lean.kernels_drawn < actual.kernels_drawn ? "left out" : "all drawn"] += 1;
        kinds[random.camera.projection() == Projection::perspective ? "perspective" : "orthographic"] += 1;
        kinds[random.scene.sampling == Sampling::slab ? "slab" : "point"] += 1;
        kinds[random.scene.preintegration ? "preintegrated" : "plain"] += 1;
        const RegularField& lattice = *as_regular(random.scene.fields.front().get());
        kinds[lattice.domain() ? "ends" : "does not end"] += 1;
        kinds[lattice.base() != 0.0 ? "based" : "counted from 0"] += 1;
        kinds[lattice.least_weight() > 0.0 ? "empty in holes" : "no holes"] += 1;
        const auto nothing = [](double value) { return std::isnan(value); };
        kinds[std::any_of(actual.scalar.begin(), actual.scalar.end(), nothing) ? "no number" : "numbers"] += 1;
    }
    std::printf("largest difference of %u scenes: %.2e, %d of them not empty\n", scenes, worst, showing);
    EXPECT_GE(showing, static_cast<int>(scenes) * 3 / 4);
    for (const char* kind :
         {"left out", "all drawn", "perspective", "orthographic", "slab", "point", "preintegrated", "plain", "ends",
          "does not end", "based", "counted from 0", "empty in holes", "no holes", "no number", "numbers"}) {
        EXPECT_GE(kinds[kind], 5) << kind;
    }
}

TEST(BruteForce, SmallMistakesAreSeen) {
    Request request;
    request.coverage = request.depth = true;
    struct Case {
        const char* name;
        Mistakes mistakes;
        int seen_at_least;
    };
    constexpr unsigned tried = 60;
    const auto mistake = [](double Mistakes::*which, double size) {
        Mistakes mistakes;
        mistakes.*which = size;
        return mistakes;
    };
    Mistakes repeated;
    repeated.repeated = true;
    for (const Case& c :
         {Case{"base", mistake(&Mistakes::base, 1e-9), 20}, Case{"hole", mistake(&Mistakes::hole, 0.8), 3},
          Case{"domain", mistake(&Mistakes::domain, 0.2), 10}, Case{"repeated", repeated, 8},
          Case{"falloff", mistake(&Mistakes::falloff, 1e-9), 40}, Case{"secant", mistake(&Mistakes::secant, 1e-9), 40},
          Case{"depth", mistake(&Mistakes::depth, 1e-9), 40},
          Case{"shininess", mistake(&Mistakes::shininess, 1e-7), 7}}) {
        int seen = 0;
        for (unsigned seed = 0; seed < tried; ++seed) {
            const RandomPicture random = random_picture(seed);
            const Picture actual = render(random.scene, random.camera, random.size, request);
            seen += distance(actual, brute_force(random, c.mistakes)) > tolerance ? 1 : 0;
        }
        std::printf("%s: seen in %d of %u scenes\n", c.name, seen, tried);
        EXPECT_GE(seen, c.seen_at_least) << c.name;
    }
}

TEST(BruteForce, RandomEllipsoidsAgree) {
    Request request;
    request.coverage = request.depth = true;
    double worst = 0.0;
    int showing = 0;
    std::map<std::string, int> kinds;
    for (unsigned seed = 0; seed < scenes; ++seed) {
        const RandomPicture random = random_picture(seed, Kinds::ellipsoids);
        const Picture expected = brute_force(random);
        const double difference = distance(render(random.scene, random.camera, random.size, request), expected);
        EXPECT_LE(difference, tolerance) << "seed " << seed;
        worst = std::max(worst, difference);
        showing += largest_of(expected.coverage) > 0.0 ? 1 : 0;
        Request less;
        less.depth = true;
        const Picture lean = render(random.scene, random.camera, random.size, less);
        EXPECT_LE(largest_difference(lean.rgba, expected.rgba), tolerance) << "seed " << seed;
        const bool perspective = random.camera.projection() == Projection::perspective;
        const bool slab = random.scene.sampling == Sampling::slab, ewa = random.scene.filter == Filter::ewa;
        kinds[std::string(perspective ? "perspective" : "orthographic") + (slab ? " slab" : " point") +
              (ewa ? " ewa" : "")] += 1;
        kinds[random.scene.fields.size() == 1                          ? "alone"
              : random.scene.fields[1]->kind() == FieldKind::ellipsoid ? "two of ellipsoids"
                                                                       : "with a lattice"] += 1;
    }
    std::printf("largest difference of %u scenes of ellipsoids: %.2e, %d of them not empty\n", scenes, worst, showing);
    EXPECT_GE(showing, static_cast<int>(scenes) * 3 / 4);
    for (const char* kind : {"perspective slab", "perspective point", "orthographic slab", "orthographic point",
                             "perspective slab ewa", "perspective point ewa", "orthographic slab ewa",
                             "orthographic point ewa", "alone", "two of ellipsoids", "with a lattice"}) {
        EXPECT_GE(kinds[kind], 3) << kind;
    }
}

TEST(BruteForce, SmallMistakesInEllipsoidsAreSeen) {
    Request request;
    request.coverage = request.depth = true;
    constexpr unsigned tried = 36;
    int turned = 0, weighed = 0, filtered = 0, of_filtered = 0;
    for (unsigned seed = 0; seed < tried; ++seed) {
        const RandomPicture random = random_picture(seed, Kinds::ellipsoids);
        const Picture actual = render(random.scene, random.camera, random.size, request);
        Mistakes turn, weight, filter;
        turn.turn = weight.weight = filter.filter = 1e-9;
        turned += distance(actual, brute_force(random, turn)) > tolerance ? 1 : 0;
        weighed += distance(actual, brute_force(random, weight)) > tolerance ? 1 : 0;
        if (random.scene.filter == Filter::ewa) {
            ++of_filtered;
            filtered += distance(actual, brute_force(random, filter)) > tolerance ? 1 : 0;
        }
    }
    EXPECT_GE(turned, 24);
    EXPECT_GE(weighed, 24);
    EXPECT_GE(of_filtered, 8);
    EXPECT_GE(filtered, of_filtered * 3 / 4);
}

} // namespace sheetsplat::reference::testing

// Fields of every kind, views, modes and effects in every combination: pictures of each instruction set and number
// format against the float64 reference. Arithmetic that makes a NaN or an infinity is found by the processor's own
// flags.
#include <functional>
#include <string>

#include <gtest/gtest.h>

#include "renderer_scenes.hpp"
#include "support/lattices.hpp"

namespace sheetsplat::backend_cpu {
namespace {

/// Fields of every kind.
struct Kind {
    const char* name;
    std::vector<std::shared_ptr<const Field>> fields;
    bool slender = false;
    bool ewa = false;
    double slice_spacing = 0.0; ///< 0: the default
    double iso_value = 0.4;
};

std::vector<Kind> kinds() {
    RegularFieldOptions bcc = test::zero_boundary();
    bcc.lattice = Lattice::bcc;
    bcc.spacing = Vec3(1.3);
    RegularFieldOptions unequal = test::zero_boundary();
    unequal.spacing = Vec3(1.0, 1.7, 0.8);
    unequal.normalization = Normalization::threshold;
    unequal.w0 = 0.5;
    RegularFieldOptions small = test::zero_boundary();
    small.spacing = Vec3(0.12);
    small.normalization = Normalization::none;
    EllipsoidFieldOptions thin;
    thin.w0 = 0.1;
    return {
        {"cartesian", {ball(9)}},
        {"bcc", {ball(8, bcc)}},
        {"unequal", {ball(7, unequal)}},
        {"spheres", {cloud(60, 0.17, 1.0)}, false, false, 0.05},
        {"1:5", {cloud(60, 0.17, 5.0)}, false, false, 0.05},
        {"1:1000", {cloud(60, 0.12, 1000.0, 5, thin)}, true, false, 0.05, 0.2},
        {"ewa", {cloud(60, 0.12, 5.0)}, false, true, 0.08, 0.1},
        {"ewa cartesian", {ball(9)}, false, true},
        {"ewa unequal", {ball(7, unequal)}, false, true, 0.6},
        {"several", {ball(7, small), cloud(30, 0.15, 1.0), cloud(30, 0.15, 3.0, 8, thin)}, false, false, 0.06},
    };
}

std::vector<Named> matrix() {
    struct View {
        const char* name;
        std::function<Camera(const Field&)> camera;
    };
    const View views[] = {{"ortho", [](const Field& f) { return askew(f, Projection::orthographic); }},
                          {"persp", [](const Field& f) { return askew(f, Projection::perspective); }},
                          {"inside", [](const Field& f) { return test::inside(f); }}};
    struct How {
        const char* name;
        Mode mode;
        bool preintegration;
        std::function<void(Scene&, const Camera&)> add_effects;
        bool of_several = false; ///< for several fields alone
        bool slender = false;    ///< for slender kernels too
    };
    const auto plain = [](Scene&, const Camera&) {};
    const auto second_order = [](Scene& scene, const Camera&) { scene.second_order = true; };
    const auto derivatives = [](Scene& scene, const Camera& camera) {
        scene.gradient = Gradient::analytic;
        clip(scene);
        cue(scene, camera);
    };
    const auto faded = [](Scene& scene, const Camera& camera) {
        // (Widened kernels are low.)
        scene.gradient_opacity = (scene.filter == Filter::ewa ? 0.02 : 0.1) / scene.reference_distance();
        clip(scene);
        cue(scene, camera);
    };
    const auto clipped = [](Scene& scene, const Camera&) { clip(scene); };
    // Of several fields each is a group of its own, with colours and a window of its own.
    const auto groups = [](Scene& scene, const Camera&) {
        for (std::size_t field = 1; field < scene.fields.size(); ++field) {
            std::vector<TransferPoint> points = scene.transfer_function.points();
            for (TransferPoint& point : points) {
                point.value *= 1.0 - 0.15 * static_cast<double>(field);
                point.color = Vec3(point.color.z, point.color.x, 0.8 * point.color.y);
            }
            scene.later_groups.push_back({field, TransferFunction(points)});
        }
        scene.iso_values = {{1.2 * scene.iso_values.front().value, 1.0},
                            {0.5 * scene.iso_values.front().value, 0.3},
                            {0.8 * scene.iso_values.front().value, 0.5}};
    };
    const auto groups_derivatives = [groups, derivatives](Scene& scene, const Camera& camera) {
        groups(scene, camera);
        derivatives(scene, camera);
    };
    const How hows[] = {{"composite", Mode::composite, false, plain, false, true},
                        {"preintegration", Mode::composite, true, plain, false, true},
                        {"isosurface", Mode::isosurface, false, plain, false, true},
                        {"xray", Mode::xray, false, plain, false, true},
                        {"mip", Mode::mip, false, plain, false, true},
                        {"second order", Mode::composite, true, second_order, false, true},
                        {"derivatives", Mode::composite, false, derivatives},
                        {"faded", Mode::composite, true, faded},
                        {"clipped isosurface", Mode::isosurface, false, derivatives},
                        {"clipped xray", Mode::xray, false, clipped},
                        {"clipped mip", Mode::mip, false, clipped},
                        {"groups", Mode::composite, false, groups, true},
                        {"derivatives of groups", Mode::composite, true, groups_derivatives, true},
                        {"surfaces of groups", Mode::isosurface, false, groups, true},
                        {"clipped surfaces of groups", Mode::isosurface, false, groups_derivatives, true},
                        {"minimum", Mode::minimum, false, plain, true},
                        {"clipped average", Mode::average, false, clipped, true}};
    std::vector<Named> all;
    for (const Kind& kind : kinds()) {
        for (const View& view : views) {
            for (const Sampling sampling : {Sampling::point, Sampling::slab}) {
                if (kind.ewa && sampling == Sampling::slab) {
                    continue;
                }
                for (const How& how : hows) {
                    // Of few needles a clip leaves next to nothing.
                    if ((kind.slender && !how.slender) || (how.of_several && kind.fields.size() == 1)) {
                        continue;
                    }
                    Shot shot = shot_of(kind.fields, view.camera(*kind.fields.back()));
                    Scene& scene = shot.scene;
                    scene.sampling = sampling;
                    scene.mode = how.mode;
                    scene.preintegration = how.preintegration;
                    scene.filter = kind.ewa ? Filter::ewa : Filter::none;
                    scene.iso_values = {kind.iso_value};
                    if (kind.slice_spacing > 0.0) {
                        scene.slice_spacing = kind.slice_spacing;
                    }
                    how.add_effects(scene, shot.camera);
                    shot.size = {34, 30};
                    shot.outputs = {how.mode == Mode::composite, how.mode == Mode::composite};
                    all.push_back({std::string(kind.name) + " " + view.name +
                                       (sampling == Sampling::slab ? " slab " : " point ") + how.name,
                                   shot, kind.slender});
                }
            }
        }
    }
    return all;
}

/// Parts of the matrix side by side.
constexpr std::size_t matrix_parts = 8;
class Matrix : public ::testing::TestWithParam<std::size_t> {};

TEST_P(Matrix, IsTheReferencesPictureWithoutAFloatingPointException) {
    const SetChoice choice;
    const std::vector<Named> all = matrix();
    const std::vector<std::string> sets = instruction_sets();
    ASSERT_FALSE(sets.empty());
    double worst[2] = {0.0, 0.0};
    std::string worst_name[2];
    for (std::size_t number = GetParam(); number < all.size(); number += matrix_parts) {
        const Named& one = all[number];
        const reference::Picture judge = test::reference_of(one.shot);
        // (Where kernels end their sums fall to 0: so do minima.)
        EXPECT_GT(test::largest(pixels_of(judge)), one.shot.scene.mode == Mode::minimum ? 1e-3 : 0.01) << one.name;
        if (number == GetParam()) {
            // Supports that are a thousandth larger are seen.
            reference::Request larger;
            larger.nudge_radius = 1e-3;
            const reference::Picture other = reference::render(one.shot.scene, one.shot.camera, one.shot.size, larger);
            EXPECT_GT(distance(pixels_of(other), pixels_of(judge), judge.rgba.empty()).rms, 1e-5) << one.name;
        }
        const bool jumps = one.shot.scene.mode == Mode::isosurface;
        // Pixels that jump are looked for, and left out, only where a picture is farther off with them.
        std::vector<unsigned char> ambiguous;
        for (const Precision precision : {Precision::float32, Precision::float64}) {
            if (precision == Precision::float32 && one.slender) {
                continue;
            }
            const bool fine = precision == Precision::float64;
            const CpuDrawing drawing(one.shot, precision);
            ASSERT_EQ(drawing.plan().precision, precision) << one.name;
            for (const std::string& set : sets) {
                choose_instruction_set(set);
                const std::string name = one.name + (fine ? " float64 " : " float32 ") + set;
                const Raised raised;
                const Image image = drawing.draw();
                EXPECT_EQ(raised.names(), "") << name;
                // float64: what rounding to the picture's float32 takes, and no more.
                const double most_rms = fine ? 3e-8 : jumps ? 1e-5 : 2e-6, most = fine ? 1e-7 : jumps ? 3e-4 : 5e-5;
                Distance off = distance(image, judge);
                if (jumps && (off.rms > most_rms || off.most > most)) {
                    if (ambiguous.empty()) {
                        ambiguous = reference::ambiguous_pixels(one.shot.scene, one.shot.camera, one.shot.size);
                    }
                    off = distance(image, judge, &ambiguous);
                }
                if (off.rms > worst[fine ? 1 : 0]) {
                    worst[fine ? 1 : 0] = off.rms;
                    worst_name[fine ? 1 : 0] = name;
                }
                EXPECT_LE(off.rms, most_rms) << name;
                EXPECT_LE(off.most, most) << name;
                if (one.shot.outputs.coverage) {
                    EXPECT_LE(distance(image.coverage, judge.coverage, true).rms, fine ? 4e-8 : 2e-6) << name;
                    std::size_t other = 0;
                    for (std::size_t p = 0; p < judge.depth.size(); ++p) {
                        other += static_cast<double>(image.depth[p]) ==
                                         static_cast<double>(static_cast<float>(judge.depth[p]))
                                     ? 0U
                                     : 1U;
                    }
                    // Depth jumps where opacity comes close to one half.
                    EXPECT_LE(other, fine ? 0U : 2U) << name;
                }
            }
        }
    }
    std::printf("largest rmse: %.2e (%s), %.2e (%s)\n", worst[0], worst_name[0].c_str(), worst[1],
                worst_name[1].c_str());
}

INSTANTIATE_TEST_SUITE_P(Parts, Matrix, ::testing::Range(std::size_t{0}, matrix_parts));

} // namespace
} // namespace sheetsplat::backend_cpu

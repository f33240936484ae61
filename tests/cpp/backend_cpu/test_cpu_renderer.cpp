// Whole pictures of backend_cpu::CpuRenderer against closed forms, and against themselves with other tiles, threads and
// orders.
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <numeric>
#include <string>
#include <vector>

#include <glm/geometric.hpp>
#include <gtest/gtest.h>

#include "backend_cpu/tile_feed.hpp"
#include "renderer_scenes.hpp"
#include "sheetsplat/error.hpp"
#include "support/lattices.hpp"

namespace sheetsplat::backend_cpu {
namespace {

TEST(CpuRenderer, ThreadsAndFormerPicturesChangeNoBit) {
    for (const Named& one : some_scenes()) {
        Shot shot = one.shot;
        shot.size = {70, 50};
        for (const Precision precision : {Precision::float32, Precision::float64}) {
            const CpuDrawing drawing(shot, precision);
            const Image first = drawing.draw();
            for (const int threads : {1, 2, 3, 7}) {
                CpuRenderer renderer;
                const Image image = drawing.draw(renderer, {0, threads});
                EXPECT_EQ(image.stats.at("threads"), threads);
                EXPECT_EQ(image.stats.at("buckets_reused"), 0.0);
                EXPECT_EQ(pixels_of(image), pixels_of(first)) << one.name << ", threads " << threads;
                EXPECT_EQ(image.depth, first.depth) << one.name << ", threads " << threads;
                const Image again = drawing.draw(renderer, {0, threads});
                EXPECT_EQ(again.stats.at("buckets_reused"), 1.0);
                EXPECT_EQ(pixels_of(again), pixels_of(first)) << one.name << " again, threads " << threads;
                EXPECT_EQ(again.depth, first.depth) << one.name << " again, threads " << threads;
            }
        }
    }
}

/// What light has lost before slices 0, every, 2 every ... of an orthographic view, with an element on each pixel's
/// centre.
LightVolume lost_before_slices(CpuRenderer& renderer, const Job& job, int every) {
    const Frame& frame = *job.frame;
    const Camera& camera = *job.camera;
    const std::int64_t planes = (frame.slices + every - 1) / every;
    LightVolume volume;
    volume.counts = {frame.size.width, frame.size.height, static_cast<int>(planes) + 1};
    volume.per_step = {camera.right_world() / frame.pixel, -camera.up_world() / frame.pixel,
                       -camera.back_world() / (frame.slice_spacing * every)};
    volume.origin = camera.eye() + frame.eye_x(0) * camera.right_world() + frame.eye_y(0) * camera.up_world() -
                    frame.first_depth * camera.back_world();
    const std::size_t plane = volume.index(0, 0, 1);
    volume.values.assign(plane * static_cast<std::size_t>(planes + 1), 0.0F);
    renderer.absorb(job, every, volume.values.data() + plane);
    for (std::size_t element = plane; element < volume.values.size(); ++element) {
        volume.values[element] += volume.values[element - plane];
    }
    return volume;
}

/// What light loses on its way is what the picture of the flat, unlit scene is made of.
TEST(CpuRenderer, AbsorptionIsThatOfTheUnlitPicture) {
    for (const auto& field : std::vector<std::shared_ptr<const Field>>{ball(12), cloud(80, 0.16, 4.0)}) {
        Shot shot = shot_of({field}, askew(*field, Projection::orthographic, 1.1));
        shot.size = {57, 41};
        shot.scene.lights.clear();
        shot.scene.slice_spacing = 0.7 * shot.scene.default_slice_spacing();
        clip(shot.scene);
        for (const Precision precision : {Precision::float32, Precision::float64}) {
            const CpuDrawing drawing(shot, precision);
            CpuRenderer renderer;
            const Image image = drawing.draw(renderer);
            const LightVolume volume = lost_before_slices(renderer, drawing.job_with({}), 1);
            EXPECT_EQ(drawing.draw(renderer).stats.at("buckets_reused"), 1.0);
            const Frame& frame = drawing.frame();
            const int slices = static_cast<int>(frame.slices);
            ASSERT_EQ(volume.counts, (std::array<int, 3>{57, 41, slices + 1}));
            double densest = 0.0;
            for (int y = 0; y < 41; ++y) {
                for (int x = 0; x < 57; ++x) {
                    EXPECT_EQ(volume.values[volume.index(x, y, 0)], 0.0F);
                    const auto lost = static_cast<double>(volume.values[volume.index(x, y, slices)]);
                    const auto alpha = static_cast<double>(image.rgba[static_cast<std::size_t>(y * 57 + x) * 4 + 3]);
                    EXPECT_NEAR(-std::expm1(-lost), alpha, 2e-6);
                    densest = std::max(densest, alpha);
                    for (int n = 0; n < slices; ++n) {
                        EXPECT_LE(volume.values[volume.index(x, y, n)], volume.values[volume.index(x, y, n + 1)]);
                    }
                }
            }
            EXPECT_GT(densest, 0.3);
            // Where its elements lie: at the pixels' centres on the slices.
            for (const auto& [x, y, n] : {std::array<int, 3>{31, 20, slices / 2}, {17, 29, slices - 3}}) {
                const double right = (x - 28.0) * frame.pixel, up = (20.0 - y) * frame.pixel;
                const Vec3 world = shot.camera.eye() + right * shot.camera.right_world() + up * shot.camera.up_world() -
                                   frame.depth_of(n) * shot.camera.back_world();
                EXPECT_NEAR(volume.at(world), static_cast<double>(volume.values[volume.index(x, y, n)]), 1e-6);
                const Vec3 behind = world - 0.5 * frame.slice_spacing * shot.camera.back_world();
                EXPECT_NEAR(volume.at(behind),
                            0.5 * static_cast<double>(volume.values[volume.index(x, y, n)] +
                                                      volume.values[volume.index(x, y, n + 1)]),
                            1e-6);
            }
            EXPECT_EQ(volume.at(shot.camera.eye() + 1e4 * shot.camera.back_world()), 0.0);
            EXPECT_EQ(lost_before_slices(renderer, drawing.job_with({0, 3}), 1).values, volume.values);
            const LightVolume coarse = lost_before_slices(renderer, drawing.job_with({}), 3);
            const int planes = (slices + 2) / 3 + 1;
            ASSERT_EQ(coarse.counts[2], planes);
            for (int p = 0; p < planes; ++p) {
                const int n = std::min(3 * p, slices);
                for (std::size_t pixel = 0; pixel < 57 * 41; ++pixel) {
                    ASSERT_NEAR(coarse.values[coarse.index(0, 0, p) + pixel],
                                volume.values[volume.index(0, 0, n) + pixel], 1e-6)
                        << p;
                }
            }
        }
    }
}

/// What is left of light that comes from where a scene's light is.
std::shared_ptr<const LightVolume> light_of(const Shot& shot, const Vec3& towards) {
    const Box box = shot.scene.fields.front()->supports_world();
    const double size = glm::length(box.extent());
    Shot along{shot.scene,
               Camera::orthographic(box.centre() + size * towards, box.centre(), Vec3(0.3, 1.0, 0.1), size)};
    along.scene.lights.clear();
    along.scene.mode = Mode::composite;
    along.scene.preintegration = along.scene.shadows = false;
    along.scene.ambient_occlusion.reset();
    along.size = {40, 40};
    CpuRenderer renderer;
    const CpuDrawing drawing(along, Precision::float32);
    LightVolume volume = lost_before_slices(renderer, drawing.job_with({}), 1);
    for (float& value : volume.values) {
        value = std::exp(-value);
    }
    return std::make_shared<const LightVolume>(std::move(volume));
}

TEST(CpuRenderer, LightVolumesAreLookedUpAlikeByEverySet) {
    const SetChoice choice;
    for (const Named& one : some_scenes()) {
        Shot shot = one.shot;
        // (Shadows of isosurfaces are not drawn from volumes.)
        if (shot.scene.mode != Mode::composite || shot.scene.gradient_opacity || shot.scene.fields.size() > 1) {
            continue;
        }
        shot.scene.shadows = true;
        shot.scene.ambient_occlusion = AmbientOcclusion{0.3, 0.9};
        LightVolumes volumes;
        volumes.lights = {light_of(shot, Vec3(0.6, 0.8, 0.0)), light_of(shot, Vec3(-0.8, 0.0, 0.6))};
        volumes.openness = light_of(shot, Vec3(0.0, 0.6, 0.8));
        const auto draw = [&](Precision precision, const LightVolumes* from) {
            const CpuDrawing drawing(shot, precision);
            backend_cpu::Job job = drawing.job_with({});
            job.volumes = from;
            Image image;
            image.size = shot.size;
            CpuRenderer().render(job, image);
            return image;
        };
        choose_instruction_set("");
        const Image fine = draw(Precision::float64, &volumes);
        // Of light a part is left, nowhere more than all.
        const Image bright = draw(Precision::float64, nullptr);
        EXPECT_GT(distance(fine, bright).rms, 1e-3) << one.name;
        for (std::size_t n = 0; n < fine.rgba.size(); ++n) {
            ASSERT_LE(fine.rgba[n], bright.rgba[n] + 1e-6F) << one.name;
        }
        for (const std::string& set : instruction_sets()) {
            choose_instruction_set(set);
            const Raised raised;
            const Image image = draw(Precision::float32, &volumes), wide = draw(Precision::float64, &volumes);
            EXPECT_EQ(raised.names(), "") << one.name << " " << set;
            EXPECT_LE(distance(image, fine).rms, 2e-6) << one.name << " " << set;
            EXPECT_LE(distance(wide, fine).most, 1.3e-7) << one.name << " " << set;
        }
        // Volumes that lie a twentieth of an element elsewhere are seen.
        LightVolumes moved = volumes;
        auto other = std::make_shared<LightVolume>(*volumes.lights[0]);
        other->origin += 0.05 * other->per_step[0] / glm::dot(other->per_step[0], other->per_step[0]);
        moved.lights[0] = other;
        EXPECT_GT(distance(draw(Precision::float64, &moved), fine).rms, 1e-5) << one.name;
    }
}

/// Counts of kernels and sections are those of the picture, whoever drew it.
TEST(CpuRenderer, CountsEachKernelOnce) {
    for (const Projection projection : {Projection::orthographic, Projection::perspective}) {
        const auto lattice = ball(12);
        const auto spheres = cloud(300, 0.05, 1.0), ellipsoids = cloud(200, 0.05, 4.0);
        const std::vector<std::shared_ptr<const Field>> fields{lattice, spheres, ellipsoids};
        for (const auto& field : fields) {
            Shot shot = shot_of({field}, askew(*field, projection, 1.3));
            shot.size = {90, 80};
            // Close enough that every kernel meets a slice.
            shot.scene.slice_spacing = field == lattice ? 1.0 : 0.01;
            const CpuDrawing drawing(shot, Precision::float32);
            double sections = 0.0;
            for (const int tile_size : {90, 17}) {
                const Image image = drawing.draw({tile_size, 2});
                EXPECT_EQ(image.stats.at("kernels_drawn"), static_cast<double>(field->size())) << tile_size;
                sections = image.stats.at("sections_drawn");
                EXPECT_GE(sections, static_cast<double>(field->size()));
            }
        }
    }
}

constexpr int tile_sizes[] = {1, 7, 16, 31, 62, 63, 100, 126, 0};

TEST(CpuRenderer, TilesLeaveNoSeam) {
    for (const Named& one : some_scenes()) {
        Shot shot = one.shot;
        shot.size = {133, 70};
        shot.scene.opacity_stop = 1.0;
        const bool jumps = shot.scene.mode == Mode::isosurface;
        for (const Precision precision : {Precision::float32, Precision::float64}) {
            const bool fine = precision == Precision::float64;
            const CpuDrawing drawing(shot, precision);
            CpuRenderer renderer;
            const Image whole = drawing.draw(renderer, {126, 1});
            for (const int tile_size : tile_sizes) {
                if (tile_size == 1 && !fine) {
                    continue;
                }
                const Image image = drawing.draw(renderer, {tile_size, 2});
                const Distance off = distance(image, whole);
                const std::string name =
                    one.name + (fine ? " float64" : " float32") + ", tiles of " + std::to_string(tile_size);
                // float64: one step of the picture's float32.
                EXPECT_LE(off.rms, fine ? 1e-8 : jumps ? 1e-5 : 1e-6) << name;
                EXPECT_LE(off.most, fine ? 1.3e-7 : jumps ? 1e-3 : 2e-5) << name;
            }
        }
        // The picture of a camera that is a thousandth of a pixel off differs by more.
        const Vec3 by =
            shot.camera.right_world() * (1e-3 * CpuDrawing(shot, Precision::float64).frame().smallest_pixel());
        Shot moved = shot;
        moved.camera = shot.camera.projection() == Projection::orthographic
                           ? Camera::orthographic(shot.camera.eye() + by, shot.camera.target() + by, shot.camera.up(),
                                                  shot.camera.height())
                           : Camera::perspective(shot.camera.eye() + by, shot.camera.target() + by, shot.camera.up(),
                                                 shot.camera.fov_y(), shot.camera.near());
        EXPECT_GT(
            distance(CpuDrawing(moved, Precision::float64).draw(), CpuDrawing(shot, Precision::float64).draw()).rms,
            1e-6)
            << one.name;
    }
}

/// Tiles that are drawn alone are those of the whole picture, and the others stay empty.
TEST(CpuRenderer, ExcerptsAreTilesOfThePicture) {
    constexpr int edge = 16;
    for (const Named& one : some_scenes()) {
        Shot shot = one.shot;
        shot.size = {90, 70};
        const TileLayout layout(shot.size, edge);
        std::vector<std::uint8_t> drawn(layout.tiles(), 0);
        for (std::size_t tile = 0; tile < drawn.size(); tile += 3) {
            drawn[tile] = 1;
        }
        const std::vector<std::uint8_t> none(layout.tiles(), 0);
        const CpuDrawing drawing(shot, Precision::float32);
        CpuRenderer renderer;
        const Image whole = drawing.draw(renderer, {edge, 2});
        Job job = drawing.job_with({edge, 2});
        const auto draw = [&](const std::vector<std::uint8_t>& tiles) {
            job.drawn_tiles = &tiles;
            Image image;
            image.size = shot.size;
            renderer.render(job, image);
            return image;
        };
        // (What was sorted for the whole picture, or for other tiles, is not taken for it.)
        EXPECT_TRUE(pixels_of(draw(none)) == std::vector<float>(pixels_of(whole).size(), 0.0F)) << one.name;
        const Image excerpt = draw(drawn);
        EXPECT_EQ(excerpt.stats.at("buckets_reused"), 0.0);
        EXPECT_EQ(draw(drawn).stats.at("buckets_reused"), 1.0);
        const std::vector<float> all = pixels_of(whole), some = pixels_of(excerpt);
        const std::size_t channels = all.size() / (90U * 70U);
        for (std::size_t tile = 0; tile < layout.tiles(); ++tile) {
            const TileShape shape = layout.shape(tile);
            for (int y = shape.y; y < shape.y + shape.height; ++y) {
                const auto first = static_cast<std::ptrdiff_t>(static_cast<std::size_t>(y * 90 + shape.x) * channels);
                const auto past = first + static_cast<std::ptrdiff_t>(static_cast<std::size_t>(shape.width) * channels);
                ASSERT_TRUE(drawn[tile] != 0 ? std::equal(all.begin() + first, all.begin() + past, some.begin() + first)
                                             : std::all_of(some.begin() + first, some.begin() + past,
                                                           [](float value) { return value == 0.0F; }))
                    << one.name << ", tile " << tile;
            }
        }
    }
}

TEST(CpuRenderer, WhatIsHiddenIsLeftOutAndNothingElse) {
    double drawn_of[2] = {0.0, 0.0};
    const auto lattice = ball(11);
    EllipsoidFieldOptions options;
    options.w0 = 0.02;
    const auto ellipsoids = cloud(200, 0.12, 4.0, 5, options);
    const auto spheres = cloud(200, 0.1, 1.0, 5, options);
    const std::vector<std::shared_ptr<const Field>> fields{lattice, ellipsoids, spheres};
    for (const auto& field : fields) {
        for (const Projection projection : {Projection::orthographic, Projection::perspective}) {
            for (const Size size : {Size{50, 104}, Size{104, 50}, Size{60, 60}}) {
                for (const bool iso : {false, true}) {
                    if (iso && size.width == 104) {
                        continue;
                    }
                    Shot shot = shot_of({field}, askew(*field, projection, 0.7));
                    shot.size = size;
                    shot.scene.transfer_function = test::dense();
                    shot.scene.opacity_stop = 0.9;
                    shot.scene.mode = iso ? Mode::isosurface : Mode::composite;
                    // Many slices: a kernel is drawn in some of them ahead.
                    shot.scene.reference_length = field == lattice ? 1.0 : 0.04;
                    shot.scene.slice_spacing = *shot.scene.reference_length / 4.0;
                    const reference::Picture judge = test::reference_of(shot);
                    const CpuDrawing drawing(shot, Precision::float64);
                    Shot endless = shot;
                    endless.scene.opacity_stop = 1.0;
                    const double all = CpuDrawing(endless, Precision::float64).draw({16, 1}).stats.at("sections_drawn");
                    for (const int tile_size : {16, 62, 126}) {
                        const Image image = drawing.draw({tile_size, 1});
                        const std::string name = std::to_string(size.width) + " x " + std::to_string(size.height) +
                                                 (iso ? ", isosurface" : "") + ", tiles of " +
                                                 std::to_string(tile_size);
                        // Pixels whose opacity comes close to A_stop may end a slice sooner or later.
                        std::size_t other = 0;
                        for (std::size_t n = 0; n < judge.rgba.size(); ++n) {
                            other += std::abs(static_cast<double>(image.rgba[n]) - judge.rgba[n]) > 1e-6 ? 1U : 0U;
                        }
                        EXPECT_LE(other, 4U) << name;
                        if (!iso && tile_size == 16) {
                            EXPECT_LT(image.stats.at("sections_drawn"), 0.95 * all) << name << ": nothing was left out";
                            drawn_of[0] += image.stats.at("sections_drawn");
                            drawn_of[1] += all;
                        }
                    }
                }
            }
        }
    }
    EXPECT_LT(drawn_of[0], 0.85 * drawn_of[1]);
}

/// An opaque plate with holes in front of a ball, some samples of which are left out, and a coarser lattice in the same
/// place: what is seen through holes is fed however late its slices come, and nothing behind the plate is drawn.
TEST(CpuRenderer, WhatIsSeenThroughHolesIsFed) {
    constexpr std::size_t n = 22;
    std::vector<float> samples(n * n * n);
    for (std::size_t k = 0; k < n; ++k) {
        for (std::size_t j = 0; j < n; ++j) {
            for (std::size_t i = 0; i < n; ++i) {
                const Vec3 at = Vec3(static_cast<double>(i), static_cast<double>(j), static_cast<double>(k)) - 10.5;
                const bool hole = glm::length(glm::dvec2(at.x - 2.0, at.y + 1.0)) < 3.5 || (i > 16 && j > 16);
                const bool plate = k >= 17 && k < 20 && !hole;
                const bool lost = i % 5 == 0 && j % 4 == 1 && k % 6 == 2;
                samples[(k * n + j) * n + i] = lost ? std::nanf("")
                                               : plate
                                                   ? 1.0F
                                                   : static_cast<float>(std::max(0.0, 0.9 - 0.08 * glm::length(at)));
            }
        }
    }
    RegularFieldOptions options = test::zero_boundary();
    options.nan = NanPolicy::skip;
    const auto plate = std::make_shared<const RegularField>(samples, std::array<std::size_t, 3>{n, n, n}, options);
    RegularFieldOptions coarse = test::zero_boundary();
    coarse.spacing = Vec3(2.0);
    coarse.origin = Vec3(1.0, 0.5, 0.3);
    const auto other = ball(9, coarse);
    const Camera above = Camera::orthographic(plate->supports_world().centre() + Vec3(3.0, 5.0, 40.0),
                                              plate->supports_world().centre(), Vec3(0, 1, 0), 26.0);
    const std::vector<Camera> cameras{above, askew(*plate, Projection::orthographic),
                                      Camera::perspective(above.eye(), above.target(), Vec3(0, 1, 0), 40.0, 0.5),
                                      test::inside(*plate)};
    for (std::size_t view = 0; view < cameras.size(); ++view) {
        for (const int kind : {0, 1, 2}) {
            Shot shot = shot_of({plate}, cameras[view]);
            shot.size = {64, 47};
            shot.outputs = {false, true};
            shot.scene.transfer_function = test::dense();
            shot.scene.opacity_stop = 0.95;
            // A kernel meets more slices than a batch has, and there are many batches.
            shot.scene.reference_length = 1.0;
            shot.scene.slice_spacing = kind == 0 ? 0.2 : 0.5;
            if (kind == 1) {
                shot.scene.fields.push_back(other);
            }
            if (kind == 2) {
                clip(shot.scene);
            }
            const std::string name = "view " + std::to_string(view) + ", kind " + std::to_string(kind);
            const reference::Picture judge = test::reference_of(shot);
            const CpuDrawing exact(shot, Precision::float64), usual(shot, Precision::float32);
            const Image image = exact.draw({62, 1});
            std::size_t differ = 0;
            for (std::size_t at = 0; at < judge.rgba.size(); ++at) {
                differ += std::abs(static_cast<double>(image.rgba[at]) - judge.rgba[at]) > 1e-6 ? 1U : 0U;
            }
            EXPECT_LE(differ, 4U) << name;
            const Image first = usual.draw({20, 1});
            EXPECT_LT(distance(first, judge).rms, 1e-4) << name;
            const Image again = usual.draw({20, 3});
            EXPECT_EQ(first.rgba, again.rgba) << name;
            EXPECT_EQ(first.depth, again.depth) << name;
            Shot endless = shot;
            endless.scene.opacity_stop = 1.0;
            const double all = CpuDrawing(endless, Precision::float32).draw({20, 1}).stats.at("sections_drawn");
            EXPECT_LT(first.stats.at("sections_drawn"), (view == 0 && kind != 2 ? 0.8 : 1.0) * all) << name;
        }
    }
}

/// \int g along a ray that passes at distance p (in radii) of a ball's centre, in radii.
double chord_sum(const Kernel& kernel, double p) {
    if (p >= 1.0) {
        return 0.0;
    }
    const double k = kernel.falloff, half = std::sqrt(1.0 - p * p);
    return kernel.gain() *
           (std::exp(-k * p * p) * std::sqrt(pi / k) * std::erf(std::sqrt(k) * half) - 2.0 * half * std::exp(-k));
}

/// upright: the kernel's axes are those of the picture.
void expect_chord_sum(bool upright) {
    EllipsoidArrays arrays;
    arrays.centers = {Vec3(0.13, -0.4, 0.2)};
    arrays.values = {1.7};
    arrays.scales = {Vec3(9.0, 4.0, 6.0)};
    arrays.rotations = {upright ? glm::dquat(1.0, 0.0, 0.0, 0.0)
                                : glm::angleAxis(0.7, glm::normalize(Vec3(1.0, 2.0, -1.0)))};
    EllipsoidFieldOptions options;
    options.normalization = Normalization::none;
    options.falloff = 6.0;
    const auto field = std::make_shared<const EllipsoidField>(arrays, options);
    const Size size{31, 27};
    Shot shot = shot_of({field}, Camera::orthographic(Vec3(0, 0, 50), Vec3(0), Vec3(0, 1, 0), 27.0));
    shot.size = size;
    shot.scene.mode = Mode::xray;
    shot.scene.sampling = Sampling::slab;
    const Mat3 to_ball = glm::inverse(field->shape(0));
    std::vector<double> exact;
    for (int y = 0; y < size.height; ++y) {
        for (int x = 0; x < size.width; ++x) {
            // The ray in the ball: its nearest point to the centre, and lengths along it.
            const Vec3 from = to_ball * (Vec3(x + 0.5 - 15.5, 13.5 - (y + 0.5), 0.0) - arrays.centers[0]);
            const Vec3 along = to_ball * Vec3(0.0, 0.0, 1.0);
            const double p = glm::length(glm::cross(from, along)) / glm::length(along);
            exact.push_back(1.7 * chord_sum(field->kernel(), p) / glm::length(along));
        }
    }
    for (const double spacing : {0.3, 1.0, 1.3, 5.0, 40.0}) {
        shot.scene.slice_spacing = spacing;
        EXPECT_LE(distance(CpuDrawing(shot, Precision::float32).draw({16, 1}).scalar, exact, true).most, 1e-6)
            << spacing << upright;
        EXPECT_LE(distance(CpuDrawing(shot, Precision::float64).draw({16, 1}).scalar, exact, true).most, 7e-8)
            << spacing;
    }
    // Point sampling is not exact.
    shot.scene.sampling = Sampling::point;
    EXPECT_GT(distance(CpuDrawing(shot, Precision::float64).draw().scalar, exact, true).most, 1e-3);
}

TEST(CpuRenderer, XRayOfOneKernelIsItsChordSum) {
    expect_chord_sum(false);
    expect_chord_sum(true);
}

TEST(CpuRenderer, AConstantFieldIsConstant) {
    const double value = 0.7, w0 = 0.01;
    EllipsoidArrays arrays = test::cloud_arrays(300, 0.15, 5.0);
    std::fill(arrays.values.begin(), arrays.values.end(), value);
    EllipsoidFieldOptions options;
    options.w0 = w0;
    RegularFieldOptions regular = test::zero_boundary();
    regular.normalization = Normalization::threshold;
    regular.w0 = w0;
    const std::vector<std::shared_ptr<const Field>> fields{
        std::make_shared<const EllipsoidField>(arrays, options),
        std::make_shared<const RegularField>(std::vector<float>(512, static_cast<float>(value)),
                                             std::array<std::size_t, 3>{8, 8, 8}, regular)};
    for (const auto& field : fields) {
        for (const Projection projection : {Projection::orthographic, Projection::perspective}) {
            Shot shot = shot_of({field}, askew(*field, projection));
            shot.size = {60, 50};
            shot.scene.mode = Mode::mip;
            shot.outputs.coverage = true;
            const CpuDrawing drawing(shot, Precision::float32);
            const Image image = drawing.draw();
            const double ds = drawing.frame().slice_spacing;
            std::size_t inside = 0;
            for (std::size_t p = 0; p < image.scalar.size(); ++p) {
                // (No number: no kernel reaches the ray.)
                EXPECT_TRUE(std::isnan(image.scalar[p]) ? image.coverage[p] == 0.0F
                                                        : image.scalar[p] <= value * (1.0 + 4e-7));
                // So much on the whole ray is more than w0 somewhere.
                const auto slices = static_cast<double>(drawing.frame().slices);
                if (static_cast<double>(image.coverage[p]) > 1.6 * w0 * ds * slices) {
                    EXPECT_NEAR(image.scalar[p], value, 4e-7);
                    ++inside;
                }
            }
            EXPECT_GT(inside, 300U);
        }
    }
}

TEST(CpuRenderer, HalvesOfAKernelAreTheKernel) {
    EllipsoidArrays arrays = test::cloud_arrays(80, 0.16, 4.0);
    for (std::size_t n = 0; n < arrays.values.size(); ++n) {
        arrays.weights.push_back(0.3 + 0.02 * static_cast<double>(n));
    }
    EllipsoidArrays halves = arrays;
    for (std::size_t n = 0; n < arrays.values.size(); n += 2) {
        halves.weights[n] *= 0.5;
        halves.centers.push_back(arrays.centers[n]);
        halves.scales.push_back(arrays.scales[n]);
        halves.rotations.push_back(arrays.rotations[n]);
        halves.values.push_back(arrays.values[n]);
        halves.weights.push_back(halves.weights[n]);
    }
    EllipsoidArrays wrong = halves;
    wrong.weights.back() *= 1.01;
    const auto field = std::make_shared<const EllipsoidField>(arrays);
    Shot shot = shot_of({field}, askew(*field, Projection::perspective));
    shot.scene.slice_spacing = shot.scene.reference_length = 0.05;
    const Image whole = CpuDrawing(shot, Precision::float64).draw();
    shot.scene.fields = {std::make_shared<const EllipsoidField>(halves)};
    EXPECT_LE(distance(CpuDrawing(shot, Precision::float64).draw(), whole).most, 1.3e-7);
    shot.scene.fields = {std::make_shared<const EllipsoidField>(wrong)};
    EXPECT_GT(distance(CpuDrawing(shot, Precision::float64).draw(), whole).most, 1e-5);
}

TEST(CpuRenderer, OrderOfKernelsDoesNotMatter) {
    for (const double aspect : {1.0, 6.0}) {
        const EllipsoidArrays arrays = test::cloud_arrays(150, 0.13, aspect);
        std::vector<std::size_t> order(arrays.values.size());
        std::iota(order.begin(), order.end(), std::size_t{0});
        std::mt19937 random(3);
        std::shuffle(order.begin(), order.end(), random);
        EllipsoidArrays other;
        for (const std::size_t n : order) {
            other.centers.push_back(arrays.centers[n]);
            other.values.push_back(arrays.values[n]);
            if (aspect == 1.0) {
                other.radii.push_back(arrays.radii[n]);
            } else {
                other.scales.push_back(arrays.scales[n]);
                other.rotations.push_back(arrays.rotations[n]);
            }
        }
        const auto field = std::make_shared<const EllipsoidField>(arrays);
        Shot shot = shot_of({field}, askew(*field, Projection::orthographic));
        shot.scene.slice_spacing = 0.05;
        const Image fine = CpuDrawing(shot, Precision::float64).draw(),
                    coarse = CpuDrawing(shot, Precision::float32).draw();
        shot.scene.fields = {std::make_shared<const EllipsoidField>(other)};
        EXPECT_LE(distance(CpuDrawing(shot, Precision::float64).draw(), fine).most, 1.3e-7);
        EXPECT_LE(distance(CpuDrawing(shot, Precision::float32).draw(), coarse).most, 2e-5);
        other.values[0] += 0.01;
        shot.scene.fields = {std::make_shared<const EllipsoidField>(other)};
        EXPECT_GT(distance(CpuDrawing(shot, Precision::float64).draw(), fine).most, 1e-5);
    }
}

/// What was sorted for one field is not used for another one that happens to lie where it was in memory.
TEST(CpuRenderer, KnowsFieldsApartWhateverTheirAddress) {
    alignas(RegularField) static unsigned char place[sizeof(RegularField)];
    const auto make = [&](std::array<std::size_t, 3> shape) {
        auto* field = new (place)
            RegularField(std::vector<float>(shape[0] * shape[1] * shape[2], 1.0F), shape, test::zero_boundary());
        return std::shared_ptr<const RegularField>(field, [](const RegularField* gone) { gone->~RegularField(); });
    };
    const Camera camera = Camera::orthographic(Vec3(4, 9, 60), Vec3(4, 9, 0), Vec3(0, 1, 0), 30.0);
    CpuRenderer renderer;
    std::weak_ptr<const RegularField> first;
    {
        const auto field = make({2, 16, 9});
        first = field;
        static_cast<void>(CpuDrawing(shot_of({field}, camera), Precision::float32).draw(renderer, {12, 1}));
    }
    // As many rows and columns, otherwise arranged.
    if (first.expired()) {
        const CpuDrawing second(shot_of({make({16, 2, 9})}, camera), Precision::float32);
        EXPECT_EQ(pixels_of(second.draw(renderer, {12, 1})), pixels_of(second.draw({12, 1})));
    }
    // Another one frees it.
    const CpuDrawing other(shot_of({ball(5)}, camera), Precision::float32);
    static_cast<void>(other.draw(renderer, {12, 1}));
    EXPECT_TRUE(first.expired());
}

TEST(CpuRenderer, PicturesOfNothing) {
    // No kernel, none in the picture, none before the near plane.
    const auto none = std::make_shared<const EllipsoidField>(EllipsoidArrays{});
    const auto field = cloud(20, 0.1, 3.0);
    const Camera away = Camera::orthographic(Vec3(100, 0, 5), Vec3(100, 0, 0), Vec3(0, 1, 0), 1.0);
    const Camera behind = Camera::perspective(Vec3(0, 0, 5), Vec3(0, 0, 6), Vec3(0, 1, 0), 40.0, 0.1);
    for (const auto& shot : {shot_of({none}, away), shot_of({field}, away), shot_of({field}, behind)}) {
        for (const Mode mode : {Mode::composite, Mode::isosurface, Mode::xray, Mode::mip}) {
            Shot one = shot;
            one.scene.mode = mode;
            one.outputs = {true, mode == Mode::composite};
            const Raised raised;
            const Image image = CpuDrawing(one, Precision::float32).draw({0, 1});
            EXPECT_EQ(raised.names(), "");
            const std::vector<float> pixels = pixels_of(image);
            const double blank = mode == Mode::mip ? test::no_number : 0.0;
            EXPECT_TRUE(std::all_of(pixels.begin(), pixels.end(),
                                    [blank](float pixel) { return static_cast<double>(pixel) == blank; }));
            EXPECT_EQ(pixels_of(image).size(), static_cast<std::size_t>(40 * 34 * (image.rgba.empty() ? 1 : 4)));
            for (const float depth : image.depth) {
                EXPECT_EQ(depth, std::numeric_limits<float>::infinity());
            }
        }
    }
}

} // namespace
} // namespace sheetsplat::backend_cpu

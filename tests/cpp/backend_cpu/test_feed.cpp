// What tiles are handed: layouts that hold every pixel once, buckets that miss no kernel that reaches into a tile, and
// sections whose factored coordinates are the kernels of conventions, section 2.
#include <algorithm>
#include <cmath>
#include <random>
#include <stdexcept>
#include <string>
#include <vector>

#include <glm/matrix.hpp>
#include <gtest/gtest.h>

#include "backend_cpu/shading.hpp"
#include "backend_cpu/tile_feed.hpp"
#include "backend_cpu/tile_task.hpp"
#include "base/instruction_set.hpp"
#include "support/cpu_drawing.hpp"
#include "support/draws.hpp"
#include "support/lattices.hpp"

namespace sheetsplat::backend_cpu {
namespace {

using test::CpuDrawing;
using test::Shot;

TEST(TileLayout, HoldsEveryPixelOnce) {
    for (const Size size : {Size{1, 1}, Size{7, 5}, Size{62, 62}, Size{63, 61}, Size{400, 3}, Size{133, 97}}) {
        for (const int largest : {1, 2, 5, 16, 62, 126}) {
            const TileLayout layout(size, largest);
            std::vector<int> seen(static_cast<std::size_t>(size.width * size.height), 0);
            for (std::size_t tile = 0; tile < layout.tiles(); ++tile) {
                const TileShape shape = layout.shape(tile);
                EXPECT_GE(shape.width, 1);
                EXPECT_LE(shape.width, largest);
                EXPECT_GE(shape.height, 1);
                EXPECT_LE(shape.height, largest);
                EXPECT_GE(shape.stride, shape.width + 2 + TileShape::padding);
                EXPECT_EQ(shape.stride % TileShape::padding, 0);
                for (int y = shape.y; y < shape.y + shape.height; ++y) {
                    for (int x = shape.x; x < shape.x + shape.width; ++x) {
                        ++seen[static_cast<std::size_t>(y * size.width + x)];
                    }
                }
            }
            EXPECT_EQ(std::count(seen.begin(), seen.end(), 1), static_cast<std::ptrdiff_t>(seen.size()));
        }
    }
}

TEST(TileLayout, FindsTheTilesThatSeeAStretch) {
    std::mt19937 random(4);
    std::uniform_real_distribution<double> uniform(-30.0, 180.0);
    for (const int largest : {1, 3, 16, 62, 126}) {
        const TileLayout layout({133, 97}, largest);
        for (int n = 0; n < 300; ++n) {
            double low = uniform(random), high = low + std::abs(uniform(random)) * 0.2;
            if (n % 5 == 0) {
                // Ends on centres of pixels.
                low = std::floor(low) + 0.5;
                high = std::floor(high) + 0.5;
            }
            const TileLayout::Range found = layout.across().between(low, high);
            for (int column = 0; column < layout.columns(); ++column) {
                bool wanted = false;
                for (int pixel = layout.left(column) - 1; pixel <= layout.left(column + 1); ++pixel) {
                    wanted = wanted || (pixel + 0.5 >= low && pixel + 0.5 <= high);
                }
                EXPECT_EQ(wanted, column >= found.first && column <= found.last) << low << " to " << high;
            }
        }
        EXPECT_GT(layout.across().between(-1e300, -1e299).first, layout.across().between(-1e300, -1e299).last);
        EXPECT_EQ(layout.across().between(-1e300, 1e300).last, layout.columns() - 1);
    }
}

TEST(TileKernels, SortKeepsTheOrderOfEqualSlices) {
    std::mt19937 random(9);
    for (const int slices : {1, 7, 100000000}) {
        TileKernels<double> kernels;
        for (int n = 0; n < 500; ++n) {
            Section<double> section;
            section.first = std::uniform_int_distribution<int>(0, slices - 1)(random) / 5 * 5;
            section.value = n;
            kernels.unsorted.push_back(section);
            SectionExtra<double> extra;
            extra.weight = n;
            kernels.unsorted_extras.push_back(extra);
            RowShape<double> shape;
            shape.X = n;
            kernels.unsorted_shapes.push_back(shape);
        }
        kernels.sort();
        ASSERT_EQ(kernels.sections.size(), 500U);
        for (std::size_t n = 0; n < kernels.sections.size(); ++n) {
            EXPECT_EQ(kernels.sections[n].value, kernels.extras[n].weight);
            EXPECT_EQ(kernels.sections[n].value, kernels.shapes[n].X);
            if (n > 0) {
                const Section<double>&a = kernels.sections[n - 1], &b = kernels.sections[n];
                EXPECT_TRUE(a.first < b.first || (a.first == b.first && a.value < b.value));
            }
        }
    }
}

/// Kernels of a field in the world.
struct Kernels {
    std::vector<Vec3> centers;
    std::vector<Mat3> to_ball;
    std::vector<double> values;
};
Kernels kernels_of(const Field& field) {
    Kernels all;
    if (const RegularField* lattice = as_regular(&field)) {
        const Vec3 axes = lattice->kernel_axes().lengths;
        const Mat3 to_ball(Vec3(1.0 / axes.x, 0, 0), Vec3(0, 1.0 / axes.y, 0), Vec3(0, 0, 1.0 / axes.z));
        const auto& shape = lattice->shape();
        for (std::size_t k = 0; k < shape[0]; ++k) {
            for (std::size_t j = 0; j < shape[1]; ++j) {
                for (std::size_t i = 0; i < shape[2]; ++i) {
                    if (!std::isnan(lattice->value(i, j, k))) {
                        all.centers.push_back(lattice->position(i, j, k));
                        all.to_ball.push_back(to_ball);
                        all.values.push_back(lattice->value(i, j, k));
                    }
                }
            }
        }
        return all;
    }
    const EllipsoidField& ellipsoids = *as_ellipsoids(&field);
    for (std::size_t i = 0; i < ellipsoids.size(); ++i) {
        all.centers.push_back(ellipsoids.center(i));
        all.to_ball.push_back(glm::inverse(ellipsoids.shape(i)));
        all.values.push_back(ellipsoids.value(i) * ellipsoids.weight(i));
    }
    return all;
}

std::vector<std::shared_ptr<const Field>> fields() {
    RegularFieldOptions plain = test::zero_boundary();
    plain.normalization = Normalization::none;
    RegularFieldOptions bcc = plain;
    bcc.lattice = Lattice::bcc;
    RegularFieldOptions unequal = plain;
    unequal.spacing = Vec3(1.0, 2.1, 0.6);
    EllipsoidFieldOptions scattered;
    scattered.normalization = Normalization::none;
    std::vector<double> holes(8 * 9 * 10);
    for (std::size_t n = 0; n < holes.size(); ++n) {
        holes[n] = n % 3 == 0 ? std::nan("") : std::sin(static_cast<double>(n));
    }
    RegularFieldOptions skip = plain;
    skip.nan = NanPolicy::skip;
    return {test::ball(8, plain),
            test::ball(7, bcc),
            test::ball(8, unequal),
            std::make_shared<const RegularField>(holes, std::array<std::size_t, 3>{8, 9, 10}, skip),
            test::cloud(60, 0.2, 1.0, 5, scattered),
            test::cloud(60, 0.2, 6.0, 6, scattered),
            test::cloud(60, 0.2, 300.0, 7, scattered)};
}

/// A pixel inside a section lies within the reach around the kernel's centre, unless the kernel is next to the eye.
template <class T>
void expect_in_reach(const TileKernels<T>& kernels, const Section<T>& section, const Frame& frame, int x, int y,
                     const std::string& name) {
    const RowShape<T>& shape = kernels.shapes.front();
    const auto number = [](T value) { return static_cast<double>(value); };
    const double steps = number(section.s) / -number(shape.ds);
    double depth = 1.0;
    if (frame.projection == Projection::perspective) {
        depth = frame.depth_of(section.first) + steps * frame.slice_spacing;
        if (depth < 2.0 * frame.slice_spacing / -number(shape.ds)) {
            return;
        }
    }
    const double middle_y = -(number(section.a2) + steps * number(shape.d2)) / (number(shape.Y2) * depth);
    const double middle_x = -(number(section.a1) + steps * number(shape.d1)) / (number(shape.X) * depth) -
                            number(shape.Y1) / number(shape.X) * middle_y;
    EXPECT_LE(std::abs(x - middle_x), number(kernels.reach_x) / depth + 1e-3) << name;
    EXPECT_LE(std::abs(y - middle_y), number(kernels.reach_y) / depth + 1e-3) << name;
}

/// Sums of sections at points of slices of a tile are those of kernels in the world, and slices and pixels that a
/// section claims hold all of it.
template <class T>
void check_sums(const Shot& shot, const CpuDrawing& drawing, double most_error, const std::string& name) {
    const TileFunctions<T>& functions = *tile_functions<T>(chosen_instruction_set());
    const Frame& frame = drawing.frame();
    const Field& field = *shot.scene.fields[0];
    const Kernels world = kernels_of(field);
    const Job& job = drawing.job();
    const TileLayout layout(shot.size, 13);
    ThreadPool pool(2);
    Buckets<RowPart> rows;
    Buckets<std::uint32_t> indices;
    if (!job.regular.empty()) {
        rows = bucket_rows(*job.regular[0].view, *job.regular[0].runs, frame, layout, pool);
    } else {
        indices = bucket_kernels(*job.ellipsoids[0].view, *job.ellipsoids[0].visible, layout,
                                 tile_functions<float>(chosen_instruction_set())->rects, pool);
    }
    const bool perspective = frame.projection == Projection::perspective;
    const double k = field.kernel().falloff;
    std::mt19937 random(2);
    // Points inside kernels, moved to the nearest pixel of the nearest slice.
    struct Point {
        int x, y; ///< of the picture
        std::int64_t n;
    };
    std::vector<Point> points;
    std::uniform_real_distribution<double> uniform(-1.0, 1.0);
    for (int tries = 0; tries < 3000 && points.size() < 400; ++tries) {
        const std::size_t i = std::uniform_int_distribution<std::size_t>(0, world.centers.size() - 1)(random);
        const Vec3 inside = test::three([&] { return uniform(random); });
        const Vec3 eye = shot.camera.to_eye(world.centers[i] + glm::inverse(world.to_ball[i]) * inside);
        const double slice = std::round((-eye.z - frame.first_depth) / frame.slice_spacing);
        if (glm::length(inside) > 1.0 || slice < 0.0 || slice >= static_cast<double>(frame.slices)) {
            continue;
        }
        const auto n = static_cast<std::int64_t>(slice);
        const double unit = frame.pixel * (perspective ? frame.depth_of(n) : 1.0);
        const double x = std::floor(eye.x / unit + 0.5 * shot.size.width);
        const double y = std::floor(0.5 * shot.size.height - eye.y / unit);
        if (x >= -1.0 && y >= -1.0 && x <= shot.size.width && y <= shot.size.height) {
            points.push_back({static_cast<int>(x), static_cast<int>(y), n});
        }
    }
    std::size_t counted = 0, met = 0;
    double worst = 0.0;
    for (std::size_t tile = 0; tile < layout.tiles(); ++tile) {
        const TileShape shape = layout.shape(tile);
        TileKernels<T> kernels;
        if (!job.regular.empty()) {
            functions.feed_rows({job.regular[0].view, job.regular[0].runs, &frame, shot.scene.sampling,
                                 rows.begin(tile), rows.end(tile)},
                                shape, kernels);
        } else {
            functions.feed_kernels(*job.ellipsoids[0].view, indices.begin(tile), indices.end(tile), shape, kernels);
        }
        counted += kernels.counted;
        EXPECT_TRUE(kernels.extras.empty() || kernels.extras.size() == kernels.sections.size()) << name;
        EXPECT_TRUE(kernels.shapes.size() == 1 || kernels.shapes.size() == kernels.sections.size()) << name;
        EXPECT_TRUE(std::is_sorted(kernels.sections.begin(), kernels.sections.end(),
                                   [](const Section<T>& a, const Section<T>& b) { return a.first < b.first; }))
            << name;
        for (const Point& place : points) {
            const int x = place.x - shape.x + 1, y = place.y - shape.y + 1;
            if (x < 0 || y < 0 || x > shape.width + 1 || y > shape.height + 1) {
                continue;
            }
            const std::int64_t n = place.n;
            // The same point in the world.
            const double depth = frame.depth_of(n), unit = frame.pixel * (perspective ? depth : 1.0);
            const Vec3 eye((place.x + 0.5 - 0.5 * shot.size.width) * unit,
                           (0.5 * shot.size.height - (place.y + 0.5)) * unit, -depth);
            const Vec3 point = shot.camera.eye() + eye.x * shot.camera.right_world() + eye.y * shot.camera.up_world() +
                               eye.z * shot.camera.back_world();
            double exact = 0.0;
            for (std::size_t i = 0; i < world.centers.size(); ++i) {
                const Vec3 q = world.to_ball[i] * (point - world.centers[i]);
                const double r2 = glm::dot(q, q);
                exact += r2 < 1.0 ? world.values[i] * (std::exp(-k * r2) - std::exp(-k)) : 0.0;
            }
            exact *= field.kernel().gain();
            double sum = 0.0;
            for (std::size_t i = 0; i < kernels.sections.size(); ++i) {
                const Section<T>& section = kernels.sections[i];
                if (section.first > n) {
                    continue;
                }
                if (!kernels.extras.empty()) {
                    const SectionExtra<T>& extra = kernels.extras[i];
                    if (n > extra.last || x < extra.x0 || x >= extra.x1 || y < extra.y0 || y >= extra.y1) {
                        continue;
                    }
                }
                const RowShape<T>& form = kernels.shapes[kernels.shapes.size() == 1 ? 0 : i];
                const double along = static_cast<double>(n - section.first), scale = perspective ? depth : 1.0;
                const double q1 = scale * (static_cast<double>(form.X) * x + static_cast<double>(form.Y1) * y) +
                                  static_cast<double>(section.a1) + along * static_cast<double>(form.d1);
                const double q2 = scale * static_cast<double>(form.Y2) * y + static_cast<double>(section.a2) +
                                  along * static_cast<double>(form.d2);
                const double q3 = static_cast<double>(section.s) + along * static_cast<double>(form.ds);
                const double r2 = q1 * q1 + q2 * q2 + q3 * q3;
                if (r2 < 1.0 && kernels.reach_x > 0) {
                    expect_in_reach(kernels, section, frame, x, y, name);
                }
                sum += r2 < 1.0 ? static_cast<double>(section.value) * (std::exp(-k * r2) - std::exp(-k)) : 0.0;
            }
            met += exact != 0.0 ? 1U : 0U;
            worst = std::max(worst, std::abs(sum * drawing.plan().value_unit - exact));
        }
    }
    EXPECT_LE(worst, most_error) << name;
    EXPECT_GT(worst, sizeof(T) == 4 ? 1e-10 : 0.0) << name << ": nothing was compared";
    EXPECT_GT(met, 60U) << name;
    EXPECT_LE(counted, world.centers.size()) << name;
}

TEST(Feed, SectionsAreTheKernels) {
    for (const std::string& set : instruction_sets()) {
        choose_instruction_set(set);
        std::size_t number = 0;
        for (const auto& field : fields()) {
            ++number;
            for (int view = 0; view < 3; ++view) {
                for (const Sampling sampling : {Sampling::point, Sampling::slab}) {
                    Shot shot{test::scene_of({field}), view == 2
                                                           ? test::inside(*field)
                                                           : test::askew(*field, view == 0 ? Projection::orthographic
                                                                                           : Projection::perspective)};
                    shot.size = {47, 38};
                    shot.scene.sampling = sampling;
                    shot.scene.mode = Mode::xray;
                    if (as_regular(field.get()) == nullptr) {
                        shot.scene.slice_spacing = 0.05;
                    }
                    const std::string name = set + ", field " + std::to_string(number) + ", view " +
                                             std::to_string(view) + (sampling == Sampling::slab ? ", slab" : "");
                    const CpuDrawing drawing(shot, Precision::float64);
                    check_sums<double>(shot, drawing, 1e-10, name);
                    if (number != 7) {
                        check_sums<float>(shot, drawing, 2e-4, name);
                    }
                }
            }
        }
    }
    choose_instruction_set("");
}

/// The same buckets however many threads made them.
TEST(Feed, BucketsDoNotDependOnThreads) {
    const auto lattice = test::ball(16);
    const auto ellipsoids = test::cloud(4000, 0.05, 4.0);
    for (const Projection projection : {Projection::orthographic, Projection::perspective}) {
        for (const bool scattered : {false, true}) {
            const std::shared_ptr<const Field> field =
                scattered ? std::shared_ptr<const Field>(ellipsoids) : std::shared_ptr<const Field>(lattice);
            Shot shot{test::scene_of({field}), test::askew(*field, projection)};
            shot.size = {150, 120};
            const CpuDrawing drawing(shot, Precision::float32);
            const TileLayout layout(shot.size, 20);
            std::vector<std::size_t> offsets;
            std::vector<std::uint32_t> items;
            for (const int threads : {1, 2, 5}) {
                ThreadPool pool(threads);
                std::vector<std::size_t> own_offsets;
                std::vector<std::uint32_t> own_items;
                if (scattered) {
                    const auto found =
                        bucket_kernels(*drawing.job().ellipsoids[0].view, *drawing.job().ellipsoids[0].visible, layout,
                                       tile_functions<float>(chosen_instruction_set())->rects, pool);
                    own_offsets = found.offset;
                    own_items.assign(found.begin(0), found.end(layout.tiles() - 1));
                } else {
                    const auto found = bucket_rows(*drawing.job().regular[0].view, *drawing.job().regular[0].runs,
                                                   drawing.frame(), layout, pool);
                    own_offsets = found.offset;
                    for (const RowPart* part = found.begin(0); part != found.end(layout.tiles() - 1); ++part) {
                        own_items.insert(own_items.end(), {part->row, part->begin, part->end});
                    }
                }
                if (threads == 1) {
                    offsets = own_offsets;
                    items = own_items;
                    EXPECT_GT(items.size(), 1000U);
                }
                EXPECT_EQ(own_offsets, offsets);
                EXPECT_EQ(own_items, items);
            }
        }
    }
}

/// Of a hundred thousand kernels in one tile no more than some thousands are added between two questions.
TEST(Feed, CanBeEndedAmongManyKernels) {
    const auto lattice = test::ball(50);
    const auto ellipsoids = test::cloud(60000, 0.05, 4.0), spheres = test::cloud(60000, 0.05, 1.0);
    const std::vector<std::shared_ptr<const Field>> many{lattice, ellipsoids, spheres};
    for (const auto& field : many) {
        for (const Projection projection : {Projection::orthographic, Projection::perspective}) {
            Shot shot{test::scene_of({field}), test::askew(*field, projection)};
            shot.size = {20, 20};
            const CpuDrawing drawing(shot, Precision::float32);
            const Job& job = drawing.job();
            const TileLayout layout(shot.size, 20);
            const TileShape shape = layout.shape(0);
            const TileFunctions<float>& functions = *tile_functions<float>(chosen_instruction_set());
            ThreadPool pool(1);
            int asked_of_buckets = 0;
            const std::function<void()> ask = [&] { ++asked_of_buckets; };
            TileKernels<float> kernels;
            const auto feed = [&] {
                if (!job.regular.empty()) {
                    const Buckets<RowPart> rows =
                        bucket_rows(*job.regular[0].view, *job.regular[0].runs, drawing.frame(), layout, pool, ask);
                    functions.feed_rows({job.regular[0].view, job.regular[0].runs, &drawing.frame(),
                                         shot.scene.sampling, rows.begin(0), rows.end(0)},
                                        shape, kernels);
                } else {
                    const Buckets<std::uint32_t> indices = bucket_kernels(
                        *job.ellipsoids[0].view, *job.ellipsoids[0].visible, layout, functions.rects, pool, ask);
                    functions.feed_kernels(*job.ellipsoids[0].view, indices.begin(0), indices.end(0), shape, kernels);
                }
            };
            int asked = 0;
            kernels.poll = [&] { ++asked; };
            feed();
            EXPECT_GE(asked_of_buckets, 2);
            EXPECT_GE(asked, static_cast<int>(field->size() / 40000));
            const std::size_t all = kernels.sections.size();
            EXPECT_GT(all, 10000U);
            const int half = (asked + 1) / 2;
            asked = 0;
            kernels.poll = [&] {
                if (++asked == half) {
                    throw std::runtime_error("ended");
                }
            };
            EXPECT_THROW(feed(), std::runtime_error);
            EXPECT_EQ(asked, half);
            kernels.poll = nullptr;
            feed();
            EXPECT_EQ(kernels.sections.size(), all) << "what was ended leaves nothing behind";
        }
    }
}

/// Each slice is asked about, so that what is drawn between two questions is at most what begins there: a bound that
/// does not know how many slices or tiles there are.
TEST(TileLoop, AsksAfterEverySliceAndEndsWhereItIsTold) {
    const auto field = test::cloud(3000, 0.1, 4.0);
    Shot shot{test::scene_of({field}), test::askew(*field, Projection::orthographic)};
    shot.size = {60, 60};
    shot.scene.slice_spacing = 0.01;
    shot.scene.mode = Mode::xray;
    const CpuDrawing drawing(shot, Precision::float32);
    const Shading<float> shading = make_shading<float>(shot.scene, shot.camera, drawing.frame(), drawing.plan());
    LoopSetup<float> setup;
    setup.shading = &shading;
    PartProfile<float> profile;
    profile.falloff_log2 = static_cast<float>(field->kernel().falloff * 1.4426950408889634);
    profile.edge = static_cast<float>(field->kernel().edge());
    profile.root_falloff = static_cast<float>(std::sqrt(field->kernel().falloff));
    profile.weight_channel = 1;
    setup.parts = {profile};
    GroupSheets<float> sheets;
    sheets.rho_channel = sheets.take(setup.channels, 1);
    sheets.weight_channel = sheets.take(setup.channels, 1);
    sheets.threshold = true;
    setup.groups = {sheets};
    setup.first_depth = drawing.frame().first_depth;
    setup.slice_spacing = drawing.frame().slice_spacing;
    const TileLayout layout(shot.size, 60);
    ASSERT_EQ(layout.tiles(), 1U);
    const TileShape shape = layout.shape(0);
    ThreadPool pool(1);
    const TileFunctions<float>& functions = *tile_functions<float>(chosen_instruction_set());
    const auto found = bucket_kernels(*drawing.job().ellipsoids[0].view, *drawing.job().ellipsoids[0].visible, layout,
                                      functions.rects, pool);
    TileScratch<float> room;
    room.kernels.resize(1);
    functions.feed_kernels(*drawing.job().ellipsoids[0].view, found.begin(0), found.end(0), shape, room.kernels[0]);
    room.ring.assign(shape.sheet_elements() * ring_slots * 2, 0.0F);
    room.zeros.assign(shape.sheet_elements(), 0.0F);
    room.picture.assign(shape.picture_elements(), 0.0F);
    room.planes.scalar = room.picture.data();
    room.row_alive.assign(static_cast<std::size_t>(shape.height), shape.width);
    room.planes.row_alive = room.row_alive.data();
    room.planes.alive = shape.width * shape.height;

    // Of each slice: the sections that a drawing of the kernels that begin there, or are drawn again, can cover.
    std::vector<std::uint64_t> most(static_cast<std::size_t>(drawing.frame().slices) + 16, 0);
    const TileKernels<float>& kernels = room.kernels[0];
    for (std::size_t i = 0; i < kernels.sections.size(); ++i) {
        for (std::int32_t n = kernels.sections[i].first; n <= kernels.extras[i].last; n += covered_slices) {
            most[static_cast<std::size_t>(n)] += covered_slices;
        }
    }
    const std::uint64_t bound = *std::max_element(most.begin(), most.end());
    std::size_t calls = 0;
    std::uint64_t drawn = 0;
    const std::function<bool()> count = [&] {
        EXPECT_LE(room.sections_drawn - drawn, bound);
        drawn = room.sections_drawn;
        ++calls;
        return true;
    };
    functions.run(setup, shape, room, count);
    const std::size_t all_calls = calls;
    const std::vector<float> picture(room.picture.begin(), room.picture.end());
    EXPECT_GE(all_calls, 100U);
    EXPECT_GT(drawn, 20 * bound);
    for (const std::size_t last : {std::size_t{1}, all_calls / 2, all_calls - 1}) {
        std::fill(room.picture.begin(), room.picture.end(), 0.0F);
        calls = 0;
        functions.run(setup, shape, room, [&] { return ++calls < last; });
        EXPECT_EQ(calls, last);
        EXPECT_NE(std::vector<float>(room.picture.begin(), room.picture.end()), picture);
        // What a picture that was ended leaves behind does not get into the next one.
        std::fill(room.picture.begin(), room.picture.end(), 0.0F);
        functions.run(setup, shape, room, [] { return true; });
        EXPECT_EQ(std::vector<float>(room.picture.begin(), room.picture.end()), picture);
    }
}

} // namespace
} // namespace sheetsplat::backend_cpu

// Front to back through the cells of a grid: which kernels are drawn for which batch.
#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <memory>
#include <set>
#include <string>
#include <vector>

#include <glm/geometric.hpp>
#include <gtest/gtest.h>

#include "index/ellipsoid_fields.hpp"
#include "view/cell_walk.hpp"

namespace sheetsplat {
namespace {

using test::Random;
using test::Scatter;
using Entry = CellTraversal::Entry;

constexpr double never = std::numeric_limits<double>::infinity();

enum class Kind { none, one, copies, even, turned, sizes, through, flat };
constexpr Kind all_kinds[] = {Kind::none,   Kind::one,   Kind::copies,  Kind::even,
                              Kind::turned, Kind::sizes, Kind::through, Kind::flat};

EllipsoidArrays kernels_of(Kind kind, unsigned seed) {
    Random random(seed);
    switch (kind) {
    case Kind::none:
        return {};
    case Kind::one:
        return test::scattered(random, Scatter::turned, 1);
    case Kind::copies:
        return test::scattered(random, Scatter::copies, 50);
    case Kind::even:
        return test::scattered(random, Scatter::even, 400);
    case Kind::turned:
        return test::scattered(random, Scatter::turned, 400);
    case Kind::flat:
        return test::scattered(random, Scatter::flat, 300);
    case Kind::sizes:
    case Kind::through:
        break;
    }
    EllipsoidArrays arrays;
    for (int i = 0; i < 300; ++i) {
        arrays.centers.push_back(20.0 * random.in_cube());
        // Sizes over eight decades, or kernels of which each spans most of the slices.
        arrays.radii.push_back(kind == Kind::sizes ? std::pow(10.0, random.uniform(-6.0, 2.0))
                                                   : random.uniform(15.0, 100.0));
        arrays.values.push_back(1.0);
    }
    return arrays;
}

struct Setting {
    Kind kind;
    Projection projection;
    Sampling sampling;
    BatchLayout layout;
    int wider;
    bool may_narrow;
};

/// All that a traversal is made from.
struct Stage {
    std::shared_ptr<const EllipsoidField> field;
    Camera camera;
    Frame frame;
    SpatialGrid grid;
    StartCells starts;
    EllipsoidView view;

    Stage(EllipsoidArrays arrays, const Camera& from, Sampling sampling, double spacing)
        : field(std::make_shared<EllipsoidField>(std::move(arrays))), camera(from), frame(frame_of(*this, spacing)),
          grid(SpatialGrid::of(*field)), starts(StartCells::of(*field, grid)),
          view(*field, camera, frame, sampling, Filter::none, 1.0, 1.0) {}
    Stage(const Stage&) = delete;
    Stage& operator=(const Stage&) = delete;

    [[nodiscard]] CellTraversal traversal(const Setting& setting, bool by_reach,
                                          const std::vector<std::uint8_t>& visible) const {
        return CellTraversal::of(view, grid, by_reach ? &starts : nullptr, visible, setting.layout, setting.wider,
                                 setting.wider, setting.may_narrow, 0.0, never);
    }
    [[nodiscard]] std::uint32_t start(std::size_t kernel, bool by_reach) const {
        return by_reach ? starts.of_kernel(*field, grid, kernel, view.first_point_world(kernel)) : grid.home(kernel);
    }

  private:
    static Frame frame_of(const Stage& stage, double spacing) {
        Scene scene{{stage.field}, TransferFunction({{0.0, {1, 1, 1}, 0.0}, {1.0, {1, 1, 1}, 0.5}})};
        scene.slice_spacing = spacing;
        return make_frame(scene, stage.camera, {48, 36});
    }
};

Camera camera_for(const EllipsoidArrays& arrays, Projection projection) {
    Box box;
    const EllipsoidField field{EllipsoidArrays(arrays)};
    box = field.size() == 0 ? Box{Vec3(-1.0), Vec3(1.0)} : field.supports_world();
    if (projection == Projection::orthographic) {
        return Camera::fit(box, Vec3(0.3, -0.5, -1.0), Vec3(0.0, 1.0, 0.0));
    }
    // Among the kernels, so that some are cut by the near plane.
    return Camera::perspective(box.centre(), box.centre() + Vec3(0.3, -0.5, -1.0), Vec3(0.0, 1.0, 0.0), 100.0,
                               0.02 * glm::length(box.extent()));
}

double spacing_for(const EllipsoidArrays& arrays) {
    if (arrays.centers.empty()) {
        return 1.0;
    }
    const EllipsoidField field{EllipsoidArrays(arrays)};
    return glm::length(field.supports_world().extent()) / 90.0;
}

/// Every drawing: kernel -> batches, and what the walk asked.
struct Walked {
    std::map<std::uint32_t, std::vector<std::int64_t>> drawn;
    std::map<std::uint32_t, bool> narrow;
    std::map<std::size_t, std::vector<std::int64_t>> asked; ///< cell -> batches
};

/// Walks all batches and a few more. hides(cell, batch): from then on.
template <class Hides>
Walked walk_of(const CellTraversal& traversal, std::int64_t batches, Hides&& hides) {
    Walked walked;
    CellWalk walk(traversal);
    for (std::int64_t batch = 0; batch < batches + 5; ++batch) {
        std::size_t cell = 0;
        walk.next(
            [&](const EllipsoidView::ScreenBounds& bounds) {
                cell = 0;
                while (&traversal.cells()[cell].bounds != &bounds) {
                    ++cell;
                }
                walked.asked[cell].push_back(batch);
                return hides(cell, batch);
            },
            [&](const Entry& entry) {
                walked.drawn[entry.kernel].push_back(batch);
                walked.narrow[entry.kernel] = entry.narrow != 0U;
                // It is drawn by the cell that was asked for last.
                const CellTraversal::Cell& own = traversal.cells()[cell];
                const Entry* begin = traversal.entries() + own.begin;
                const Entry* end = traversal.entries() + own.end;
                EXPECT_TRUE(std::any_of(begin, end, [&](const Entry& e) { return e.kernel == entry.kernel; }));
            });
    }
    return walked;
}

const auto shown = [](std::size_t, std::int64_t) { return false; };

class Walks : public testing::TestWithParam<Kind> {};

TEST_P(Walks, DrawEveryKernelOnceInEverySlabThatItMeets) {
    std::size_t several_cells = 0, again = 0, narrow = 0, cut = 0;
    unsigned seed = 1;
    for (const Projection projection : {Projection::orthographic, Projection::perspective}) {
        for (const Sampling sampling : {Sampling::point, Sampling::slab}) {
            const EllipsoidArrays arrays = kernels_of(GetParam(), seed++);
            const Stage stage(arrays, camera_for(arrays, projection), sampling, spacing_for(arrays));
            Random random(seed);
            std::vector<std::uint8_t> visible(stage.field->size());
            for (std::uint8_t& flag : visible) {
                flag = random.chance(0.8) || visible.size() == 1 ? 1 : 0;
            }
            for (const BatchLayout layout : {BatchLayout{4, 8}, BatchLayout{1, 4}, BatchLayout{1, 1}}) {
                for (const int wider : {0, 1}) {
                    for (const bool may_narrow : {false, true}) {
                        const Setting setting{GetParam(), projection, sampling, layout, wider, may_narrow};
                        const CellTraversal traversal = stage.traversal(setting, true, visible);
                        const std::int64_t batches = (stage.frame.slices + layout.stride - 1) / layout.stride;
                        const Walked walked = walk_of(traversal, batches, shown);
                        EXPECT_EQ(walked.drawn.size(), traversal.kernels());
                        for (std::size_t i = 0; i < stage.field->size(); ++i) {
                            const EllipsoidView::Span span = stage.view.span(stage.view.depths(i), wider);
                            const auto found = walked.drawn.find(static_cast<std::uint32_t>(i));
                            if (visible[i] == 0 || span.first > span.last) {
                                EXPECT_TRUE(found == walked.drawn.end()) << i;
                                continue;
                            }
                            if (found == walked.drawn.end()) {
                                // Beside the picture, which shows all of it in orthographic view.
                                EXPECT_EQ(projection, Projection::perspective) << i;
                                continue;
                            }
                            const bool half = walked.narrow.at(found->first);
                            const int covered = half ? layout.stride : layout.covered;
                            std::vector<int> times(static_cast<std::size_t>(stage.frame.slices), 0);
                            for (const std::int64_t batch : found->second) {
                                const std::int64_t first = batch * layout.stride;
                                EXPECT_LE(first, span.last) << "drawn after its last slab";
                                EXPECT_GE(first + covered, span.first + 1) << "drawn before its first slab";
                                for (std::int64_t slab = first; slab < std::min(first + covered, stage.frame.slices);
                                     ++slab) {
                                    ++times[static_cast<std::size_t>(slab)];
                                }
                            }
                            for (std::int64_t slab = span.first; slab <= span.last; ++slab) {
                                EXPECT_EQ(times[static_cast<std::size_t>(slab)], 1) << "kernel " << i << ", " << slab;
                            }
                            EXPECT_LE(*std::max_element(times.begin(), times.end()), 1);
                            again += found->second.size() > 1 ? 1 : 0;
                            narrow += half ? 1 : 0;
                            cut += span.first == 0 && projection == Projection::perspective ? 1 : 0;
                            if (half) {
                                EXPECT_TRUE(may_narrow && layout.covered > layout.stride);
                            } else if (may_narrow && layout.stride == 4) {
                                EXPECT_NE(span.first / 4, span.last / 4) << "could be narrow";
                            }
                        }
                        several_cells += traversal.cells().size() > 1 ? 1 : 0;
                    }
                }
            }
        }
    }
    if (GetParam() == Kind::none) {
        EXPECT_EQ(several_cells + again + narrow, 0U);
    } else {
        EXPECT_GT(again, 0U);
        if (GetParam() != Kind::one && GetParam() != Kind::copies && GetParam() != Kind::through) {
            EXPECT_GT(several_cells, 0U);
            EXPECT_GT(narrow, 0U);
        }
        if (GetParam() != Kind::one && GetParam() != Kind::copies) {
            EXPECT_GT(cut, 0U);
        }
    }
}

TEST_P(Walks, CellsComeAndGoWithTheirKernels) {
    for (const Projection projection : {Projection::orthographic, Projection::perspective}) {
        const EllipsoidArrays arrays = kernels_of(GetParam(), 77);
        const Stage stage(arrays, camera_for(arrays, projection), Sampling::slab, spacing_for(arrays));
        const std::vector<std::uint8_t> visible(stage.field->size(), 1);
        for (const BatchLayout layout : {BatchLayout{4, 8}, BatchLayout{1, 4}, BatchLayout{1, 1}}) {
            const Setting setting{GetParam(), projection, Sampling::slab, layout, 0, true};
            const std::int64_t batches = (stage.frame.slices + layout.stride - 1) / layout.stride;
            std::vector<Walked> both;
            for (const bool by_reach : {false, true}) {
                const CellTraversal traversal = stage.traversal(setting, by_reach, visible);
                // Cells hold the kernels that begin in them, and nobody else's.
                std::map<std::uint32_t, std::size_t> cell_of_start;
                std::uint32_t entries = 0;
                for (std::size_t c = 0; c < traversal.cells().size(); ++c) {
                    const CellTraversal::Cell& cell = traversal.cells()[c];
                    ASSERT_LT(cell.begin, cell.end);
                    entries += cell.end - cell.begin;
                    if (c > 0) {
                        EXPECT_LE(traversal.cells()[c - 1].first_batch, cell.first_batch);
                    }
                    std::int32_t first = std::numeric_limits<std::int32_t>::max(), last = -1;
                    for (std::uint32_t e = cell.begin; e < cell.end; ++e) {
                        const Entry& entry = traversal.entries()[e];
                        const std::uint32_t start = stage.start(entry.kernel, by_reach);
                        EXPECT_EQ(cell_of_start.emplace(start, c).first->second, c) << "one cell, twice";
                        EXPECT_EQ(stage.start(traversal.entries()[cell.begin].kernel, by_reach), start);
                        if (e > cell.begin) {
                            EXPECT_LE(traversal.entries()[e - 1].first_batch, entry.first_batch);
                        }
                        first = std::min(first, entry.first_batch);
                        last = std::max(last, static_cast<std::int32_t>(entry.last_batch));
                        const EllipsoidView::Span span = stage.view.span(stage.view.depths(entry.kernel));
                        EXPECT_EQ(entry.first_batch, span.first / layout.stride);
                        EXPECT_EQ(static_cast<std::int64_t>(entry.last_batch), span.last / layout.stride);
                        const auto bounds = stage.view.support_bounds(entry.kernel, stage.view.front_of(span.first),
                                                                      stage.view.back_of(span.last));
                        EXPECT_TRUE(cell.bounds.unbounded || !bounds.unbounded);
                        EXPECT_TRUE(bounds.unbounded ||
                                    (cell.bounds.left <= bounds.left && cell.bounds.right >= bounds.right &&
                                     cell.bounds.top <= bounds.top && cell.bounds.bottom >= bounds.bottom));
                    }
                    EXPECT_EQ(first, cell.first_batch);
                    EXPECT_EQ(last, cell.last_batch);
                }
                EXPECT_EQ(entries, traversal.kernels());
                // A cell is looked at from its first batch to its last, and in no other.
                both.push_back(walk_of(traversal, batches, shown));
                EXPECT_EQ(both.back().asked.size(), traversal.cells().size());
                for (const auto& [c, asked] : both.back().asked) {
                    const CellTraversal::Cell& cell = traversal.cells()[c];
                    EXPECT_EQ(asked.front(), cell.first_batch);
                    EXPECT_EQ(asked.back(), cell.last_batch);
                    EXPECT_EQ(asked.size(), static_cast<std::size_t>(cell.last_batch - cell.first_batch + 1));
                }
            }
            EXPECT_EQ(both[0].drawn, both[1].drawn) << "homes and reach draw different kernels";
            EXPECT_EQ(both[0].narrow, both[1].narrow);
        }
    }
}

TEST_P(Walks, HiddenCellsLeaveForGood) {
    const EllipsoidArrays arrays = kernels_of(GetParam(), 5);
    const Stage stage(arrays, camera_for(arrays, Projection::orthographic), Sampling::point, spacing_for(arrays));
    const std::vector<std::uint8_t> visible(stage.field->size(), 1);
    const Setting setting{GetParam(), Projection::orthographic, Sampling::point, {4, 8}, 0, false};
    const CellTraversal traversal = stage.traversal(setting, true, visible);
    const std::int64_t batches = (stage.frame.slices + 3) / 4;
    const Walked all = walk_of(traversal, batches, shown);
    const std::int64_t when = batches / 2;
    // Every other cell is hidden at one moment, and would be seen again afterwards.
    const auto hides = [&](std::size_t cell, std::int64_t batch) { return cell % 2 == 0 && batch == when; };
    const Walked some = walk_of(traversal, batches, hides);
    std::size_t dropped = 0;
    for (std::size_t c = 0; c < traversal.cells().size(); ++c) {
        const CellTraversal::Cell& cell = traversal.cells()[c];
        const bool leaves = c % 2 == 0 && cell.first_batch <= when && when <= cell.last_batch;
        if (leaves) {
            EXPECT_EQ(some.asked.at(c).back(), when);
        } else {
            EXPECT_EQ(some.asked.at(c), all.asked.at(c));
        }
        for (std::uint32_t e = cell.begin; e < cell.end; ++e) {
            const std::uint32_t kernel = traversal.entries()[e].kernel;
            std::vector<std::int64_t> wanted = all.drawn.at(kernel);
            if (leaves) {
                const auto late = std::find_if(wanted.begin(), wanted.end(), [&](auto batch) { return batch >= when; });
                dropped += static_cast<std::size_t>(wanted.end() - late);
                wanted.erase(late, wanted.end());
            }
            const auto found = some.drawn.find(kernel);
            EXPECT_EQ(found == some.drawn.end() ? std::vector<std::int64_t>{} : found->second, wanted) << kernel;
        }
    }
    if (GetParam() != Kind::none && GetParam() != Kind::one) {
        EXPECT_GT(dropped, 0U);
    }
    // Hidden from the start, nothing is drawn.
    EXPECT_TRUE(walk_of(traversal, batches, [](std::size_t, std::int64_t) { return true; }).drawn.empty());
}

std::string name_of(const testing::TestParamInfo<Kind>& one) {
    static const char* const kinds[] = {"None", "One", "Copies", "Even", "Turned", "Sizes", "Through", "Flat"};
    return kinds[static_cast<int>(one.param)];
}

INSTANTIATE_TEST_SUITE_P(Fields, Walks, testing::ValuesIn(all_kinds), name_of);

TEST(CellTraversal, LeavesOutWhatThePictureCannotShow) {
    Random random(3);
    const EllipsoidArrays arrays = test::scattered(random, Scatter::turned, 500);
    const EllipsoidField field{EllipsoidArrays(arrays)};
    const Vec3 middle = field.centres_world().centre();
    // A tenth of the kernels' box.
    const Camera camera = Camera::orthographic(middle + Vec3(1.0, 2.0, 3.0), middle, Vec3(0.0, 1.0, 0.0), 0.1);
    const Stage stage(arrays, camera, Sampling::point, 0.02);
    const std::vector<std::uint8_t> visible(stage.field->size(), 1);
    for (const int wider : {0, 6}) {
        const Setting setting{Kind::turned, Projection::orthographic, Sampling::point, {4, 8}, wider, false};
        const CellTraversal traversal = stage.traversal(setting, true, visible);
        std::set<std::uint32_t> kept;
        for (std::size_t e = 0; e < traversal.kernels(); ++e) {
            kept.insert(traversal.entries()[e].kernel);
        }
        std::size_t inside = 0, outside = 0;
        for (std::uint32_t i = 0; i < stage.field->size(); ++i) {
            const Vec3 eye = camera.to_eye(stage.field->center(i));
            const Mat3 m = glm::transpose(stage.field->shape(i));
            const double extent_x = glm::length(m * camera.right_world()) / stage.frame.pixel;
            const double extent_y = glm::length(m * camera.up_world()) / stage.frame.pixel;
            // Pixels by which the support stays away from the picture.
            const double away = std::max(std::abs(eye.x) / stage.frame.pixel - extent_x - 24.0,
                                         std::abs(eye.y) / stage.frame.pixel - extent_y - 18.0) -
                                wider;
            if (away < 1.0) {
                EXPECT_EQ(kept.count(i), 1U) << i;
                ++inside;
            } else if (away > 2.5) {
                EXPECT_EQ(kept.count(i), 0U) << i;
                ++outside;
            }
        }
        EXPECT_GT(inside, 20U);
        EXPECT_GT(outside, 20U);
    }
}

TEST(CellTraversal, TakesTwelveBytesAKernel) {
    static_assert(sizeof(Entry) == 12);
    const EllipsoidArrays arrays = kernels_of(Kind::even, 4);
    const Stage stage(arrays, camera_for(arrays, Projection::orthographic), Sampling::point, spacing_for(arrays));
    const std::vector<std::uint8_t> visible(stage.field->size(), 1);
    const Setting setting{Kind::even, Projection::orthographic, Sampling::point, {4, 8}, 0, false};
    const CellTraversal traversal = stage.traversal(setting, false, visible);
    EXPECT_EQ(traversal.bytes(), 12 * traversal.kernels() + sizeof(CellTraversal::Cell) * traversal.cells().size());
    EXPECT_EQ(traversal.again(), 2);
    EXPECT_EQ(stage.traversal({Kind::even, Projection::orthographic, Sampling::point, {1, 4}, 0, false}, false, visible)
                  .again(),
              4);
}

} // namespace
} // namespace sheetsplat

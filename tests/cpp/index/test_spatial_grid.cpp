// The grid against its definition, for kernels of any size and place; start cells; memory.
#include "index/spatial_grid.hpp"

#include <gtest/gtest.h>
#include <malloc.h>
#include <sys/resource.h>

#include <cstdlib>
#include <fstream>
#include <map>
#include <set>

#include "index/ellipsoid_fields.hpp"
#include "sheetsplat/error.hpp"
#include "support.hpp"

namespace sheetsplat::test {
namespace {

/// Places this near to a cell's face may lie on either side.
double rounding_at(const Box& cell) {
    const Vec3 farthest = glm::max(glm::abs(cell.lower), glm::abs(cell.upper));
    return 1e-15 * std::max({farthest.x, farthest.y, farthest.z});
}

bool holds(const Box& box, const Vec3& point, double wider) {
    return meet({box.lower - wider, box.upper + wider}, {point, point});
}

double largest_extent(const EllipsoidField& field, std::size_t kernel) {
    const Vec3 half = field.extent(kernel);
    return 2.0 * std::max({half.x, half.y, half.z});
}

/// The point of a kernel's support that is nearest to a viewer far away: c + M M^T e / |M^T e|.
Vec3 first_point(const EllipsoidField& field, std::size_t kernel, const Vec3& towards_viewer) {
    const Mat3 shape = field.shape(kernel);
    const Vec3 turned = glm::normalize(towards_viewer) * shape;
    // Divided before it is squared, so that no semi-axis is too short or too long for it.
    const double largest = std::max({std::abs(turned.x), std::abs(turned.y), std::abs(turned.z)});
    return field.center(kernel) + shape * glm::normalize(turned / largest);
}

struct Trial {
    Scatter scatter;
    std::size_t kernels;
};

class Grids : public testing::TestWithParam<Trial> {
  protected:
    EllipsoidField field_ = scattered_field(7, GetParam().scatter, GetParam().kernels);
    SpatialGrid grid_ = SpatialGrid::of(field_);
};

TEST_P(Grids, EveryKernelIsAtHomeOnce) {
    ASSERT_EQ(grid_.kernels(), field_.size());
    std::vector<int> times(field_.size(), 0);
    for (std::size_t cell = 0; cell < grid_.cells(); ++cell) {
        ASSERT_EQ(grid_.home_begin(cell), cell == 0 ? grid_.order().data() : grid_.home_end(cell - 1));
        ASSERT_LT(grid_.home_begin(cell), grid_.home_end(cell));
        for (const std::uint32_t* kernel = grid_.home_begin(cell); kernel != grid_.home_end(cell); ++kernel) {
            ++times[*kernel];
            ASSERT_EQ(grid_.home(*kernel), cell);
            ASSERT_EQ(grid_.level(*kernel), grid_.level_of_cell(cell));
            ASSERT_TRUE(holds(grid_.cell_bounds(cell), field_.center(*kernel), rounding_at(grid_.cell_bounds(cell))));
            ASSERT_LE(largest_extent(field_, *kernel), grid_.cell_size(grid_.level_of_cell(cell)));
        }
    }
    EXPECT_EQ(times, std::vector<int>(field_.size(), 1));
}

TEST_P(Grids, CellsAreSortedByLevelAndExistOnce) {
    ASSERT_GE(grid_.levels(), 1);
    EXPECT_LE(grid_.levels(), 53);
    EXPECT_EQ(grid_.level_begin(0), 0U);
    EXPECT_EQ(grid_.level_begin(grid_.levels()), grid_.cells());
    EXPECT_GT(grid_.level_begin(1), 0U) << "level 0 is the finest that is used";
    for (int level = 0; level < grid_.levels(); ++level) {
        if (level > 0) {
            EXPECT_EQ(grid_.cell_size(level), 2.0 * grid_.cell_size(level - 1));
        }
        std::set<std::array<double, 3>> corners;
        const double size = grid_.cell_size(level);
        for (std::uint32_t cell = grid_.level_begin(level); cell < grid_.level_begin(level + 1); ++cell) {
            EXPECT_EQ(grid_.level_of_cell(cell), level);
            const Box bounds = grid_.cell_bounds(cell);
            const double rounding = 4.0 * rounding_at(bounds);
            for (int axis = 0; axis < 3; ++axis) {
                EXPECT_NEAR(bounds.extent()[axis], size, rounding);
            }
            if (size > rounding) {
                EXPECT_TRUE(corners.insert({bounds.lower.x, bounds.lower.y, bounds.lower.z}).second);
            }
        }
    }
}

TEST_P(Grids, BoxesAreThoseOfTheKernelsAtHome) {
    for (std::size_t cell = 0; cell < grid_.cells(); ++cell) {
        Box box = box_of(field_, *grid_.home_begin(cell));
        for (const std::uint32_t* kernel = grid_.home_begin(cell); kernel != grid_.home_end(cell); ++kernel) {
            const Box support = box_of(field_, *kernel);
            box = {glm::min(box.lower, support.lower), glm::max(box.upper, support.upper)};
        }
        EXPECT_EQ(grid_.home_supports(cell).lower, box.lower);
        EXPECT_EQ(grid_.home_supports(cell).upper, box.upper);
    }
}

// A cell is as fine as its kernels' sizes and number allow: were any least_in_cell of those that fit the next finer
// level in one of its eighths, they would live there.
TEST_P(Grids, CellsAreAsFineAsTheyCanBe) {
    std::size_t small = 0;
    for (std::size_t cell = 0; cell < grid_.cells(); ++cell) {
        const int level = grid_.level_of_cell(cell);
        const Box bounds = grid_.cell_bounds(cell);
        if (static_cast<std::size_t>(grid_.home_end(cell) - grid_.home_begin(cell)) < SpatialGrid::least_in_cell) {
            ++small;
            EXPECT_TRUE(glm::all(glm::lessThanEqual(bounds.lower, field_.supports_world().lower)) &&
                        glm::all(glm::greaterThanEqual(bounds.upper, field_.supports_world().upper)));
        }
        // Centres closer than this to the middle may count to either side.
        const double rounding = 4.0 * rounding_at(bounds);
        std::map<int, std::size_t> in_eighth;
        for (const std::uint32_t* kernel = grid_.home_begin(cell); kernel != grid_.home_end(cell); ++kernel) {
            const Vec3 from_middle = field_.center(*kernel) - bounds.centre();
            const Vec3 distance = glm::abs(from_middle);
            if (largest_extent(field_, *kernel) <= 0.5 * grid_.cell_size(level) &&
                std::min({distance.x, distance.y, distance.z}) > rounding) {
                ++in_eighth[(from_middle.x > 0.0 ? 1 : 0) + (from_middle.y > 0.0 ? 2 : 0) +
                            (from_middle.z > 0.0 ? 4 : 0)];
            }
        }
        for (const auto& [eighth, kernels] : in_eighth) {
            EXPECT_LT(kernels, SpatialGrid::least_in_cell) << "cell " << cell << ", eighth " << eighth;
        }
    }
    EXPECT_LE(small, 1U);
    EXPECT_LE(grid_.cells(), field_.size() / SpatialGrid::least_in_cell + 1);
}

TEST_P(Grids, StartCellsExistOnce) {
    const StartCells starts = StartCells::of(field_, grid_);
    ASSERT_GE(starts.cells(), grid_.cells());
    std::set<std::array<double, 6>> boxes;
    std::size_t large = 0;
    for (std::size_t cell = 0; cell < starts.cells(); ++cell) {
        const Box bounds = starts.cell_bounds(grid_, cell);
        if (glm::length(bounds.extent()) > 100.0 * rounding_at(bounds)) {
            ++large;
            boxes.insert(
                {bounds.lower.x, bounds.lower.y, bounds.lower.z, bounds.upper.x, bounds.upper.y, bounds.upper.z});
        }
    }
    EXPECT_EQ(boxes.size(), large);
}

TEST_P(Grids, AKernelStartsInOneOfTheCellsThatItMeets) {
    const StartCells starts = StartCells::of(field_, grid_);
    Random random(3);
    std::size_t elsewhere = 0;
    for (int view = 0; view < 12; ++view) {
        // Along an axis first points lie on cells' faces.
        Vec3 towards(0.0);
        towards[view % 3] = view < 3 ? 1.0 : -1.0;
        if (view >= 6) {
            do {
                towards = random.in_ball();
            } while (glm::length(towards) < 0.1);
        }
        for (std::size_t kernel = 0; kernel < field_.size(); ++kernel) {
            const Vec3 point = first_point(field_, kernel, towards);
            const std::uint32_t start = starts.of_kernel(field_, grid_, kernel, point);
            ASSERT_LT(start, starts.cells());
            const Box bounds = starts.cell_bounds(grid_, start);
            const double rounding = 4.0 * rounding_at(bounds);
            ASSERT_NEAR(bounds.extent().x, grid_.cell_size(grid_.level(kernel)), rounding);
            ASSERT_TRUE(holds(bounds, point, rounding + 1e-12 * largest_extent(field_, kernel)));
            ASSERT_TRUE(meet({bounds.lower - rounding, bounds.upper + rounding}, box_of(field_, kernel)));
            elsewhere += start != grid_.home(kernel) ? 1 : 0;
        }
    }
    // Homes alone would not do.
    EXPECT_TRUE(elsewhere > 0 || field_.size() < 100 || grid_.cells() == 1);
}

std::vector<Trial> trials() {
    std::vector<Trial> result;
    for (const Scatter scatter : all_scatters) {
        for (const std::size_t kernels : {1, 2, 9, 300, 6000}) {
            result.push_back({scatter, kernels});
        }
    }
    return result;
}

std::string name_of_trial(const testing::TestParamInfo<Trial>& tried) {
    return std::string(name_of(tried.param.scatter)) + std::to_string(tried.param.kernels);
}

INSTANTIATE_TEST_SUITE_P(All, Grids, testing::ValuesIn(trials()), name_of_trial);

TEST(SpatialGrid, OfNothing) {
    const EllipsoidField field{EllipsoidArrays{}};
    const SpatialGrid grid = SpatialGrid::of(field);
    EXPECT_EQ(grid.cells(), 0U);
    EXPECT_EQ(grid.levels(), 0);
    EXPECT_EQ(grid.kernels(), 0U);
    EXPECT_EQ(StartCells::of(field, grid).cells(), 0U);
}

TEST(SpatialGrid, ClustersGetFineCells) {
    // A thousand kernels in a cube of 1e-6, one kernel a thousand away.
    Random random(5);
    EllipsoidArrays arrays = scattered(random, Scatter::even, 1000);
    for (std::size_t i = 0; i < 1000; ++i) {
        arrays.centers[i] *= 1e-6;
        arrays.radii[i] = 2e-8;
    }
    arrays.centers.emplace_back(1e3, 0.0, 0.0);
    arrays.radii.push_back(1.0);
    arrays.values.push_back(0.0);
    const SpatialGrid grid = SpatialGrid::of(EllipsoidField(arrays));
    EXPECT_GT(grid.cells(), 30U);
    EXPECT_LT(grid.cell_size(0), 1e-6);
}

TEST(SpatialGrid, SizesAtTheEndsOfTheNumbers) {
    EllipsoidArrays arrays;
    for (const double size : {1e-100, 1e-50, 1e-8, 1.0, 1e50, 1e100}) {
        for (const Vec3& centre : {Vec3(0.0), Vec3(1.0, 2.0, 3.0), Vec3(-1e100, 1e100, 0.0)}) {
            for (int copy = 0; copy < 9; ++copy) {
                arrays.centers.push_back(centre);
                arrays.radii.push_back(size);
                arrays.values.push_back(1.0);
            }
        }
    }
    const EllipsoidField field(arrays);
    const SpatialGrid grid = SpatialGrid::of(field);
    const StartCells starts = StartCells::of(field, grid);
    for (std::size_t kernel = 0; kernel < field.size(); ++kernel) {
        const Vec3 point = first_point(field, kernel, Vec3(1e-3, -1e-3, 1.0));
        EXPECT_TRUE(std::isfinite(point.x) && std::isfinite(point.y) && std::isfinite(point.z));
        ASSERT_LT(starts.of_kernel(field, grid, kernel, point), starts.cells());
    }
    // The same for kernels that are all too small for the finest cells.
    for (double& radius : arrays.radii) {
        radius = 1e-100;
    }
    for (Vec3& centre : arrays.centers) {
        centre = Vec3(0.0);
    }
    EXPECT_EQ(SpatialGrid::of(EllipsoidField(arrays)).cells(), 1U);
}

// Kernels beside each other in number lie beside each other in space: boxes around runs of them stay small.
TEST(SpatialGrid, OrderFollowsSpace) {
    const EllipsoidField field = scattered_field(2, Scatter::even, 20000);
    const SpatialGrid grid = SpatialGrid::of(field);
    const auto mean_extent = [&](const std::vector<std::uint32_t>& order) {
        double sum = 0.0;
        constexpr std::size_t run = 20;
        for (std::size_t begin = 0; begin + run <= order.size(); begin += run) {
            Box box{field.center(order[begin]), field.center(order[begin])};
            for (std::size_t at = begin; at < begin + run; ++at) {
                box = {glm::min(box.lower, field.center(order[at])), glm::max(box.upper, field.center(order[at]))};
            }
            sum += glm::length(box.extent()) / static_cast<double>(order.size() / run);
        }
        return sum;
    };
    std::vector<std::uint32_t> unsorted(field.size());
    for (std::uint32_t kernel = 0; kernel < field.size(); ++kernel) {
        unsorted[kernel] = kernel;
    }
    // A cube with 20 of the 20,000 has a diagonal of 0.17.
    EXPECT_LT(mean_extent(grid.order()), 0.34);
    EXPECT_GT(mean_extent(unsorted), 1.0);
}

// A quadratic step anywhere would keep these 300,000 kernels busy for minutes.
TEST(SpatialGrid, HardScattersTakeNoMoreThanEvenOnes) {
    for (const Scatter scatter : {Scatter::sizes, Scatter::clusters, Scatter::one_spot, Scatter::copies}) {
        const EllipsoidField field = scattered_field(1, scatter, 300000);
        const SpatialGrid grid = SpatialGrid::of(field);
        EXPECT_LE(grid.cells(), field.size() / SpatialGrid::least_in_cell + 1);
        EXPECT_LE(StartCells::of(field, grid).cells(), 8 * field.size());
        TransferFunction transfer_function({{0.9, Vec3(1), 0.0}, {1.0, Vec3(1), 1.0}});
        VisibilityQuery visibility;
        visibility.transfer_function = &transfer_function;
        EXPECT_EQ(visible_kernels(field, grid, visibility).size(), field.size());
    }
}

#ifndef SHEETSPLAT_SANITIZED
/// The most memory that this process had at once since the last call, bytes. What is free goes back to the system.
std::size_t peak_memory() {
    malloc_trim(0);
    std::ifstream status("/proc/self/status");
    std::size_t peak = 0;
    for (std::string line; std::getline(status, line);) {
        if (line.rfind("VmHWM:", 0) == 0) {
            peak = std::stoull(line.substr(6)) * 1024;
        }
    }
    std::ofstream("/proc/self/clear_refs") << 5;
    return peak;
}

TEST(SpatialGrid, MemoryAKernel) {
    constexpr std::size_t n = 1000000;
    for (const Scatter scatter : {Scatter::even, Scatter::clusters, Scatter::sizes}) {
        const EllipsoidField field = scattered_field(1, scatter, n);
        peak_memory();
        const std::size_t before = peak_memory();
        std::vector<std::uint8_t> control(33 * n, 1);
        const std::size_t with_control = peak_memory();
        if (with_control <= before) {
            GTEST_SKIP() << "this system does not tell the peak of memory anew";
        }
        EXPECT_GT(with_control, before + 32 * n) << control.back();
        control = {};
        peak_memory();
        const std::size_t without = peak_memory();
        const SpatialGrid grid = SpatialGrid::of(field);
        EXPECT_LT(peak_memory(), without + 32 * n) << name_of(scatter);
        EXPECT_LE(grid.bytes(), 20 * n);
    }
}

TEST(SpatialGridDeathTest, MemoryIsCheckedBeforeItIsTaken) {
    const EllipsoidField field = scattered_field(1, Scatter::even, 300000);
    const auto try_with = [&](std::size_t bytes_left) {
        std::size_t pages = 0;
        std::ifstream("/proc/self/statm") >> pages;
        rlimit limit{};
        limit.rlim_cur = limit.rlim_max = pages * 4096 + bytes_left;
        setrlimit(RLIMIT_AS, &limit);
        try {
            (void)SpatialGrid::of(field);
        } catch (const OutOfMemory&) {
            std::_Exit(7);
        }
        std::_Exit(0);
    };
    EXPECT_EXIT(try_with(std::size_t{1} << 20), testing::ExitedWithCode(7), "");
    EXPECT_EXIT(try_with(std::size_t{1} << 28), testing::ExitedWithCode(0), "");
}
#endif

} // namespace
} // namespace sheetsplat::test

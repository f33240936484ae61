// Volumes of fewer samples for stages with large pixels.
#include "field_levels.hpp"

#include <cmath>
#include <limits>
#include <numeric>

#include <gtest/gtest.h>

#include "sheetsplat/error.hpp"
#include "support/lattices.hpp"

namespace sheetsplat {
namespace {

std::shared_ptr<const RegularField> ramp(std::array<std::size_t, 3> shape,
                                         const RegularFieldOptions& options = test::zero_boundary()) {
    std::vector<float> samples(shape[0] * shape[1] * shape[2]);
    std::iota(samples.begin(), samples.end(), 1.0F);
    return std::make_shared<RegularField>(std::move(samples), shape, options);
}

Scene scene_of(std::shared_ptr<const Field> field) {
    return Scene{{std::move(field)}, TransferFunction({{0.0, {1.0, 1.0, 1.0}, 0.0}, {1.0, {1.0, 1.0, 1.0}, 1.0}})};
}

std::shared_ptr<const RegularField> made(FieldLevels& levels, const std::shared_ptr<const Field>& field,
                                         const Level& level) {
    return std::dynamic_pointer_cast<const RegularField>(levels.of({field}, level, [] {}).front());
}

double sum_of(const RegularField& field) {
    const auto& samples = std::get<std::vector<float>>(field.samples());
    return std::accumulate(samples.begin(), samples.end(), 0.0);
}

TEST(FieldLevels, BlocksAreAsLongAsPixels) {
    RegularFieldOptions options = test::zero_boundary();
    options.spacing = {1.0, 2.0, 0.5};
    const auto field = ramp({64, 64, 64}, options);
    const auto blocks = [&](double pixel) { return level_of(scene_of(field), pixel).blocks.front(); };
    EXPECT_EQ(blocks(0.0), (LevelBlock{1, 1, 1}));
    EXPECT_EQ(blocks(0.9), (LevelBlock{1, 1, 1}));
    EXPECT_EQ(blocks(1.0), (LevelBlock{1, 1, 2}));
    EXPECT_EQ(blocks(4.0), (LevelBlock{4, 2, 8}));
    EXPECT_EQ(blocks(1e9), (LevelBlock{8, 8, 8})) << "8 blocks are left";
    const Level level = level_of(scene_of(field), 4.0);
    EXPECT_EQ(level.fewer, 64.0);
    EXPECT_EQ(level.slice_spacing, 4.0);
    EXPECT_EQ(level_of(scene_of(field), 0.0).slice_spacing, 0.5);
    EXPECT_EQ(level_of(scene_of(field), 1e9, true).blocks.front(), (LevelBlock{1, 1, 1}));
}

TEST(FieldLevels, OtherFieldsStayThemselves) {
    RegularFieldOptions bcc = test::zero_boundary();
    bcc.lattice = Lattice::bcc;
    EllipsoidArrays arrays;
    arrays.centers = {Vec3(0.0), Vec3(1.0)};
    arrays.radii = {1.0, 1.0};
    arrays.values = {1.0, 2.0};
    const std::vector<std::shared_ptr<const Field>> fields{ramp({32, 32, 32}, bcc),
                                                           std::make_shared<EllipsoidField>(std::move(arrays))};
    Scene scene = scene_of(fields.front());
    scene.fields = fields;
    const Level level = level_of(scene, 100.0);
    EXPECT_EQ(level.fewer, 1.0);
    EXPECT_EQ(level.slice_spacing, scene.default_slice_spacing());
    FieldLevels levels;
    EXPECT_EQ(levels.of(fields, level, [] {}), fields);
}

TEST(FieldLevels, BlocksKeepTheSumOfTheirSamplesAndTheirPlaces) {
    RegularFieldOptions options = test::zero_boundary();
    options.origin = {10.0, 20.0, 30.0};
    options.spacing = {1.0, 1.0, 2.0};
    // Blocks of 2, 2 and 1 samples; what is missing in the last ones counts as 0.
    const auto field = ramp({16, 17, 19}, options);
    FieldLevels levels;
    const Level level = level_of(scene_of(field), 2.0);
    ASSERT_EQ(level.blocks.front(), (LevelBlock{2, 2, 1}));
    const auto blocks = made(levels, field, level);
    EXPECT_EQ(blocks->shape(), (std::array<std::size_t, 3>{16, 9, 10}));
    EXPECT_NEAR(4.0 * sum_of(*blocks), sum_of(*field), 1e-6 * sum_of(*field));
    EXPECT_EQ(blocks->value(1, 2, 3),
              0.25 * (field->value(2, 4, 3) + field->value(3, 4, 3) + field->value(2, 5, 3) + field->value(3, 5, 3)));
    EXPECT_EQ(blocks->position(1, 2, 3), 0.5 * (field->position(2, 4, 3) + field->position(3, 5, 3)));
    EXPECT_EQ(blocks->kernel_axes().lengths, field->kernel_axes().lengths * Vec3(2.0, 2.0, 1.0));
    EXPECT_EQ(blocks->lattice_constant(), field->lattice_constant());
}

TEST(FieldLevels, BlocksOfTheFactorsOfAPrefilteredField) {
    RegularFieldOptions options = test::zero_boundary();
    options.prefilter = true;
    const auto field = ramp({16, 16, 16}, options);
    FieldLevels levels;
    const auto blocks = made(levels, field, level_of(scene_of(field), 2.0));
    EXPECT_EQ(blocks->normalization(), field->normalization());
    EXPECT_FALSE(blocks->prefilter());
    EXPECT_NEAR(8.0 * sum_of(*blocks), sum_of(*field), 1e-6 * sum_of(*field));
}

TEST(FieldLevels, HolesAreLeftOut) {
    std::vector<float> samples(16 * 16 * 16, 3.0F);
    const float nan = std::numeric_limits<float>::quiet_NaN();
    for (const std::size_t n : {0U, 1U, 16U, 17U, 256U, 257U, 272U, 273U, 2U}) {
        samples[n] = nan;
    }
    RegularFieldOptions options = test::zero_boundary();
    options.nan = NanPolicy::skip;
    for (const Normalization normalization : {Normalization::threshold, Normalization::lattice}) {
        options.normalization = normalization;
        const auto field =
            std::make_shared<const RegularField>(samples, std::array<std::size_t, 3>{16, 16, 16}, options);
        FieldLevels levels;
        const auto blocks = made(levels, field, level_of(scene_of(field), 2.0));
        EXPECT_TRUE(std::isnan(blocks->value(0, 0, 0)));
        EXPECT_EQ(blocks->value(1, 0, 0), normalization == Normalization::threshold ? 3.0 : 3.0 * 7.0 / 8.0);
        EXPECT_EQ(blocks->value(1, 1, 1), 3.0);
    }
}

TEST(FieldLevels, IntegersStayIntegers) {
    std::vector<std::uint8_t> samples(16 * 16 * 16, 7);
    samples[0] = 0;
    samples[1] = 3;
    const auto field =
        std::make_shared<const RegularField>(samples, std::array<std::size_t, 3>{16, 16, 16}, test::zero_boundary());
    FieldLevels levels;
    const auto blocks = made(levels, field, level_of(scene_of(field), 2.0));
    ASSERT_TRUE(std::holds_alternative<std::vector<std::uint8_t>>(blocks->samples()));
    EXPECT_EQ(blocks->value(0, 0, 0), 6.0) << "45 / 8, rounded";
    EXPECT_EQ(blocks->value(1, 0, 0), 7.0);
}

TEST(FieldLevels, AreKeptAsLongAsTheirFields) {
    const auto field = ramp({32, 32, 32}), other = ramp({32, 32, 32});
    FieldLevels levels;
    const Level two = level_of(scene_of(field), 2.0), four = level_of(scene_of(field), 4.0);
    const auto first = made(levels, field, two);
    EXPECT_NE(made(levels, field, four), first);
    EXPECT_EQ(made(levels, field, two), first);
    EXPECT_TRUE(levels.made(first));
    EXPECT_FALSE(levels.made(field));
    EXPECT_EQ(levels.keep(scene_of(first)).size(), 3U) << "a stage keeps its source and the other levels";
    EXPECT_EQ(levels.keep(scene_of(field)).size(), 3U);
    EXPECT_EQ(levels.keep(scene_of(other)).size(), 1U);
    EXPECT_FALSE(levels.made(first));
}

TEST(FieldLevels, CanBeCancelled) {
    const auto field = ramp({32, 32, 32});
    FieldLevels levels;
    const Level level = level_of(scene_of(field), 2.0);
    EXPECT_THROW(static_cast<void>(levels.of({field}, level, [] { throw Cancelled(); })), Cancelled);
    EXPECT_NE(made(levels, field, level), nullptr);
}

} // namespace
} // namespace sheetsplat

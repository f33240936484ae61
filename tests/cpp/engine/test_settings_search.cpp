// The choice of settings for an error or a time, by judges whose errors and times are formulas; and promises of a
// renderer, by its own pictures.
#include "settings_search.hpp"

#include <cmath>
#include <limits>
#include <set>
#include <string>
#include <utility>

#include <gtest/gtest.h>

#include "sheetsplat/error.hpp"
#include "sheetsplat/renderer.hpp"
#include "support/bumps.hpp"

namespace sheetsplat {
namespace {

using test::bumps;

/// Errors c ds^p and a stop's, times in proportion to 1 / ds.
class Formula : public Judge {
  public:
    double point = 1e-2, first = 5e-3, second = 2e-3, slab = 9e-3; ///< at ds = 1
    double first_price = 1.3, second_price = 2.0, slab_price = 10.0;
    double stopped = 0.0; ///< at 0.98
    bool has_second = true;
    bool opposed = false; ///< the stop takes away what the slices add
    double noise = 0.0;
    Floor least{};
    int looks = 0;

    std::optional<double> error(const Settings& settings) override {
        ++looks;
        if (settings.second_order && !has_second) {
            return std::nullopt;
        }
        const double ds = settings.slice_spacing;
        const double own = settings.sampling == Sampling::slab ? slab * ds * ds
                           : settings.second_order             ? second * ds * ds * ds
                           : settings.preintegration           ? first * ds * ds
                                                               : point * ds;
        const double stop = stop_error(settings);
        return std::hypot(opposed ? own - stop : std::hypot(own, stop), noise);
    }
    Floor floor() override { return least; }
    double stop_error(const Settings& settings) override { return stopped * (1.0 - settings.opacity_stop) / 0.02; }
    double seconds(const Settings& settings) override {
        const double price = settings.sampling == Sampling::slab ? slab_price
                             : settings.second_order             ? second_price
                             : settings.preintegration           ? first_price
                                                                 : 1.0;
        return price / settings.slice_spacing;
    }
};

/// The least time over a fine grid of all settings that keep an error.
double best_by_sweep(Formula& judge, double most) {
    double best = std::numeric_limits<double>::infinity();
    for (double ds = finest_spacing; ds <= coarsest_spacing; ds *= 1.01) {
        for (int kind = 0; kind < 4; ++kind) {
            for (const double left : {0.0, 1e-4, 1e-3, 1e-2, 2e-2}) {
                Settings settings;
                settings.slice_spacing = ds;
                settings.preintegration = kind == 1 || kind == 2;
                settings.second_order = kind == 2;
                settings.sampling = kind == 3 ? Sampling::slab : Sampling::point;
                settings.opacity_stop = 1.0 - left;
                const std::optional<double> error = judge.error(settings);
                if (error && *error <= most) {
                    best = std::min(best, judge.seconds(settings));
                }
            }
        }
    }
    return best;
}

TEST(Budget, PicksWhatCostsLittleMoreThanTheBestOfASweep) {
    std::set<std::string> kinds;
    for (const double most : {3e-2, 1e-2, 3e-3, 1e-3, 1e-4, 1e-5}) {
        for (const double stopped : {0.0, 1e-3}) {
            Formula judge;
            judge.stopped = stopped;
            const Choice choice = choose_settings(Settings{}, Freedom{}, {most, {}}, judge);
            kinds.insert(kind_of(choice.settings));
            EXPECT_LE(*judge.error(choice.settings), most);
            EXPECT_LE(judge.seconds(choice.settings), 1.35 * best_by_sweep(judge, most)) << most;
            EXPECT_DOUBLE_EQ(choice.seconds, judge.seconds(choice.settings));
        }
    }
    // One kind for all errors would be no choice.
    EXPECT_GE(kinds.size(), 3U);
}

TEST(Budget, StopIsSharpenedWhereItIsMostOfTheError) {
    Formula judge;
    judge.stopped = 5e-3;
    const Choice choice = choose_settings(Settings{}, Freedom{}, {1e-3, {}}, judge);
    EXPECT_GT(choice.settings.opacity_stop, 0.998);
    EXPECT_LE(judge.stop_error(choice.settings), 0.4e-3);
    // Where nothing is stopped, it stays.
    judge.stopped = 0.0;
    EXPECT_EQ(choose_settings(Settings{}, Freedom{}, {1e-3, {}}, judge).settings.opacity_stop, 0.98);
}

TEST(Budget, WhatIsFixedStays) {
    Formula judge;
    Settings start;
    start.slice_spacing = 0.5;
    start.opacity_stop = 0.9;
    start.preintegration = true;
    Freedom none{false, false, false, false};
    const Choice choice = choose_settings(start, none, {1e-2, {}}, judge);
    EXPECT_EQ(choice.settings.slice_spacing, 0.5);
    EXPECT_EQ(choice.settings.opacity_stop, 0.9);
    EXPECT_TRUE(choice.settings.preintegration);
    EXPECT_FALSE(choice.settings.second_order);
}

std::string refusal(const Settings& start, const Freedom& freedom, double most, Judge& judge, bool& invalid) {
    try {
        choose_settings(start, freedom, {most, {}}, judge);
    } catch (const InvalidInput& error) {
        invalid = true;
        return error.what();
    } catch (const Unsupported& error) {
        invalid = false;
        return error.what();
    }
    return "";
}

TEST(Budget, ContradictionsNameBothSides) {
    Formula judge;
    judge.stopped = 3e-2;
    bool invalid = false;
    Freedom fixed{false, true, true, true};
    Settings start;
    judge.stopped = 0.0;
    std::string text = refusal(start, fixed, 1e-5, judge, invalid);
    EXPECT_TRUE(invalid);
    EXPECT_NE(text.find("slice_spacing = 1"), std::string::npos) << text;
    EXPECT_NE(text.find("max_error = 1e-05"), std::string::npos) << text;

    judge.stopped = 3e-2;
    fixed = Freedom{true, true, true, false};
    text = refusal(start, fixed, 1e-3, judge, invalid);
    EXPECT_TRUE(invalid);
    EXPECT_NE(text.find("opacity_stop = 0.98"), std::string::npos) << text;
    EXPECT_NE(text.find("max_error = 0.001"), std::string::npos) << text;

    // Out of reach of all slice distances: 1e-3 ds and no other kind.
    judge.stopped = 0.0;
    text = refusal(start, Freedom{true, false, false, true}, 1e-6, judge, invalid);
    EXPECT_FALSE(invalid);
    EXPECT_NE(text.find("max_error = 1e-06"), std::string::npos) << text;
}

TEST(Budget, ATimeIsUsedForTheSmallestError) {
    for (const double most : {0.5, 2.0, 10.0, 100.0}) {
        Formula judge;
        const Choice choice = choose_settings(Settings{}, Freedom{}, {{}, most}, judge);
        EXPECT_TRUE(choice.seconds_kept);
        EXPECT_LE(judge.seconds(choice.settings), most);
        for (const bool second : {false, true}) {
            Settings other;
            other.preintegration = other.second_order = second;
            other.slice_spacing = std::min(coarsest_spacing, (second ? judge.second_price : 1.0) / most);
            if (judge.seconds(other) <= most) {
                EXPECT_LE(*judge.error(choice.settings), 1.02 * *judge.error(other)) << most;
            }
        }
    }
}

TEST(Budget, AStopDoesNotHideWhichKindIsTheBestInATime) {
    for (const double most : {1.0, 2.0, 5.0}) {
        Formula judge;
        judge.stopped = judge.point / most;
        judge.opposed = true;
        const Choice choice = choose_settings(Settings{}, Freedom{}, {{}, most}, judge);
        double least = std::numeric_limits<double>::infinity();
        for (const bool second : {false, true}) {
            Settings other;
            other.opacity_stop = 1.0;
            other.preintegration = other.second_order = second;
            other.slice_spacing = (second ? judge.second_price : 1.0) / most;
            least = std::min(least, *judge.error(other));
        }
        EXPECT_LE(choice.error, 1.1 * least) << most;
        EXPECT_LE(judge.stop_error(choice.settings), 0.5 * least) << most;
        EXPECT_NE(kind_of(choice.settings), "point sampling") << most;
    }
}

TEST(Budget, KindsThatNeverWinCostOneLookEach) {
    Formula judge;
    judge.first = judge.second = judge.slab = 1e3;
    Freedom only_spacing;
    only_spacing.preintegration = only_spacing.sampling = false;
    const Choice alone = choose_settings(Settings{}, only_spacing, {3e-4, {}}, judge);
    const int looks = std::exchange(judge.looks, 0);
    const Choice choice = choose_settings(Settings{}, Freedom{}, {3e-4, {}}, judge);
    EXPECT_EQ(kind_of(choice.settings), "point sampling");
    EXPECT_EQ(choice.settings.slice_spacing, alone.settings.slice_spacing);
    EXPECT_LE(judge.looks, looks + 3);
}

TEST(Budget, WhatIsOutOfReachIsSeenEarly) {
    const auto looks = [](double most, double noise, double floor) {
        Formula judge;
        judge.noise = noise;
        judge.least = {floor, "the error of shadows", "use another backend"};
        bool invalid = true;
        const std::string text = refusal(Settings{}, Freedom{}, most, judge, invalid);
        EXPECT_FALSE(invalid);
        EXPECT_EQ(text.find("the error of shadows = ") != std::string::npos, floor > most) << text;
        EXPECT_EQ(text.find("use another backend") != std::string::npos, floor > most) << text;
        return judge.looks;
    };
    // All halvings of all four kinds would be 36.
    EXPECT_LE(looks(1e-13, 0.0, 0.0), 20);
    EXPECT_LE(looks(1e-7, 1e-4, 0.0), 26);
    EXPECT_EQ(looks(1e-3, 0.0, 2e-3), 0);
    // What is hard to reach, but can be, is reached.
    Formula judge;
    EXPECT_LE(choose_settings(Settings{}, Freedom{}, {1e-9, {}}, judge).error, 1e-9);
}

TEST(Budget, WhatIsKeptWithoutTheMarginIsTaken) {
    Formula judge;
    judge.noise = 0.9e-3;
    const Choice choice = choose_settings({}, {}, {1e-3, {}}, judge);
    EXPECT_LE(choice.error, 1e-3);
    EXPECT_GT(choice.error, 0.85e-3);
    EXPECT_TRUE(choice.error_kept);
    judge.noise = 1.1e-3;
    EXPECT_THROW(choose_settings({}, {}, {1e-3, {}}, judge), Unsupported);
}

TEST(Budget, ATimeTooShortGetsTheFastestAndSaysSo) {
    Formula judge;
    const Choice choice = choose_settings(Settings{}, Freedom{}, {{}, 0.01}, judge);
    EXPECT_FALSE(choice.seconds_kept);
    EXPECT_EQ(choice.settings.slice_spacing, coarsest_spacing);
    EXPECT_EQ(kind_of(choice.settings), "point sampling");
}

TEST(Budget, OfBothTheTimeIsKept) {
    Formula judge;
    const Choice both = choose_settings(Settings{}, Freedom{}, {1e-4, 1.0}, judge);
    EXPECT_LE(both.seconds, 1.0);
    EXPECT_FALSE(both.error_kept);
    const Choice easy = choose_settings(Settings{}, Freedom{}, {1e-2, 100.0}, judge);
    EXPECT_TRUE(easy.error_kept && easy.seconds_kept);
    // An error that is kept is not bettered for time that is left.
    EXPECT_LT(easy.seconds, 10.0);
    // Out of reach, but for as long as there is time the best is made of it.
    judge.has_second = false;
    const Choice never = choose_settings(Settings{}, Freedom{true, false, false, true}, {1e-6, 5.0}, judge);
    EXPECT_FALSE(never.error_kept);
    EXPECT_TRUE(never.seconds_kept);
}

TEST(Budget, KindsThatASceneCannotHaveAreLeftOut) {
    Formula judge;
    judge.has_second = false;
    const Choice choice = choose_settings(Settings{}, Freedom{}, {1e-4, {}}, judge);
    EXPECT_FALSE(choice.settings.second_order);
    for (const std::string& kind : choice.looked_at) {
        EXPECT_EQ(kind.find("second"), std::string::npos);
    }
}

// A renderer's promises

Scene scene_of(const std::shared_ptr<const Field>& field, bool lit) {
    Scene scene{
        {field},
        TransferFunction({{0.1, Vec3(0.1, 0.2, 0.6), 0.0}, {0.6, Vec3(0.9, 0.6, 0.2), 0.5}, {1.0, Vec3(1.0), 0.8}})};
    if (lit) {
        scene.lights.push_back({Vec3(0.4, 0.6, 1.0), Vec3(1.0), LightSpace::eye});
    }
    return scene;
}

Camera camera_of(const Field& field, double turn = 0.0) {
    return Camera::fit(field.supports_world(), Vec3(-0.5 + turn, -0.4, -0.8), Vec3(0.0, 1.0, 0.0));
}

RendererOptions asking(double error) {
    RendererOptions options;
    options.backend = Backend::cpu;
    options.max_error = error;
    return options;
}

TEST(MaxError, IsKept) {
    const auto field = bumps();
    const Camera camera = camera_of(*field);
    const Size size{72, 64};
    for (const bool lit : {false, true}) {
        Scene converged = scene_of(field, lit);
        converged.reference_length = converged.default_slice_spacing();
        converged.slice_spacing = converged.default_slice_spacing() / 256.0;
        converged.preintegration = true;
        converged.opacity_stop = 1.0;
        RendererOptions exact;
        exact.backend = Backend::cpu;
        exact.precision = Precision::float64;
        const Image reference = Renderer(exact).render(converged, camera, size);
        double before = 0.0;
        for (const double error : {1e-2, 1e-3, 1e-4}) {
            Renderer renderer(asking(error));
            const Scene scene = scene_of(field, lit);
            const Image image = renderer.render(scene, camera, size);
            const double found = compare(image.rgba, reference.rgba, 4).rmse;
            RecordProperty("rmse", std::to_string(found));
            EXPECT_LE(found, error);
            // Not by far better, which would be dear.
            EXPECT_GE(found, 0.2 * error);
            ASSERT_TRUE(image.settings);
            EXPECT_TRUE(image.plan->has("settings for max_error"));
            EXPECT_GT(image.stats.at("slices"), before);
            before = image.stats.at("slices");
            // The plan says the same without drawing all of it.
            const RenderPlan plan = renderer.plan(scene, camera, size);
            EXPECT_EQ(plan.slice_spacing, image.plan->slice_spacing);
            EXPECT_EQ(plan.effects.back().reason, image.plan->effects.back().reason);
        }
    }
}

TEST(MaxError, ChoicesServeNeighbouringViews) {
    const auto field = bumps();
    Renderer renderer(asking(2e-3));
    const Scene scene = scene_of(field, true);
    const Size size{64, 64};
    const Image first = renderer.render(scene, camera_of(*field), size);
    const Image next = renderer.render(scene, camera_of(*field, 0.02), size);
    EXPECT_EQ(first.plan->slice_spacing, next.plan->slice_spacing);
    // Another scene, another choice.
    Scene other = scene;
    other.transfer_function = TransferFunction({{0.1, Vec3(1.0), 0.0}, {1.0, Vec3(1.0), 0.02}});
    EXPECT_GT(renderer.render(other, camera_of(*field), size).plan->slice_spacing, first.plan->slice_spacing);
    // The same again from scratch: nothing depends on what came before, or on a clock.
    Renderer fresh(asking(2e-3));
    EXPECT_EQ(fresh.render(scene, camera_of(*field), size).rgba, first.rgba);
}

TEST(MaxError, WhatTheSceneGivesStays) {
    const auto field = bumps();
    Scene scene = scene_of(field, false);
    scene.slice_spacing = 0.25;
    scene.sampling = Sampling::slab;
    scene.preintegration = true;
    Renderer renderer(asking(2e-2));
    const Image image = renderer.render(scene, camera_of(*field), {48, 48});
    EXPECT_EQ(image.plan->slice_spacing, 0.25);
    EXPECT_EQ(image.settings->sampling, Sampling::slab);
    EXPECT_TRUE(image.settings->preintegration);
    scene.slice_spacing = 3.0;
    EXPECT_THROW((void)Renderer(asking(1e-4)).plan(scene, camera_of(*field), {48, 48}), InvalidInput);
}

TEST(MaxError, CountsShadowsFromVolumes) {
    const auto field = bumps();
    Scene scene = scene_of(field, true);
    const Camera camera = camera_of(*field);
    const Size size{24, 24};
    // Steep, so that grids follow it less well than slices.
    scene.transfer_function = TransferFunction({{0.3, Vec3(1.0, 0.5, 0.2), 0.0}, {0.4, Vec3(1.0), 0.9}});
    Scene shadowed = scene;
    shadowed.shadows = true;
    // An error that leaves room for them.
    Renderer loose(asking(0.05));
    const Image image = loose.render(shadowed, camera, size);
    double shadows = 0.0;
    for (const ErrorShare& share : image.plan->error_budget) {
        shadows = share.effect == "shadows" ? share.rmse : shadows;
    }
    EXPECT_GT(shadows, 1e-3);
    EXPECT_GE(image.stats.at("estimated_rmse"), shadows);
    const double less = 0.5 * shadows;
    EXPECT_NO_THROW((void)Renderer(asking(less)).plan(scene, camera, size));
    try {
        (void)Renderer(asking(less)).plan(shadowed, camera, size);
        FAIL() << "shadows from volumes are further off than that";
    } catch (const Unsupported& error) {
        const std::string text = error.what();
        EXPECT_NE(text.find("shadows"), std::string::npos) << text;
        EXPECT_NE(text.find("backend = reference"), std::string::npos) << text;
    }
    RendererOptions exact = asking(less);
    exact.backend = Backend::reference;
    EXPECT_NO_THROW((void)Renderer(exact).plan(shadowed, camera, size));
}

TEST(MaxError, ThePlanSaysWhatWasChosenAndWhatAskedFor) {
    const auto field = bumps();
    const Camera camera = camera_of(*field);
    const auto reason = [&](const Scene& scene, const char* name) {
        for (const Effect& effect : Renderer(asking(1e-3)).plan(scene, camera, {48, 48}).effects) {
            if (effect.name == name) {
                return effect.reason;
            }
        }
        return std::string();
    };
    Scene scene = scene_of(field, false);
    // Steps are what pre-integration is for.
    scene.transfer_function = TransferFunction({{0.3, Vec3(1.0), 0.0}, {0.3, Vec3(1.0, 0.5, 0.2), 0.4}});
    EXPECT_EQ(reason(scene, "preintegration"), "chosen for max_error");
    scene.preintegration = true;
    EXPECT_EQ(reason(scene, "preintegration"), "asked for");
    // Its error is from another picture than those of the other rows.
    EXPECT_EQ(Renderer(asking(1e-3)).plan(scene, camera, {48, 48}).effects.back().error, 0.0);
}

TEST(MaxError, NumbersWithoutMeaningAreRefused) {
    const double nan = std::numeric_limits<double>::quiet_NaN(), infinite = std::numeric_limits<double>::infinity();
    for (const double wrong : {0.0, -1.0, nan, infinite, 1e-9}) {
        EXPECT_THROW(Renderer{asking(wrong)}, InvalidInput) << wrong;
    }
    EXPECT_NO_THROW(Renderer{asking(least_max_error)});
    for (const double wrong : {0.0, -1.0, nan, infinite}) {
        RendererOptions options;
        options.max_seconds = wrong;
        EXPECT_THROW(Renderer{options}, InvalidInput) << wrong;
    }
}

TEST(MaxSeconds, TooShortATimeGetsAPictureAndAWord) {
    const auto field = bumps();
    RendererOptions options;
    options.backend = Backend::cpu;
    options.max_seconds = 1e-12;
    Renderer renderer(options);
    const Image image = renderer.render(scene_of(field, false), camera_of(*field), {48, 48});
    EXPECT_EQ(image.stats.at("max_seconds_kept"), 0.0);
    EXPECT_NE(image.plan->effects.back().reason.find("is not kept"), std::string::npos);
    options.max_seconds = 1e6;
    Renderer patient(options);
    const Image fine = patient.render(scene_of(field, false), camera_of(*field), {24, 24});
    EXPECT_EQ(fine.stats.at("max_seconds_kept"), 1.0);
    EXPECT_GT(fine.stats.at("slices"), 20.0 * image.stats.at("slices"));
}

} // namespace
} // namespace sheetsplat

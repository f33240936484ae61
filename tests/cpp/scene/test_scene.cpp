#include <gtest/gtest.h>

#include <algorithm>
#include <functional>
#include <limits>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "sheetsplat/camera.hpp"
#include "sheetsplat/error.hpp"
#include "sheetsplat/scene.hpp"
#include "support.hpp"
#include "support/lattices.hpp"

namespace sheetsplat {
namespace {

using test::expect_parts;
using test::message_of;

constexpr double infinity = std::numeric_limits<double>::infinity();
constexpr double nan = std::numeric_limits<double>::quiet_NaN();

std::shared_ptr<const RegularField> field_at(const Vec3& origin, const Vec3& spacing) {
    RegularFieldOptions options = test::zero_boundary();
    options.origin = origin;
    options.spacing = spacing;
    return std::make_shared<RegularField>(std::vector<float>(8, 1.0F), std::array<std::size_t, 3>{2, 2, 2}, options);
}

std::shared_ptr<const RegularField> field_of_nothing() {
    RegularFieldOptions options = test::zero_boundary();
    options.nan = NanPolicy::skip;
    return std::make_shared<RegularField>(std::vector<double>(1, nan), std::array<std::size_t, 3>{1, 1, 1}, options);
}

Scene good() {
    return Scene{{field_at(Vec3(0.0), Vec3(1.0))}, TransferFunction({{0.0, Vec3(0.0), 0.0}, {1.0, Vec3(1.0), 1.0}})};
}

std::string refused(const std::function<void(Scene&)>& change) {
    Scene scene = good();
    change(scene);
    return message_of<InvalidInput>([&] { scene.validate(); });
}

void accepted(const std::function<void(Scene&)>& change) {
    Scene scene = good();
    change(scene);
    EXPECT_NO_THROW(scene.validate());
}

TEST(Scene, distances_come_from_the_finest_field_unless_given) {
    Scene scene = good();
    scene.fields.push_back(field_at(Vec3(10.0, 0.0, -5.0), {2.0, 0.5, 3.0}));
    EXPECT_EQ(scene.default_slice_spacing(), 0.5);
    EXPECT_EQ(scene.slice_distance(), 0.5);
    EXPECT_EQ(scene.reference_distance(), 0.5);
    scene.slice_spacing = 0.125;
    EXPECT_EQ(scene.slice_distance(), 0.125);
    EXPECT_EQ(scene.reference_distance(), 0.5);
    scene.reference_length = 4.0;
    EXPECT_EQ(scene.reference_distance(), 4.0);
}

TEST(Scene, centres_are_those_of_all_fields) {
    Scene scene = good();
    scene.fields.push_back(field_at(Vec3(10.0, 0.0, -5.0), {2.0, 0.5, 3.0}));
    scene.fields.push_back(field_of_nothing());
    EXPECT_EQ(scene.centres_world().lower, Vec3(0.0, 0.0, -5.0));
    EXPECT_EQ(scene.centres_world().upper, Vec3(12.0, 1.0, 1.0));
    scene.fields = {field_of_nothing()};
    EXPECT_TRUE(scene.centres_world().empty());
    EXPECT_NO_THROW(scene.validate());
}

TEST(Scene, what_is_given_by_default_is_valid) { EXPECT_NO_THROW(good().validate()); }

TEST(Scene, clipping_has_a_meaning) {
    accepted([](Scene& s) { s.clip.planes = {{Vec3(0.0, 2.0, 0.0), -1.0}}; });
    accepted([](Scene& s) { s.clip.box = Box{Vec3(0.0), Vec3(0.0)}; });
    expect_parts(refused([](Scene& s) { s.clip.planes = {{}, {Vec3(0.0), 1.0}}; }), {"clip", "plane 1"});
    expect_parts(refused([](Scene& s) { s.clip.planes = {{Vec3(nan, 0.0, 1.0), 1.0}}; }), {"clip", "NaN"});
    expect_parts(refused([](Scene& s) { s.clip.planes = {{Vec3(1.0), infinity}}; }), {"clip", "offset"});
    expect_parts(refused([](Scene& s) {
                     s.clip.box = Box{Vec3(1.0, 0.0, 0.0), Vec3(0.0, 1.0, 1.0)};
                 }),
                 {"clip", "lower one first"});
    EXPECT_TRUE(good().clip.empty());
    Clip clip;
    clip.box = Box{Vec3(1.0, 2.0, 3.0), Vec3(4.0, 5.0, 6.0)};
    clip.planes = {{Vec3(1.0), 2.0}};
    EXPECT_FALSE(clip.empty());
    const std::vector<Clip::Plane> planes = clip.half_spaces();
    ASSERT_EQ(planes.size(), 7U);
    const auto inside = [&](const Vec3& point) {
        return std::all_of(planes.begin(), planes.end(), [&](const Clip::Plane& plane) {
            return plane.normal.x * point.x + plane.normal.y * point.y + plane.normal.z * point.z >= plane.offset;
        });
    };
    EXPECT_TRUE(inside(Vec3(1.0, 2.0, 3.0)));
    EXPECT_TRUE(inside(Vec3(4.0, 5.0, 6.0)));
    for (int axis = 0; axis < 3; ++axis) {
        Vec3 below(2.0, 3.0, 4.0), above = below;
        below[axis] = clip.box->box.lower[axis] - 1e-9;
        above[axis] = clip.box->box.upper[axis] + 1e-9;
        EXPECT_FALSE(inside(below));
        EXPECT_FALSE(inside(above));
    }
}

TEST(Scene, faces_of_a_clip_box_at_infinity_cut_nothing) {
    const Clip open{{}, Box{Vec3(-infinity, 0.0, -infinity), Vec3(infinity, 1.0, 2.0)}};
    EXPECT_EQ(open.half_spaces().size(), 3u);
}

TEST(Scene, depth_limits_are_depths_of_a_picture) {
    const DepthLimit limit({2, 1}, {3.0, infinity});
    EXPECT_EQ(limit.at(0, 0), 3.0);
    EXPECT_EQ(limit.at(1, 0), infinity);
    EXPECT_EQ(limit.nearest(), 3.0);
    EXPECT_EQ(limit.farthest(), infinity);
    const auto made = [](Size size, std::vector<double> depths) {
        return message_of<InvalidInput>([&] { (void)DepthLimit(size, std::move(depths)); });
    };
    expect_parts(made({2, 2}, {1.0}), {"depth_limit", "1 depth for 2 x 2 pixels"});
    expect_parts(made({0, 0}, {}), {"depth_limit", "0 x 0"});
    expect_parts(made({1, 1}, {nan}), {"depth_limit", "NaN"});
    expect_parts(made({1, 1}, {-infinity}), {"depth_limit", "-infinity"});

    const Camera across = Camera::orthographic({0, 0, 5}, {0, 0, 0}, {0, 1, 0}, 1.0);
    const Camera near = Camera::perspective({0, 0, 5}, {0, 0, 0}, {0, 1, 0}, 30.0);
    const DepthLimit behind({1, 1}, {-1.0});
    EXPECT_NO_THROW(behind.require_for({1, 1}, across));
    EXPECT_NO_THROW(limit.require_for({2, 1}, near));
    expect_parts(message_of<InvalidInput>([&] { behind.require_for({1, 1}, near); }), {"depth -1", "perspective"});
    expect_parts(message_of<InvalidInput>([&] { limit.require_for({1, 2}, across); }), {"2 x 1", "1 x 2"});
}

TEST(Scene, numbers_of_effects_have_a_meaning) {
    for (const double bad : {0.0, -1.0, nan, infinity}) {
        expect_parts(refused([&](Scene& s) { s.gradient_opacity = bad; }), {"gradient_opacity", "above 0"});
        expect_parts(refused([&](Scene& s) {
                         s.ambient_occlusion = AmbientOcclusion{bad, 1.0};
                     }),
                     {"ambient_occlusion", "radius"});
    }
    for (const double bad : {-0.1, 1.1, nan}) {
        expect_parts(refused([&](Scene& s) { s.ambient_occlusion = AmbientOcclusion{1.0, bad}; }), {"strength"});
        expect_parts(refused([&](Scene& s) { s.depth_cue = DepthCue{0.0, 1.0, Vec3(0.0), bad}; }), {"strength"});
    }
    expect_parts(refused([](Scene& s) { s.depth_cue = DepthCue{2.0, 2.0, Vec3(0.0), 1.0}; }), {"nearer one first"});
    expect_parts(refused([](Scene& s) { s.depth_cue = DepthCue{0.0, infinity, Vec3(0.0), 1.0}; }), {"depth_cue"});
    expect_parts(refused([](Scene& s) { s.depth_cue = DepthCue{0.0, 1.0, Vec3(nan), 1.0}; }), {"colour"});
}

TEST(Scene, effects_that_contradict_name_both_sides) {
    const auto in_mode = [](Mode mode, const std::function<void(Scene&)>& change) {
        return refused([&](Scene& s) {
            s.mode = mode;
            s.iso_values = {0.5};
            change(s);
        });
    };
    const std::function<void(Scene&)> cue = [](Scene& s) { s.depth_cue = DepthCue{}; };
    const std::function<void(Scene&)> shadows = [](Scene& s) { s.shadows = true; };
    const std::function<void(Scene&)> occlusion = [](Scene& s) { s.ambient_occlusion = AmbientOcclusion{}; };
    const std::function<void(Scene&)> opacity = [](Scene& s) { s.gradient_opacity = 2.0; };
    for (const auto& [mode, name] : {std::pair{Mode::xray, "mode = xray"},
                                     {Mode::mip, "mode = mip"},
                                     {Mode::minimum, "mode = minimum"},
                                     {Mode::average, "mode = average"}}) {
        expect_parts(in_mode(mode, cue), {"depth_cue", name});
        expect_parts(in_mode(mode, shadows), {"shadows = true", name});
        expect_parts(in_mode(mode, occlusion), {"ambient_occlusion", name});
        expect_parts(in_mode(mode, opacity), {"gradient_opacity = 2", name});
    }
    expect_parts(in_mode(Mode::isosurface, opacity), {"gradient_opacity = 2", "mode = isosurface"});
    for (const auto& change : {cue, shadows, occlusion}) {
        accepted([&](Scene& s) {
            s.mode = Mode::isosurface;
            s.iso_values = {0.5};
            change(s);
        });
        accepted(change);
    }
    accepted(opacity);
    expect_parts(refused([&](Scene& s) {
                     shadows(s);
                     opacity(s);
                 }),
                 {"shadows = true", "gradient_opacity = 2"});
    expect_parts(refused([&](Scene& s) {
                     occlusion(s);
                     opacity(s);
                 }),
                 {"ambient_occlusion", "gradient_opacity = 2"});
    expect_parts(refused([](Scene& s) { s.second_order = true; }),
                 {"second_order without pre-integration", "pass preintegration = true"});
    accepted([](Scene& s) { s.second_order = s.preintegration = true; });
    // Effects that change nothing are no mistake.
    accepted([](Scene& s) {
        s.gradient = Gradient::analytic;
        s.mode = Mode::xray;
    });
}

TEST(Scene, needs_fields) {
    expect_parts(refused([](Scene& s) { s.fields.clear(); }), {"nothing to draw", "at least one field"});
    expect_parts(refused([](Scene& s) { s.fields.push_back(nullptr); }), {"field 1"});
    Scene scene = good();
    scene.fields.clear();
    EXPECT_THROW((void)scene.default_slice_spacing(), InvalidInput);
    EXPECT_THROW((void)scene.centres_world(), InvalidInput);
}

TEST(Scene, lengths_are_finite_and_above_0) {
    for (const double bad : {0.0, -1.0, nan, infinity}) {
        expect_parts(refused([=](Scene& s) { s.slice_spacing = bad; }), {"slice_spacing cannot be used", "above 0"});
        expect_parts(refused([=](Scene& s) { s.reference_length = bad; }),
                     {"reference_length cannot be used", "above 0"});
    }
    accepted([](Scene& s) { s.slice_spacing = 1e-300; });
}

TEST(Scene, an_isosurface_needs_its_value) {
    expect_parts(refused([](Scene& s) { s.mode = Mode::isosurface; }), {"mode = isosurface", "no iso_value"});
    for (const double bad : {nan, infinity, -infinity}) {
        expect_parts(refused([=](Scene& s) {
                         s.mode = Mode::isosurface;
                         s.iso_values = {bad};
                     }),
                     {"iso_value cannot be used"});
    }
    accepted([](Scene& s) {
        s.mode = Mode::isosurface;
        s.iso_values = {-3.0};
    });
}

TEST(Scene, surfaces_have_values_and_opacities) {
    const auto surfaces = [](std::vector<IsoValue> values) {
        return [values = std::move(values)](Scene& s) {
            s.mode = Mode::isosurface;
            s.iso_values = values;
        };
    };
    accepted(surfaces({{0.2, 0.0}, {0.7, 1.0}, {0.7, 0.5}}));
    for (const double bad : {-0.1, 1.0000001, nan, infinity}) {
        expect_parts(refused(surfaces({0.25, {0.5, bad}})),
                     {"iso_value cannot be used", "opacity", "of the surface at 0.5", "from 0 to 1"});
    }
    expect_parts(refused(surfaces({0.25, infinity})), {"iso_value cannot be used", "found infinity"});
    EXPECT_EQ(IsoValue(0.5), (IsoValue{0.5, 1.0}));
    EXPECT_FALSE(IsoValue(0.5) == (IsoValue{0.5, 0.9}));
}

TEST(Scene, groups_follow_one_another) {
    Scene scene = good();
    const TransferFunction other({{2.0, Vec3(1.0), 0.5}, {3.0, Vec3(0.0), 0.0}});
    scene.fields.resize(4, scene.fields.front());
    EXPECT_EQ(scene.groups().size(), 1U);
    EXPECT_EQ(scene.groups().front().last, 4U);
    scene.later_groups = {{1, other}, {3, scene.transfer_function}};
    EXPECT_NO_THROW(scene.validate());
    const std::vector<Group> groups = scene.groups();
    ASSERT_EQ(groups.size(), 3U);
    EXPECT_EQ(groups[0].first, 0U);
    EXPECT_EQ(groups[0].last, 1U);
    EXPECT_EQ(groups[0].transfer_function, &scene.transfer_function);
    EXPECT_EQ(groups[1].first, 1U);
    EXPECT_EQ(groups[1].last, 3U);
    EXPECT_EQ(groups[1].transfer_function->v_min(), 2.0);
    EXPECT_EQ(groups[2].first, 3U);
    EXPECT_EQ(groups[2].last, 4U);
}

TEST(Scene, groups_have_fields) {
    const auto groups_from = [](std::vector<std::size_t> firsts) {
        return [firsts = std::move(firsts)](Scene& s) {
            s.fields.resize(3, s.fields.front());
            for (const std::size_t first : firsts) {
                s.later_groups.push_back({first, s.transfer_function});
            }
        };
    };
    accepted(groups_from({1, 2}));
    expect_parts(refused(groups_from({0})), {"divided into groups", "group 1 begins at field 0 of 3", "at least one"});
    expect_parts(refused(groups_from({1, 1})), {"group 2 begins at field 1 of 3, group 1 at field 1"});
    expect_parts(refused(groups_from({2, 1})), {"group 2 begins at field 1 of 3, group 1 at field 2"});
    expect_parts(refused(groups_from({3})), {"group 1 begins at field 3 of 3"});
}

TEST(Scene, second_order_needs_one_transfer_function) {
    const auto second_order = [](Scene& s) {
        s.preintegration = s.second_order = true;
        s.fields.push_back(s.fields.front());
    };
    accepted(second_order);
    expect_parts(refused([&](Scene& s) {
                     second_order(s);
                     s.later_groups.push_back({1, s.transfer_function});
                 }),
                 {"second order of pre-integration with 2 transfer functions", "preintegration = true"});
}

TEST(Scene, lights) {
    expect_parts(refused([](Scene& s) { s.lights = {Light{}, Light{Vec3(0.0)}}; }), {"direction (0, 0, 0) of light 1"});
    expect_parts(refused([](Scene& s) { s.lights = {Light{{0.0, nan, 1.0}}}; }), {"direction (0, NaN, 1) of light 0"});
    expect_parts(refused([](Scene& s) {
                     s.lights = {Light{{0.0, 0.0, 1.0}, {infinity, 0.0, 0.0}}};
                 }),
                 {"colour (infinity, 0, 0)"});
    accepted([](Scene& s) { s.lights = {Light{{0.0, 0.0, -1e-300}, {2.0, 0.0, 0.0}, LightSpace::world}}; });
}

TEST(Scene, material) {
    for (const double bad : {nan, infinity, -infinity}) {
        expect_parts(refused([=](Scene& s) { s.material.ambient = bad; }), {"ambient"});
        expect_parts(refused([=](Scene& s) { s.material.diffuse = bad; }), {"diffuse"});
        expect_parts(refused([=](Scene& s) { s.material.specular = bad; }), {"specular"});
        expect_parts(refused([=](Scene& s) { s.material.shininess = bad; }), {"shininess"});
    }
    expect_parts(refused([](Scene& s) { s.material.shininess = -1e-9; }), {"shininess -1e-09", "0 or more"});
    accepted([](Scene& s) { s.material = {0.0, 2.0, 1.0, 0.0, true}; });
}

TEST(Scene, opacity_stop) {
    for (const double bad : {0.0, -0.5, 1.0000001, nan, infinity}) {
        expect_parts(refused([=](Scene& s) { s.opacity_stop = bad; }),
                     {"opacity_stop cannot be used", "above 0 and not above 1"});
    }
    accepted([](Scene& s) { s.opacity_stop = 1.0; });
    accepted([](Scene& s) { s.opacity_stop = 1e-6; });
}

TEST(Scene, background) {
    expect_parts(refused([](Scene& s) { s.background = Vec3(0.0, 0.0, nan); }),
                 {"background cannot be used", "(0, 0, NaN)"});
    accepted([](Scene& s) { s.background = Vec3(1.0); });
}

TEST(Scene, preintegration_belongs_to_composite) {
    for (const auto& [mode, name] : {std::pair{Mode::isosurface, "isosurface"},
                                     {Mode::xray, "xray"},
                                     {Mode::mip, "mip"},
                                     {Mode::minimum, "minimum"},
                                     {Mode::average, "average"}}) {
        expect_parts(refused([mode = mode](Scene& s) {
                         s.mode = mode;
                         s.iso_values = {0.5};
                         s.preintegration = true;
                     }),
                     {std::string("preintegration = true with mode = ") + name,
                      "wanted preintegration only in mode = composite"});
    }
    accepted([](Scene& s) { s.preintegration = true; });
}

} // namespace
} // namespace sheetsplat

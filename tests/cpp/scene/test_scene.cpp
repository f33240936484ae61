#include <gtest/gtest.h>

#include <functional>
#include <limits>
#include <memory>
#include <string>
#include <vector>

#include "sheetsplat/error.hpp"
#include "sheetsplat/scene.hpp"
#include "support.hpp"

namespace sheetsplat {
namespace {

using test::expect_parts;
using test::message_of;

constexpr double infinity = std::numeric_limits<double>::infinity();
constexpr double nan = std::numeric_limits<double>::quiet_NaN();

std::shared_ptr<const RegularField> field_at(const Vec3& origin, const Vec3& spacing) {
    RegularFieldOptions options;
    options.origin = origin;
    options.spacing = spacing;
    return std::make_shared<RegularField>(std::vector<float>(8, 1.0F), std::array<std::size_t, 3>{2, 2, 2}, options);
}

std::shared_ptr<const RegularField> field_of_nothing() {
    RegularFieldOptions options;
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

TEST(Scene, needs_fields) {
    expect_parts(refused([](Scene& s) { s.fields.clear(); }), {"nothing to show", "at least one field"});
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
    expect_parts(refused([](Scene& s) { s.mode = Mode::isosurface; }), {"mode=\"isosurface\"", "no iso_value"});
    for (const double bad : {nan, infinity, -infinity}) {
        expect_parts(refused([=](Scene& s) {
                         s.mode = Mode::isosurface;
                         s.iso_value = bad;
                     }),
                     {"iso_value cannot be used"});
    }
    accepted([](Scene& s) {
        s.mode = Mode::isosurface;
        s.iso_value = -3.0;
    });
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
    for (const auto& [mode, name] :
         {std::pair{Mode::isosurface, "isosurface"}, {Mode::xray, "xray"}, {Mode::mip, "mip"}}) {
        expect_parts(refused([mode = mode](Scene& s) {
                         s.mode = mode;
                         s.iso_value = 0.5;
                         s.preintegration = true;
                     }),
                     {std::string("preintegration=true with mode=\"") + name + "\"",
                      "wanted preintegration only in mode=\"composite\""});
    }
    accepted([](Scene& s) { s.preintegration = true; });
}

} // namespace
} // namespace sheetsplat

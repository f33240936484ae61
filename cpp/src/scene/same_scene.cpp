#include "scene/same_scene.hpp"

#include <algorithm>
#include <vector>

namespace sheetsplat {

namespace {

template <class Value>
auto same(const Value& a, const Value& b) -> decltype(a == b) {
    return a == b;
}

// Structured bindings name every member: one that is added does not compile until it is compared here.

bool same(const Light& a, const Light& b) {
    const auto& [direction, color, space] = a;
    return direction == b.direction && color == b.color && space == b.space;
}

bool same(const Material& a, const Material& b) {
    const auto& [ambient, diffuse, specular, shininess, two_sided] = a;
    return ambient == b.ambient && diffuse == b.diffuse && specular == b.specular && shininess == b.shininess &&
           two_sided == b.two_sided;
}

bool same(const DepthCue& a, const DepthCue& b) {
    const auto& [start, end, color, strength] = a;
    return start == b.start && end == b.end && color == b.color && strength == b.strength;
}

bool same(const AmbientOcclusion& a, const AmbientOcclusion& b) {
    const auto& [radius, strength] = a;
    return radius == b.radius && strength == b.strength;
}

template <class Option>
bool same(const std::optional<Option>& a, const std::optional<Option>& b) {
    return a.has_value() == b.has_value() && (!a || same(*a, *b));
}

} // namespace

bool same(const std::vector<TransferPoint>& a, const std::vector<TransferPoint>& b) {
    return std::equal(a.begin(), a.end(), b.begin(), b.end(), [](const TransferPoint& one, const TransferPoint& other) {
        return one.value == other.value && one.color == other.color && one.opacity == other.opacity;
    });
}

bool same(const Clip& a, const Clip& b) {
    const std::vector<Clip::Plane> first = a.half_spaces(), second = b.half_spaces();
    return std::equal(first.begin(), first.end(), second.begin(), second.end(),
                      [](const Clip::Plane& one, const Clip::Plane& other) {
                          return one.normal == other.normal && one.offset == other.offset && one.center == other.center;
                      });
}

static bool same_groups(const std::vector<Scene::LaterGroup>& a, const std::vector<Scene::LaterGroup>& b) {
    return std::equal(a.begin(), a.end(), b.begin(), b.end(),
                      [](const Scene::LaterGroup& one, const Scene::LaterGroup& other) {
                          const auto& [first_field, transfer_function, use] = one;
                          return first_field == other.first_field && use == other.use &&
                                 same(transfer_function.points(), other.transfer_function.points());
                      });
}

static bool same(const std::vector<Light>& a, const std::vector<Light>& b) {
    return std::equal(a.begin(), a.end(), b.begin(), b.end(),
                      [](const Light& one, const Light& other) { return same(one, other); });
}

bool same(const Scene& a, const Scene& b) {
#define SHEETSPLAT_OPTION_NAME(type, name, ...) name,
    const auto& [fields, transfer_function, use, later_groups,
                 SHEETSPLAT_SCENE_OPTIONS(SHEETSPLAT_OPTION_NAME) depth_limit, counted, part] = a;
#undef SHEETSPLAT_OPTION_NAME
    // Not the limit's depths: they belong to one camera, and settings chosen for one view serve others near it.
    bool all = fields == b.fields && use == b.use && same(transfer_function.points(), b.transfer_function.points()) &&
               same_groups(later_groups, b.later_groups) && depth_limit.has_value() == b.depth_limit.has_value() &&
               !counted && !b.counted && !part && !b.part;
#define SHEETSPLAT_OPTION_SAME(type, name, ...) all = all && same(name, b.name);
    SHEETSPLAT_SCENE_OPTIONS(SHEETSPLAT_OPTION_SAME)
#undef SHEETSPLAT_OPTION_SAME
    return all;
}

} // namespace sheetsplat

#include "same_scene.hpp"

#include <algorithm>
#include <vector>

namespace sheetsplat {

namespace {

bool same(const Light& a, const Light& b) {
    return a.direction == b.direction && a.color == b.color && a.space == b.space;
}

bool same(const Material& a, const Material& b) {
    return a.ambient == b.ambient && a.diffuse == b.diffuse && a.specular == b.specular && a.shininess == b.shininess &&
           a.two_sided == b.two_sided;
}

bool same(const std::optional<DepthCue>& a, const std::optional<DepthCue>& b) {
    return a.has_value() == b.has_value() &&
           (!a || (a->start == b->start && a->end == b->end && a->color == b->color && a->strength == b->strength));
}

bool same(const std::optional<AmbientOcclusion>& a, const std::optional<AmbientOcclusion>& b) {
    return a.has_value() == b.has_value() && (!a || (a->radius == b->radius && a->strength == b->strength));
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
                          return one.normal == other.normal && one.offset == other.offset;
                      });
}

/// Fields, their groups and these groups' transfer functions.
static bool same_groups(const Scene& a, const Scene& b) {
    return a.fields == b.fields && same(a.transfer_function.points(), b.transfer_function.points()) &&
           std::equal(a.later_groups.begin(), a.later_groups.end(), b.later_groups.begin(), b.later_groups.end(),
                      [](const Scene::LaterGroup& one, const Scene::LaterGroup& other) {
                          return one.first_field == other.first_field &&
                                 same(one.transfer_function.points(), other.transfer_function.points());
                      });
}

bool same(const Scene& a, const Scene& b) {
    return same_groups(a, b) && a.slice_spacing == b.slice_spacing && a.sampling == b.sampling &&
           a.reference_length == b.reference_length && a.mode == b.mode && a.iso_values == b.iso_values &&
           std::equal(a.lights.begin(), a.lights.end(), b.lights.begin(), b.lights.end(),
                      [](const Light& one, const Light& other) { return same(one, other); }) &&
           same(a.material, b.material) && a.opacity_stop == b.opacity_stop && a.preintegration == b.preintegration &&
           a.second_order == b.second_order && a.filter == b.filter && a.gradient == b.gradient &&
           same(a.clip, b.clip) && a.gradient_opacity == b.gradient_opacity && same(a.depth_cue, b.depth_cue) &&
           a.depth_limit.has_value() == b.depth_limit.has_value() && a.shadows == b.shadows &&
           same(a.ambient_occlusion, b.ambient_occlusion) && a.background == b.background && !a.part && !b.part;
}

} // namespace sheetsplat

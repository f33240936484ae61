#include "sheetsplat/scene.hpp"

#include <algorithm>
#include <limits>
#include <string>
#include <utility>

#include <glm/common.hpp>
#include <glm/gtc/matrix_access.hpp>

#include "base/checks.hpp"
#include "base/unusable.hpp"
#include "scene/mode_rules.hpp"
#include "sheetsplat/error.hpp"

namespace sheetsplat {
namespace {

void require(bool holds, const Words& failed, const Words& found, const Words& wanted, const Words& advice = {}) {
    if (!holds) {
        throw InvalidInput(Complaint{"Scene: " + failed, found, wanted, advice});
    }
}

void require_fields(const std::vector<std::shared_ptr<const Field>>& fields) {
    require(!fields.empty(), "there is nothing to draw", "no field", "at least one field");
    for (std::size_t n = 0; n < fields.size(); ++n) {
        require(fields[n] != nullptr, "a field cannot be used", "nothing in place of field " + text_of_count(n),
                "a field");
    }
}

std::string name_of_group(std::size_t n) { return "group " + text_of_count(n); }

void require_groups(const Scene& scene) {
    std::size_t begins = 0;
    for (std::size_t n = 0; n < scene.later_groups.size(); ++n) {
        const std::size_t next = scene.later_groups[n].first_field;
        require(next > begins && next < scene.fields.size(), "its fields cannot be divided into groups",
                name_of_group(n + 1) + " begins at field " + text_of_count(next) + " of " +
                    text_of_count(scene.fields.size()) + ", " + name_of_group(n) + " at field " + text_of_count(begins),
                "groups of at least one field each, one after the other");
        begins = next;
    }
}

Words cannot_use(const char* option) { return option_ref(option) + " cannot be used"; }

void require_length(const std::optional<double>& length, const char* option) {
    if (length) {
        require(*length > 0.0 && is_finite(*length), cannot_use(option), text_of(*length),
                "a finite number of world units above 0", "leave it out to use the fields' own sample distance");
    }
}

void check_uses(const Scene& scene) {
    const std::vector<Group> groups = scene.groups();
    for (std::size_t n = 0; n < groups.size(); ++n) {
        const GroupRole role = groups[n].use.role;
        if (role == GroupRole::shown) {
            continue;
        }
        require(!is_scalar(scene.mode), "a group cannot be used",
                (role == GroupRole::colors ? "colours of another field" : "labels") + (" with " + Words()) +
                    option_ref("mode", name_of(scene.mode)),
                option_ref("mode", "composite") + " or " + option_ref("mode", "isosurface"));
        if (role == GroupRole::colors) {
            const bool colors_something =
                n > 0 && (groups[n - 1].use.role == GroupRole::shown || groups[n - 1].use.role == GroupRole::colors);
            require(colors_something, "a group cannot be used", "colours in " + name_of_group(n),
                    "the group that they belong to before it");
            const std::vector<TransferPoint>& points = groups[n].transfer_function->points();
            require(std::all_of(points.begin(), points.end(),
                                [](const TransferPoint& point) { return point.opacity == 1.0; }),
                    "a transfer function of colours cannot be used", "opacities other than 1", "1 at each point");
        } else {
            require(groups[n].last - groups[n].first == 1, "a group cannot be used",
                    text_of_count(groups[n].last - groups[n].first) + " fields of one label", "one");
        }
    }
}

void check_iso_values(const Scene& scene) {
    const std::vector<Group> groups = scene.groups();
    const bool needed = shows_surfaces(scene.mode) && std::any_of(groups.begin(), groups.end(), [](const Group& group) {
                            return group.use.role == GroupRole::shown;
                        });
    require(!needed || !scene.iso_values.empty(), option_ref("mode", "isosurface") + " needs a value",
            "no " + option_ref("iso_value"), "the value of the surface", "pass " + option_ref("iso_value", "..."));
    for (const IsoValue& iso : scene.iso_values) {
        require(is_finite(iso.value), cannot_use("iso_value"), text_of(iso.value), "a finite number");
        require(iso.opacity >= 0.0 && iso.opacity <= 1.0, cannot_use("iso_value"),
                "opacity " + text_of(iso.opacity) + " of the surface at " + text_of(iso.value), "a number from 0 to 1");
    }
}

void check_light(const Light& light, std::size_t n) {
    const std::string name = " of light " + text_of_count(n);
    require(is_finite(light.direction) && light.direction != Vec3(0.0), cannot_use("lights"),
            "direction " + text_of(light.direction) + name,
            "a finite direction other than (0, 0, 0), towards the light");
    require(is_finite(light.color), cannot_use("lights"), "colour " + text_of(light.color) + name,
            "three finite numbers");
}

void check_material(const Material& material) {
    const auto finite = [](double value, const char* name) {
        require(is_finite(value), cannot_use("material"), std::string(name) + " " + text_of(value), "a finite number");
    };
    finite(material.ambient, "ambient");
    finite(material.diffuse, "diffuse");
    finite(material.specular, "specular");
    finite(material.shininess, "shininess");
    require(material.shininess >= 0.0, cannot_use("material"), "shininess " + text_of(material.shininess), "0 or more");
}

void check_clip(const Clip& clip) {
    for (std::size_t n = 0; n < clip.planes.size(); ++n) {
        const Clip::Plane& plane = clip.planes[n];
        const std::string name = " of plane " + text_of_count(n);
        require(is_finite(plane.normal) && plane.normal != Vec3(0.0), cannot_use("clip"),
                "normal " + text_of(plane.normal) + name, "a finite normal other than (0, 0, 0)");
        require(is_finite(plane.offset), cannot_use("clip"), "offset " + text_of(plane.offset) + name,
                "a finite number");
    }
    if (clip.box) {
        const Box& box = clip.box->box;
        const bool right = is_finite(box.lower) && is_finite(box.upper) && box.lower.x <= box.upper.x &&
                           box.lower.y <= box.upper.y && box.lower.z <= box.upper.z;
        require(right, cannot_use("clip"), "a box from " + text_of(box.lower) + " to " + text_of(box.upper),
                "two finite corners, the lower one first");
    }
}

void check_depth_cue(const DepthCue& cue) {
    require(is_finite(cue.start) && is_finite(cue.end) && cue.start < cue.end, cannot_use("depth_cue"),
            "depths from " + text_of(cue.start) + " to " + text_of(cue.end), "two finite depths, the nearer one first");
    require(is_finite(cue.color), cannot_use("depth_cue"), "colour " + text_of(cue.color), "three finite numbers");
    require(cue.strength >= 0.0 && cue.strength <= 1.0, cannot_use("depth_cue"), "strength " + text_of(cue.strength),
            "a number from 0 to 1");
}

void check_occlusion(const AmbientOcclusion& occlusion) {
    require(occlusion.radius > 0.0 && is_finite(occlusion.radius), cannot_use("ambient_occlusion"),
            "radius " + text_of(occlusion.radius), "a finite number of world units above 0");
    require(occlusion.strength >= 0.0 && occlusion.strength <= 1.0, cannot_use("ambient_occlusion"),
            "strength " + text_of(occlusion.strength), "a number from 0 to 1");
}

constexpr const char* together = "two options cannot be used together";

void check_part(const Part& part) {
    const auto right = [](const Box& box) {
        return box.lower.x < box.upper.x && box.lower.y < box.upper.y && box.lower.z < box.upper.z;
    };
    require(right(part.cell.box), "a part cannot be drawn",
            "a cell from " + text_of(part.cell.box.lower) + " to " + text_of(part.cell.box.upper),
            "two corners, the lower one first");
    require(is_finite(part.centres.lower) && is_finite(part.centres.upper) && !part.centres.empty(),
            "a part cannot be drawn",
            "a box of centres from " + text_of(part.centres.lower) + " to " + text_of(part.centres.upper),
            "two finite corners, the lower one first");
    require(is_finite(part.depths[0]) && is_finite(part.depths[1]) && part.depths[0] <= part.depths[1],
            "a part cannot be drawn", "depths from " + text_of(part.depths[0]) + " to " + text_of(part.depths[1]),
            "two finite depths, the nearer one first");
}

// Whether an option is set, and its value in words where they are short.
bool is_set(bool on) { return on; }
bool is_set(double value) { return value != 0.0; }
template <class Value>
bool is_set(const std::optional<Value>& value) {
    return value.has_value();
}
template <class Value>
bool is_set(const Value&) {
    return false;
}
Words told(const char* name, bool) { return option_ref(name, "true"); }
Words told(const char* name, const std::optional<double>& value) {
    return option_ref(name, value ? text_of(*value) : std::string());
}
template <class Value>
Words told(const char* name, const Value&) {
    return option_ref(name);
}

// Effects that a mode cannot have, and pairs that contradict each other.
void check_effects(const Scene& scene) {
    for_each_option(scene, [&](const char* name, Applies applies, const auto& value) {
        const bool fits = applies == Applies::always || (applies == Applies::colors && !is_scalar(scene.mode)) ||
                          (applies == Applies::opacities && is_composited(scene.mode));
        const Words composite = option_ref("mode", "composite");
        const Words wanted =
            applies == Applies::opacities
                ? option_ref(name) + " only in " + composite + ", where opacities count"
                : "a picture of colours, which " + composite + " and " + option_ref("mode", "isosurface") + " make";
        require(fits || !is_set(value), together,
                told(name, value) + " with " + option_ref("mode", name_of(scene.mode)), wanted,
                applies == Applies::opacities ? "leave out " + option_ref(name) + " or use " + composite
                                              : Words("leave it out or use another mode"));
    });
    const Words opacity = told("gradient_opacity", scene.gradient_opacity);
    require(!scene.second_order || scene.preintegration, together, "second_order without pre-integration",
            "second order only with pre-integration", "pass " + option_ref("preintegration", "true"));
    require(!scene.second_order || scene.later_groups.empty(), together,
            "second order of pre-integration with " + text_of_count(scene.later_groups.size() + 1) +
                " transfer functions",
            "second order only where one transfer function classifies all fields",
            "pass " + option_ref("preintegration", "true") + ", or give all fields one transfer function");
    require(!scene.shadows || !scene.gradient_opacity, together, option_ref("shadows", "true") + " with " + opacity,
            "one of them: shadows are computed without gradients", "leave one out");
    require(!scene.ambient_occlusion || !scene.gradient_opacity, together,
            option_ref("ambient_occlusion") + " with " + opacity,
            "one of them: ambient occlusion is computed without gradients", "leave one out");
}

} // namespace

std::vector<Clip::Plane> Clip::half_spaces() const {
    std::vector<Plane> all = planes;
    if (box) {
        for (int axis = 0; axis < 3; ++axis) {
            const Vec3 normal = glm::row(box->to_box, axis);
            for (const Plane& face : {Plane{normal, box->box.lower[axis]}, Plane{-normal, -box->box.upper[axis]}}) {
                // A face at infinity cuts nothing.
                if (is_finite(face.offset)) {
                    all.push_back(face);
                }
            }
        }
    }
    return all;
}

std::vector<Group> Scene::groups() const {
    std::vector<Group> all{{0, fields.size(), &transfer_function, use}};
    for (const LaterGroup& later : later_groups) {
        all.back().last = later.first_field;
        all.push_back({later.first_field, fields.size(), &later.transfer_function, later.use});
    }
    return all;
}

bool adds_all_fields(const Scene& scene) {
    return is_scalar(scene.mode) && !(scene.counted && !scene.counted->ends.empty());
}

std::vector<Group> groups_drawn(const Scene& scene) {
    return adds_all_fields(scene) ? std::vector<Group>{{0, scene.fields.size(), &scene.transfer_function}}
                                  : scene.groups();
}

namespace {

/// What only gives colours does not say where slices lie.
bool places_slices(const Group& group) { return group.use.role != GroupRole::colors; }

} // namespace

std::vector<GroupRange> label_sets(const std::vector<Group>& groups) {
    std::vector<GroupRange> sets;
    for (std::size_t n = 0; n < groups.size(); ++n) {
        if (!is_label(groups[n])) {
            continue;
        }
        const bool goes_on = !sets.empty() && sets.back().last == n && groups[n - 1].use.set == groups[n].use.set;
        if (goes_on) {
            sets.back().last = n + 1;
        } else {
            sets.push_back({n, n + 1});
        }
    }
    return sets;
}

GroupRange colors_of(const std::vector<Group>& groups, std::size_t number) {
    GroupRange range{number + 1, number + 1};
    while (range.last < groups.size() && groups[range.last].use.role == GroupRole::colors) {
        ++range.last;
    }
    return range;
}

bool has_window_of_one_value(const Group& group) {
    return group.transfer_function->v_min() == group.transfer_function->v_max();
}

bool has_window_of_one_value(const Scene& scene) {
    const std::vector<Group> groups = groups_drawn(scene);
    return std::any_of(groups.begin(), groups.end(), [](const Group& group) { return has_window_of_one_value(group); });
}

std::vector<IsoValue> iso_values_of(const Scene& scene, std::size_t group) {
    const Group own = scene.groups()[group];
    if (own.use.role != GroupRole::shown) {
        // A label's surface lies where it is as large as the next one; colours and labels that are not shown have none.
        return own.use.role == GroupRole::label
                   ? std::vector<IsoValue>{{0.0, own.transfer_function->points().back().opacity}}
                   : std::vector<IsoValue>{};
    }
    std::vector<IsoValue> values = scene.iso_values;
    for (IsoValue& iso : values) {
        iso.value -= scene.counted ? scene.counted->bases[group] : 0.0;
    }
    return values;
}

double weakest_difference(const Scene& scene, const Group& group) {
    constexpr double share_of_window = 1e-3, windows_of_range = 4096.0;
    double range = 0.0;
    for (std::size_t field = group.first; field < group.last; ++field) {
        const std::array<double, 2> values = scene.fields[field]->value_range();
        range = std::max(range, values[1] - values[0]);
    }
    const double window = group.transfer_function->v_max() - group.transfer_function->v_min();
    return share_of_window * std::max(window, range / windows_of_range);
}

std::size_t group_drawn_of(const Scene& scene, std::size_t field) {
    if (adds_all_fields(scene)) {
        return 0;
    }
    const auto begins_behind = [field](const Scene::LaterGroup& group) { return group.first_field > field; };
    return static_cast<std::size_t>(std::find_if(scene.later_groups.begin(), scene.later_groups.end(), begins_behind) -
                                    scene.later_groups.begin());
}

namespace {

/// Says that depths cannot be used, unless a condition holds.
void require_depths(bool right, const std::string& found, const Words& wanted, const Words& advice = {}) {
    if (!right) {
        throw InvalidInput(Complaint{unusable("Renderer", "depth_limit"), found, wanted, advice, "depth_limit"});
    }
}

std::string name_of(Size size) { return std::to_string(size.width) + " x " + std::to_string(size.height) + " pixels"; }

} // namespace

DepthLimit::DepthLimit(Size size, std::vector<double> depths)
    : size_(size), nearest_(std::numeric_limits<double>::infinity()), farthest_(-nearest_) {
    require_depths(size.width > 0 && size.height > 0 &&
                       depths.size() == static_cast<std::size_t>(size.width) * static_cast<std::size_t>(size.height),
                   text_of_count(depths.size(), "depth") + " for " + name_of(size), "a depth for each pixel");
    for (const double depth : depths) {
        require_depths(depth > -std::numeric_limits<double>::infinity(), text_of(depth),
                       "depths in world units, and infinity where nothing is cut off");
        nearest_ = std::min(nearest_, depth);
        farthest_ = std::max(farthest_, depth);
    }
    depths_ = std::make_shared<const std::vector<double>>(std::move(depths));
}

void DepthLimit::require_for(Size picture, const Camera& camera) const {
    require_depths(picture.width == size_.width && picture.height == size_.height,
                   "depths of " + name_of(size_) + " for a picture of " + name_of(picture),
                   "a depth for each pixel of the picture", "draw the surface at the size of the picture");
    require_depths(camera.projection() == Projection::orthographic || nearest_ >= 0.0,
                   "the depth " + text_of(nearest_) + " with a perspective camera",
                   "depths of at least 0, and infinity where nothing is cut off",
                   "count depths from the eye along the view direction, away from the viewer");
}

double Scene::default_slice_spacing() const {
    require_fields(fields);
    std::optional<double> smallest;
    for (const Group& group : groups()) {
        for (std::size_t field = group.first; field < group.last && places_slices(group); ++field) {
            if (fields[field]->size() != 0) {
                const double own = fields[field]->default_slice_spacing();
                smallest = smallest ? std::min(*smallest, own) : own;
            }
        }
    }
    return smallest.value_or(1.0);
}

bool Part::cuts() const {
    const double infinity = std::numeric_limits<double>::infinity();
    return cell.box.lower != Vec3(-infinity) || cell.box.upper != Vec3(infinity);
}

Box Scene::centres_world() const {
    require_fields(fields);
    if (part) {
        return part->centres;
    }
    Box all;
    for (const Group& group : groups()) {
        for (std::size_t field = group.first; field < group.last && places_slices(group); ++field) {
            const Box box = fields[field]->centres_world();
            if (!box.empty()) {
                all = all.empty() ? box : Box{glm::min(all.lower, box.lower), glm::max(all.upper, box.upper)};
            }
        }
    }
    return all;
}

void Scene::validate() const {
    require_fields(fields);
    require_groups(*this);
    check_uses(*this);
    require_length(slice_spacing, "slice_spacing");
    require_length(reference_length, "reference_length");
    check_iso_values(*this);
    for (std::size_t n = 0; n < lights.size(); ++n) {
        check_light(lights[n], n);
    }
    check_material(material);
    require(opacity_stop > 0.0 && opacity_stop <= 1.0, cannot_use("opacity_stop"), text_of(opacity_stop),
            "a number above 0 and not above 1", "1 never stops early");
    if (background) {
        require(is_finite(*background), cannot_use("background"), text_of(*background), "three finite numbers");
    }
    check_clip(clip);
    if (gradient_opacity) {
        require(*gradient_opacity > 0.0 && is_finite(*gradient_opacity), cannot_use("gradient_opacity"),
                text_of(*gradient_opacity), "a finite gradient above 0, scalar per world unit");
    }
    if (depth_cue) {
        check_depth_cue(*depth_cue);
    }
    if (ambient_occlusion) {
        check_occlusion(*ambient_occlusion);
    }
    if (part) {
        check_part(*part);
    }
    check_effects(*this);
}

} // namespace sheetsplat

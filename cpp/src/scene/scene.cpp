#include "sheetsplat/scene.hpp"

#include <algorithm>
#include <string>

#include <glm/common.hpp>

#include "base/checks.hpp"
#include "sheetsplat/error.hpp"

namespace sheetsplat {
namespace {

const char* name_of(Mode mode) {
    switch (mode) {
    case Mode::composite:
        return "composite";
    case Mode::isosurface:
        return "isosurface";
    case Mode::xray:
        return "xray";
    case Mode::mip:
        return "mip";
    }
    return "unknown";
}

void require(bool holds, const char* failed, const std::string& found, const char* wanted, const char* next = "") {
    if (!holds) {
        throw InvalidInput(Complaint{std::string("Scene: ") + failed, found, wanted, next});
    }
}

void require_fields(const std::vector<std::shared_ptr<const Field>>& fields) {
    require(!fields.empty(), "there is nothing to show", "no field", "at least one field");
    for (std::size_t n = 0; n < fields.size(); ++n) {
        require(fields[n] != nullptr, "a field cannot be used", "nothing in place of field " + text_of_count(n),
                "a field");
    }
}

void require_length(const std::optional<double>& length, const char* failed) {
    if (length) {
        require(*length > 0.0 && is_finite(*length), failed, text_of(*length), "a finite number of world units above 0",
                "leave it out to use the fields' own sample distance");
    }
}

void check_light(const Light& light, std::size_t n) {
    const std::string name = " of light " + text_of_count(n);
    require(is_finite(light.direction) && light.direction != Vec3(0.0), "a light cannot be used",
            "direction " + text_of(light.direction) + name,
            "a finite direction other than (0, 0, 0), towards the light");
    require(is_finite(light.color), "a light cannot be used", "colour " + text_of(light.color) + name,
            "three finite numbers");
}

void check_material(const Material& material) {
    const auto finite = [](double value, const char* name) {
        require(is_finite(value), "the material cannot be used", std::string(name) + " " + text_of(value),
                "a finite number");
    };
    finite(material.ambient, "ambient");
    finite(material.diffuse, "diffuse");
    finite(material.specular, "specular");
    finite(material.shininess, "shininess");
    require(material.shininess >= 0.0, "the material cannot be used", "shininess " + text_of(material.shininess),
            "0 or more");
}

void check_clip(const Clip& clip) {
    for (std::size_t n = 0; n < clip.planes.size(); ++n) {
        const Clip::Plane& plane = clip.planes[n];
        const std::string name = " of plane " + text_of_count(n);
        require(is_finite(plane.normal) && plane.normal != Vec3(0.0), "clip cannot be used",
                "normal " + text_of(plane.normal) + name, "a finite normal other than (0, 0, 0)");
        require(is_finite(plane.offset), "clip cannot be used", "offset " + text_of(plane.offset) + name,
                "a finite number");
    }
    if (clip.box) {
        const Box& box = *clip.box;
        const bool right = is_finite(box.lower) && is_finite(box.upper) && box.lower.x <= box.upper.x &&
                           box.lower.y <= box.upper.y && box.lower.z <= box.upper.z;
        require(right, "clip cannot be used", "a box from " + text_of(box.lower) + " to " + text_of(box.upper),
                "two finite corners, the lower one first");
    }
}

void check_depth_cue(const DepthCue& cue) {
    require(is_finite(cue.start) && is_finite(cue.end) && cue.start < cue.end, "depth_cue cannot be used",
            "depths from " + text_of(cue.start) + " to " + text_of(cue.end), "two finite depths, the nearer one first");
    require(is_finite(cue.color), "depth_cue cannot be used", "colour " + text_of(cue.color), "three finite numbers");
    require(cue.strength >= 0.0 && cue.strength <= 1.0, "depth_cue cannot be used", "strength " + text_of(cue.strength),
            "a number from 0 to 1");
}

void check_occlusion(const AmbientOcclusion& occlusion) {
    require(occlusion.radius > 0.0 && is_finite(occlusion.radius), "ambient_occlusion cannot be used",
            "radius " + text_of(occlusion.radius), "a finite number of world units above 0");
    require(occlusion.strength >= 0.0 && occlusion.strength <= 1.0, "ambient_occlusion cannot be used",
            "strength " + text_of(occlusion.strength), "a number from 0 to 1");
}

// Effects that a mode cannot have, and pairs that contradict each other.
void check_effects(const Scene& scene) {
    const char* const together = "two options do not go together";
    const std::string in_mode = std::string(" with mode=\"") + name_of(scene.mode) + "\"";
    const bool scalar = scene.mode == Mode::xray || scene.mode == Mode::mip;
    const std::string opacity =
        scene.gradient_opacity ? "gradient_opacity=" + text_of(*scene.gradient_opacity) : std::string();
    const auto need_colors = [&](bool on, const std::string& name) {
        require(!(on && scalar), together, name + in_mode,
                "a picture of colours, which mode=\"composite\" and mode=\"isosurface\" make",
                "leave it out or use another mode");
    };
    require(!scene.gradient_opacity || scene.mode == Mode::composite, together, opacity + in_mode,
            "gradient_opacity only in mode=\"composite\", where opacities count",
            "leave gradient_opacity out or use mode=\"composite\"");
    need_colors(scene.depth_cue.has_value(), "depth_cue");
    need_colors(scene.shadows, "shadows=true");
    need_colors(scene.ambient_occlusion.has_value(), "ambient_occlusion");
    require(!scene.second_order || scene.preintegration, together, "second_order=true with preintegration=false",
            "second order only with pre-integration", "turn preintegration on");
    require(!scene.shadows || !scene.gradient_opacity, together, "shadows=true with " + opacity,
            "one of them: what lies between a point and its light is seen without gradients", "leave one out");
    require(!scene.ambient_occlusion || !scene.gradient_opacity, together, "ambient_occlusion with " + opacity,
            "one of them: what lies around a point is seen without gradients", "leave one out");
}

} // namespace

std::vector<Clip::Plane> Clip::half_spaces() const {
    std::vector<Plane> all = planes;
    if (box) {
        for (int axis = 0; axis < 3; ++axis) {
            Vec3 normal(0.0);
            normal[axis] = 1.0;
            all.push_back({normal, box->lower[axis]});
            all.push_back({-normal, -box->upper[axis]});
        }
    }
    return all;
}

double Scene::default_slice_spacing() const {
    require_fields(fields);
    std::optional<double> smallest;
    for (const auto& field : fields) {
        if (field->size() != 0) {
            const double own = field->default_slice_spacing();
            smallest = smallest ? std::min(*smallest, own) : own;
        }
    }
    return smallest.value_or(1.0);
}

Box Scene::centres_world() const {
    require_fields(fields);
    Box all;
    for (const auto& field : fields) {
        const Box box = field->centres_world();
        if (box.empty()) {
            continue;
        }
        all = all.empty() ? box : Box{glm::min(all.lower, box.lower), glm::max(all.upper, box.upper)};
    }
    return all;
}

void Scene::validate() const {
    require_fields(fields);
    require_length(slice_spacing, "slice_spacing cannot be used");
    require_length(reference_length, "reference_length cannot be used");
    require(mode != Mode::isosurface || iso_value.has_value(), "mode=\"isosurface\" does not know which surface",
            "no iso_value", "a finite iso_value", "pass iso_value");
    if (iso_value) {
        require(is_finite(*iso_value), "iso_value cannot be used", text_of(*iso_value), "a finite number");
    }
    for (std::size_t n = 0; n < lights.size(); ++n) {
        check_light(lights[n], n);
    }
    check_material(material);
    require(opacity_stop > 0.0 && opacity_stop <= 1.0, "opacity_stop cannot be used", text_of(opacity_stop),
            "a number above 0 and not above 1", "1 never stops early");
    if (background) {
        require(is_finite(*background), "background cannot be used", text_of(*background), "three finite numbers");
    }
    check_clip(clip);
    if (gradient_opacity) {
        require(*gradient_opacity > 0.0 && is_finite(*gradient_opacity), "gradient_opacity cannot be used",
                text_of(*gradient_opacity), "a finite gradient above 0, scalar per world unit");
    }
    if (depth_cue) {
        check_depth_cue(*depth_cue);
    }
    if (ambient_occlusion) {
        check_occlusion(*ambient_occlusion);
    }
    check_effects(*this);
    require(!preintegration || mode == Mode::composite, "two options do not go together",
            std::string("preintegration=true with mode=\"") + name_of(mode) + "\"",
            "preintegration only in mode=\"composite\"", "turn preintegration off or use mode=\"composite\"");
}

} // namespace sheetsplat

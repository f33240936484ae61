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

} // namespace

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
    require(!preintegration || mode == Mode::composite, "two options do not go together",
            std::string("preintegration=true with mode=\"") + name_of(mode) + "\"",
            "preintegration only in mode=\"composite\"", "turn preintegration off or use mode=\"composite\"");
}

} // namespace sheetsplat

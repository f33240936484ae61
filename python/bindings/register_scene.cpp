// What Python sees of scenes.
#include <memory>
#include <optional>
#include <tuple>
#include <vector>

#include <glm/matrix.hpp>

#include <pybind11/numpy.h>

#include "convert.hpp"
#include "registrars.hpp"
#include "sheetsplat/light_volume.hpp"
#include "sheetsplat/scene.hpp"

namespace py = pybind11;

namespace sheetsplat::bindings {
namespace {

const std::map<std::string, Sampling> samplings{{"point", Sampling::point}, {"slab", Sampling::slab}};
const std::map<std::string, Mode> modes = [] {
    std::map<std::string, Mode> all;
    for (const ModeTraits& mode : mode_table) {
        all.emplace(mode.name, mode.mode);
    }
    return all;
}();
const std::map<std::string, Filter> filters{{"none", Filter::none}, {"ewa", Filter::ewa}};
const std::map<std::string, Gradient> gradients{{"sheets", Gradient::sheets}, {"analytic", Gradient::analytic}};
const std::map<std::string, LightSpace> light_spaces{{"eye", LightSpace::eye}, {"world", LightSpace::world}};

Light make_light(const Triple& direction, const Triple& color, const std::string& space) {
    return {to_vec3(direction), to_vec3(color), from_name("space", space, light_spaces)};
}

Material make_material(double ambient, double diffuse, double specular, double shininess, bool two_sided) {
    return {ambient, diffuse, specular, shininess, two_sided};
}

using Planes = std::vector<std::pair<Triple, double>>;

/// facets: planes around a sphere and its middle.
Clip make_clip(const Planes& planes, const std::optional<std::pair<Triple, Triple>>& box,
               const std::optional<std::pair<Planes, Triple>>& facets) {
    Clip clip;
    for (const auto& [normal, offset] : planes) {
        clip.planes.push_back({to_vec3(normal), offset, {}});
    }
    for (const auto& [normal, offset] : facets ? facets->first : Planes{}) {
        clip.planes.push_back({to_vec3(normal), offset, to_vec3(facets->second)});
    }
    if (box) {
        clip.box = Box{to_vec3(box->first), to_vec3(box->second)};
    }
    return clip;
}

DepthCue make_depth_cue(double start, double end, const Triple& color, double strength) {
    return {start, end, to_vec3(color), strength};
}

AmbientOcclusion make_occlusion(double radius, double strength) { return {radius, strength}; }

const std::map<std::string, GroupRole> roles{{"shown", GroupRole::shown},
                                             {"colors", GroupRole::colors},
                                             {"label", GroupRole::label},
                                             {"compared", GroupRole::compared}};

// A group of fields, its transfer function, what it is for, and the number of its set of labels.
using OwnLook = std::tuple<std::vector<std::shared_ptr<Field>>, TransferFunction, std::string, std::size_t>;

// Members of a scene from values of Python.
template <class Value>
void read(const char*, py::handle value, Value& member) {
    member = value.cast<Value>();
}
void read(const char* name, py::handle value, Sampling& member) {
    member = from_name(name, value.cast<std::string>(), samplings);
}
void read(const char* name, py::handle value, Mode& member) {
    member = from_name(name, value.cast<std::string>(), modes);
}
void read(const char* name, py::handle value, Filter& member) {
    member = from_name(name, value.cast<std::string>(), filters);
}
void read(const char* name, py::handle value, Gradient& member) {
    member = from_name(name, value.cast<std::string>(), gradients);
}
void read(const char*, py::handle value, std::vector<IsoValue>& member) {
    for (const auto& [scalar, opacity] : value.cast<std::vector<std::pair<double, double>>>()) {
        member.emplace_back(scalar, opacity);
    }
}
void read(const char*, py::handle value, std::optional<Vec3>& member) {
    if (!value.is_none()) {
        member = to_vec3(value.cast<Triple>());
    }
}

/// options: of Scene, by name.
Scene make_scene(const std::vector<OwnLook>& groups, const py::kwargs& options) {
    Scene scene{{}, std::get<TransferFunction>(groups.at(0))};
    for (const auto& [fields, transfer_function, role, set] : groups) {
        const GroupUse use{from_name("role", role, roles), set};
        if (scene.fields.empty()) {
            scene.use = use;
        } else {
            scene.later_groups.push_back({scene.fields.size(), transfer_function, use});
        }
        scene.fields.insert(scene.fields.end(), fields.begin(), fields.end());
    }
    std::size_t known = 0;
    for_each_option(scene, [&](const char* name, Applies, auto& member) {
        if (options.contains(name)) {
            read(name, options[name], member);
            ++known;
        }
    });
    if (known != options.size()) {
        throw py::type_error("Scene: there is an option that it does not have");
    }
    scene.validate();
    return scene;
}

/// depths: (h, w).
Scene with_depth_limit(const Scene& scene,
                       const py::array_t<double, py::array::c_style | py::array::forcecast>& depths) {
    const py::buffer_info info = depths.request();
    const auto* first = static_cast<const double*>(info.ptr);
    const Size size{static_cast<int>(info.shape.at(1)), static_cast<int>(info.shape.at(0))};
    Scene limited = scene;
    limited.depth_limit = DepthLimit(size, std::vector<double>(first, first + info.size));
    return limited;
}

/// in_front: (h, w).
Scene with_part(const Scene& scene, const std::pair<Triple, Triple>& cell, const std::pair<Triple, Triple>& centres,
                const std::array<double, 2>& depths,
                const std::optional<py::array_t<float, py::array::c_style | py::array::forcecast>>& in_front,
                const std::optional<std::pair<Triple, Triple>>& supports,
                const std::optional<std::pair<Triple, Triple>>& domain, bool filled,
                const std::shared_ptr<LightVolumes>& light, const std::optional<std::array<Triple, 3>>& to_box) {
    Scene made = scene;
    Part& part = made.part.emplace();
    // Rows.
    const Mat3 matrix =
        to_box ? glm::transpose(Mat3(to_vec3((*to_box)[0]), to_vec3((*to_box)[1]), to_vec3((*to_box)[2]))) : Mat3(1.0);
    part.cell = {Box{to_vec3(cell.first), to_vec3(cell.second)}, matrix};
    part.centres = {to_vec3(centres.first), to_vec3(centres.second)};
    part.depths = depths;
    if (in_front) {
        part.in_front =
            std::make_shared<const std::vector<float>>(in_front->data(), in_front->data() + in_front->size());
    }
    if (supports) {
        part.supports = {to_vec3(supports->first), to_vec3(supports->second)};
    }
    if (domain) {
        part.domain.emplace(Box{to_vec3(domain->first), to_vec3(domain->second)}, matrix);
    }
    part.filled = filled;
    part.light = light;
    made.validate();
    return made;
}

py::list mode_traits() {
    py::list all;
    for (const ModeTraits& mode : mode_table) {
        all.append(py::dict(py::arg("name") = mode.name, py::arg("fold") = to_string(mode.fold),
                            py::arg("counts") = mode.counts, py::arg("mean") = mode.mean,
                            py::arg("integrates") = mode.integrates, py::arg("of_values") = mode.of_values,
                            py::arg("label") = mode.label, py::arg("meaning") = mode.meaning));
    }
    return all;
}

} // namespace

void register_scene(py::module_& module) {
    module.def("mode_traits", &mode_traits);
    py::class_<Light>(module, "Light")
        .def(py::init(&make_light), py::kw_only(), py::arg("direction"), py::arg("color"), py::arg("space"));
    py::class_<Material>(module, "Material")
        .def(py::init(&make_material), py::kw_only(), py::arg("ambient"), py::arg("diffuse"), py::arg("specular"),
             py::arg("shininess"), py::arg("two_sided"));
    py::class_<Clip>(module, "Clip")
        .def(py::init(&make_clip), py::kw_only(), py::arg("planes"), py::arg("box"), py::arg("facets"));
    py::class_<DepthCue>(module, "DepthCue")
        .def(py::init(&make_depth_cue), py::kw_only(), py::arg("start"), py::arg("end"), py::arg("color"),
             py::arg("strength"));
    py::class_<AmbientOcclusion>(module, "AmbientOcclusion")
        .def(py::init(&make_occlusion), py::kw_only(), py::arg("radius"), py::arg("strength"));
    py::class_<Scene>(module, "Scene")
        .def(py::init(&make_scene), py::arg("groups"))
        .def("with_depth_limit", &with_depth_limit, py::arg("depths"))
        .def("with_part", &with_part, py::kw_only(), py::arg("cell"), py::arg("centres"), py::arg("depths"),
             py::arg("in_front").none(true), py::arg("supports") = py::none(), py::arg("domain") = py::none(),
             py::arg("filled") = false, py::arg("light") = py::none(), py::arg("to_box") = py::none())
        .def_property_readonly("slice_distance", &Scene::slice_distance)
        .def_property_readonly("reference_distance", &Scene::reference_distance)
        .def_property_readonly("centres", [](const Scene& scene) { return to_corners(scene.centres_world()); });
}

} // namespace sheetsplat::bindings

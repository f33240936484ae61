// What Python sees of cameras.
#include <array>
#include <optional>

#include "convert.hpp"
#include "registrars.hpp"
#include "sheetsplat/camera.hpp"

namespace py = pybind11;

namespace sheetsplat::bindings {
namespace {

const std::map<std::string, Projection> projections{{"orthographic", Projection::orthographic},
                                                    {"perspective", Projection::perspective}};

Camera orthographic(const Triple& eye, const Triple& target, const Triple& up, double height) {
    return Camera::orthographic(to_vec3(eye), to_vec3(target), to_vec3(up), height);
}

Camera perspective(const Triple& eye, const Triple& target, const Triple& up, double fov_y, std::optional<double> near,
                   const std::array<double, 2>& shift) {
    return Camera::perspective(to_vec3(eye), to_vec3(target), to_vec3(up), fov_y, near, Vec2(shift[0], shift[1]));
}

Camera fit(const Triple& lower, const Triple& upper, const Triple& direction, const Triple& up, const std::string& kind,
           double margin, double fov_y) {
    return Camera::fit(Box{to_vec3(lower), to_vec3(upper)}, to_vec3(direction), to_vec3(up),
                       from_name("kind", kind, projections), margin, fov_y);
}

} // namespace

void register_camera(py::module_& module) {
    py::class_<Camera>(module, "Camera")
        .def_static("orthographic", &orthographic, py::arg("eye"), py::arg("target"), py::arg("up"), py::arg("height"))
        .def_static("perspective", &perspective, py::arg("eye"), py::arg("target"), py::arg("up"), py::arg("fov_y"),
                    py::arg("near"), py::arg("shift"))
        .def_static("fit", &fit, py::arg("lower"), py::arg("upper"), py::arg("direction"), py::arg("up"),
                    py::arg("kind"), py::arg("margin"), py::arg("fov_y"))
        .def_property_readonly("kind",
                               [](const Camera& camera) {
                                   return camera.projection() == Projection::orthographic ? "orthographic"
                                                                                          : "perspective";
                               })
        .def_property_readonly("eye", [](const Camera& camera) { return to_triple(camera.eye()); })
        .def_property_readonly("target", [](const Camera& camera) { return to_triple(camera.target()); })
        .def_property_readonly("up", [](const Camera& camera) { return to_triple(camera.up()); })
        .def_property_readonly("height", &Camera::height)
        .def_property_readonly("fov_y", &Camera::fov_y)
        .def_property_readonly("near", &Camera::near)
        .def_property_readonly("shift",
                               [](const Camera& camera) { return py::make_tuple(camera.shift().x, camera.shift().y); })
        .def(
            "to_eye",
            [](const Camera& camera, const Triple& point) { return to_triple(camera.to_eye(to_vec3(point))); },
            py::arg("point"))
        .def(
            "direction_to_eye",
            [](const Camera& camera, const Triple& direction) {
                return to_triple(camera.direction_to_eye(to_vec3(direction)));
            },
            py::arg("direction"));
}

} // namespace sheetsplat::bindings

// Each noun of the library is registered by one function of its own.
#pragma once

#include <pybind11/pybind11.h>

namespace sheetsplat::bindings {

void register_error();
void register_field(pybind11::module_& module);
void register_transfer_function(pybind11::module_& module);
void register_scene(pybind11::module_& module);
void register_camera(pybind11::module_& module);
void register_light(pybind11::module_& module);
void register_plan(pybind11::module_& module);
void register_image(pybind11::module_& module);
void register_renderer(pybind11::module_& module);
void register_descent(pybind11::module_& module);
void register_device(pybind11::module_& module);
void register_ellipsoid_fit(pybind11::module_& module);

} // namespace sheetsplat::bindings

// What Python sees of devices.
#include "convert.hpp"
#include "registrars.hpp"
#include "released.hpp"
#include "sheetsplat/device.hpp"

namespace py = pybind11;

namespace sheetsplat::bindings {

void register_device(py::module_& module) {
    py::class_<DeviceReport>(module, "DeviceReport")
        .def_readonly("backend", &DeviceReport::backend)
        .def_readonly("platform", &DeviceReport::platform)
        .def_readonly("available", &DeviceReport::available)
        .def_readonly("description", &DeviceReport::description)
        .def_readonly("extensions", &DeviceReport::extensions)
        .def_readonly("workarounds", &DeviceReport::workarounds);
    module.def("devices", &devices, py::call_guard<Released>());
}

} // namespace sheetsplat::bindings

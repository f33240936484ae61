#include "convert.hpp"
#include "registrars.hpp"
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
    module.def("devices", &devices, py::call_guard<py::gil_scoped_release>());
    module.def(
        "fill_test",
        [](std::size_t kernels, double diameter_px, int width, int height, int targets, int repeats) {
            Seconds seconds;
            {
                const py::gil_scoped_release release;
                seconds = fill_test(kernels, diameter_px, width, height, targets, repeats);
            }
            return py::make_tuple(seconds.wall, seconds.cpu);
        },
        py::arg("kernels"), py::arg("diameter_px"), py::arg("width"), py::arg("height"), py::arg("targets") = 1,
        py::arg("repeats") = 5);
}

} // namespace sheetsplat::bindings

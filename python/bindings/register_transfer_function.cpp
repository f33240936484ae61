// What Python sees of transfer functions.
#include <pybind11/numpy.h>

#include "convert.hpp"
#include "registrars.hpp"
#include "sheetsplat/transfer_function.hpp"

namespace py = pybind11;

namespace sheetsplat::bindings {
namespace {

using Rows = py::array_t<double, py::array::c_style>;

TransferFunction make_transfer_function(const Rows& rows) {
    if (rows.ndim() != 2 || rows.shape(1) != 5) {
        throw InvalidInput(Complaint{"TransferFunction: the points cannot be used", "an array of another shape",
                                     "rows of five numbers: value, r, g, b, opacity", ""});
    }
    const auto table = rows.unchecked<2>();
    std::vector<TransferPoint> points;
    points.reserve(static_cast<std::size_t>(table.shape(0)));
    for (py::ssize_t row = 0; row < table.shape(0); ++row) {
        points.push_back({table(row, 0), Vec3(table(row, 1), table(row, 2), table(row, 3)), table(row, 4)});
    }
    return TransferFunction(std::move(points));
}

void write_row(py::detail::unchecked_mutable_reference<double, 2>& table, py::ssize_t row, const TransferPoint& point) {
    table(row, 0) = point.value;
    table(row, 1) = point.color.x;
    table(row, 2) = point.color.y;
    table(row, 3) = point.color.z;
    table(row, 4) = point.opacity;
}

py::array_t<double> points_of(const TransferFunction& function) {
    const auto& points = function.points();
    py::array_t<double> rows({static_cast<py::ssize_t>(points.size()), py::ssize_t{5}});
    auto table = rows.mutable_unchecked<2>();
    for (std::size_t row = 0; row < points.size(); ++row) {
        write_row(table, static_cast<py::ssize_t>(row), points[row]);
    }
    return rows;
}

py::array_t<double> at(const TransferFunction& function, const Rows& values) {
    if (values.ndim() != 1) {
        throw InvalidInput(Complaint{"TransferFunction: the values cannot be used", "an array of several axes",
                                     "one axis of numbers", ""});
    }
    const auto list = values.unchecked<1>();
    py::array_t<double> rows({list.shape(0), py::ssize_t{5}});
    auto table = rows.mutable_unchecked<2>();
    for (py::ssize_t row = 0; row < list.shape(0); ++row) {
        write_row(table, row, function.at(list(row)));
    }
    return rows;
}

} // namespace

void register_transfer_function(py::module_& module) {
    py::class_<TransferFunction>(module, "TransferFunction")
        .def(py::init(&make_transfer_function), py::arg("points"))
        .def_property_readonly("points", &points_of)
        .def_property_readonly("v_min", &TransferFunction::v_min)
        .def_property_readonly("v_max", &TransferFunction::v_max)
        .def_property_readonly("max_opacity", &TransferFunction::max_opacity)
        .def_property_readonly("has_steps", &TransferFunction::has_steps)
        .def_property_readonly("steepest", &TransferFunction::steepest)
        .def("transparent_over", &TransferFunction::transparent_over, py::arg("lower"), py::arg("upper"))
        .def("at", &at, py::arg("values"));
}

} // namespace sheetsplat::bindings

#include <cstdint>
#include <memory>
#include <type_traits>
#include <variant>
#include <vector>

#include <pybind11/numpy.h>

#include "convert.hpp"
#include "registrars.hpp"
#include "sheetsplat/field.hpp"

namespace py = pybind11;

namespace sheetsplat::bindings {
namespace {

const std::map<std::string, Normalization> normalizations{
    {"none", Normalization::none}, {"lattice", Normalization::lattice}, {"threshold", Normalization::threshold}};
const std::map<std::string, Lattice> lattices{{"cartesian", Lattice::cartesian}, {"bcc", Lattice::bcc}};
const std::map<std::string, NanPolicy> nan_policies{{"error", NanPolicy::error}, {"skip", NanPolicy::skip}};

template <typename Value>
SampleArray copy_samples(const py::array& values) {
    const auto* first = static_cast<const Value*>(values.data());
    const auto count = static_cast<std::size_t>(values.size());
    const py::gil_scoped_release release;
    return std::vector<Value>(first, first + count);
}

SampleArray to_samples(const py::array& values) {
    if (!(values.flags() & py::array::c_style)) {
        throw InvalidInput(Complaint{"RegularField: the samples cannot be used", "an array that is not contiguous",
                                     "C order, the last axis fastest", "pass numpy.ascontiguousarray(values)"});
    }
    const py::dtype dtype = values.dtype();
    if (dtype.equal(py::dtype::of<std::uint8_t>())) {
        return copy_samples<std::uint8_t>(values);
    }
    if (dtype.equal(py::dtype::of<std::int16_t>())) {
        return copy_samples<std::int16_t>(values);
    }
    if (dtype.equal(py::dtype::of<std::uint16_t>())) {
        return copy_samples<std::uint16_t>(values);
    }
    if (dtype.equal(py::dtype::of<float>())) {
        return copy_samples<float>(values);
    }
    if (dtype.equal(py::dtype::of<double>())) {
        return copy_samples<double>(values);
    }
    throw InvalidInput(Complaint{"RegularField: the samples cannot be used",
                                 "samples of type " + std::string(py::str(dtype)),
                                 "uint8, int16, uint16, float32 or float64 in this machine's byte order", ""});
}

std::shared_ptr<RegularField> make_field(const py::array& values, const Triple& spacing, const Triple& origin,
                                         const std::string& lattice, double radius, double falloff,
                                         const std::string& normalization, double w0, const std::string& nan) {
    if (values.ndim() != 3) {
        throw InvalidInput(Complaint{"RegularField: the samples cannot be used",
                                     "an array of " + std::to_string(values.ndim()) + " axes", "3 axes, [k, j, i]",
                                     ""});
    }
    RegularFieldOptions options;
    options.spacing = to_vec3(spacing);
    options.origin = to_vec3(origin);
    options.lattice = from_name("lattice", lattice, lattices);
    options.radius = radius;
    options.falloff = falloff;
    options.normalization = from_name("normalization", normalization, normalizations);
    options.w0 = w0;
    options.nan = from_name("nan", nan, nan_policies);
    const std::array<std::size_t, 3> shape{static_cast<std::size_t>(values.shape(0)),
                                           static_cast<std::size_t>(values.shape(1)),
                                           static_cast<std::size_t>(values.shape(2))};
    SampleArray samples = to_samples(values);
    const py::gil_scoped_release release;
    return std::make_shared<RegularField>(std::move(samples), shape, options);
}

/// The samples themselves, read-only; the array keeps the field alive.
py::array view_samples(const py::object& self) {
    const auto& field = self.cast<const RegularField&>();
    const auto& shape = field.shape();
    py::array view = std::visit(
        [&](const auto& samples) {
            using Value = typename std::decay_t<decltype(samples)>::value_type;
            return py::array(py::dtype::of<Value>(), {shape[0], shape[1], shape[2]}, samples.data(), self);
        },
        field.samples());
    view.attr("flags").attr("writeable") = false;
    return view;
}

} // namespace

void register_field(py::module_& module) {
    py::class_<RegularField, std::shared_ptr<RegularField>>(module, "RegularField")
        .def(py::init(&make_field), py::arg("values"), py::kw_only(), py::arg("spacing"), py::arg("origin"),
             py::arg("lattice"), py::arg("radius"), py::arg("falloff"), py::arg("normalization"), py::arg("w0"),
             py::arg("nan"))
        .def_property_readonly("values", &view_samples)
        .def_property_readonly("size", &RegularField::size)
        .def_property_readonly("value_range", &RegularField::value_range)
        .def_property_readonly("centres", [](const RegularField& field) { return to_corners(field.centres_world()); })
        .def_property_readonly("supports", [](const RegularField& field) { return to_corners(field.supports_world()); })
        .def_property_readonly("default_slice_spacing", &RegularField::default_slice_spacing)
        .def_property_readonly("memory", &RegularField::memory)
        .def_property_readonly("lattice_constant", &RegularField::lattice_constant)
        .def_property_readonly("has_holes", &RegularField::has_holes)
        .def(
            "position",
            [](const RegularField& field, std::size_t i, std::size_t j, std::size_t k) {
                return to_triple(field.position(i, j, k));
            },
            py::arg("i"), py::arg("j"), py::arg("k"));
}

} // namespace sheetsplat::bindings

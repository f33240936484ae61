// What Python sees of fields.
#include <cstddef>
#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <type_traits>
#include <variant>
#include <vector>

#include <pybind11/numpy.h>

#include "convert.hpp"
#include "ellipsoid_arrays.hpp"
#include "registrars.hpp"
#include "released.hpp"
#include "sheetsplat/field.hpp"
#include "sheetsplat/field_points.hpp"

namespace py = pybind11;

namespace sheetsplat::bindings {
namespace {

const std::map<std::string, Normalization> normalizations{
    {"none", Normalization::none}, {"lattice", Normalization::lattice}, {"threshold", Normalization::threshold}};
const std::map<std::string, Lattice> lattices{{"cartesian", Lattice::cartesian}, {"bcc", Lattice::bcc}};
const std::map<std::string, Boundary> boundaries{{"edge", Boundary::edge}, {"zero", Boundary::zero}};
const std::map<std::string, NanPolicy> nan_policies{{"error", NanPolicy::error}, {"skip", NanPolicy::skip}};

/// Rows without gaps in them; between them there may be some.
template <typename Value>
SampleArray copy_samples(const py::array& values) {
    const auto* first = static_cast<const std::byte*>(values.data());
    const py::ssize_t layers = values.shape(0), rows = values.shape(1), count = values.shape(2);
    const py::ssize_t layer = values.strides(0), row = values.strides(1);
    const Released release;
    std::vector<Value> samples;
    samples.reserve(static_cast<std::size_t>(layers * rows * count));
    for (py::ssize_t k = 0; k < layers; ++k) {
        for (py::ssize_t j = 0; j < rows; ++j) {
            const auto* from = reinterpret_cast<const Value*>(first + k * layer + j * row);
            samples.insert(samples.end(), from, from + count);
        }
    }
    return samples;
}

SampleArray to_samples(const py::array& values) {
    if (values.ndim() != 3) {
        throw InvalidInput(Complaint{"RegularField: the samples cannot be used",
                                     "an array of " + std::to_string(values.ndim()) + " axes", "3 axes, [k, j, i]",
                                     ""});
    }
    if (!(values.flags() & py::array::c_style) && values.strides(2) != values.itemsize()) {
        throw InvalidInput(Complaint{"RegularField: the samples cannot be used", "rows that are not contiguous",
                                     "the last axis fastest", "pass numpy.ascontiguousarray(values)"});
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

std::shared_ptr<RegularField>
make_field(const py::array& values, const Triple& spacing, const Triple& origin, const std::string& lattice,
           double radius, double falloff, const std::string& normalization, double w0, const std::string& nan,
           bool prefilter, const std::string& boundary, std::optional<double> base, double least_weight,
           const std::optional<py::array>& coefficients, const std::optional<std::map<std::string, double>>& figures,
           const std::optional<std::array<double, 2>>& value_range, const std::optional<std::array<Triple, 3>>& axes) {
    SampleArray samples = to_samples(values);
    RegularFieldOptions options;
    options.spacing = to_vec3(spacing);
    options.origin = to_vec3(origin);
    options.lattice = from_name("lattice", lattice, lattices);
    options.radius = radius;
    options.falloff = falloff;
    options.normalization = from_name("normalization", normalization, normalizations);
    options.w0 = w0;
    options.nan = from_name("nan", nan, nan_policies);
    options.prefilter = prefilter;
    options.boundary = from_name("boundary", boundary, boundaries);
    options.base = base;
    options.least_weight = least_weight;
    options.value_range = value_range;
    if (axes) {
        options.axes.emplace(to_vec3((*axes)[0]), to_vec3((*axes)[1]), to_vec3((*axes)[2]));
    }
    const std::array<std::size_t, 3> shape{static_cast<std::size_t>(values.shape(0)),
                                           static_cast<std::size_t>(values.shape(1)),
                                           static_cast<std::size_t>(values.shape(2))};
    if (coefficients && figures) {
        PrefilteredSamples found{
            to_samples(*coefficients),
            {figures->at("residual"), figures->at("condition"), static_cast<int>(figures->at("steps"))}};
        const Released release;
        return std::make_shared<RegularField>(std::move(samples), std::move(found), shape, options);
    }
    const auto progress = [](double) {
        const py::gil_scoped_acquire acquire;
        if (PyErr_CheckSignals() != 0) {
            throw py::error_already_set();
        }
        return true;
    };
    const Released release;
    return std::make_shared<RegularField>(std::move(samples), shape, options, progress);
}

/// The samples themselves, as they were given or as kernels have them, read-only; the array keeps the field alive. Rows
/// may be kept with mirrored samples at their ends.
template <bool given>
py::array view_samples(const py::object& self) {
    const auto& field = self.cast<const RegularField&>();
    const auto& shape = field.shape();
    const std::size_t ends = given && field.prefilter() ? 0 : field.mirrored()[2];
    const std::size_t row = shape[2] + 2 * ends;
    py::array view = std::visit(
        [&](const auto& samples) {
            using Value = typename std::decay_t<decltype(samples)>::value_type;
            return py::array(py::dtype::of<Value>(), {shape[0], shape[1], shape[2]},
                             {shape[1] * row * sizeof(Value), row * sizeof(Value), sizeof(Value)},
                             samples.data() + ends, self);
        },
        given ? field.given_samples() : field.samples());
    view.attr("flags").attr("writeable") = false;
    return view;
}

std::optional<std::map<std::string, double>> figures_of(const RegularField& field) {
    const std::optional<PrefilterFigures>& found = field.prefilter();
    if (!found) {
        return std::nullopt;
    }
    return std::map<std::string, double>{
        {"residual", found->residual}, {"condition", found->condition}, {"steps", found->steps}};
}

/// A box, and the rows of the matrix that brings the world to it.
using GivenEnds = std::tuple<Triple, Triple, std::array<Triple, 3>>;

std::shared_ptr<EllipsoidField>
make_ellipsoids(const py::array& centers, const py::array& scales, const std::optional<py::array>& rotations,
                const py::array& values, const std::optional<py::array>& weights, const std::string& normalization,
                double w0, double falloff, std::optional<double> min_scale, std::optional<double> cell_volume,
                double base, bool unit_rotations, const std::optional<std::array<double, 2>>& value_range,
                const std::optional<std::pair<Triple, Triple>>& periodic, const std::optional<GivenEnds>& ends,
                std::optional<double> slice_spacing) {
    EllipsoidFieldOptions options;
    options.slice_spacing = slice_spacing;
    if (ends) {
        const auto& [lower, upper, rows] = *ends;
        options.domain = Parallelepiped(Box{to_vec3(lower), to_vec3(upper)},
                                        glm::transpose(Mat3(to_vec3(rows[0]), to_vec3(rows[1]), to_vec3(rows[2]))));
    }
    options.normalization = from_name("normalization", normalization, normalizations);
    options.w0 = w0;
    options.falloff = falloff;
    options.min_scale = min_scale;
    options.cell_volume = cell_volume;
    options.base = base;
    options.value_range = value_range;
    if (periodic) {
        options.periodic = Box{to_vec3(periodic->first), to_vec3(periodic->second)};
    }
    EllipsoidArrays arrays;
    arrays.unit_rotations = unit_rotations;
    arrays.centers = to_vectors(centers, "centers");
    if (scales.ndim() == 1) {
        arrays.radii = to_numbers(scales, "scales");
    } else {
        arrays.scales = to_vectors(scales, "scales");
    }
    if (rotations) {
        arrays.rotations = to_rotations(*rotations);
    }
    arrays.values = to_numbers(values, "values");
    if (weights) {
        arrays.weights = to_numbers(*weights, "weights");
    }
    const Released release;
    return std::make_shared<EllipsoidField>(std::move(arrays), options);
}

/// Number of the kernels of a field without their images.
std::size_t given(const py::object& self) { return self.cast<const EllipsoidField&>().given(); }

/// One of a field's arrays itself, read-only; the array keeps the field alive. `columns` numbers a kernel, 0: one.
py::array view_array(const py::object& self, const void* first, std::size_t count, std::size_t columns) {
    std::vector<py::ssize_t> shape{static_cast<py::ssize_t>(count)};
    if (columns != 0) {
        shape.push_back(static_cast<py::ssize_t>(columns));
    }
    py::array view(py::dtype::of<double>(), shape, first, self);
    view.attr("flags").attr("writeable") = false;
    return view;
}

static_assert(sizeof(Vec3) == 3 * sizeof(double) && sizeof(glm::dquat) == 4 * sizeof(double),
              "vectors and quaternions are seen as rows of numbers");

/// A new array (N, columns) of what `fill` writes into it with the interpreter's lock released.
template <class Fill>
py::array_t<double> made_array(std::size_t count, std::size_t columns, Fill&& fill) {
    py::array_t<double> made({static_cast<py::ssize_t>(count), static_cast<py::ssize_t>(columns)});
    double* const first = made.mutable_data();
    const Released release;
    fill(first);
    return made;
}

py::array_t<double> array_of_rotations(const std::vector<glm::dquat>& rotations) {
    return made_array(rotations.size(), 4, [&](double* at) {
        for (const glm::dquat& q : rotations) {
            for (const double part : {q.w, q.x, q.y, q.z}) {
                *at++ = part;
            }
        }
    });
}

py::object rotations_of(const EllipsoidField& field) {
    if (field.arrays().rotations.empty()) {
        return py::none();
    }
    std::vector<glm::dquat> given = field.arrays().rotations;
    given.resize(field.given());
    py::array made = array_of_rotations(given);
    made.attr("flags").attr("writeable") = false;
    return made;
}

/// M of the kernels with these indices, (count, 3, 3), its columns the semi-axes as vectors.
py::array_t<double> shapes_of(const EllipsoidField& field,
                              const py::array_t<std::int64_t, py::array::c_style>& indices) {
    if (indices.ndim() != 1) {
        throw InvalidInput(Complaint{"EllipsoidField: the indices cannot be used",
                                     "an array of " + std::to_string(indices.ndim()) + " axes", "one axis", ""});
    }
    py::array_t<double> made({indices.shape(0), py::ssize_t{3}, py::ssize_t{3}});
    double* at = made.mutable_data();
    for (py::ssize_t n = 0; n < indices.shape(0); ++n) {
        const auto i = static_cast<std::size_t>(indices.data()[n]);
        if (i >= field.size()) {
            throw InvalidInput(Complaint{"EllipsoidField: the indices cannot be used",
                                         std::to_string(indices.data()[n]),
                                         "indices below " + std::to_string(field.size()), ""});
        }
        const Mat3 shape = field.shape(i);
        for (int row = 0; row < 3; ++row) {
            for (int column = 0; column < 3; ++column) {
                *at++ = shape[column][row];
            }
        }
    }
    return made;
}

/// What the kernels of any field add up to at points (M, 3): (M, 8) of D, W, their derivatives along x, y, z, and (M,)
/// the number of the kernel with the nearest centre among those that reach the point, -1 where none does. 0 threads:
/// all that the process may use.
py::tuple arrays_of_sums(const Field& field, const py::array& points, int threads) {
    const std::vector<Vec3> places = to_vectors(points, "points");
    const std::size_t count = places.size();
    py::array_t<std::int64_t> nearest(static_cast<py::ssize_t>(count));
    std::int64_t* number = nearest.mutable_data();
    py::array_t<double> sums = made_array(count, 8, [&](double* at) {
        for (const FieldSums& one : field_sums(field, places, threads)) {
            *at++ = one.values;
            *at++ = one.weights;
            for (int axis = 0; axis < 3; ++axis) {
                at[axis] = one.values_slope[axis];
                at[3 + axis] = one.weights_slope[axis];
            }
            at += 6;
            *number++ = one.nearest;
        }
    });
    return py::make_tuple(std::move(sums), std::move(nearest));
}

py::tuple arrays_of_ghosts(const EllipsoidField& field, double distance, std::size_t most) {
    GhostPoints ghosts;
    {
        const Released release;
        ghosts = ghost_points(field, distance, most);
    }
    py::array_t<std::int64_t> owners(static_cast<py::ssize_t>(ghosts.owners.size()));
    std::copy(ghosts.owners.begin(), ghosts.owners.end(), owners.mutable_data());
    const std::vector<Vec3>& centers = ghosts.centers;
    py::array_t<double> places = made_array(centers.size(), 3, [&](double* at) {
        for (const Vec3& center : centers) {
            for (int axis = 0; axis < 3; ++axis) {
                *at++ = center[axis];
            }
        }
    });
    return py::make_tuple(std::move(owners), std::move(places));
}

} // namespace

void register_field(py::module_& module) {
    py::class_<Field, std::shared_ptr<Field>>(module, "Field")
        .def_property_readonly("size", &Field::size)
        .def_property_readonly("value_range", &Field::value_range)
        .def_property_readonly("base", &Field::base)
        .def_property_readonly("least_weight", &Field::least_weight)
        .def_property_readonly("centres", [](const Field& field) { return to_corners(field.centres_world()); })
        .def_property_readonly("supports", [](const Field& field) { return to_corners(field.supports_world()); })
        .def_property_readonly("default_slice_spacing", &Field::default_slice_spacing)
        .def_property_readonly("memory", &Field::memory)
        .def_property_readonly("domain",
                               [](const Field& field) { return to_corners(field.domain().value_or(Box{}).box); })
        .def("sums_at", &arrays_of_sums, py::arg("points"), py::arg("threads") = 0)
        .def(
            "reach_along",
            [](const Field& field, const Triple& from, const Triple& direction) {
                return field.reach_along(to_vec3(from), to_vec3(direction));
            },
            py::arg("from_point"), py::arg("direction"), py::call_guard<Released>());
    py::class_<RegularField, Field, std::shared_ptr<RegularField>>(module, "RegularField")
        .def(py::init(&make_field), py::arg("values"), py::kw_only(), py::arg("spacing"), py::arg("origin"),
             py::arg("lattice"), py::arg("radius"), py::arg("falloff"), py::arg("normalization"), py::arg("w0"),
             py::arg("nan"), py::arg("prefilter"), py::arg("boundary") = "zero", py::arg("base") = py::none(),
             py::arg("least_weight") = 0.0, py::arg("coefficients").none(true), py::arg("figures").none(true),
             py::arg("value_range") = py::none(), py::arg("axes") = py::none())
        .def_property_readonly("values", &view_samples<false>)
        .def_property_readonly("given_values", &view_samples<true>)
        .def_property_readonly("given_range", &RegularField::given_range)
        .def_property_readonly("prefilter_figures", &figures_of)
        .def_property_readonly("lattice_constant", &RegularField::lattice_constant)
        .def_property_readonly("has_holes", &RegularField::has_holes)
        .def(
            "position",
            [](const RegularField& field, std::size_t i, std::size_t j, std::size_t k) {
                return to_triple(field.position(i, j, k));
            },
            py::arg("i"), py::arg("j"), py::arg("k"));
    py::class_<EllipsoidField, Field, std::shared_ptr<EllipsoidField>>(module, "EllipsoidField")
        .def(py::init(&make_ellipsoids), py::arg("centers"), py::arg("scales"), py::arg("rotations").none(true),
             py::arg("values"), py::kw_only(), py::arg("weights").none(true), py::arg("normalization"), py::arg("w0"),
             py::arg("falloff"), py::arg("min_scale"), py::arg("cell_volume"), py::arg("base") = 0.0,
             py::arg("unit_rotations") = false, py::arg("value_range") = py::none(), py::arg("periodic") = py::none(),
             py::arg("ends") = py::none(), py::arg("slice_spacing") = py::none())
        .def_property_readonly("size", &EllipsoidField::given)
        .def_property_readonly("images", [](const EllipsoidField& field) { return field.size() - field.given(); })
        .def("with_images",
             [](const EllipsoidField& field) {
                 EllipsoidArrays arrays = field.arrays();
                 arrays.unit_rotations = true;
                 EllipsoidFieldOptions options = field.options();
                 options.periodic.reset();
                 options.domain.reset();
                 return std::make_shared<EllipsoidField>(std::move(arrays), options);
             })
        .def_property_readonly("centers",
                               [](const py::object& self) {
                                   const auto& arrays = self.cast<const EllipsoidField&>().arrays();
                                   return view_array(self, arrays.centers.data(), given(self), 3);
                               })
        .def_property_readonly("scales",
                               [](const py::object& self) {
                                   const auto& field = self.cast<const EllipsoidField&>();
                                   const auto& arrays = field.arrays();
                                   return field.isotropic() ? view_array(self, arrays.radii.data(), given(self), 0)
                                                            : view_array(self, arrays.scales.data(), given(self), 3);
                               })
        .def_property_readonly("rotations", &rotations_of)
        .def_property_readonly("values",
                               [](const py::object& self) {
                                   const auto& arrays = self.cast<const EllipsoidField&>().arrays();
                                   return view_array(self, arrays.values.data(), given(self), 0);
                               })
        .def_property_readonly("weights",
                               [](const py::object& self) -> py::object {
                                   const auto& arrays = self.cast<const EllipsoidField&>().arrays();
                                   if (arrays.weights.empty()) {
                                       return py::none();
                                   }
                                   return view_array(self, arrays.weights.data(), given(self), 0);
                               })
        .def_property_readonly("weight_range", &EllipsoidField::weight_range)
        .def_property_readonly("scale_range", &EllipsoidField::scale_range)
        .def_property_readonly("isotropic", &EllipsoidField::isotropic)
        .def_property_readonly("lattice_constant", &EllipsoidField::lattice_constant)
        .def("shapes", &shapes_of, py::arg("indices"))
        .def("ghost_points", &arrays_of_ghosts, py::arg("distance"), py::arg("most"));
    module.def(
        "prefilter_condition",
        [](double radius, double falloff, const std::string& lattice) {
            return prefilter_condition(from_name("lattice", lattice, lattices), radius, falloff);
        },
        py::arg("radius"), py::arg("falloff"), py::arg("lattice"));
    module.def(
        "nearest_rotations", [](const py::array& matrices) { return array_of_rotations(to_rotations(matrices)); },
        py::arg("matrices"));
}

} // namespace sheetsplat::bindings

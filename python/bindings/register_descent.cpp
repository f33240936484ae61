// What Python sees of coordinate descent on lattices of kernels.
#include <algorithm>
#include <string>
#include <utility>
#include <vector>

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include "registrars.hpp"
#include "released.hpp"
#include "sheetsplat/lattice_descent.hpp"

namespace py = pybind11;

namespace sheetsplat::bindings {

namespace {

using fit::BitTable;
using fit::LatticeDescent;
using fit::Nodes;
using fit::Pass;
using Numbers = py::array_t<double, py::array::c_style | py::array::forcecast>;
/// Of one level: the first node, counts of nodes, the spacing.
using GivenNodes = std::tuple<std::array<int, 3>, std::array<int, 3>, double>;

std::vector<Nodes> to_nodes(const std::vector<GivenNodes>& given) {
    std::vector<Nodes> made;
    for (const auto& [first, counts, spacing] : given) {
        made.push_back({first, counts, spacing});
    }
    return made;
}

std::vector<double> to_vector(const Numbers& array) { return {array.data(), array.data() + array.size()}; }

std::unique_ptr<LatticeDescent> of_grids(const std::vector<std::pair<std::array<double, 3>, Numbers>>& grids,
                                         const std::vector<GivenNodes>& levels, double falloff, double radius,
                                         int threads, bool exact) {
    std::vector<fit::SampleGrid> made;
    for (const auto& [offset, samples] : grids) {
        fit::SampleGrid grid;
        for (std::size_t axis = 0; axis < 3; ++axis) {
            grid.counts[axis] = static_cast<std::size_t>(samples.shape(static_cast<py::ssize_t>(2 - axis)));
        }
        grid.offset = offset;
        grid.samples = to_vector(samples);
        made.push_back(std::move(grid));
    }
    const Released release;
    return std::make_unique<LatticeDescent>(std::move(made), to_nodes(levels), falloff, radius, threads, exact);
}

std::unique_ptr<LatticeDescent> of_points(const Numbers& places, const Numbers& samples,
                                          const std::vector<GivenNodes>& levels, double falloff, double radius,
                                          int threads) {
    fit::SamplePoints points;
    const auto at = places.unchecked<2>();
    for (py::ssize_t i = 0; i < at.shape(0); ++i) {
        points.places.emplace_back(at(i, 0), at(i, 1), at(i, 2));
    }
    points.samples = to_vector(samples);
    const Released release;
    return std::make_unique<LatticeDescent>(std::move(points), to_nodes(levels), falloff, radius, threads);
}

py::tuple to_tuple(const Pass& pass) { return py::make_tuple(pass.largest, pass.active); }

py::array_t<float> coefficients(const LatticeDescent& descent, std::size_t level) {
    const auto& counts = descent.levels().at(level).counts;
    py::array_t<float> made({counts[2], counts[1], counts[0]});
    const auto& from = descent.coefficients(level);
    std::copy(from.begin(), from.end(), made.mutable_data());
    return made;
}

} // namespace

void register_descent(py::module_& module) {
    py::class_<LatticeDescent>(module, "LatticeDescent")
        .def(py::init(&of_grids), py::arg("grids"), py::arg("levels"), py::arg("falloff"), py::arg("radius"),
             py::arg("threads"), py::arg("exact") = false)
        .def(py::init(&of_points), py::arg("places"), py::arg("samples"), py::arg("levels"), py::arg("falloff"),
             py::arg("radius"), py::arg("threads"))
        .def("norm", &LatticeDescent::norm, py::arg("level"))
        .def("misfit", &LatticeDescent::misfit)
        .def("residual",
             [](const LatticeDescent& descent) {
                 const std::vector<double> numbers = descent.residual();
                 return py::array_t<double>(static_cast<py::ssize_t>(numbers.size()), numbers.data());
             })
        .def("coefficients", &coefficients, py::arg("level"))
        .def(
            "soften",
            [](LatticeDescent& descent, std::size_t level, double threshold, bool only_active) {
                Pass pass;
                {
                    const Released release;
                    pass = descent.soften(level, threshold, only_active);
                }
                return to_tuple(pass);
            },
            py::arg("level"), py::arg("threshold"), py::arg("only_active"))
        .def(
            "round_off",
            [](LatticeDescent& descent, std::size_t level, double step, double squared_error_a_bit,
               const BitTable& bits, bool only_active) {
                Pass pass;
                {
                    const Released release;
                    pass = descent.round_off(level, step, squared_error_a_bit, bits, only_active);
                }
                return to_tuple(pass);
            },
            py::arg("level"), py::arg("step"), py::arg("squared_error_a_bit"), py::arg("bits"), py::arg("only_active"))
        .def(
            "set",
            [](LatticeDescent& descent, std::size_t level, const Numbers& given) {
                const std::vector<double> numbers = to_vector(given);
                const Released release;
                descent.set(level, numbers);
            },
            py::arg("level"), py::arg("coefficients"));
}

} // namespace sheetsplat::bindings

// What Python sees of the fit of free ellipsoids to samples.
#include <array>
#include <cstddef>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <pybind11/numpy.h>

#include "convert.hpp"
#include "registrars.hpp"
#include "released.hpp"
#include "sheetsplat/ellipsoid_fit.hpp"

namespace py = pybind11;

namespace sheetsplat::bindings {
namespace {

using Table = py::array_t<double, py::array::c_style | py::array::forcecast>;
constexpr auto columns = static_cast<py::ssize_t>(numbers_of_ellipsoid);

/// Rows of centre, frame and value.
std::vector<FreeEllipsoid> ellipsoids_of(const Table& table) {
    if (table.ndim() != 2 || table.shape(1) != columns) {
        throw InvalidInput(Complaint{"EllipsoidFit: the kernels cannot be used",
                                     "an array of " + std::to_string(table.ndim()) + " axes", "rows of 10 numbers",
                                     ""});
    }
    std::vector<FreeEllipsoid> kernels(static_cast<std::size_t>(table.shape(0)));
    const double* from = table.data();
    for (FreeEllipsoid& kernel : kernels) {
        kernel = {{from[0], from[1], from[2]}, {from[3], from[4], from[5], from[6], from[7], from[8]}, from[9]};
        from += numbers_of_ellipsoid;
    }
    return kernels;
}

Table table_of(const std::vector<FreeEllipsoid>& kernels) {
    Table table({static_cast<py::ssize_t>(kernels.size()), columns});
    double* to = table.mutable_data();
    for (const FreeEllipsoid& kernel : kernels) {
        for (int axis = 0; axis < 3; ++axis) {
            *to++ = kernel.center[axis];
        }
        for (const double one : kernel.frame) {
            *to++ = one;
        }
        *to++ = kernel.value;
    }
    return table;
}

std::vector<double> numbers_of(const Table& table) {
    return std::vector<double>(table.data(), table.data() + table.size());
}

Table array_of(const std::vector<double>& numbers) {
    return Table(static_cast<py::ssize_t>(numbers.size()), numbers.data());
}

/// Serves one thread at a time; between steps it listens to Ctrl-C.
class SharedFit {
  public:
    SharedFit(const Table& data, const std::optional<Table>& points, const std::optional<Table>& weights,
              double falloff, int threads) {
        EllipsoidFit::Options options;
        options.falloff = falloff;
        options.threads = threads;
        if (weights) {
            options.weights = numbers_of(*weights);
        }
        std::vector<double> numbers = numbers_of(data);
        if (points) {
            if (points->ndim() != 2 || points->shape(1) != 3) {
                throw InvalidInput(Complaint{"EllipsoidFit: the points cannot be used",
                                             "an array of " + std::to_string(points->ndim()) + " axes", "(M, 3) places",
                                             ""});
            }
            std::vector<Vec3> places;
            places.reserve(static_cast<std::size_t>(points->shape(0)));
            for (py::ssize_t n = 0; n < points->shape(0); ++n) {
                const double* const at = points->data(n, 0);
                places.emplace_back(at[0], at[1], at[2]);
            }
            const Released release;
            fit_ = std::make_unique<EllipsoidFit>(places, std::move(numbers), std::move(options));
            return;
        }
        if (data.ndim() != 3) {
            throw InvalidInput(Complaint{"EllipsoidFit: the samples cannot be used",
                                         "an array of " + std::to_string(data.ndim()) + " axes", "3 axes, [k, j, i]",
                                         ""});
        }
        const std::array<std::size_t, 3> shape{static_cast<std::size_t>(data.shape(0)),
                                               static_cast<std::size_t>(data.shape(1)),
                                               static_cast<std::size_t>(data.shape(2))};
        const Released release;
        fit_ = std::make_unique<EllipsoidFit>(shape, std::move(numbers), std::move(options));
    }

  private:
    template <class Do>
    auto work(Do&& act) {
        const auto ask = [](double) {
            if (Released::ending_elsewhere()) {
                return false;
            }
            const py::gil_scoped_acquire acquire;
            if (PyErr_CheckSignals() != 0) {
                throw py::error_already_set();
            }
            return true;
        };
        const Released release;
        const std::lock_guard<std::mutex> hold(mutex_);
        return act(ask);
    }

  public:
    py::tuple objective(const Table& table) {
        const std::vector<FreeEllipsoid> kernels = ellipsoids_of(table);
        std::vector<EllipsoidChange> slope;
        const double found = work([&](const auto& ask) { return fit_->objective(kernels, slope, ask); });
        return py::make_tuple(found, table_of(slope));
    }
    py::tuple residual(const Table& table) {
        const std::vector<FreeEllipsoid> kernels = ellipsoids_of(table);
        std::vector<double> left;
        const double found = work([&](const auto& ask) { return fit_->residual(kernels, left, ask); });
        return py::make_tuple(found, array_of(left));
    }
    Table sums(const Table& table) {
        const std::vector<FreeEllipsoid> kernels = ellipsoids_of(table);
        return array_of(work([&](const auto& ask) { return fit_->sums(kernels, ask); }));
    }
    Table project(const Table& table, const Table& field) {
        const std::vector<FreeEllipsoid> kernels = ellipsoids_of(table);
        const std::vector<double> numbers = numbers_of(field);
        return table_of(work([&](const auto& ask) { return fit_->project(kernels, numbers, ask); }));
    }
    Table normal(const Table& table, const Table& changes) {
        const std::vector<FreeEllipsoid> kernels = ellipsoids_of(table);
        const std::vector<EllipsoidChange> given = ellipsoids_of(changes);
        return table_of(work([&](const auto& ask) { return fit_->normal(kernels, given, ask); }));
    }
    Table overlaps(const Table& table) {
        const std::vector<FreeEllipsoid> kernels = ellipsoids_of(table);
        const auto found = work([&](const auto& ask) { return fit_->overlaps(kernels, ask); });
        return Table(std::vector<py::ssize_t>(2, table.shape(0)), found.data());
    }
    /// Symmetric matrices, (N, 10, 10).
    Table blocks(const Table& table) {
        const std::vector<FreeEllipsoid> kernels = ellipsoids_of(table);
        const auto found = work([&](const auto& ask) { return fit_->blocks(kernels, ask); });
        Table made(std::vector<py::ssize_t>{static_cast<py::ssize_t>(found.size()), columns, columns});
        auto to = made.mutable_unchecked<3>();
        for (py::ssize_t n = 0; n < made.shape(0); ++n) {
            const double* from = found[static_cast<std::size_t>(n)].data();
            for (py::ssize_t a = 0; a < columns; ++a) {
                for (py::ssize_t b = a; b < columns; ++b) {
                    to(n, a, b) = to(n, b, a) = *from++;
                }
            }
        }
        return made;
    }

  private:
    std::unique_ptr<EllipsoidFit> fit_;
    std::mutex mutex_;
};

} // namespace

void register_ellipsoid_fit(py::module_& module) {
    py::class_<SharedFit>(module, "EllipsoidFit")
        .def(py::init<const Table&, const std::optional<Table>&, const std::optional<Table>&, double, int>(),
             py::arg("data"), py::kw_only(), py::arg("points") = py::none(), py::arg("weights") = py::none(),
             py::arg("falloff") = 8.0, py::arg("threads") = 0)
        .def("objective", &SharedFit::objective, py::arg("kernels"))
        .def("residual", &SharedFit::residual, py::arg("kernels"))
        .def("sums", &SharedFit::sums, py::arg("kernels"))
        .def("project", &SharedFit::project, py::arg("kernels"), py::arg("field"))
        .def("normal", &SharedFit::normal, py::arg("kernels"), py::arg("changes"))
        .def("overlaps", &SharedFit::overlaps, py::arg("kernels"))
        .def("blocks", &SharedFit::blocks, py::arg("kernels"));
    module.def(
        "changed_ellipsoids",
        [](const Table& kernels, const Table& changes) {
            std::vector<FreeEllipsoid> made = ellipsoids_of(kernels);
            const std::vector<EllipsoidChange> given = ellipsoids_of(changes);
            if (given.size() != made.size()) {
                throw InvalidInput(Complaint{"EllipsoidFit: the changes cannot be used",
                                             std::to_string(given.size()) + " of them", "one a kernel", ""});
            }
            for (std::size_t n = 0; n < made.size(); ++n) {
                made[n] = changed(made[n], given[n]);
            }
            return table_of(made);
        },
        py::arg("kernels"), py::arg("changes"));
}

} // namespace sheetsplat::bindings

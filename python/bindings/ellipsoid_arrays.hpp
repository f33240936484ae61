// Arrays of NumPy as the arrays of an EllipsoidField, and back, without a Python object a number.
#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <cstring>
#include <string>
#include <vector>

#include <glm/geometric.hpp>
#include <glm/gtc/quaternion.hpp>
#include <glm/matrix.hpp>
#include <pybind11/numpy.h>

#include "convert.hpp"
#include "released.hpp"
#include "sheetsplat/field.hpp"

namespace sheetsplat::bindings {

/// Calls take(row, numbers) for every row of an array (N), (N, C) or (N, A, B) of any strides, C = A B numbers each in
/// C order, with the interpreter's lock released. float32 and float64 in this machine's byte order; InvalidInput for
/// other types and shapes.
template <std::size_t Columns, class Take>
void each_row(const pybind11::array& array, const char* name, Take&& take) {
    namespace py = pybind11;
    const bool flat = Columns == 1 && array.ndim() == 1;
    const bool rows = array.ndim() == 2 && static_cast<std::size_t>(array.shape(1)) == Columns;
    const bool blocks = array.ndim() == 3 && static_cast<std::size_t>(array.shape(1) * array.shape(2)) == Columns;
    if (!flat && !rows && !blocks) {
        throw InvalidInput(Complaint{std::string("EllipsoidField: ") + option_ref(name) + " cannot be used",
                                     "an array of " + std::to_string(array.ndim()) + " axes",
                                     std::to_string(Columns) + " numbers a kernel", ""});
    }
    std::array<py::ssize_t, Columns> offsets{};
    for (std::size_t c = 0; c < Columns && !flat; ++c) {
        const auto column = static_cast<py::ssize_t>(c);
        offsets[c] = rows ? column * array.strides(1)
                          : column / array.shape(2) * array.strides(1) + column % array.shape(2) * array.strides(2);
    }
    const auto count = static_cast<std::size_t>(array.shape(0));
    const py::ssize_t step = array.strides(0);
    const auto* const first = static_cast<const char*>(array.data());
    const auto read = [&](auto zero) {
        using Value = decltype(zero);
        const Released release;
        std::array<double, Columns> numbers{};
        for (std::size_t n = 0; n < count; ++n) {
            const char* const at = first + static_cast<py::ssize_t>(n) * step;
            for (std::size_t c = 0; c < Columns; ++c) {
                Value value;
                std::memcpy(&value, at + offsets[c], sizeof(Value));
                numbers[c] = static_cast<double>(value);
            }
            take(n, numbers);
        }
    };
    const py::dtype dtype = array.dtype();
    if (dtype.equal(py::dtype::of<double>())) {
        read(double{});
    } else if (dtype.equal(py::dtype::of<float>())) {
        read(float{});
    } else {
        throw InvalidInput(Complaint{std::string("EllipsoidField: ") + option_ref(name) + " cannot be used",
                                     "numbers of type " + std::string(py::str(dtype)),
                                     "float32 or float64 in this machine's byte order", ""});
    }
}

inline std::vector<double> to_numbers(const pybind11::array& array, const char* name) {
    std::vector<double> numbers;
    numbers.reserve(array.ndim() == 0 ? 0 : static_cast<std::size_t>(array.shape(0)));
    each_row<1>(array, name, [&](std::size_t, const std::array<double, 1>& row) { numbers.push_back(row[0]); });
    return numbers;
}

inline std::vector<Vec3> to_vectors(const pybind11::array& array, const char* name) {
    std::vector<Vec3> vectors;
    vectors.reserve(array.ndim() == 0 ? 0 : static_cast<std::size_t>(array.shape(0)));
    each_row<3>(array, name,
                [&](std::size_t, const std::array<double, 3>& row) { vectors.emplace_back(row[0], row[1], row[2]); });
    return vectors;
}

/// The rotation nearest to an almost orthogonal matrix, as a unit quaternion. A reflection is negated first: the two
/// span the same ellipsoid.
inline glm::dquat nearest_rotation(Mat3 matrix) {
    if (glm::determinant(matrix) < 0.0) {
        matrix = -1.0 * matrix;
    }
    // The polar factor by Newton's iteration (Higham 1986, eq. 3.4), which squares the error: 1e-3, 1e-6, 1e-12, 1e-24.
    for (int n = 0; n < 4; ++n) {
        matrix = 0.5 * (matrix + glm::transpose(glm::inverse(matrix)));
    }
    return glm::normalize(glm::quat_cast(matrix));
}

/// Unit quaternions out of (N, 4), w, x, y, z as they are, or out of matrices (N, 3, 3) whose columns are a kernel's
/// own axes in the world. InvalidInput, with the index, for a matrix farther than 1e-3 from an orthogonal one.
inline std::vector<glm::dquat> to_rotations(const pybind11::array& array) {
    constexpr double tolerance = 1e-3;
    std::vector<glm::dquat> rotations;
    rotations.reserve(array.ndim() == 0 ? 0 : static_cast<std::size_t>(array.shape(0)));
    if (array.ndim() == 2) {
        each_row<4>(array, "rotations", [&](std::size_t, const std::array<double, 4>& row) {
            rotations.emplace_back(row[0], row[1], row[2], row[3]);
        });
        return rotations;
    }
    each_row<9>(array, "rotations", [&](std::size_t n, const std::array<double, 9>& row) {
        const Mat3 matrix(row[0], row[3], row[6], row[1], row[4], row[7], row[2], row[5], row[8]);
        double error = 0.0;
        for (int axis = 0; axis < 3; ++axis) {
            const double length = std::abs(glm::length(matrix[axis]) - 1.0);
            const double leaning = std::abs(glm::dot(matrix[axis], matrix[(axis + 1) % 3]));
            // Not by a maximum, which drops NaN.
            error = length <= error ? error : length;
            error = leaning <= error ? error : leaning;
        }
        if (!(error <= tolerance)) {
            std::ostringstream text;
            text << error;
            throw InvalidInput(Complaint{"EllipsoidField: a rotation cannot be used",
                                         "a matrix of kernel " + std::to_string(n) + " that is " + text.str() +
                                             " away from an orthogonal one",
                                         "orthogonal matrices, to within 1e-3",
                                         "for columns with lengths use EllipsoidField.from_frames, for covariances "
                                         "EllipsoidField.from_covariances"});
        }
        rotations.push_back(nearest_rotation(matrix));
    });
    return rotations;
}

} // namespace sheetsplat::bindings

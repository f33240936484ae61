// Coefficients against dense solutions of the same equations, by the definition of the kernel.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "base/instruction_set.hpp"
#include "base/poll.hpp"
#include "field/prefilter.hpp"
#include "sheetsplat/error.hpp"
#include "sheetsplat/field_points.hpp"
#include "support.hpp"
#include "support/lattices.hpp"

namespace sheetsplat {
namespace {

using test::message_of;
using Shape = std::array<std::size_t, 3>;

std::size_t count_of(const Shape& shape) { return shape[0] * shape[1] * shape[2]; }

RegularFieldOptions options_of(Lattice lattice, double radius, double falloff) {
    RegularFieldOptions options = test::zero_boundary();
    options.lattice = lattice;
    options.radius = radius;
    options.falloff = falloff;
    options.prefilter = true;
    return options;
}

template <class T>
std::vector<T> noise(std::size_t count, double scale = 1.0) {
    std::mt19937 generator(7);
    std::uniform_real_distribution<double> uniform(-1.0, 1.0);
    std::vector<T> samples(count);
    for (T& sample : samples) {
        sample = static_cast<T>(scale * uniform(generator));
    }
    return samples;
}

/// Places in sample distances (BCC: of a / sqrt 2).
std::vector<Vec3> places_of(const Shape& shape, Lattice lattice) {
    std::vector<Vec3> places;
    for (std::size_t k = 0; k < shape[0]; ++k) {
        for (std::size_t j = 0; j < shape[1]; ++j) {
            for (std::size_t i = 0; i < shape[2]; ++i) {
                const Vec3 at(static_cast<double>(i), static_cast<double>(j), static_cast<double>(k));
                const double half = k % 2 == 0 ? 0.0 : 0.5;
                places.push_back(lattice == Lattice::bcc ? std::sqrt(2.0) * Vec3(at.x + half, at.y + half, 0.5 * at.z)
                                                         : at);
            }
        }
    }
    return places;
}

/// [sample][sample], row by row: the kernel of each at each other.
std::vector<double> matrix_of(const Shape& shape, const RegularFieldOptions& options) {
    const std::vector<Vec3> places = places_of(shape, options.lattice);
    std::vector<double> matrix;
    for (const Vec3& a : places) {
        for (const Vec3& b : places) {
            const Vec3 away = (a - b) / options.radius;
            const double square = away.x * away.x + away.y * away.y + away.z * away.z;
            const double edge = std::exp(-options.falloff);
            matrix.push_back(std::max(0.0, (std::exp(-options.falloff * square) - edge) / (1.0 - edge)));
        }
    }
    return matrix;
}

/// Image of index i, counted from the first of `count` planes of samples: one reflection after the other.
int image_of(int i, int count) {
    if (count == 1) {
        return 0;
    }
    while (i < 0 || i >= count) {
        i = i < 0 ? -i : 2 * (count - 1) - i;
    }
    return i;
}

/// Number of planes of samples along k, j, i; BCC: half an edge apart.
std::array<int, 3> planes_of(const Shape& shape, Lattice lattice) {
    const int each = lattice == Lattice::bcc ? 2 : 1;
    return {static_cast<int>(shape[0]), each * static_cast<int>(shape[1]), each * static_cast<int>(shape[2])};
}

/// The planes that sample n lies in.
std::array<int, 3> planes_of_sample(std::size_t n, const Shape& shape, Lattice lattice) {
    const auto k = static_cast<int>(n / shape[2] / shape[1]);
    const auto j = static_cast<int>(n / shape[2] % shape[1]), i = static_cast<int>(n % shape[2]);
    return lattice == Lattice::bcc ? std::array<int, 3>{k, 2 * j + k % 2, 2 * i + k % 2} : std::array<int, 3>{k, j, i};
}

/// The same with the kernels of all mirrored samples, added to those of the samples that they are images of.
std::vector<double> mirrored_matrix_of(const Shape& shape, const RegularFieldOptions& options) {
    const bool bcc = options.lattice == Lattice::bcc;
    const double radius = options.radius * (bcc ? std::sqrt(2.0) : 1.0), edge = std::exp(-options.falloff);
    const auto reach = static_cast<int>(std::ceil(radius));
    const std::array<int, 3> planes = planes_of(shape, options.lattice);
    const std::size_t count = count_of(shape);
    std::vector<double> matrix(count * count, 0.0);
    for (std::size_t row = 0; row < count; ++row) {
        const std::array<int, 3> at = planes_of_sample(row, shape, options.lattice);
        for (int k = -reach; k <= reach; ++k) {
            for (int j = -reach; j <= reach; ++j) {
                for (int i = -reach; i <= reach; ++i) {
                    const double square = static_cast<double>(k * k + j * j + i * i) / (radius * radius);
                    if (square >= 1.0 || (bcc && (std::abs(k) % 2 != std::abs(j) % 2 || std::abs(j + i) % 2 != 0))) {
                        continue;
                    }
                    const int in_k = image_of(at[0] + k, planes[0]), in_j = image_of(at[1] + j, planes[1]);
                    const int in_i = image_of(at[2] + i, planes[2]), each = bcc ? 2 : 1;
                    const auto column = static_cast<std::size_t>(
                        (in_k * static_cast<int>(shape[1]) + in_j / each) * static_cast<int>(shape[2]) + in_i / each);
                    matrix[row * count + column] += (std::exp(-options.falloff * square) - edge) / (1.0 - edge);
                }
            }
        }
    }
    return matrix;
}

/// How often each sample occurs in a period of the mirrored volume. Rows times that are a symmetric matrix.
std::vector<double> images_in_a_period(const Shape& shape, Lattice lattice) {
    const std::array<int, 3> planes = planes_of(shape, lattice);
    std::vector<double> images;
    for (std::size_t n = 0; n < count_of(shape); ++n) {
        const std::array<int, 3> at = planes_of_sample(n, shape, lattice);
        double number = 1.0;
        for (std::size_t axis = 0; axis < 3; ++axis) {
            number *= at[axis] == 0 || at[axis] == planes[axis] - 1 ? 1.0 : 2.0;
        }
        images.push_back(number);
    }
    return images;
}

/// By Cholesky's factors.
std::vector<double> dense_solution(std::vector<double> matrix, std::vector<double> right) {
    const std::size_t n = right.size();
    for (std::size_t c = 0; c < n; ++c) {
        for (std::size_t r = c; r < n; ++r) {
            double sum = matrix[r * n + c];
            for (std::size_t m = 0; m < c; ++m) {
                sum -= matrix[r * n + m] * matrix[c * n + m];
            }
            matrix[r * n + c] = r == c ? std::sqrt(sum) : sum / matrix[c * n + c];
        }
    }
    for (std::size_t r = 0; r < n; ++r) {
        for (std::size_t m = 0; m < r; ++m) {
            right[r] -= matrix[r * n + m] * right[m];
        }
        right[r] /= matrix[r * n + r];
    }
    for (std::size_t r = n; r-- > 0;) {
        for (std::size_t m = r + 1; m < n; ++m) {
            right[r] -= matrix[m * n + r] * right[m];
        }
        right[r] /= matrix[r * n + r];
    }
    return right;
}

std::vector<double> wide(const SampleArray& samples) {
    return std::visit([](const auto& array) { return std::vector<double>(array.begin(), array.end()); }, samples);
}

double largest(const std::vector<double>& values) {
    double found = 0.0;
    for (const double value : values) {
        found = std::max(found, std::abs(value));
    }
    return found;
}

double largest_difference(const std::vector<double>& a, const std::vector<double>& b) {
    double found = 0.0;
    for (std::size_t n = 0; n < a.size(); ++n) {
        found = std::max(found, std::abs(a[n] - b[n]));
    }
    return found;
}

std::vector<double> product(const std::vector<double>& matrix, const std::vector<double>& vector) {
    std::vector<double> sums(vector.size(), 0.0);
    for (std::size_t r = 0; r < vector.size(); ++r) {
        for (std::size_t c = 0; c < vector.size(); ++c) {
            sums[r] += matrix[r * vector.size() + c] * vector[c];
        }
    }
    return sums;
}

constexpr Shape shapes[] = {{1, 1, 1}, {1, 1, 9}, {1, 7, 1}, {8, 1, 1}, {1, 6, 7}, {5, 1, 4},  {4, 5, 1}, {2, 2, 2},
                            {2, 5, 6}, {5, 2, 6}, {6, 5, 2}, {3, 3, 3}, {6, 7, 5}, {2, 3, 70}, {70, 3, 2}};
constexpr std::pair<double, double> kernels[] = {{2.0, 5.0}, {2.5, 7.0}, {3.0, 8.0},  {1.5, 4.0},
                                                 {1.0, 3.0}, {0.4, 5.0}, {2.0, 20.0}, {4.0, 16.0}};
constexpr Lattice lattices[] = {Lattice::cartesian, Lattice::bcc};

class InstructionSetChoice {
  public:
    explicit InstructionSetChoice(const std::string& name) { choose_instruction_set(name); }
    ~InstructionSetChoice() { choose_instruction_set(""); }
    InstructionSetChoice(const InstructionSetChoice&) = delete;
    InstructionSetChoice& operator=(const InstructionSetChoice&) = delete;
};

/// Expects what the prefilter finds with every instruction set. matrix: sums of kernels at samples; counted: samples
/// less their base; expected: the matrix's solution.
void expect_coefficients(const std::vector<float>& samples, const std::vector<double>& counted, const Shape& shape,
                         const RegularFieldOptions& options, const std::vector<double>& matrix,
                         const std::vector<double>& expected) {
    const std::string lattice = options.lattice == Lattice::bcc ? "bcc " : "cartesian ";
    const std::string where = lattice + std::to_string(options.radius) + " " + std::to_string(options.falloff) + " " +
                              std::to_string(shape[0]) + " " + std::to_string(shape[1]) + " " +
                              std::to_string(shape[2]);
    const std::vector<std::string> all = instruction_sets();
    const bool in_use = options.radius == 2.5;
    for (const std::string& set : in_use ? all : std::vector<std::string>{all.front()}) {
        SCOPED_TRACE(where + " " + set);
        const InstructionSetChoice choice(set);
        const PrefilteredSamples narrow = prefiltered(samples, shape, options);
        EXPECT_LE(largest_difference(wide(narrow.coefficients), expected), 1e-6 * largest(expected));
        const std::vector<double> sums = product(matrix, wide(narrow.coefficients));
        EXPECT_NEAR(largest_difference(sums, counted) / largest(counted), narrow.figures.residual, 1e-12);
        const PrefilteredSamples exact = prefiltered(wide(samples), shape, options);
        ASSERT_TRUE(std::holds_alternative<std::vector<double>>(exact.coefficients));
        EXPECT_LE(largest_difference(wide(exact.coefficients), expected), 2e-11 * largest(expected));
        if (in_use) {
            EXPECT_LE(narrow.figures.steps, 12);
        }
    }
}

TEST(Prefilter, CoefficientsAreThoseOfTheDenseMatrix) {
    for (const Lattice lattice : lattices) {
        for (const auto& [radius, falloff] : kernels) {
            const RegularFieldOptions options = options_of(lattice, radius, falloff);
            for (const Shape& shape : shapes) {
                const std::vector<float> samples = noise<float>(count_of(shape), 50.0);
                const std::vector<double> matrix = matrix_of(shape, options);
                const std::vector<double> expected = dense_solution(matrix, wide(samples));
                expect_coefficients(samples, wide(samples), shape, options, matrix, expected);
            }
        }
    }
}

TEST(Prefilter, MirroredCoefficientsAreThoseOfTheDenseMatrix) {
    for (const Lattice lattice : lattices) {
        for (const auto& [radius, falloff] : kernels) {
            RegularFieldOptions options = options_of(lattice, radius, falloff);
            options.boundary = Boundary::edge;
            options.base = 12.5;
            for (const Shape& shape : shapes) {
                if (lattice == Lattice::bcc && shape[0] == 1) {
                    continue;
                }
                const std::vector<float> samples = noise<float>(count_of(shape), 50.0);
                std::vector<double> counted = wide(samples);
                for (double& value : counted) {
                    value -= *options.base;
                }
                const std::vector<double> matrix = mirrored_matrix_of(shape, options);
                const std::vector<double> images = images_in_a_period(shape, lattice);
                std::vector<double> symmetric = matrix, right = counted;
                for (std::size_t row = 0; row < right.size(); ++row) {
                    right[row] *= images[row];
                    for (std::size_t column = 0; column < right.size(); ++column) {
                        symmetric[row * right.size() + column] *= images[row];
                    }
                }
                for (std::size_t row = 0; row < right.size(); ++row) {
                    for (std::size_t column = 0; column < row; ++column) {
                        ASSERT_NEAR(symmetric[row * right.size() + column], symmetric[column * right.size() + row],
                                    1e-12);
                    }
                }
                const std::vector<double> expected = dense_solution(symmetric, right);
                expect_coefficients(samples, counted, shape, options, matrix, expected);
            }
        }
    }
}

/// Largest distance of a field's scalar from the samples that it was given, over the largest |f - b|.
double distance_at_samples(const RegularField& field) {
    const Shape& shape = field.shape();
    std::vector<Vec3> points;
    for (std::size_t k = 0; k < shape[0]; ++k) {
        for (std::size_t j = 0; j < shape[1]; ++j) {
            for (std::size_t i = 0; i < shape[2]; ++i) {
                points.push_back(field.position(i, j, k));
            }
        }
    }
    const std::vector<double> given = wide(field.given_samples());
    const std::vector<FieldSums> sums = field_sums(field, points);
    double away = 0.0, scale = 0.0;
    for (std::size_t n = 0; n < given.size(); ++n) {
        scale = std::max(scale, std::abs(given[n] - field.base()));
        // (Subtracted first: rho itself has no digits to spare.)
        away = std::max(away, std::abs(sums[n].values - (given[n] - field.base())));
    }
    return away / scale;
}

/// Samples around a base, up to 300 away from it.
SampleArray samples_around(double base, std::size_t count, std::size_t kind) {
    const auto made = [&](auto zero) {
        std::vector<decltype(zero)> samples;
        for (const double value : noise<double>(count, 300.0)) {
            samples.push_back(static_cast<decltype(zero)>(base + value));
        }
        return SampleArray(std::move(samples));
    };
    return kind == 0 ? made(0.0F) : kind == 1 ? made(0.0) : made(std::int16_t{0});
}

TEST(Prefilter, SumsPassThroughEverySample) {
    constexpr std::size_t sizes[] = {1, 2, 3, 5, 64};
    std::vector<Shape> all{{64, 3, 64}, {5, 64, 64}, {64, 64, 1}};
    for (const std::size_t k : sizes) {
        for (const std::size_t j : sizes) {
            for (const std::size_t i : sizes) {
                if ((k == 64) + (j == 64) + (i == 64) <= 1) {
                    all.push_back({k, j, i});
                }
            }
        }
    }
    std::size_t turn = 0;
    for (const Lattice lattice : lattices) {
        for (const auto& [radius, falloff] : {kernels[0], kernels[1], kernels[2]}) {
            for (const Boundary boundary : {Boundary::edge, Boundary::zero}) {
                for (const Shape& shape : all) {
                    const std::size_t kind = turn++ % 3;
                    const double base = kind == 2 || turn % 2 == 0 ? -1000.0 : 101300.0;
                    RegularFieldOptions options = options_of(lattice, radius, falloff);
                    options.spacing = {0.3, 0.7, 1.1};
                    options.origin = {5.0, -2.0, 1.0};
                    options.boundary = boundary;
                    options.base = base;
                    const RegularField field(samples_around(base, count_of(shape), kind), shape, options);
                    EXPECT_EQ(field.counted_from(), 0.0);
                    EXPECT_EQ(field.domain().has_value(),
                              boundary == Boundary::edge && !(lattice == Lattice::bcc && shape[0] == 1));
                    const double away = distance_at_samples(field);
                    EXPECT_LE(away, kind == 1 ? 1e-11 : worst_prefilter_residual)
                        << (lattice == Lattice::bcc ? "bcc " : "cartesian ") << radius << " "
                        << (boundary == Boundary::edge ? "edge " : "zero ") << shape[0] << " " << shape[1] << " "
                        << shape[2] << " kind " << kind;
                    EXPECT_NEAR(away, field.prefilter()->residual, 1e-11);
                }
            }
        }
    }
}

TEST(Prefilter, CoefficientsOfOneBoundaryDoNotSuitTheOther) {
    // The control: what the test of sums would say of coefficients that know nothing of mirrored samples.
    const Shape shape{12, 5, 7};
    for (const Lattice lattice : lattices) {
        for (const Boundary boundary : {Boundary::edge, Boundary::zero}) {
            RegularFieldOptions options = options_of(lattice, 2.5, 7.0), other = options;
            options.base = other.base = 101300.0;
            options.boundary = boundary;
            other.boundary = boundary == Boundary::edge ? Boundary::zero : Boundary::edge;
            const SampleArray samples = samples_around(101300.0, count_of(shape), 0);
            const RegularField right(samples, prefiltered(samples, shape, options), shape, options);
            const RegularField wrong(samples, prefiltered(samples, shape, other), shape, options);
            EXPECT_LE(distance_at_samples(right), worst_prefilter_residual);
            EXPECT_GT(distance_at_samples(wrong), 0.05);
            other = options;
            other.base = 101310.0;
            const RegularField counted_wrongly(samples, prefiltered(samples, shape, other), shape, options);
            EXPECT_GT(distance_at_samples(counted_wrongly), 0.02);
        }
    }
}

TEST(Prefilter, ABaseIsOnlyWhereCountingBegins) {
    const Shape shape{9, 6, 11};
    for (const Lattice lattice : lattices) {
        for (const Boundary boundary : {Boundary::edge, Boundary::zero}) {
            RegularFieldOptions options = options_of(lattice, 2.5, 7.0);
            options.boundary = boundary;
            options.base = 0.0;
            std::vector<float> whole = noise<float>(count_of(shape), 300.0);
            for (float& value : whole) {
                value = std::round(value);
            }
            const PrefilteredSamples first = prefiltered(whole, shape, options);
            options.base.reset();
            EXPECT_EQ(prefiltered(whole, shape, options).coefficients, first.coefficients);
            const std::vector<float> rough = noise<float>(count_of(shape), 300.0);
            const std::vector<double> of_rough = wide(prefiltered(rough, shape, options).coefficients);
            for (const double base : {101300.0, -1000.0, 1024.0}) {
                options.base = base;
                std::vector<float> moved = whole;
                std::vector<double> moved_rough = wide(rough);
                for (std::size_t n = 0; n < moved.size(); ++n) {
                    moved[n] += static_cast<float>(base);
                    moved_rough[n] += base;
                }
                EXPECT_EQ(prefiltered(moved, shape, options).coefficients, first.coefficients) << base;
                if (std::abs(base) < 3e4) {
                    const std::vector<std::int16_t> integers(moved.begin(), moved.end());
                    EXPECT_EQ(prefiltered(integers, shape, options).coefficients, first.coefficients) << base;
                }
                const std::vector<double> found = wide(prefiltered(moved_rough, shape, options).coefficients);
                EXPECT_LE(largest_difference(found, of_rough), 1e-6 * largest(of_rough)) << base;
            }
            // What has nowhere a value other than the base has no coefficients, of whatever type it is.
            options.base = 101300.0;
            const PrefilteredSamples none = prefiltered(std::vector<float>(count_of(shape), 101300.0F), shape, options);
            ASSERT_TRUE(std::holds_alternative<std::vector<float>>(none.coefficients));
            EXPECT_EQ(largest(wide(none.coefficients)), 0.0);
            EXPECT_EQ(none.figures.residual, 0.0);
            options.base = 200.0;
            EXPECT_EQ(largest(wide(
                          prefiltered(std::vector<std::uint8_t>(count_of(shape), 200), shape, options).coefficients)),
                      0.0);
            // Bytes reach neither their base nor the differences from it.
            options.base = 1e30;
            const PrefilteredSamples far = prefiltered(std::vector<std::uint8_t>(count_of(shape), 3), shape, options);
            EXPECT_TRUE(std::holds_alternative<std::vector<double>>(far.coefficients));
        }
    }
}

TEST(Prefilter, AConstantVolumeThatIsMirroredHasConstantCoefficients) {
    for (const Lattice lattice : lattices) {
        RegularFieldOptions options = options_of(lattice, 2.5, 7.0);
        options.boundary = Boundary::edge;
        const Shape shape{6, 5, 40};
        const std::vector<double> found =
            wide(prefiltered(std::vector<double>(count_of(shape), 7.0), shape, options).coefficients);
        const auto [low, high] = std::minmax_element(found.begin(), found.end());
        EXPECT_GT(*low, 0.0);
        EXPECT_LE(*high - *low, 1e-11 * *high);
    }
    // The mirrors of a BCC lattice need two layers: one layer has the same coefficients with either boundary.
    RegularFieldOptions options = options_of(Lattice::bcc, 2.5, 7.0);
    const Shape layer{1, 8, 9};
    const std::vector<float> samples = noise<float>(count_of(layer));
    const SampleArray expected = prefiltered(samples, layer, options).coefficients;
    options.boundary = Boundary::edge;
    EXPECT_EQ(prefiltered(samples, layer, options).coefficients, expected);
}

TEST(Prefilter, FieldsThatShareCoefficientsAgree) {
    const Shape shape{6, 7, 9};
    const SampleArray samples = samples_around(101300.0, count_of(shape), 0);
    for (const Lattice lattice : lattices) {
        RegularFieldOptions options = options_of(lattice, 2.5, 7.0);
        options.boundary = Boundary::edge;
        const RegularField field(samples, shape, options);
        EXPECT_NEAR(field.base(), 101300.0, 10.0);
        EXPECT_EQ(field.normalization(), Normalization::none);
        // Coefficients row by row, without the mirrored ones that the field keeps at the ends of its rows.
        RegularFieldOptions resolved = options;
        resolved.base = field.base();
        PrefilteredSamples found = prefiltered(samples, shape, resolved);
        for (std::size_t n = 0, k = 0; k < shape[0]; ++k) {
            for (std::size_t j = 0; j < shape[1]; ++j) {
                for (std::size_t i = 0; i < shape[2]; ++i) {
                    EXPECT_EQ(field.value(i, j, k), wide(found.coefficients)[n++]);
                }
            }
        }
        // Beside samples and coefficients, with the mirrored ones at the ends of rows, it keeps hardly anything.
        const std::size_t kept = wide(field.samples()).size() + count_of(shape);
        EXPECT_EQ(wide(field.samples()).size(), shape[0] * shape[1] * (shape[2] + 2 * field.mirrored()[2]));
        EXPECT_LE(field.memory(), sizeof(RegularField) + sizeof(float) * kept + 512);
        // With the options as they were given, and as the field has them, whose normalisation is `none`.
        for (const RegularFieldOptions& given : {options, field.options()}) {
            const RegularField again(samples, found, shape, given);
            EXPECT_EQ(again.base(), field.base());
            EXPECT_EQ(again.samples(), field.samples());
            EXPECT_EQ(again.value_range(), field.value_range());
            EXPECT_EQ(again.domain().has_value(), true);
            EXPECT_EQ(distance_at_samples(again), distance_at_samples(field));
        }
        const auto mirrored = field.with_mirrored();
        EXPECT_EQ(mirrored->counted_from(), 0.0);
        EXPECT_EQ(mirrored->base(), field.base());
        // Without an end it is a field of its own, of the samples themselves.
        const auto endless = field.without_end();
        options.boundary = Boundary::zero;
        EXPECT_EQ(endless->base(), 0.0);
        EXPECT_FALSE(endless->domain());
        EXPECT_EQ(endless->mirrored(), (Shape{0, 0, 0}));
        EXPECT_EQ(endless->samples(), prefiltered(samples, shape, options).coefficients);
        EXPECT_EQ(endless->given_samples(), samples);
        EXPECT_LE(distance_at_samples(*endless), worst_prefilter_residual);
    }
}

TEST(Prefilter, TheToleranceTellsCoefficientsApart) {
    // The control: samples themselves are no coefficients, and neither are those of a slightly different kernel.
    const Shape shape{6, 7, 5};
    const std::vector<float> samples = noise<float>(count_of(shape));
    const RegularFieldOptions options = options_of(Lattice::cartesian, 2.0, 5.0);
    const std::vector<double> expected = dense_solution(matrix_of(shape, options), wide(samples));
    EXPECT_GT(largest_difference(wide(samples), expected), 0.1 * largest(expected));
    const PrefilteredSamples other = prefiltered(samples, shape, options_of(Lattice::cartesian, 2.0, 5.0001));
    EXPECT_GT(largest_difference(wide(other.coefficients), expected), 1e-6 * largest(expected));
}

TEST(Prefilter, TakesEveryTypeOfSamples) {
    const Shape shape{5, 4, 6};
    std::vector<std::uint8_t> bytes(count_of(shape));
    for (std::size_t n = 0; n < bytes.size(); ++n) {
        bytes[n] = static_cast<std::uint8_t>(n * 37 % 251);
    }
    const SampleArray others[] = {bytes, std::vector<std::int16_t>(bytes.begin(), bytes.end()),
                                  std::vector<std::uint16_t>(bytes.begin(), bytes.end()),
                                  std::vector<float>(bytes.begin(), bytes.end())};
    for (const Lattice lattice : lattices) {
        const PrefilteredSamples first = prefiltered(others[0], shape, options_of(lattice, 2.5, 7.0));
        ASSERT_TRUE(std::holds_alternative<std::vector<float>>(first.coefficients));
        for (const SampleArray& samples : others) {
            EXPECT_EQ(prefiltered(samples, shape, options_of(lattice, 2.5, 7.0)).coefficients, first.coefficients);
        }
        const PrefilteredSamples zeros =
            prefiltered(std::vector<std::uint8_t>(count_of(shape)), shape, options_of(lattice, 2.0, 5.0));
        EXPECT_EQ(largest(wide(zeros.coefficients)), 0.0);
        EXPECT_EQ(zeros.figures.residual, 0.0);
    }
}

TEST(Prefilter, BitsDoNotDependOnThreads) {
    const Shape shape{40, 37, 45};
    const std::vector<float> samples = noise<float>(count_of(shape));
    for (const Lattice lattice : lattices) {
        for (const Boundary boundary : {Boundary::edge, Boundary::zero}) {
            RegularFieldOptions options = options_of(lattice, 2.5, 7.0);
            options.boundary = boundary;
            options.base = boundary == Boundary::edge ? 0.3 : 0.0;
            const PrefilteredSamples one = prefiltered(samples, shape, options, {1});
            EXPECT_LE(one.figures.residual, worst_prefilter_residual);
            for (const int threads : {2, 3, 7}) {
                const PrefilteredSamples many = prefiltered(samples, shape, options, {threads});
                EXPECT_EQ(many.coefficients, one.coefficients) << threads;
                EXPECT_EQ(many.figures.residual, one.figures.residual);
                EXPECT_EQ(many.figures.steps, one.figures.steps);
            }
        }
    }
}

TEST(Prefilter, PowersOfTwoAreExact) {
    const Shape shape{5, 6, 7};
    const std::vector<double> samples = noise<double>(count_of(shape));
    for (const Lattice lattice : lattices) {
        const auto first = wide(prefiltered(samples, shape, options_of(lattice, 2.0, 5.0)).coefficients);
        for (const int exponent : {-900, 40, 600}) {
            std::vector<double> scaled = samples;
            for (double& sample : scaled) {
                sample = std::ldexp(sample, exponent);
            }
            auto found = wide(prefiltered(scaled, shape, options_of(lattice, 2.0, 5.0)).coefficients);
            for (double& coefficient : found) {
                coefficient = std::ldexp(coefficient, -exponent);
            }
            EXPECT_EQ(found, first) << exponent;
        }
    }
}

TEST(Prefilter, CanBeCancelled) {
    const Shape shape{32, 33, 34};
    const SampleArray samples = noise<float>(count_of(shape));
    for (const Lattice lattice : lattices) {
        EXPECT_THROW(RegularField(samples, shape, options_of(lattice, 2.5, 7.0), [](double) { return false; }),
                     Cancelled);
        const PollScope scope([] { throw Cancelled(); });
        EXPECT_THROW(static_cast<void>(prefiltered(samples, shape, options_of(lattice, 2.5, 7.0), {2})), Cancelled);
    }
}

TEST(Prefilter, AFieldKeepsWhatItWasGiven) {
    const Shape shape{6, 5, 7};
    const std::vector<std::uint16_t> samples(count_of(shape), 300);
    RegularFieldOptions options = options_of(Lattice::cartesian, 2.0, 5.0);
    const RegularField field(samples, shape, options);
    EXPECT_EQ(std::get<std::vector<std::uint16_t>>(field.given_samples()), samples);
    EXPECT_EQ(field.given_range(), (std::array<double, 2>{300.0, 300.0}));
    EXPECT_EQ(field.normalization(), Normalization::none);
    EXPECT_EQ(field.options().normalization, Normalization::none);
    ASSERT_TRUE(field.prefilter());
    EXPECT_NEAR(field.prefilter()->condition, 43.9, 0.1);
    EXPECT_EQ(field.prefilter()->condition, prefilter_condition(Lattice::cartesian, 2.0, 5.0));
    EXPECT_EQ(field.samples(), prefiltered(samples, shape, options).coefficients);
    EXPECT_LT(field.value_range()[0], field.value_range()[1]);
    const RegularField again(field.given_samples(), {field.samples(), *field.prefilter()}, shape, options);
    EXPECT_EQ(again.samples(), field.samples());
    EXPECT_EQ(again.given_samples(), field.given_samples());
    EXPECT_EQ(again.prefilter()->residual, field.prefilter()->residual);
    EXPECT_EQ(again.normalization(), Normalization::none);
    EXPECT_THROW(RegularField(field.given_samples(), {std::vector<float>(3), {}}, shape, options), InvalidInput);
    options.prefilter = false;
    const RegularField plain(samples, shape, options);
    EXPECT_FALSE(plain.prefilter());
    EXPECT_EQ(&plain.given_samples(), &plain.samples());
    EXPECT_EQ(plain.given_range(), plain.value_range());
    EXPECT_GE(field.memory(), plain.memory() + 4 * count_of(shape));
}

TEST(Prefilter, RefusesWhatItCannotDo) {
    const Shape shape{4, 4, 4};
    const auto refused = [&](std::vector<double> samples, const RegularFieldOptions& options) {
        return message_of<InvalidInput>([&] { const RegularField field(std::move(samples), shape, options); });
    };
    const std::vector<double> ones(count_of(shape), 1.0);
    RegularFieldOptions options = options_of(Lattice::cartesian, 2.0, 5.0);
    options.normalization = Normalization::threshold;
    EXPECT_NE(refused(ones, options).find("passes through no sample"), std::string::npos);
    options = options_of(Lattice::bcc, 2.0, 5.0);
    std::vector<double> hole = ones;
    hole[16 + 2 * 4 + 3] = std::numeric_limits<double>::quiet_NaN();
    EXPECT_NE(refused(hole, options).find("NaN at sample [1, 2, 3]"), std::string::npos);
    options.nan = NanPolicy::skip;
    EXPECT_NE(refused(hole, options).find("leaves out"), std::string::npos);
    EXPECT_NO_THROW(RegularField(ones, shape, options)) << "there is no NaN to skip";
    hole[16 + 2 * 4 + 3] = std::numeric_limits<double>::infinity();
    EXPECT_NE(refused(hole, options).find("infinity at sample [1, 2, 3]"), std::string::npos);
    for (const Lattice lattice : lattices) {
        EXPECT_NE(refused(ones, options_of(lattice, 3.0, 1.0)).find("whose spectrum goes from -"), std::string::npos);
        EXPECT_NE(refused(ones, options_of(lattice, 17.0, 500.0)).find("at most 16"), std::string::npos);
    }
    EXPECT_NE(refused(ones, options_of(Lattice::cartesian, 3.5, 8.0)).find("the condition number"), std::string::npos);
    EXPECT_NE(refused(ones, options_of(Lattice::cartesian, -1.0, 8.0)).find("radius"), std::string::npos);
    EXPECT_THROW(static_cast<void>(prefiltered(ones, shape, options_of(Lattice::cartesian, 3.0, 8.0), {1, 1})), Error);
}

} // namespace
} // namespace sheetsplat

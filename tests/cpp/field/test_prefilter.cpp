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
#include "support.hpp"

namespace sheetsplat {
namespace {

using test::message_of;
using Shape = std::array<std::size_t, 3>;

std::size_t count_of(const Shape& shape) { return shape[0] * shape[1] * shape[2]; }

RegularFieldOptions options_of(Lattice lattice, double radius, double falloff) {
    RegularFieldOptions options;
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

TEST(Prefilter, CoefficientsAreThoseOfTheDenseMatrix) {
    for (const Lattice lattice : lattices) {
        for (const auto& [radius, falloff] : kernels) {
            const RegularFieldOptions options = options_of(lattice, radius, falloff);
            for (const Shape& shape : shapes) {
                const std::vector<float> samples = noise<float>(count_of(shape), 50.0);
                const std::vector<double> matrix = matrix_of(shape, options);
                const std::vector<double> expected = dense_solution(matrix, wide(samples));
                const std::string where = std::string(lattice == Lattice::bcc ? "bcc" : "cartesian") + " " +
                                          std::to_string(radius) + " " + std::to_string(falloff) + " " +
                                          std::to_string(shape[0]) + " " + std::to_string(shape[1]) + " " +
                                          std::to_string(shape[2]);
                const std::vector<std::string> all = instruction_sets();
                const bool in_use = radius == 2.5;
                for (const std::string& set : in_use ? all : std::vector<std::string>{all.front()}) {
                    const InstructionSetChoice choice(set);
                    const PrefilteredSamples narrow = prefiltered(samples, shape, options);
                    EXPECT_LE(largest_difference(wide(narrow.coefficients), expected), 1e-6 * largest(expected))
                        << where << " " << set;
                    const std::vector<double> sums = product(matrix, wide(narrow.coefficients));
                    EXPECT_NEAR(largest_difference(sums, wide(samples)) / largest(wide(samples)),
                                narrow.figures.residual, 1e-12)
                        << where << " " << set;
                    const PrefilteredSamples exact = prefiltered(wide(samples), shape, options);
                    ASSERT_TRUE(std::holds_alternative<std::vector<double>>(exact.coefficients));
                    EXPECT_LE(largest_difference(wide(exact.coefficients), expected), 2e-11 * largest(expected))
                        << where << " " << set;
                    if (in_use) {
                        EXPECT_LE(narrow.figures.steps, 12) << where << " " << set;
                    }
                }
            }
        }
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
        const PrefilteredSamples one = prefiltered(samples, shape, options_of(lattice, 2.5, 7.0), {1});
        EXPECT_LE(one.figures.residual, worst_prefilter_residual);
        for (const int threads : {2, 3, 7}) {
            const PrefilteredSamples many = prefiltered(samples, shape, options_of(lattice, 2.5, 7.0), {threads});
            EXPECT_EQ(many.coefficients, one.coefficients) << threads;
            EXPECT_EQ(many.figures.residual, one.figures.residual);
            EXPECT_EQ(many.figures.steps, one.figures.steps);
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

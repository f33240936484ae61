// What each way of drawing keeps its error bound for: one table (limits.cpp), walked by one loop.
#pragma once

#include <array>
#include <cmath>
#include <limits>
#include <optional>
#include <string>
#include <vector>

#include "error_model.hpp"
#include "plan/make_plan.hpp"
#include "sheetsplat/error.hpp"

namespace sheetsplat {

/// Ways of drawing. The last two narrow `sheets`: OpenGL before 4.0, which has no float64, and the effect
/// paper_slicing.
enum class Way { float32, float64, sheets, old_sheets, papers };
constexpr std::size_t ways = 5;

/// What limits are measured by.
struct Measures {
    const Scene& scene;
    const ViewFacts& view;
    const DrawPlan& plan;
    SumFacts sums;
    double epsilon = float32_epsilon;
    const Capabilities* device = nullptr; ///< of backend gl
};

/// Not measured, where a limit does not apply, and no limit.
constexpr double none = std::numeric_limits<double>::quiet_NaN();

/// A quantity, and the most, or the least, of it that each way of drawing keeps its error bound for.
struct Limit {
    enum class Sense { most, least };

    const char* name;
    Sense sense;
    std::array<double, ways> ends; ///< by Way
    const char* found; ///< a noun; {} stands for the number, its word and what follows for its unit; {largest} and
                       ///< {resolved} for SumFacts'
    Words advice;
    double (*measure)(const Measures&);
    bool counted = false; ///< of things that programs and buffers hold: allow_inexact does not help

    [[nodiscard]] bool keeps(double number, Way way) const {
        const double end = ends[static_cast<std::size_t>(way)];
        // (Which raise nothing where a number is none.)
        return !(sense == Sense::most ? std::isgreater(number, end) : std::isless(number, end));
    }
};

const std::vector<Limit>& limits();

/// A limit that a scene is beyond.
struct Beyond {
    const Limit* limit;
    std::string found;  ///< "ellipsoids of 1:600"
    std::string wanted; ///< "at most 1:512"
};

/// The first limit of the table that the scene is beyond; empty scenes are beyond none but those of counts.
std::optional<Beyond> first_beyond(const Measures& measures, Way way, bool counts_alone = false);

/// Throws Unsupported where the scene is beyond a limit; with allow_inexact, of counts alone.
void refuse_beyond(const Measures& measures, Way way, bool allow_inexact);

} // namespace sheetsplat

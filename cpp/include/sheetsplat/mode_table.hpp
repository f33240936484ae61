// The one list of modes: what each makes of the slices along a ray, and how its pictures are told of. The engine and
// Python ask for these traits instead of comparing modes. Source: conventions, section 7.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

namespace sheetsplat {

/// How the slices of a ray become one pixel.
enum class Fold : std::uint8_t {
    opacities, ///< slices are classified, and composited from front to back
    surfaces,  ///< crossings of iso values are composited
    sum,       ///< from here on the scalar itself, a number a pixel: the sum over slices
    largest,
    smallest,
};
constexpr const char* to_string(Fold fold) {
    constexpr std::array names{"opacities", "surfaces", "sum", "largest", "smallest"};
    return names[static_cast<std::size_t>(fold)];
}

// X(name, fold, counts, mean, integrates, what its numbers are of the field's values, its name in the viewer, meaning).
// Flags: see ModeTraits. What numbers are: empty of colours, and where they have a unit of their own.
// clang-format off
#define SHEETSPLAT_MODES(X) \
    X(composite,  opacities, no,  no,  no,  "", "Volume", "composited colours") \
    X(isosurface, surfaces,  no,  no,  no,  "", "Isosurface", "surfaces of equal value") \
    X(mip,        largest,   yes, no,  no,  "largest", "Maximum (MIP)", "the maximum of the scalar along the ray") \
    X(minimum,    smallest,  yes, no,  no,  "smallest", "Minimum", "its minimum") \
    X(average,    sum,       yes, yes, no,  "mean", "Average", "its average") \
    X(xray,       sum,       no,  no,  yes, "", "X-ray (integral)", "or its integral")
// clang-format on

enum class Mode : std::uint8_t {
#define SHEETSPLAT_MODE_NAME(name, ...) name,
    SHEETSPLAT_MODES(SHEETSPLAT_MODE_NAME)
#undef SHEETSPLAT_MODE_NAME
};

struct ModeTraits {
    Mode mode;
    const char* name;
    Fold fold;
    bool counts;     ///< only slices that kernels reach count; a pixel without one is no number (else: 0)
    bool mean;       ///< the sum is divided by how many slices count
    bool integrates; ///< slices count by the length of the ray in them, world units
    const char* of_values;
    const char* label;
    const char* meaning;
};

#define SHEETSPLAT_MODE_ENTRY(name, fold, ...) ModeTraits{Mode::name, #name, Fold::fold, __VA_ARGS__},
constexpr std::array mode_table = [] {
    constexpr bool no = false, yes = true;
    return std::array{SHEETSPLAT_MODES(SHEETSPLAT_MODE_ENTRY)};
}();
#undef SHEETSPLAT_MODE_ENTRY

constexpr const ModeTraits& traits_of(Mode mode) { return mode_table[static_cast<std::size_t>(mode)]; }

} // namespace sheetsplat

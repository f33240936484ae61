// The one list of backends: what each can do. The engine and Python ask for abilities instead of comparing names.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

namespace sheetsplat {

/// What a backend can do, or does.
enum class Ability : std::uint8_t {
    defines,          ///< it draws the scene itself in the one way that defines pictures: slowly, in float64
    exact,            ///< it draws in float64 what others would lose to rounding; it is there on every machine
    tiles,            ///< it draws chosen tiles of a picture alone
    ways,             ///< it has several ways of tagging, packing and drawing tiles
    tells_reach,      ///< it knows from the places of samples which points kernels reach
    filters_lattices, ///< it draws the filtered kernels of lattices as those of lattices, and not one by one
    start_cells,      ///< it walks the cells of grids from start cells on
};
constexpr std::size_t abilities = 7;

// X(name, interface of its devices, abilities, precisions, pixels of kernels in slices, slices of kernels and pixels of
// slices a second, what a device's name holds that has these rates: empty, all).
// clang-format off
#define SHEETSPLAT_BACKENDS(X) \
    X(gl,        "OpenGL",    bit(A::ways) | bit(A::start_cells), "uint8 float16 float32", 2.5e8, 2e8, 1.2e8, "llvmpipe") \
    X(cpu,       "processor", bit(A::exact) | bit(A::tiles) | bit(A::tells_reach) | bit(A::filters_lattices), "float32 float64", 3e9, 2e8, 1.2e9, "") \
    X(reference, "processor", bit(A::defines), "float64", 5e7, 5e7, 5e7, "")
// clang-format on

/// A value for each row of the table, in its order, and `automatic`: one that is chosen.
enum class Backend : std::uint8_t {
    automatic,
#define SHEETSPLAT_BACKEND_NAME(name, ...) name,
    SHEETSPLAT_BACKENDS(SHEETSPLAT_BACKEND_NAME)
#undef SHEETSPLAT_BACKEND_NAME
};

struct BackendTraits {
    Backend backend;
    const char* name;
    const char* interface;
    unsigned abilities; ///< a bit each
    const char* precisions;
    /// Measured on two cores of 2023 with AVX2: volumes of 64 to 256 samples an edge, radii of 2 to 20 samples, 90,000
    /// to 2,560,000 pixels, and 500 to 1,000,000 ellipsoids, within a factor of 3.
    double pixels, sections, points;
    const char* rated_device;
};

constexpr unsigned bit(Ability ability) { return 1U << static_cast<unsigned>(ability); }

#define SHEETSPLAT_BACKEND_ENTRY(name, ...) BackendTraits{Backend::name, #name, __VA_ARGS__},
constexpr std::array backend_table = [] {
    using A = Ability;
    return std::array{SHEETSPLAT_BACKENDS(SHEETSPLAT_BACKEND_ENTRY)};
}();
#undef SHEETSPLAT_BACKEND_ENTRY

/// Place of a backend in the table; not of `automatic`.
constexpr std::size_t index_of(Backend backend) { return static_cast<std::size_t>(backend) - 1; }
constexpr const BackendTraits& traits_of(Backend backend) { return backend_table[index_of(backend)]; }
constexpr bool can(Backend backend, Ability ability) { return (traits_of(backend).abilities & bit(ability)) != 0; }

/// The first backend with an ability.
constexpr Backend backend_that(Ability ability) {
    for (const BackendTraits& traits : backend_table) {
        if (can(traits.backend, ability)) {
            return traits.backend;
        }
    }
    return Backend::automatic;
}

} // namespace sheetsplat

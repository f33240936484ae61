// How far light in the picture of a whole that is drawn in parts is from its definition: what parts say of it, in two
// rounds, where one process looks along whole lines (light/light_error.hpp). Source: conventions, sections 10 and 11.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "sheetsplat/types.hpp"

namespace sheetsplat {

/// Which pixels of a picture are looked at, in their order, and how many.
struct ProbePixels {
    std::vector<std::array<int, 2>> pixels; ///< column and row; as many as are tried at most
    std::size_t wanted = 0;                 ///< that show something
    std::size_t batch = 1;                  ///< tried between two looks at whether there are enough
    std::size_t every_occlusion = 1;        ///< of so many pixels one is looked at for occlusion
    double points = 0.0;                    ///< of a pixel, on the average
};
ProbePixels probe_pixels(Size size, bool surfaces);
/// What is stated over what was measured: other pixels may be worse than those that were looked at.
constexpr double light_reserve = 1.25;

/// What a pixel shows of a slice, an interval or a crossing.
struct LightSpot {
    std::size_t number = 0; ///< of the pixel, in probe_pixels
    std::int64_t slice = 0;
    double behind = 0.0; ///< how far it is on the way to the next slice, 0 ... 1
    std::size_t group = 0;
    Vec3 color{0.0};
    double share = 0.0;              ///< of the pixel, behind what the part shows in front of it
    std::array<double, 2> chances{}; ///< of the pixel: from 0 to 1, alike on every machine
    bool occlusion = false;          ///< it is looked at for occlusion
    bool own = true;                 ///< the part shows it
};

/// Numbers for each spot, those of all parts together: products, of surfaces sums, and the sums.
struct LightLines {
    bool absorbed = false;      ///< what lines say is a sum, of which 2^-sum of light is left; else a product
    std::size_t directions = 0; ///< towards the lights, and around the spot
    std::size_t lights = 0;
    std::vector<double> left; ///< spot by spot, of each direction
    /// Spot by spot, of each light and of what is open around: red, green and blue that all of it adds to a pixel of
    /// which the spot has the share 1; and how much of it the picture shows. 0 for spots of other parts.
    std::vector<double> shown;
};

} // namespace sheetsplat

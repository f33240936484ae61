// How far light in a picture is from its definition, measured at some of its pixels. Of a whole that is drawn in parts
// these say what they know, in two rounds, because lines from spots to lights leave the part that a spot is in. Source:
// conventions, sections 10 and 11.
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

    /// every_occlusion where some pixels show something: of few that do, one in so many are too few to tell.
    [[nodiscard]] std::size_t every(std::size_t seen) const { return seen <= wanted / 2 ? 1 : every_occlusion; }
};
ProbePixels probe_pixels(Size size, bool surfaces);

/// What a pixel shows of a slice, an interval or a crossing.
struct LightSpot {
    std::size_t number = 0; ///< of the pixel, in probe_pixels
    std::int64_t slice = 0;
    double behind = 0.0; ///< how far it is on the way to the next slice, 0 ... 1
    std::size_t group = 0;
    Vec3 color{0.0};
    double share = 0.0;              ///< of the pixel, behind what the part shows in front of it
    std::array<double, 2> chances{}; ///< of the pixel: from 0 to 1, alike on every machine
    std::size_t part = 0;            ///< that shows it
    bool occlusion = false;          ///< it is looked at for occlusion
    /// What it stands for in its pixel, twice, independently of each other.
    std::array<double, 2> stands_for{};
    double on_face = 0.0; ///< what the normal of a cut counts beside its own
};

/// Of the spots of a part those of pixels with few; of others `most` at equal steps of what they add, which add as
/// much.
std::vector<LightSpot> thinned(const std::vector<LightSpot>& spots, std::size_t most);
/// Spots at equal steps of what they add to their pixels, of those of all parts; behind the stop nothing adds anything.
/// Those that add more than a step are in both halves. points: of a pixel, on the average; every: one pixel of so many
/// is looked at for occlusion.
std::vector<LightSpot> choose_spots(std::vector<LightSpot> spots, double points, double opacity_stop,
                                    std::size_t every);

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

/// Root mean square errors over the picture (conventions, section 8).
struct LightErrors {
    double shadows = 0.0, occlusion = 0.0;
};
/// tried: pixels that were looked at.
LightErrors light_errors(const std::vector<LightSpot>& chosen, const LightLines& lines, std::size_t tried,
                         std::size_t every);

} // namespace sheetsplat

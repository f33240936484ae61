// What estimates from further pictures of a view share: some tiles of it, scenes with other settings, float64, and how
// far two pictures are apart. image.error, max_error and max_seconds, stages, and tiles that are drawn again ask here.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "sheetsplat/image.hpp"
#include "sheetsplat/renderer.hpp"
#include "sheetsplat/scene.hpp"

namespace sheetsplat {

struct DrawPlan;

/// Tiles of a picture that are drawn alone, on backend cpu; the others stay empty.
struct Excerpt {
    int edge = 0;                    ///< of a tile, pixels at most
    std::vector<std::uint8_t> drawn; ///< a flag a tile, row by row
    double pixels = 0.0;             ///< of the drawn ones
    std::size_t tiles = 0;           ///< how many are drawn
};

/// Some tiles of a picture, spread evenly: enough that their error is the picture's within some 20 %, few enough that
/// they take a small share of its time. For a check others, half as many.
Excerpt spread_tiles(Size size, bool checked);
/// The tiles whose light shows more of float32's rounding than the plan's bound allows. doubts: of each pixel
/// (backend_gl::Job), empty: of none. image: what was drawn; of modes mip and minimum all tiles or none are doubtful.
Excerpt doubtful_tiles(const DrawPlan& plan, Size size, const std::vector<float>& doubts, const Image& image);
/// Copies the tiles that were drawn from a picture of the same scene.
void copy_tiles(const Image& from, const Excerpt& excerpt, Size size, Image& to);

/// Backend cpu in float64, whatever the scene is.
RendererOptions exact_options(const RendererOptions& options);
/// The scene with other settings.
Scene with_settings(const Scene& scene, const Settings& settings);

/// Colours, or scalars.
const std::vector<float>& channels_of(const Image& image);
/// What scalars are divided by, as section 8 does: max(1, largest absolute value).
double scale_of(const Image& reference);
/// Mean over the channels of squared differences, a pixel. (No number: no slice counts in one of them.)
std::vector<double> squares(const Image& picture, const Image& reference, double scale);
double root_of_mean(const std::vector<double>& values);
/// How pictures approach the converged one as slices come closer, by three of them, each at half the slice distance of the
/// one before. Errors fall by a factor; those of neighbours are alike where they fall steadily, and less so where slices
/// meet kernels and steps by chance.
struct Approach {
    double factor = 0.0; ///< error at half a slice distance over that at the whole
    double alike = 1.0;  ///< correlation of these two errors
    /// Distance of the pictures at a slice distance and at half of it, over the error at the whole.
    [[nodiscard]] double share() const;
};
Approach approach(const Image& coarse, const Image& middle, const Image& fine);
/// Root mean square difference, as section 8 has it. excerpt: of its tiles, with their standard error on top.
double distance(const Image& picture, const Image& reference, const Excerpt* excerpt = nullptr);

} // namespace sheetsplat

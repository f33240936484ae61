// Pictures by other ways of drawing than the product's, on backend gl, so that what the product's ways are worth can be
// measured.
#pragma once

#include <string>
#include <vector>

#include "sheetsplat/renderer.hpp"

namespace sheetsplat::lab {

/// Each changes one thing; any of them may be on together unless said otherwise.
struct Comparators {
    /// The fragment-centric way of [NM06] section 5.1: each pixel looks in a grid of lists for the ellipsoids that
    /// reach its place. One field of ellipsoids, orthographic, sampling "point", no filter, packing wide.
    bool gather = false;
    /// Kernels are classified and lit one by one and their colours summed, as splatters did before [NM05]. Cartesian
    /// volumes in mode composite, orthographic, sampling "point", no effects beyond the papers.
    bool preshaded = false;
    bool quads = false;           ///< rectangles in place of point sprites
    bool single_calls = false;    ///< one draw call a kernel
    bool one_slab = false;        ///< one slab in one channel a pass, in place of four or eight
    bool average_opacity = false; ///< the opacity buffer drops kernels by the mean opacity over their box ([NM05] 4.4)
    bool bare_fill = false;       ///< the same rectangles of ellipsoids in one colour, and no shading: no picture
    bool count_fragments = false; ///< stats["fragments"]: fragments of splats
    bool count_work = false;      ///< of the compute path: stats["sections"], ["samples_read"] and ["barriers"]
};

/// The names above, as Comparators::of takes them.
std::vector<std::string> comparator_names();
/// Throws InvalidInput for names that do not exist.
Comparators comparators_of(const std::vector<std::string>& names);

/// Draws with comparators. The renderer's options choose the rest (backend gl; effects, packing, tagging and so on),
/// its plan does not tell of comparators. Throws Unsupported where a comparator cannot draw the scene; else as
/// Renderer::render.
Image render(Renderer& renderer, const Comparators& comparators, const Scene& scene, const Camera& camera, Size size,
             const Outputs& outputs = {}, const Progress& progress = {});

} // namespace sheetsplat::lab

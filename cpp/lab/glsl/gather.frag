// Four slabs of a pixel, each summed over the kernels that reach its place: [NM06] section 5.1, the fragment-centric way. The place
// gives a cell of a uniform grid, the cell a list of kernels; of each of them the whole 3D Gaussian is evaluated.
#include "lib/interop.h"
#include "lab_interop.h"

uniform usampler2D list_texture;  // of a cell: its first entry, and how many there are
uniform usampler2D entry_texture; // kernels
uniform sampler2D record_texture; // of a kernel: centre on its slice, pixels -> plane of the unit sphere, heights, amounts
uniform vec3 cell_corner;         // place of the targets' corner on the first slab, in cells
uniform vec3 cell_right;          // a pixel to the right, one down, a slab back
uniform vec3 cell_down;
uniform vec3 cell_back;
uniform vec3 shape;               // cells along each axis
uniform vec2 axis;                // pixel where the optical axis meets the targets
uniform float first_slab;
uniform float falloff_log2;       // k log2(e)
uniform float edge;               // exp(-k)

out vec4 sheet_front;
#ifdef WEIGHT
out vec4 weight_front;
#endif

ivec2 texel(int number) { return ivec2(number % KERNEL_COLUMNS, number / KERNEL_COLUMNS); }

// Number of the cell that a place lies in; -1 outside, where no kernel reaches.
int cell_at(vec3 place) {
    vec3 cell = floor(place);
    if (any(lessThan(cell, vec3(0.0))) || any(greaterThanEqual(cell, shape))) {
        return -1;
    }
    return (int(cell.z) * int(shape.y) + int(cell.y)) * int(shape.x) + int(cell.x);
}

void main() {
    vec3 place = cell_corner + gl_FragCoord.x * cell_right + gl_FragCoord.y * cell_down;
    ivec4 cells = ivec4(cell_at(place), cell_at(place + cell_back), cell_at(place + 2.0 * cell_back), cell_at(place + 3.0 * cell_back));
    vec4 values = vec4(0.0);
    vec4 weights = vec4(0.0);
    for (int slab = 0; slab < 4; ++slab) {
        // A ray leaves a cell for good: slabs in one cell follow one another and are served together.
        if (cells[slab] < 0 || (slab > 0 && cells[slab] == cells[slab - 1])) {
            continue;
        }
        vec4 here = vec4(equal(cells, ivec4(cells[slab])));
        uvec2 list = texelFetch(list_texture, texel(cells[slab]), 0).rg;
        for (uint entry = list.x; entry < list.x + list.y; ++entry) {
            int record = 4 * int(texelFetch(entry_texture, texel(int(entry)), 0).r);
            vec4 center = texelFetch(record_texture, texel(record), 0);
            vec4 unit_of_px = texelFetch(record_texture, texel(record + 1), 0);
            vec4 heights = texelFetch(record_texture, texel(record + 2), 0);
            vec4 amounts = texelFetch(record_texture, texel(record + 3), 0);
            // Whole pixels first: the difference is exact, however far from the corner of the picture.
            vec2 from = (gl_FragCoord.xy - (center.xy + axis)) - center.zw;
            vec2 across = mat2(unit_of_px.xy, unit_of_px.zw) * from;
            vec4 since = (first_slab - amounts.z) + vec4(0.0, 1.0, 2.0, 3.0);
            vec4 s = heights.x - since * heights.y;
            vec4 x = across.x - since * heights.z;
            vec4 y = across.y - since * heights.w;
            vec4 g = here * max(exp2(-falloff_log2 * (s * s + x * x + y * y)) - edge, 0.0);
            values += amounts.x * g;
            weights += amounts.y * g;
        }
    }
    sheet_front = values;
#ifdef WEIGHT
    weight_front = weights;
#endif
}

// Draws a tile of a picture from its first slab to its last, as the processor does: sums the kernels of four slabs at the tile's points,
// keeps eight slabs in shared memory, and classifies, shades and composites them there. Nothing but the picture is written.
//
// A work group owns a tile of EDGE x EDGE points, of which BORDER on each side are neighbours that gradients read. Kernels are added in the
// order of the scene, so that pictures are the same from run to run.
#include "lib/interop.h"
#define POINTS (EDGE * EDGE)
layout(local_size_x = EDGE, local_size_y = EDGE) in;

#ifdef GROUPS
#define SHEET_GROUPS GROUPS
#else
#define SHEET_GROUPS 1
#endif
// Sheets: for each group PLANES planes of four slabs a point, twice, for the newest four slabs and those before them.
shared vec4 sheets[2 * SHEET_GROUPS * PLANES * POINTS];
int front_planes = 0;
int back_planes = 0;
ivec2 tile_corner = ivec2(0); // pixel of the tile's first point
int point_of(ivec2 at) { return (at.y - tile_corner.y) * EDGE + at.x - tile_corner.x; }

#include "lib/sheets.glsl"
#include "lib/compensated.glsl"
#include "lib/picture.glsl"
#ifdef SEVERAL
#include "lib/slices_of_groups.glsl"
#else
#include "lib/slices_of_one.glsl"
#endif
#include "lib/tile_scene.glsl"
layout(std430, binding = BUFFER_BOUNDS) readonly buffer Bounds { Bound bounds[]; };
#include "lib/tile_sums.glsl"

layout(rgba32f, binding = IMAGE_PICTURE) uniform image2D picture_image;
#ifdef DEPTH_OUT
layout(r32f, binding = IMAGE_DEPTH) uniform image2D depth_image;
#endif
#ifdef COVERAGE
layout(rg32f, binding = IMAGE_COVERAGE) uniform image2D coverage_image;
#endif
#ifdef COMPENSATED
layout(rgba32f, binding = IMAGE_ERROR) uniform image2D error_image;
#endif
#ifdef DOUBT
layout(rgba32f, binding = IMAGE_DOUBT) uniform image2D doubt_image;
#endif

uniform ivec2 first_tile;   // of this call: column and row of tiles
uniform ivec2 picture_size; // pixels, without the border of one pixel around it
uniform ivec2 steps;        // of four slabs, the first of this call and the one behind its last

Pixel load_pixel(ivec2 at) {
    Pixel so_far = empty_pixel();
    so_far.image = imageLoad(picture_image, at);
#ifdef DEPTH_OUT
    so_far.depth = imageLoad(depth_image, at).r;
#endif
#ifdef COVERAGE
    so_far.covered = imageLoad(coverage_image, at).rg;
#endif
#ifdef COMPENSATED
    so_far.error = imageLoad(error_image, at);
#endif
#ifdef DOUBT
    so_far.doubt = imageLoad(doubt_image, at).r;
#endif
    return so_far;
}

void store_pixel(ivec2 at, Pixel so_far) {
    imageStore(picture_image, at, so_far.image);
#ifdef DEPTH_OUT
    imageStore(depth_image, at, vec4(so_far.depth));
#endif
#ifdef COVERAGE
    imageStore(coverage_image, at, vec4(so_far.covered, 0.0, 0.0));
#endif
#ifdef COMPENSATED
    imageStore(error_image, at, so_far.error);
#endif
#ifdef DOUBT
    imageStore(doubt_image, at, vec4(so_far.doubt));
#endif
}

// Whether slices behind can still change a pixel.
bool goes_on(Pixel so_far) {
#ifdef COVERAGE
    return true;
#elif defined(MODE_ISOSURFACE) && !defined(SEVERAL)
    return so_far.image.a == 0.0;
#elif defined(STOP)
    return so_far.image.a < opacity_stop;
#else
    return true;
#endif
}

shared bool anything_left;

void main() {
    ivec2 here = ivec2(gl_LocalInvocationID.xy);
    // The picture's pixels begin at (1, 1): its own border.
    tile_corner = (first_tile + ivec2(gl_WorkGroupID.xy)) * (EDGE - 2 * BORDER) + 1 - BORDER;
    ivec2 at = tile_corner + here;
    place_px = vec2(at) + 0.5;
    bool shown = all(greaterThanEqual(here, ivec2(BORDER))) && all(lessThan(here, ivec2(EDGE - BORDER))) && all(lessThanEqual(at, picture_size));
    Pixel so_far = empty_pixel();
    if (shown) {
        so_far = load_pixel(at);
    }
    const int half_of_sheets = SHEET_GROUPS * PLANES;
    back_planes = 0;
    make_empty();
    bool before = false; // something is in the slabs before the newest
    // A call that goes on where another ended sums the slabs before its first once more.
    for (int step = max(steps.x - 1, 0); step < steps.y; ++step) {
        front_planes = back_planes;
        back_planes = half_of_sheets - back_planes;
        array_first = 4 * step - 4;
        barrier();
        if (here == ivec2(0)) {
            anything_left = false;
        }
        bool now = sum_slabs(4 * step);
        if ((now || before) && step >= steps.x && shown && goes_on(so_far)) {
            shade_slices(at, so_far);
        }
        before = now;
        if (shown && goes_on(so_far)) {
            anything_left = true;
        }
        barrier();
        if (!anything_left) {
            break;
        }
    }
    if (shown) {
        store_pixel(at, so_far);
    }
#ifdef COUNTING
    count_work();
#endif
}

// What is known of a pixel so far, and where its slabs lie. Needs first_slab. For lib/slices_of_one.glsl and lib/slices_of_groups.glsl.

#if defined(PERSPECTIVE) || defined(VOLUMES)
uniform vec2 axis;              // pixel of the optical axis
#endif
#ifdef PERSPECTIVE
uniform float pixel;            // slope of one pixel
#endif
#if defined(PERSPECTIVE) || defined(DEPTH_OUT)
uniform float first_depth;      // of slab 0
uniform float slice_spacing;
#endif
#if defined(PREINTEGRATION) && defined(DEPTH_OUT)
uniform int nearest_slab;       // that of the least depth that an interval reports
#endif
uniform int first_slab;         // what slab 0 is, counted from the first slice
#ifdef COMPUTE
int array_first = 0;            // what the first slab of the array is, counted from slab 0
vec2 place_px = vec2(0.0);      // the pixel's centre
#define PLACE place_px
#else
const int array_first = 0;
#define PLACE gl_FragCoord.xy
#endif
#if defined(PERSPECTIVE) || defined(DEPTH_OUT)
// slab: place in the array, between two slabs for what lies there
float depth_of(float slab) { return first_depth + (float(array_first) + slab) * slice_spacing; }
#endif

// What slices are added to.
struct Pixel {
    vec4 image;
#ifdef DEPTH_OUT
    float depth;
#endif
#ifdef COVERAGE
    vec2 covered; // sum and its rounding error
#endif
#ifdef COMPENSATED
    vec4 error;
#endif
#ifdef DOUBT
    float doubt;  // sum of squares (lib/doubt.glsl)
#endif
};
Pixel empty_pixel() {
    Pixel made;
    made.image = vec4(0.0);
#ifdef DEPTH_OUT
    made.depth = uintBitsToFloat(0x7F800000u);
#endif
#ifdef COVERAGE
    made.covered = vec2(0.0);
#endif
#ifdef COMPENSATED
    made.error = vec4(0.0);
#endif
#ifdef DOUBT
    made.doubt = 0.0;
#endif
    return made;
}

// Slices of a step are CENTER ... CENTER + SLICES - 1 of the array; intervals start one earlier, since their far end needs a gradient too.
#define CENTER (SLABS - 1 - SLICES)
#define INTERVAL (SLABS - 2 - SLICES)

// How a classified colour is seen: lit, with what is left of light, faded with depth. Needs lib/sheets.glsl and lib/picture.glsl. Source:
// conventions, sections 5 and 10.

#ifdef VOLUMES
#include "lib/light_volume.glsl"
#endif
#ifdef GRADIENT
#include "lib/phong.glsl"
#ifdef CUT_FACES
#include "lib/faces.glsl"
#endif
#ifdef GROUPS
uniform float weakest_gradients[GROUPS];
#define weakest_gradient weakest_gradients[group]
#else
uniform float weakest_gradient; // g0
#endif
#endif
#ifdef GRADIENT_OPACITY
#ifdef GROUPS
uniform float full_gradients[GROUPS];
#define full_gradient full_gradients[group]
#else
uniform float full_gradient;    // g1, in the gradient's unit
#endif
#endif
#ifdef DEPTH_CUE
uniform vec4 cue;               // colour, strength
uniform vec2 cue_share;         // share of the way from start to end: of slab 0, from slab to slab
#endif

// Without lights colours count as ambient light.
#ifdef OCCLUSION
#ifndef GRADIENT
#define ALL_AMBIENT
#elif LIGHTS == 0
#define ALL_AMBIENT
#endif
#endif

#ifdef VOLUMES
vec3 spot_at(float slab) {
    vec2 from = PLACE - axis;
#ifdef PERSPECTIVE
    from *= depth_of(slab);
#endif
    return vec3(from, float(array_first) + slab);
}
#define AND_SPOT(slab) , spot_at(slab)
#else
#define AND_SPOT(slab)
#endif

#ifdef DEPTH_CUE
// slab: place in the array, between two slabs for what lies there
vec3 cued(vec3 color, float slab) {
    return mix(color, cue.rgb, cue.a * clamp(cue_share.x + (float(array_first) + slab) * cue_share.y, 0.0, 1.0));
}
#endif

// slab: as above; view: unit vector towards the camera
#ifdef GRADIENT
vec3 seen(vec3 color, float slab, vec3 gradient, vec3 view) {
    color = shade(color, gradient, weakest_gradient, view AND_SPOT(slab));
#else
vec3 seen(vec3 color, float slab) {
#endif
#ifdef ALL_AMBIENT
    color *= ambient_left(spot_at(slab));
#endif
#ifdef DEPTH_CUE
    color = cued(color, slab);
#endif
    return color;
}

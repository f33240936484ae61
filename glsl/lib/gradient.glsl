// Gradients of rho on the slabs of a pixel. Needs lib/sheets.glsl and lib/picture.glsl. Source: conventions, section 5.

uniform vec2 gradient_scale;    // reference length over twice the pixel's width (perspective: its slope) and over twice the spacing
#ifdef SLOPES
#include "lib/slopes.glsl"
#else
#include "lib/differences.glsl"
#endif

// rho: of the slabs at the pixel; slope: of its ray, in perspective. The first and the last slab have no gradient.
void gradients_at(ivec2 at, float rho[SLABS], vec2 slope, out vec3 gradient[SLABS]) {
#ifdef SLOPES
    vec3 slopes[SLABS];
    slopes_at(at, rho, slopes);
#else
    vec2 beside[SLABS];
    differences_at(at, beside);
#endif
    for (int c = 1; c < SLABS - 1; ++c) {
#ifdef SLOPES
        vec3 change = slopes[c];
#else
        vec3 change = vec3(beside[c], rho[c + 1] - rho[c - 1]);
#endif
#ifdef PERSPECTIVE
        float t = depth_of(float(c));
        // In front of the eye there are no slices: both differences are 0 there, and so is their quotient.
        vec2 across = t > 0.0 ? change.xy * gradient_scale.x / t : vec2(0.0);
        gradient[c] = vec3(across, dot(slope, across) - change.z * gradient_scale.y);
#else
        gradient[c] = vec3(change.xy * gradient_scale.x, -change.z * gradient_scale.y);
#endif
    }
}

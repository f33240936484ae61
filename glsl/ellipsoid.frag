// Adds an ellipsoid's sections to the sheets: one channel a slab, values and, where the plan asks for them, weights.
// [NM06] sections 3.3 and 4.1: the place of the pixel in the plane of the unit sphere and the section's height give the Gaussian.
#include "lib/interop.h"
#include "lib/kernel.glsl"
#define PLACE gl_FragCoord.xy

flat in vec4 place_at;     // centre on the record's slice: whole pixels, parts of pixels
flat in vec3 amount;       // value, weight, slabs from the record's slice to the batch's first one
#ifdef SPRITE
flat in vec4 section_front;
#ifdef TWO_TARGETS
flat in vec4 section_back;
#endif
flat in float falloff_px;  // -k log2(e) over the radius in pixels, squared
#else
flat in vec4 unit_of_px;   // columns of: pixels (times depth) -> plane of the unit sphere
flat in vec4 heights;      // height there, step; step of the centre in the plane of the unit sphere
#ifdef PRECISE_PLACES
flat in vec4 axes;
flat in vec4 step_and_rest; // step of the centre, and what float32 cut off it
flat in vec4 axes_rest;
flat in vec4 heights_rest;
#ifdef PERSPECTIVE
uniform double exact_depth;   // of the batch's first slice
uniform double exact_spacing;
#endif
#endif
uniform vec4 offset_front; // slab of each channel, counted from the batch's first one
uniform vec4 offset_back;
#ifdef PERSPECTIVE
uniform vec4 depth_front;  // of the slabs in the channels
uniform vec4 depth_back;
uniform float slice_spacing;
#endif
#endif

out vec4 sheet_front;
#ifdef TWO_TARGETS
out vec4 sheet_back;
#endif
#ifdef WEIGHT
out vec4 weight_front;
#ifdef TWO_TARGETS
out vec4 weight_back;
#endif
#endif
#ifdef FINE
out vec4 x_front;
out vec4 y_front;
out vec4 z_front;
#ifdef TWO_TARGETS
out vec4 x_back;
out vec4 y_back;
out vec4 z_back;
#endif
#endif

#ifndef SPRITE
#include "lib/sections.glsl"

#include "lib/ellipsoid.glsl"

#ifdef COMPACT
// Four slabs next to one another, the middle of them `middle` slabs behind the record's slice. The exponent is a polynomial of the
// slab d = -3/2 ... 3/2 from there, c + s d + b d^2, so that two exponentials serve all four.
vec4 compact(vec2 place, float middle) {
    vec2 across = place - middle * heights.zw;
    float height = heights.x - middle * heights.y;
    float bend = -falloff_log2 * (dot(heights.zw, heights.zw) + heights.y * heights.y);
    float inner = exp2(0.25 * bend - falloff_log2 * (dot(across, across) + height * height));
    float slope = exp2(falloff_log2 * (dot(across, heights.zw) + height * heights.y));
    float fall = 1.0 / slope;
    float outer = inner * exp2(2.0 * bend);
    return max(vec4(outer * fall * fall * fall, inner * fall, inner * slope, outer * slope * slope * slope) - edge, 0.0);
}
#endif
#endif

void main() {
    // Whole pixels first: the difference is exact, however far from the corner of the picture.
    vec2 from = (gl_FragCoord.xy - place_at.xy) - place_at.zw;
#ifdef SPRITE
    float bell = exp2(falloff_px * dot(from, from));
    vec4 front = max(section_front * bell - edge, 0.0);
#ifdef TWO_TARGETS
    vec4 back = max(section_back * bell - edge, 0.0);
#endif
#else
#ifdef PRECISE_PLACES
    ExactPlace place = exact_place();
#else
    vec2 place = mat2(unit_of_px.xy, unit_of_px.zw) * from;
#endif
#ifdef COMPACT
    vec4 front = compact(place, amount.z + 1.5);
#ifdef TWO_TARGETS
    vec4 back = compact(place, amount.z + 5.5);
#endif
#else
#ifdef SLAB
    slab_half = 0.5 * heights.y;
#endif
#ifdef PERSPECTIVE
    Sections at_front = sections(place, offset_front, depth_front);
#else
    Sections at_front = sections(place, offset_front, vec4(1.0));
#endif
    vec4 front = values(at_front);
#ifdef TWO_TARGETS
#ifdef PERSPECTIVE
    Sections at_back = sections(place, offset_back, depth_back);
#else
    Sections at_back = sections(place, offset_back, vec4(1.0));
#endif
    vec4 back = values(at_back);
#endif
#endif
#endif

#ifdef WEIGHT_ALONE
    float scale = amount.y;
    sheet_front = weights_of(scale, front);
#ifdef TWO_TARGETS
    sheet_back = weights_of(scale, back);
#endif
#else
    float scale = amount.x;
    sheet_front = scale * front;
#ifdef TWO_TARGETS
    sheet_back = scale * back;
#endif
#endif
#ifdef WEIGHT
    weight_front = weights_of(amount.y, front);
#ifdef TWO_TARGETS
    weight_back = weights_of(amount.y, back);
#endif
#endif
#ifdef FINE
    mat2 unit = mat2(unit_of_px.xy, unit_of_px.zw);
#ifdef ANALYTIC
    slopes(at_front, scale, unit, heights.y, x_front, y_front, z_front);
#ifdef TWO_TARGETS
    slopes(at_back, scale, unit, heights.y, x_back, y_back, z_back);
#endif
#else
#ifdef PERSPECTIVE
    float part = slice_spacing / heights.y;
#else
    float part = 0.0;
#endif
    slopes(at_front, scale, unit, part, heights.y, x_front, y_front, z_front);
#ifdef TWO_TARGETS
    slopes(at_back, scale, unit, part, heights.y, x_back, y_back, z_back);
#endif
#endif
#endif
}

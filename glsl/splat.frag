// Adds a kernel's sections to the sheets: one channel a slab, values and, where the plan asks for them, weights.
// [NM05] section 4.2: the 2D Gaussian times the 1D weight of the section; the lowering by exp(-k) follows per slab.
#include "lib/interop.h"
#include "lib/splat.glsl"
#include "lib/kernel.glsl"

flat in vec3 kernel; // centre in pixels, value
#ifdef SEPARABLE
flat in vec4 section_front;
flat in vec4 section_back;
#else
flat in vec4 s_front;
flat in vec4 s_back;
#endif
#ifdef GENERAL
flat in vec4 shift_x_front;
flat in vec4 shift_y_front;
flat in vec4 shift_x_back;
flat in vec4 shift_y_back;
uniform vec2 shear;
#ifdef PERSPECTIVE
flat in vec2 drift;
uniform vec4 depth_front; // of the slabs in the channels
uniform vec4 depth_back;
uniform float half_depth;
#endif
#endif
#ifdef FINE
uniform float step_s; // slice spacing over half-depth
#endif
#ifdef SEPARABLE
uniform float falloff_px; // -k log2(e) over the radius in pixels, squared
#endif
#if defined(WEIGHT) || defined(WEIGHT_ALONE)
uniform float weight_scale;
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

#ifndef SEPARABLE
#include "lib/sections.glsl"

Sections sections(vec4 s, vec2 place, vec4 shift_x, vec4 shift_y, vec4 depth) {
    Sections r;
    r.s = s;
    r.ax = place.x * depth + shift_x;
    r.ay = place.y * depth + shift_y;
    r.depth = depth;
    r.ray = vec2(0.0);
#ifdef GENERAL
    r.ray = shear;
#ifdef PERSPECTIVE
    r.ray += (place + drift) * half_depth;
#endif
#endif
    return r;
}
#endif

void main() {
#ifdef SEPARABLE
    vec2 place = gl_FragCoord.xy - kernel.xy;
    float bell = exp2(falloff_px * dot(place, place));
#ifdef NONNEGATIVE
    float lowering = kernel.z;
#else
    float lowering = edge;
#endif
    vec4 front = max(section_front * bell - lowering, 0.0);
#ifdef TWO_TARGETS
    vec4 back = max(section_back * bell - lowering, 0.0);
#endif
#else
    vec2 place = to_unit * (gl_FragCoord.xy - kernel.xy);
    vec4 zero = vec4(0.0);
    vec4 one = vec4(1.0);
#ifdef PERSPECTIVE
    Sections at_front = sections(s_front, place, shift_x_front, shift_y_front, depth_front);
#elif defined(GENERAL)
    Sections at_front = sections(s_front, place, shift_x_front, shift_y_front, one);
#else
    Sections at_front = sections(s_front, place, zero, zero, one);
#endif
    vec4 front = values(at_front);
#ifdef TWO_TARGETS
#ifdef PERSPECTIVE
    Sections at_back = sections(s_back, place, shift_x_back, shift_y_back, depth_back);
#elif defined(GENERAL)
    Sections at_back = sections(s_back, place, shift_x_back, shift_y_back, one);
#else
    Sections at_back = sections(s_back, place, zero, zero, one);
#endif
    vec4 back = values(at_back);
#endif
#endif

#if defined(WEIGHT_ALONE)
    float scale = weight_scale;
    sheet_front = weights_of(scale, front);
#ifdef TWO_TARGETS
    sheet_back = weights_of(scale, back);
#endif
#else
#ifdef NONNEGATIVE
    const float scale = 1.0;
#else
    float scale = kernel.z;
#endif
    sheet_front = scale * front;
#ifdef TWO_TARGETS
    sheet_back = scale * back;
#endif
#endif
#ifdef WEIGHT
    weight_front = weights_of(weight_scale, front);
#ifdef TWO_TARGETS
    weight_back = weights_of(weight_scale, back);
#endif
#endif
#if defined(FINE) && defined(ANALYTIC)
    slopes(at_front, scale, to_unit, step_s, x_front, y_front, z_front);
#ifdef TWO_TARGETS
    slopes(at_back, scale, to_unit, step_s, x_back, y_back, z_back);
#endif
#elif defined(FINE)
#ifdef PERSPECTIVE
    float part = half_depth;
#else
    float part = 0.0;
#endif
    slopes(at_front, scale, to_unit, part, step_s, x_front, y_front, z_front);
#ifdef TWO_TARGETS
    slopes(at_back, scale, to_unit, part, step_s, x_back, y_back, z_back);
#endif
#endif
}

// Classifies, shades and composites finished slices, front to back: SLICES of them in one pass.
// Source: conventions, sections 4 to 7; [NM05] sections 4.2 to 4.4.
#include "lib/interop.h"
#include "lib/sheets.glsl"
#include "lib/compensated.glsl"

#if defined(PERSPECTIVE) || defined(VOLUMES)
uniform vec2 axis;              // pixel of the optical axis
#endif
#ifdef PERSPECTIVE
uniform float pixel;            // slope of one pixel
#endif
#if defined(PERSPECTIVE) || defined(DEPTH_OUT)
uniform float first_depth;      // of the first slab in the array
uniform float slice_spacing;
#endif
#ifdef CLASSIFY
#include "lib/transfer.glsl"
#include "lib/opacity.glsl"
uniform float exponent;         // slice spacing over reference length
#endif
#if defined(PREINTEGRATION) && defined(DEPTH_OUT)
uniform int nearest_slab;       // of the array: that of the least depth that an interval reports
#endif
#if (defined(SLOPES) && !defined(ANALYTIC)) || defined(CLIP) || defined(OPEN_FRONT)
uniform int first_slab;         // of the array, counted from the first slice
#endif
#ifdef CLIP
#include "lib/clip.glsl"
#endif
#ifdef VOLUMES
#include "lib/light_volume.glsl"
#endif
#ifdef GRADIENT
#include "lib/phong.glsl"
uniform vec2 gradient_scale;    // reference length over twice the pixel's width (perspective: its slope) and over twice the spacing
uniform float weakest_gradient; // g0
#ifdef SLOPES
#include "lib/slopes.glsl"
#endif
#endif
#ifdef GRADIENT_OPACITY
uniform float full_gradient;    // g1, in the gradient's unit
#endif
#ifdef DEPTH_CUE
uniform vec4 cue;               // colour, strength
uniform vec2 cue_share;         // share of the way from start to end: of the first slab in the array, from slab to slab
#endif
#ifdef STOP
uniform float opacity_stop;
#endif
#ifdef MODE_ISOSURFACE
uniform float iso_value;
uniform vec4 iso_color;
#endif
#ifdef READ_IMAGE
uniform sampler2D image_texture;
#ifdef DEPTH_OUT
uniform sampler2D image_depth_texture;
#endif
#endif
#ifdef COVERAGE
uniform sampler2D image_coverage_texture;
#endif
#ifdef COMPENSATED
uniform sampler2D image_error_texture;
#endif

out vec4 image_out;
#ifdef DEPTH_OUT
out float depth_out;
#endif
#ifdef COVERAGE
out vec2 coverage_out; // sum and its rounding error
#endif
#ifdef COMPENSATED
out vec4 error_out;
#endif

// Without lights colours count as ambient light.
#ifdef OCCLUSION
#ifndef GRADIENT
#define ALL_AMBIENT
#elif LIGHTS == 0
#define ALL_AMBIENT
#endif
#endif

// Slices of this pass are CENTER ... CENTER + SLICES - 1 of the array; intervals start one earlier, since their far end needs a gradient too.
#define CENTER (SLABS - 1 - SLICES)
#define INTERVAL (SLABS - 2 - SLICES)

#ifdef PREINTEGRATION
#include "lib/preintegration.glsl"
#endif

#ifdef VOLUMES
vec3 spot_at(float slab) {
    vec2 from = gl_FragCoord.xy - axis;
#ifdef PERSPECTIVE
    from *= first_depth + slab * slice_spacing;
#endif
    return vec3(from, slab);
}
#define AND_SPOT(slab) , spot_at(slab)
#else
#define AND_SPOT(slab)
#endif

#ifdef DEPTH_CUE
// slab: place in the array, between two slabs for what lies there
vec3 cued(vec3 color, float slab) {
    return mix(color, cue.rgb, cue.a * clamp(cue_share.x + slab * cue_share.y, 0.0, 1.0));
}
#endif

void main() {
    ivec2 at = ivec2(gl_FragCoord.xy);
    float rho[SLABS];
    rho_at(at, rho);
#ifdef WEIGHT
    float w[SLABS];
    weights_at(at, w);
#endif
#ifdef PERSPECTIVE
    vec2 slope = vec2(gl_FragCoord.x - axis.x, axis.y - gl_FragCoord.y) * pixel;
    float slant = sqrt(1.0 + dot(slope, slope));
#else
    const float slant = 1.0;
#endif

#ifdef CLIP
    ivec2 run = texelFetch(clip_texture, at, 0).rg;
    bool kept[SLABS];
    for (int c = INTERVAL; c < CENTER + SLICES; ++c) {
        kept[c] = is_kept(run, c);
    }
#endif

#ifdef COVERAGE
    vec2 covered = texelFetch(image_coverage_texture, at, 0).rg;
    for (int c = CENTER; c < CENTER + SLICES; ++c) {
#ifdef CLIP
        if (!kept[c]) {
            continue;
        }
#endif
        add(covered, w[c] * slant);
    }
    coverage_out = covered;
#endif

#ifdef READ_IMAGE
    vec4 result = texelFetch(image_texture, at, 0);
#else
    vec4 result = vec4(0.0);
#endif
#ifdef DEPTH_OUT
    float depth = texelFetch(image_depth_texture, at, 0).r;
#endif
#ifdef COMPENSATED
    vec4 error = texelFetch(image_error_texture, at, 0);
#endif

#ifdef MODE_XRAY
    for (int c = CENTER; c < CENTER + SLICES; ++c) {
#ifdef CLIP
        if (!kept[c]) {
            continue;
        }
#endif
        add(result.rg, rho[c] * slant);
    }
#endif
#ifdef MODE_MIP
    for (int c = CENTER; c < CENTER + SLICES; ++c) {
#ifdef CLIP
        if (!kept[c]) {
            continue;
        }
#endif
        result.r = max(result.r, rho[c]);
    }
#endif
#if defined(CLASSIFY) || defined(MODE_ISOSURFACE)
#ifdef GRADIENT
#ifdef SLOPES
    vec3 slopes[SLABS];
    slopes_at(at, rho, slopes);
#else
    float left[SLABS];
    float right[SLABS];
    float above[SLABS];
    float below[SLABS];
    rho_at(at - ivec2(1, 0), left);
    rho_at(at + ivec2(1, 0), right);
    rho_at(at - ivec2(0, 1), above);
    rho_at(at + ivec2(0, 1), below);
#endif
#ifdef PERSPECTIVE
    vec3 view = vec3(-slope, 1.0) / slant;
#else
    const vec3 view = vec3(0.0, 0.0, 1.0);
#endif
    vec3 gradient[SLABS];
    for (int c = 1; c < SLABS - 1; ++c) {
#ifdef SLOPES
        vec3 change = slopes[c];
#else
        vec3 change = vec3(right[c] - left[c], above[c] - below[c], rho[c + 1] - rho[c - 1]);
#endif
#ifdef PERSPECTIVE
        float t = first_depth + float(c) * slice_spacing;
        // In front of the eye there are no slices: both differences are 0 there, and so is their quotient.
        vec2 across = t > 0.0 ? change.xy * gradient_scale.x / t : vec2(0.0);
        gradient[c] = vec3(across, dot(slope, across) - change.z * gradient_scale.y);
#else
        gradient[c] = vec3(change.xy * gradient_scale.x, -change.z * gradient_scale.y);
#endif
    }
#endif

#ifdef MODE_ISOSURFACE
    for (int c = INTERVAL; c < INTERVAL + SLICES; ++c) {
        bool crossed = result.a == 0.0 && (rho[c] < iso_value) != (rho[c + 1] < iso_value);
#ifdef CLIP
        crossed = crossed && kept[c] && kept[c + 1];
#endif
#ifdef OPEN_FRONT
        crossed = crossed && first_slab + c >= 0;
#endif
        if (crossed) {
            float share = clamp((iso_value - rho[c]) / (rho[c + 1] - rho[c]), 0.0, 1.0);
#ifdef GRADIENT
            result = vec4(shade(iso_color.rgb, mix(gradient[c], gradient[c + 1], share), weakest_gradient, view AND_SPOT(float(c) + share)), 1.0);
#else
            result = vec4(iso_color.rgb, 1.0);
#endif
#ifdef ALL_AMBIENT
            result.rgb *= ambient_left(spot_at(float(c) + share));
#endif
#ifdef DEPTH_CUE
            result.rgb = cued(result.rgb, float(c) + share);
#endif
#ifdef DEPTH_OUT
            depth = first_depth + (float(c) + share) * slice_spacing;
#endif
        }
    }
#else
#ifdef PREINTEGRATION
    for (int c = INTERVAL; c < INTERVAL + SLICES; ++c) {
#else
    for (int c = CENTER; c < CENTER + SLICES; ++c) {
#endif
#ifdef STOP
        if (result.a >= opacity_stop) {
            break;
        }
#endif
#ifdef PREINTEGRATION
#ifdef EMPTY_TEST
        if (w[c] == 0.0 && w[c + 1] == 0.0) {
            continue;
        }
#endif
#ifdef GRADIENT
        vec3 normal_gradient = 0.5 * (gradient[c] + gradient[c + 1]);
#endif
        float measure = exponent * slant;
#ifdef GRADIENT_OPACITY
        measure *= min(length(normal_gradient) / full_gradient, 1.0);
#endif
#ifdef SECOND_ORDER
        vec4 classified = bent_ramp(rho[c - 1], rho[c], rho[c + 1], rho[c + 2], measure);
        float alpha = classified.a;
#else
        vec4 classified = ramp(rho[c], rho[c + 1]);
        float alpha = opacity_of_absorption(measure * classified.a);
#endif
#else
#ifdef EMPTY_TEST
        if (w[c] == 0.0) {
            continue;
        }
#endif
#ifdef GRADIENT
        vec3 normal_gradient = gradient[c];
#endif
        vec4 classified = transfer(rho[c]);
#ifdef GRADIENT_OPACITY
        classified.a *= min(length(normal_gradient) / full_gradient, 1.0);
#endif
#ifdef OPACITY_CORRECTION
        float alpha = opacity_of(classified.a, exponent * slant);
#else
        float alpha = classified.a;
#endif
#endif
#ifdef CLIP
        // No branch of its own: compilers take long enough over the one below.
#if defined(PREINTEGRATION) && defined(EMPTY_TEST)
        alpha = (kept[c] && w[c] != 0.0) || (kept[c + 1] && w[c + 1] != 0.0) ? alpha : 0.0;
#elif defined(PREINTEGRATION)
        alpha = kept[c] || kept[c + 1] ? alpha : 0.0;
#else
        alpha = kept[c] ? alpha : 0.0;
#endif
#endif
        if (alpha == 0.0) {
            continue;
        }
#ifdef PREINTEGRATION
        float middle = float(c) + 0.5;
#else
        float middle = float(c);
#endif
#ifdef GRADIENT
        vec3 color = shade(classified.rgb, normal_gradient, weakest_gradient, view AND_SPOT(middle));
#else
        vec3 color = classified.rgb;
#endif
#ifdef ALL_AMBIENT
        color *= ambient_left(spot_at(middle));
#endif
#ifdef DEPTH_CUE
        color = cued(color, middle);
#endif
        float share = (1.0 - result.a) * alpha;
#ifdef DEPTH_OUT
        if (result.a < 0.5 && result.a + share >= 0.5) {
#ifdef PREINTEGRATION
            depth = first_depth + max(middle, float(nearest_slab)) * slice_spacing;
#else
            depth = first_depth + float(c) * slice_spacing;
#endif
        }
#endif
#ifdef COMPENSATED
        add(result, error, vec4(color * share, share));
#else
        result += vec4(color * share, share);
#endif
    }
#endif
#ifdef DEPTH_OUT
    depth_out = depth;
#endif
#endif
    image_out = result;
#ifdef COMPENSATED
    error_out = error;
#endif
}

// Classifies, shades and composites finished slices of one group, front to back: SLICES of them in a step.
// Source: conventions, sections 4 to 7; [NM05] sections 4.2 to 4.4.
#ifdef CLASSIFY
#include "lib/transfer.glsl"
#include "lib/opacity.glsl"
uniform float exponent;         // slice spacing over reference length
#endif
#if defined(CLIP) || defined(OWNED)
#include "lib/clip.glsl"
#endif
#if defined(CLASSIFY) || defined(MODE_ISOSURFACE)
#include "lib/look.glsl"
#ifdef GRADIENT
#include "lib/gradient.glsl"
#endif
#ifdef DOUBT
#include "lib/doubt.glsl"
#endif
#endif
#ifdef STOP
uniform float opacity_stop;
#endif
#ifdef LEAST_WEIGHT
uniform float least_weight; // points with less are empty
#endif
// Whether a slice counts that is kept: without weights all do.
#ifdef WEIGHT
#define COUNTS(slab) (w[slab] > 0.0)
#else
#define COUNTS(slab) true
#endif
#ifdef MODE_ISOSURFACE
uniform float iso_value;
uniform vec4 iso_color;
#endif
#ifdef PREINTEGRATION
#include "lib/preintegration.glsl"
#endif

void shade_slices(ivec2 at, inout Pixel so_far) {
    float rho[SLABS];
    rho_at(at, rho);
#ifdef WEIGHT
    float w[SLABS];
    weights_at(at, w);
#endif
#ifdef PERSPECTIVE
    vec2 slope = vec2(PLACE.x - axis.x, axis.y - PLACE.y) * pixel;
    float slant = sqrt(1.0 + dot(slope, slope));
#else
    const vec2 slope = vec2(0.0);
    const float slant = 1.0;
#endif

#if defined(CLIP) || defined(OWNED)
    ivec4 runs = texelFetch(clip_texture, at, 0);
#endif
#ifdef CLIP
    bool kept[SLABS];
    for (int c = INTERVAL; c < CENTER + SLICES; ++c) {
        kept[c] = is_kept(runs, c);
    }
#endif

#ifdef COVERAGE
    vec2 covered = so_far.covered;
    for (int c = CENTER; c < CENTER + SLICES; ++c) {
#ifdef CLIP
        if (!kept[c]) {
            continue;
        }
#endif
#ifdef OWNED
        if (!is_owned(runs, c)) {
            continue;
        }
#endif
        add(covered, w[c] * slant);
    }
    so_far.covered = covered;
#endif

#ifdef LEAST_WEIGHT
    for (int c = 0; c < SLABS; ++c) {
        w[c] = w[c] < least_weight ? 0.0 : w[c];
    }
#endif

    vec4 result = so_far.image;
#ifdef DEPTH_OUT
    float depth = so_far.depth;
#endif
#ifdef COMPENSATED
    vec4 error = so_far.error;
#endif
#ifdef DOUBT
    float doubt = so_far.doubt;
#endif

#ifdef MODE_XRAY
    for (int c = CENTER; c < CENTER + SLICES; ++c) {
#ifdef CLIP
        if (!kept[c]) {
            continue;
        }
#endif
#ifdef OWNED
        if (!is_owned(runs, c)) {
            continue;
        }
#endif
        add(result.rg, rho[c] * slant);
    }
#endif
#ifdef MODE_EXTREME
    // In g: 1 once a slice has counted.
    for (int c = CENTER; c < CENTER + SLICES; ++c) {
#ifdef CLIP
        if (!kept[c]) {
            continue;
        }
#endif
#ifdef OWNED
        if (!is_owned(runs, c)) {
            continue;
        }
#endif
        if (COUNTS(c)) {
            result.rg = vec2(result.g > 0.0 ? MODE_EXTREME(result.r, rho[c]) : rho[c], 1.0);
        }
    }
#endif
#ifdef MODE_AVERAGE
    // Sum, its rounding error, number of slices.
    for (int c = CENTER; c < CENTER + SLICES; ++c) {
#ifdef CLIP
        if (!kept[c]) {
            continue;
        }
#endif
#ifdef OWNED
        if (!is_owned(runs, c)) {
            continue;
        }
#endif
        if (COUNTS(c)) {
            add(result.rg, rho[c]);
            result.b += 1.0;
        }
    }
#endif
#if defined(CLASSIFY) || defined(MODE_ISOSURFACE)
#ifdef GRADIENT
#ifdef PERSPECTIVE
    vec3 view = vec3(-slope, 1.0) / slant;
#else
    const vec3 view = vec3(0.0, 0.0, 1.0);
#endif
    vec3 gradient[SLABS];
    gradients_at(at, rho, slope, gradient);
#define SEEN(color, slab) seen(color, slab, normal_gradient, view)
#else
#define SEEN(color, slab) seen(color, slab)
#endif

#ifdef CUT_FACES
    vec4 entry = texelFetch(face_texture, ivec3(at, 0), 0);
#endif
#ifdef MODE_ISOSURFACE
    for (int c = INTERVAL; c < INTERVAL + SLICES; ++c) {
        bool crossed = result.a == 0.0 && (rho[c] < iso_value) != (rho[c + 1] < iso_value);
#ifdef CLIP
        crossed = crossed && kept[c] && kept[c + 1];
#endif
#ifdef OWNED
        crossed = crossed && is_owned(runs, c);
#endif
#ifdef OPEN_FRONT
        crossed = crossed && first_slab + array_first + c >= 0;
#endif
        if (crossed) {
            float share = clamp((iso_value - rho[c]) / (rho[c + 1] - rho[c]), 0.0, 1.0);
#ifdef GRADIENT
            vec3 normal_gradient = mix(gradient[c], gradient[c + 1], share);
#endif
#ifdef DOUBT
            add_doubt(doubt, normal_error(normal_gradient, gradient_error(float(c) + share) +
                                                               moved(gradient[c], gradient[c + 1], normal_gradient, rho[c + 1] - rho[c])));
#endif
            result = vec4(SEEN(iso_color.rgb, float(c) + share), 1.0);
#ifdef DEPTH_OUT
            depth = depth_of(float(c) + share);
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
#ifdef OWNED
        alpha = is_owned(runs, c) ? alpha : 0.0;
#endif
        if (alpha == 0.0) {
            continue;
        }
#ifdef PREINTEGRATION
        float middle = float(c) + 0.5;
#else
        float middle = float(c);
#endif
#ifdef CUT_FACES
        face = face_of(entry, float(first_slab + array_first - runs.x) + middle, absorption(min(alpha, 1.0 - clearest)), result.a);
#endif
        vec3 color = SEEN(classified.rgb, middle);
        float share = (1.0 - result.a) * alpha;
#ifdef DOUBT
        add_doubt(doubt, share * normal_error(normal_gradient, gradient_error(middle)));
#endif
#ifdef DEPTH_OUT
        if (result.a < 0.5 && result.a + share >= 0.5) {
#ifdef PREINTEGRATION
            depth = depth_of(max(middle, float(nearest_slab - array_first)));
#else
            depth = depth_of(float(c));
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
    so_far.depth = depth;
#endif
#endif
    so_far.image = result;
#ifdef COMPENSATED
    so_far.error = error;
#endif
#ifdef DOUBT
    so_far.doubt = doubt;
#endif
}

// lib/slices_of_one.glsl for scenes that it does not draw: GROUPS of fields with transfer functions of their own or that end in different
// places, and isosurfaces of several values or translucent ones. Source: conventions, sections 2 and 4 to 7.

#ifdef GROUPS
#define ALL_GROUPS GROUPS
#define SELECT(number) group = number
#else
#define ALL_GROUPS 1
#define SELECT(number)
#endif

#if defined(CLASSIFY) || defined(SERVING)
#include "lib/transfer.glsl"
#endif
#ifdef CLASSIFY
#include "lib/opacity.glsl"
uniform float exponent;         // slice spacing over reference length
#endif
#if defined(CLIP) || defined(OWNED) || defined(ENDS)
#include "lib/clip.glsl"
#endif
#if defined(CLIP) || defined(ENDS)
#define CUT
#endif
#if defined(CLASSIFY) || defined(MODE_ISOSURFACE)
#include "lib/look.glsl"
#else
#define SCALAR
uniform float bases[ALL_GROUPS]; // what the values of each group are counted from
#endif
#ifdef GRADIENT
#include "lib/gradient.glsl"
#ifdef DOUBT
#include "lib/doubt.glsl"
#endif
#define SEEN(color, slab) seen(color, slab, normal_gradient, view)
#else
#define SEEN(color, slab) seen(color, slab)
#endif
#ifdef LEAST_WEIGHT
uniform float least_weights[ALL_GROUPS]; // points of a group with less are empty
#endif
// Whether a slab of a group can show something.
#if defined(CUT) && defined(EMPTY_TEST)
#define REACHED(n) (kept[n] && w[n] != 0.0)
#elif defined(CUT)
#define REACHED(n) kept[n]
#elif defined(EMPTY_TEST)
#define REACHED(n) (w[n] != 0.0)
#else
#define REACHED(n) true
#endif
#ifdef SERVING
uniform int classified[ALL_GROUPS]; // 0: the group is there for others
uniform int counted[ALL_GROUPS];    // 0: its weights are no part of the coverage
uniform ivec2 colors[ALL_GROUPS];   // the groups whose colours take the place of its own, from the first to the one behind the last
#define CLASSIFIED(g) (classified[g] != 0)
#define COUNTED(g) (counted[g] != 0)
#else
#define CLASSIFIED(g) true
#define COUNTED(g) true
#endif
#ifdef SERVING
// Puts the sum of the colours that other groups have in slab c in the place of a group's own, where any is not empty.
#define RECOLOR(color, of, reached, looks, c) \
    { \
        vec3 sum = vec3(0.0); \
        bool any = false; \
        for (int giver = colors[of].x; giver < colors[of].y; ++giver) { \
            SELECT(giver); \
            int other = giver * SLABS + c; \
            if (reached) { \
                sum += looks; \
                any = true; \
            } \
        } \
        color = any ? sum : color; \
    }
#endif
#ifdef STOP
uniform float opacity_stop;
#else
const float opacity_stop = 1.0;
#endif
#ifdef MODE_ISOSURFACE
// SURFACES: all iso values of the first group, all of the next one ...
uniform float iso_values[SURFACES];
uniform vec4 iso_colors[SURFACES]; // colour, opacity of the surface
#define VALUES (SURFACES / ALL_GROUPS)
#endif
#ifdef PREINTEGRATION
#include "lib/preintegration.glsl"
#define FIRST INTERVAL
#else
#define FIRST CENTER
#endif

void shade_slices(ivec2 at, inout Pixel so_far) {
#ifdef PERSPECTIVE
    vec2 slope = vec2(PLACE.x - axis.x, axis.y - PLACE.y) * pixel;
    float slant = sqrt(1.0 + dot(slope, slope));
    vec3 view = vec3(-slope, 1.0) / slant;
#else
    const vec2 slope = vec2(0.0);
    const float slant = 1.0;
    const vec3 view = vec3(0.0, 0.0, 1.0);
#endif

    // Slab c of group g: element g SLABS + c.
    float rho[ALL_GROUPS * SLABS];
#ifdef WEIGHT
    float w[ALL_GROUPS * SLABS];
#endif
#ifdef GRADIENT
    vec3 gradient[ALL_GROUPS * SLABS];
#endif
    for (int g = 0; g < ALL_GROUPS; ++g) {
        SELECT(g);
        float rho_here[SLABS];
        rho_at(at, rho_here);
#ifdef WEIGHT
        float w_here[SLABS];
        weights_at(at, w_here);
#endif
#ifdef GRADIENT
        vec3 gradient_here[SLABS];
        gradients_at(at, rho_here, slope, gradient_here);
#endif
        for (int c = 0; c < SLABS; ++c) {
            rho[g * SLABS + c] = rho_here[c];
#ifdef WEIGHT
            w[g * SLABS + c] = w_here[c];
#endif
#ifdef GRADIENT
            gradient[g * SLABS + c] = gradient_here[c];
#endif
        }
    }

#if defined(CLIP) || defined(OWNED)
    ivec4 runs = texelFetch(clip_texture, at, 0);
#endif
#ifdef CUT
    bool kept[ALL_GROUPS * SLABS];
#ifdef CUT_FACES
    int first_kept[ALL_GROUPS];
#endif
    for (int g = 0; g < ALL_GROUPS; ++g) {
#ifdef ENDS
        ivec2 inside = texelFetch(end_texture, ivec3(at, g), 0).rg;
#endif
        for (int c = INTERVAL; c < CENTER + SLICES; ++c) {
            bool cut = false;
#ifdef CLIP
            cut = !is_kept(runs, c);
#endif
#ifdef ENDS
            cut = cut || !is_in(inside, c);
#endif
            kept[g * SLABS + c] = !cut;
        }
#if defined(CUT_FACES) && defined(CLIP) && defined(ENDS)
        first_kept[g] = max(runs.x, inside.x);
#elif defined(CUT_FACES) && defined(CLIP)
        first_kept[g] = runs.x;
#elif defined(CUT_FACES)
        first_kept[g] = inside.x;
#endif
    }
#endif

#ifdef COVERAGE
    vec2 covered = so_far.covered;
    for (int c = CENTER; c < CENTER + SLICES; ++c) {
#ifdef OWNED
        if (!is_owned(runs, c)) {
            continue;
        }
#endif
        float weight = 0.0;
        for (int n = c; n < ALL_GROUPS * SLABS; n += SLABS) {
            if (!COUNTED(n / SLABS)) {
                continue;
            }
#ifdef CUT
            weight += kept[n] ? w[n] : 0.0;
#else
            weight += w[n];
#endif
        }
        add(covered, weight * slant);
    }
    so_far.covered = covered;
#endif

#ifdef LEAST_WEIGHT
    for (int n = 0; n < ALL_GROUPS * SLABS; ++n) {
        w[n] = w[n] < least_weights[n / SLABS] ? 0.0 : w[n];
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

#ifdef SCALAR
    for (int c = CENTER; c < CENTER + SLICES; ++c) {
#ifdef OWNED
        if (!is_owned(runs, c)) {
            continue;
        }
#endif
        float sum = 0.0;
        bool counts = false;
        for (int g = 0; g < ALL_GROUPS; ++g) {
            int n = g * SLABS + c;
            if (kept[n]) {
                sum += rho[n] + bases[g];
#ifdef WEIGHT
                counts = counts || w[n] > 0.0;
#else
                counts = true;
#endif
            }
        }
        if (counts) {
#if defined(MODE_XRAY)
            add(result.rg, sum * slant);
#elif defined(MODE_EXTREME)
            result.rg = vec2(result.g > 0.0 ? MODE_EXTREME(result.r, sum) : sum, 1.0);
#else
            add(result.rg, sum);
            result.b += 1.0;
#endif
        }
    }
#elif defined(MODE_ISOSURFACE)
    for (int c = INTERVAL; c < INTERVAL + SLICES; ++c) {
#ifdef OWNED
        if (!is_owned(runs, c)) {
            continue;
        }
#endif
#ifdef OPEN_FRONT
        if (first_slab + array_first + c < 0) {
            continue;
        }
#endif
        // Crossings are drawn in the order of their places, one after the other.
        uint drawn = 0u;
        for (int count = 0; count < SURFACES && result.a < opacity_stop; ++count) {
            int next = -1;
            float place = 2.0;
            for (int s = 0; s < SURFACES; ++s) {
                float value = iso_values[s];
                int n = s / VALUES * SLABS + c;
                float front = rho[n];
                float back = rho[n + 1];
                bool crossed = (front < value) != (back < value) && (drawn & (1u << s)) == 0u;
#ifdef CUT
                crossed = crossed && kept[n] && kept[n + 1];
#endif
                if (!crossed) {
                    continue;
                }
                float share = clamp((value - front) / (back - front), 0.0, 1.0);
                // Of two values of a group whose places are too close for float32, the nearer to the front.
                bool sooner = share == place && next / VALUES == s / VALUES && (front < back ? value < iso_values[next] : value > iso_values[next]);
                if (share < place || sooner) {
                    next = s;
                    place = share;
                }
            }
            if (next < 0) {
                break;
            }
            drawn |= 1u << next;
            SELECT(next / VALUES);
#ifdef GRADIENT
            int from = next / VALUES * SLABS + c;
            vec3 normal_gradient = mix(gradient[from], gradient[from + 1], place);
#endif
            float share = (1.0 - result.a) * iso_colors[next].a;
#ifdef DOUBT
            add_doubt(doubt, share * normal_error(normal_gradient, gradient_error(float(c) + place) +
                                                                       moved(gradient[from], gradient[from + 1], normal_gradient, rho[from + 1] - rho[from])));
#endif
#ifdef DEPTH_OUT
            if (result.a < 0.5 && result.a + share >= 0.5) {
                depth = depth_of(float(c) + place);
            }
#endif
            vec3 color = iso_colors[next].rgb;
#ifdef SERVING
            RECOLOR(color, next / VALUES, REACHED(other) || REACHED(other + 1), transfer(mix(rho[other], rho[other + 1], place)).rgb, c)
            SELECT(next / VALUES);
#endif
            result += vec4(SEEN(color, float(c) + place) * share, share);
        }
    }
#else
    for (int c = FIRST; c < FIRST + SLICES && result.a < opacity_stop; ++c) {
#ifdef OWNED
        if (!is_owned(runs, c)) {
            continue;
        }
#endif
#ifdef PREINTEGRATION
        float middle = float(c) + 0.5;
#else
        float middle = float(c);
#endif
        vec4 mixed = vec4(0.0); // sums of tau times colour and of tau, over the groups
        float absorbed = 0.0;
        bool opaque = false;
#ifdef DOUBT
        float largest_error = 0.0;
#endif
        for (int g = 0; g < ALL_GROUPS; ++g) {
            SELECT(g);
            int n = g * SLABS + c;
            if (!CLASSIFIED(g)) {
                continue;
            }
#ifdef PREINTEGRATION
            bool reached = REACHED(n) || REACHED(n + 1);
#ifdef GRADIENT
            vec3 normal_gradient = 0.5 * (gradient[n] + gradient[n + 1]);
#endif
            vec4 looks = ramp(rho[n], rho[n + 1]);
            float tau = looks.a;
#ifdef GRADIENT_OPACITY
            tau *= min(length(normal_gradient) / full_gradient, 1.0);
#endif
#else
            bool reached = REACHED(n);
#ifdef GRADIENT
            vec3 normal_gradient = gradient[n];
#endif
            vec4 looks = transfer(rho[n]);
#ifdef GRADIENT_OPACITY
            looks.a *= min(length(normal_gradient) / full_gradient, 1.0);
#endif
            float tau = absorption(min(looks.a, 1.0 - clearest));
            opaque = opaque || (reached && looks.a >= 1.0);
#endif
            if (!reached || tau == 0.0) {
                continue;
            }
#ifdef CUT_FACES
            face = face_of(texelFetch(face_texture, ivec3(at, g), 0), float(first_slab + array_first - first_kept[g]) + middle, tau * exponent * slant, result.a);
#endif
#ifdef DOUBT
            largest_error = max(largest_error, normal_error(normal_gradient, gradient_error(middle)));
#endif
            absorbed += tau * exponent * slant;
#ifdef SERVING
#ifdef PREINTEGRATION
            RECOLOR(looks.rgb, g, REACHED(other) || REACHED(other + 1), ramp(rho[other], rho[other + 1]).rgb, c)
#else
            RECOLOR(looks.rgb, g, REACHED(other), transfer(rho[other]).rgb, c)
#endif
            SELECT(g);
#endif
            mixed += tau * vec4(SEEN(looks.rgb, middle), 1.0);
        }
        float alpha = opaque ? 1.0 : opacity_of_absorption(absorbed);
        if (alpha == 0.0) {
            continue;
        }
        float share = (1.0 - result.a) * alpha;
#ifdef DOUBT
        add_doubt(doubt, share * largest_error);
#endif
#ifdef DEPTH_OUT
        if (result.a < 0.5 && result.a + share >= 0.5) {
#ifdef PREINTEGRATION
            depth = depth_of(max(middle, float(nearest_slab - array_first)));
#else
            depth = depth_of(middle);
#endif
        }
#endif
        vec4 added = vec4(mixed.rgb / mixed.a * share, share);
#ifdef COMPENSATED
        add(result, error, added);
#else
        result += added;
#endif
    }
#endif
#ifdef DEPTH_OUT
    so_far.depth = depth;
#endif
    so_far.image = result;
#ifdef COMPENSATED
    so_far.error = error;
#endif
#ifdef DOUBT
    so_far.doubt = doubt;
#endif
}

// Twice the derivatives of rho per pixel and slice where they are splatted (ANALYTIC). Else differences of rho between the neighbours of a pixel, from splatted differences where the differences of sums would lose their digits.
// x: right less left, y: above less below, z: next slice less the one before. Needs first_slab. Source: conventions, section 5.

#ifndef ANALYTIC
uniform int last_slab; // of all
#ifndef FINE_XY
#include "lib/differences.glsl"
#endif
#endif

#ifdef COMPUTE
#define x_front_texture (front_planes + PLANE_SLOPES)
#define x_back_texture (back_planes + PLANE_SLOPES)
#define y_front_texture (front_planes + PLANE_SLOPES + 1)
#define y_back_texture (back_planes + PLANE_SLOPES + 1)
#define z_front_texture (front_planes + PLANE_SLOPES + 2)
#define z_back_texture (back_planes + PLANE_SLOPES + 2)
#define weight_x_front_texture (front_planes + PLANE_WEIGHT_SLOPES)
#define weight_x_back_texture (back_planes + PLANE_WEIGHT_SLOPES)
#define weight_y_front_texture (front_planes + PLANE_WEIGHT_SLOPES + 1)
#define weight_y_back_texture (back_planes + PLANE_WEIGHT_SLOPES + 1)
#define weight_z_front_texture (front_planes + PLANE_WEIGHT_SLOPES + 2)
#define weight_z_back_texture (back_planes + PLANE_WEIGHT_SLOPES + 2)
#else
uniform SHEET x_front_texture;
uniform SHEET y_front_texture;
uniform SHEET z_front_texture;
#if SLABS == 8
uniform SHEET x_back_texture;
uniform SHEET y_back_texture;
uniform SHEET z_back_texture;
#endif
#ifdef THRESHOLD
uniform SHEET weight_x_front_texture;
uniform SHEET weight_y_front_texture;
uniform SHEET weight_z_front_texture;
#if SLABS == 8
uniform SHEET weight_x_back_texture;
uniform SHEET weight_y_back_texture;
uniform SHEET weight_z_back_texture;
#endif
#endif

#endif

#if SLABS == 8
#define FETCH(result, axis, at) \
    { \
        vec4 fetched_front = SHEET_TEXEL(axis##_front_texture, at); \
        vec4 fetched_back = SHEET_TEXEL(axis##_back_texture, at); \
        result = UNPACK(fetched_front, fetched_back); \
    }
#else
#define FETCH(result, axis, at) \
    { \
        vec4 fetched_front = SHEET_TEXEL(axis##_front_texture, at); \
        result = UNPACK(fetched_front, fetched_front); \
    }
#endif

#ifdef THRESHOLD
void raw_at(ivec2 at, out float d[SLABS]) {
    FETCH(d, sheet, at)
}

// rho+ - rho- from the splatted differences of D and W: D+ / M+ - D- / M- with M = max(w0, W); of values that are counted from a
// pivot, that much more for each W up to w0.
float quotient_change(float d_minus, float w_minus, float w_plus, float d_change, float w_change) {
    float m_minus = max(w0, w_minus);
    float m_plus = max(w0, w_plus);
    float m_change = min(w_minus, w_plus) > w0 ? w_change : m_plus - m_minus;
    float change = (d_change * m_minus - d_minus * m_change) / (m_minus * m_plus);
#ifdef PIVOT
    change *= half_range;
    change += pivot * (max(w_minus, w_plus) < w0 ? w_change : min(w_plus, w0) - min(w_minus, w0)) / w0;
#endif
    return change;
}
#endif

void slopes_at(ivec2 at, float rho[SLABS], out vec3 change[SLABS]) {
#ifdef ANALYTIC
    float across[SLABS];
    float upwards[SLABS];
    float along[SLABS];
    FETCH(across, x, at)
    FETCH(upwards, y, at)
    FETCH(along, z, at)
    for (int c = 1; c < SLABS - 1; ++c) {
        change[c] = vec3(across[c], upwards[c], along[c]);
    }
#ifdef LABELS
    // Less those of the largest other label.
    int own = group;
    ivec2 set = label_sets[own];
    float largest[SLABS];
    vec3 rival[SLABS];
    for (int c = 0; c < SLABS; ++c) {
        largest[c] = 0.0;
        rival[c] = vec3(0.0);
    }
    for (int other = set.x; other < set.y; ++other) {
        group = other;
        float weight[SLABS];
        FETCH(weight, sheet, at)
        FETCH(across, x, at)
        FETCH(upwards, y, at)
        FETCH(along, z, at)
        for (int c = 0; c < SLABS; ++c) {
            if (other != own && weight[c] > largest[c]) {
                largest[c] = weight[c];
                rival[c] = vec3(across[c], upwards[c], along[c]);
            }
        }
    }
    group = own;
    for (int c = 1; c < SLABS - 1; ++c) {
        change[c] -= rival[c];
    }
#endif
#else
#ifdef FINE_XY
    float across[SLABS];
    float upwards[SLABS];
    FETCH(across, x, at)
    FETCH(upwards, y, at)
#ifdef THRESHOLD
    float d_minus[SLABS];
    float w_minus[SLABS];
    float w_plus[SLABS];
    float w_change[SLABS];
    raw_at(at - ivec2(1, 0), d_minus);
    weights_at(at - ivec2(1, 0), w_minus);
    weights_at(at + ivec2(1, 0), w_plus);
    FETCH(w_change, weight_x, at)
    for (int c = 0; c < SLABS; ++c) {
        across[c] = quotient_change(d_minus[c], w_minus[c], w_plus[c], across[c], w_change[c]);
    }
    raw_at(at + ivec2(0, 1), d_minus);
    weights_at(at + ivec2(0, 1), w_minus);
    weights_at(at - ivec2(0, 1), w_plus);
    FETCH(w_change, weight_y, at)
    for (int c = 0; c < SLABS; ++c) {
        upwards[c] = quotient_change(d_minus[c], w_minus[c], w_plus[c], upwards[c], w_change[c]);
    }
#endif
#else
    vec2 beside[SLABS];
    differences_at(at, beside);
#endif
#ifdef FINE_Z
    float along[SLABS];
    FETCH(along, z, at)
#ifdef THRESHOLD
    float d_here[SLABS];
    float w_here[SLABS];
    float w_along[SLABS];
    raw_at(at, d_here);
    weights_at(at, w_here);
    FETCH(w_along, weight_z, at)
    for (int c = 1; c < SLABS - 1; ++c) {
        along[c] = quotient_change(d_here[c - 1], w_here[c - 1], w_here[c + 1], along[c], w_along[c]);
    }
#endif
#endif
    for (int c = 1; c < SLABS - 1; ++c) {
#ifdef FINE_XY
        change[c] = vec3(across[c], upwards[c], rho[c + 1] - rho[c - 1]);
#else
        change[c] = vec3(beside[c], rho[c + 1] - rho[c - 1]);
#endif
#ifdef FINE_Z
        // At both ends of the stack one of the two neighbours is 0, and their difference exact.
        int slab = first_slab + array_first + c;
        if (slab > 0 && slab < last_slab) {
            change[c].z = along[c];
        }
#endif
    }
#endif
}

// Reading finished slabs. wide: eight slabs in two sheets; paper: four slabs in the copy buffer, whose order rotates with PHASE.
// SLABS consecutive slabs come as an array, front to back.

#ifdef GROUPS
// Groups of fields that are classified apart have layers of the sheets: what is read is that of this group.
int group = 0;
#define SHEET_TEXEL(sheet, at) SHEET_TEXEL_OF(sheet, at, group)
#else
#define SHEET_TEXEL(sheet, at) SHEET_TEXEL_OF(sheet, at, 0)
#endif

#ifdef COMPUTE
// Sheets of a tile lie in shared memory (tile.comp): planes of four slabs of one sum each, those of a group after those of another.
#define SHEET int
#define SHEET_TEXEL_OF(sheet, at, layer) sheets[((sheet) + (layer) * PLANES) * POINTS + point_of(at)]
#define sheet_front_texture (front_planes + PLANE_VALUE)
#define sheet_back_texture (back_planes + PLANE_VALUE)
#define weight_front_texture (front_planes + PLANE_WEIGHT)
#define weight_back_texture (back_planes + PLANE_WEIGHT)
#elif defined(GROUPS)
#define SHEET sampler2DArray
#define SHEET_TEXEL_OF(sheet, at, layer) texelFetch(sheet, ivec3(at, layer), 0)
#else
#define SHEET sampler2D
#define SHEET_TEXEL_OF(sheet, at, layer) texelFetch(sheet, at, 0)
#endif

#ifndef COMPUTE
uniform SHEET sheet_front_texture;
#ifdef WEIGHT
uniform SHEET weight_front_texture;
#endif
#if SLABS == 8
uniform SHEET sheet_back_texture;
#ifdef WEIGHT
uniform SHEET weight_back_texture;
#endif
#endif
#endif

#if SLABS == 8
#define UNPACK(front, back) float[8](front.x, front.y, front.z, front.w, back.x, back.y, back.z, back.w)
#elif PHASE == 0
#define UNPACK(front, back) float[4](front.y, front.z, front.w, front.x)
#elif PHASE == 1
#define UNPACK(front, back) float[4](front.z, front.w, front.x, front.y)
#elif PHASE == 2
#define UNPACK(front, back) float[4](front.w, front.x, front.y, front.z)
#else
#define UNPACK(front, back) float[4](front.x, front.y, front.z, front.w)
#endif

#ifdef THRESHOLD
uniform float w0;
#ifdef PIVOT
uniform float pivot;      // what values in D, and rho, are less by
uniform float half_range; // what values in D are divided by
#endif
#endif

#ifdef WEIGHT
void weights_at(ivec2 at, out float w[SLABS]) {
    vec4 front = SHEET_TEXEL(weight_front_texture, at);
#if SLABS == 8
    vec4 back = SHEET_TEXEL(weight_back_texture, at);
#else
    vec4 back = front;
#endif
    w = UNPACK(front, back);
}
#endif

vec4 normalized(vec4 d, ivec2 at, bool of_front) {
#ifdef THRESHOLD
#if SLABS == 8
    vec4 weight = of_front ? SHEET_TEXEL(weight_front_texture, at) : SHEET_TEXEL(weight_back_texture, at);
#else
    vec4 weight = SHEET_TEXEL(weight_front_texture, at);
#endif
    vec4 quotient = d / max(weight, vec4(w0));
#ifdef PIVOT
    quotient = half_range * quotient + pivot * (min(weight / w0, 1.0) - 1.0);
#endif
    return quotient;
#else
    return d;
#endif
}

#ifdef LABELS
uniform ivec2 label_sets[GROUPS]; // the set of labels of each group, from the first to the one behind the last; empty: of none

// Of four slabs that hold the weight of a label, what it is above the largest other one; below 0 where it has none.
vec4 above_others(SHEET sheet, ivec2 at, vec4 own) {
    ivec2 set = label_sets[group];
    if (set.x == set.y) {
        return own;
    }
    vec4 largest = vec4(0.0);
    for (int other = set.x; other < set.y; ++other) {
        largest = other != group ? max(largest, SHEET_TEXEL_OF(sheet, at, other)) : largest;
    }
    vec4 above = own - largest;
    return mix(min(above, vec4(-1e-12)), above, greaterThan(own, vec4(0.0)));
}
#define COMPARED(sheet, at, own) above_others(sheet, at, own)
#else
#define COMPARED(sheet, at, own) own
#endif

// rho of the slabs at a pixel
void rho_at(ivec2 at, out float rho[SLABS]) {
    vec4 front = COMPARED(sheet_front_texture, at, normalized(SHEET_TEXEL(sheet_front_texture, at), at, true));
#if SLABS == 8
    vec4 back = COMPARED(sheet_back_texture, at, normalized(SHEET_TEXEL(sheet_back_texture, at), at, false));
#else
    vec4 back = front;
#endif
    rho = UNPACK(front, back);
}

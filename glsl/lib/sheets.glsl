// Reading finished slabs. wide: eight slabs in two sheets; paper: four slabs in the copy buffer, whose order rotates with PHASE.
// SLABS consecutive slabs come as an array, front to back.

uniform sampler2D sheet_front_texture;
#ifdef WEIGHT
uniform sampler2D weight_front_texture;
#endif
#if SLABS == 8
uniform sampler2D sheet_back_texture;
#ifdef WEIGHT
uniform sampler2D weight_back_texture;
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
#endif

#ifdef WEIGHT
void weights_at(ivec2 at, out float w[SLABS]) {
    vec4 front = texelFetch(weight_front_texture, at, 0);
#if SLABS == 8
    vec4 back = texelFetch(weight_back_texture, at, 0);
#else
    vec4 back = front;
#endif
    w = UNPACK(front, back);
}
#endif

vec4 normalized(vec4 d, ivec2 at, bool of_front) {
#ifdef THRESHOLD
#if SLABS == 8
    return d / max(of_front ? texelFetch(weight_front_texture, at, 0) : texelFetch(weight_back_texture, at, 0), vec4(w0));
#else
    return d / max(texelFetch(weight_front_texture, at, 0), vec4(w0));
#endif
#else
    return d;
#endif
}

// rho of the slabs at a pixel
void rho_at(ivec2 at, out float rho[SLABS]) {
    vec4 front = normalized(texelFetch(sheet_front_texture, at, 0), at, true);
#if SLABS == 8
    vec4 back = normalized(texelFetch(sheet_back_texture, at, 0), at, false);
#else
    vec4 back = front;
#endif
    rho = UNPACK(front, back);
}

// Differences of rho between the neighbours of a pixel, from splatted differences where the differences of sums would lose their digits.
// x: right less left, y: above less below, z: next slice less the one before. Source: IMAGE FORMATION section 5.

uniform int first_slab; // of the array, counted from the first slice
uniform int last_slab;  // of all

uniform sampler2D x_front_texture;
uniform sampler2D y_front_texture;
uniform sampler2D z_front_texture;
#if SLABS == 8
uniform sampler2D x_back_texture;
uniform sampler2D y_back_texture;
uniform sampler2D z_back_texture;
#endif

#if SLABS == 8
#define FETCH(result, axis, at) \
    { \
        vec4 fetched_front = texelFetch(axis##_front_texture, at, 0); \
        vec4 fetched_back = texelFetch(axis##_back_texture, at, 0); \
        result = UNPACK(fetched_front, fetched_back); \
    }
#else
#define FETCH(result, axis, at) \
    { \
        vec4 fetched_front = texelFetch(axis##_front_texture, at, 0); \
        result = UNPACK(fetched_front, fetched_front); \
    }
#endif

void slopes_at(ivec2 at, float rho[SLABS], out vec3 change[SLABS]) {
    float left[SLABS];
    float right[SLABS];
    float above[SLABS];
    float below[SLABS];
#ifdef FINE_XY
    FETCH(right, x, at)
    FETCH(above, y, at)
    for (int c = 0; c < SLABS; ++c) {
        left[c] = 0.0;
        below[c] = 0.0;
    }
#else
    rho_at(at - ivec2(1, 0), left);
    rho_at(at + ivec2(1, 0), right);
    rho_at(at - ivec2(0, 1), above);
    rho_at(at + ivec2(0, 1), below);
#endif
#ifdef FINE_Z
    float along[SLABS];
    FETCH(along, z, at)
#endif
    for (int c = 1; c < SLABS - 1; ++c) {
        change[c] = vec3(right[c] - left[c], above[c] - below[c], rho[c + 1] - rho[c - 1]);
#ifdef FINE_Z
        // At both ends of the stack one of the two neighbours is 0, and their difference exact.
        int slab = first_slab + c;
        if (slab > 0 && slab < last_slab) {
            change[c].z = along[c];
        }
#endif
    }
}

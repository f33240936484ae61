// What is left of light at a point: numbers on grids in the world, linear in between. One buffer holds them all, since textures of three
// dimensions end at sizes that grids go beyond, and hardware mixes with 8 fractional bits. Source: conventions, section 10.

uniform samplerBuffer volume_texture;
uniform int volume_first[VOLUMES];  // element of the buffer that a grid begins with
uniform vec3 volume_last[VOLUMES];  // numbers of its last elements
uniform vec3 volume_place[VOLUMES]; // of the optical axis on the first slab of the array, in elements
uniform vec3 volume_right[VOLUMES]; // what a pixel to the right comes to, one down and a slab back
uniform vec3 volume_down[VOLUMES];
uniform vec3 volume_back[VOLUMES];

// spot: pixels to the right of the optical axis and below it (times depth in perspective), place in the array of slabs
float left_of(int volume, vec3 spot) {
    vec3 last = volume_last[volume];
    vec3 place = volume_place[volume] + spot.x * volume_right[volume] + spot.y * volume_down[volume] + spot.z * volume_back[volume];
    place = clamp(place, vec3(0.0), last);
    vec3 whole = min(floor(place), max(last - 1.0, 0.0));
    vec3 part = place - whole;
    ivec3 at = ivec3(whole);
    ivec3 size = ivec3(last) + 1;
    ivec3 further = ivec3(min(last, 1.0)) * ivec3(1, size.x, size.x * size.y);
    int corner = volume_first[volume] + at.x + size.x * (at.y + size.y * at.z);
#define FOUR_AT(from) \
    vec4(texelFetch(volume_texture, from).r, texelFetch(volume_texture, from + further.x).r, \
         texelFetch(volume_texture, from + further.y).r, texelFetch(volume_texture, from + further.x + further.y).r)
    vec4 four = mix(FOUR_AT(corner), FOUR_AT(corner + further.z), part.z);
    vec2 two = mix(four.xy, four.zw, part.y);
    return mix(two.x, two.y, part.x);
}

#ifdef OCCLUSION
uniform float occlusion; // strength

// Share of ambient light: the grid after those of the lights tells how open a point's surroundings are.
float ambient_left(vec3 spot) { return 1.0 - occlusion * (1.0 - left_of(VOLUMES - 1, spot)); }
#endif

// What is left of light at a point, from grids in the world whose numbers are linear in between: what is left or, in mode isosurface, rho.
// One buffer holds all grids, since textures of three dimensions end at sizes that grids go beyond, and hardware mixes with 8 fractional
// bits. Source: conventions, section 10.

uniform samplerBuffer volume_texture;
uniform int volume_first[VOLUMES];  // element of the buffer that a grid begins with
uniform vec3 volume_last[VOLUMES];  // numbers of its last elements
uniform vec3 volume_place[VOLUMES]; // of the optical axis on slab 0, in elements
uniform vec3 volume_right[VOLUMES]; // what a pixel to the right comes to, one down and a slab back
uniform vec3 volume_down[VOLUMES];
uniform vec3 volume_back[VOLUMES];

// spot: pixels to the right of the optical axis and below it (times depth in perspective), slab
vec3 place_of(int volume, vec3 spot) {
    return volume_place[volume] + spot.x * volume_right[volume] + spot.y * volume_down[volume] + spot.z * volume_back[volume];
}

float number_at(int volume, vec3 place) {
    vec3 last = volume_last[volume];
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
#endif

#ifndef CASTERS

float left_of(int light, vec3 spot) { return number_at(light, place_of(light, spot)); }

#ifdef OCCLUSION
// Share of ambient light: the grid after those of the lights tells how open a point's surroundings are.
float ambient_left(vec3 spot) { return 1.0 - occlusion * (1.0 - number_at(VOLUMES - 1, place_of(VOLUMES - 1, spot))); }
#endif

#else

// Lines through grids of rho, a grid for each group of fields, which lose light where rho crosses an iso value from one step to the
// next (light/surface_lines.hpp).
// The arrays are those of one group after the other.
uniform vec3 caster[VOLUMES * CASTERS]; // iso value in the sheets' unit, -log2(1 - opacity), 0
uniform float caster_opaque;   // where absorptions add up to this much nothing is left
#ifdef SHADOWS
uniform vec3 light_step[LIGHTS]; // a slice distance towards a light, in elements
#endif
#ifdef OCCLUSION
uniform vec3 around_step[AROUND]; // and in each direction of ambient occlusion
uniform float around_steps;
#endif
#ifdef KEPT
uniform vec3 kept_normal[VOLUMES * KEPT]; // half spaces: dot(normal, place) + distance.x >= 0
uniform vec3 kept_distance[VOLUMES * KEPT];
#endif

float absorbed_below(int group, float rho) {
    float sum = 0.0;
    for (int i = group * CASTERS; i < (group + 1) * CASTERS; ++i) {
        sum += rho >= caster[i].x ? caster[i].y : 0.0;
    }
    return sum;
}

// Light that comes along a line through points 1 to `steps`, as far as the line is in the grid and kept.
float left_along(vec3 place, vec3 step_, float steps) {
    float end = 1e6;
    for (int axis = 0; axis < 3; ++axis) {
        if (step_[axis] != 0.0) {
            end = min(end, ((step_[axis] > 0.0 ? volume_last[0][axis] : 0.0) - place[axis]) / step_[axis]);
        }
    }
    end = min(floor(end) + 1.0, steps);
    float absorbed = 0.0;
    for (int group = 0; group < VOLUMES; ++group) {
        float first = 1.0;
        float last = end;
#ifdef KEPT
        for (int i = group * KEPT; i < (group + 1) * KEPT; ++i) {
            float rise = dot(kept_normal[i], step_);
            float height = dot(kept_normal[i], place) + kept_distance[i].x;
            if (rise > 1e-6) {
                first = max(first, ceil(-height / rise));
            } else if (rise < -1e-6) {
                last = min(last, floor(-height / rise));
            } else if (height < 0.0) {
                last = 0.0;
            }
        }
#endif
        float before = 0.0;
        for (float point = first; point <= last && absorbed < caster_opaque; point += 1.0) {
            float here = absorbed_below(group, number_at(group, place + point * step_));
            absorbed += point > first ? abs(here - before) : 0.0;
            before = here;
        }
    }
    return absorbed < caster_opaque ? exp2(-absorbed) : 0.0;
}

#ifdef SHADOWS
float left_of(int light, vec3 spot) { return left_along(place_of(0, spot), light_step[light], 1e6); }
#endif

#ifdef OCCLUSION
float ambient_left(vec3 spot) {
    vec3 place = place_of(0, spot);
    float sum = 0.0;
    for (int i = 0; i < AROUND; ++i) {
        sum += left_along(place, around_step[i], around_steps);
    }
    return 1.0 - occlusion * (1.0 - sum / float(AROUND));
}
#endif

#endif

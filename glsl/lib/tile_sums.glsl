// Sums of kernels in four slabs at the points of a tile. For tile.comp.
#include "lib/kernel.glsl"
#include "lib/sections.glsl"
#include "lib/division.glsl"
#ifdef PERSPECTIVE
uniform double depth_of_first; // of slab 0
uniform double exact_spacing;
#endif
#ifdef ELLIPSOIDS
#include "lib/ellipsoid_edges.glsl"
// Of the kernel that is added.
vec4 place_at = vec4(0.0);   // centre on the record's slice: whole pixels, parts of pixels
vec3 amount = vec3(0.0);     // value, weight, slabs from the record's slice to the first one
vec4 unit_of_px = vec4(0.0); // columns of: pixels (times depth) -> plane of the unit sphere
vec4 heights = vec4(0.0);    // height there, step; step of the centre in the plane of the unit sphere
#ifdef PRECISE_PLACES
bool place_is_precise = false;
int precise_record = 0;
vec4 axes = vec4(0.0);
vec4 step_and_rest = vec4(0.0);
vec4 axes_rest = vec4(0.0);
vec4 heights_rest = vec4(0.0);
#ifdef PERSPECTIVE
double exact_depth = 0.0LF; // of the first slab
#endif
#endif
#include "lib/ellipsoid.glsl"
#endif

// Which sums a field makes beside those of its values: what it is divided by goes along where its group's sheets have none.
#if defined(WEIGHT) || defined(DIVIDED)
#define SUM_WEIGHTS
#endif
#if defined(SLOPES) && (defined(THRESHOLD) || defined(DIVIDED))
#define SUM_WEIGHT_SLOPES
#endif

struct Sums {
    vec4 value;
#ifdef SUM_WEIGHTS
    vec4 weight;
#endif
#ifdef SLOPES
    vec4 slopes[3];
#endif
#ifdef SUM_WEIGHT_SLOPES
    vec4 weight_slopes[3];
#endif
};
Sums no_sums() {
    Sums sums;
    sums.value = vec4(0.0);
#ifdef SUM_WEIGHTS
    sums.weight = vec4(0.0);
#endif
    for (int n = 0; n < 3; ++n) {
#ifdef SLOPES
        sums.slopes[n] = vec4(0.0);
#endif
#ifdef SUM_WEIGHT_SLOPES
        sums.weight_slopes[n] = vec4(0.0);
#endif
    }
    return sums;
}

#ifdef COUNTING
// What a model of the time is made of: of each thread kernels times slabs that it adds, samples that it reads and barriers that it meets.
// One counter a work group, so that no sum depends on their order.
layout(std430, binding = BUFFER_COUNTS) buffer Counts { uvec4 counts[]; };
shared uint group_counts[3];
uvec3 my_counts = uvec3(0u);
#define COUNT_SECTIONS(number) my_counts.x += uint(number)
#define COUNT_SAMPLE my_counts.y += 1u
#define COUNT_BARRIERS(number) my_counts.z += uint(number)

void count_work() {
    if (gl_LocalInvocationIndex < 3u) {
        group_counts[gl_LocalInvocationIndex] = 0u;
    }
    barrier();
    for (int n = 0; n < 3; ++n) {
        atomicAdd(group_counts[n], my_counts[n]);
    }
    barrier();
    if (gl_LocalInvocationIndex == 0u) {
        counts[gl_WorkGroupID.y * gl_NumWorkGroups.x + gl_WorkGroupID.x] += uvec4(group_counts[0], group_counts[1], group_counts[2], 1u);
    }
}
#else
#define COUNT_SECTIONS(number)
#define COUNT_SAMPLE
#define COUNT_BARRIERS(number)
#endif

int my_number() { return int(gl_LocalInvocationIndex); }
#define MY_SHEET(plane, of_group) sheets[(back_planes + (plane) + (of_group) * PLANES) * POINTS + my_number()]

// Adds what a field's kernels come to to the sheets of its group.
void add_field(int part, Sums sums) {
    int of_group = parts[part].kind.y;
#ifdef DIVIDED
    if (parts[part].kind.z != 0) {
        Division by = Division(parts[part].division.x, parts[part].division.y, parts[part].division.z, parts[part].division.w);
#ifdef SLOPES
        for (int n = 0; n < 3; ++n) {
            sums.slopes[n] = divided_slope(by, sums.value, sums.weight, sums.slopes[n], sums.weight_slopes[n]);
        }
#endif
        sums.value = divided(by, sums.value, sums.weight);
        sums.weight = counted_weight(by, sums.weight);
    }
#endif
    MY_SHEET(PLANE_VALUE, of_group) += sums.value;
#ifdef WEIGHT
    MY_SHEET(PLANE_WEIGHT, of_group) += sums.weight;
#endif
#ifdef SLOPES
    for (int n = 0; n < 3; ++n) {
        MY_SHEET(PLANE_SLOPES + n, of_group) += sums.slopes[n];
#ifdef THRESHOLD
        MY_SHEET(PLANE_WEIGHT_SLOPES + n, of_group) += sums.weight_slopes[n];
#endif
    }
#endif
}

// Of the slabs, which lengths in the plane of the unit sphere grow with in perspective.
vec4 depths_of(int first) {
#ifdef PERSPECTIVE
    return first_depth + (float(first) + vec4(0.0, 1.0, 2.0, 3.0)) * slice_spacing;
#else
    return vec4(1.0);
#endif
}

// Adds a kernel's sections. unit: pixels (times depth) -> plane of the unit sphere; step_s: slice spacing over half-depth.
void add_sections(Sections at, float value, float weight, mat2 unit, float step_s, inout Sums sums) {
#ifdef SLAB
    slab_half = 0.5 * step_s;
    float width = falloff_root * step_s * sqrt(1.0 + dot(at.ray, at.ray));
    slab_nodes = width < FOUR_NODE_SLAB ? 4 : width < SIX_NODE_SLAB ? 6 : 0;
    slab_pieces = width < SIX_NODE_SLAB ? 1 : 4;
#endif
    vec4 g = values(at);
    COUNT_SECTIONS(4);
    sums.value += value * g;
#ifdef SUM_WEIGHTS
    sums.weight += weights_of(weight, g);
#endif
#ifdef SLOPES
    vec4 x, y, z;
#ifdef ANALYTIC
    slopes(at, 1.0, unit, step_s, x, y, z);
#else
#ifdef PERSPECTIVE
    float part_of_ray = slice_spacing / step_s;
#else
    const float part_of_ray = 0.0;
#endif
    slopes(at, 1.0, unit, part_of_ray, step_s, x, y, z);
#endif
    sums.slopes[0] += value * x;
    sums.slopes[1] += value * y;
    sums.slopes[2] += value * z;
#ifdef SUM_WEIGHT_SLOPES
    sums.weight_slopes[0] += weight * x;
    sums.weight_slopes[1] += weight * y;
    sums.weight_slopes[2] += weight * z;
#endif
#endif
}

uniform float slab_reach; // half a slab where slabs are averaged, and what differences over depth reach further
#ifdef ELLIPSOIDS
uniform float margin;     // pixels by which kernels reach further
#ifndef PERSPECTIVE
uniform vec2 axis_px;     // where the optical axis meets the picture
#define AXIS axis_px
#else
#define AXIS axis
#endif

#define LISTED (POINTS / 2)
shared vec4 listed[4 * LISTED]; // kernels that reach the tile: place_at, amount, unit_of_px, heights
shared uint flags[(POINTS + 31) / 32];
shared int nodes_met[POINTS];
shared int leaves_met[TREE_ARITY];

// Numbers the threads for which `met` holds, in the order of their own numbers; returns how many there are.
int number_those(bool met, out int number) {
    barrier();
    if (my_number() < (POINTS + 31) / 32) {
        flags[my_number()] = 0u;
    }
    barrier();
    if (met) {
        atomicOr(flags[my_number() >> 5], 1u << (my_number() & 31));
    }
    barrier();
    COUNT_BARRIERS(4);
    int total = 0;
    number = 0;
    for (int word = 0; word < (POINTS + 31) / 32; ++word) {
        int ones = bitCount(flags[word]);
        number += word < (my_number() >> 5) ? ones : 0;
        total += ones;
    }
    number += bitCount(flags[my_number() >> 5] & ((1u << (my_number() & 31)) - 1u));
    return total;
}

// Edges of the tile's points: left, right, upper, lower.
vec4 tile_edges() { return vec4(tile_corner.x, tile_corner.x, tile_corner.y, tile_corner.y) + vec4(0.5, float(EDGE) - 0.5, 0.5, float(EDGE) - 0.5); }

bool meets(Bound bound, int first) {
    vec4 edges = tile_edges();
    return bound.rectangle.x <= edges.y && bound.rectangle.y >= edges.x && bound.rectangle.z <= edges.w && bound.rectangle.w >= edges.z &&
           bound.slabs.x <= float(first + 3) + slab_reach && bound.slabs.y >= float(first) - slab_reach;
}

// Readies a kernel; false where its sections in the four slabs do not reach the tile.
bool ready(int record, int first) {
    vec4 place = records[RECORD_SIZE * record];
    vec4 along = records[RECORD_SIZE * record + 1];
    vec4 axes = records[RECORD_SIZE * record + 2];
    vec4 more = records[RECORD_SIZE * record + 3];
#ifdef PRECISE_PLACES
    place_is_precise = more.w != 0.0;
    precise_record = record;
#endif
    float since = float(first) - along.x;
    vec2 slabs = slabs_met(vec2(since - slab_reach, since + 3.0 + slab_reach), along.y, along.z);
    if (slabs.x > slabs.y) {
        return false;
    }
    float length_u = length(axes.xy);
    float length_v = length(axes.zw);
    vec2 along_u = axes.xy / length_u;
    vec2 along_v = axes.zw / length_v;
    place_at = vec4(place.xy + AXIS, place.zw);
    amount = vec3(along.w, more.z, since);
    // The axes are orthogonal, so that their inverse needs no determinant.
    unit_of_px = vec4(along_u.x / length_u, along_v.x / length_v, along_u.y / length_u, along_v.y / length_v);
    heights = vec4(along.y, along.z, dot(along_u, more.xy) / length_u, dot(along_v, more.xy) / length_v);
    vec2 edge_u = edge_over(slabs, along.y, along.z, heights.z) * length_u;
    vec2 edge_v = edge_over(slabs, along.y, along.z, heights.w) * length_v;
#ifdef PERSPECTIVE
    vec2 depths = first_depth + (along.x + slabs) * slice_spacing;
    if (depths.x <= 1e-6 * slice_spacing) {
        return true;
    }
    edge_u = over_depths(edge_u, depths);
    edge_v = over_depths(edge_v, depths);
#endif
    edge_u += vec2(-1.0, 1.0) * (margin + 1e-5 * (edge_u.y - edge_u.x));
    edge_v += vec2(-1.0, 1.0) * (margin + 1e-5 * (edge_v.y - edge_v.x));
    // The rectangle along the section's axes and the tile: apart along one of the four directions, or they meet.
    vec4 edges = tile_edges();
    vec2 middle = vec2(0.5 * (edges.x + edges.y), 0.5 * (edges.z + edges.w)) - place_at.xy - place_at.zw;
    vec2 reach = vec2(0.5 * (edges.y - edges.x), 0.5 * (edges.w - edges.z));
    vec2 half_u = 0.5 * (edge_u.y - edge_u.x) * along_u;
    vec2 half_v = 0.5 * (edge_v.y - edge_v.x) * along_v;
    vec2 center = 0.5 * (edge_u.x + edge_u.y) * along_u + 0.5 * (edge_v.x + edge_v.y) * along_v;
    vec2 away = abs(middle - center) - reach - abs(half_u) - abs(half_v);
    vec2 slack = 1e-5 * (abs(middle) + abs(center));
    if (any(greaterThan(away, slack))) {
        return false;
    }
    float tile_u = dot(abs(along_u), reach);
    float tile_v = dot(abs(along_v), reach);
    float at_u = dot(middle, along_u);
    float at_v = dot(middle, along_v);
    float more_slack = 1e-5 * (abs(at_u) + abs(at_v));
    return at_u + tile_u >= edge_u.x - more_slack && at_u - tile_u <= edge_u.y + more_slack && at_v + tile_v >= edge_v.x - more_slack &&
           at_v - tile_v <= edge_v.y + more_slack;
}

void add_kernel(int number, int first, inout Sums sums) {
    place_at = listed[4 * number];
    amount = listed[4 * number + 1].xyz;
    unit_of_px = listed[4 * number + 2];
    heights = listed[4 * number + 3];
    mat2 unit = mat2(unit_of_px.xy, unit_of_px.zw);
#ifdef PRECISE_PLACES
    int record = floatBitsToInt(listed[4 * number + 1].w);
    if (record >= 0) {
        int more = RECORD_SIZE * record;
        axes = records[more + 2];
        step_and_rest = vec4(records[more + 3].xy, records[more + 6].xy);
        axes_rest = records[more + 5];
        // Whole pixels beyond 2^24 leave no room for the axis: what the sum lost is part of the parts.
        vec4 place = records[more];
        vec4 rests = records[more + 4];
        heights_rest = vec4(vec2(dvec2(rests.xy) + (dvec2(place.xy) + dvec2(AXIS) - dvec2(place_at.xy))), rests.zw);
#ifdef PERSPECTIVE
        exact_depth = depth_of_first + double(first) * exact_spacing;
#endif
        add_sections(sections(exact_place(), vec4(0.0, 1.0, 2.0, 3.0), depths_of(first)), amount.x, amount.y, unit, heights.y, sums);
        return;
    }
#endif
    // Whole pixels first: the difference is exact, however far from the corner of the picture.
    vec2 from = (place_px - place_at.xy) - place_at.zw;
    add_sections(sections(unit * from, vec4(0.0, 1.0, 2.0, 3.0), depths_of(first)), amount.x, amount.y, unit, heights.y, sums);
}

// Kernels that may reach the tile, LISTED at a time, down the tree of bounds and in its order. Returns whether any does.
bool sum_ellipsoids(int part, int first, inout Sums sums) {
    int first_record = parts[part].kernels.x;
    int first_of_order = parts[part].kernels.y;
    int kernels = parts[part].kernels.z;
    int first_leaf = parts[part].kernels.w;
    int leaves = parts[part].size.x;
    int nodes = parts[part].size.y;
    bool any_met = false;
    for (int n = 0; n < nodes; n += POINTS) {
        int number;
        int node = n + my_number();
        bool met = node < nodes && meets(bounds[first_leaf + leaves + node], first);
        int nodes_here = number_those(met, number);
        if (met) {
            nodes_met[number] = node;
        }
        barrier();
        for (int m = 0; m < nodes_here; ++m) {
            int leaf = nodes_met[m] * TREE_ARITY + my_number();
            met = my_number() < TREE_ARITY && leaf < leaves && meets(bounds[first_leaf + leaf], first);
            int leaves_here = number_those(met, number);
            if (met) {
                leaves_met[number] = leaf;
            }
            barrier();
            for (int k = 0; k < leaves_here * TREE_ARITY; k += LISTED) {
                int candidate = k + my_number();
                met = false;
                if (my_number() < LISTED && candidate < leaves_here * TREE_ARITY) {
                    int kernel = leaves_met[candidate / TREE_ARITY] * TREE_ARITY + candidate % TREE_ARITY;
                    met = kernel < kernels && ready(first_record + int(order[first_of_order + kernel]), first);
                }
                int kernels_here = number_those(met, number);
                if (met) {
                    listed[4 * number] = place_at;
#ifdef PRECISE_PLACES
                    listed[4 * number + 1] = vec4(amount, intBitsToFloat(place_is_precise ? precise_record : -1));
#else
                    listed[4 * number + 1] = vec4(amount, 0.0);
#endif
                    listed[4 * number + 2] = unit_of_px;
                    listed[4 * number + 3] = heights;
                }
                barrier();
                for (int number_listed = 0; number_listed < kernels_here; ++number_listed) {
                    add_kernel(number_listed, first, sums);
                }
                any_met = any_met || kernels_here > 0;
            }
        }
    }
    return any_met;
}
#endif

#ifdef LATTICES
uniform sampler3D lattice_textures[LATTICES];
uniform int last_slab_of_all;
uniform usampler3D block_textures[LATTICES]; // not 0 where a sample that is drawn reaches into a block of BLOCK_EDGE^3 samples

shared ivec3 anchor_whole[PARTS]; // place of the tile's first point on the first slab among the samples: whole samples, and parts of them
shared vec3 anchor_part[PARTS];
shared vec3 anchor_step[PARTS];   // from slab to slab there
shared bool any_reached;

// One thread a field, in float64, so that places in the tile keep their digits.
void anchor(int part, int first) {
    dvec2 corner = dvec2(tile_corner) + 0.5;
    dvec3 step = parts[part].back.xyz;
#ifdef PERSPECTIVE
    corner -= dvec2(axis);
    step += corner.x * parts[part].right.xyz + corner.y * parts[part].down.xyz;
    dvec3 place = parts[part].start.xyz + (depth_of_first + double(first) * exact_spacing) * step;
    step *= exact_spacing;
#else
    dvec3 place = parts[part].start.xyz + corner.x * parts[part].right.xyz + corner.y * parts[part].down.xyz + double(first) * step;
#endif
    dvec3 whole = clamp(floor(place), dvec3(-1e8), dvec3(1e8));
    anchor_whole[part] = ivec3(whole);
    anchor_part[part] = vec3(place - whole);
    anchor_step[part] = vec3(step);
}

// Of one lattice: some drivers read the first of an array of samplers whatever the index, unless it is a constant.
#define OF_TEXTURES(number, fetched) \
    if (textures == number) { \
        return texelFetch(fetched[number], at, 0).r; \
    }
float sample_of(int textures, ivec3 at) {
#if LATTICES > 3
    OF_TEXTURES(3, lattice_textures)
#endif
#if LATTICES > 2
    OF_TEXTURES(2, lattice_textures)
#endif
#if LATTICES > 1
    OF_TEXTURES(1, lattice_textures)
#endif
    return texelFetch(lattice_textures[0], at, 0).r;
}
uint mark_of(int textures, ivec3 at) {
#if LATTICES > 3
    OF_TEXTURES(3, block_textures)
#endif
#if LATTICES > 2
    OF_TEXTURES(2, block_textures)
#endif
#if LATTICES > 1
    OF_TEXTURES(1, block_textures)
#endif
    return texelFetch(block_textures[0], at, 0).r;
}

// From the tile's first point to this one on the first slab, in samples, and from slab to slab here.
struct Ray {
    vec3 start, step;
};
Ray ray_among_samples(int part, int first) {
    vec2 from = vec2(gl_LocalInvocationID.xy);
    vec3 beside = from.x * vec3(parts[part].right.xyz) + from.y * vec3(parts[part].down.xyz);
#ifdef PERSPECTIVE
    float depth = first_depth + float(first) * slice_spacing;
    return Ray(anchor_part[part] + depth * beside, anchor_step[part] + slice_spacing * beside);
#else
    return Ray(anchor_part[part] + beside, anchor_step[part]);
#endif
}

// Whether samples that are drawn may reach a box, given from the anchor.
bool is_reached(int part, vec3 low, vec3 high) {
    ivec3 size = parts[part].size.xyz;
    vec3 reach = parts[part].reach.xyz + 1.0;
    vec3 whole = vec3(anchor_whole[part]);
    if (any(lessThan(high + whole, -reach)) || any(greaterThan(low + whole, vec3(size) + reach))) {
        return false;
    }
    ivec3 first = clamp(anchor_whole[part] + ivec3(floor(low)), ivec3(0), size - 1) / BLOCK_EDGE;
    ivec3 last = clamp(anchor_whole[part] + ivec3(floor(high)), ivec3(0), size - 1) / BLOCK_EDGE;
    for (int k = first.z; k <= last.z; ++k) {
        for (int j = first.y; j <= last.y; ++j) {
            for (int i = first.x; i <= last.x; ++i) {
                if (mark_of(parts[part].kind.w, ivec3(i, j, k)) != 0u) {
                    return true;
                }
            }
        }
    }
    return false;
}

// f - b of a sample, less its pivot; false where it is no kernel.
bool is_kernel(int part, ivec3 sample_at, out float value) {
    value = sample_of(parts[part].kind.w, sample_at);
    COUNT_SAMPLE;
#ifdef HOLES
    if (isnan(value)) {
        return false;
    }
#endif
    value = value * parts[part].texels.x + parts[part].texels.y;
    return true;
}

#ifdef PRODUCTS
// Samples around a point, whose kernels are products of three Gaussians, each of which follows from the one before it. at: from the anchor.
// Returns the sums of values and of weights.
vec2 gathered(int part, vec3 at) {
    ivec3 whole = anchor_whole[part];
    vec3 reach = parts[part].reach.xyz;
    vec3 pace = parts[part].pace.xyz;
    vec3 bend = exp2(-2.0 * falloff_log2 * pace * pace);
    vec2 sums = vec2(0.0);
    int low_z = max(int(ceil(at.z - reach.z)), -whole.z);
    int high_z = min(int(floor(at.z + reach.z)), parts[part].size.z - 1 - whole.z);
    for (int k = low_z; k <= high_z; ++k) {
        vec2 beside = at.xy;
        if (parts[part].reach.w != 0.0 && ((k + whole.z) & 1) == 1) {
            beside -= 0.5;
        }
        ivec2 low = max(ivec2(ceil(beside - reach.xy)), -whole.xy);
        ivec2 high = min(ivec2(floor(beside + reach.xy)), parts[part].size.xy - 1 - whole.xy);
        vec3 from = (vec3(low, k) - vec3(beside, at.z)) * pace;
        float bell_z = exp2(-falloff_log2 * from.z * from.z);
        vec2 bell = exp2(-falloff_log2 * from.xy * from.xy);
        vec2 ratio = exp2(-falloff_log2 * pace.xy * (2.0 * from.xy + pace.xy));
        float bell_y = bell.y * bell_z;
        float ratio_y = ratio.y;
        for (int j = low.y; j <= high.y; ++j) {
            if (bell_y > edge) {
                float bell_x = bell.x * bell_y;
                float ratio_x = ratio.x;
                for (int i = low.x; i <= high.x; ++i) {
                    float g = bell_x - edge;
                    float value;
                    if (g > 0.0 && is_kernel(part, whole + ivec3(i, j, k), value)) {
                        sums += g * vec2(value, 1.0);
                    }
                    bell_x *= ratio_x;
                    ratio_x *= bend.x;
                }
            }
            bell_y *= ratio_y;
            ratio_y *= bend.y;
        }
    }
    return sums;
}

bool reaches_me(int part, int first, inout Sums sums) {
    Ray ray = ray_among_samples(part, first);
    bool any_slab = false;
    for (int c = 0; c < 4; ++c) {
        vec3 at = ray.start + float(c) * ray.step;
        if (first + c <= last_slab_of_all && is_reached(part, at, at)) {
            vec2 both = gathered(part, at);
            sums.value[c] = both.x * parts[part].texels.w;
#ifdef SUM_WEIGHTS
            sums.weight[c] = both.y > 0.0 ? max(parts[part].kernel.w * both.y, 1e-37) : 0.0;
#endif
            any_slab = true;
        }
    }
    return any_slab;
}
#else
// All samples that reach a ray in the four slabs, one after the other.
bool reaches_me(int part, int first, inout Sums sums) {
    Ray ray = ray_among_samples(part, first);
    ivec3 whole = anchor_whole[part];
    vec3 front = ray.start - slab_reach * ray.step;
    vec3 back = ray.start + (3.0 + slab_reach) * ray.step;
    vec3 more = vec3(0.0);
#ifdef FINE
    more = (abs(vec3(parts[part].right.xyz)) + abs(vec3(parts[part].down.xyz))) * depths_of(first).w;
#endif
    if (!is_reached(part, min(front, back) - more, max(front, back) + more)) {
        return false;
    }
    more += parts[part].reach.xyz;
    bool shifted = parts[part].reach.w != 0.0;
    ivec3 low = max(ivec3(ceil(min(front, back) - more)), -whole);
    ivec3 high = min(ivec3(floor(max(front, back) + more)), parts[part].size.xyz - 1 - whole);
    mat3 frame = transpose(mat3(parts[part].frame_s.xyz, parts[part].frame_u.xyz, parts[part].frame_v.xyz));
    vec3 step = frame * ray.step;
    float step_s = -step.x;
    mat2 unit = mat2(parts[part].unit.xy, parts[part].unit.zw);
    const vec4 slabs = vec4(0.0, 1.0, 2.0, 3.0);
    Sections at;
    at.depth = depths_of(first);
    at.ray = step.yz / step_s;
    float scale = parts[part].texels.w;
    for (int k = low.z; k <= high.z; ++k) {
        float shift = shifted && ((k + whole.z) & 1) == 1 ? 0.5 : 0.0;
        for (int j = low.y - int(shifted); j <= high.y; ++j) {
            for (int i = low.x - int(shifted); i <= high.x; ++i) {
                ivec3 sample_at = whole + ivec3(i, j, k);
                vec3 q = frame * (ray.start - vec3(float(i) + shift, float(j) + shift, float(k)));
                float value;
                if (min(sample_at.x, sample_at.y) >= 0 && is_kernel(part, sample_at, value)) {
                    at.s = q.x + step.x * slabs;
                    at.ax = q.y + step.y * slabs;
                    at.ay = q.z + step.z * slabs;
                    add_sections(at, value * scale, parts[part].kernel.w, unit, step_s, sums);
                }
            }
        }
    }
    return true;
}
#endif

bool sum_lattice(int part, int first, inout Sums sums) {
    if (reaches_me(part, first, sums)) {
        any_reached = true;
    }
    barrier();
    return any_reached;
}
#endif

void clear_sums() {
    for (int plane = 0; plane < SHEET_GROUPS * PLANES; ++plane) {
        sheets[(back_planes + plane) * POINTS + my_number()] = vec4(0.0);
    }
}

// Makes the newest slabs those that nothing reaches.
void make_empty() {
    clear_sums();
    for (int part = 0; part < PARTS; ++part) {
        add_field(part, no_sums());
    }
}

// Sums all fields in four slabs from `first` on. Returns whether any kernel reaches the tile there.
bool sum_slabs(int first) {
    COUNT_BARRIERS(4);
    clear_sums();
#ifdef LATTICES
    if (my_number() < PARTS && parts[my_number()].kind.x != 0) {
        anchor(my_number(), first);
    }
    if (my_number() == 0) {
        any_reached = false;
    }
    barrier();
#endif
    bool any_met = false;
    for (int part = 0; part < PARTS; ++part) {
        falloff_log2 = parts[part].kernel.x;
        edge = parts[part].kernel.y;
#ifdef SLAB
        falloff_root = parts[part].kernel.z;
#endif
        Sums sums = no_sums();
#ifdef LATTICES
        if (parts[part].kind.x != 0) {
            any_met = sum_lattice(part, first, sums) || any_met;
        }
#endif
#ifdef ELLIPSOIDS
        if (parts[part].kind.x == 0) {
            any_met = sum_ellipsoids(part, first, sums) || any_met;
        }
#endif
        add_field(part, sums);
    }
    barrier();
    return any_met;
}

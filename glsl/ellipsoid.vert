// An ellipsoid of a batch: the rectangle around its sections in the slabs that the batch covers, along the sections' own axes, or a
// point sprite around a sphere. [NM06] sections 3.3 and 4.1: start position, u, v, step, unit-sphere step and start height.
#include "lib/interop.h"

uniform vec2 target_size;   // pixels of the sheets
uniform vec2 axis;          // pixel where the optical axis meets the sheets
uniform float tag;          // depth in normalised device coordinates that marks touched pixels
uniform float batch_first;  // slice of the batch's first slab
#ifdef SPRITE
uniform vec4 offset_front;  // slab of each channel, counted from there
#ifdef TWO_TARGETS
uniform vec4 offset_back;
#endif
uniform float falloff_log2; // k log2(e)
uniform vec2 guard;         // pixels by which the viewport is larger than the sheets on every side
uniform float sprite_margin;
#else
uniform float last_offset;  // of the slabs that are covered
uniform float slab_reach;   // half a slab where slabs are averaged, and what differences over depth reach further
uniform float margin;       // pixels by which the rectangle is larger
#endif
#ifdef PERSPECTIVE
uniform float first_depth;  // of the batch's first slice
uniform float slice_spacing;
#endif

#ifdef RESIDENT
uniform samplerBuffer records;
layout(location = ATTRIBUTE_RECORD_INDEX) in uint record_index;
#else
layout(location = ATTRIBUTE_RECORD_PLACE) in vec4 record_place;     // centre on the record's slice: whole pixels, parts of pixels
layout(location = ATTRIBUTE_RECORD_HEIGHTS) in vec4 record_heights; // the slice, height there, step of the height, value
layout(location = ATTRIBUTE_RECORD_AXES) in vec4 record_axes;       // B u, B v
layout(location = ATTRIBUTE_RECORD_STEP) in vec4 record_step;       // step of the centre, weight
#endif
#ifdef PRECISE_PLACES
layout(location = ATTRIBUTE_REST_HEIGHTS) in vec4 rest_heights;     // parts of pixels, height, its step
layout(location = ATTRIBUTE_REST_AXES) in vec4 rest_axes;
layout(location = ATTRIBUTE_REST_STEP) in vec4 rest_step;
flat out vec4 axes;
flat out vec4 step_and_rest; // step of the centre, and what float32 cut off it
flat out vec4 axes_rest;
flat out vec4 heights_rest;
#endif

flat out vec4 place_at;     // centre on the record's slice: whole pixels, parts of pixels
flat out vec3 amount;       // value, weight, slabs from the record's slice to the batch's first one
#ifdef SPRITE
flat out vec4 section_front;
#ifdef TWO_TARGETS
flat out vec4 section_back;
#endif
flat out float falloff_px;  // -k log2(e) over the radius in pixels, squared
#else
flat out vec4 unit_of_px;   // columns of: pixels (times depth) -> plane of the unit sphere
flat out vec4 heights;      // height there, step; step of the centre in the plane of the unit sphere
#endif

const vec4 nowhere = vec4(2.0, 2.0, 2.0, 1.0);

#ifndef SPRITE
#include "lib/ellipsoid_edges.glsl"
#endif

void main() {
#ifdef RESIDENT
    int first_texel = 4 * int(record_index);
    vec4 record_place = texelFetch(records, first_texel);
    vec4 record_heights = texelFetch(records, first_texel + 1);
    vec4 record_axes = texelFetch(records, first_texel + 2);
    vec4 record_step = texelFetch(records, first_texel + 3);
#endif
    float since = batch_first - record_heights.x;
    vec2 step = record_step.xy;
    place_at = vec4(record_place.xy + axis, record_place.zw);
    amount = vec3(record_heights.w, record_step.z, since);
    float step_s = record_heights.z;
    float height = record_heights.y;
#ifdef PRECISE_PLACES
    axes = record_axes;
    axes_rest = rest_axes;
    // Whole pixels beyond 2^24 leave no room for the axis: what the sum lost is part of the parts.
    heights_rest = vec4(vec2(dvec2(rest_heights.xy) + (dvec2(record_place.xy) + dvec2(axis) - dvec2(place_at.xy))), rest_heights.zw);
    step_and_rest = vec4(step, rest_step.xy);
#endif

#ifdef SPRITE
    vec4 front = height - (since + offset_front) * step_s;
    section_front = exp2(-falloff_log2 * front * front);
    vec4 nearest = front * front;
#ifdef TWO_TARGETS
    vec4 back = height - (since + offset_back) * step_s;
    section_back = exp2(-falloff_log2 * back * back);
    nearest = min(nearest, back * back);
#endif
    float radius = length(record_axes.xy);
    falloff_px = -falloff_log2 / (radius * radius);
    // A section at height s has the radius sqrt(1 - s^2): no sprite needs to be larger than its largest section.
    float lowest = min(min(nearest.x, nearest.y), min(nearest.z, nearest.w));
    gl_PointSize = 2.0 * radius * sqrt(max(1.0 - lowest, 0.0)) + sprite_margin;
    gl_Position = lowest < 1.0 ? vec4((place_at.xy + place_at.zw + guard) / (target_size + 2.0 * guard) * 2.0 - 1.0, tag, 1.0) : nowhere;
#else
    vec2 u = record_axes.xy;
    vec2 v = record_axes.zw;
    float length_u = length(u);
    float length_v = length(v);
    vec2 along_u = u / length_u;
    vec2 along_v = v / length_v;
    // The axes are orthogonal, so that their inverse needs no determinant.
    unit_of_px = vec4(along_u.x / length_u, along_v.x / length_v, along_u.y / length_u, along_v.y / length_v);
    vec2 unit_step = vec2(dot(along_u, step) / length_u, dot(along_v, step) / length_v);
    heights = vec4(height, step_s, unit_step);

    vec2 slabs = slabs_met(vec2(since - slab_reach, since + last_offset + slab_reach), height, step_s);
    if (slabs.x > slabs.y) {
        gl_Position = nowhere;
        return;
    }
    vec2 edge_u = edge_over(slabs, height, step_s, unit_step.x) * length_u;
    vec2 edge_v = edge_over(slabs, height, step_s, unit_step.y) * length_v;
#ifdef PERSPECTIVE
    vec2 depths = first_depth + (slabs - since) * slice_spacing;
    bool through_eye = depths.x <= 1e-6 * slice_spacing;
    depths = max(depths, vec2(1e-30));
    edge_u = over_depths(edge_u, depths);
    edge_v = over_depths(edge_v, depths);
#endif
    edge_u += vec2(-1.0, 1.0) * (margin + 1e-5 * (edge_u.y - edge_u.x));
    edge_v += vec2(-1.0, 1.0) * (margin + 1e-5 * (edge_v.y - edge_v.x));
    // Along both axes no more than the sheets need: rasterisers are inaccurate for corners millions of pixels away.
    vec2 low = vec2(-1.0) - place_at.xy - place_at.zw;
    vec2 high = target_size + 1.0 - place_at.xy - place_at.zw;
    vec2 window_u = vec2(dot(mix(high, low, greaterThan(along_u, vec2(0.0))), along_u), dot(mix(low, high, greaterThan(along_u, vec2(0.0))), along_u));
    vec2 window_v = vec2(dot(mix(high, low, greaterThan(along_v, vec2(0.0))), along_v), dot(mix(low, high, greaterThan(along_v, vec2(0.0))), along_v));
    edge_u = clamp(edge_u, window_u.x, window_u.y);
    edge_v = clamp(edge_v, window_v.x, window_v.y);
    vec2 corner = vec2(gl_VertexID & 1, gl_VertexID >> 1);
    vec2 from = along_u * mix(edge_u.x, edge_u.y, corner.x) + along_v * mix(edge_v.x, edge_v.y, corner.y);
    vec2 at = place_at.xy + (place_at.zw + from);
    // From so far off, float32 cannot tell the corners of the window apart: the rectangle is all of it.
    bool far_off = max(abs(place_at.x), abs(place_at.y)) > 1048576.0;
#ifdef PERSPECTIVE
    far_off = far_off || through_eye;
#endif
    if (far_off) {
        at = mix(vec2(-1.0), target_size + 1.0, corner);
    }
    gl_Position = vec4(at / target_size * 2.0 - 1.0, tag, 1.0);
#endif
}

// A kernel of a batch: a point sprite or a quad, and its sections in the slabs that the batch covers.
// [NM05] sections 4.1 and 4.2; [NM06] section 3.3 for cross-sections of ellipsoids.
#include "lib/interop.h"
#include "lib/splat.glsl"

uniform float tag;          // depth in normalised device coordinates that marks touched pixels
uniform vec4 offset_front;  // slab of each channel, counted from the batch's first one
uniform vec4 offset_back;
uniform float step_s;       // slice spacing over half-depth
#ifdef POINTS
uniform vec2 guard;         // pixels by which the viewport is larger than the sheets on every side
uniform float point_size;
#else
uniform vec2 half_size;     // pixels, orthographic
#endif
#ifdef SEPARABLE
uniform float falloff_log2;
#ifdef NONNEGATIVE
uniform float edge;
#endif
#endif
#ifdef GENERAL
uniform vec2 shear;         // shift of the section per unit of height, in the plane of the unit sphere
#endif
#ifdef PERSPECTIVE
uniform float first_depth;  // of the batch's first slice
uniform float slice_spacing;
uniform float half_depth;
uniform float last_offset;  // of the slabs that are covered
#endif

layout(location = ATTRIBUTE_SAMPLE) in vec4 sample_in; // x, y in pixels; height of the first slice; value
#ifdef PERSPECTIVE
layout(location = ATTRIBUTE_BOX) in vec4 box_in;
#endif

flat out vec3 kernel; // centre in pixels, value
#ifdef SEPARABLE
flat out vec4 section_front;
flat out vec4 section_back;
#else
flat out vec4 s_front;
flat out vec4 s_back;
#endif
#ifdef GENERAL
flat out vec4 shift_x_front;
flat out vec4 shift_y_front;
flat out vec4 shift_x_back;
flat out vec4 shift_y_back;
#ifdef PERSPECTIVE
flat out vec2 drift;
#endif
#endif

void main() {
    kernel = sample_in.xyw;
    vec4 front = sample_in.z - offset_front * step_s;
    vec4 back = sample_in.z - offset_back * step_s;
#ifdef SEPARABLE
    section_front = exp2(-falloff_log2 * front * front);
    section_back = exp2(-falloff_log2 * back * back);
#ifdef NONNEGATIVE
    // A factor that is not negative may be taken into the max, here once instead of there for every pixel.
    section_front *= sample_in.w;
    section_back *= sample_in.w;
    kernel.z *= edge;
#endif
#else
    s_front = front;
    s_back = back;
#endif
#ifdef GENERAL
    shift_x_front = -front * shear.x;
    shift_y_front = -front * shear.y;
    shift_x_back = -back * shear.x;
    shift_y_back = -back * shear.y;
#ifdef PERSPECTIVE
    // The centre is its ray at a reference depth between the slices; the ray leaves it by `drift` per unit of depth.
    drift = to_unit * (kernel.xy - axis);
    float reference = clamp(sample_in.z * half_depth, 0.0, last_offset * slice_spacing);
    float reached = min((sample_in.z + 1.0) * half_depth, last_offset * slice_spacing);
    reference = max(reference, 0.6 * (first_depth + reached) - first_depth);
    vec4 away_front = offset_front * slice_spacing - reference;
    vec4 away_back = offset_back * slice_spacing - reference;
    shift_x_front += drift.x * away_front;
    shift_y_front += drift.y * away_front;
    shift_x_back += drift.x * away_back;
    shift_y_back += drift.y * away_back;
#endif
#endif

#ifdef POINTS
    gl_Position = vec4((sample_in.xy + guard) / (target_size + 2.0 * guard) * 2.0 - 1.0, tag, 1.0);
    gl_PointSize = point_size;
#else
    vec2 corner = vec2(gl_VertexID & 1, gl_VertexID >> 1);
#ifdef PERSPECTIVE
    vec2 at = mix(box_in.xy, box_in.zw, corner);
#else
    vec2 at = sample_in.xy + (2.0 * corner - 1.0) * half_size;
#endif
    // Kernels far larger than the sheets: rasterisers are inaccurate for corners millions of pixels away.
    at = clamp(at, vec2(-1.0), target_size + 1.0);
    gl_Position = vec4(at / target_size * 2.0 - 1.0, tag, 1.0);
#endif
}

// A kernel that was coloured before it is summed: the way of splatting before [NM05], kept for comparison.
#include "lib/interop.h"
#include "lab_interop.h"

uniform vec2 target_size;
uniform vec2 half_size; // pixels

layout(location = ATTRIBUTE_SAMPLE) in vec4 sample_in; // x, y in pixels; height of the slice; not used
layout(location = ATTRIBUTE_COLOR) in vec4 color_in;   // premultiplied, times the kernel's share of a constant field

flat out vec3 kernel; // centre in pixels, height
flat out vec4 color;

void main() {
    kernel = sample_in.xyz;
    color = color_in;
    vec2 corner = vec2(gl_VertexID & 1, gl_VertexID >> 1);
    gl_Position = vec4((sample_in.xy + (2.0 * corner - 1.0) * half_size) / target_size * 2.0 - 1.0, 0.0, 1.0);
}

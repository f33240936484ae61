// A corner of a kernel's polygon in the current slice, with its place in the unit sphere. [NM06] section 4.1: the vertex program
// decides whether the kernel meets the slice, and moves it out of the view where it does not; the Gaussian along the slicing axis is
// computed here.
#include "lib/interop.h"

uniform sampler2D start_texture; // centre on the first slice, that slice, height there
uniform sampler2D axes_texture;  // B u, length of B v, step of the height
uniform sampler2D step_texture;  // step of the centre, value, weight
uniform float current_slice;     // currentSlicingZ, from the same slice as the first slices
uniform vec2 origin;             // pixel of the targets from which places are counted
uniform vec2 target_size;
uniform float tag;
uniform float margin;            // pixels by which a rasteriser may cut a polygon short
uniform float falloff_log2;      // k log2(e)

out vec2 place;       // in the plane of the unit sphere
flat out vec3 amount; // Gaussian of the height, value, weight

void main() {
    int kernel = gl_VertexID / 6;
    int number = gl_VertexID % 6;
    ivec2 texel = ivec2(kernel % KERNEL_COLUMNS, kernel / KERNEL_COLUMNS);
    vec4 start = texelFetch(start_texture, texel, 0);
    vec4 axes = texelFetch(axes_texture, texel, 0);
    vec4 step = texelFetch(step_texture, texel, 0);
    float since = current_slice - start.z;
    float height = start.w - since * axes.w;
    amount = vec3(exp2(-falloff_log2 * height * height), step.zw);
    place = vec2(0.0);
    gl_Position = vec4(2.0, 2.0, 2.0, 1.0);
    if (since >= 0.0 && abs(height) <= 1.0) {
        // 0 1 2, 2 1 3
        int corner = number < 3 ? number : number == 3 ? 2 : number == 4 ? 1 : 3;
        float length_u = length(axes.xy);
        vec2 along = axes.xy / length_u;
        vec2 lengths = vec2(length_u, axes.z);
        vec2 from = (vec2(corner & 1, corner >> 1) * 2.0 - 1.0) * (lengths + margin);
        place = from / lengths;
        vec2 at = origin + (start.xy + since * step.xy + from.x * along + from.y * vec2(-along.y, along.x));
        gl_Position = vec4(at / target_size * 2.0 - 1.0, tag, 1.0);
    }
}

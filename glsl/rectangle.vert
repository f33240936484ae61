// Rectangles of pixels, one an instance: whole targets or the touched tiles.
#include "lib/interop.h"

uniform vec2 target_size;
uniform float tag;

layout(location = ATTRIBUTE_RECTANGLE) in vec4 rectangle_in; // x0, y0, x1, y1 in pixels

void main() {
    vec2 corner = vec2(gl_VertexID & 1, gl_VertexID >> 1);
    gl_Position = vec4(mix(rectangle_in.xy, rectangle_in.zw, corner) / target_size * 2.0 - 1.0, tag, 1.0);
}

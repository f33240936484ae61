// Adds a coloured kernel to the sheet of one slab.
#include "lib/kernel.glsl"

uniform mat2 to_unit;

flat in vec3 kernel;
flat in vec4 color;

out vec4 sheet_front;

void main() {
    vec2 place = to_unit * (gl_FragCoord.xy - kernel.xy);
    sheet_front = color * kernel_at(vec4(kernel.z), vec4(place.x), vec4(place.y)).x;
}

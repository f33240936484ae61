// Early splat elimination ([NM05] section 4.4): marks opaque pixels at depth 0, in front of every tag. A pixel may go only when
// its four neighbours are opaque too, because it still feeds their gradients.
#include "lib/interop.h"

uniform sampler2D image_texture;
uniform float opacity_stop;
uniform ivec2 last_pixel; // of the sheets without their border

bool opaque(ivec2 at) {
    // Pixels of the border belong to no picture: nobody looks at them.
    return any(lessThan(at, ivec2(1))) || any(greaterThan(at, last_pixel)) || texelFetch(image_texture, at, 0).a >= opacity_stop;
}

void main() {
    ivec2 at = ivec2(gl_FragCoord.xy);
    if (!(opaque(at) && opaque(at + ivec2(1, 0)) && opaque(at - ivec2(1, 0)) && opaque(at + ivec2(0, 1)) && opaque(at - ivec2(0, 1)))) {
        discard;
    }
}

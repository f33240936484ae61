// Copies the finished slab from the splat buffer to the copy buffer; the colour mask leaves the other three alone.
// [NM05] section 4.2, figure 2.
#include "lib/interop.h"

uniform sampler2D sheet_front_texture;
out vec4 sheet_copy;
#ifdef WEIGHT
uniform sampler2D weight_front_texture;
out vec4 weight_copy;
#endif
#ifdef FINE
uniform sampler2D x_front_texture;
uniform sampler2D y_front_texture;
uniform sampler2D z_front_texture;
out vec4 x_copy;
out vec4 y_copy;
out vec4 z_copy;
#endif

void main() {
    ivec2 at = ivec2(gl_FragCoord.xy);
    sheet_copy = texelFetch(sheet_front_texture, at, 0);
#ifdef WEIGHT
    weight_copy = texelFetch(weight_front_texture, at, 0);
#endif
#ifdef FINE
    x_copy = texelFetch(x_front_texture, at, 0);
    y_copy = texelFetch(y_front_texture, at, 0);
    z_copy = texelFetch(z_front_texture, at, 0);
#endif
}

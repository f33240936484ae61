// Adds a field that is normalised by itself to the sheet of all fields: D / max(w0, W), and W. [NM06] equation 20.
#include "lib/interop.h"

uniform sampler2D sheet_front_texture;
uniform sampler2D weight_front_texture;
uniform float w0;

out vec4 sheet_sum;
#ifdef WEIGHT
out vec4 weight_sum;
#endif

void main() {
    ivec2 at = ivec2(gl_FragCoord.xy);
    vec4 weight = texelFetch(weight_front_texture, at, 0);
    sheet_sum = texelFetch(sheet_front_texture, at, 0) / max(weight, vec4(w0));
#ifdef WEIGHT
    weight_sum = weight;
#endif
}

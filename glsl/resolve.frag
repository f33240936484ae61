// Adds a field that is divided by its own weights to the sheet of all fields.
#include "lib/interop.h"
#include "lib/division.glsl"

uniform sampler2D sheet_front_texture;
uniform sampler2D weight_front_texture;
uniform float w0;
uniform float pivot;
uniform float half_range;
uniform float least_weight;

#ifdef SLOPES
uniform sampler2D x_front_texture;
uniform sampler2D y_front_texture;
uniform sampler2D z_front_texture;
uniform sampler2D weight_x_front_texture;
uniform sampler2D weight_y_front_texture;
uniform sampler2D weight_z_front_texture;
#endif

out vec4 sheet_sum;
#ifdef SLOPES
out vec4 x_sum;
out vec4 y_sum;
out vec4 z_sum;
#endif
#ifdef WEIGHT
out vec4 weight_sum;
#endif

void main() {
    ivec2 at = ivec2(gl_FragCoord.xy);
    Division by = Division(w0, pivot, half_range, least_weight);
    vec4 weight = texelFetch(weight_front_texture, at, 0);
    vec4 d = texelFetch(sheet_front_texture, at, 0);
    sheet_sum = divided(by, d, weight);
#ifdef SLOPES
    x_sum = divided_slope(by, d, weight, texelFetch(x_front_texture, at, 0), texelFetch(weight_x_front_texture, at, 0));
    y_sum = divided_slope(by, d, weight, texelFetch(y_front_texture, at, 0), texelFetch(weight_y_front_texture, at, 0));
    z_sum = divided_slope(by, d, weight, texelFetch(z_front_texture, at, 0), texelFetch(weight_z_front_texture, at, 0));
#endif
#ifdef WEIGHT
    weight_sum = counted_weight(by, weight);
#endif
}

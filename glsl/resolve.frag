// Adds a field that is normalised by itself to the sheet of all fields: D / max(w0, W), its derivatives, and W. [NM06] equation 20.
#include "lib/interop.h"

uniform sampler2D sheet_front_texture;
uniform sampler2D weight_front_texture;
uniform float w0;
#ifdef WEIGHT
uniform float least_weight;
#endif

#ifdef SLOPES
uniform sampler2D x_front_texture;
uniform sampler2D y_front_texture;
uniform sampler2D z_front_texture;
uniform sampler2D weight_x_front_texture;
uniform sampler2D weight_y_front_texture;
uniform sampler2D weight_z_front_texture;
#endif
#ifdef PIVOT
uniform float pivot;      // what values in D, and rho in the sheet of all fields, are less by
uniform float half_range; // what values in D are divided by
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
    vec4 weight = texelFetch(weight_front_texture, at, 0);
    vec4 divisor = max(weight, vec4(w0));
    vec4 quotient = texelFetch(sheet_front_texture, at, 0) / divisor;
#ifdef PIVOT
    sheet_sum = half_range * quotient + pivot * (min(weight / w0, 1.0) - 1.0);
#else
    const float pivot = 0.0;
    const float half_range = 1.0;
    sheet_sum = quotient;
#endif
#ifdef SLOPES
    // The derivative of (D + pivot W) / max(w0, W): w0 has none.
    vec4 varying_part = mix(vec4(-pivot / half_range), quotient, greaterThan(weight, vec4(w0)));
    divisor /= half_range;
    x_sum = (texelFetch(x_front_texture, at, 0) - varying_part * texelFetch(weight_x_front_texture, at, 0)) / divisor;
    y_sum = (texelFetch(y_front_texture, at, 0) - varying_part * texelFetch(weight_y_front_texture, at, 0)) / divisor;
    z_sum = (texelFetch(z_front_texture, at, 0) - varying_part * texelFetch(weight_z_front_texture, at, 0)) / divisor;
#endif
#ifdef WEIGHT
    // Where its weight is too small the field is empty.
    weight_sum = mix(vec4(0.0), weight, greaterThanEqual(weight, vec4(least_weight)));
#endif
}

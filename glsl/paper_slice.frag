// Slices one ellipsoid for a view, a texel each. [NM06] sections 3.3 and 4.1: from scales, rotation, centre, value and weight to the
// place of the first intersecting slice, the axes of the slicing polygon, the steps from slice to slice on the screen and in the unit
// sphere, and the height at which that begins.
#include "lib/interop.h"

#ifdef FLOAT64
#define REAL double
#define REAL2 dvec2
#define REAL3 dvec3
#define REAL4 dvec4
#else
#define REAL float
#define REAL2 vec2
#define REAL3 vec3
#define REAL4 vec4
#endif

uniform usampler2D order_texture;   // the kernel of each texel
uniform sampler2D center_texture;   // centre from the field's centre, value times weight
uniform sampler2D scale_texture;    // semi-axes, weight
uniform sampler2D rotation_texture; // quaternion x, y, z, w: own axes -> world
uniform REAL3 right, up, back;      // of the view
uniform REAL3 middle;               // the field's centre: pixels to the right and down, slices back, from whole ones
uniform REAL pixels, slices;        // to a unit of length
uniform float value_scale, weight_scale, least_weight;

out vec4 start_out; // centre on the first slice, that slice, height there
out vec4 axes_out;  // B u, length of B v, step of the height
out vec4 step_out;  // step of the centre, value, weight

// From the world to the kernel's own axes.
REAL3 turned_back(REAL4 q, REAL3 v) { return v + REAL(2.0) * cross(-q.xyz, cross(-q.xyz, v) + q.w * v); }

void main() {
    ivec2 at = ivec2(gl_FragCoord.xy);
    int kernel = int(texelFetch(order_texture, at, 0).r);
    ivec2 texel = ivec2(kernel % KERNEL_COLUMNS, kernel / KERNEL_COLUMNS);
    vec4 center_value = texelFetch(center_texture, texel, 0);
    vec4 scale_weight = texelFetch(scale_texture, texel, 0);
    REAL3 center = REAL3(center_value.xyz);
    REAL3 scale = REAL3(scale_weight.xyz);
    // Rounded numbers are no unit quaternion.
    REAL4 rotation = normalize(REAL4(texelFetch(rotation_texture, texel, 0)));

    // Rows of B = V R S.
    REAL3 row_x = turned_back(rotation, right) * scale;
    REAL3 row_y = turned_back(rotation, up) * scale;
    REAL3 row_z = turned_back(rotation, back) * scale;
    REAL half_depth = length(row_z);
    REAL3 n = row_z / half_depth;
    REAL3 u = normalize(cross(n, abs(n.x) < REAL(0.6) ? REAL3(1.0, 0.0, 0.0) : REAL3(0.0, 1.0, 0.0)));
    REAL3 v = cross(n, u);
    REAL2 a = REAL2(dot(row_x, u), dot(row_y, u));
    REAL2 b = REAL2(dot(row_x, v), dot(row_y, v));
    REAL across = dot(a, b);
    REAL2 axis = a;
    if (across != REAL(0.0)) {
        REAL zeta = (dot(b, b) - dot(a, a)) / (REAL(2.0) * across);
        // Beyond, its square leaves float32, and the two are orthogonal.
        REAL t = abs(zeta) > REAL(1e8) ? REAL(0.0) : (zeta >= REAL(0.0) ? REAL(1.0) : REAL(-1.0)) / (abs(zeta) + sqrt(REAL(1.0) + zeta * zeta));
        REAL c = inversesqrt(REAL(1.0) + t * t);
        axis = c * (a - t * b);
        b = c * (b + t * a);
    }
    if (dot(axis, axis) < dot(b, b)) {
        axis = b;
    }
    // |B u x B v| = det B / |B^T e_z|: the shorter axis keeps its digits.
    REAL shorter = scale.x * (scale.y / half_depth) * (scale.z / length(axis));
    REAL2 lean = REAL2(dot(row_x, n), -dot(row_y, n)) * pixels;

    REAL depth = middle.z - dot(back, center) * slices;
    REAL reach = half_depth * slices;
    REAL first = ceil(depth - reach);
    REAL height = (depth - first) / reach;
    REAL2 place = middle.xy + REAL2(dot(right, center), -dot(up, center)) * pixels + height * lean;
    start_out = vec4(vec2(place), float(first), float(height));
    axes_out = vec4(vec2(REAL2(axis.x, -axis.y) * pixels), float(shorter * pixels), float(REAL(1.0) / reach));
    step_out = vec4(vec2(-lean / reach), center_value.w * value_scale, max(scale_weight.w * weight_scale, least_weight));
}

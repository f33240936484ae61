// Slices one ellipsoid for a view: the record that all its sections are drawn from. [NM06] sections 3.3 and 4.1 in factored form, in
// float64; the same arithmetic as view/ellipsoid_view.cpp. Captured by transform feedback, one record a kernel.
#include "lib/interop.h"

uniform dvec3 eye;   // from the field's centre, world
uniform dvec3 right; // the eye's axes in the world
uniform dvec3 up;
uniform dvec3 back;
uniform double pixel; // width of a pixel: world units, or per unit of depth in perspective
uniform double slice_spacing;
uniform double first_depth; // of slice 0
uniform double last_slice;
uniform double value_scale;
uniform double pivot;        // what values are less by, and then divided by (Counting)
uniform double half_range;   // 0: not at all
uniform double weight_scale;
uniform double least_weight; // of kernels of weight 0, so that points that they reach do not count as empty

layout(location = ATTRIBUTE_KERNEL_CENTER) in dvec3 center; // from the field's centre, world
layout(location = ATTRIBUTE_KERNEL_AXIS_A) in dvec3 axis_a; // semi-axes
layout(location = ATTRIBUTE_KERNEL_AXIS_B) in dvec3 axis_b;
layout(location = ATTRIBUTE_KERNEL_AXIS_C) in dvec3 axis_c;
layout(location = ATTRIBUTE_KERNEL_AMOUNT) in dvec2 amount; // value, weight

out vec4 record_place;
out vec4 record_heights;
out vec4 record_axes;
out vec4 record_step; // in w: 1 where float32 is too coarse for its places
#ifdef RESTS
// What float32 cut off.
out vec4 rest_heights;
out vec4 rest_axes;
out vec4 rest_step;
uniform double precise_aspect; // longest over shortest semi-axis, and
uniform double least_px;       // semi-axis in pixels, from and up to which it is

double rest_of(double number) { return number - double(float(number)); }
dvec2 rest_of(dvec2 numbers) { return numbers - dvec2(vec2(numbers)); }
#endif

// Rows count downwards, eye y upwards.
dvec2 on_screen(dvec2 eye_xy) {
    return dvec2(eye_xy.x, -eye_xy.y) / pixel;
}

void main() {
    dvec3 from_eye = center - eye;
    dvec3 center_eye = dvec3(dot(from_eye, right), dot(from_eye, up), dot(from_eye, back));
    // Rows of B.
    dvec3 row_x = dvec3(dot(right, axis_a), dot(right, axis_b), dot(right, axis_c));
    dvec3 row_y = dvec3(dot(up, axis_a), dot(up, axis_b), dot(up, axis_c));
    dvec3 row_z = dvec3(dot(back, axis_a), dot(back, axis_b), dot(back, axis_c));
    double half_depth = sqrt(dot(row_z, row_z));
    dvec3 n = row_z / half_depth;
    dvec3 helper = abs(n.x) < 0.6 ? dvec3(1.0, 0.0, 0.0) : dvec3(0.0, 1.0, 0.0);
    dvec3 u = cross(n, helper);
    u /= sqrt(dot(u, u));
    dvec3 v = cross(n, u);
    dvec2 a = dvec2(dot(row_x, u), dot(row_y, u));
    dvec2 b = dvec2(dot(row_x, v), dot(row_y, v));
    // One rotation of u and v makes their images orthogonal; the product of the two with themselves would lose the shorter one.
    double across = dot(a, b);
    if (across != 0.0) {
        double zeta = (dot(b, b) - dot(a, a)) / (2.0 * across);
        double t = (zeta >= 0.0 ? 1.0 : -1.0) / (abs(zeta) + sqrt(1.0 + zeta * zeta));
        double c = 1.0 / sqrt(1.0 + t * t);
        dvec2 turned = c * (a - t * b);
        b = c * (b + t * a);
        a = turned;
    }
    if (dot(a, a) < dot(b, b)) {
        dvec2 longer = b;
        b = a;
        a = longer;
    }
    dvec2 lean = on_screen(dvec2(dot(row_x, n), dot(row_y, n)));

    double depth = -center_eye.z;
    double anchor_near = depth;
#ifdef PERSPECTIVE
    // Places on the screen grow without bound towards the eye: see EllipsoidView::anchor.
    anchor_near = max(depth, 0.6 * min(depth + half_depth, first_depth + last_slice * slice_spacing));
#endif
    double anchor = clamp(floor((anchor_near - first_depth) / slice_spacing + 0.5), 0.0, last_slice);
    double anchor_depth = first_depth + anchor * slice_spacing;
    double s = (depth - anchor_depth) / half_depth;
    double step_s = slice_spacing / half_depth;
    dvec2 at = on_screen(center_eye.xy) + s * lean;
    dvec2 step = -step_s * lean;
#ifdef PERSPECTIVE
    at /= anchor_depth;
    step -= at * slice_spacing;
#endif
    // Beyond 2^24 float32 has no room for all whole pixels: what it leaves is part of the parts.
    vec2 whole = vec2(floor(at));
    record_place = vec4(whole, vec2(at - dvec2(whole)));
    // A weight of 0 still reaches: what it leaves in the sheets tells a point that is 0 from one that is empty.
    float weight = max(float(amount.y * weight_scale), float(least_weight));
    double counted = amount.y > 0.0 ? amount.x : 0.0;
    float value = half_range == 0.0 ? float(amount.x * amount.y * value_scale) : float((counted - pivot) / half_range) * weight;
    record_heights = vec4(float(anchor), float(s), float(step_s), value);
    record_axes = vec4(vec2(on_screen(a)), vec2(on_screen(b)));
    record_step = vec4(vec2(step), weight, 0.0);
#ifdef RESTS
    dvec2 parts = at - dvec2(whole);
    rest_heights = vec4(vec2(rest_of(parts)), float(rest_of(s)), float(rest_of(step_s)));
    rest_axes = vec4(vec2(rest_of(on_screen(a))), vec2(rest_of(on_screen(b))));
    rest_step = vec4(vec2(rest_of(step)), 0.0, 0.0);
    double longest = sqrt(max(dot(axis_a, axis_a), max(dot(axis_b, axis_b), dot(axis_c, axis_c))));
    double shortest = sqrt(min(dot(axis_a, axis_a), min(dot(axis_b, axis_b), dot(axis_c, axis_c))));
    double width = pixel;
#ifdef PERSPECTIVE
    width *= abs(depth);
#endif
    record_step.w = longest >= precise_aspect * shortest || shortest < least_px * width ? 1.0 : 0.0;
#endif
}

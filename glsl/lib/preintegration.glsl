// Classification of the ramp between two slices, integrated over the piecewise linear transfer function.
// Source: conventions, section 4; Engel, Kraus and Ertl 2001.

// Interval between two points that a value lies in; -1 before the first point.
int interval_of(float value) {
    if (!(value >= transfer_range.x)) {
        return -1;
    }
    int cell = int(min((value - transfer_range.x) * transfer_range.y, float(TRANSFER_CELLS - 1)));
    int point = texelFetch(transfer_index, ivec2(cell, INDEX_ROW), 0).r;
    while (point < transfer_last && value >= texelFetch(transfer_points, ivec2(point, VALUE_ROW), 0).y) {
        ++point;
    }
    return point;
}

// -ln(u), u = 1 - a: from whichever of the two has the digits. Between two opacities near 1, a itself may round to 1 or lose its last bits.
float absorption_of(float a, float u) { return a < 0.25 ? absorption(a) : -log(u); }

// Means of the absorption and of its product with the share of the way, over a stretch where opacity is linear.
vec2 moments(float a_from, float a_to) {
    a_from = min(a_from, 1.0 - clearest);
    a_to = min(a_to, 1.0 - clearest);
    float u_from = 1.0 - a_from;
    float u_to = 1.0 - a_to;
    if (max(u_from, u_to) <= 2.0 * min(u_from, u_to)) {
        const float node[2] = float[2](0.3399810435848563, 0.8611363115940526);
        const float share[2] = float[2](0.3260725774312731, 0.1739274225687269);
        vec2 sum = vec2(0.0);
        for (int n = 0; n < 2; ++n) {
            float near = 0.5 - 0.5 * node[n];
            float far = 0.5 + 0.5 * node[n];
            float at_near = absorption_of(mix(a_from, a_to, near), mix(u_from, u_to, near));
            float at_far = absorption_of(mix(a_from, a_to, far), mix(u_from, u_to, far));
            sum += share[n] * vec2(at_near + at_far, near * at_near + far * at_far);
        }
        return sum;
    }
    // The logarithm bends too much for a quadrature; its own integrals do not cancel here.
    float d = u_to - u_from;
    float log_from = log(u_from);
    float log_to = log(u_to);
    float first = (u_to * log_to - u_from * log_from) / d - 1.0;
    float second = (0.5 * (u_to * u_to * log_to - u_from * u_from * log_from) - 0.25 * (u_to * u_to - u_from * u_from) -
                    u_from * (u_to * log_to - u_from * log_from - d)) / (d * d);
    return -vec2(first, second);
}

// Mean absorption per reference length in a, and the colour that goes with it.
vec4 ramp(float from, float to) {
    float low = min(from, to);
    float high = max(from, to);
    float span = high - low;
    int point = interval_of(low);
    if (!(span > 0.0)) {
        vec4 at = transfer(low);
        return vec4(at.rgb, absorption(min(at.a, 1.0 - clearest)));
    }
    vec3 color = vec3(0.0);
    float total = 0.0;
    float begin = low;
    while (true) {
        vec3 reach = point < 0 ? vec3(0.0, transfer_range.x, 0.0) : texelFetch(transfer_points, ivec2(point, VALUE_ROW), 0).xyz;
        float end = point == transfer_last ? high : min(reach.y, high);
        vec4 at_begin = texelFetch(transfer_points, ivec2(max(point, 0), COLOR_ROW), 0);
        vec4 at_end = at_begin;
        if (point >= 0 && point < transfer_last) {
            vec4 next = texelFetch(transfer_points, ivec2(point + 1, COLOR_ROW), 0);
            vec4 here = at_begin;
            at_begin = mix(here, next, clamp((begin - reach.x) * reach.z, 0.0, 1.0));
            at_end = mix(here, next, clamp((end - reach.x) * reach.z, 0.0, 1.0));
        }
        float share = (end - begin) / span;
        if (share > 0.0) {
            vec2 moment = moments(at_begin.a, at_end.a);
            total += share * moment.x;
            color += share * (at_begin.rgb * moment.x + (at_end.rgb - at_begin.rgb) * moment.y);
        }
        if (end >= high || point == transfer_last) {
            break;
        }
        begin = end;
        ++point;
    }
    return total > 0.0 ? vec4(color / total, total) : vec4(0.0);
}

#ifdef SECOND_ORDER
// Colour and opacity of an interval over which rho bends: Romberg's step from the interval by one ramp and by two. The neighbours give
// rho in the middle; measure: slice spacing over reference length along the ray.
vec4 bent_ramp(float before, float from, float to, float after, float measure) {
    float middle = (9.0 * (from + to) - before - after) * 0.0625;
    vec4 whole = ramp(from, to);
    vec4 near = ramp(from, middle);
    vec4 far = ramp(middle, to);
    float alpha_whole = opacity_of_absorption(measure * whole.a);
    float alpha_near = opacity_of_absorption(0.5 * measure * near.a);
    float alpha_far = (1.0 - alpha_near) * opacity_of_absorption(0.5 * measure * far.a);
    float alpha = clamp((4.0 * (alpha_near + alpha_far) - alpha_whole) / 3.0, 0.0, 1.0);
    vec3 color = max((4.0 * (alpha_near * near.rgb + alpha_far * far.rgb) - alpha_whole * whole.rgb) / 3.0, 0.0);
    return alpha > 0.0 ? vec4(color / alpha, alpha) : vec4(0.0);
}
#endif

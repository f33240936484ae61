// A field that is divided by its own weights: D / max(w0, W) in the sheets' unit, its derivatives, and W. [NM06] equation 20.

// pivot: what values in D, and rho, are less by; half_range: what values in D are divided by
struct Division {
    float w0, pivot, half_range, least_weight;
};

vec4 divided(Division by, vec4 d, vec4 weight) {
    return by.half_range * (d / max(weight, vec4(by.w0))) + by.pivot * (min(weight / by.w0, 1.0) - 1.0);
}

// The derivative of (D + pivot W) / max(w0, W): w0 has none.
vec4 divided_slope(Division by, vec4 d, vec4 weight, vec4 slope, vec4 weight_slope) {
    vec4 divisor = max(weight, vec4(by.w0));
    vec4 varying_part = mix(vec4(-by.pivot / by.half_range), d / divisor, greaterThan(weight, vec4(by.w0)));
    return (slope - varying_part * weight_slope) / (divisor / by.half_range);
}

// Where its weight is too small the field is empty.
vec4 counted_weight(Division by, vec4 weight) { return mix(vec4(0.0), weight, greaterThanEqual(weight, vec4(by.least_weight))); }

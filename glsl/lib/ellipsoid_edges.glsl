// Where the sections of an ellipsoid in several slabs end on the screen. [NM06] section 3.3.

// Bounds of j step + l sqrt(1 - s(j)^2), the section's edge along one axis in units of its length l, over slabs j.
vec2 edge_over(vec2 slabs, float height, float step_s, float step) {
    float lean = step / step_s;
    float turn = lean * inversesqrt(1.0 + lean * lean);
    vec2 j = clamp((height + vec2(-turn, turn)) / step_s, slabs.x, slabs.y);
    vec2 s = height - j * step_s;
    vec2 half_width = sqrt(max(1.0 - s * s, 0.0));
    return vec2(j.x * step - half_width.x, j.y * step + half_width.y);
}

// Of edges in pixels times depth, in pixels, over depths above 0.
vec2 over_depths(vec2 edges, vec2 depths) {
    return vec2(min(edges.x / depths.x, edges.x / depths.y), max(edges.y / depths.x, edges.y / depths.y));
}

// The slabs, counted from the record's slice, out of some that a support meets; none where x > y.
vec2 slabs_met(vec2 slabs, float height, float step_s) {
    return vec2(max(slabs.x, (height - 1.0) / step_s), min(slabs.y, (height + 1.0) / step_s));
}

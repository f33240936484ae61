// Sections of an ellipsoid, placed in float32 or in float64. Needs lib/sections.glsl, and of the kernel what ellipsoid.vert says of it. [NM06] sections 3.3 and 4.1.

// place: of the pixel (times depth) in the plane of the unit sphere on the record's slice; slab: of each, counted from the batch's first one
Sections sections(vec2 place, vec4 slab, vec4 depth) {
    vec4 offset = amount.z + slab;
    Sections r;
    r.s = heights.x - offset * heights.y;
    r.ax = place.x * depth - offset * heights.z;
    r.ay = place.y * depth - offset * heights.w;
    r.depth = depth;
    r.ray = -heights.zw / heights.y;
#ifdef PERSPECTIVE
    r.ray += place * slice_spacing / heights.y;
#endif
    return r;
}

#ifdef PRECISE_PLACES
// In float64: along a needle of 1:100,000 the place of a section is known to no more than 6e-3 of its radius in float32.
struct ExactPlace {
    dvec2 place, step; // on the record's slice, and from slab to slab, in the plane of the unit sphere
    double s, step_s;
};

ExactPlace exact_place() {
    dvec2 u = dvec2(axes.xy) + dvec2(axes_rest.xy);
    dvec2 v = dvec2(axes.zw) + dvec2(axes_rest.zw);
    dvec2 step = dvec2(step_and_rest.xy) + dvec2(step_and_rest.zw);
    dvec2 from = dvec2(PLACE) - dvec2(place_at.xy) - (dvec2(place_at.zw) + dvec2(heights_rest.xy));
    double uu = dot(u, u);
    double vv = dot(v, v);
    ExactPlace exact;
    exact.place = dvec2(dot(u, from) / uu, dot(v, from) / vv);
    exact.step = dvec2(dot(u, step) / uu, dot(v, step) / vv);
    exact.s = double(heights.x) + double(heights_rest.z);
    exact.step_s = double(heights.y) + double(heights_rest.w);
#ifdef PERSPECTIVE
    // The ray moves on as well: at the record's slice the place is that of the pixel times the depth there.
    exact.step -= exact.place * exact_spacing;
    exact.place *= exact_depth - double(amount.z) * exact_spacing;
#endif
    return exact;
}

Sections sections(ExactPlace exact, vec4 slab, vec4 depth) {
    Sections r;
    for (int c = 0; c < 4; ++c) {
        double offset = double(amount.z) + double(slab[c]);
        r.s[c] = float(exact.s - offset * exact.step_s);
        r.ax[c] = float(exact.place.x - offset * exact.step.x);
        r.ay[c] = float(exact.place.y - offset * exact.step.y);
    }
    r.depth = depth;
    r.ray = vec2(-exact.step / exact.step_s);
    return r;
}
#endif

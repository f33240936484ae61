// Sections of an ellipsoid that float32 places. Needs lib/sections.glsl, and of the kernel `amount` and `heights`. [NM06] sections 3.3 and 4.1.

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

// A kernel's sections in four slabs, and what they add to the sheets. Needs lib/kernel.glsl.

// Places of four slabs in the unit sphere, and how the pixel's ray moves there per half-depth.
struct Sections {
    vec4 s, ax, ay, depth;
    vec2 ray;
};

vec4 values(Sections at) {
#ifdef SLAB
    return kernel_mean(at.s, at.ax, at.ay, vec4(at.ray.x), vec4(at.ray.y));
#else
    return kernel_at(at.s, at.ax, at.ay);
#endif
}

#ifdef FINE
vec4 changes(Sections at, vec4 ds, vec4 dx, vec4 dy, vec2 part) {
#ifdef SLAB
    return mean_change(at.s, at.ax, at.ay, vec4(at.ray.x), vec4(at.ray.y), ds, dx, dy, part);
#else
    return kernel_change(at.s, at.ax, at.ay, ds, dx, dy);
#endif
}

// unit: pixels (times depth in perspective) -> plane of the unit sphere; part: half-depth in perspective, else 0; step_s: slice
// spacing over half-depth.
void slopes(Sections at, float scale, mat2 unit, float part, float step_s, out vec4 x, out vec4 y, out vec4 z) {
    x = y = z = vec4(0.0);
#ifdef FINE_XY
    // One pixel to the right, one up (rows count downwards).
    x = scale * changes(at, vec4(0.0), unit[0].x * at.depth, unit[0].y * at.depth, part * unit[0]);
    y = scale * changes(at, vec4(0.0), -unit[1].x * at.depth, -unit[1].y * at.depth, -part * unit[1]);
#endif
#ifdef FINE_Z
    // One slice back along the pixel's ray.
    z = scale * changes(at, vec4(-step_s), vec4(at.ray.x * step_s), vec4(at.ray.y * step_s), vec2(0.0));
#endif
}
#endif

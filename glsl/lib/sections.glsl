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

#ifdef ANALYTIC
#ifdef FINE
// Twice the derivatives of g per pixel to the right, per pixel up (rows count downwards) and per slice along the pixel's ray.
void slopes(Sections at, float scale, mat2 unit, float step_s, out vec4 x, out vec4 y, out vec4 z) {
    vec4 ux = unit[0].x * at.depth;
    vec4 vx = unit[0].y * at.depth;
    vec4 uy = -unit[1].x * at.depth;
    vec4 vy = -unit[1].y * at.depth;
    float amount = -4.0 * 0.6931471805599453 * falloff_log2 * scale;
#ifdef SLAB
    // q = nearest point of the ray + t w: what is odd in t and what is even.
    Moments m = kernel_moments(at.s, at.ax, at.ay, at.ray.x, at.ray.y);
    x = amount * ((m.u * ux + m.v * vx) * m.even + (at.ray.x * ux + at.ray.y * vx) * m.odd);
    y = amount * ((m.u * uy + m.v * vy) * m.even + (at.ray.x * uy + at.ray.y * vy) * m.odd);
    z = amount * step_s * (1.0 + dot(at.ray, at.ray)) * m.odd;
#else
    vec4 bell = exp2(-falloff_log2 * (at.s * at.s + at.ax * at.ax + at.ay * at.ay));
    bell = amount * mix(vec4(0.0), bell, greaterThan(bell, vec4(edge)));
    x = bell * (at.ax * ux + at.ay * vx);
    y = bell * (at.ax * uy + at.ay * vy);
    z = bell * step_s * (at.ax * at.ray.x + at.ay * at.ray.y - at.s);
#endif
}
#endif
#elif defined(FINE)
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

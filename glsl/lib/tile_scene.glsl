// The fields that the compute path sums, and a tree of bounds over the kernels of scattered ones.

// One field. Buffers hold those of all fields, one after the other.
struct Part {
    ivec4 kind;     // 1: a lattice, else ellipsoids; its group; 1: divided by its own weights; number of its textures
    ivec4 kernels;  // ellipsoids: first record, first of `order`, how many; of their bounds the first leaf
    ivec4 size;     // lattice: samples along i, j, k. Ellipsoids: leaves, nodes above them
    vec4 kernel;    // k log2(e), exp(-k), sqrt(k); lattice: weight of a sample
    vec4 division;  // as Division has it (lib/division.glsl)
    vec4 texels;    // lattice: what a texel is multiplied by, what is added then, radius in samples, what sums are multiplied by
    // Lattice. Rows of: way from a sample, counted in samples along i, j, k -> height in its unit sphere, place in the plane there (u, v).
    vec4 frame_s, frame_u, frame_v;
    vec4 reach;     // how far supports reach along i, j, k; 1: odd layers are shifted by half a sample along i and j (BCC)
    vec4 unit;      // columns of: pixels (times depth) -> plane of the unit sphere
    vec4 pace;      // from sample to sample along i, j, k in the unit sphere, where kernels are products of three Gaussians
    // Place among its samples of pixel (0, 0) on slab 0 and steps to the right, down and to the next slab. In perspective: of the
    // eye, and steps for a depth of 1: to the right and down, of a pixel from the axis, and along the axis.
    dvec4 start, right, down, back;
};
layout(std430, binding = BUFFER_PARTS) readonly buffer Parts { Part parts[]; };
// RECORD_SIZE vec4 a kernel: four as SectionRecord has them, and three as SectionRest where float32 does not place all kernels.
layout(std430, binding = BUFFER_RECORDS) readonly buffer Records { vec4 records[]; };
// Kernels that are drawn, neighbours in space next to one another.
layout(std430, binding = BUFFER_ORDER) readonly buffer Order { uint order[]; };

// What the kernels below a node of the tree cover: left, right, upper and lower edge in pixels; first and last slab.
struct Bound {
    vec4 rectangle;
    vec4 slabs;
};

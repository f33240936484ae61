// Bounds of the kernels of one field on the screen: of TREE_ARITY kernels in a row, or of so many bounds below.
#include "lib/interop.h"
#include "lib/ellipsoid_edges.glsl"
#include "lib/tile_scene.glsl"

layout(local_size_x = TREE_ARITY) in;
layout(std430, binding = BUFFER_BOUNDS) buffer Bounds { Bound bounds[]; };

uniform int part;
uniform bool leaves;
uniform vec2 axis;         // pixel where the optical axis meets the picture
uniform float slab_reach;  // slabs by which kernels reach further
uniform float margin;      // pixels by which they do
uniform float last_slab;   // of all
#ifdef PERSPECTIVE
uniform float first_depth; // of slab 0
uniform float slice_spacing;
#endif

const float nowhere = 1e30;
shared Bound several[TREE_ARITY];

Bound nothing() { return Bound(vec4(nowhere, -nowhere, nowhere, -nowhere), vec4(nowhere, -nowhere, 0.0, 0.0)); }

float length_of(vec4 rectangle) { return rectangle.y - rectangle.x + rectangle.w - rectangle.z; }

Bound of_kernel(int number) {
    int first = RECORD_SIZE * (parts[part].kernels.x + int(order[parts[part].kernels.y + number]));
    vec4 place = records[first];
    vec4 heights = records[first + 1];
    vec4 axes = records[first + 2];
    vec2 step = records[first + 3].xy;
    vec2 slabs = slabs_met(vec2(-slab_reach, last_slab + slab_reach) - heights.x, heights.y, heights.z);
    if (slabs.x > slabs.y) {
        return nothing();
    }
    float length_x = length(axes.xz);
    float length_y = length(axes.yw);
    vec2 edge_x = edge_over(slabs, heights.y, heights.z, step.x / length_x) * length_x;
    vec2 edge_y = edge_over(slabs, heights.y, heights.z, step.y / length_y) * length_y;
#ifdef PERSPECTIVE
    vec2 depths = first_depth + (heights.x + slabs) * slice_spacing;
    bool through_eye = depths.x <= 1e-6 * slice_spacing;
    depths = max(depths, vec2(1e-30));
    edge_x = over_depths(edge_x, depths);
    edge_y = over_depths(edge_y, depths);
#else
    const bool through_eye = false;
#endif
    vec2 at = axis + place.xy + place.zw;
    vec4 rectangle = vec4(at.x + edge_x, at.y + edge_y);
    // As much as float32 may have lost of far corners and of long edges.
    float slack = margin + 1e-5 * (length_of(rectangle) + abs(at.x) + abs(at.y));
    Bound result;
    result.rectangle = through_eye ? vec4(-nowhere, nowhere, -nowhere, nowhere) : rectangle + slack * vec4(-1.0, 1.0, -1.0, 1.0);
    result.slabs = vec4(slabs + heights.x, 0.0, 0.0);
    return result;
}

void main() {
    int me = int(gl_LocalInvocationID.x);
    int node = int(gl_WorkGroupID.x + gl_WorkGroupID.y * gl_NumWorkGroups.x);
    int first_leaf = parts[part].kernels.w;
    int below = leaves ? parts[part].kernels.z : parts[part].size.x;
    int nodes = leaves ? parts[part].size.x : parts[part].size.y;
    int child = node * TREE_ARITY + me;
    several[me] = child < below ? (leaves ? of_kernel(child) : bounds[first_leaf + child]) : nothing();
    barrier();
    for (int apart = TREE_ARITY / 2; apart > 0; apart /= 2) {
        if (me < apart) {
            Bound other = several[me + apart];
            Bound mine = several[me];
            several[me] = Bound(vec4(min(mine.rectangle.x, other.rectangle.x), max(mine.rectangle.y, other.rectangle.y),
                                     min(mine.rectangle.z, other.rectangle.z), max(mine.rectangle.w, other.rectangle.w)),
                                vec4(min(mine.slabs.x, other.slabs.x), max(mine.slabs.y, other.slabs.y), 0.0, 0.0));
        }
        barrier();
    }
    if (me == 0 && node < nodes) {
        bounds[first_leaf + (leaves ? 0 : parts[part].size.x) + node] = several[0];
    }
}

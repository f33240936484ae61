// Faces of cuts. Source: conventions, section 10.

uniform sampler2DArray face_texture; // of each pixel, a layer for each group: normal, and where its ray enters: slices before the first that is kept
uniform float face_length;           // slices over which it counts in full

// What it counts for matter of an opacity over face_length, so many slices behind the first one that is kept, times normal and 1.
vec4 face_of(vec4 entry, float slices, float opacity) {
    return opacity * clamp(2.0 - (slices + entry.a) / face_length, 0.0, 1.0) * vec4(entry.rgb, 1.0);
}

// Faces of cuts. Needs lib/opacity.glsl. Source: conventions, section 10.

uniform sampler2DArray face_texture; // of each pixel, a layer for each group: normal, and where its ray enters: slices before the first that is kept
uniform float face_length;           // slices to the length by which they count

const float thickest = 16.635532; // -ln(2^-24)

// What a face counts, times its normal and 1, for matter so many slices behind the first one that is kept which absorbs so much of a slice's
// light; in_front: opacity in front of it.
vec4 face_of(vec4 entry, float slices, float absorbed, float in_front) {
    float thickness = min(absorbed * face_length, thickest);
    float behind = (slices + entry.a) / face_length;
    float through = absorption(min(in_front, 1.0 - clearest)) / thickness;
    float share = opacity_of_absorption(4.0 * thickness) * clamp(2.0 - behind / 4.0, 0.0, 1.0) * clamp(2.0 - (behind - through), 0.0, 1.0);
    return share * vec4(entry.rgb, 1.0);
}

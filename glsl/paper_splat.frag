// A slice of a kernel: the texture of the 2D Gaussian times the 1D Gaussian of the slice's height, lowered by the value at the
// support's edge. [NM06] equation 1 and section 4.1. Drawn to one channel of the sheet.
uniform sampler2D gaussian_texture; // exp(-k (x^2 + y^2)) at x, y = 0 ... 1
uniform float gaussian_cells;       // texels less one
uniform float edge;                 // exp(-k)

in vec2 place;
flat in vec3 amount;

out vec4 sheet_front;
#ifdef WEIGHT
out vec4 weight_front;
#endif

// Filters mix with 8 bits, which shows: four texels are fetched and mixed in full.
float gaussian(vec2 at) {
    vec2 t = min(abs(at), 1.0) * gaussian_cells;
    vec2 cell = min(floor(t), gaussian_cells - 1.0);
    vec2 share = t - cell;
#ifdef GATHER
    // The point where four texels meet: from the one at the lower left counter-clockwise, the last one first.
    vec4 four = textureGather(gaussian_texture, (cell + 1.0) / (gaussian_cells + 1.0));
    vec2 low = four.wz;
    vec2 high = four.xy;
#else
    ivec2 texel = ivec2(cell);
    vec2 low = vec2(texelFetch(gaussian_texture, texel, 0).r, texelFetch(gaussian_texture, texel + ivec2(1, 0), 0).r);
    vec2 high = vec2(texelFetch(gaussian_texture, texel + ivec2(0, 1), 0).r, texelFetch(gaussian_texture, texel + ivec2(1, 1), 0).r);
#endif
    vec2 mixed = mix(low, high, share.y);
    return mix(mixed.x, mixed.y, share.x);
}

void main() {
    float g = max(gaussian(place) * amount.x - edge, 0.0);
    sheet_front = vec4(g * amount.y);
#ifdef WEIGHT
    weight_front = vec4(g * amount.z);
#endif
}

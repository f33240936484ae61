// Differences of rho between the neighbours of a pixel: right less left, above less below. Needs lib/sheets.glsl.
void differences_at(ivec2 at, out vec2 change[SLABS]) {
    float left[SLABS];
    float right[SLABS];
    float above[SLABS];
    float below[SLABS];
    rho_at(at - ivec2(1, 0), left);
    rho_at(at + ivec2(1, 0), right);
    rho_at(at - ivec2(0, 1), above);
    rho_at(at + ivec2(0, 1), below);
    for (int c = 0; c < SLABS; ++c) {
        change[c] = vec2(right[c] - left[c], above[c] - below[c]);
    }
}

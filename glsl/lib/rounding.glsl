// On plateaus of quotients, where rho has no gradient, D and W are rounded apart from one another, and what is left of their difference
// would be lit. What is no larger than that is none: a real difference of its size is not known either.

// Roundings to 24 bits of D, W and their quotients: of differences between pixels 8, of derivatives, which are differences of products,
// 16. With twice as many, gradients that are real are darkened by more than rounding lights.
const float rounding = 8.0 / 16777216.0;

float above_rounding(float difference, float part) { return abs(difference) > rounding * abs(part) ? difference : 0.0; }

vec4 above_rounding(vec4 difference, vec4 part) {
    return mix(vec4(0.0), difference, greaterThan(abs(difference), rounding * abs(part)));
}

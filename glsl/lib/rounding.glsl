// On plateaus of quotients, where rho has no gradient, D and W are rounded apart from one another, and what is left of their difference
// would be lit. What is no larger than that is none: a real difference of its size is not known either.

// 16 roundings to 24 bits, of D, W, their derivatives, products and quotients. With 35, gradients that are real are darkened by more.
const float rounding = 16.0 / 16777216.0;

float above_rounding(float difference, float part) { return abs(difference) > rounding * abs(part) ? difference : 0.0; }

vec4 above_rounding(vec4 difference, vec4 part) {
    return mix(vec4(0.0), difference, greaterThan(abs(difference), rounding * abs(part)));
}

// On plateaus of quotients, where rho has no gradient, D and W are rounded apart from one another, and what is left of their difference
// would be lit. What is no larger than rounding counts as none.

// Roundings to 24 bits of D, W and their quotients: 2 of differences between pixels, 8 of differences of two products (derivatives, and
// differences that are splatted). With more, gradients that are real are darkened by more than rounding lights.
const float rounding = 2.0 / 16777216.0;
const float of_products = 4.0;

float above_rounding(float difference, float part) { return abs(difference) > rounding * abs(part) ? difference : 0.0; }

vec3 above_rounding(vec3 difference, float part) {
    return mix(vec3(0.0), difference, greaterThan(abs(difference), vec3(rounding * abs(part))));
}

vec4 above_rounding(vec4 difference, vec4 part) {
    return mix(vec4(0.0), difference, greaterThan(abs(difference), rounding * abs(part)));
}

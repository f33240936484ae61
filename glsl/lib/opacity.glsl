// Opacity of a slice from opacity per reference length, with all digits for a -> 0 and a = 1.
// Source: conventions, section 4.

const float clearest = 5.9604645e-8; // in means, 1 - a is never taken smaller: 2^-24

// -ln(1 - a)
float absorption(float a) {
    if (a < 0.25) {
        float z = a / (2.0 - a);
        float z2 = z * z;
        return 2.0 * z * (1.0 + z2 * (0.33333333 + z2 * (0.2 + z2 * (0.14285714 + z2 * 0.11111111))));
    }
    return -log(1.0 - a);
}

// 1 - exp(-x), x >= 0
float opacity_of_absorption(float x) {
    if (x < 0.35) {
        return x * (1.0 - x * 0.5 * (1.0 - x * 0.33333333 * (1.0 - x * 0.25 * (1.0 - x * 0.2 * (1.0 - x * 0.16666667 * (1.0 - x * 0.14285714))))));
    }
    return 1.0 - exp(-x);
}

// 1 - (1 - a)^exponent
float opacity_of(float a, float exponent) {
    return a >= 1.0 ? 1.0 : opacity_of_absorption(exponent * absorption(a));
}

// How much of the rounding of rho lit colours show. Needs lib/look.glsl and lib/gradient.glsl. Source: conventions, section 9.

uniform float gradient_doubt; // error of a gradient, over gradient_scale, over that of rho

// Of an error of rho of 1: the error of the gradient at a place in the array of slabs.
float gradient_error(float slab) {
#ifdef PERSPECTIVE
    float t = depth_of(slab);
    return gradient_doubt * max(t > 0.0 ? gradient_scale.x / t : 0.0, gradient_scale.y);
#else
    return gradient_doubt * max(gradient_scale.x, gradient_scale.y);
#endif
}

// ... and the error of a normal: at most 1e15, so that squares and their sums stay within float32. 0 where the gradient has no direction.
float normal_error(vec3 gradient, float error) {
    float size = max(length(gradient), weakest_gradient);
#ifdef CUT_FACES
    error *= 1.0 - face.a;
#endif
    return size > 1e-30 ? min(error * min(1.0 / size, 1e15), 1e15) : 0.0;
}

// Of a surface between two slabs, whose rho differ by `change`: it moves too. Beyond a hundred of its gradient it is ambiguous
// (conventions, section 9).
float moved(vec3 front, vec3 back, vec3 gradient, float change) {
    return min(length(back - front) / max(abs(change), 1e-15), 100.0 * max(length(gradient), weakest_gradient));
}

void add_doubt(inout float doubt, float shown) { doubt += shown * shown; }

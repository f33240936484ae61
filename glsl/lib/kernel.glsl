// The kernel on slices, four at a time. Source: conventions, sections 2 and 3.
// s: heights of the slices in the kernel's unit sphere; ax, ay: the pixel's place in the plane of each, u and v.
// All return g without the gain 1 / (1 - exp(-k)), which is part of the value.

#ifdef COMPUTE
#define OF_FIELD(number) number = 0.0;
#else
#define OF_FIELD(number) uniform number;
#endif
OF_FIELD(float falloff_log2) // k log2(e)
OF_FIELD(float edge)         // exp(-k)

vec4 kernel_at(vec4 s, vec4 ax, vec4 ay) {
    return max(exp2(-falloff_log2 * (s * s + ax * ax + ay * ay)) - edge, 0.0);
}

#if defined(WEIGHT) || defined(WEIGHT_ALONE)
// Weights at points: above 0 wherever the kernel reaches, as what is 0 counts as empty. The product alone would leave float32's range
// where a slab only just meets a support whose weight is next to nothing.
vec4 weights_of(float weight, vec4 g) {
    return max(weight * g, mix(vec4(0.0), vec4(1e-37), greaterThan(g, vec4(0.0))));
}
#endif

#ifdef SLAB
#ifdef COMPUTE
#define SLAB_NODES slab_nodes
#define SLAB_PIECES slab_pieces
int slab_nodes = 0;  // each kernel has its own
int slab_pieces = 1;
#endif
#if defined(ELLIPSOID) || defined(COMPUTE)
float slab_half = 0.0;      // half a slice spacing over the half-depth h: each kernel has its own
#else
uniform float slab_half;    // half a slice spacing over the half-depth h
#endif
OF_FIELD(float falloff_root) // sqrt(k)

// Abramowitz and Stegun 7.1.26: below 1.5e-7 off.
vec4 error_function(vec4 x) {
    vec4 z = abs(x);
    vec4 t = 1.0 / (1.0 + 0.3275911 * z);
    vec4 sum = t * (0.254829592 + t * (-0.284496736 + t * (1.421413741 + t * (-1.453152027 + t * 1.061405429))));
    return sign(x) * (1.0 - sum * exp2(-1.4426950408889634 * z * z));
}

// Gauss-Legendre nodes and weights, those above 0.
const float four_nodes[2] = float[2](0.3399810435848563, 0.8611363115940526);
const float four_shares[2] = float[2](0.6521451548625461, 0.3478548451374538);
const float six_nodes[3] = float[3](0.2386191860831969, 0.6612093864662645, 0.9324695142031521);
const float six_shares[3] = float[3](0.4679139345726910, 0.3607615730481386, 0.1713244923791704);

// Mean over the slab along the pixel's ray, of which tau is the depth in units of h, 0 on the slice; the ray moves by
// (-1, wx, wy) along (n, u, v) per unit of tau. The chord of the support ends where g does, so that no max is needed.
vec4 kernel_mean(vec4 s, vec4 ax, vec4 ay, vec4 wx, vec4 wy) {
    vec4 speed2 = 1.0 + wx * wx + wy * wy;
    vec4 speed = sqrt(speed2);
    vec4 nearest = (s - ax * wx - ay * wy) / speed2;
    // |q x w|^2 / |w|^2: the difference |q|^2 - (q.w)^2 / |w|^2 would cancel for long rays.
    vec4 cn = ax * wy - ay * wx;
    vec4 cu = -ay - s * wy;
    vec4 cv = s * wx + ax;
    vec4 apart2 = (cn * cn + cu * cu + cv * cv) / speed2;
    vec4 half_chord = sqrt(max(1.0 - apart2, 0.0)) / speed;
    // Counted from the nearest point: a chord that is short beside the slab keeps its digits.
    vec4 from = max(vec4(-slab_half) - nearest, -half_chord);
    vec4 to = max(min(vec4(slab_half) - nearest, half_chord), from);
    if (SLAB_NODES > 0) {
        // Thin slabs: an erf difference would cancel.
        vec4 middle = 0.5 * (from + to);
        vec4 reach = 0.5 * (to - from);
        vec4 rate = -falloff_log2 * speed2;
        vec4 base = -falloff_log2 * apart2;
        vec4 sum = vec4(0.0);
        for (int n = 0; n < SLAB_NODES / 2; ++n) {
            float node = SLAB_NODES == 4 ? four_nodes[n] : six_nodes[n];
            float share = SLAB_NODES == 4 ? four_shares[n] : six_shares[n];
            vec4 lower = middle - node * reach;
            vec4 upper = middle + node * reach;
            sum += share * (exp2(base + rate * lower * lower) + exp2(base + rate * upper * upper) - 2.0 * edge);
        }
        return max(sum, 0.0) * reach / (2.0 * slab_half);
    }
    vec4 root = falloff_root * speed;
    vec4 bell = exp2(-falloff_log2 * apart2) * 0.886226925452758 / root;
    vec4 sum = bell * (error_function(root * to) - error_function(root * from)) - edge * (to - from);
    // A cap too thin for the difference still is a support that is met: it must not look empty.
    return max(sum, mix(vec4(0.0), vec4(1e-20), greaterThan(to, from))) / (2.0 * slab_half);
}
#endif

#if defined(FINE) && defined(ANALYTIC) && defined(SLAB)
// Means over a slab, along the pixel's ray, of exp(-k r^2) where the ray is inside the support, and of the same times the way t from the
// ray's point that is nearest to the centre; u and v: that point's place in the plane of the unit sphere.
struct Moments {
    vec4 even, odd, u, v;
};

Moments kernel_moments(vec4 s, vec4 ax, vec4 ay, float wx, float wy) {
    Moments m;
    float speed2 = 1.0 + wx * wx + wy * wy;
    float speed = sqrt(speed2);
    vec4 nearest = (s - ax * wx - ay * wy) / speed2;
    vec4 cn = ax * wy - ay * wx;
    vec4 cu = -ay - s * wy;
    vec4 cv = s * wx + ax;
    vec4 apart2 = (cn * cn + cu * cu + cv * cv) / speed2;
    // w x (q x w) / |w|^2 is the nearest point; q + nearest w would cancel for long rays.
    m.u = (cv + cn * wy) / speed2;
    m.v = -(cn * wx + cu) / speed2;
    vec4 half_chord = sqrt(max(1.0 - apart2, 0.0)) / speed;
    vec4 from = max(vec4(-slab_half) - nearest, -half_chord);
    vec4 to = max(min(vec4(slab_half) - nearest, half_chord), from);
    vec4 bell = exp2(-falloff_log2 * apart2);
    float rate = falloff_log2 * speed2;
    if (SLAB_NODES > 0) {
        // Thin slabs: differences of closed forms would cancel.
        vec4 middle = 0.5 * (from + to);
        vec4 reach = 0.5 * (to - from);
        m.even = vec4(0.0);
        m.odd = vec4(0.0);
        for (int n = 0; n < 3; ++n) {
            vec4 lower = middle - six_nodes[n] * reach;
            vec4 upper = middle + six_nodes[n] * reach;
            vec4 at_lower = six_shares[n] * exp2(-rate * lower * lower);
            vec4 at_upper = six_shares[n] * exp2(-rate * upper * upper);
            m.even += at_lower + at_upper;
            m.odd += at_lower * lower + at_upper * upper;
        }
        bell *= reach / (2.0 * slab_half);
    } else {
        float root = falloff_root * speed;
        m.even = (error_function(root * to) - error_function(root * from)) * (0.886226925452758 / root);
        m.odd = (exp2(-rate * from * from) - exp2(-rate * to * to)) / (2.0 * root * root);
        bell /= 2.0 * slab_half;
    }
    m.even *= bell;
    m.odd *= bell;
    return m;
}
#elif defined(FINE) && !defined(ANALYTIC)
// g at a point moved by (ds, dx, dy) less g at the point moved the other way, as one number: two values that are nearly equal
// are never subtracted, so that the sums of such differences keep the digits that differences of sums would lose.
vec4 kernel_change(vec4 s, vec4 ax, vec4 ay, vec4 ds, vec4 dx, vec4 dy) {
    vec4 bell = exp2(-falloff_log2 * (s * s + ax * ax + ay * ay + ds * ds + dx * dx + dy * dy));
    vec4 lean = falloff_log2 * 2.0 * (s * ds + ax * dx + ay * dy);
    vec4 ahead = exp2(-falloff_log2 * ((s + ds) * (s + ds) + (ax + dx) * (ax + dx) + (ay + dy) * (ay + dy)));
    vec4 behind = exp2(-falloff_log2 * ((s - ds) * (s - ds) + (ax - dx) * (ax - dx) + (ay - dy) * (ay - dy)));
    vec4 x = lean * 0.6931471805599453;
    vec4 x2 = x * x;
    vec4 series = -2.0 * bell * x * (1.0 + x2 * 0.16666667 * (1.0 + x2 * 0.05 * (1.0 + x2 * 0.023809524)));
    vec4 inside = mix(ahead - behind, series, lessThan(abs(x), vec4(0.8)));
    vec4 across = max(ahead - edge, 0.0) - max(behind - edge, 0.0);
    return mix(across, inside, greaterThan(min(ahead, behind), vec4(edge)));
}

#ifdef SLAB
// Where a ray is inside the support and the slab.
void chord(vec4 s, vec4 ax, vec4 ay, vec4 wx, vec4 wy, out vec4 low, out vec4 high) {
    vec4 speed2 = 1.0 + wx * wx + wy * wy;
    vec4 nearest = (s - ax * wx - ay * wy) / speed2;
    vec4 cn = ax * wy - ay * wx;
    vec4 cu = -ay - s * wy;
    vec4 cv = s * wx + ax;
    vec4 half_chord = sqrt(max(1.0 - (cn * cn + cu * cu + cv * cv) / speed2, 0.0) / speed2);
    low = clamp(nearest - half_chord, vec4(-slab_half), vec4(slab_half));
    high = clamp(nearest + half_chord, low, vec4(slab_half));
}

// Integral of g along a ray from a to b, inside the support: by quadrature, or where that is too long for its nodes by erf.
vec4 alone(vec4 s, vec4 ax, vec4 ay, vec4 wx, vec4 wy, vec4 a, vec4 b) {
    vec4 reach = max(0.5 * (b - a), 0.0);
    if (reach == vec4(0.0)) {
        return vec4(0.0);
    }
    vec4 middle = 0.5 * (a + b);
    vec4 sum = vec4(0.0);
    for (int n = 0; n < 3; ++n) {
        vec4 near = middle - six_nodes[n] * reach;
        vec4 far = middle + six_nodes[n] * reach;
        sum += six_shares[n] * (kernel_at(s - near, ax + wx * near, ay + wy * near) + kernel_at(s - far, ax + wx * far, ay + wy * far));
    }
    vec4 speed2 = 1.0 + wx * wx + wy * wy;
    vec4 nearest = (s - ax * wx - ay * wy) / speed2;
    vec4 cn = ax * wy - ay * wx;
    vec4 cu = -ay - s * wy;
    vec4 cv = s * wx + ax;
    vec4 root = falloff_root * sqrt(speed2);
    vec4 bell = exp2(-falloff_log2 * (cn * cn + cu * cu + cv * cv) / speed2) * 0.886226925452758 / root;
    vec4 closed = bell * (error_function(root * (b - nearest)) - error_function(root * (a - nearest))) - 2.0 * edge * reach;
    return mix(sum * reach, max(closed, 0.0), greaterThan(root * reach, vec4(0.75)));
}

// The same for means over slabs, by quadrature where both rays are inside the support, in pieces short enough for its nodes, and of
// one alone where the other is not: a quadrature across the end of g would miss it. In perspective neighbouring rays part by `part`
// per unit of tau.
vec4 mean_change(vec4 s, vec4 ax, vec4 ay, vec4 wx, vec4 wy, vec4 ds, vec4 dx, vec4 dy, vec2 part) {
    // Both neighbours' chords, each cut where its own g ends: between them the difference is smooth, and beyond either only one counts.
    vec4 low_a, high_a, low_b, high_b;
    chord(s + ds, ax + dx, ay + dy, wx + part.x, wy + part.y, low_a, high_a);
    chord(s - ds, ax - dx, ay - dy, wx - part.x, wy - part.y, low_b, high_b);
    vec4 low = max(low_a, low_b);
    vec4 high = max(min(high_a, high_b), low);
    bvec4 apart = lessThanEqual(min(high_a, high_b), max(low_a, low_b));
    vec4 piece = (high - low) / float(SLAB_PIECES);
    vec4 sum = vec4(0.0);
    for (int n_piece = 0; n_piece < SLAB_PIECES; ++n_piece) {
        vec4 middle = low + (float(n_piece) + 0.5) * piece;
        for (int n = 0; n < 3; ++n) {
            vec4 near = middle - 0.5 * six_nodes[n] * piece;
            vec4 far = middle + 0.5 * six_nodes[n] * piece;
            sum += six_shares[n] * (kernel_change(s - near, ax + wx * near, ay + wy * near, ds, dx + part.x * near, dy + part.y * near) +
                               kernel_change(s - far, ax + wx * far, ay + wy * far, ds, dx + part.x * far, dy + part.y * far));
        }
    }
    vec4 total = sum * 0.5 * piece;
    // Where only one of the two rays is inside: before and after the common stretch; both whole where there is none.
    total += alone(s + ds, ax + dx, ay + dy, wx + part.x, wy + part.y, low_a, mix(low, high_a, apart));
    total += mix(alone(s + ds, ax + dx, ay + dy, wx + part.x, wy + part.y, high, high_a), vec4(0.0), apart);
    total -= alone(s - ds, ax - dx, ay - dy, wx - part.x, wy - part.y, low_b, mix(low, high_b, apart));
    total -= mix(alone(s - ds, ax - dx, ay - dy, wx - part.x, wy - part.y, high, high_b), vec4(0.0), apart);
    return total / (2.0 * slab_half);
}
#endif
#endif

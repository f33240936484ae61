// Phong shading of a classified point. Source: conventions, section 5.

#if LIGHTS > 0
uniform vec3 light_direction[LIGHTS]; // eye space, unit length, towards the light
uniform vec3 light_color[LIGHTS];
#endif
#ifdef CUT_FACES
vec4 face = vec4(0.0);          // of the point that is shaded: the normal of a cut times what it counts, and that
#endif
uniform vec4 material; // ambient, diffuse, specular, shininess

#ifdef SPECULAR
float power(float base, float exponent) {
    return exponent == 0.0 ? 1.0 : base > 0.0 ? exp2(exponent * log2(base)) : 0.0;
}
#endif

// gradient: of rho in the sheets' unit, per reference length; weakest: g0 in the same unit; view: unit vector towards the camera; spot:
// of the point, as lib/light_volume.glsl has it
#ifdef VOLUMES
vec3 shade(vec3 color, vec3 gradient, float weakest, vec3 view, vec3 spot) {
#else
vec3 shade(vec3 color, vec3 gradient, float weakest, vec3 view) {
#endif
#if LIGHTS == 0
    // A scene without lights shows the colour itself.
    return color;
#else
    float size = length(gradient);
    vec3 normal = size > 0.0 ? -gradient / max(size, weakest) : vec3(0.0);
#ifdef CUT_FACES
    normal = normal * (1.0 - face.a) + face.rgb;
#endif
    vec3 result = color * material.x;
#ifdef OCCLUSION
    result *= ambient_left(spot);
#endif
    for (int l = 0; l < LIGHTS; ++l) {
        float facing = dot(normal, light_direction[l]);
        vec3 side = normal;
#ifdef TWO_SIDED
        if (facing < 0.0) {
            facing = -facing;
            side = -normal;
        }
#endif
        facing = max(facing, 0.0);
        vec3 reflected = color * material.y;
#ifdef SPECULAR
        vec3 mirrored = 2.0 * facing * side - light_direction[l];
        reflected += material.z * power(max(dot(mirrored, view), 0.0), material.w);
#endif
#ifdef SHADOWS
        // Where the light does not fall, nothing is looked up.
        facing *= facing > 0.0 ? left_of(l, spot) : 0.0;
#endif
        result += light_color[l] * facing * reflected;
    }
    return result;
#endif
}

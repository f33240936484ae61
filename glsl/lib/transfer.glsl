// The transfer function, exact between its points: a table of cells leads to the interval, so that no step is smeared.
// Values are in the sheets' unit. Source: conventions, section 4.

uniform isampler2D transfer_index;   // largest point not above the start of each cell; a row for each group
uniform sampler2D transfer_points;   // row 0: r, g, b, opacity; row 1: value, next value, 1 / (next - value); two for each group
#ifdef GROUPS
uniform vec2 transfer_ranges[GROUPS];
uniform int transfer_lasts[GROUPS];
#define transfer_range transfer_ranges[group]
#define transfer_last transfer_lasts[group]
#define INDEX_ROW group
#define COLOR_ROW (2 * group)
#define VALUE_ROW (2 * group + 1)
#else
uniform vec2 transfer_range;         // first value, cells per unit of value
uniform int transfer_last;           // last point
#define INDEX_ROW 0
#define COLOR_ROW 0
#define VALUE_ROW 1
#endif

// r, g, b, opacity per reference length
vec4 transfer(float value) {
    if (!(value >= transfer_range.x)) {
        return texelFetch(transfer_points, ivec2(0, COLOR_ROW), 0);
    }
    int cell = int(min((value - transfer_range.x) * transfer_range.y, float(TRANSFER_CELLS - 1)));
    int point = texelFetch(transfer_index, ivec2(cell, INDEX_ROW), 0).r;
    vec3 span = texelFetch(transfer_points, ivec2(point, VALUE_ROW), 0).xyz;
    while (value >= span.y && point < transfer_last) {
        ++point;
        span = texelFetch(transfer_points, ivec2(point, VALUE_ROW), 0).xyz;
    }
    vec4 from = texelFetch(transfer_points, ivec2(point, COLOR_ROW), 0);
    if (point == transfer_last) {
        return from;
    }
    return mix(from, texelFetch(transfer_points, ivec2(point + 1, COLOR_ROW), 0), clamp((value - span.x) * span.z, 0.0, 1.0));
}

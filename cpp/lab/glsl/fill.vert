// Bare point sprites, to measure what blending alone costs.
uniform float point_size;
layout(location = 0) in vec2 position;

void main() {
    gl_Position = vec4(position, 0.0, 1.0);
    gl_PointSize = point_size;
}

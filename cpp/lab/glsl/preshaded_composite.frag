// A sheet of colours goes behind what is there: the blend does (1 - A) of it.
uniform sampler2D sheet_front_texture;

out vec4 image_out;

void main() {
    vec4 sheet = texelFetch(sheet_front_texture, ivec2(gl_FragCoord.xy), 0);
    image_out = vec4(sheet.rgb, min(sheet.a, 1.0));
}

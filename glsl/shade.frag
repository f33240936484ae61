// Adds finished slices to the picture: SLICES of them in one pass. Source: [NM05] sections 4.2 to 4.4.
#include "lib/interop.h"
#include "lib/sheets.glsl"
#include "lib/compensated.glsl"
#include "lib/picture.glsl"
#ifdef SEVERAL
#include "lib/slices_of_groups.glsl"
#else
#include "lib/slices_of_one.glsl"
#endif

#ifdef READ_IMAGE
uniform sampler2D image_texture;
#ifdef DEPTH_OUT
uniform sampler2D image_depth_texture;
#endif
#endif
#ifdef COVERAGE
uniform sampler2D image_coverage_texture;
#endif
#ifdef COMPENSATED
uniform sampler2D image_error_texture;
#endif
#if defined(DOUBT) && defined(READ_IMAGE)
uniform sampler2D image_doubt_texture;
#endif

out vec4 image_out;
#ifdef DEPTH_OUT
out float depth_out;
#endif
#ifdef COVERAGE
out vec2 coverage_out;
#endif
#ifdef COMPENSATED
out vec4 error_out;
#endif
#ifdef DOUBT
out vec4 doubt_out; // where passes are blended, opacity in a
#endif

void main() {
    ivec2 at = ivec2(gl_FragCoord.xy);
    Pixel so_far = empty_pixel();
#ifdef READ_IMAGE
    so_far.image = texelFetch(image_texture, at, 0);
#ifdef DEPTH_OUT
    so_far.depth = texelFetch(image_depth_texture, at, 0).r;
#endif
#endif
#ifdef COVERAGE
    so_far.covered = texelFetch(image_coverage_texture, at, 0).rg;
#endif
#ifdef COMPENSATED
    so_far.error = texelFetch(image_error_texture, at, 0);
#endif
#if defined(DOUBT) && defined(READ_IMAGE)
    so_far.doubt = texelFetch(image_doubt_texture, at, 0).r;
#endif
    shade_slices(at, so_far);
    image_out = so_far.image;
#ifdef DEPTH_OUT
    depth_out = so_far.depth;
#endif
#ifdef COVERAGE
    coverage_out = so_far.covered;
#endif
#ifdef COMPENSATED
    error_out = so_far.error;
#endif
#ifdef DOUBT
    doubt_out = vec4(so_far.doubt, 0.0, 0.0, so_far.image.a);
#endif
}

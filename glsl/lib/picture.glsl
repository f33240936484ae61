// What shading passes read and write beside the sheets, and where their pixels and slabs lie. shade.frag and shade_groups.frag.

#if defined(PERSPECTIVE) || defined(VOLUMES)
uniform vec2 axis;              // pixel of the optical axis
#endif
#ifdef PERSPECTIVE
uniform float pixel;            // slope of one pixel
#endif
#if defined(PERSPECTIVE) || defined(DEPTH_OUT)
uniform float first_depth;      // of the first slab in the array
uniform float slice_spacing;
#endif
#if defined(PREINTEGRATION) && defined(DEPTH_OUT)
uniform int nearest_slab;       // of the array: that of the least depth that an interval reports
#endif
#if (defined(SLOPES) && !defined(ANALYTIC)) || defined(CLIP) || defined(OWNED) || defined(ENDS) || defined(OPEN_FRONT)
uniform int first_slab;         // of the array, counted from the first slice
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
out vec2 coverage_out; // sum and its rounding error
#endif
#ifdef COMPENSATED
out vec4 error_out;
#endif
#ifdef DOUBT
out vec4 doubt_out; // sum of squares (lib/doubt.glsl); where passes are blended, opacity in a
#endif

// Slices of this pass are CENTER ... CENTER + SLICES - 1 of the array; intervals start one earlier, since their far end needs a gradient too.
#define CENTER (SLABS - 1 - SLICES)
#define INTERVAL (SLABS - 2 - SLICES)

// Which slices of a pixel are kept. Half spaces and a depth limit leave one run of them; the processor finds it in float64, so that a point near a plane
// falls to the side on which it lies. Needs first_slab. Source: conventions, section 10.

uniform isampler2D clip_texture; // of each pixel: the first slice that is kept, the last one

bool is_kept(ivec2 run, int slab) { return first_slab + slab >= run.x && first_slab + slab <= run.y; }

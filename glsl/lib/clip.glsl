// Which slices of a pixel are kept, and which belong to the part of a whole that is drawn. Half spaces and a depth limit leave one run of
// slices, and so do the end of a group's fields and a part's cell; the processor finds them in float64, so that a point near a plane falls
// to the side on which it lies. Needs first_slab. Source: conventions, sections 2, 10 and 11.

bool is_in(ivec2 run, int slab) { return first_slab + array_first + slab >= run.x && first_slab + array_first + slab <= run.y; }
#if defined(CLIP) || defined(OWNED)
uniform isampler2D clip_texture; // of each pixel: the first slice that is kept, the last one, the first and the last that belong
#endif
#ifdef CLIP
bool is_kept(ivec4 runs, int slab) { return is_in(runs.rg, slab); }
#endif
#ifdef OWNED
// Slice, and the interval behind it.
bool is_owned(ivec4 runs, int slab) { return is_in(runs.ba, slab); }
#endif
#ifdef ENDS
uniform isampler2DArray end_texture; // of each pixel, a layer for each group: the first and the last slice inside its fields' end
#endif

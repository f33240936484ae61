// What the two stages of the splat pass agree on.
uniform vec2 target_size;  // pixels of the sheets
uniform vec2 axis;         // pixel where the optical axis meets the sheets
uniform mat2 to_unit;      // pixels (times depth in perspective) -> plane of the unit sphere

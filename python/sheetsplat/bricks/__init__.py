"""One picture drawn in bricks: parts of a field that are drawn by themselves and composited. Conventions, section 11.

Nothing here knows how bricks are spread over processes: `partition` cuts a field, `whole` holds what all bricks share,
`view` says what a picture needs of each brick, `draw` draws one, `partial` composites what was drawn.
"""

// Constants that C++ and GLSL share. Both compilers read this file, so it holds preprocessor lines only.
#ifndef SHEETSPLAT_INTEROP_H
#define SHEETSPLAT_INTEROP_H

// Texture units.
#define UNIT_SHEET_FRONT 0
#define UNIT_SHEET_BACK 1
#define UNIT_WEIGHT_FRONT 2
#define UNIT_WEIGHT_BACK 3
#define UNIT_IMAGE 4
#define UNIT_IMAGE_DEPTH 5
#define UNIT_IMAGE_COVERAGE 6
#define UNIT_TRANSFER_INDEX 7
#define UNIT_TRANSFER_POINTS 8
#define UNIT_SLOPE_X_FRONT 9
#define UNIT_SLOPE_X_BACK 10
#define UNIT_SLOPE_Y_FRONT 11
#define UNIT_SLOPE_Y_BACK 12
#define UNIT_SLOPE_Z_FRONT 13
#define UNIT_SLOPE_Z_BACK 14
#define UNIT_WEIGHT_X_FRONT 15
#define UNIT_WEIGHT_X_BACK 16
#define UNIT_WEIGHT_Y_FRONT 17
#define UNIT_WEIGHT_Y_BACK 18
#define UNIT_WEIGHT_Z_FRONT 19
#define UNIT_WEIGHT_Z_BACK 20
#define UNIT_IMAGE_ERROR 21
#define UNIT_CLIP 22
#define UNIT_LIGHT_VOLUMES 23
#define UNIT_ENDS 24
#define UNIT_IMAGE_DOUBT 25
#define UNIT_FACES 26
#define UNIT_RECORDS 0
// Ellipsoids as [NM06] draws them: in passes of their own.
#define UNIT_KERNEL_ORDER 0
#define UNIT_KERNEL_CENTER 1
#define UNIT_KERNEL_SCALE 2
#define UNIT_KERNEL_ROTATION 3
#define UNIT_SLICED_START 0
#define UNIT_SLICED_AXES 1
#define UNIT_SLICED_STEP 2
#define UNIT_GAUSSIAN 3

// Volumes of the compute path: one unit each, from here on, and then those of their visible blocks.
#define UNIT_LATTICES 27
#define MOST_LATTICES 4
// Storage buffers of the compute path.
#define BUFFER_PARTS 0
#define BUFFER_RECORDS 1
#define BUFFER_ORDER 2
#define BUFFER_BOUNDS 3
#define BUFFER_COUNTS 4
// Images that it writes.
#define IMAGE_PICTURE 0
#define IMAGE_DEPTH 1
#define IMAGE_COVERAGE 2
#define IMAGE_ERROR 3
#define IMAGE_DOUBT 4
// Kernels of a leaf of the tree of bounds, and children of a node.
#define TREE_ARITY 64
// Samples along an edge of a block of a volume.
#define BLOCK_EDGE 8

// Vertex attributes.
#define ATTRIBUTE_SAMPLE 0
#define ATTRIBUTE_BOX 1
#define ATTRIBUTE_RECTANGLE 0
// Records of ellipsoids: four vec4.
#define ATTRIBUTE_RECORD_PLACE 0
#define ATTRIBUTE_RECORD_HEIGHTS 1
#define ATTRIBUTE_RECORD_AXES 2
#define ATTRIBUTE_RECORD_STEP 3
#define ATTRIBUTE_RECORD_INDEX 0
// What float32 cut off a record: three vec4.
#define ATTRIBUTE_REST_HEIGHTS 4
#define ATTRIBUTE_REST_AXES 5
#define ATTRIBUTE_REST_STEP 6
// Kernels on their way to records.
#define ATTRIBUTE_KERNEL_CENTER 0
#define ATTRIBUTE_KERNEL_AXIS_A 1
#define ATTRIBUTE_KERNEL_AXIS_B 2
#define ATTRIBUTE_KERNEL_AXIS_C 3
#define ATTRIBUTE_KERNEL_AMOUNT 4

// Cells of the table that finds a value's interval between transfer-function points.
#define TRANSFER_CELLS 1024

// Texels of a row where a texture is a list of kernels.
#define KERNEL_COLUMNS 1024

// Pixels of a tile's edge where tagging is by tiles.
#define TILE_EDGE 32

#endif

// Constants that the lab's C++ and GLSL share, beside those of lib/interop.h.
#ifndef SHEETSPLAT_LAB_INTEROP_H
#define SHEETSPLAT_LAB_INTEROP_H

#define UNIT_GATHER_LISTS 0
#define UNIT_GATHER_ENTRIES 1
#define UNIT_GATHER_RECORDS 2

#define ATTRIBUTE_COLOR 2

#endif

#ifndef V2V3D_BASE_PI_H
#define V2V3D_BASE_PI_H

/** The ratio of a circle's circumference to its diameter, which C17 does not name. */
#define V2V_PI 3.14159265358979323846

#endif

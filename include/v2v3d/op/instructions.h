#ifndef V2V3D_OP_INSTRUCTIONS_H
#define V2V3D_OP_INSTRUCTIONS_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/** A number for the instructions that convolutions are computed with here: processors of equal
 *  numbers round alike. Asked at run time; oneDNN's share of it heeds DNNL_MAX_CPU_ISA.
 *  @kind Local. @return >= 0 */
int64_t v2v_op_instructions(void);

#ifdef __cplusplus
}
#endif

#endif

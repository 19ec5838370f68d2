#ifndef V2V3D_OP_BF16_H
#define V2V3D_OP_BF16_H

#ifdef __cplusplus
extern "C" {
#endif

/** How convolutions in bf16 are computed on this processor; a larger value is better. */
enum v2v_bf16 {
    V2V_BF16_NONE,     /**< not at all */
    V2V_BF16_EMULATED, /**< with the same rounding by float32 instructions: slower than float32 */
    V2V_BF16_NATIVE,   /**< with its own instructions, by oneDNN */
    V2V_BF16_TILES     /**< by our own kernels on the tile unit (AMX) */
};

/** What convolutions will do here, asked at run time of the processor and the system;
 *  DNNL_MAX_CPU_ISA takes instructions away from both kinds. @kind Local. @return enum v2v_bf16 */
int v2v_op_bf16(void);

/** A kind in words, for people. @param kind enum v2v_bf16 @kind Local. */
const char *v2v_op_bf16_text(int kind);

#ifdef __cplusplus
}
#endif

#endif

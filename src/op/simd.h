#ifndef OP_SIMD_H
#define OP_SIMD_H

/** One binary, the processor's own instructions: the dynamic linker picks the clone. The loops of a
 *  clone hold no OpenMP region (its outlined body would not be cloned). The address sanitizer runs
 *  before the resolvers may: one plain version there. */
#if defined(__SANITIZE_ADDRESS__)
#define V2V_SIMD_CLONES
#else
#define V2V_SIMD_CLONES                                                                            \
    __attribute__((target_clones("arch=x86-64-v4", "arch=x86-64-v3", "default")))
#endif

#endif

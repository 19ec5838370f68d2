/** One binary, the processor's own instructions. */
#ifndef V2V3D_BASE_CLONES_H
#define V2V3D_BASE_CLONES_H

/** Compiles a hot loop for AVX-512, AVX2 and plain machines; the dynamic linker picks the clone.
 *  The loops of a clone hold no OpenMP region (its outlined body would not be cloned). One plain
 *  version elsewhere than on x86-64, without V2V_SIMD, and under the address sanitizer, which is
 *  set up after the dynamic linker has chosen. */
#if defined(V2V_X86) && !defined(__SANITIZE_ADDRESS__)
#define V2V_SIMD_CLONES                                                                            \
    __attribute__((target_clones("arch=x86-64-v4", "arch=x86-64-v3", "default")))
#else
#define V2V_SIMD_CLONES
#endif

#endif

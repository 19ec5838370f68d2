#ifndef V2V3D_SRC_OPTICS_SIMD_H
#define V2V3D_SRC_OPTICS_SIMD_H

/** Compile a hot loop for AVX-512, AVX2 and plain machines and choose at load time. The resolvers
 *  run before the sanitizers are set up, so sanitized builds do without. */
#ifdef __SANITIZE_ADDRESS__
#define V2V_OPTICS_SIMD_CLONES
#else
#define V2V_OPTICS_SIMD_CLONES                                                                     \
    __attribute__((target_clones("arch=x86-64-v4", "arch=x86-64-v3", "default")))
#endif

#endif

/* Which instructions this room computes with: asked here by all who choose between kernels and by
 * all who call oneDNN, before they do. All calls are local, by any thread. */
#ifndef OP_ISA_H
#define OP_ISA_H

/* oneDNN's instructions, bits of dnnl_cpu_isa_t; 0 elsewhere than on x86-64. The first call keeps
 * oneDNN away from the tile unit: on processors where our kernels run, those of oneDNN 2.6 can die
 * of an illegal instruction at their first tile. A lower DNNL_MAX_CPU_ISA is heeded. */
unsigned v2v_onednn_isa(void);

/* Has the processor tiles, does DNNL_MAX_CPU_ISA leave them to us, and may this process use them?
 * The first call asks the system. */
int v2v_amx_usable(void);

/* The widest of this room's sets of kernels that the processor has: places in V2V_KERNEL_SETS. */
enum { V2V_SET_ANY, V2V_SET_AVX2, V2V_SET_AVX512 };
int v2v_kernel_set(void);

/* Kernels of one kind for every set of this build. */
#ifdef V2V_X86
#define V2V_KERNEL_SETS(name)                                                                      \
    {                                                                                              \
        &name##_any, &name##_avx2, &name##_avx512                                                  \
    }
#else
#define V2V_KERNEL_SETS(name)                                                                      \
    {                                                                                              \
        &name##_any                                                                                \
    }
#endif

#endif

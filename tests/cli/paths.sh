#!/usr/bin/env bash
# `check` where a library dies of an illegal instruction: it says which, and what helps, and lives.
# shellcheck source=tests/cli/lib.sh
. "$(dirname "$0")/lib.sh"

works check
for path in 'own kernels' 'Winograd' oneDNN OpenBLAS; do
    says "^convolution, $path +ok$"
done

export LD_PRELOAD=${V2V_DYING}dnnl_primitive_execute.so
refuses 70 '1 of the checks above failed' check
says '^convolution, oneDNN +FAILED: died, Illegal instruction; what helps: DNNL_MAX_CPU_ISA=AVX2 '
says '^convolution, OpenBLAS +ok$'
works check --set model.backend=openblas
says '^convolution, oneDNN +FAILED: .*; these settings do not use it'

export LD_PRELOAD=${V2V_DYING}cblas_sgemm.so
works check
says '^convolution, OpenBLAS +FAILED: .*; these settings do not use it'
refuses 70 '1 of the checks above failed' check --set model.backend=openblas
says '^convolution, OpenBLAS +FAILED: died, Illegal instruction; .* --set model.backend=onednn'
unset LD_PRELOAD
finish

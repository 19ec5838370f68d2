/** What the machine can do: the rates that floors are made of. */
#ifndef V2V_BENCH_FLOOR_H
#define V2V_BENCH_FLOOR_H

#include "bench/work.h"
#include "v2v3d/bench/bench.h"

/** Measure once more and keep the best of each rate. Takes memory only while it runs.
 *  @kind Local. @return V2V_OK | V2V_E_MEMORY */
enum v2v_status v2v_floor_measure(struct v2v_bench_rates *rates) V2V_MUST_CHECK;

/** max(multiply-adds over the fastest GEMM's rate, bytes over the copy rate). @kind Local */
double v2v_floor_seconds(const struct v2v_bench_rates *rates, const struct v2v_work *work);

#endif

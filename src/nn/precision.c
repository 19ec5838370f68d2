#include "v2v3d/nn/precision.h"

#include "v2v3d/base/log.h"
#include "v2v3d/conf/config.h"
#include "v2v3d/op/bf16.h"

#include <stdint.h>

/* The slowest of the ranks' kinds, and how many ranks have it. */
static void log_kinds(const struct v2v_comm *comm)
{
    int64_t negated = -v2v_op_bf16();
    v2v_par_max_i64(comm, &negated, 1);
    int64_t slowest = -negated, have = v2v_op_bf16() == slowest;
    v2v_par_sum_i64(comm, &have, 1);
    v2v_log(V2V_LOG_INFO, "convolutions in bf16: %s, on %lld of %d ranks",
            v2v_op_bf16_text((int)slowest), (long long)have, v2v_comm_size(comm));
}

enum v2v_status v2v_precision_agree(int *precision, int wanted, const struct v2v_comm *comm)
{
    int least = wanted == V2V_PRECISION_BF16_ALWAYS ? V2V_BF16_EMULATED : V2V_BF16_NATIVE;
    int64_t without = v2v_op_bf16() < least;
    int ranks = v2v_comm_size(comm);
    *precision = V2V_PRECISION_F32;
    if (wanted == V2V_PRECISION_F32) {
        return V2V_OK;
    }
    v2v_par_sum_i64(comm, &without, 1);
    if (without > 0 && wanted == V2V_PRECISION_BF16_ALWAYS) {
        return V2V_FAIL(V2V_E_CONFIG,
                        "precision bf16-always: the processors of %lld of %d ranks have no "
                        "AVX-512, which bf16 takes at least",
                        (long long)without, ranks);
    }
    if (without > 0) {
        if (v2v_comm_rank(comm) == 0) {
            v2v_log(V2V_LOG_WARNING,
                    "precision bf16: the processors of %lld of %d ranks have no instructions for "
                    "it, all go on in float32",
                    (long long)without, ranks);
        }
        return V2V_OK;
    }
    *precision = V2V_PRECISION_BF16;
    log_kinds(comm);
    return V2V_OK;
}
